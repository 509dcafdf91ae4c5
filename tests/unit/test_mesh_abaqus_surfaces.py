"""Surfaces of Abaqus files that are made of others, and what of them is not read."""

from __future__ import annotations

import re

import numpy as np
import pytest
from deck_texts import deck_of
from mesh_measures import area
from test_mesh_abaqus import DATA, TET, written

from fe_squeal.decks.scene import draft_of
from fe_squeal.errors import MeshError
from fe_squeal.mesh import raw, surface_group, surfaces
from meshes import box


def test_unions_of_surfaces(tmp_path):
    """Faces that several of them have count once; a union may be one of unions, and of surfaces of instances."""
    text = TET + "*SURFACE, NAME=A\nE, S1\nE, S2\n*SURFACE, NAME=B\nE, S2\nE, S3\n"
    text += "*SURFACE, NAME=ALL, COMBINE=UNION\nSOME,\n*SURFACE, NAME=SOME, COMBINE=UNION\na, B\n"
    loaded = written(tmp_path, text)
    for name in ("ALL", "SOME"):  # two sides of 1/2, and the slanted one
        facets = surface_group(loaded, name)
        assert len(facets) == 3 and area(loaded.mesh, facets) == pytest.approx(1 + np.sqrt(3) / 2, rel=1e-13)
    brake = (DATA / "mesh_brake.inp").read_text()
    both = "*Surface, name=both, combine=UNION\npad-1.pad_face, pad-2.pad_face\n"
    loaded = written(tmp_path, re.sub("(?i)\\*end assembly", both + "*End Assembly", brake))
    assert area(loaded.mesh, surface_group(loaded, "both")) == pytest.approx(2.0, rel=1e-13)


@pytest.mark.parametrize("how", ["COMBINE=DIFFERENCE", "COMBINE=INTERSECTION", "CROP", "TYPE=SEGMENTS"])
def test_surfaces_that_are_not_read(tmp_path, how):
    """They are refused where something is meant to act on them, and so is a union with one of them."""
    text = TET + f"*SURFACE, NAME=A\nE, S1\n*SURFACE, NAME=F, {how}\nA, A\n*SURFACE, NAME=G, COMBINE=UNION\nA, F\n"
    loaded = written(tmp_path, text)
    assert len(surface_group(loaded, "A")) == 1
    for name in "FG":
        with pytest.raises(MeshError, match=rf'no surface group "{name}" in a\.inp: \*SURFACE, {how} is not read'):
            surface_group(loaded, name)


def test_a_deck_says_why_a_surface_is_none(tmp_path):
    text = TET + "*SURFACE, NAME=A\nE, S1\n*SURFACE, NAME=F, COMBINE=DIFFERENCE\nA, A\n*NODE\n9, 0, 0, 5\n"
    text += "*SOLID SECTION, ELSET=E, MATERIAL=M\n*MATERIAL, NAME=M\n*COUPLING, REF NODE=9, SURFACE=F\n*KINEMATIC\n"
    (tmp_path / "a.inp").write_text(text + "*STEP\n*STATIC\n*DSLOAD\nF, P, 1.\n*END STEP\n")
    missing = [line for line in draft_of(tmp_path / "a.inp").missing if "COMBINE=DIFFERENCE is not read" in line]
    assert [line.split(" at ")[0] for line in missing] == ["*Coupling", "*Dsload"]


def test_tables_are_sorted_once_however_many_lines_a_surface_has(tmp_path, monkeypatch):
    """Lines of single elements, in a part and of an instance: else time grows with the square of the mesh."""
    found = []
    for n in (2, 4):
        text = deck_of(box("hex1", (n, n, 1), name="P"))
        lines = [(f"A-1.{e}, S1\n", f"{e}, S1\n") for e in range(1, n * n + 1)]
        placed, own = ("".join(column) for column in zip(*lines, strict=True))
        text = f"*Part, name=A\n{text}*Surface, name=OWN\n{own}*End Part\n*Assembly, name=X\n"
        text += f"*Instance, name=A-1, part=A\n*End Instance\n*Surface, name=PLACED\n{placed}*End Assembly\n"
        sorts = []
        with monkeypatch.context() as patched:
            for module, name in ((surfaces, "row_ids"), (raw.Rows, "__init__")):
                patched.setattr(module, name, counted(getattr(module, name), sorts))
            loaded = written(tmp_path, text)
        for name in ("OWN", "PLACED"):
            assert len(surface_group(loaded, name)) == n * n
        found.append(len(sorts))
    assert found[0] == found[1] > 0


def counted(function, calls):
    return lambda *arguments: (calls.append(function), function(*arguments))[1]
