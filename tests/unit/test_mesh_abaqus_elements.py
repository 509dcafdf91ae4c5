"""Elements of Abaqus files: their numbers, types, data lines of those that are left out, and sets of several names."""

from __future__ import annotations

import numpy as np
import pytest
from mesh_measures import area, volume
from test_mesh_abaqus import TET, written

from fe_squeal.errors import MeshError
from fe_squeal.mesh import surface_group, volume_group
from fe_squeal.mesh.elements import REFERENCE
from fe_squeal.mesh.readers.abaqus.deck import parse_model
from fe_squeal.mesh.readers.sources import Sources

PART = f"*PART, NAME=P\n{TET}*END PART\n"
PLACED = "*ASSEMBLY, NAME=X\n*INSTANCE, NAME=P-1, PART=P\n*END INSTANCE\n"
SECOND = "*NODE\n5, 1, 1, 1\n*ELEMENT, TYPE=C3D4, ELSET=F\n1, 2, 3, 4, 5\n"


def rows(*numbers: int, per_line: int = 16, comma: str = "") -> str:
    lines = [numbers[i : i + per_line] for i in range(0, len(numbers), per_line)]
    return ",\n".join(", ".join(map(str, line)) for line in lines) + comma + "\n"


@pytest.mark.parametrize("more", [
    SECOND, "*ELEMENT, TYPE=S3, ELSET=F\n1, 1, 2, 3\n", "*ELEMENT, TYPE=MASS, ELSET=F\n1, 4\n",
    "*ELEMENT, TYPE=T3D2, ELSET=F\n2, 1, 2\n2, 2, 3\n",
], ids=["solids", "a shell", "a mass", "trusses"])  # fmt: skip
@pytest.mark.parametrize("in_part", [False, True])
def test_a_number_of_two_elements_is_refused(tmp_path, more, in_part):
    """Else the second set would mean the first one's elements."""
    text = f"*PART, NAME=P\n{TET}{more}*END PART\n{PLACED}*END ASSEMBLY\n" if in_part else TET + more
    number = 2 if "T3D2" in more else 1
    with pytest.raises(MeshError, match=rf"^a\.inp: {'P-1: ' * in_part}element number {number} is defined more than"):
        written(tmp_path, text)


def test_parts_have_numbers_of_their_own(tmp_path):
    other = PART.replace("NAME=P", "NAME=Q") + PLACED + "*INSTANCE, NAME=Q-1, PART=Q\n5., 0., 0.\n*END INSTANCE\n"
    loaded = written(tmp_path, PART + other + "*ELEMENT, TYPE=MASS\n1, P-1.1\n*END ASSEMBLY\n")
    assert sorted(loaded.element_labels) == ["P-1.1", "Q-1.1"]


@pytest.mark.parametrize(("text", "message"), [
    (PART + PART.replace("NAME=P", "NAME=p"), r'^a\.inp: a\.inp line 10: \*PART "p" is defined more than once'),
    (PART + PLACED + "*INSTANCE, NAME=p-1, PART=P\n9., 0., 0.\n", r'line 13: \*INSTANCE "p-1" is defined more than'),
])  # fmt: skip
def test_a_name_of_two_parts_is_refused(tmp_path, text, message):
    with pytest.raises(MeshError, match=message):
        written(tmp_path, text)


@pytest.mark.parametrize(("kind", "cell", "size"), [
    ("DC3D6", "wedge", 0.5), ("DC3D15E", "wedge15", 0.5), ("DC3D4", "tetra", 1 / 6), ("DC3D8", "hexahedron", 1.0),
])  # fmt: skip
def test_solids_of_diffusion_are_solids(tmp_path, kind, cell, size):
    """Some programs export them."""
    points = REFERENCE[cell]
    text = "*NODE\n" + "".join(f"{i}, {x}, {y}, {z}\n" for i, (x, y, z) in enumerate(points, 1))
    loaded = written(tmp_path, f"{text}*ELEMENT, TYPE={kind}\n" + rows(1, *range(1, len(points) + 1)))
    assert volume(loaded.mesh) == pytest.approx(size, rel=1e-12)


