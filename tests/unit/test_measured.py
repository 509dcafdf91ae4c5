"""Measured squeal beside computed: frequencies, shapes in axes and units of their own, universal files."""

from __future__ import annotations

import json
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace
from unittest import mock

import numpy as np
import pandas as pd
import pytest
import pyuff
from scene_texts import SCENE, replaced, write_scene
from selection import some

import fe_squeal
from fe_squeal.cli import main
from fe_squeal.errors import SceneError
from fe_squeal.report.mac import mac, mac_figure, plot_mac
from fe_squeal.report.results import read_shapes
from fe_squeal.run.compared import _matched, measured_record
from fe_squeal.run.measured import Frequency, Measurements, read_measured
from fe_squeal.run.measured import TestShape as FoundShape

# The file's axes: its x along the model's y, its y along the model's z, in mm, from a corner that is not the model's.
AXES = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
ORIGIN = np.array([0.01, -0.02, 0.03])
KEYS = "length_unit = 'mm'\naxes = [[0, 1, 0], [0, 0, 1]]\norigin = [0.01, -0.02, 0.03]\n"


def run(folder: Path, measured: str, shapes: str = "none", drawn: bool = False) -> Path:
    """Run a scene; of its figures mac.png alone is drawn, unless others are asked for."""
    path = write_scene(folder, replaced('shapes = "none"\nreport = false', f'shapes = "{shapes}"') + measured)
    with nullcontext() if drawn else mock.patch("fe_squeal.run.run.write_figures"):
        assert main(["run", str(path), "-o", str(folder / "out")]) == 0
    return folder / "out"


@pytest.fixture(scope="module")
def shape(tmp_path_factory: pytest.TempPathFactory) -> tuple[np.ndarray, np.ndarray, int]:
    """Points and displacements of the unstable mode, and its branch: what a perfect test would measure."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("fe_squeal.report.export.drawing_shapes", lambda *_: nullcontext())
        out = run(tmp_path_factory.mktemp("shape"), "", "unstable")
    grid, [found], _ = read_shapes(out / "shapes")
    return grid.points, found.u, int(found.info["branch"])


def in_file(points: np.ndarray, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return 1e3 * (points - ORIGIN) @ AXES.T, u @ AXES.T


@pytest.mark.slow
def test_frequencies_of_the_scene_and_of_a_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The unstable mode lies near 712 Hz: 700 Hz is below it by what the sentence says."""
    (tmp_path / "squeal.csv").write_text("frequency_hz,level_db,label\n650,88.5,stop 2\n9000,,\n")
    one = '[[measured]]\nfrequency_hz = 700.0\nlevel_db = 92.0\nlabel = "stop 1"\n'
    out = run(tmp_path, one + '[[measured]]\nfile = "squeal.csv"\n', drawn=True)
    record = json.loads((out / "run.json").read_text())["measured"]
    assert [(m["frequency_hz"], m["level_db"], m["label"]) for m in record] == [
        (700.0, 92.0, "stop 1"), (650.0, 88.5, "stop 2"), (9000.0, None, "")]  # fmt: skip
    modes = pd.read_csv(out / "modes.csv")
    unstable = modes[modes["stability"] == "unstable"]
    for m in record:
        near = unstable.loc[(unstable["frequency_hz"] - m["frequency_hz"]).abs().idxmin()]
        assert m["nearest"]["branch"] == near["branch"] and m["nearest"]["value"] == near["value"]
        assert m["nearest"]["distance_percent"] == pytest.approx(100 * (near["frequency_hz"] / m["frequency_hz"] - 1))
        assert m["sentence"] in capsys.readouterr().out or m is not record[0]
    assert record[0]["sentence"].startswith("Measured 700 Hz (stop 1, 92 dB): the nearest unstable mode is branch")
    known = json.loads((out / "run.json").read_text())["frequency_range_hz"][1]
    assert [("It lies above" in m["sentence"]) for m in record] == [m["frequency_hz"] > known for m in record]
    assert record[0]["sentence"] in (out / "report.html").read_text(encoding="utf-8")
    assert not (out / "mac.csv").exists()


@pytest.mark.slow
def test_without_an_unstable_mode_the_sentence_says_so(tmp_path: Path, no_figures: None) -> None:
    path = write_scene(tmp_path, replaced("to = 0.8", "to = 0.2") + "[[measured]]\nfrequency_hz = 700.0\n")
    assert main(["run", str(path), "-o", str(tmp_path / "out")]) == 0
    [m] = json.loads((tmp_path / "out/run.json").read_text())["measured"]
    assert m["nearest"] is None and m["sentence"] == "Measured 700 Hz: no mode is unstable in this sweep."


