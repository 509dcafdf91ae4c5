"""Growth and onsets that a coarse mesh does not have, and sweeps over numbers that change the modes by orders."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

import fe_squeal
from fe_squeal.accuracy.discretisation import with_discretisation
from fe_squeal.accuracy.estimate import refined_changes
from fe_squeal.accuracy.largest_error import estimated_error
from fe_squeal.accuracy.onset_pairs import pair_onsets
from fe_squeal.assembly.assembly import Assembly
from fe_squeal.mesh import from_skfem
from fe_squeal.mesh.groups import NodeSet
from fe_squeal.mesh.refining import refine
from fe_squeal.sweep.onset import Onset
from meshes import BELT, box, modes_of

LINING = {"youngs_modulus": 2e9, "poisson_ratio": 0.25, "density": 2600.0}


def problems(kind, size, springs, stiffness, mu=0.6, piston=0.3, damping=0.0):
    """A lining on a belt, on two by one by one elements and on the same refined once."""
    along = {"abutment": ("right", [1.0, 0.0, 0.0]), "guide": ("front", [0.0, 1.0, 0.0])}
    scene = {
        "mesh": {"file": "none.msh", "order": 2}, "materials": {"lining": LINING},
        "bodies": {"block": {"material": "lining"}},
        "springs": [{"name": "piston", "surface": "top", "direction": [piston, 0.0, 1.0], "stiffness": 2e7}]
        + [{"name": n, "surface": s, "direction": d, "stiffness": k}
           for (n, (s, d)), k in zip(along.items(), springs, strict=True)],
        "contacts": [{"name": "face", "surface": "bottom", "counterface": "rigid", "normal_stiffness": stiffness,
                      "normal_damping": damping, "sliding": BELT}],
        "effects": {"friction": {"mu": mu}},
    }  # fmt: skip
    mesh = from_skfem(box(kind, (2, 1, 1), size))
    return [Assembly(fe_squeal.parse_scene(scene), m).problem({}) for m in (mesh, refine(mesh))]


SIZE, C4 = (0.085, 0.05, 0.02), (0.08442234, 0.04166764, 0.01443174)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("parameter", "values"),
    [("materials.lining.youngs_modulus", np.array([1e9, 2e9, 4e9])),
     ("contacts.face.normal_stiffness", np.geomspace(1e8, 1e14, 4))],
)  # fmt: skip
def test_changes_are_those_of_the_refined_mesh_where_modes_change_by_orders(parameter, values):
    coarse, fine = problems("hex2", SIZE, (4e7, 3e7), 1e11)
    result = fe_squeal.sweep(coarse, values, parameter, modes=12)
    changes = refined_changes(result).modes
    exact = {value: modes_of(fine, 16, **{parameter: value}).lam for value in values}
    for point, change in zip(result.points, changes, strict=True):
        if point.between:
            continue
        known = np.flatnonzero(np.isfinite(change) & (point.modes.lam.imag < 0.8 * point.modes.lam.imag.max()))
        refined = (point.modes.lam + change)[known]
        apart = np.abs(refined[:, None] - exact[point.value][None, :])
        rows, columns = linear_sum_assignment(apart)
        assert len(known) >= 4
        assert (apart[rows, columns] <= 0.05 * np.abs(change[known][rows]) + 1e-5 * np.abs(refined[rows])).all()


def test_a_divergence_that_the_extrapolated_value_alone_has_counts():
    """An inclined spring and friction make a pad diverge, a second time from mu = 1.1286 on; on two elements it is
    1.1389, and 1.1316 on these refined: at 1.13 the mode oscillates on both."""
    scene = {
        "mesh": {"file": "none.msh", "order": 2}, "materials": {"lining": LINING},
        "bodies": {"block": {"material": "lining"}},
        "springs": [{"name": n, "surface": "right", "direction": d, "stiffness": k}
                    for n, d, k in (("side", [1, 0, 1], 5e7), ("guide", [0, 1, 0], 1e7))],
        "contacts": [{"name": "face", "surface": "bottom", "counterface": "rigid", "normal_stiffness": 1e10,
                      "sliding": BELT}],
        "effects": {"friction": {"mu": 1.13}},
    }  # fmt: skip
    scene, mesh = fe_squeal.parse_scene(scene), from_skfem(box("hex1", (2, 1, 1), (0.08, 0.04, 0.02)))
    coarse, fine = (Assembly(scene, m).problem({}) for m in (mesh, refine(refine(mesh))))
    sweeps = [fe_squeal.sweep(problem, [1.13], modes=6) for problem in (coarse, fine)]
    diverging = [result.points[0].modes.lam.real for result in sweeps]
    assert [int((re > 1.0).sum()) for re in diverging] == [1, 2]
    result = with_discretisation(sweeps[0])
    point = result.points[0]
    hidden = int(np.argmin(np.where(point.modes.lam.imag > 0, point.modes.lam.imag, np.inf)))
    assert point.modes.lam.real[hidden] == 0 and point.extrapolated.imag[hidden] == 0
    true, bar = np.sort(diverging[1])[-2], point.extrapolated_discretisation.real[hidden]
    assert abs(point.extrapolated.real[hidden] - true) <= bar and point.discretisation.real[hidden] >= true
    assert any("a mode of 24.796 Hz does not grow on this mesh, and grows by" in w for w in result.warnings)


def test_growth_that_the_extrapolated_value_alone_has_counts():
    """The mesh has Re λ = 0 at mu = 0.25, finer ones have a mode of 6.13 kHz that grows by some 480 1/s."""
    coarse, _ = problems("tet2", C4, (16933745.9, 68270290.6), 59649208996.2, 0.25, 0.26267716)
    result = with_discretisation(fe_squeal.sweep(coarse, [0.25], modes=10))
    modes = result.points[0].modes
    hidden = np.flatnonzero((modes.stability != "unstable") & (result.points[0].extrapolated.real > 100))
    assert len(hidden) and not (modes.stability == "unstable").any()
    assert estimated_error(result, ["growth"]) > 0.5
    assert any("does not grow on this mesh, and grows by" in w for w in result.warnings)
    assert (result.points[0].discretisation.real[hidden] > 100).all()


SUPPORT = {"supports": [{"nodes": "held", "fixed": "xyz"}]}


def tied(kind, **reference):
    return {kind: [{"name": "r", "nodes": "held", **reference}]}


@pytest.mark.parametrize(("path", "place", "tables"), [
    ("supports[0]", "corner", SUPPORT), ("supports[0]", "edge", SUPPORT),
    ("rigid[0]", "corner", tied("rigid", mass=0.1)), ("rigid[0]", "corner", tied("rigid", fixed="xyz")),
    ("rigid[0]", "edges", tied("rigid")), ("averaged[0]", "edges", tied("averaged", inertia=[1.0] * 3 + [0.0] * 3)),
    ("", "corner", tied("rigid")), ("", "edges", tied("averaged")),  # these have no forces
])  # fmt: skip
def test_forces_on_single_nodes_have_no_limit_and_are_told(path, place, tables):
    """At a corner or on one or two edges of the face z = 0; on this face they have one."""
    def told(nodes):
        loaded = from_skfem(box("hex2", (2, 1, 1), SIZE))
        held = np.flatnonzero(nodes(loaded.mesh.doflocs))
        loaded = replace(loaded, node_groups={"held": NodeSet(held, held)})
        scene = {"mesh": {"file": "none.msh"}, "materials": {"lining": LINING},
                 "bodies": {"block": {"material": "lining"}}, **tables}  # fmt: skip
        problem = fe_squeal.assemble(fe_squeal.parse_scene(scene), loaded)
        return [w for w in with_discretisation(fe_squeal.sweep(problem, [0.0], modes=2)).warnings if "no limit" in w]

    assert told(lambda x: x[2] < 1e-9) == []
    edge = {"corner": lambda x: x[0] + x[1] < 1e-9, "edge": lambda x: x[0] < 1e-9,
            "edges": lambda x: np.abs(x[0] - SIZE[0] / 2) > SIZE[0] / 2 - 1e-9}[place]  # fmt: skip
    found = told(lambda x: (x[2] < 1e-9) & edge(x))
    assert [sentence.split(":")[0] for sentence in found] == [f"{path} acts on nodes that cover no face"] * bool(path)


def onset(value, hz=1000.0, a=1, b=2):
    return Onset("p", value, hz, "flutter", "into", 1.0, a, b, 0.0, np.nan)


def test_onsets_of_other_branches_are_the_same_only_if_their_shapes_are_alike():
    values, same = np.array([0.0, 1.0]), {0: 0, 1: 1, 2: 2, 3: 3}
    own, other = [onset(0.5)], [onset(0.52, 1010.0, 3, 4)]
    assert pair_onsets(own, other, same, values) == [0]
    assert pair_onsets(own, other, same, values, lambda i, j: False) == [None]
    assert pair_onsets(own, [onset(0.52)], same, values, lambda i, j: False) == [0]


def test_moves_of_onsets_over_decades_are_those_of_the_logarithm():
    values = np.geomspace(1e6, 1e12, 7)
    assert pair_onsets([onset(2e6)], [onset(3e9)], {0: 0, 1: 1}, values) == [None]
    assert pair_onsets([onset(2e6)], [onset(3e6)], {0: 0, 1: 1}, values) == [0]


def test_onsets_that_lie_close_together_are_told_apart_by_their_speeds():
    """Two that grow slowly and one that grows fast, which passes one of the others on the refined mesh."""
    speeds = {"slow": 390.0, "fast": 4600.0}

    def onset(value, frequency, speed, direction="into"):
        return Onset("mu", value, frequency, "flutter", direction, speeds[speed], 1, 2, 0.0)

    own = [onset(0.9038, 7143, "slow"), onset(0.9089, 7145, "slow", "out of"), onset(0.99, 7361, "fast")]
    refined = [onset(0.8428, 7117, "slow"), onset(0.8473, 7119, "slow", "out of"), onset(0.913, 7313, "fast")]
    same, values = {0: 0, 1: 1}, np.linspace(0.0, 1.0, 11)
    assert pair_onsets(own, refined, same, values) == [0, 1, 2]
    unknown = [replace(o, crossing_speed=np.nan) for o in refined]
    assert pair_onsets(own, unknown, same, values) == [2, 1, 0]
