"""Loads that steps of Abaqus decks take away, modes that they ask for, and sections without solids."""

from __future__ import annotations

import pytest
from deck_scenes import deck, written
from deck_texts import deck_of

from fe_squeal.cli import main
from fe_squeal.decks.scene import draft_of
from meshes import box

BLOCK = deck_of(box("hex1", (2, 1, 1), (100.0, 50.0, 20.0), name="P"))
BLOCK += "*Solid Section, elset=P, material=S\n*Material, name=S\n*Elastic\n210000., 0.3\n*Density\n7.85e-9\n"
STEP = "*Step\n*Frequency\n{}\n*End Step\n"
FIRST = "*Step\n*Static\n*Dload\nP, P2, 1.\n*Dsload\ntop_P, P, 1.\n*End Step\n"


@pytest.mark.parametrize(("load", "left"), [
    ("*Dsload, op=NEW\nbottom_P, P, 2.", {"DLOAD_P_P2": 1e6, "bottom_P": 2e6}),
    ("*Dload, op=NEW\nP, P1, 2.", {"top_P": 1e6, "DLOAD_P_P1": 2e6}),
])  # fmt: skip
def test_new_loads_remove_those_of_their_keyword(tmp_path, load, left):
    text = BLOCK + FIRST + f"*Step\n*Static\n{load}\n*End Step\n" + STEP.format(10)
    (preload,) = [t for t in draft_of(written(tmp_path, text)).tables if t.path == ("effects", "preload")]
    assert preload.values["pressures"] == left


@pytest.mark.parametrize(("asked", "told"), [
    ("10, 2000.", "asks for modes above 2000"), ("10, , , 1.e6", "nearest to a shift point"),
    ("10, 0., 5000.", ""),
])  # fmt: skip
def test_modes_that_are_not_the_lowest_are_told(tmp_path, asked, told):
    draft = draft_of(written(tmp_path, BLOCK + STEP.format(asked)))
    found = [str(f) for f in draft.findings if f.what == "*Frequency"]
    assert len(found) == bool(told) and (not told or told in found[0])


def test_forces_in_turned_axes_are_left_out(tmp_path):
    """3 of the axes of *Transform is no pressure on the face, whatever its number."""
    forces = "*Step\n*Static\n*Cload\nN_top_P, 3, -10.\n*End Step\n"
    draft = draft_of(written(tmp_path, BLOCK + forces + STEP.format(10)))
    assert any(t.path == ("effects", "preload") for t in draft.tables)
    turned = "*Transform, nset=N_top_P\n0., 1., 0., 0., 0., 1.\n"
    draft = draft_of(written(tmp_path, BLOCK + turned + forces + STEP.format(10)))
    assert not any(t.path == ("effects", "preload") for t in draft.tables)
    assert any("*Cload" in line and "axes of *Transform are left out" in line for line in draft.told)


def test_sections_of_trusses_change_the_answer(tmp_path):
    truss = "*Element, type=T3D2, elset=ROD\n2001, 1, 7\n*Solid Section, elset=ROD, material=STEEL\n10.\n"
    draft = draft_of(written(tmp_path, deck() + truss))
    assert any("*Solid Section" in line and "trusses" in line for line in draft.told)


def tables(draft, *path):
    return [t.values for t in draft.tables if t.path == path]


def test_steps_behind_the_frequencies_that_count_change_nothing(tmp_path):
    """Another pressure, direction and friction in later steps are not those at which the complex step was solved."""
    later = "*Step\n*Static\n*Dsload\ntop_pad, P, 9.\n*Motion, rotation\nN_top, -5., 0., 0., 0., 0., 0., 1.\n"
    later += "*Change Friction, interaction=PADS\n*Friction\n0.1\n*Boundary, op=NEW\n*End Step\n"
    later += "*Step\n*Frequency\n50,\n*End Step\n"
    plain, more = (draft_of(written(tmp_path, text)) for text in (deck(), deck() + later))
    assert [(t.path, t.values) for t in more.tables] == [(t.path, t.values) for t in plain.tables]
    assert any("behind that of the frequencies" in f.text for f in more.findings)


RAMP = "*Amplitude, name=A\n0., 0., 1., {}\n"


@pytest.mark.parametrize(("amplitude", "static", "factor"), [
    (RAMP.format(0.5), "*Static", 0.5), (RAMP.format(-0.5), "*Static\n0.1, 1.", -0.5),
    ("*Amplitude, name=A\n0., 0., 2., 1.,\n4., 3.\n", "*Static\n0.1, 3.", 2.0),
])  # fmt: skip
def test_a_load_is_what_its_amplitude_is_at_the_end_of_the_step(tmp_path, amplitude, static, factor):
    text = deck().replace("*Step\n*Static", amplitude + "*Step\n" + static)
    text = text.replace("*Dsload", "*Dsload, amplitude=A").replace("*Motion, ", "*Motion, amplitude=A, ")
    draft = draft_of(written(tmp_path, text))
    assert not draft.missing
    (preload,), (contact,) = tables(draft, "effects", "preload"), tables(draft, "contacts")
    assert preload["pressures"] == {"top_pad": pytest.approx(1.5e6 * factor)}
    assert contact["sliding"]["speed"] == pytest.approx(5.0 * factor)