@pytest.mark.slow
@pytest.mark.parametrize(
    "kind",
    ["one axis", "all", "turned and scaled"],
)
def test_a_measured_shape_is_found_again(tmp_path: Path, shape, kind: str) -> None:
    """The model's own shape, in another frame, in mm, with another phase and size, or along one axis alone: MAC 1."""
    points, u, branch = shape
    x, v = in_file(points, u * (1.0 if kind == "all" else 3e-6 * np.exp(0.7j)))
    columns = {**dict(zip("xyz", x.T, strict=True))}
    for a, axis in enumerate("xyz"):
        if kind != "one axis" or axis == "y":
            columns |= {f"u{axis}_re": v[:, a].real, f"u{axis}_im": v[:, a].imag}
    pd.DataFrame(columns).to_csv(tmp_path / "shape.csv", index=False)
    out = run(tmp_path, f'[[measured]]\nfile = "shape.csv"\nlabel = "laser"\n{KEYS}')
    table = pd.read_csv(out / "mac.csv")
    last = table[table["value"] == 0.8]
    assert len(last) == 8  # every mode at the last value
    best = last.loc[last["mac"].idxmax()]
    assert best["branch"] == branch and best["mac"] == pytest.approx(1.0, abs=1e-9)
    others = last[~last["branch"].isin([branch])]
    partner = others["mac"].max()  # the mirror of an undamped mode is its complex conjugate
    assert others["mac"].drop(others["mac"].idxmax()).max() < 0.9 and partner < 1 - 1e-6
    assert set(table["points"]) == {len(table) and int(table["points"].iloc[0])}
    assert (out / "mac.png").stat().st_size > 5000
    assert "Measured shapes and the modes most like them" in (out / "report.html").read_text(encoding="utf-8")


@pytest.mark.slow
def test_points_far_from_the_surface_are_left_out_and_told(
    tmp_path: Path, shape, capsys: pytest.CaptureFixture[str]
) -> None:
    points, u, branch = shape
    x = points.copy()
    x[:5] += 1.0
    frame = pd.DataFrame({"x": x[:, 0], "y": x[:, 1], "z": x[:, 2], "uz_re": u[:, 2].real, "uz_im": u[:, 2].imag})
    frame.to_csv(tmp_path / "shape.csv", index=False)
    out = run(tmp_path, '[[measured]]\nfile = "shape.csv"\n')
    said = f"measured shape shape: 5 of {len(x)} points have no node of the surface within 5 mm and are left out"
    assert said in capsys.readouterr().out and said in json.loads((out / "run.json").read_text())["warnings"]
    best = pd.read_csv(out / "mac.csv").query("value == 0.8").nlargest(1, "mac").iloc[0]
    assert best["branch"] == branch and best["mac"] == pytest.approx(1.0, abs=1e-9)
    frame.assign(x=frame["x"] + 7).to_csv(tmp_path / "shape.csv", index=False)
    out = run(tmp_path, '[[measured]]\nfile = "shape.csv"\n')
    assert "too few for a MAC" in capsys.readouterr().out
    assert len(pd.read_csv(out / "mac.csv")) == 0


@pytest.mark.parametrize(("units", "told"), [("SI", "within 5e+03 mm"), ("any", "within 5")])
def test_the_distance_of_points_is_told_in_units_that_are_known(units: str, told: str) -> None:
    said: list[str] = []
    shape = FoundShape("rim", None, np.eye(3) * 1e3, np.ones((3, 3), complex), np.zeros((3, 3, 3)), 5.0)
    _matched(shape, np.zeros((1, 3)), units, said)
    assert f"no node of the surface {told}; that leaves" in said[0]


