"""What a run says on the terminal at its end."""

import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

import fe_squeal
from fe_squeal.report.warnings import told_once
from fe_squeal.run.run import report_sweep
from fe_squeal.scene.file import load_scene
from tests.scene_texts import write_scene


@pytest.fixture(scope="module")
def block(tmp_path_factory):
    scene = load_scene(write_scene(tmp_path_factory.mktemp("summary")))
    problem = fe_squeal.assemble(scene)
    return scene, fe_squeal.sweep(problem, np.linspace(0.0, 0.8, 5), modes=8)


def summary(scene, result, width=80):
    console = Console(file=io.StringIO(), width=width, soft_wrap=True)
    report_sweep(scene, result, Path("out"), console, 1.0)
    return console.file.getvalue()


def test_equal_warnings_once_with_their_number_and_the_gravest_at_the_end(block):
    scene, result = block
    rough = "3 of the modes have frequencies that rounding of the matrices may move, by up to 2 %"
    lost = [f"branch {b} is not found again between mu = {b / 10} and {b / 5}" for b in range(1, 115)]
    text = summary(scene, replace(result, doubts=(rough, *lost)))
    warnings = [line for line in text.splitlines() if line.startswith("warning: ")]
    assert warnings == [f"warning: {rough}", f"warning: {lost[-1]} (one of 114 such warnings)"]
    assert text.rstrip().splitlines()[-1] == warnings[-1]


def test_warnings_about_other_contacts_stay():
    given = ["contact pad_1: only 3 % touch", "contact pad_2: only 5 % touch"]
    assert told_once(given) == given
