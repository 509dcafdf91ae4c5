"""What figures show between the values of a sweep: how growth begins, windows, labels of onsets close together."""

import numpy as np
import pandas as pd
import pytest
from test_report_figures import ONSET_COLUMNS, SWEEP, coupled_tables, no_onsets, texts, thick_lines
from test_report_tables import printed

from fe_squeal.report import figures
from fe_squeal.report.branches import collect_branches
from fe_squeal.report.figures import plot_stability
from fe_squeal.report.growth import growth_curves, onset_laws
from fe_squeal.report.page.charts import law_text
from fe_squeal.report.tables import print_unstable
from fe_squeal.report.views import moving_triangles

EXACT = 0.312
COARSE = np.linspace(0.0, 0.7, 8)


@pytest.fixture
def drawn(monkeypatch):
    kept = []
    save = figures.save_figure
    monkeypatch.setattr(figures, "save_figure", lambda figure, path: (kept.append(figure), save(figure, path))[1])
    return kept


def root_speed(frequency, split, critical):
    """Return the coefficient of √(μ − μ_c) of Re λ for −λ² = a ± d√(1 − μ/μ_c): d/(2ω√μ_c)."""
    return 2 * (2 * np.pi) ** 2 * frequency * split / (2 * 2 * np.pi * frequency * np.sqrt(critical))


def growth_of(frequency, split, critical, mu):
    d = 2 * (2 * np.pi) ** 2 * frequency * split
    return np.sqrt((2 * np.pi * frequency) ** 2 + d * np.sqrt(1 - mu / critical + 0j) + 0j).imag.__abs__()


def test_growth_begins_with_the_root_of_its_onset():
    """Against the closed form between the onset and the next value of a coarse sweep: a chord is off by a fifth of
    the growth there, the curve by less than a thousandth."""
    modes, onsets = coupled_tables([(2413.0, 60.0, EXACT)], COARSE)
    onsets["crossing_speed"] = root_speed(2413.0, 60.0, EXACT)
    branch = collect_branches(modes, onsets)[0]
    [i] = np.flatnonzero(branch.onset == 1)
    curve = growth_curves(branch)[i]
    assert curve[0].tolist() == [EXACT, 0.0] and curve[-1, 1] == pytest.approx(branch.re[i + 1])
    exact = growth_of(2413.0, 60.0, EXACT, curve[:, 0])
    assert np.abs(curve[:, 1] - exact).max() < 1e-3 * exact.max()
    chord = exact.max() * (curve[:, 0] - EXACT) / np.ptp(curve[:, 0])
    assert np.abs(chord - exact).max() > 0.2 * exact.max()


@pytest.mark.parametrize("wrong", [np.inf, -np.inf, np.nan, 1e300, 5e-324])
def test_growth_that_is_no_number_of_a_brake(wrong):
    """A table that was spoilt gives curves all the same, without a warning of NumPy: between finite rates of one sign
    they rise or fall from one to the other, whatever their size."""
    modes, onsets = coupled_tables([(2413.0, 60.0, EXACT)], COARSE)
    modes.loc[modes.index[(modes["branch"] == 1) & (modes["value"] > 0.55)][0], "re"] = wrong
    onsets["crossing_speed"] = root_speed(2413.0, 60.0, EXACT)
    branch = collect_branches(modes, onsets)[0]
    i = int(np.flatnonzero((branch.re == wrong) | np.isnan(branch.re))[0]) - 1
    curve = growth_curves(branch)[i]
    assert len(curve) == (33 if 0 < wrong < np.inf else 2)
    if 0 < wrong < np.inf:
        steps = np.diff(curve[:, 1]) * np.sign(wrong - branch.re[i])
        ends = pytest.approx([branch.re[i], wrong], abs=1e-6 * max(wrong, 1.0))
        assert curve[[0, -1], 1] == ends and (steps >= 0).all()


def test_growth_begins_with_a_line_where_one_mode_crosses():
    """Re λ = 300 s (1 − s/0.4) from μ = 0.15 on, of a damped scene."""
    mu = np.array([0.0, 0.1, 0.2, 0.3])
    re = 300 * (mu - 0.15) * (1 - (mu - 0.15) / 0.4)
    modes = pd.DataFrame({"parameter": "mu", "value": mu, "branch": 1, "re": re, "im": 6e3, "frequency_hz": 955.0,
                          "stability": np.where(re > 0, "unstable", "stable"), "re_uncertainty": 0.0})
    onsets = pd.DataFrame([("mu", 0.15, 955.0, "flutter", "into", 300.0, 1, np.nan, 1e-9, np.nan, None)],
                          columns=ONSET_COLUMNS)
    [branch] = collect_branches(modes, onsets)
    curve = growth_curves(branch)[2]
    s = curve[:, 0] - 0.15
    assert curve[1, 1] == pytest.approx(300 * s[1], rel=1e-2)
    assert np.abs(curve[:, 1] - 300 * s * (1 - s / 0.4)).max() < 0.01 * re.max()


