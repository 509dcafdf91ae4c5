"""A mesh cut into eighths fills the same space, with the same groups, and holds every field of the coarse one."""

import numpy as np
import pytest
from selection import some

from fe_squeal import from_skfem
from fe_squeal.accuracy.prolongation import prolongation
from fe_squeal.mesh.measures import area_of, volume_of
from fe_squeal.mesh.refining import refine
from meshes import KINDS, annulus, box, distorted, make_problem, mapped


def bent(kind):
    """A box with curved faces and edges, nodes inside moved at random."""
    mesh = distorted(box(kind, (2, 3, 2), (2.0, 1.5, 1.0)), 0.05)
    bend = lambda x: np.stack([x[0] + 0.1 * x[2] ** 2, x[1] + 0.15 * np.sin(x[0]), x[2] + 0.1 * x[0] * x[1]])  # noqa: E731
    return mapped(mesh, bend)


@pytest.mark.parametrize("kind", some(KINDS, lambda kind: kind != "hex2"))
def test_same_domain_and_groups(kind):
    coarse = from_skfem(bent(kind))
    fine = refine(coarse)
    assert fine.mesh.nelements == 8 * coarse.mesh.nelements
    for name, elements in coarse.mesh.subdomains.items():
        whole, centre = volume_of(coarse.mesh, elements)
        parts, same = volume_of(fine.mesh, fine.mesh.subdomains[name])
        assert parts == pytest.approx(whole, rel=1e-12)
        np.testing.assert_allclose(same, centre, rtol=1e-11)
    for name, facets in coarse.mesh.boundaries.items():
        assert len(fine.mesh.boundaries[name]) == 4 * len(facets)
        assert area_of(fine.mesh, fine.mesh.boundaries[name])[0] == pytest.approx(
            area_of(coarse.mesh, facets)[0], rel=1e-13 if kind == "tet1" else 1e-3
        )  # areas of faces that are not flat are integrals of roots, by quadrature
    assert (fine.mesh.f2t[1, np.concatenate(list(fine.mesh.boundaries.values()))] < 0).all()


@pytest.mark.parametrize("kind", KINDS)
def test_children_lie_in_their_parents(kind):
    """Element i becomes 8 i … 8 i + 7: volumes add up parent by parent."""
    coarse = from_skfem(bent(kind))
    fine = refine(coarse)
    for i in (0, 5, coarse.mesh.nelements - 1):
        whole = volume_of(coarse.mesh, np.array([i]))[0]
        assert volume_of(fine.mesh, 8 * i + np.arange(8))[0] == pytest.approx(whole, rel=1e-12)


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("kind", KINDS)
def test_a_coarse_field_is_a_fine_one(kind, order):
    """Energy and mass of any field are the same on both: the spaces are nested. (A box, where integration is exact.)"""
    supports = [{"surface": "left", "fixed": "xyz"}, {"surface": "top", "fixed": "y"}]
    mesh = from_skfem(box(kind, (2, 2, 1), (1.0, 0.8, 0.5)))
    coarse, fine = (make_problem(m.mesh, order, supports=supports) for m in (mesh, refine(mesh)))
    E = prolongation(coarse.discretisation.space, fine.discretisation.space)
    assert E.shape == (fine.unknowns, coarse.unknowns)
    u = np.random.default_rng(3).standard_normal((coarse.unknowns, 4))
    for name in "MK":
        A, B = (getattr(p.pencil(), name) for p in (coarse, fine))
        energy = u.T @ (A @ u)
        np.testing.assert_allclose((E @ u).T @ (B @ (E @ u)), energy, atol=1e-11 * energy.max())


@pytest.mark.parametrize("kind", ["hex1", "hex2", "tet1", "tet2"])
def test_prolongation_on_curved_elements(kind):
    """Positions are fields, too: of coarse nodes prolonged they are those of the fine ones, on curved elements."""
    mesh = from_skfem(bent(kind))
    coarse, fine = (make_problem(m.mesh, 2 if kind.endswith("2") else 1) for m in (mesh, refine(mesh)))
    E = prolongation(coarse.discretisation.space, fine.discretisation.space)
    np.testing.assert_allclose(
        E @ coarse.discretisation.space.coordinates.ravel(), fine.discretisation.space.coordinates.ravel(), atol=1e-12
    )


@pytest.mark.slow
def test_repeated_refinement_keeps_the_shape_of_tetrahedra():
    """The smallest ratio of volume to the cube of the longest edge stays, however often the mesh is cut."""

    def worst(mesh):
        x = mesh.p[:, mesh.t].transpose(2, 1, 0)
        volume = np.abs(np.linalg.det(x[:, 1:] - x[:, :1])) / 6
        longest = np.max([np.linalg.norm(x[:, a] - x[:, b], axis=1) for a in range(4) for b in range(a)], axis=0)
        return (volume / longest**3).min()

    once = refine(from_skfem(bent("tet1")))
    thrice = refine(refine(once))
    assert worst(thrice.mesh) > 0.99 * worst(once.mesh)


def test_circles_stay_as_round_as_they_were():
    """The mid-nodes of a ring's second refinement lie on its parents' parabolas, not on chords."""
    coarse = from_skfem(annulus("hex2", (1, 12, 1), 1.0, 2.0, 0.2))
    fine = refine(coarse)
    rim = np.unique(fine.mesh.dofs.get_facet_dofs(fine.mesh.boundaries["rim"]).flatten())
    radius = np.linalg.norm(fine.mesh.doflocs[:2, rim], axis=0)
    assert np.abs(radius / 2 - 1).max() < (np.pi / 12) ** 4 / 8  # a parabola through three points of a circle


@pytest.mark.parametrize("kind", some(KINDS, lambda kind: kind == "hex2"))
def test_neighbours_have_near_numbers(kind):
    """Numbers of the corners rise as the elements are met: none is new and yet smaller than one before."""
    fine = refine(from_skfem(box(kind, (5, 4, 3), (2.0, 1.5, 1.0)))).mesh
    corners = fine.t.T
    highest = np.maximum.accumulate(corners.max(axis=1))
    new = np.r_[corners[0].max(), np.diff(highest)]
    assert highest[-1] == corners.max() and (np.abs(new[1:]) <= 27).all()  # a parent and its children bring few at once
