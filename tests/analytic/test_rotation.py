"""Bodies of revolution that turn, against closed forms in the frame that does not turn.

A wave e^{i(ωt + mθ)} of the body's cylindrical components that has ω₀ in the body has ω₀ − mΩ here: m = −n runs with
the rotation, m = n against it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.sparse.linalg import spsolve
from selection import some

from fe_squeal.eigen.pencil import Pencil
from fe_squeal.eigen.request import Request
from fe_squeal.eigen.solve import solve_modes
from fe_squeal.fem import gyroscopics
from fe_squeal.fem.element_matrices import assemble_elasticity
from fe_squeal.fem.materials import Material, stiffness_tensor
from fe_squeal.fem.motion import SteadyMotion
from fe_squeal.fem.spaces import make_space
from meshes import KINDS, STEEL, annulus, make_problem, mapped, modes_of, rotation

OUTER, INNER, THICKNESS = 0.2, 0.1, 0.004
RING_INNER, RING_RADIUS, RING_OUTER, RING_WIDTH = 0.198, 0.2, 0.202, 0.004
RHO, E = STEEL["density"], STEEL["youngs_modulus"]
ELASTICITY = stiffness_tensor(Material(**STEEL))


class Body:
    def __init__(self, mesh, order=2, held=()):
        self.space = make_space(mesh, order, [(mesh.boundaries[group], "xyz") for group in held])
        self.elements = np.arange(mesh.nelements)
        self.K, self.M = assemble_elasticity(self.space, self.elements, ELASTICITY, RHO)

    def gyroscopic(self, motion):
        return gyroscopics.gyroscopic_matrices(self.space, self.elements, RHO, motion)

    def circulatory(self, motion):
        return gyroscopics.circulatory_matrices(self.space, self.elements, self.K, RHO, motion)

    def rigid(self):
        """Return (n, 6): translations along and rotations about x, y and z, of a body that is not held."""
        x = self.space.coordinates
        fields = [np.tile(e, (len(x), 1)) for e in np.eye(3)] + [np.cross(e, x) for e in np.eye(3)]
        return np.stack([field.ravel() for field in fields], axis=1)


def disc(held=()):
    return Body(annulus("hex2", (2, 20, 1), INNER, OUTER, THICKNESS), held=held)


def ring():
    return Body(annulus("hex2", (1, 24, 1), RING_INNER, RING_OUTER, RING_WIDTH))


def about_z(speed, centre=(0.0, 0.0, 0.0)):
    return SteadyMotion(np.array([0.0, 0.0, speed]), np.array(centre))


def radial(x):
    return np.column_stack([x[:, :2] / np.linalg.norm(x[:, :2], axis=1, keepdims=True), np.zeros(len(x))])


def axial(x):
    return [0.0, 0.0, 1.0]


def waves(body, modes, n, direction):
    """Return λ of the waves with n diameters in a direction field, with and against the rotation."""
    x = body.space.coordinates
    u = np.stack([(body.space.expand(shape) * direction(x)).sum(axis=1) for shape in modes.right.T])
    share = np.abs(u @ np.exp(-1j * np.outer(np.arctan2(x[:, 1], x[:, 0]), [-n, n])))
    return modes.lam[np.argmax(share, axis=0)]  # of modes of unit mass


def solve(body, count, K=None, C=None):
    K = body.K if K is None else sp.csr_array(body.K + K)
    return solve_modes(Pencil(body.M, K, C, symmetric=C is None), Request(count=count))


@pytest.mark.parametrize("kind", KINDS)
def test_gyroscopic_matrix_is_skew_and_convected_stiffness_symmetric(kind):
    turning = rotation()
    mesh = mapped(annulus(kind, (1, 8, 1), INNER, OUTER, THICKNESS), lambda x: turning @ x + 0.3)
    motion = SteadyMotion(40.0 * turning[:, 2], np.full(3, 0.3))
    it = Body(mesh, int(kind[-1]))
    G, K = it.gyroscopic(motion)
    B_K, B_M = it.circulatory(motion)
    for skew in (G, B_K, B_M):
        assert abs(skew).max() > 0 and abs(skew + skew.T).max() == 0.0
    assert abs(K - K.T).max() == 0.0
    assert np.linalg.eigvalsh(K.toarray()).max() <= 1e-12 * abs(K).max()


def test_rigid_motions_have_the_inertia_of_the_annulus():
    """Translations do not convect; e × r convects to e × w, so that K_Ω and G of two are moments of inertia.

    Fixed here, they turn backwards in the body, without strain: Lu = −Ω × e and −(Ω × e) × r.
    """
    speed, it = 40.0, disc()
    G, K = it.gyroscopic(about_z(speed))
    B_K, B_M = it.circulatory(about_z(speed))
    shifts, (x_turn, y_turn, z_turn) = it.rigid()[:, :3], it.rigid().T[3:]
    for A, u in ((G, shifts), (K, shifts), (B_K, it.rigid())):
        assert np.abs(A @ u).max() <= 1e-10 * np.abs(A).max()
    polar = RHO * THICKNESS * np.pi / 2 * (OUTER**4 - INNER**4)
    assert z_turn @ K @ z_turn == pytest.approx(-(speed**2) * polar, rel=1e-4)
    assert x_turn @ K @ x_turn == pytest.approx(-(speed**2) * polar / 2, rel=1e-4)
    assert x_turn @ G @ y_turn == pytest.approx(speed * polar, rel=1e-4)
    assert abs(x_turn @ G @ z_turn) <= 1e-10 * speed * polar
    size = speed * RHO * THICKNESS * np.pi * (OUTER**2 - INNER**2)
    np.testing.assert_allclose(shifts.T @ B_M @ shifts, size * np.cross(np.eye(3)[2], np.eye(3)), atol=1e-4 * size)


@pytest.mark.parametrize("speed", some([30.0, -30.0], lambda speed: speed > 0))
def test_bending_waves_split_by_n_times_the_speed(speed):
    it = disc()
    at_rest = solve(it, 12)
    G, K = it.gyroscopic(about_z(speed))
    turning = solve(it, 16, K, G)
    for n in (2, 3):
        rest = waves(it, at_rest, n, axial).imag
        forward, backward = waves(it, turning, n, axial).imag
        assert forward - backward == pytest.approx(2 * n * speed, rel=1e-3)
        # Second order in Ω is (nΩ)²/ω₀ if the two matrices do not fit together: 5 rad/s.
        assert (forward + backward) / 2 == pytest.approx(rest[0], abs=0.1)


def test_ring_waves_in_its_plane_split_by_coriolis_too():
    """Thin inextensional ring: the pattern turns with Ω(n² − 1)/(n² + 1), as found by Bryan (1890)."""
    speed, it = 20.0, ring()
    G, K = it.gyroscopic(about_z(speed))
    turning = solve(it, 20, K, G)
    for n in (2, 3):
        forward, backward = waves(it, turning, n, radial).imag
        assert forward - backward == pytest.approx(2 * n * speed * (n**2 - 1) / (n**2 + 1), rel=5e-4)


@pytest.mark.parametrize("rounding", [1e-16, 1e-15])
@pytest.mark.parametrize("seed", [1, 2])
def test_rounding_does_not_hold_motions_that_nothing_holds(rounding, seed):
    """A ring is so soft that rounding in K Z turns Z by 1e-7, which gyroscopic forces on the rest of it then see.

    Rounding of entries by itself moves λ by up to 1e9 times as much, relatively: by −ψᴴδQ(λ)φ/ψᴴ(2λM + G)φ, which is
    known.
    """
    it, rng = ring(), np.random.default_rng(seed)
    G, K = it.gyroscopic(about_z(20.0))

    def rounded(A, sign):
        B = sp.csr_array(A)
        B.data = B.data * (1 + rounding * rng.standard_normal(B.nnz))
        return sp.csr_array((B + sign * B.T) / 2)

    exact, whole = solve(it, 20, K, G), it.K + K
    M, C, K = rounded(it.M, 1), rounded(G, -1), rounded(whole, 1)
    found = solve_modes(Pencil(M, K, C), Request(count=20))
    assert np.count_nonzero(found.lam == 0) == np.count_nonzero(exact.lam == 0) == 3
    swings = exact.lam.imag > 100
    lam, phi, psi = exact.lam[swings], exact.right[:, swings], exact.left[:, swings].conj()
    moved = ((M - it.M) @ phi) * lam**2 + ((C - G) @ phi) * lam + (K - whole) @ phi
    lam = lam - (psi * moved).sum(axis=0) / (psi * (2 * lam * (it.M @ phi) + G @ phi)).sum(axis=0)
    np.testing.assert_allclose(found.lam.imag[: len(exact)][swings], lam.imag, rtol=1e-8)
    assert found.re_uncertainty[: len(exact)][swings].max() < 10 * exact.re_uncertainty[swings].max() < 0.1


@pytest.mark.parametrize(
    ("held", "kind"),
    some([((), "beta"), (("hub",), "beta"), ((), "alpha")], lambda held, kind: kind == "alpha"),
)
def test_damping_in_the_body_does_not_see_the_frame(held, kind):
    """μ = λ + imΩ obeys μ² + 2δμ + ω₀² = 0, 2δ = βω₀² or α; without the circulatory matrix λ stands for this μ."""
    it, n = disc(held), 2
    rest = waves(it, solve(it, 12), n, axial).imag[0]
    speed, delta, ways = 0.1 * rest, 0.01 * rest, np.array([1, -1])
    G, K = it.gyroscopic(about_z(speed))
    B_K, B_M = it.circulatory(about_z(speed))
    beta = 2 * delta / rest**2
    damping, B = (beta * it.K, beta * B_K) if kind == "beta" else (2 * delta * it.M, 2 * delta * B_M)
    C = sp.csr_array(G + damping)
    seen = waves(it, solve(it, 18, K + B, C), n, axial)
    np.testing.assert_allclose(seen.real, -delta, rtol=1e-3)
    np.testing.assert_allclose(seen.imag, np.sqrt(rest**2 - delta**2) + ways * n * speed, rtol=1e-3)
    unseen = waves(it, solve(it, 18, K, C), n, axial)
    np.testing.assert_allclose(unseen.real, -delta * (1 + ways * n * speed / rest), rtol=1e-3)


def test_centrifugal_load_on_a_ring():
    speed, it = 50.0, ring()
    f = gyroscopics.centrifugal_load(it.space, it.elements, RHO, about_z(speed))
    total = speed**2 * RHO * RING_WIDTH * 2 * np.pi * (RING_OUTER**3 - RING_INNER**3) / 3
    np.testing.assert_allclose(it.space.expand(f).sum(axis=0), 0.0, atol=1e-11 * total)
    assert radial(it.space.coordinates).ravel() @ f == pytest.approx(total, rel=1e-4)
    # Held against rigid motions by the mass, the ring expands by ρΩ²r³/E.
    x, rigid = it.space.coordinates, it.M @ it.rigid()
    bordered = sp.block_array([[it.K, rigid], [rigid.T, None]], format="csc")
    u = it.space.expand(spsolve(bordered, np.append(f, np.zeros(6)))[: len(f)])
    middle = np.abs(np.linalg.norm(x[:, :2], axis=1) - RING_RADIUS) < 1e-6
    np.testing.assert_allclose((u * radial(x)).sum(axis=1)[middle], RHO * speed**2 * RING_RADIUS**3 / E, rtol=2e-3)


@pytest.mark.parametrize("speed", some([30.0, 300.0], lambda speed: speed == 300))
def test_growth_of_a_freely_spinning_disc_does_not_exist_and_is_said(speed):
    """K_Ω alone gives the turning about the axis Re λ = Ω; the stiffness of the centrifugal stress cancels it.

    A warning says so with that number and with what to write; with what it says to write, nothing grows.
    """
    ring = annulus("hex2", (1, 12, 1), 0.10, 0.15, 0.02)
    rotation = {"rotation": {"bodies": ["disc"], "axis": [0, 0, 1], "speed": speed}}
    held = [{"surface": "bottom", "fixed": "z"}]
    bare = make_problem(ring, supports=held, effects=rotation)
    lam = modes_of(bare, 6).lam
    assert lam.real.max() == pytest.approx(speed, rel=1e-3)  # 12 elements around
    [text] = bare.discretisation.warnings
    assert f"growth of up to Re λ = Ω = {speed:g} 1/s appears that does not exist" in text
    assert "write [effects.preload] and [effects.stress_stiffening]" in text
    whole = make_problem(ring, supports=held, effects={**rotation, "preload": {}, "stress_stiffening": {}})
    assert whole.discretisation.warnings == ()
    assert np.abs(modes_of(whole, 6).lam.real).max() < 1e-3 * speed


def test_growth_of_a_rotor_of_two_bodies_does_not_exist_either_and_is_said():
    ring = annulus("hex2", (1, 12, 2), 0.10, 0.15, 0.02)
    upper = ring.p[2, ring.t].mean(axis=0) > 0.01
    ring = replace(ring, _subdomains={"disc": np.flatnonzero(~upper), "hat": np.flatnonzero(upper)})
    rotation = {"rotation": {"bodies": ["disc", "hat"], "axis": [0, 0, 1], "speed": 300.0}}
    bare = make_problem(ring, supports=[{"surface": "bottom", "fixed": "z"}], effects=rotation)
    assert modes_of(bare, 6).lam.real.max() == pytest.approx(300.0, rel=1e-3)  # 12 elements around
    [text] = bare.discretisation.warnings
    assert "bodies disc and hat together are free to turn about the axis;" in text
    assert "growth of up to Re λ = Ω = 300 1/s appears that does not exist" in text