@pytest.mark.slow
def test_shapes_without_a_mac_are_told_and_draw_nothing(
    tmp_path: Path, shape, capsys: pytest.CaptureFixture[str]
) -> None:
    points, u, _ = shape
    columns = {**dict(zip("xyz", points.T, strict=True)), "uz_re": u[:, 2].real}
    frame = pd.DataFrame(columns)
    frame[:2].to_csv(tmp_path / "two.csv", index=False)
    frame.assign(uz_re=0.0).to_csv(tmp_path / "zero.csv", index=False)
    frame.assign(uz_re=frame["uz_re"].where(frame.index == 3)).to_csv(tmp_path / "one.csv", index=False)
    out = run(tmp_path, "".join(f'[[measured]]\nfile = "{name}.csv"\n' for name in ("two", "zero", "one")))
    warnings = json.loads((out / "run.json").read_text())["warnings"]
    printed = capsys.readouterr()
    for said in ("measured shape two: displacements at 2 points are too few for a MAC; expected 3 points or more",
                 "measured shape one: displacements at 1 points are too few for a MAC; expected 3 points or more",
                 "measured shape zero: all displacements are zero, so it has no MAC"):  # fmt: skip
        assert said in printed.out and said in warnings
    assert "Warning" not in printed.err
    assert (out / "mac.csv").exists() and not (out / "mac.png").exists()


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("label", ["rim", "W" * 200])
def test_the_figure_of_mac_has_room_for_any_label(tmp_path: Path, label: str) -> None:
    table = pd.DataFrame({"measured": [label], "value": [1.0], "branch": [1], "frequency_hz": [100.0], "mac": [0.5]})
    assert plot_mac(table, tmp_path / "mac.png").stat().st_size > 1000


def test_the_figure_of_mac_shows_the_modes_most_like_a_shape(tmp_path: Path) -> None:
    """Squeal is often among the highest modes: of many, those with the largest MAC to any shape, by frequency."""
    modes = pd.DataFrame({"parameter": "mu", "branch": np.arange(1, 61), "frequency_hz": 1e4 - 100.0 * np.arange(60)})
    like = {"rim": np.where(np.arange(60) == 2, 0.9, 0.001 * np.arange(60)), "pad": np.arange(60) == 7, "zero": np.nan}
    last = pd.concat([modes.assign(measured=name, value=0.7, mac=m) for name, m in like.items()])
    figure = mac_figure(pd.concat([last.assign(value=0.2, branch=99), last]), "a brake of 3 $, not of 4 $")
    axes = figure.axes[0]
    shown = [int(label.get_text().partition(":")[0]) for label in axes.get_xticklabels()]
    assert shown == [*range(60, 22, -1), 8, 3]
    assert figure.get_suptitle().endswith("\nthe 40 of 60 modes with the largest MAC at μ = 0.70")
    grey = axes.images[0].get_array().mask.all(axis=1).tolist()
    assert [label.get_text() for label in axes.get_yticklabels()] == ["rim", "pad", "zero"]
    assert grey == [False, False, True] and "no MAC" in [text.get_text() for text in axes.texts]
    assert mac_figure(last[last["branch"] < 2]).get_suptitle() == "1 mode at μ = 0.70"
    figure.savefig(tmp_path / "mac.png")


def test_shapes_of_one_label_have_names_of_their_own(tmp_path: Path) -> None:
    """Tables and figures go by the name: two shapes of one name would be one row, of their mean."""
    for name, size in (("shape", 1), ("other", 2), ("third", 3)):
        (tmp_path / f"{name}.csv").write_text(f"x,y,z,uz_re\n0,0,0,{size}\n")
    entries = (("shape", ""), ("other", 'label = "shape"\n'), ("third", 'label = "shape"\n'))
    text = SCENE + "".join(f'[[measured]]\nfile = "{name}.csv"\n{label}' for name, label in entries)
    found = read_measured(fe_squeal.load_scene(write_scene(tmp_path, text))).shapes
    assert [(s.label, s.u[0, 2].real) for s in found] == [("shape", 1), ("shape (2)", 2), ("shape (3)", 3)]


def test_labels_in_a_file_stay_as_they_are(tmp_path: Path) -> None:
    """Stops are often numbered; NA is a name like others."""
    (tmp_path / "squeal.csv").write_text("frequency_hz, label\n650, 007\n660,\n670, NA\n")
    scene = write_scene(tmp_path, SCENE + '[[measured]]\nfile = "squeal.csv"\n')
    found = read_measured(fe_squeal.load_scene(scene)).frequencies
    assert [(f.hz, f.label) for f in found] == [(650.0, "007"), (660.0, ""), (670.0, "NA")]