@pytest.mark.parametrize(("kind", "lines"), [
    ("AC3D20", "50, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15\n16, 17, 18, 19, 20\n" + rows(51, *range(1, 21))),
    ("AC3D20", rows(50, *range(1, 21), per_line=8, comma=",") + rows(51, *range(1, 21), per_line=8)),
    ("AC3D15", rows(50, *range(1, 16)) + rows(51, *range(1, 16), comma=",")),
    ("CCL24RH", rows(50, *range(1, 25)) + rows(51, *range(1, 25))),
    ("GK3D18N", rows(50, *range(1, 19)) + rows(51, *range(1, 19))),
    ("GK3D18", rows(50, *range(1, 10)) + rows(51, *range(1, 10))),  # the nodes of the lower face alone
    ("CONN3D2", "50, 5,\n51, , 6\n"),  # to the ground
    ("S4R", "50, 1, 2, 3, 4,\n51, 1, 2, 3, 4,\n"),
    ("Z1", rows(50, *range(1, 21)) + rows(51, *range(1, 41))),
    ("SPRING2", "50, P-1.1, P-1.2\n51, P-1.1, P-1.3\n"),
])  # fmt: skip
def test_nodes_on_further_lines_are_no_elements(tmp_path, kind, lines):
    (tmp_path / "a.inp").write_text(f"{TET}*ELEMENT, TYPE={kind}, ELSET=AIR\n{lines}*ELSET, ELSET=BOTH\nAIR, E\n")
    model = parse_model(Sources(tmp_path / "a.inp"))
    shells = [label for block in model.assembly.skins for label in block.labels]
    assert model.assembly.others + shells == [50, 51]
    assert model.left_out.get(kind, (2, ""))[0] == 2
    assert [member.items for member in model.assembly.sets["ELSET", "AIR"]] == [["50", "51"]]
    assert list(volume_group(written(tmp_path, (tmp_path / "a.inp").read_text()), "BOTH")) == [0]


@pytest.mark.parametrize("nodes", ["1, 2, 3", "1, 2, 5"], ids=["on a face", "elsewhere"])
def test_a_surface_is_not_the_shells_of_its_name(tmp_path, nodes):
    """*ELSET and *SURFACE have names of their own: the surface has the slanted face alone."""
    shells = f"*NODE\n5, 9, 9, 9\n*ELEMENT, TYPE=S3, ELSET=F\n2, {nodes}\n"
    loaded = written(tmp_path, TET + shells + "*SURFACE, NAME=F\nE, S3\n*SURFACE, NAME=G\nF, SPOS\n")
    assert area(loaded.mesh, surface_group(loaded, "F")) == pytest.approx(np.sqrt(3) / 2, rel=1e-13)
    if nodes == "1, 2, 3":
        assert area(loaded.mesh, surface_group(loaded, "G")) == pytest.approx(0.5, rel=1e-13)
    else:
        with pytest.raises(MeshError, match=r'"G" .* its shell elements are no faces of solid elements'):
            surface_group(loaded, "G")


@pytest.mark.parametrize("word", ["ELSET", "NSET"])
def test_a_set_that_contains_itself_through_an_instance_is_refused(tmp_path, word):
    own = PART.replace("*END PART", f"*{word}, {word}=A\nP-1.A\n*END PART")
    with pytest.raises(MeshError, match=r'^a\.inp: set "A" contains itself$'):
        written(tmp_path, own + PLACED + "*END ASSEMBLY\n")
    own = PART.replace("*END PART", f"*{word}, {word}=A\n1\n*END PART")
    through = f"*{word}, {word}=A, INSTANCE=P-1\nB\n*{word}, {word}=B\nA\n"
    with pytest.raises(MeshError, match=r'"A" refers to (node|element) set "B", which does not exist'):
        written(tmp_path, own + PLACED + through + "*END ASSEMBLY\n")
    loaded = written(tmp_path, own + PLACED + f"*{word}, {word}=A\nP-1.A\n*END ASSEMBLY\n")  # two sets of one name
    found = loaded.mesh.subdomains["A"] if word == "ELSET" else loaded.node_groups["A"].nodes
    assert len(found) == 1
