"""A pad on a disc as an Abaqus deck, and the same as a scene, for tests."""

from __future__ import annotations

from deck_texts import deck_of

import fe_squeal
from meshes import annulus, box

# A pad (a block of 80 x 40 x 20 mm) on a disc, in mm, t and s. Its spring is of 3 N/mm at each of two nodes.
PHYSICS = """*Material, name=STEEL
*Density
7.8E-9
*Elastic
2.1E5, 0.3
*Material, name=LINING
*Density
2.5E-9
*Elastic, type=ENGINEERING CONSTANTS
6000., 5000., 1500., 0.2, 0.15, 0.1, 2000., 1000.
900.
*Damping, alpha=10., beta=1.E-7
*Solid Section, elset=disc, material=STEEL
*Solid Section, elset=pad, material=LINING, orientation=TURNED
*Orientation, name=TURNED, system=RECTANGULAR
0., 1., 0., -1., 0., 0.
3, 0.
*Element, type=SPRING1, elset=GUIDES
90001, 10001
90002, 10002
*Element, type=DASHPOT1, elset=DAMPERS
90003, 10003
*Spring, elset=GUIDES
2
3.
*Dashpot, elset=DAMPERS
1
0.02
*Surface Interaction, name=PADS
*Friction
0.4
*Surface Behavior, pressure-overclosure=LINEAR
1500.
*Contact Pair, interaction=PADS
bottom_pad, top
*Boundary
N_hub, ENCASTRE
N_left_pad, 1, 1
N_back_pad, 2
*Step
*Static
*Dsload
top_pad, P, 1.5
*Motion, rotation, type=VELOCITY
N_top, 5., 0., 0., 0., 0., 0., 1.
*End Step
*Step
*Complex Frequency
12,
*End Step
"""


def mesh(kind="hex1"):
    disc = annulus(kind, (1, 12, 1), 0.05, 0.12, 0.01)
    return disc, box(kind, (3, 2, 1), (0.06, 0.03, 0.02), (-0.03, 0.07, 0.01), name="pad")


def deck(kind="hex1", physics=PHYSICS, scale=1e3):
    disc, pad = mesh(kind)
    return "*Heading\n" + deck_of(disc, scale) + deck_of(pad, scale, first=10000) + physics


def by_hand(path):
    """Return the scene that the deck with PHYSICS describes, in SI units, written by hand."""
    return {
        "mesh": {"file": str(path), "length_unit": "mm"},
        "materials": {
            "steel": {"youngs_modulus": 2.1e11, "poisson_ratio": 0.3, "density": 7800.0},
            "lining": {"youngs_modulus": [6e9, 5e9, 1.5e9], "poisson_ratio": [0.1, 0.15, 0.2],
                       "shear_modulus": [0.9e9, 1e9, 2e9], "density": 2500.0}},
        "bodies": {"disc": {"material": "steel"}, "pad": {"material": "lining", "axes": [[0.0, 1.0, 0.0], [-1.0, 0, 0]],
                                                          "rayleigh": {"alpha": 10.0, "beta": 1e-7}}},
        "supports": [{"surface": "hub", "fixed": "xyz"}, {"surface": "left_pad", "fixed": "x"},
                     {"surface": "back_pad", "fixed": "y"}],
        "springs": [{"name": "a", "nodes": "10001", "direction": [0, 1, 0], "stiffness": 3000.0},
                    {"name": "b", "nodes": "10002", "direction": [0, 1, 0], "stiffness": 3000.0},
                    {"name": "c", "nodes": "10003", "direction": [1, 0, 0], "damping": 20.0}],
        "contacts": [{"surface": "bottom_pad", "counterface": "top", "normal_stiffness": 1.5e12,
                      "sliding": {"axis": [0, 0, 1], "speed": 5.0}}],
        "effects": {"friction": {"mu": 0.4}, "preload": {"pressures": {"top_pad": 1.5e6}}},
        "solve": {"modes": 12},
    }  # fmt: skip


def matrices(scene):
    """Return M, C and K + μK_f of a scene at its own numbers."""
    pencil = fe_squeal.assemble(scene).pencil()
    return [A for A in (pencil.M, pencil.C, pencil.K) if A is not None]


def assert_same_matrices(a, b, tolerance=1e-12):
    assert len(a) == len(b)
    for A, B in zip(a, b, strict=True):
        assert A.shape == B.shape
        assert abs(A - B).max() <= tolerance * abs(A).max()


def written(tmp_path, text, name="brake.inp"):
    (tmp_path / name).write_text(text)
    return tmp_path / name
