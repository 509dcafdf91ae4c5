"""Settings of the lumped models: what is read, and what the messages say about what is not."""

import json
import math
from dataclasses import fields

import pytest
from numpy.testing import assert_allclose

from fe_squeal.cli import main
from lumped import MODELS, Minimal, NineDof, evaluate, parse_settings
from lumped.noise import name_noise

SIZE = "expected a number between 1e-50 and 1e+50 in size, or 0"


def test_evaluate_gives_plain_numbers():
    result = evaluate("minimal", parse_settings(["k2=20", "mu=0.4", "friction=printed"]))
    json.loads(json.dumps(result, allow_nan=False))
    assert_allclose(result["critical_mu"], [4 / (7 * math.sqrt(3))], rtol=1e-14)
    assert len(result["eigenvalues"]) == 4
    assert_allclose(result["eigenvalues"][-1][1], 4.47952756539986, rtol=1e-13)
    assert result["stability"] == "unstable" and result["mu"] == 0.4


@pytest.mark.parametrize("name", MODELS)
def test_defaults(name):
    result = evaluate(name, {})
    assert len(result["eigenvalues"]) == 2 * len(MODELS[name].coordinates)
    assert result["mu"] == MODELS[name].default_mu
    assert json.loads(json.dumps(result, allow_nan=False))["critical_mu"] == result["critical_mu"]


def test_degenerate_base_values():
    assert evaluate("minimal", {"mu": "1"})["stability"] == "marginal"
    assert evaluate("minimal", {})["critical_mu"] == []


@pytest.mark.parametrize(
    ("model", "settings", "message"),
    [
        ("minimall", {}, 'no lumped model "minimall"; did you mean "minimal"'),
        ("minimal", {"tetha2": "3"}, 'minimal: no parameter "tetha2"; did you mean "theta2"'),
        ("two-mass", {"q": "3"}, 'no parameter "q"; valid: m1, m2'),
        ("minimal", {"k2": "ten"}, 'k2 = "ten"; expected a number (N/m)'),
        ("minimal", {"k2": "nan"}, "k2 = nan; expected zero or a positive number (N/m)"),
        ("minimal", {"theta1": "inf"}, "theta1 = inf; expected a finite number (°)"),
        ("minimal", {"m": "-1"}, "m = -1 kg (mass); expected a positive number"),
        ("minimal", {"m": "0"}, "m = 0 kg (mass); expected a positive number"),
        ("two-mass", {"cy": "-0.1"}, "cy = -0.1 N s/m (damper beside ky); expected zero or a positive number"),
        ("minimal", {"mu": "inf"}, "mu = inf; expected a finite number"),
        ("minimal", {"mu": "a"}, 'mu = "a"; expected a number'),
        ("minimal", {"mu": "1e308"}, f"minimal: mu = 1e+308; {SIZE}"),
        ("minimal", {"mu": "-1e50"}, f"minimal: mu = -1e+50; {SIZE}"),
        ("minimal", {"k1": "1e300", "k2": "1e-300"}, f"minimal: k1 = 1e+300; {SIZE}"),
        ("oscillator", {"cx": "1e200"}, f"oscillator: cx = 1e+200; {SIZE}"),
        ("oscillator", {"theta": "-1e60"}, f"oscillator: theta = -1e+60; {SIZE}"),
        ("two-mass", {"m2": "1e-250"}, f"two-mass: m2 = 1e-250; {SIZE}"),
        ("two-mass", {"cy": "1e-250"}, f"two-mass: cy = 1e-250; {SIZE}"),
        ("minimal", {"friction": "contakt"}, 'friction = "contakt"; did you mean "contact"'),
        ("nine-dof", {"friction": "printed"}, 'friction = "printed"; valid: contact'),
        ("minimal", {"name": "x"}, 'no parameter "name"'),
    ],
)
def test_bad_settings(model, settings, message):
    with pytest.raises(ValueError) as caught:
        evaluate(model, settings)
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("texts", "message"),
    [(["k2"], '"k2" is no setting'), (["=3"], "expected name=value"), (["k2="], "expected name=value"),
     (["k2=1", "k2=2"], "k2 is set twice, to 1 and to 2")],
)  # fmt: skip
def test_bad_texts(texts, message):
    with pytest.raises(ValueError) as caught:
        parse_settings(texts)
    assert message in str(caught.value)


@pytest.mark.parametrize("more", [["k2=20"], ["--json"], []])
def test_what_goes_with_a_study_alone_is_refused_elsewhere(more, tmp_path, capsys):
    """-o belongs to a study, parameters and --json to one evaluation; nothing is evaluated and nothing written."""
    out = tmp_path / "out"
    assert main(["lumped", "minimal", *more, "-o", str(out)]) == 2
    said = capsys.readouterr()
    assert said.err == "error: lumped: -o says where a study goes; expected --study beside it\n" and not said.out
    if more:
        assert main(["lumped", "minimal", *more, "--study", "all", "-o", str(out)]) == 2
        assert "expected neither --set nor --json beside it" in capsys.readouterr().err
    assert not out.exists()


def test_models_check_what_python_gives_them():
    with pytest.raises(ValueError, match="k2 = '20'"):
        Minimal(k2="20")
    with pytest.raises(ValueError, match="jb"):
        NineDof(jb=0.0)
    with pytest.raises(ValueError, match="k2 = 1000"):
        Minimal(k2=10**400)  # no float
    for numbers in ({"k1": 1e50}, {"m": 1e-50}):
        with pytest.raises(ValueError, match="expected a number between"):
            Minimal(**numbers)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("odd", [False, True])
def test_numbers_at_both_ends_of_what_is_allowed_give_finite_results(name, odd):
    """Every other parameter is as large, the rest as small as it may be: nothing overflows."""
    numbers = [f.name for f in fields(MODELS[name]) if f.metadata.get("bound", "any") != "any"]
    settings = {key: "9.9e49" if i % 2 == odd else "1.1e-50" for i, key in enumerate(numbers)}
    for mu in ("9.9e49", "-9.9e49", "1.1e-50", "0"):
        json.dumps(evaluate(name, {**settings, "mu": mu}), allow_nan=False)


def test_noise_bands():
    assert [name_noise(f) for f in (-1, 0, 1, 99.9, 100, 999, 1000, 12000)] == [
        "divergence", "divergence", "groan", "groan", "moan", "moan", "squeal", "squeal",
    ]  # fmt: skip
