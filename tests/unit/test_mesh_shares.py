"""Where the error of the mesh comes from: shares by element and axis against what they have to be."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp
import skfem

from fe_squeal import assemble, from_skfem, load_scene, parse_scene, sweep
from fe_squeal.accuracy.estimate import changes_by
from fe_squeal.accuracy.prolongation import prolongation
from fe_squeal.accuracy.quantities import split_changes
from fe_squeal.accuracy.refined import refine_problem
from fe_squeal.accuracy.shares import Hierarchy, lattice_of
from fe_squeal.assembly.assembly import Assembly
from fe_squeal.fem.spaces import make_space
from fe_squeal.mesh.refining import refine

EXAMPLES = Path(__file__).parents[2] / "examples"
BENT = 1.0 + 0.3 * np.arange(4)  # planes at unequal distances


def spaces(kind, order):
    maker = skfem.MeshHex.init_tensor if kind == "hex" else skfem.MeshTet.init_tensor
    loaded = from_skfem(maker(BENT, BENT[:3], BENT[:3] ** 2))
    return make_space(loaded.mesh, order, []), make_space(refine(loaded).mesh, order, [])


def vanishing(E, seed):
    """A random residual that vanishes on the functions of the mesh itself."""
    r = np.random.default_rng(seed).standard_normal((E.shape[0], 2))
    E = E.toarray()
    return r - E @ np.linalg.lstsq(E.T @ E, E.T @ r, rcond=None)[0]


@pytest.mark.parametrize(("kind", "order"), [("hex", 1), ("hex", 2), ("hex", 3), ("tet", 1), ("tet", 2)])
def test_they_add_up_to_the_whole(kind, order):
    coarse, fine = spaces(kind, order)
    E = prolongation(coarse, fine)
    rho = vanishing(E, 1)
    z = np.random.default_rng(2).standard_normal(rho.shape)
    parts = Hierarchy(coarse, fine, E).shares(rho, z)
    assert parts.shape == (2, coarse.mesh.nelements, 3 if kind == "hex" else 1)
    whole = np.einsum("ij,ij->j", rho, z)
    np.testing.assert_allclose(parts.sum(axis=(1, 2)), whole, atol=1e-9 * np.abs(rho * z).sum())


@pytest.mark.parametrize("kind", ["hex", "tet"])
def test_functions_of_the_mesh_itself_add_nothing(kind):
    """However large z is on the mesh itself, no element is blamed for it."""
    coarse, fine = spaces(kind, 2)
    E = prolongation(coarse, fine)
    rho = vanishing(E, 3)
    own = E @ np.random.default_rng(4).standard_normal((E.shape[1], 2))
    parts = Hierarchy(coarse, fine, E).shares(rho, own)
    assert np.abs(parts).max() < 1e-10 * np.abs(rho).max() * np.abs(own).max()


@pytest.mark.parametrize("kind", ["hex", "tet"])
def test_the_prolongation_stays_what_it_is(kind):
    """What rounding leaves of zeros in it is left out of a copy: others use it afterwards."""
    coarse, fine = spaces(kind, 2)
    E = prolongation(coarse, fine)
    E = sp.csr_array(E + 1e-17 * sp.random_array(E.shape, density=0.01, random_state=np.random.default_rng(5)))
    rho, before = vanishing(E, 5), E.toarray()
    parts = Hierarchy(coarse, fine, E).shares(rho, E @ np.ones((E.shape[1], 2)))
    np.testing.assert_array_equal(E.toarray(), before)
    assert np.abs(parts).max() < 1e-10 * np.abs(rho).max()


@pytest.mark.parametrize("order", [1, 2, 3])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_function_that_is_new_along_one_axis_belongs_to_it(axis, order):
    """A kink in the middle of one element along one axis: its share is that axis's and that element layer's."""
    coarse, fine = spaces("hex", order)
    E = prolongation(coarse, fine)
    x = fine.coordinates.T
    planes = np.unique(coarse.mesh.p[axis])
    low, high = planes[0], planes[1]
    middle = (low + high) / 2
    kink = np.where(x[axis] < high, (high - low) / 2 - np.abs(x[axis] - middle), 0.0)
    across = 1 + x[(axis + 1) % 3]  # linear along another axis
    z = np.zeros((fine.unknowns, 1))
    z[1::3, 0] = kink * across
    rho = vanishing(E, 5)[:, :1]
    parts = Hierarchy(coarse, fine, E).shares(rho, z)[0]
    edges = coarse.mesh.p[:, coarse.mesh.t]
    at = np.asarray(coarse.mesh.elem.refdom.p)
    along = [np.abs(edges[:, at[a] > 0.5].mean(1) - edges[:, at[a] < 0.5].mean(1))[axis] > 1e-9 for a in range(3)]
    own = np.stack(along, axis=1)
    layer = edges[axis].min(axis=0) < low + 1e-9
    size = np.abs(parts).sum()
    assert np.abs(parts[own & layer[:, None]]).sum() == pytest.approx(size) and size > 0


def test_each_node_of_the_refined_mesh_is_shared_once():
    coarse, fine = spaces("hex", 2)
    lattice = lattice_of(coarse, fine)
    assert lattice.nodes.min() == 0 and len(np.unique(lattice.nodes)) == fine.nodes
    np.testing.assert_array_equal(np.bincount(lattice.nodes.ravel()), lattice.sharing)


def rod(cells, order=1, **more):
    """A rod that cannot bulge: held across at its sides, clamped at one end, so that u = sin along it alone."""
    n_x, n_y = cells
    sides = {"front": "y", "back": "y", "bottom": "z", "top": "z", "left": "xyz"}
    return parse_scene({
        "mesh": {"order": order, "block": {
            "length": 0.2, "width": 0.02, "height": 0.02, "size": 0.1, "elements_x": n_x, "elements_y": n_y}},
        "materials": {"steel": {"youngs_modulus": 2e11, "poisson_ratio": 0.0, "density": 7800.0}},
        "bodies": {"block": {"material": "steel"}},
        "supports": [{"surface": s, "fixed": f} for s, f in sides.items()], "solve": {"modes": 2}, **more,
    })  # fmt: skip


@pytest.mark.parametrize("order", [1, 2])
def test_a_rod_by_its_closed_form(order):
    """ω = (2k − 1)π/2L √(E/ρ): all of the error is along the rod, and s times the change is what it is."""
    scene = rod((6, 3), order)
    result = sweep(assemble(scene), [7800.0], "materials.steel.density", modes=2)
    split = split_changes(result, refine_problem(result))
    assert split.kinds == ("frequencies", "frequencies")
    exact = np.array([1, 3]) * np.pi / 0.4 * np.sqrt(2e11 / 7800)
    lam = np.sort(result.points[0].modes.lam.imag)
    rank = np.argsort(split.scales)
    np.testing.assert_allclose(split.changes[rank] / (1 - 2.0 ** (-2 * order)), exact - lam, rtol=0.15)
    parts = np.abs(split.parts).sum(axis=1)
    assert (parts[:, 1:] < 0.03 * parts[:, :1]).all()  # what the conjugate gradients leave
    assert split.of(("growth",)).parts.shape[0] == 0


@pytest.mark.slow
def test_onsets_move_as_on_the_refined_mesh():
    """To first order, against the onsets of the refined mesh itself; so do those of its corrected model."""
    brake = load_scene(EXAMPLES / "disc_pad.toml")
    table = brake.mesh.disc_pad.model_copy(update={"size": 0.03})
    mesh = brake.mesh.model_copy(update={"disc_pad": table, "file": None})
    scene = brake.model_copy(update={"mesh": mesh})
    values = np.linspace(0.09, 0.4, 3)  # both onsets; the reduced model of a shorter interval is cheaper
    problem = assemble(scene)
    result = sweep(problem, values, max_frequency=5000.0)
    refined = refine_problem(result)
    split = split_changes(result, refined).of(("onsets",))
    finer = Assembly(scene, refine(problem.source.loaded)).problem({})
    there = sweep(finer, values, max_frequency=5000.0).onsets
    changes = changes_by(result, refined).onsets
    assert len(result.onsets) == len(split.names) >= 2
    for onset, first, whole in zip(result.onsets, split.changes, changes, strict=True):
        near = min(there, key=lambda o: abs(o.frequency_hz / onset.frequency_hz - 1))
        moved = near.value - onset.value
        assert whole == pytest.approx(moved, rel=0.06)
        assert first == pytest.approx(moved, rel=0.45)  # changes are not small here: 24 % of an onset
