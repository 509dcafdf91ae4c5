"""What an Ansys archive has besides solids, and axes that it turns: taken over or listed, never passed over."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from selection import some

from fe_squeal.decks.ansys.ties import axes_of
from fe_squeal.decks.scene import draft_of
from fe_squeal.errors import MeshError
from fe_squeal.mesh import load_mesh

mapdl_archive = pytest.importorskip("mapdl_archive")
HEX = Path(mapdl_archive.__file__).parent / "examples" / "HexBeam.cdb"


def beam(tmp_path, elements=(), commands=(), angles=(), constants=()):
    """Write the beam with further elements (kind, real constant, nodes), commands, and angles of its first node."""
    lines = HEX.read_text().split("\n")
    first = next(i for i, line in enumerate(lines) if line.startswith("EBLOCK"))
    last = next(i for i in range(first, len(lines)) if lines[i].strip() == "-1")
    rows = [
        "".join(f"{n:10d}" for n in (1, 100 + i, real, 1, 0, 0, 0, 0, len(nodes), 0, 901 + i, *nodes))
        for i, (_, real, nodes) in enumerate(elements)
    ]
    lines[last:last] = rows
    lines[first] = f"EBLOCK,19,SOLID,{901 + len(rows):10d},{last - first - 2 + len(rows):10d}"
    block = next(i for i, line in enumerate(lines) if line.startswith("NBLOCK"))
    if angles:
        lines[block + 2] = "".join(f"{n:9d}" for n in (1, 0, 0)) + "".join(f"{v:21.13E}" for v in (0, 0, 0, *angles))
    types = next(i for i, line in enumerate(lines) if line.startswith("ET,"))
    lines[types + 1 : types + 1] = [f"ET,{100 + i},{kind}" for i, (kind, _, _) in enumerate(elements)]
    materials = next(i for i, line in enumerate(lines) if line.startswith("MPDATA"))
    lines[materials:materials] = [*constants, *commands]
    (tmp_path / "beam.cdb").write_text("\n".join(lines))
    return tmp_path / "beam.cdb"


OTHERS = {14: ("COMBIN14", 2, "missing"), 27: ("MATRIX27", 2, "missing"), 184: ("MPC184", 2, "missing"),
          180: ("LINK180", 2, "missing"), 45: ("SOLID45", 8, "missing"), 175: ("CONTA175", 1, "missing"),
          999: ("element type 999", 2, "missing"), 181: ("SHELL181", 4, "changes"),
          188: ("BEAM188", 2, "changes")}  # fmt: skip


@pytest.mark.slow
def test_other_elements_are_listed(tmp_path):
    """Each type once with the number of its elements; reading the mesh alone notes them too."""
    path = beam(tmp_path, [(kind, 5, range(1, nodes + 1)) for kind, (_, nodes, _) in OTHERS.items() for _ in "12"])
    found = draft_of(path).findings
    assert {f.what: f.weight for f in found} == {what: weight for what, _, weight in OTHERS.values()}
    assert all(f.text.startswith("2 elements are not read: ") for f in found)
    assert len(load_mesh(path).notes) == len(OTHERS)


def test_elements_that_lose_nothing_are_not_listed(tmp_path):
    draft = draft_of(beam(tmp_path, [(200, 5, range(1, 5)), (170, 5, [1])]))
    assert not draft.findings


@pytest.mark.parametrize(("angles", "held", "fixed"), [
    ((90.0, 0.0, 0.0), ["UX"], "y"), ((30.0, 0.0, 0.0), ["UX", "UY"], "xy"),
    *(pytest.param(*case, marks=pytest.mark.slow) for case in (
        ((0.0, 90.0, 0.0), ["UY"], "z"), ((0.0, 0.0, 90.0), ["UX"], "z"), ((90.0, 90.0, 0.0), ["UZ"], "x"),
        ((30.0, 20.0, 10.0), ["ALL"], "xyz"))),
])  # fmt: skip
def test_nodes_are_held_in_their_own_axes(tmp_path, angles, held, fixed):
    draft = draft_of(beam(tmp_path, commands=[f"D,1,{freedom},0.,0." for freedom in held], angles=angles))
    (support,) = [table for table in draft.tables if table.path == ("supports",)]
    assert support.values == {"nodes": "1", "fixed": fixed} and not draft.findings


@pytest.mark.parametrize(("command", "held"), some([
    ("D,17,UX,0,,,,UY,UZ", {"17": "xyz"}), ("D,17,UX,0.,0.,,,UZ,TEMP", {"17": "xz"}),
    ("D,17,TEMP,0,,,,UY", {"17": "y"}), ("D,17,UX,0,,19", {"17, 18, 19": "x"}),
    ("D,17,UX,0,,22,2,UY", {"17, 19, 21": "xy"}), ("D,17,UX,0,,0,0", {"17": "x"}),
    ("D,17,UX,0,,999999999999,300", {"17, 317": "x"}),
], lambda command, held: command in ("D,17,UX,0,,,,UY,UZ", "D,17,UX,0,,22,2,UY")))  # fmt: skip
def test_one_command_holds_several_nodes_and_freedoms(tmp_path, command, held):
    """D,Node,Lab,VALUE,VALUE2,NEND,NINC,Lab2,...,Lab6."""
    draft = draft_of(beam(tmp_path, commands=[command]))
    assert {t.values["nodes"]: t.values["fixed"] for t in draft.tables if t.path == ("supports",)} == held


@pytest.mark.parametrize("command", some(["D,ALL,UX", "D,17,UX,0,,SKIN", "D,17,UX,0,,19,-1", "D,17,UX,0,,5"],
                                         lambda command: "SKIN" in command))  # fmt: skip
def test_nodes_of_supports_that_are_no_range_are_refused(tmp_path, command):
    with pytest.raises(MeshError, match=r"beam.cdb: line .*: D at .*expected the number of a node"):
        draft_of(beam(tmp_path, commands=[command]))


@pytest.mark.slow
def test_oblique_axes_are_asked_for(tmp_path):
    draft = draft_of(beam(tmp_path, commands=["D,1,UX,0.,0."], angles=(30.0, 0.0, 0.0)))
    assert "D: holds 1 nodes (1, ...) in axes that NBLOCK turns" in draft.missing[0]


def test_three_angles_turn_about_z_then_x_then_y():
    """The third turn is about the axis y that the first two have turned."""
    axes = axes_of(20.0, 30.0, 40.0)
    before = axes_of(20.0, 30.0, 0.0)
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(axes[1], before[1], atol=1e-15)
    np.testing.assert_allclose(axes[2], np.cos(np.deg2rad(40)) * before[2] + np.sin(np.deg2rad(40)) * before[0])


@pytest.mark.slow
def test_laws_are_listed(tmp_path):
    laws = [f"TB,{law},1,1,1\nTBDATA,1,0.02" for law in ("SDAMP", "FRIC", "BISO")]
    draft = draft_of(beam(tmp_path, commands=laws))
    assert [(f.what, f.weight) for f in draft.findings] == [("TB,SDAMP", "changes"), ("TB,BISO", "changes")]


def constants(*rows):
    lines = ["RLBLOCK,       2,       9,       6,       7", "(2i8,6g16.9)", "(7g16.9)"]
    return lines + [f"{i:8d}{6:8d}" + "".join(f"{v:16.8E}" for v in row) for i, row in rows]


@pytest.mark.slow
def test_masses_of_one_node_add_up(tmp_path):
    """Two MASS21 at the reference of CERIG; one with other masses along y and z is asked for."""
    ties = ["CERIG,1,30,ALL"]
    masses = [(21, 8, [1]), (21, 9, [1])]
    rows = (8, (1.0, 1.0, 1.0, 0.1, 0.2, 0.3)), (9, (2.0, 2.0, 2.0, 0.1, 0.0, 0.0))
    draft = draft_of(beam(tmp_path, masses, ties, constants=constants(*rows)))
    (rigid,) = [table for table in draft.tables if table.path == ("rigid",)]
    assert rigid.values["mass"] == 3.0 and rigid.values["inertia"] == pytest.approx([0.2, 0.2, 0.3, 0, 0, 0])
    draft = draft_of(beam(tmp_path, masses, ties, constants=constants(rows[0], (9, (2.0, 0.0, 2.0, 0, 0, 0)))))
    assert "MASS21: at node 1 has masses of its own" in draft.missing[0]


def test_a_mass_without_constants_is_told_as_such(tmp_path):
    (finding,) = draft_of(beam(tmp_path, [(21, 8, [1])], ["CERIG,1,30,ALL"])).findings
    assert finding.what == "MASS21" and "node 1 has no real constants: the archive has no set 8" in finding.text


@pytest.mark.slow
@pytest.mark.parametrize(("row", "listed"), [((0, 0, 0, 1e6, 0, 0), True), ((0, 0, 0, 0, 1.0, 0), False)])
def test_stiffness_of_surfaces_is_listed(tmp_path, row, listed):
    """The fourth real constant of SURF154 is the stiffness of a foundation; the fifth is a tension."""
    draft = draft_of(beam(tmp_path, [(154, 8, range(1, 5))], constants=constants((8, row))))
    assert [(f.what, f.weight) for f in draft.findings] == ([("SURF154", "changes")] if listed else [])


def free_face():
    """The corners I, J, K, L of the first element of which no other one has them, and its row."""
    solids = mapdl_archive.Archive(HEX, parse_vtk=False).elem
    rows = [([int(n) for n in row[10:14]], row) for row in solids]
    return next((four, row) for four, row in rows if sum(set(four) <= {int(n) for n in r[10:18]} for r in solids) == 1)


@pytest.mark.slow
def test_loads_along_surface_elements_are_left_out(tmp_path):
    """Beside the pressure on the first face; those on solids count."""
    corners, row = free_face()
    loads = ["SFE,901,2,PRES,0,7.5", "SFE,901,5,PRES,0,3.5,1,0,0", "SFE,901,1,PRES,0,2.5", f"SFE,{row[8]},1,PRES,0,7.5"]
    path = beam(tmp_path, [(154, 8, corners)], loads)
    draft = draft_of(path)
    (table,) = [t for t in draft.tables if t.path == ("effects", "preload")]
    assert table.values["pressures"] == {"pressure_1": 2.5, "pressure_2": 7.5}
    (found,) = [f for f in draft.findings if f.what == "SFE"]
    assert "acts along SURF154" in found.text and "2 loads" in found.text and found.weight == "changes"
    boundaries = load_mesh(path).mesh.boundaries
    assert [len(boundaries[f"pressure_{i}"]) for i in (1, 2)] == [1, 1]


@pytest.mark.parametrize(("order", "pulls"), some(
    [((1, 0, 3, 2), False), ((0, 1, 2, 3), True)], lambda order, pulls: pulls
))  # fmt: skip
def test_pressure_acts_against_the_normal_of_a_surface_element(tmp_path, order, pulls):
    """On a face that one solid has: J, I, L, K of its corners I to P point outwards, I, J, K, L into the solid."""
    surface = [free_face()[0][i] for i in order]
    path = beam(tmp_path, [(154, 8, surface)], ["SFE,901,1,PRES,0,2.5"])
    asked = [line for line in draft_of(path).missing if line.startswith("SURF154")]
    assert len(asked) == pulls and all("the normal of element 901 points into" in line for line in asked)