@pytest.mark.parametrize("frequency_hz", [955.0, 0.0])
@pytest.mark.parametrize("kind", ["meeting", "crossing"])
def test_growth_that_gathers_speed_behind_its_onset_is_nearly_a_line(kind, frequency_hz):
    """Re λ = √(c²s + κs²) and s(c + κs) of an onset with hardly any speed: neither lies on zero and then jumps."""
    mu, c, kappa = np.array([0.0, 0.1, 0.2]), 0.3, 4e6
    re = np.sqrt(c**2 * mu + kappa * mu**2) if kind == "meeting" else 2000 * mu
    modes = pd.DataFrame([
        {"parameter": "mu", "value": v, "branch": b, "re": s * r, "im": 6e3 if frequency_hz else 0.0,
         "frequency_hz": frequency_hz, "stability": "unstable" if r > 0 < s else "stable", "re_uncertainty": 0.0}
        for v, r in zip(mu, re, strict=True) for b, s in ((1, 1), (2, -1))
    ])  # fmt: skip
    onsets = pd.DataFrame([("mu", 0.0, frequency_hz, "flutter", "into", c, 1, 2 if kind == "meeting" else np.nan, 1e-9,
                            np.nan, None)], columns=ONSET_COLUMNS)  # fmt: skip
    branch = next(b for b in collect_branches(modes, onsets) if b.number == 1)
    curve = growth_curves(branch)[int(np.flatnonzero(branch.onset == 1)[-1])]
    exact = np.interp(curve[:, 0], mu, re)
    assert np.abs(curve[:, 1] - exact).max() < 0.01 * exact.max()


@pytest.mark.parametrize("power", [0.5, 1.0])
def test_growth_between_values_has_no_kink(power):
    """Re λ = c μ or c√μ from an onset next to μ = 0, at five values: exact between all of them behind the first one,
    where a square root through two values alone is off by a tenth."""
    mu = np.linspace(0.0, 0.6, 5)
    re = 300 * mu**power
    modes = pd.DataFrame([
        {"parameter": "mu", "value": v, "branch": b, "re": s * r, "im": 6e3, "frequency_hz": 955.0,
         "stability": "unstable" if r > 0 < s else "stable", "re_uncertainty": 0.0}
        for v, r in zip(mu, re, strict=True) for b, s in ((1, 1), (2, -1))
    ])  # fmt: skip
    onset = ("mu", 1e-9, 955.0, "flutter", "into", 300.0, 1, 2, 1e-9, np.nan, None)
    onsets = pd.DataFrame([onset], columns=ONSET_COLUMNS)
    for branch in collect_branches(modes, onsets)[:2]:
        sign = np.sign(branch.re[-1])
        for curve in growth_curves(branch)[-3:]:
            assert curve[:, 1] == pytest.approx(sign * 300 * curve[:, 0] ** power, rel=1e-6)


@pytest.mark.parametrize(("times", "band"), [(1.0, 0), (1.5, 1)])
def test_what_loss_factors_say_nothing_of_has_no_band(tmp_path, drawn, times, band):
    """Re λ = −900 1/s, Im λ = 100 rad/s at the first value, uncertain by |λ|; by more than that it is a real doubt."""
    re, im = np.array([-900.0, 200.0, 400.0]), np.array([100.0, 6e3, 6e3])
    modes = pd.DataFrame({"parameter": "mu", "value": [0.0, 0.1, 0.2], "branch": 1, "re": re, "im": im,
                          "frequency_hz": im / (2 * np.pi), "stability": ["marginal", "unstable", "unstable"],
                          "re_uncertainty": [times * np.hypot(re[0], im[0]), 0.0, 0.0]})  # fmt: skip
    plot_stability(modes, pd.DataFrame(columns=ONSET_COLUMNS), tmp_path / "stability.png")
    bands = [c for c in drawn[0].axes[1].collections if "PolyCollection" in type(c).__name__]
    assert len(bands) == band


def test_the_drawn_curve_is_the_root(tmp_path, drawn):
    modes, onsets = coupled_tables([(2413.0, 60.0, EXACT)], COARSE)
    onsets["crossing_speed"] = root_speed(2413.0, 60.0, EXACT)
    plot_stability(modes, onsets, tmp_path / "stability.png")
    [rate] = thick_lines(drawn[0].axes[1])
    near = rate[(rate[:, 0] > EXACT) & (rate[:, 0] < 0.4)]
    assert len(near) > 10
    np.testing.assert_allclose(near[:, 1], growth_of(2413.0, 60.0, EXACT, near[:, 0]), rtol=2e-3)