def universal(path: Path, shape, kind: str) -> None:
    points, u, _ = shape
    x, v = in_file(points, u)
    nodes = np.arange(1, len(x) + 1) * 10
    zero = np.zeros(len(x), int)
    sets = [pyuff.prepare_2411(node_nums=nodes, def_cs=zero, disp_cs=zero, color=zero, x=x[:, 0], y=x[:, 1], z=x[:, 2])]
    order = np.random.default_rng(3).permutation(len(x))
    if kind == "55":
        for hz, factor in ((300.0, np.ones((1, 3))), (712.0, None)):
            w = v[order] if factor is None else np.abs(v[order]) * factor + 0j
            sets.append(pyuff.prepare_55(
                model_type=1, analysis_type=5, data_ch=2, spec_data_type=8, load_case=0, freq_step_n=1, freq=hz,
                data_type=5, n_data_per_node=3, node_nums=nodes[order], r1=w[:, 0], r2=w[:, 1], r3=w[:, 2],
            ))  # fmt: skip
    else:
        hz = np.array([690.0, 710.0, 730.0])
        for i in order:
            for a in range(3):
                sign = -1 if (i + a) % 2 else 1  # sensors that look the other way
                data = sign * v[i, a] * np.array([0.2, 1.0, 0.3j])
                sets.append(pyuff.prepare_58(
                    binary=0, func_type=4, rsp_node=int(nodes[i]), rsp_dir=sign * (a + 1), ref_node=1, ref_dir=1,
                    data=data, x=hz, id1="frf", rsp_ent_name="p", ref_ent_name="p", abscissa_spacing=1,
                    ord_data_type=6, num_pts=3, abscissa_min=690.0, abscissa_inc=20.0, z_axis_value=0.0,
                    abscissa_spec_data_type=18, abscissa_len_unit_exp=0, abscissa_force_unit_exp=0,
                    abscissa_temp_unit_exp=0, ordinate_spec_data_type=8, ordinate_len_unit_exp=0,
                    ordinate_force_unit_exp=0, ordinate_temp_unit_exp=0, orddenom_spec_data_type=13))  # fmt: skip
    pyuff.UFF(str(path)).write_sets(sets, mode="overwrite")


@pytest.mark.parametrize("kind", some(["55", "58"], lambda kind: kind == "58"))
def test_universal_files(tmp_path: Path, shape, kind: str) -> None:
    """Written by pyuff, nodes out of order; of several shapes or lines the one at the frequency is taken."""
    universal(tmp_path / "test.unv", shape, kind)
    scene = write_scene(tmp_path, f'{SCENE}[[measured]]\nfile = "test.unv"\nfrequency_hz = 710.0\n{KEYS}')
    [found] = read_measured(fe_squeal.load_scene(scene)).shapes
    points, u, _ = shape
    order = np.lexsort(found.points.round(6).T), np.lexsort(points.round(6).T)
    np.testing.assert_allclose(found.points[order[0]], points[order[1]], atol=1e-6)
    assert mac(np.einsum("pi,pij->pj", found.u, found.axes)[order[0]], u[order[1]]) == pytest.approx(1.0, abs=1e-6)


@pytest.mark.slow
def test_a_shape_far_from_the_frequency_is_told_on_the_page(tmp_path: Path, shape) -> None:
    universal(tmp_path / "test.unv", shape, "55")
    out = run(tmp_path, f'[[measured]]\nfile = "test.unv"\nfrequency_hz = 600.0\n{KEYS}')
    said = "measured shape test: the shape nearest to 600 Hz is at 712 Hz, 19 % away"
    assert said in json.loads((out / "run.json").read_text())["warnings"]
    assert said in (out / "report.html").read_text(encoding="utf-8")
    table = pd.read_csv(out / "mac.csv")
    assert (table["measured_hz"] == 712.0).all() and table["mac"].max() == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("lost", ["y", "r2"])
def test_universal_files_of_which_a_part_is_lost(tmp_path: Path, shape, lost: str, monkeypatch) -> None:
    """pyuff gives columns of different lengths for some damaged files."""
    universal(tmp_path / "test.unv", shape, "55")
    read = pyuff.UFF.read_sets

    def shortened(*arguments):
        sets = read(*arguments)
        for s in sets:
            if lost in s:
                s[lost] = s[lost][:-1]
        return sets

    monkeypatch.setattr(pyuff.UFF, "read_sets", shortened)
    scene = write_scene(tmp_path, f'{SCENE}[[measured]]\nfile = "test.unv"\nfrequency_hz = 710.0\n{KEYS}')
    with pytest.raises(SceneError, match=r"test\.unv (cannot be read|has shapes that are not whole)"):
        read_measured(fe_squeal.load_scene(scene))


