"""What the results of a run depend on is part of its inputs, so that --resume tells another run from the same one."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import scipy.sparse as sp

import fe_squeal
from fe_squeal.accuracy.settings import key_of
from fe_squeal.errors import SceneError
from fe_squeal.mesh.digest import mesh_digest
from fe_squeal.mesh.groups import NodeSet
from fe_squeal.problem.problem import Problem
from fe_squeal.problem.terms import Term
from fe_squeal.run.inputs import differences, run_inputs
from fe_squeal.run.measured import read_measured
from fe_squeal.scene.file import load_scene
from fe_squeal.sweep.doubts import Doubt
from fe_squeal.sweep.state import modes_of_record, record_of_modes, record_of_state, state_of_record
from fe_squeal.sweep.told import Told
from meshes import BELT, box

SCENE = {
    "mesh": {"file": "none.msh"},
    "materials": {"m": {"youngs_modulus": 2e9, "poisson_ratio": 0.3, "density": 2e3, "loss_factor": 0.05}},
    "bodies": {"block": {"material": "m"}}, "supports": [{"surface": "top", "fixed": "xyz"}],
    "contacts": [{"surface": "bottom", "counterface": "rigid", "normal_stiffness": 1e11, "sliding": BELT}],
}  # fmt: skip
DECK = """*Node
1, 0., 0., 0.
2, {x}, 0., 0.
3, {x}, 1., 0.
4, 0., 1., 0.
5, 0., 0., 1.
6, {x}, 0., 1.
7, {x}, 1., 1.
8, 0., 1., 1.
"""


@pytest.mark.parametrize("effect", ["structural_damping", "stress_stiffening", "friction_damping"])
def test_an_effect_that_needs_no_key_is_seen(effect):
    """Its table is empty, and switches the effect on."""
    effects = {"friction": {"mu": 0.3}, "preload": {"pressures": {"top": 1e6}}}
    mesh = fe_squeal.from_skfem(box("hex1", (1, 1, 1), name="block"))
    without, with_it = (
        run_inputs(fe_squeal.parse_scene({**SCENE, "effects": on}), mesh) for on in (effects, {**effects, effect: {}})
    )
    assert differences(without, without) == [] == differences(with_it, with_it)
    assert differences(without, with_it) == [f"effects.{effect} is not given there and a table here"]
    assert differences(with_it, without) == [f"effects.{effect} is a table there and not given here"]


def test_numbers_of_nodes_and_kinds_of_groups_are_seen():
    """A set of nodes may be given by their numbers; a body and a surface may have the same name."""
    loaded = fe_squeal.from_skfem(box("hex1", (1, 1, 1)))
    digests = {
        mesh_digest(dataclasses.replace(loaded, node_numbers={"": (numbers, np.arange(8))}))
        for numbers in (np.arange(8), np.arange(8)[::-1], np.arange(8))
    }
    assert len(digests) == 2
    sets = [NodeSet(np.array(nodes), np.arange(8)) for nodes in ([0, 1], [0, 2], [0, 1])]  # springs act on `nodes`
    assert len({mesh_digest(dataclasses.replace(loaded, node_groups={"s": group})) for group in sets}) == 2
    mesh = loaded.mesh
    bodies = [dict(mesh.subdomains or {}), {**(mesh.subdomains or {}), "top": np.array([0])}]
    assert len({mesh_digest(dataclasses.replace(loaded, mesh=mesh.with_subdomains(b))) for b in bodies}) == 2


def test_included_files_are_seen_by_a_study_of_accuracy(tmp_path):
    deck = "*Include, input=nodes.inc\n*Element, type=C3D8, elset=block\n1, 1, 2, 3, 4, 5, 6, 7, 8\n"
    (tmp_path / "a.inp").write_text(deck)
    path = tmp_path / "scene.toml"
    path.write_text('[mesh]\nfile = "a.inp"\nlength_unit = "m"\n[materials.m]\nyoungs_modulus = 2e9\n'
                    'poisson_ratio = 0.3\ndensity = 2e3\n[bodies.block]\nmaterial = "m"\n')  # fmt: skip
    keys = []
    for x in (1.0, 1.5, 1.0):
        (tmp_path / "nodes.inc").write_text(DECK.format(x=x))
        keys.append(key_of(load_scene(path)))
    assert keys[0] == keys[2] != keys[1]


def measured_scene(tmp_path, table):
    (tmp_path / "squeal.csv").write_text("frequency_hz, level_db\n2000, 90\n")
    scene = fe_squeal.parse_scene({**SCENE, "measured": [table]})
    scene._source = tmp_path / "scene.toml"
    return scene


def test_files_of_measurements_are_seen(tmp_path):
    scene = measured_scene(tmp_path, {"file": "squeal.csv"})
    before = run_inputs(scene, None)
    (tmp_path / "squeal.csv").write_text("frequency_hz, level_db\n900, 90\n")
    assert differences(before, run_inputs(scene, None)) == ["the content of file squeal.csv is another"]


@pytest.mark.parametrize("key", ["frequency_hz", "level_db"])
def test_a_number_beside_a_file_that_has_it_is_refused(tmp_path, key):
    with pytest.raises(SceneError, match=rf"measured\[0\]\.{key}: given beside columns of .*squeal\.csv"):
        read_measured(measured_scene(tmp_path, {"file": "squeal.csv", key: 80.0}))


def test_what_the_next_step_may_widen_survives():
    """The last doubt about onsets, growth of which loss factors say nothing, and whether modes were all there are."""
    K = sp.csr_array(np.array([[1.0, 0.0], [0.0, 1.3]]))
    terms = (Term("m", "M", sp.eye_array(2, format="csr"), True), Term("k", "K", K, True),
             Term("f", "K", sp.csr_array(np.array([[0.0, 1.0], [-1.0, 0.0]])), False, {"mu": 1}))  # fmt: skip
    kept = []

    class Keep:
        load = load_model = lambda self: None
        save_model = flush = lambda self, *model: None

        def save(self, state):
            kept.append(state)

    fe_squeal.sweep(Problem(terms, {"mu": 0.0}), [0.0, 0.1, 0.2], modes=2, store=Keep())
    state = dataclasses.replace(kept[-1], doubt=Doubt(0.1, 0.2, 3.0), beyond=(0.1, 0.3, 5.0))
    assert state.previous.exhaustive
    again = state_of_record(record_of_state(state), modes_of_record(record_of_modes(state.first)), state.points)
    assert (again.doubt, again.beyond) == (state.doubt, state.beyond)
    assert again.previous.exhaustive and again.first.exhaustive
    told = Told("mu", [state.doubt.sentence("mu")], [state.doubt.sentence("mu")], again.doubt)
    told.doubts([Doubt(0.2, 0.25, 3.0)])
    assert told.warnings == [Doubt(0.1, 0.25, 3.0).sentence("mu")] == told.unsettled
