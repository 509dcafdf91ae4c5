"""What a scene names on its mesh, and what it says of it, holds on every mesh that accuracy is looked for with."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fe_squeal import load_mesh
from fe_squeal.accuracy.candidates import finer_candidate, first_candidate
from fe_squeal.accuracy.own_mesh import own_mesh
from fe_squeal.accuracy.settings import own_setting, scene_at
from fe_squeal.assembly.assembly import Assembly
from fe_squeal.cli import main
from fe_squeal.fem.spaces import make_space
from fe_squeal.mesh.writing import write_loaded
from fe_squeal.run.accuracy_checks import checked_mesh
from fe_squeal.scene.file import load_scene

CORNERS = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1))
SCENE = """
[mesh]
file = "brake.inp"
{geometry}
[materials.steel]
youngs_modulus = 2e11
poisson_ratio = {poisson}
density = 7800.0
[bodies.block]
material = "steel"
{formulation}
[[supports]]
surface = "left"
fixed = "xyz"
[[springs]]
name = "guide"
nodes = "{nodes}"
direction = [0, 1, 0]
stiffness = 1e7
[[contacts]]
name = "belt"
surface = "bottom"
counterface = "rigid"
normal_stiffness = 1e12
sliding = {{ direction = [1.0, 0.0, 0.0], speed = 1.0 }}
[effects.friction]
mu = 0.3
[solve]
modes = 3
"""
GEOMETRY = "[mesh.block]\nlength = 0.08\nwidth = 0.04\nheight = {height}\nsize = {size}\n"


def deck(instance=False):
    """A block of 0.08 m x 0.04 m x 0.02 m in one element, its names in capitals; maybe as an instance of a part."""
    corners = "\n".join(f"{n}, {0.08 * x}, {0.04 * y}, {0.02 * z}" for n, (x, y, z) in enumerate(CORNERS, 1))
    part = f"*NODE\n{corners}\n*ELEMENT, TYPE=C3D8, ELSET=BLOCK\n7, 1, 2, 3, 4, 5, 6, 7, 8\n"
    where = "PAD-1." if instance else ""
    surfaces = f"*SURFACE, NAME=LEFT\n{where}BLOCK, S6\n*SURFACE, NAME=BOTTOM\n{where}BLOCK, S1\n"
    if not instance:
        return part + surfaces
    return (
        f"*PART, NAME=PAD\n{part}*END PART\n*ASSEMBLY, NAME=A\n*INSTANCE, NAME=PAD-1, PART=PAD\n*END INSTANCE\n"
        f"{surfaces}*END ASSEMBLY\n"
    )


def scene_of(folder, nodes="3", geometry="", instance=False, poisson=0.3, formulation=""):
    (folder / "brake.inp").write_text(deck(instance), "utf-8")
    path = folder / "brake.toml"
    path.write_text(
        SCENE.format(nodes=nodes, geometry=geometry, poisson=poisson, formulation=formulation), encoding="utf-8"
    )
    return path


def places(candidate_scene, loaded, name):
    """The corners (n, 3) of the nodes that the spring holds, on a mesh, in ascending order."""
    assembly = Assembly(candidate_scene, loaded)
    return sorted(map(tuple, assembly.loaded.mesh.doflocs[:, assembly.loaded.node_groups[name].nodes].T.round(9)))


NAMED = [("3", False), ("4, 3", False), ("PAD-1.3", True), ("pad-1.3, PAD-1.7", True)]


@pytest.mark.parametrize(("nodes", "instance"), NAMED)
def test_numbers_of_nodes_mean_the_same_places_on_every_mesh(tmp_path, nodes, instance):
    """And so on what is written of these; groups are found there, too, which the deck has in capitals."""
    scene = load_scene(scene_of(tmp_path, nodes, instance=instance))
    numbers = [int(part.rpartition(".")[2]) for part in nodes.split(",")]
    expected = [(0.08 * x, 0.04 * y, 0.02 * z) for x, y, z in sorted(CORNERS[n - 1] for n in numbers)]
    first = first_candidate(scene)
    finer = finer_candidate(first)
    twice = scene_at(scene, replace(own_setting(scene), size=0.01, refinement=1))
    for changed, loaded in ((first.scene, first.loaded), (finer.scene, finer.loaded), twice):
        written = load_mesh(write_loaded(loaded, tmp_path / "written.msh"))
        assert loaded.mesh.nelements == written.mesh.nelements
        for mesh in (loaded, written):
            np.testing.assert_allclose(places(changed, mesh, nodes), expected, atol=1e-12)


@pytest.mark.parametrize("order", [1, 2])
def test_numbers_of_nodes_belong_to_one_mesh_of_a_geometry(tmp_path, capsys, order):
    geometry = f"order = {order}\n" + GEOMETRY.format(height=0.02, size=0.08)
    path = scene_of(tmp_path, "3", geometry)
    for command in (["run", "--accuracy", "0.5"], ["accuracy"]):
        assert main([command[0], str(path), *command[1:], "-o", str(tmp_path / "out")]) == 2
        said = capsys.readouterr().err
        assert said.startswith(f'error: {path}: springs[0].nodes: given "3"; on other meshes') and "a surface" in said


@pytest.mark.parametrize("command", [["run", "--accuracy", "0.5"], ["accuracy"]])
def test_groups_that_are_missing_are_told_before_anything_is_solved(tmp_path, capsys, command):
    path = scene_of(tmp_path, "9")
    assert main([command[0], str(path), *command[1:], "-o", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert said == f"error: {path}: springs[0].nodes: no node 9 in brake.inp; expected one from 1 to 8\n"


def test_mixed_tetrahedra_are_refused_before_anything_is_solved(tmp_path, capsys):
    geometry = GEOMETRY.format(height=0.02, size=0.08) + 'element = "tet"\n'
    path = scene_of(tmp_path, "3", geometry, poisson=0.4999, formulation='formulation = "mixed"')
    path.write_text(path.read_text("utf-8").replace('nodes = "3"', 'surface = "right"'), encoding="utf-8")
    assert main(["run", str(path), "-o", str(tmp_path / "out"), "--accuracy", "0.5"]) == 2
    said = capsys.readouterr().err
    assert f'error: {path}: bodies.block.formulation: given "mixed" on tetrahedra' in said


def test_a_file_beside_the_geometry_is_none_of_the_meshes(tmp_path, capsys):
    """Its height is told, as `run` does, and that it is not taken."""
    path = scene_of(tmp_path, "3", GEOMETRY.format(height=0.03, size=0.08))
    path.write_text(path.read_text("utf-8").replace('nodes = "3"', 'surface = "right"'), encoding="utf-8")
    scene, said = load_scene(path), []
    own = checked_mesh(scene, said.append)
    assert own.mesh.p[2].max() == pytest.approx(0.03)
    assert said[0].startswith("warning: mesh.file is the mesh that runs, and not that of [mesh.block], whose ")
    assert said[1].startswith("note: the meshes are made from [mesh.block]; mesh.file,")
    assert first_candidate(scene).told == "the mesh of [mesh.block], order 3, elements 1.5 times as long"
    without = path.read_text("utf-8").replace('file = "brake.inp"\n', "")
    path.write_text(without, encoding="utf-8")
    said.clear()
    checked_mesh(load_scene(path), said.append)
    assert said == [] and first_candidate(load_scene(path)).told.startswith("the scene's own mesh, order 3")


def test_elements_of_order_2_are_twice_as_long_where_their_numbers_are_given(tmp_path):
    geometry = GEOMETRY.format(height=0.02, size=0.02) + "elements_x = 6\nelements_y = 4\nlayers = 2\nrefinement = 2\n"
    path = scene_of(tmp_path, "3", "order = 1\n" + geometry)
    path.write_text(path.read_text("utf-8").replace('nodes = "3"', 'surface = "right"'), encoding="utf-8")
    first = first_candidate(load_scene(path))
    assert first.scene.mesh.block.block_counts == (6, 4, 2)  # of 12, 8 and 4
    assert first.told.endswith(", elements twice as long")


@pytest.mark.parametrize(("order", "searched"), [("", 3), ("order = 1\n", 2), ("order = 2\n", 2), ("order = 3\n", 3)])
def test_hexahedra_have_order_3_where_the_scene_says_none(tmp_path, order, searched):
    """About as many nodes as before, and the order that a scene gives stays, but for 1."""
    path = scene_of(tmp_path, "3", order + GEOMETRY.format(height=0.02, size=0.01))
    path.write_text(path.read_text("utf-8").replace('nodes = "3"', 'surface = "right"'), encoding="utf-8")
    scene = load_scene(path)
    first = first_candidate(scene)
    assert first.scene.mesh.order == searched and first.loaded.mesh.nelements == first.scene.mesh.block.cells
    own = 3 * make_space(own_mesh(scene).mesh, scene.mesh.order, []).nodes
    assert 0.7 * own < first.unknowns < 1.4 * own
    assert ("as long" in first.told) == (scene.mesh.order < searched)
