"""What friction must not depend on: units, orientation, how a sign is written; and the symmetry of undamped spectra."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from dense import all_eigenvalues
from selection import some

import fe_squeal
from fe_squeal.eigen.request import Request
from fe_squeal.eigen.solve import solve_modes
from fe_squeal.geometry import Block, DiscPad, write_mesh
from meshes import STEEL, box, join, make_problem, mapped, modes_of, rotation

WOOD = {
    "youngs_modulus": [9e9, 5e9, 3e9], "poisson_ratio": [0.3, 0.25, 0.35], "shear_modulus": [1e9, 1.5e9, 2e9],
    "density": 900.0,
}  # fmt: skip
STIFFNESS = 2e11  # N/m per m^2
MU = 0.8


def brake(Q=None, speed=2.0, counts=((4, 3, 2), (3, 2, 1)), supported=True):
    """A wooden pad on a steel belt that is held below, with an inclined spring; all turned by Q."""
    Q = np.eye(3) if Q is None else Q
    belt = box("hex2", counts[0], (0.12, 0.1, 0.03), (-0.06, -0.05, -0.03), name="belt")
    pad = box("hex2", counts[1], (0.06, 0.04, 0.02), (-0.02, -0.025, 0.0), name="pad")
    mesh = mapped(join(belt, pad), lambda x: Q @ x)

    def turned(*v):
        return (Q @ np.array(v, float)).tolist()

    contact = {
        "surface": "bottom_pad", "counterface": "top_belt", "normal_stiffness": STIFFNESS,
        "sliding": {"direction": turned(1, 0.2, 0), "speed": speed},
    }  # fmt: skip
    spring = {"name": "piston", "surface": "top_pad", "direction": turned(0.3, 0.1, 1), "stiffness": 2e8}
    return make_problem(
        mesh,
        materials={"steel": STEEL, "wood": WOOD},
        bodies={
            "belt": {"material": "steel"},
            "pad": {"material": "wood", "axes": [turned(1, 0.5, 0.2), turned(0, 1, 0.1)]},
        },
        supports=[{"surface": "bottom_belt", "fixed": "xyz"}] if supported else [],
        springs=[spring] if supported else [],
        contacts=[contact],
        effects={"friction": {"mu": MU}},
    )


@functools.cache
def plain(mu=MU):
    """Return the modes of the brake as it is."""
    return modes_of(brake(), 16, mu=mu)


def same_spectrum(a, b, tolerance=1e-9):
    """Compare two spectra sorted by frequency; growth rates count relative to |λ|."""
    a, b = (x[np.lexsort((x.real, np.round(x.imag, -1)))] for x in (a, b))
    np.testing.assert_allclose(a, b, rtol=tolerance)


def test_friction_acts_here():
    """Guard of the tests below: at μ = 0 nothing grows, at μ = 0.8 the spectrum is another one."""
    assert np.abs(plain(0.0).lam.real).max() == 0.0
    assert plain().lam.real.max() > 100.0


def test_negative_mu_is_reversed_sliding():
    """t changes its sign with the velocity, and only μt enters: the same matrix, so 1e-9 is the solver's."""
    backwards = plain(-MU).lam
    same_spectrum(backwards, modes_of(brake(speed=-2.0), 16).lam)
    assert np.abs(backwards[:16] - plain().lam[:16]).max() > 100.0  # rad/s: it is not even in μ


def test_turned_in_space():
    """Mesh, material axes, spring and sliding turned together; the support holds x, y and z: nothing changes."""
    same_spectrum(modes_of(brake(rotation()), 16).lam, plain().lam)


GEOMETRIES = {
    "block": (Block, {"length": 0.06, "width": 0.04, "height": 0.02, "size": 0.02, "belt_thickness": 0.02}, {}),
    "disc": (
        DiscPad,
        {
            "inner_radius": 0.07, "outer_radius": 0.13, "thickness": 0.012, "pad_inner_radius": 0.085,
            "pad_outer_radius": 0.128, "pad_thickness": 0.011, "size": 0.03,
        },
        {"pad_angle_deg": 50, "pads": 1},
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", some(GEOMETRIES, lambda name: name == "block"))
def test_metres_and_millimetres(name, tmp_path):
    """The same geometry in a file in metres and one in millimetres with length_unit = "mm"; gap 0, 1e-9."""
    geometry, lengths, others = GEOMETRIES[name]
    groups = {
        "block": ("belt_bottom", "bottom", "belt_top", {"direction": [1, 0, 0], "speed": 1.0}, ["block", "belt"]),
        "disc": ("hub", "pad_face_1", "disc_face_1", {"axis": [0, 0, 1], "speed": 5.0}, ["disc", "pad_1"]),
    }[name]
    held, pad, counter, sliding, bodies = groups
    spectra = []
    for unit, scale in (("m", 1.0), ("mm", 1e3)):
        path = tmp_path / f"{unit}.msh"
        write_mesh(geometry(**{k: v * scale for k, v in lengths.items()}, **others), path)
        scene = {
            "mesh": {"file": str(path), "length_unit": unit},
            "materials": {"steel": STEEL},
            "bodies": {b: {"material": "steel"} for b in bodies},
            "supports": [{"surface": held, "fixed": "xyz"}],
            "contacts": [{"surface": pad, "counterface": counter, "normal_stiffness": STIFFNESS, "sliding": sliding}],
            "effects": {"friction": {"mu": MU}},
        }
        problem = fe_squeal.assemble(fe_squeal.parse_scene(scene))
        spectra.append(modes_of(problem, 12).lam)
    keep = np.abs(spectra[0]) > 1.0  # rigid sliding of the pad is zero in both
    assert (np.abs(spectra[1][~keep]) <= 1.0).all()
    same_spectrum(spectra[0][keep], spectra[1][keep], 1e-9)


@pytest.mark.parametrize("supported", [True, False])
def test_undamped_spectrum_is_symmetric(supported):
    """λ and −λ, and their conjugates, are eigenvalues of [[0, I], [−M⁻¹K, 0]], of twice the size, by LAPACK.

    Time in units of 1/√‖M⁻¹K‖; an eigenvalue of the doubled matrix is good to about ε‖A‖/|λ|, at most 1e-8 of |λ|
    here. Without supports the zeros are defective, and only the elastic modes are compared.
    """
    problem = brake(counts=((2, 1, 1), (1, 1, 1)), supported=supported)
    pencil = problem.pencil()
    unit = np.sqrt(np.linalg.norm(np.linalg.solve(pencil.M.toarray(), pencil.K.toarray()), 2))
    lam = all_eigenvalues(pencil.M, None, pencil.K, unit)
    lam = lam[np.abs(lam) > 1e-4 * unit]
    for image in (-lam, lam.conj(), -lam.conj()):
        distance = np.abs(lam[:, None] - image[None, :]).min(axis=1)
        assert (distance < 1e-6 * np.abs(lam)).all()
    assert (lam.real > 1e-5 * np.abs(lam)).any()  # it grows; its mirror image decays
    ours = solve_modes(pencil, Request(count=2 * problem.unknowns)).lam  # all there are
    ours = ours[np.abs(ours) > 1e-4 * unit]
    theirs = lam[lam.imag > -1e-7 * np.abs(lam)]
    # Of each conjugate pair one; both of λ and −λ*; both of a real pair.
    assert len(ours) == len(theirs)
    assert (np.abs(ours[:, None] - theirs[None, :]).min(axis=1) < 1e-6 * np.abs(ours)).all()
    assert (np.abs(ours[:, None] - theirs[None, :]).min(axis=0) < 1e-6 * np.abs(theirs)).all()