def test_an_amplitude_that_is_no_table_is_asked_for(tmp_path):
    amplitude = "*Amplitude, name=A, definition=SMOOTH STEP\n0., 0., 1., 1.\n"
    text = deck().replace("*Step\n*Static", amplitude + "*Step\n*Static")
    draft = draft_of(written(tmp_path, text.replace("*Dsload", "*Dsload, amplitude=A")))
    assert any('"A" is no table' in s for s in draft.missing)


@pytest.mark.parametrize(("motion", "direction", "speed"), [
    ("*Motion\nN_top, 1, 1, 100.\n*Motion\nN_top, 2, 2, 100.", [0.5**0.5, 0.5**0.5, 0.0], 0.1 * 2**0.5),
    ("*Motion\nN_bottom_pad, 1, 1, 100.\nN_top, 1, 1, 30.", [-1.0, 0.0, 0.0], 0.07),
    ("*Motion\nN_bottom_pad, 1, 1, 30.", [1.0, 0.0, 0.0], 0.03),
])  # fmt: skip
def test_sliding_is_the_motion_of_one_side_against_the_other(tmp_path, motion, direction, speed):
    head, _, tail = deck().partition("*Motion, rotation")
    text = head + motion + "\n" + tail[tail.index("*End Step") :]
    (contact,) = tables(draft_of(written(tmp_path, text)), "contacts")
    assert contact["sliding"]["direction"] == pytest.approx(direction)
    assert contact["sliding"]["speed"] == pytest.approx(speed)
    moves = "bottom_pad" if "N_top" not in motion else "top"
    assert contact["counterface"] == moves


def test_both_sides_that_turn_differently_are_asked_for(tmp_path):
    more = "N_bottom_pad, 2., 0., 0., 0., 0., 0., 1.\n*End Step"
    draft = draft_of(written(tmp_path, deck().replace("*End Step", more, 1)))
    assert any("one of them turns" in s for s in draft.missing)


def test_forces_come_on_top_of_the_pressure_of_the_same_surface(tmp_path):
    """*Cload on a node set that is named as the surface of *Dsload: 1.5 MPa, and 8 N on each node of the face."""
    both = deck().replace("*Dsload", "*Cload\ntop_pad, 3, -8.\n*Dsload")
    nset = "*Nset, nset=top_pad\nN_top_pad\n*Step\n"
    (found,) = tables(draft_of(written(tmp_path, both.replace("*Step\n", nset, 1))), "effects", "preload")
    nodes, area = 12, 1800.0  # of 3 x 2 elements, mm²
    assert found["pressures"]["top_pad"] == pytest.approx(1.5e6 + 1e6 * 8 * nodes / area)


def test_what_is_held_in_a_step_of_vibrations_alone_is_told(tmp_path):
    text = deck().replace("*Complex Frequency\n12,\n", "*Complex Frequency\n12,\n*Boundary\nN_right_pad, 3\n")
    draft = draft_of(written(tmp_path, text))
    assert any("*Boundary" in line and "in a step of vibrations" in line for line in draft.told)


def test_a_coupling_of_a_surface_is_not_of_a_node_set_with_its_name(tmp_path):
    text = BLOCK + "*Nset, nset=left_P\n1\n*Node, nset=REF\n9000, -50., 0., 0.\n"
    text += "*Coupling, constraint name=C, ref node=REF, surface=left_P\n*Kinematic\n" + STEP.format(10)
    (rigid,) = tables(draft_of(written(tmp_path, text)), "rigid")
    assert rigid["surface"] == "left_P"


def test_a_scene_with_something_unsettled_does_not_run(tmp_path, capsys):
    """What `check` of the deck asks for, the scene that `new` writes asks for, too."""
    path = written(tmp_path, deck() + "*Embedded Element\npad\n")
    assert main(["check", str(path)]) == 2
    assert "Embedded Element" in capsys.readouterr().err
    scene = path.with_suffix(".toml")
    assert main(["new", str(path), "-o", str(scene)]) == 0
    capsys.readouterr()
    assert main(["check", str(scene)]) == 2
    assert "unsettled" in capsys.readouterr().err
    text = scene.read_text("utf-8")
    settled = text[: text.index("unsettled = [")] + text[text.index("]", text.index("unsettled = [")) + 1 :]
    scene.write_text(settled, "utf-8")
    assert main(["check", str(scene)]) == 0


@pytest.mark.parametrize(("speed", "sliding"), [(0.0, None), (-7.0, {"axis": [0.0, 0.0, 1.0], "speed": -7.0})])
def test_the_last_rotation_of_a_node_set_counts(tmp_path, speed, sliding):
    """A step in which the disc is stopped leaves nothing that slides."""
    later = f"*Step\n*Static\n*Motion, rotation\nN_top, {speed}, 0., 0., 0., 0., 0., 1.\n*End Step\n"
    draft = draft_of(written(tmp_path, deck().replace("*Step\n*Complex", f"{later}*Step\n*Complex")))
    (contact,) = [t.values for t in draft.tables if t.path == ("contacts",)]
    assert contact.get("sliding") == sliding
    assert any("no *Motion" in line for line in draft.missing) == (sliding is None)


