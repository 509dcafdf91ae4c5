"""A brake as CDWRITE writes it, beside the same scene by hand: contact, friction, motion, pressure, rigid bodies."""

from __future__ import annotations

import numpy as np
import pytest

import fe_squeal
from fe_squeal.decks.scene import draft_of, scene_of
from fe_squeal.errors import MeshError, SceneError
from meshes import annulus, box

pytest.importorskip("mapdl_archive")
_HEXAHEDRON = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]])
_FACES = ((1, 0, 3, 2), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7), (4, 5, 6, 7))  # I, J, ... as 0, 1, ...
MASTER = 90001


def parts():
    return (annulus("hex1", (1, 12, 1), 0.05, 0.12, 0.01),
            box("hex1", (3, 2, 1), (0.06, 0.03, 0.02), (-0.03, 0.07, 0.01), name="pad"))  # fmt: skip


def cells(mesh):
    """Nodes from 1 in Ansys' order, right-handed."""
    order = [int(np.argmin(np.abs(np.asarray(mesh.elem.doflocs) - corner).max(axis=1))) for corner in _HEXAHEDRON]
    t = mesh.t.T[:, order]
    x = mesh.p.T[t]
    left = np.linalg.det(np.stack([x[:, i] - x[:, 0] for i in (1, 3, 4)], axis=1)) < 0
    t[left] = t[left][:, [4, 5, 6, 7, 0, 1, 2, 3]]
    return t + 1


def faces(mesh, name, table, first):
    """(element, face number, corners) of each facet of a group, with the archive's numbers."""
    found = []
    for facet in np.asarray(mesh.boundaries[name]):
        cell, on = mesh.f2t[0, facet], set((mesh.facets[:, facet] + 1).tolist())
        k = next(k for k, face in enumerate(_FACES) if set(table[cell][list(face)].tolist()) == on)
        found.append((cell + 1 + first, k + 1, table[cell][list(_FACES[k])] + first))
    return found