def window():
    """A pair of branches that flutters from 0.103 to 0.105, between the values 0.1 and 0.12."""
    modes, _ = coupled_tables([(2413.0, 60.0, 0.9)], SWEEP)
    rows = [("mu", v, 2400.0, "flutter", d, 50.0, 1, 2, 1e-9, np.nan, None)
            for v, d in ((0.103, "into"), (0.105, "out of"))]
    return modes, pd.DataFrame(rows, columns=ONSET_COLUMNS)


def test_a_window_between_two_values_has_bar_legend_growth_and_row(tmp_path, drawn):
    modes, onsets = window()
    plot_stability(modes, onsets, tmp_path / "stability.png")
    top, bottom = drawn[0].axes
    [bar] = thick_lines(top)
    np.testing.assert_allclose(bar[[0, -1], 0], [0.103, 0.105])
    assert "branch 1, 2.40 kHz" in [text.get_text() for text in top.get_legend().get_texts()]
    assert "no unstable mode" not in texts(bottom)
    [rate] = thick_lines(bottom)
    # c√(s(w − s)/w) has its top √w/2 c in the middle.
    assert rate[:, 1].max() == pytest.approx(50.0 * np.sqrt(0.002) / 2, rel=1e-3)
    text = printed(lambda frame, console: print_unstable(frame, console, onsets), modes)
    [row] = [line for line in text.splitlines() if "0.103" in line]
    assert "0.103 … 0.105" in row and "about 1.1" in row and "0.104" in row


def test_the_panel_is_scaled_by_what_grows(tmp_path, drawn):
    """Falling friction damps one branch by 12 000 before it grows with 90."""
    modes, onsets = coupled_tables([(2413.0, 60.0, EXACT)], SWEEP)
    modes.loc[(modes.branch == 1) & (modes.value < 0.2), "re"] = -12_000.0
    plot_stability(modes, onsets, tmp_path / "stability.png")
    low, high = drawn[0].axes[1].get_ylim()
    assert modes.re.max() < high < 1.5 * modes.re.max() and -2 * high < low < 0


def box_centre(label, renderer):
    box = label.get_bbox_patch().get_window_extent(renderer)
    return np.array([(box.x0 + box.x1) / 2, (box.y0 + box.y1) / 2])


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_labels_of_onsets_close_together_are_not_exchanged(tmp_path, drawn, seed):
    """Each label is as its point lies to the others, and no line to a label crosses another."""
    rng = np.random.default_rng(seed)
    pairs = [(2413.0 + rng.uniform(-60, 60), 20.0, 0.3 + rng.uniform(-0.02, 0.02)) for _ in range(3)]
    modes, onsets = coupled_tables(pairs, SWEEP, uncoupled=[6000.0])
    plot_stability(modes, onsets, tmp_path / "stability.png")
    top = drawn[0].axes[0]
    renderer = drawn[0].canvas.get_renderer()
    points = top.transData.transform(np.column_stack([onsets.value, onsets.frequency_hz / 1e3]))
    labels = {t.get_text(): t for t in top.texts}
    assert len(labels) >= 2
    values = onsets.value.to_numpy()
    owner = {text: np.argmin(np.abs(values - float(text.split(",")[0].removeprefix("μ = ")))) for text in labels}
    assert len(set(owner.values())) == len(labels)
    found = [(points[owner[text]], box_centre(label, renderer)) for text, label in labels.items()]
    for i, (p, m) in enumerate(found):
        for q, n in found[:i]:
            assert (p - q) @ (m - n) >= 0


def test_onsets_of_one_pair_are_told_apart_by_their_digits(tmp_path, drawn):
    modes, onsets = window()
    onsets["value"] = [0.10312, 0.10344]
    plot_stability(modes, onsets, tmp_path / "stability.png")
    assert sorted(t.split(",")[0] for t in texts(drawn[0].axes[0])) == ["μ = 0.1031", "μ = 0.1034"]


def test_nothing_unstable_is_still_said(tmp_path, drawn):
    modes, _ = window()
    plot_stability(modes, no_onsets(), tmp_path / "stability.png")
    assert "no unstable mode" in texts(drawn[0].axes[1])


