"""Mesh files as text: byte order marks, names in UTF-8 and in code pages, ends of lines."""

from __future__ import annotations

import codecs
import re

import numpy as np
import pytest
from test_mesh_abaqus import DATA, TET

from fe_squeal.errors import MeshError
from fe_squeal.mesh import load_mesh, surface_group, volume_group
from fe_squeal.mesh.loading import read_raw
from fe_squeal.mesh.readers.sources import text_lines
from fe_squeal.mesh.writing import write_loaded

TWO = TET + "*NODE\n5, 1, 1, 1\n*ELEMENT, TYPE=C3D4\n2, 2, 3, 4, 5\n"
UNV = """    -1
  2411
         1         1         1        11
   0.0000000000000000E+00   0.0000000000000000E+00   0.0000000000000000E+00
         2         1         1        11
   1.0000000000000000E+00   0.0000000000000000E+00   0.0000000000000000E+00
         3         1         1        11
   0.0000000000000000E+00   1.0000000000000000E+00   0.0000000000000000E+00
         4         1         1        11
   0.0000000000000000E+00   0.0000000000000000E+00   1.0000000000000000E+00
    -1
    -1
  2412
         1       111         1         1         7         4
         1         2         3         4
    -1
"""


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "cp1252"])
def test_a_name_is_what_its_user_sees(tmp_path, encoding):
    """A dash and dots of Windows are bytes that end a line elsewhere, and one that has no meaning in Latin-1."""
    text = TET + "*SURFACE, NAME=Belagfläche – 2…\nE, S1\n*ELSET, ELSET=Größe\n1\n"
    (tmp_path / "a.inp").write_bytes(text.encode(encoding))
    loaded = load_mesh(tmp_path / "a.inp")
    assert len(surface_group(loaded, "Belagfläche – 2…")) == len(volume_group(loaded, "Größe")) == 1


@pytest.mark.parametrize("encoding", ["gbk", "shift_jis", "big5", "cp1251"])
def test_different_names_stay_different(tmp_path, encoding):
    """Of Abaqus sets, which are written as a Gmsh file and read back, and of Gmsh's groups."""
    names = ("左面", "右面") if encoding != "cp1251" else ("вал", "щит")
    text = TWO + "".join(f"*ELSET, ELSET={name}\n{i}\n" for i, name in enumerate(names, 1))
    (tmp_path / "a.inp").write_bytes(text.encode(encoding))
    loaded = load_mesh(tmp_path / "a.inp")
    found = {name: cells.tolist() for name, cells in loaded.mesh.subdomains.items() if name != "E"}
    assert sorted(found.values()) == [[0], [1]]
    again = load_mesh(write_loaded(loaded, tmp_path / "b.msh")).mesh.subdomains
    assert again.keys() == {"E", *found} and sorted(again[name].tolist() for name in found) == [[0], [1]]
    data = (tmp_path / "b.msh").read_text("utf-8")
    for old, new in zip(found, names, strict=True):
        data = data.replace(old, new)
    (tmp_path / "c.msh").write_bytes(data.encode(encoding))
    assert load_mesh(tmp_path / "c.msh").mesh.subdomains.keys() == again.keys()


@pytest.mark.parametrize("suffix", [".inp", ".unv", ".bdf", ".msh"])
def test_a_byte_order_mark_is_no_part_of_a_mesh(tmp_path, suffix):
    files = {".inp": TET.encode(), ".unv": UNV.encode(), ".bdf": (DATA / "mesh_free.bdf").read_bytes(),
             ".msh": (DATA / "mesh_boxes_22_ascii.msh").read_bytes()}  # fmt: skip
    plain, marked = tmp_path / f"a{suffix}", tmp_path / f"b{suffix}"
    plain.write_bytes(files[suffix])
    marked.write_bytes(codecs.BOM_UTF8 + files[suffix])
    one, other = read_raw(plain), read_raw(marked)
    np.testing.assert_array_equal(one.points, other.points)
    assert one.volume_groups.keys() == other.volume_groups.keys() and len(one.points) > 3


def test_lines_end_as_on_any_system():
    assert text_lines(b"a\nb\r\nc\rd\x0be\x0cf\x1cg") == ["a", "b", "c", "d\x0be\x0cf\x1cg"]
    assert text_lines("a\u2028b\u0085c\n".encode()) == ["a\u2028b\u0085c"]
    every = "".join(text_lines(bytes(b for b in range(256) if b not in b"\r\n")))
    assert len(set(every)) == 254 and every[128 - 2 :].isprintable()


def test_exodus_files_are_refused(tmp_path):
    (tmp_path / "a.exo").write_bytes(b"CDF\x01")
    with pytest.raises(MeshError, match=re.escape("a.exo: Exodus files are not read, as their groups would be lost")):
        load_mesh(tmp_path / "a.exo")