def brake(fkn=-1500.0, option="", tie=True, motion="CMROTATE,DISC, 0., 0., 5., 0., 0., 0.\n"):
    """The archive in mm, t and s: disc of material 1, pad of material 2, both SOLID185, contact of real constant 5."""
    disc, pad = parts()
    tables = [cells(disc), cells(pad)]
    start = disc.p.shape[1]
    points = np.hstack([disc.p, pad.p]).T * 1e3
    nodes = [(i + 1, p) for i, p in enumerate(points)] + [(MASTER, (0.0, 85.0, 50.0))]
    block = "".join(f"{i:9d}{0:9d}{0:9d}" + "".join(f"{v:21.13E}" for v in p) + "\n" for i, p in nodes)
    rows, label = [], 0
    for material, (table, first) in enumerate(zip(tables, (0, start), strict=True), 1):
        for nodes_of in table:
            label += 1
            rows.append((material, 1, 1, 1, 0, 0, 0, 0, 8, 0, label, *(nodes_of + first)))
    labels = disc.nelements
    sides = [(2, faces(pad, "bottom_pad", tables[1], start)), (3, faces(disc, "top", tables[0], 0))]
    for kind, found in sides:
        for _, _, corners in found:
            label += 1
            rows.append((3, kind, 5, 1, 0, 0, 0, 0, 4, 0, label, *corners))
    rows.append((1, 4, 6, 1, 0, 0, 0, 0, 1, 0, label + 1, MASTER))
    elements = "".join("".join(f"{int(v):9d}" for v in row) + "\n" for row in rows)
    hub = np.unique(disc.facets[:, disc.boundaries["hub"]]) + 1
    back = np.unique(pad.facets[:, pad.boundaries["back_pad"]]) + 1 + start
    load = "".join(f"SFE,{e - start + labels:9d},{k:4d},PRES,{v},R5.0\n  {p:16.8f}  {0:16.8f}  {0:16.8f}  {0:16.8f}\n"
                   for e, k, _ in faces(pad, "top_pad", tables[1], start) for v, p in ((1, 1.5), (2, 0.0)))  # fmt: skip
    rigid = "".join(f"CERIG,{MASTER},{n},UXYZ\n" for n in back)
    rigid += "".join(f"D,{MASTER:7d},{freedom},0.,0.\n" for freedom in ("UX", "UY  ", "ROTZ"))
    return (
        "/COM,ANSYS RELEASE\n/PREP7\nET,1,185\nET,2,174\nET,3,170\nET,4,21\n" + option
        + "RLBLOCK,       2,       6,      25,       7\n(2i8,6g16.9)\n(7g16.9)\n"
        + f"       5       4{0.0:16.8f}{0.0:16.8f}{fkn:16.8f}{0.1:16.8f}\n"
        + "       6       6" + "".join(f"{v:16.8E}" for v in (1.5e-4, 1.5e-4, 1.5e-4, 0.2, 0.3, 0.4)) + "\n"
        + f"NBLOCK,6,SOLID,{MASTER:9d},{len(nodes):9d}\n(3i9,6e21.13e3)\n{block}N,R5.3,LOC,       -1,\n"
        + f"EBLOCK,19,SOLID,{label + 1:9d},{len(rows):9d}\n(19i9)\n{elements}       -1\n"
        + f"CMBLOCK,DISC    ,ELEM,{2:8d}\n(8i10)\n{1:10d}{-labels:10d}\n"
        + "".join(f"MPDATA,R5.0, 1,{k:4s},{m:8d}, 1, {v:.9E},\n" for m, values in (
            (1, {"EX": 2.1e5, "NUXY": 0.3, "DENS": 7.8e-9}),
            (2, {"EX": 8e3, "PRXY": 0.25, "DENS": 2.5e-9, "BETD": 1e-6}),
            (3, {"MU": 0.4})) for k, v in values.items())
        + "".join(f"D,{n:7d},U{x}  ,  0.000000000    ,  0.000000000\n" for n in hub for x in "XYZ")
        + load + (rigid if tie else "") + motion + "ALPHAD,  10.0\nBETAD,  0.1E-6\nMODOPT,QRDA,    12\nFINISH\n"
    )  # fmt: skip


def by_hand(path):
    disc, pad = parts()
    back = np.unique(pad.facets[:, pad.boundaries["back_pad"]]) + 1 + disc.p.shape[1]
    hub = np.unique(disc.facets[:, disc.boundaries["hub"]]) + 1
    return {
        "mesh": {"file": str(path), "length_unit": "mm"},
        "materials": {"steel": {"youngs_modulus": 2.1e11, "poisson_ratio": 0.3, "density": 7800.0},
                      "lining": {"youngs_modulus": 8e9, "poisson_ratio": 0.25, "density": 2500.0}},
        "bodies": {"material_1": {"material": "steel"},
                   "material_2": {"material": "lining", "rayleigh": {"alpha": 10.0, "beta": 1.1e-6}}},
        "supports": [{"nodes": ", ".join(map(str, hub)), "fixed": "xyz"}],
        "rigid": [{"name": "r", "nodes": ", ".join(map(str, back)), "reference": [0.0, 0.085, 0.05], "mass": 0.15,
                   "inertia": [2e-4, 3e-4, 4e-4, 0, 0, 0], "fixed": "x y rz"}],
        "contacts": [{"surface": "contact_5", "counterface": "target_5", "normal_stiffness": 1.5e12,
                      "sliding": {"axis": [0, 0, 1], "speed": 5.0}}],
        "effects": {"friction": {"mu": 0.4}, "preload": {"pressures": {"pressure_1": 1.5e6}},
                    "rayleigh": {"alpha": 10.0, "beta": 1e-7}},
        "solve": {"modes": 12},
    }  # fmt: skip


def written(tmp_path, text):
    (tmp_path / "brake.cdb").write_text(text)
    return tmp_path / "brake.cdb"