def bent_ring(power):
    """A ring clamped at its hub that bends with two nodal diameters, (r − r_i)^power cos 2θ, as triangles."""
    n_r, n_t = 24, 96
    r, t = np.meshgrid(np.linspace(0.05, 0.15, n_r + 1), 2 * np.pi * np.arange(n_t) / n_t, indexing="ij")
    points = np.column_stack([(r * np.cos(t)).ravel(), (r * np.sin(t)).ravel(), np.zeros(r.size)])
    i, j = (a.ravel() for a in np.meshgrid(np.arange(n_r), np.arange(n_t), indexing="ij"))
    a, b = i * n_t + j, i * n_t + (j + 1) % n_t
    triangles = np.concatenate([np.column_stack([a, b, a + n_t]), np.column_stack([b, b + n_t, a + n_t])])
    height = ((r - 0.05) / 0.1) ** power
    u_n = (height * np.cos(2 * t)).ravel()
    return points, triangles, u_n, np.hypot(u_n, 0.1 * height.ravel())


def test_nodal_lines_stay_off_the_clamped_hub():
    """Where the hub is held the displacement is zero, which is no nodal line; along the diameters it changes sign."""
    points, triangles, u_n, amplitude = bent_ring(2.0)
    moving = moving_triangles(points, triangles, u_n, amplitude)
    radius = np.hypot(*points[:, :2].T)[triangles]
    assert not moving[radius.min(axis=1) < 0.05 + 1e-9].any()
    crosses = (u_n[triangles].min(axis=1) < 0) & (u_n[triangles].max(axis=1) > 0)
    assert moving[crosses & (radius.min(axis=1) > 0.07)].all()
    # A body that tilts as a whole has its nodal line.
    tilt = points[:, 0]
    crosses = (tilt[triangles].min(axis=1) < 0) & (tilt[triangles].max(axis=1) > 0)
    assert moving_triangles(points, triangles, tilt, np.abs(tilt) + 0.02)[crosses].all()


def diverging(law, value, speed=200.0, /, **columns):
    """One branch, stable up to 0.2 and growing at 0.4 by 200 √s or 200 s behind an onset at a value; its table."""
    mu = np.array([0.0, 0.2, 0.4])
    s = np.clip(mu - value, 0.0, None)
    re = speed * (np.sqrt(s) if law == "root" else s)
    modes = pd.DataFrame({"parameter": "mu", "value": mu, "branch": 1, "re": re, "im": 0.0, "frequency_hz": 0.0,
                          "stability": np.where(re > 0, "unstable", "marginal"), "re_uncertainty": 0.0})
    onset = {"parameter": "mu", "value": value, "frequency_hz": 0.0, "kind": "divergence", "direction": "into",
             "crossing_speed": speed, "branch_a": 1, "branch_b": np.nan}  # fmt: skip
    return modes, pd.DataFrame([onset | columns])


@pytest.mark.parametrize("law", ["root", "linear"])
def test_a_divergence_has_the_law_of_its_table_or_that_which_fits(law):
    """Both laws occur: without dampers a root, with them a line. Earlier versions did not tell which."""
    modes, onsets = diverging(law, 0.3)
    assert onset_laws(modes, onsets) == onset_laws(modes, onsets.assign(law=law)) == [law]
    other = {"root": "linear", "linear": "root"}[law]
    assert onset_laws(modes, onsets.assign(law=other)) == [other]  # what the table says
    [branch] = collect_branches(modes, onsets.assign(law=other))
    assert branch.rooted[branch.onset == 1].tolist() == [other == "root"]
    text = law_text(onsets.assign(law=law).iloc[0].to_dict(), "μ")
    assert text == ("Re λ ≈ 200 √(μ − 0.3) 1/s" if law == "root" else "Re λ ≈ 200 (μ − 0.3) 1/s")


@pytest.mark.parametrize("changed", [
    {"law": ""}, {"law": np.nan}, {"branch_a": np.nan}, {"branch_a": 7}, {"value": 0.5}, {"crossing_speed": 0.0},
])  # fmt: skip
def test_a_law_that_is_not_known_is_no_formula(changed):
    """The table leaves it open, or the branch has no value at which it grows behind the onset."""
    modes, onsets = diverging("root", 0.3, **changed)
    assert onset_laws(modes, onsets) == [""]
    assert law_text(onsets.assign(law="").iloc[0].to_dict(), "μ") == "its law is not known"


def test_flutter_of_earlier_versions_has_a_root_where_two_meet():
    modes, onsets = coupled_tables([(2413.0, 60.0, EXACT), (900.0, 60.0, 0.2)], SWEEP)
    onsets.loc[1, "branch_b"] = np.nan
    assert onset_laws(modes, onsets) == ["root", "linear"]


@pytest.mark.parametrize(("direction", "words"), [
    ("into", "a growing mode becomes two that do not swing"), ("out of", "two growing modes become one that swings"),
])  # fmt: skip
def test_where_growing_modes_part_no_formula_is_given(direction, words):
    _, onsets = diverging("root", 0.3, law="parting", direction=direction)
    for speed in (200.0, np.nan):
        assert law_text(onsets.iloc[0].to_dict() | {"crossing_speed": speed}, "μ") == words
