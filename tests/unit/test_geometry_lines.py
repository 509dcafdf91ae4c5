"""Numbers of elements along single lines of the parametric meshes."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.spatial import cKDTree

from fe_squeal import parse_scene
from fe_squeal.accuracy.directions import axis_names
from fe_squeal.assembly.assembly import Assembly
from fe_squeal.assembly.bodies import read_mesh
from fe_squeal.geometry import Block, DiscPad, make_mesh
from fe_squeal.geometry.base import aligned, graded

BRAKE = {
    "inner_radius": 0.07, "outer_radius": 0.13, "thickness": 0.012, "pad_inner_radius": 0.085,
    "pad_outer_radius": 0.128, "pad_angle_deg": 50.0, "pad_thickness": 0.011, "back_plate_thickness": 0.005,
    "size": 0.03,
}  # fmt: skip
BLOCK = {"length": 0.08, "width": 0.04, "height": 0.02, "size": 0.02, "belt_thickness": 0.02}


@pytest.mark.parametrize("geometry", [DiscPad(**BRAKE), DiscPad(**BRAKE | {"pad_angle_deg": 360.0}), Block(**BLOCK)])
def test_each_line_is_counted_by_itself(geometry):
    """Twice as many along one line: twice the cells of its groups and no others, and the same groups."""
    for key, line in geometry.lines.items():
        finer = geometry.with_counts({key: 2 * line.elements})
        assert getattr(finer, key) == finer.lines[key].elements == 2 * line.elements
        before, after = (cells_of(g) for g in (geometry, finer))
        for group, count in before.items():
            assert after[group] == (2 if group in line.groups else 1) * count, key
        assert finer.cells == sum(after.values())
    same = geometry.with_counts({})
    assert cells_of(same) == cells_of(geometry) and same.with_counts({}) == same


def cells_of(geometry):
    return {name: len(cells) for name, cells in make_mesh(geometry).volume_groups.items()}


def test_refined_counts_become_numbers():
    twice = Block(**BLOCK).refined(2)
    fixed = twice.with_counts({})
    assert fixed.refinement == 1 and fixed.block_counts == twice.block_counts and fixed.belt_counts == twice.belt_counts


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"disc_elements_around": 30}, "multiple of 4"), ({"disc_elements_around": 8}, "at least 12"),
        ({"pad_elements_around": 1}, "at least 2"), ({"disc_elements_radial": 0}, "greater than or equal to 1"),
        ({"element": "tet", "disc_elements_radial": 3}, "layers belong to"),
        ({"pad_angle_deg": 360.0, "pad_elements_around": 18}, "multiple of 4"),
        ({"back_plate_thickness": 0.0, "back_plate_layers": 2}, "no back plate"),
        ({"element": "tet", "disc_grading": 2.0}, "disc_grading: belongs to"), ({"disc_grading": 30.0}, "equal to 20"),
        ({"element": "tet", "disc_aligned": True}, "disc_aligned: belongs to"),
    ],
)  # fmt: skip
def test_bad_numbers(more, words):
    with pytest.raises(ValidationError, match=words):
        DiscPad(**BRAKE | more)


@pytest.mark.slow
def test_circles_of_a_graded_and_aligned_disc():
    """Circles under both edges of the pads, short elements at the hub; the same volumes and areas; sectors alike."""
    plain = DiscPad(**BRAKE | {"size": 0.012})
    placed = plain.model_copy(update={"disc_grading": 4.0, "disc_aligned": True}).with_counts({})
    lengths = np.diff(placed.disc_radii)
    for edge in (0.07, 0.085, 0.128, 0.13):
        assert np.abs(placed.disc_radii - edge).min() < 1e-12
    assert lengths[0] == lengths[:-1].min() and 2 < lengths[-2] / lengths[0] < 4 and (lengths > 0).all()
    before, after = measures(plain), measures(placed)
    for group in ("volume", "area"):
        assert before[group].keys() == after[group].keys()
        for name, size in before[group].items():
            assert after[group][name] == pytest.approx(size, rel=1e-6), name
    points = make_mesh(placed).points
    disc = points[np.abs(points[:, 2]) < 0.006]
    turn = 2 * np.pi / placed.disc_counts[1]
    turned = disc @ np.array([[np.cos(turn), np.sin(turn), 0.0], [-np.sin(turn), np.cos(turn), 0.0], [0.0, 0.0, 1.0]])
    assert cKDTree(disc).query(turned)[0].max() < 1e-12


def test_a_refined_disc_has_the_circles_of_the_coarse_one():
    placed = DiscPad(**BRAKE | {"size": 0.012, "disc_grading": 3.0, "disc_aligned": True})
    coarse, fine = placed.disc_radii, placed.refined(3).disc_radii
    np.testing.assert_allclose(fine[::3], coarse, rtol=1e-14)
    np.testing.assert_allclose(np.diff(fine), np.repeat(np.diff(coarse) / 3, 3), rtol=1e-9)


def measures(geometry):
    """Volumes of the bodies and areas of the surfaces, from scikit-fem."""
    from skfem import Basis, ElementHex0, FacetBasis, Functional

    from fe_squeal.mesh.building import build_mesh

    loaded, one = build_mesh(make_mesh(geometry), "made"), Functional(lambda w: 1.0 + 0.0 * w.x[0])
    mesh = loaded.mesh
    volume = {k: one.assemble(Basis(mesh, ElementHex0(), elements=v)) for k, v in mesh.subdomains.items()}
    area = {k: one.assemble(FacetBasis(mesh, ElementHex0(), facets=v)) for k, v in mesh.boundaries.items()}
    return {"volume": volume, "area": area}


def test_elements_of_twice_as_many_include_the_others():
    for grading in (0.3, 1.0, 5.0):
        np.testing.assert_allclose(graded(10, grading)[::2], graded(5, grading), atol=1e-15)
    assert np.diff(graded(200, 4.0))[-1] / np.diff(graded(200, 4.0))[0] == pytest.approx(4.0, rel=0.02)


def test_edges_that_are_too_near_get_no_line():
    """An edge at an end or beyond it, two edges closer than a tenth of an element, more edges than lines."""
    even = np.linspace(0.0, 1.0, 6)
    np.testing.assert_allclose(aligned(even, [0.0, 1.0, -1.0, 3.0]), even)
    np.testing.assert_allclose(aligned(even, [0.5, 0.505])[[2, 3]], [0.5, 0.5 + 0.5 / 3])
    assert (np.diff(aligned(np.array([0.0, 0.5, 1.0]), [0.3, 0.6])) > 0).all()
    np.testing.assert_allclose(aligned(np.array([0.0, 1.0]), [0.5]), [0.0, 1.0])


@pytest.mark.parametrize("key", ["belt_elements_x", "belt_elements_y"])
def test_no_belt_no_elements_of_it(key):
    with pytest.raises(ValidationError, match="no belt"):
        Block(**{**BLOCK, "belt_thickness": 0.0, key: 4})


def test_axes_are_named_after_the_direction_they_run_along():
    """Thin elements: the axis along which an element is shortest is the axial one of a flat disc."""
    scene = parse_scene({
        "mesh": {"disc_pad": {**BRAKE, "thickness": 0.002, "back_plate_thickness": 0.0}},
        "materials": {"iron": {"youngs_modulus": 1e11, "poisson_ratio": 0.3, "density": 7000.0}},
        "bodies": {"disc": {"material": "iron"}, "pads": {"material": "iron", "groups": ["pad_1", "pad_2"]}},
    })  # fmt: skip
    assembly = Assembly(scene, read_mesh(scene))
    names = axis_names(assembly)
    assert (np.sort(names, axis=1) == sorted(("around", "axial", "radial"))).all()
    mesh = assembly.loaded.mesh
    corners, at = mesh.p[:, mesh.t], np.asarray(mesh.elem.refdom.p)
    length = np.stack(
        [np.linalg.norm(corners[:, at[a] > 0.5].mean(1) - corners[:, at[a] < 0.5].mean(1), axis=0) for a in range(3)], 1
    )
    disc = assembly.bodies["disc"]
    assert (names[disc][np.arange(len(disc)), length[disc].argmin(axis=1)] == "axial").all()
    # 60 mm in 2 elements along the radius, a circumference of 628 mm in 20 or so around.
    along = {n: length[disc][names[disc] == n].mean() for n in ("radial", "around", "axial")}
    assert along["axial"] == pytest.approx(0.002) and along["radial"] == pytest.approx(0.03, rel=0.02)