@pytest.mark.slow
def test_archive_is_the_scene_by_hand(tmp_path):
    path = written(tmp_path, brake())
    scene, draft = scene_of(path)
    assert [f.what for f in draft.findings if f.weight != "harmless"] == ["ALPHAD", "BETAD"]
    assert scene.solve.modes == 12
    found = [fe_squeal.assemble(s).pencil() for s in (fe_squeal.parse_scene(by_hand(path)), scene)]
    for A, B in zip(*([p.M, p.C, p.K] for p in found), strict=True):
        assert A.shape == B.shape and abs(A - B).max() <= 1e-12 * abs(A).max()
    # The faces under pressure are the top of the pad: 60 mm by 30 mm.
    mesh = fe_squeal.load_mesh(path, "mm").mesh
    corners = mesh.p[:, np.unique(mesh.facets[:, mesh.boundaries["pressure_1"]])]
    np.testing.assert_allclose(np.ptp(corners, axis=1), [0.06, 0.03, 0.0], atol=1e-12)


@pytest.mark.parametrize(("change", "counterface", "sliding"), [
    ({"motion": "CMOMEGA,DISC,5.,,,0.,0.,-1.,0.,0.,3.\n"}, "target_5", {"axis": (0, 0, 1), "speed": 5.0}),
    pytest.param({"motion": "CMROTATE,PAD,,,-5.\nCMBLOCK,PAD     ,ELEM,       2\n(8i10)\n        13       -18\n"},
                 "contact_5", {"axis": (0, 0, -1), "speed": 5.0}, marks=pytest.mark.slow),
])  # fmt: skip
def test_what_turns_is_the_counterface(tmp_path, change, counterface, sliding):
    scene, _ = scene_of(written(tmp_path, brake(**change)))
    contact = scene.contacts[0]
    assert contact.counterface == counterface and contact.sliding.speed == sliding["speed"]
    assert tuple(contact.sliding.axis) == sliding["axis"]


@pytest.mark.slow
def test_bonded_is_tied_and_factors_are_asked_for(tmp_path):
    scene, draft = scene_of(written(tmp_path, brake(option="KEYOP,       2,12,        5\n")))
    assert scene.contacts[0].kind == "tied" and scene.contacts[0].normal_stiffness == 1.5e12
    assert [f.what for f in draft.findings if f.weight == "changes"] == ["KEYOPT(12)", "ALPHAD", "BETAD"]
    text = draft_of(written(tmp_path, brake(fkn=2.0))).text()
    # Two times E/h of the pad's faces of 20 mm by 15 mm.
    assert f"# normal_stiffness = {float(f'{2 * 8e9 / np.sqrt(20 * 15 * 1e-6):.2g}')!r}" in text


@pytest.mark.slow
@pytest.mark.parametrize(("change", "error", "sentence"), [
    (lambda t: t.replace(f"CERIG,{MASTER},", f"CERIG,{MASTER},ALL !", 1), SceneError, "CERIG.*selected nodes"),
    (lambda t: t.replace(f"CERIG,{MASTER}", "CERIG,77777", 1), MeshError, "line .*CERIG names node 77777"),
    (lambda t: t.replace("   1,PRES", "   1,PRES").replace(",PRES,1", "9,PRES,1", 1), MeshError, "has no face .9"),
    (lambda t: t.replace("SFE,       ", "SFE,    999", 1), MeshError, "SFE at element"),
    (lambda t: t.replace("CMROTATE,DISC, 0.", "CMROTATE,DISC, fast"), MeshError, 'line .*"FAST" in CMROTATE'),
    (lambda t: t.replace("CMROTATE,DISC", "CMROTATE,DISK"), SceneError, "how the counterface moves"),
    (lambda t: t.replace("ALPHAD", "CE,R5.0,DEFI,2,1,0.\nALPHAD"), SceneError, "CE at line .*ties nodes"),
])  # fmt: skip
def test_what_is_missing_or_wrong_is_said(tmp_path, change, error, sentence):
    with pytest.raises(error, match=sentence):
        scene_of(written(tmp_path, change(brake())))
