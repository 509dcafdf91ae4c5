"""Ansys archives: those that mapdl-archive brings, as meshes and scenes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mesh_measures import volume

import fe_squeal
from fe_squeal.decks.scene import draft_of, scene_of
from fe_squeal.errors import SceneError, SquealError
from fe_squeal.mesh import load_mesh
from meshes import frequencies

mapdl_archive = pytest.importorskip("mapdl_archive")
FOLDER = Path(mapdl_archive.__file__).parent / "examples"
HEX = FOLDER / "HexBeam.cdb"


@pytest.mark.parametrize(("name", "elements", "size"), [
    ("HexBeam.cdb", 40, 5.0), pytest.param("TetBeam.cdb", 3913, 10.0, marks=pytest.mark.slow),
    pytest.param("sector.cdb", None, None, marks=pytest.mark.slow),
    pytest.param("academic_rotor.cdb", None, None, marks=pytest.mark.slow),
])  # fmt: skip
def test_archives_are_meshes(name, elements, size):
    """Beams of 1 x 1 x 5 and 1 x 1 x 10; the sector and the rotor have wedges or hexahedra."""
    loaded = load_mesh(FOLDER / name)
    assert "material_1" in loaded.mesh.subdomains and volume(loaded.mesh) > 0
    if size is not None:
        assert loaded.mesh.nelements == elements and volume(loaded.mesh) == pytest.approx(size, rel=1e-6)
    draft = draft_of(FOLDER / name)
    assert bool(draft.missing) == (name != "HexBeam.cdb")


@pytest.mark.slow
def test_components():
    loaded = load_mesh(HEX)
    assert [len(loaded.mesh.subdomains[name]) for name in ("ECOMP1", "ECOMP2")] == [22, 22]
    assert len(loaded.node_groups["NCOMP2"].nodes) == 98


@pytest.mark.slow
def test_beam_is_that_of_the_same_abaqus_deck(tmp_path):
    """Its elements by number as C3D20, its materials and a clamped end by D: the same frequencies to 1e-9."""
    archive = mapdl_archive.Archive(HEX, parse_vtk=False)
    held = archive.nnum[np.abs(archive.nodes[:, 2]) < 1e-9]
    assert len(held) > 8
    text = HEX.read_text()
    clamp = "".join(f"D,{n:7d},ALL ,  0.000000000    ,  0.000000000\n" for n in held)
    (tmp_path / "beam.cdb").write_text(text.replace("EXTOPT,ATTR,", clamp + "EXTOPT,ATTR,", 1))
    places = zip(archive.nnum, archive.nodes.tolist(), strict=True)
    deck = "*Node\n" + "".join(f"{n}, {x!r}, {y!r}, {z!r}\n" for n, (x, y, z) in places)
    deck += "*Element, type=C3D20, elset=ALL\n"
    for row in archive.elem:
        line = [str(v) for v in (row[8], *row[10:30])]
        deck += ", ".join(line[:11]) + ",\n" + ", ".join(line[11:]) + "\n"
    deck += "*Material, name=A\n*Elastic\n7.e10, .35\n*Density\n2700.\n*Solid Section, elset=ALL, material=A\n"
    deck += "*Boundary\n"
    deck += "".join(f"{n}, 1, 3\n" for n in held)
    (tmp_path / "beam.inp").write_text("*Heading\n" + deck)
    found = []
    for name in ("beam.cdb", "beam.inp"):
        problem = fe_squeal.assemble(scene_of(tmp_path / name)[0])
        found.append(frequencies(problem, 8))
    np.testing.assert_allclose(*found, rtol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(("loose", "asked"), [
    ("", r"contacts.contact_5: FKN = 1 is a factor.*how the counterface moves"),
    ("contact_5", r"CONTA174: contact_5 is left out: 1 of its 1 quadrilaterals are no face of a volume element"),
    ("target_5", r"TARGE170: contact_5 has no target .* on solids: 1 of its 1 quadrilaterals are no face"),
])  # fmt: skip
def test_contact_elements_are_surfaces(tmp_path, loose, asked):
    """CONTA174 and TARGE170 of real constant 5 on faces: a pair whose stiffness and motion are asked for.

    One that is on no face, such as a rigid target, is asked for, and the archive is read without it.
    """
    archive = mapdl_archive.Archive(HEX, parse_vtk=False)
    row = archive.elem[0]
    lines = HEX.read_text().split("\n")
    at = next(i for i, line in enumerate(lines) if line.startswith("EBLOCK"))
    count = len(archive.elem)
    lines[at] = f"EBLOCK,19,SOLID,        42,        {count + 2}"
    end = next(i for i in range(at, len(lines)) if lines[i].strip() == "-1")
    across = row[[10, 11, 16, 17]]
    face = [across if name == loose else own
            for name, own in (("contact_5", row[10:14]), ("target_5", row[14:18]))]  # fmt: skip
    for label, kind, nodes in ((901, 2, face[0]), (902, 3, face[1])):
        numbers = [1, kind, 5, 1, 0, 0, 0, 0, 4, 0, label, *nodes]
        lines.insert(end, "".join(f"{int(n):10d}" for n in numbers))
        end += 1
    at = next(i for i, line in enumerate(lines) if line.startswith("ET,"))
    lines[at + 1 : at + 1] = ["ET,        2,174", "ET,        3,170"]
    at = next(i for i, line in enumerate(lines) if line.startswith("MPDATA"))
    lines.insert(at, "MPDATA,R5.0, 1,MU  ,       1, 1, 0.400000000    ,")
    lines[at:at] = ["CMBLOCK,SKIN    ,ELEM,       1", "(8i10)", "       901"]
    (tmp_path / "beam.cdb").write_text("\n".join(lines))
    loaded = load_mesh(tmp_path / "beam.cdb")
    assert "SKIN" in loaded.unusable and "SKIN" not in loaded.mesh.subdomains
    found = {name: len(facets) for name, facets in loaded.mesh.boundaries.items() if name.endswith("_5")}
    assert found == {name: 1 for name in ("contact_5", "target_5") if name != loose}
    with pytest.raises(SceneError, match=asked):
        scene_of(tmp_path / "beam.cdb")


@pytest.mark.slow
def test_spoilt_archives_are_refused_in_a_sentence(tmp_path):
    rng = np.random.default_rng(3)
    base = HEX.read_bytes()
    refused = 0
    for i in range(12):
        data = bytearray(base)
        if i % 2:
            data = data[: int(rng.integers(len(data)))]
        else:
            for _ in range(8):
                data[int(rng.integers(len(data)))] = int(rng.integers(32, 127))
        (tmp_path / "a.cdb").write_bytes(bytes(data))
        try:
            draft_of(tmp_path / "a.cdb")
        except SquealError as error:
            refused += 1
            assert error.exit_code == 2 and "a.cdb" in str(error)
    assert refused >= 5