@pytest.mark.parametrize("again", ["TOP_p, P, 0.", "Top_P, P, 3."])
def test_a_later_load_replaces_one_of_the_same_surface_in_any_spelling(tmp_path, again):
    later = f"*Step\n*Static\n*Dsload\n{again}\n*End Step\n"
    draft = draft_of(written(tmp_path, BLOCK + FIRST + later + STEP.format(10)))
    (preload,) = tables(draft, "effects", "preload")
    value = float(again.split(",")[2]) * 1e6
    assert preload["pressures"] == {"DLOAD_P_P2": 1e6, **({"top_P": value} if value else {})}


def test_a_later_force_replaces_one_of_the_same_nodes(tmp_path):
    forces = "*Step\n*Static\n*Cload\n{}, 3, {}\n*End Step\n"
    text = BLOCK + forces.format("N_top_P", -10.0) + forces.format("n_TOP_p", -30.0) + STEP.format(10)
    (preload,), (alone,) = (
        tables(draft_of(written(tmp_path, t)), "effects", "preload")
        for t in (text, BLOCK + forces.format("N_top_P", -30.0) + STEP.format(10))
    )  # fmt: skip
    assert preload == alone


@pytest.mark.parametrize("step", [
    "*Visco, cetol=1.E-3\n0.1, 10.", "*Coupled Temperature-Displacement, steady state\n0.1, 10.",
    "*Dynamic, Explicit\n, 10.",
])  # fmt: skip
def test_steps_in_time_take_their_own_time(tmp_path, step):
    """A ramp over ten seconds is at its end there, not at a tenth of it."""
    text = deck().replace("*Step\n*Static", "*Amplitude, name=A\n0., 0., 10., 1.\n*Step\n" + step)
    draft = draft_of(written(tmp_path, text.replace("*Dsload", "*Dsload, amplitude=A")))
    (preload,) = tables(draft, "effects", "preload")
    assert preload["pressures"] == {"top_pad": pytest.approx(1.5e6)}


def test_loads_of_other_perturbations_are_no_preload(tmp_path):
    loaded = "*Step\n*Steady State Dynamics, direct\n1000., 2000., 10\n*Dsload\ntop_P, P, 7.\n*End Step\n"
    (preload,) = tables(draft_of(written(tmp_path, BLOCK + FIRST + loaded + STEP.format(10))), "effects", "preload")
    assert preload["pressures"] == {"DLOAD_P_P2": 1e6, "top_P": 1e6}


def test_property_evaluation_leaves_structural_damping_to_each_mode(tmp_path):
    """A loss factor of a body is not made viscous at the frequency at which viscoelasticity is evaluated."""
    text = deck().replace("*Damping, alpha", "*Damping, structural=0.02, alpha")
    text = text.replace("*Complex Frequency", "*Complex Frequency, property evaluation=2000.")
    draft = draft_of(written(tmp_path, text))
    assert tables(draft, "effects", "structural_damping") == [{}]
    assert any(f.what == "*Complex Frequency, PROPERTY EVALUATION" for f in draft.findings)


@pytest.mark.parametrize("keyword", [
    "*Matrix Assemble, stiffness=K1", "*User Element, nodes=2, type=U1, coordinates=3\n1, 2, 3",
    "*Connector Section, elset=BOLTS\nBeam,",
])  # fmt: skip
def test_structure_that_is_not_read_is_asked_for(tmp_path, keyword):
    draft = draft_of(written(tmp_path, BLOCK + keyword + "\n" + STEP.format(10)))
    assert any(keyword.split(",")[0].lower() in text.lower() for text in draft.missing)


def test_materials_without_solids_say_nothing_of_units(tmp_path):
    dummy = "*Material, name=SKIN\n*Elastic\n1., 0.\n*Density\n1.E-12\n"
    plain, more = (draft_of(written(tmp_path, text + STEP.format(10))) for text in (BLOCK, BLOCK + dummy))
    assert (more.units, more.head[1:]) == (plain.units, plain.head[1:]) and more.units == "SI"


@pytest.mark.parametrize("line", [",GRAV, 9810., 0., 0., -1.", "P, GRAV, 9810., 0., 0., -1.", ", CENTRIF, 1., 0., 0."])
def test_loads_of_the_whole_model_are_told(tmp_path, line):
    """A line without a set is a load of all elements."""
    text = BLOCK + FIRST.replace("P, P2, 1.\n", f"P, P2, 1.\n{line}\n")
    (found,) = [f for f in draft_of(written(tmp_path, text)).findings if f.what.startswith("*Dload")]
    assert "is a load that is not simulated" in found.text


def test_a_second_material_of_one_name_is_asked_about(tmp_path):
    text = BLOCK + "*Material, name=s\n*Elastic\n9., 0.3\n" + FIRST
    assert [line for line in draft_of(written(tmp_path, text)).missing if 'two materials "s"' in line]