BAD = {
    "nothing": ("[[measured]]\nlabel = 'x'\n", "given neither frequency_hz nor file"),
    "missing": ("[[measured]]\nfile = 'no.csv'\n", "there is no file"),
    "format": ("[[measured]]\nfile = 'block.msh'\n", "expected a file in .csv or .unv"),
    "columns": ("[[measured]]\nfile = 'bad.csv'\n", "has the columns a, b; expected frequency_hz"),
    "words": ("[[measured]]\nfile = 'words.csv'\n", "column frequency_hz"),
    "negative": ("[[measured]]\nfile = 'negative.csv'\n", "the frequency -5 in row 3"),
    "infinite": ("[[measured]]\nfile = 'infinite.csv'\n", "the frequency inf in row 3"),
    "no displacement": ("[[measured]]\nfile = 'points.csv'\n", "expected x, y, z and some of ux_re"),
    "imaginary part alone": ("[[measured]]\nfile = 'alone.csv'\n", "the column ux_im without ux_re; expected both"),
    "wrong name": ("[[measured]]\nfile = 'named.csv'\n", "has the column uz_imag; expected some of ux_re, ux_im"),
    "capitals": ("[[measured]]\nfile = 'capitals.csv'\n", "has the column UZ_im; expected some of ux_re"),
    "damaged": ("[[measured]]\nfile = 'bad.unv'\n", "bad.unv"),
    "skew axes": ("[[measured]]\nfrequency_hz = 5.0\naxes = [[1, 0, 0], [1, 1, 0]]\n", "two vectors at right angles"),
    "long number": ("[[measured]]\nfile = 'long.csv'\n", "long.csv"),
    "unit": ("[[measured]]\nfrequency_hz = 5.0\nlength_unit = 'in'\n", "length_unit"),
}


@pytest.mark.parametrize("case", BAD)
def test_what_is_refused_before_anything_is_solved(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], case: str
) -> None:
    measured, said = BAD[case]
    for name, text in (("bad.csv", "a,b\n1,2\n"), ("words.csv", "frequency_hz\nloud\n"), ("bad.unv", "no\n"),
                       ("negative.csv", "frequency_hz\n5\n-5\n"), ("infinite.csv", "frequency_hz\n5\ninf\n"),
                       ("long.csv", f"frequency_hz\n{'1' * 500}\n5\n"), ("points.csv", "x,y,z\n0,0,0\n"),
                       ("alone.csv", "x,y,z,ux_im,uz_re\n0,0,0,1,1\n"),
                       ("named.csv", "x,y,z,uz_re,uz_imag\n0,0,0,1,1\n"),
                       ("capitals.csv", "x,y,z,uz_re,UZ_im\n0,0,0,1,1\n")):  # fmt: skip
        (tmp_path / name).write_text(text)
    scene = write_scene(tmp_path, SCENE + measured)
    assert main(["run", str(scene), "-o", str(tmp_path / "out")]) == 2
    found = capsys.readouterr().err
    assert said in found and found.count("\n") == 1 and "measured" in found
    assert not (tmp_path / "out").exists()


def test_mac_of_vectors() -> None:
    rng = np.random.default_rng(5)
    a, b = rng.standard_normal((2, 40)) + 1j * rng.standard_normal((2, 40))
    assert mac(a, (2 - 3j) * a) == pytest.approx(1.0) and mac(a, b) == pytest.approx(mac(b, a))
    orthogonal = b - a * np.vdot(a, b) / np.vdot(a, a)
    assert mac(a, orthogonal) < 1e-28
    assert mac(np.append(a, np.nan), np.append(a, 5)) == pytest.approx(1.0)
    assert np.isnan(mac(np.zeros(3), np.ones(3)))


def test_the_example_has_frequencies_of_a_file_and_a_shape() -> None:
    example = Path(__file__).parents[2] / "examples/disc_pad_measured.toml"
    found = read_measured(fe_squeal.load_scene(example))
    names = {f.hz: f.label for f in found.frequencies}
    assert names == {4620.0: "stop 14", 2710.0: "stop 3", 5980.0: "stop 21"}
    [shape] = found.shapes
    assert shape.label == "laser, 4.62 kHz" and len(shape.points) == 44
    np.testing.assert_allclose(np.hypot(*shape.points[:, :2].T), 0.13, atol=1e-5)  # the rim, in m
    assert np.isnan(shape.u[:, :2]).all() and np.isfinite(shape.u[:, 2]).all()


def test_frequencies_below_the_range_of_known_modes_are_told() -> None:
    rows = {"stability": ["unstable"], "frequency_hz": [700.0], "branch": [1], "value": [0.8], "mode": [1]}
    result = SimpleNamespace(to_dataframe=lambda: pd.DataFrame(rows), parameter="mu")
    given = Measurements(tuple(Frequency(hz, None, "") for hz in (8.0, 700.0, 3000.0)))
    below, inside, above = (entry["sentence"] for entry in measured_record(given, result, (12.0, 2000.0)))
    assert "It lies below 12 Hz, from which on modes are known" in below and "lies above" not in below
    assert "It lies above 2.00 kHz, up to which modes are known" in above and "lies below" not in above
    assert "It lies" not in inside
