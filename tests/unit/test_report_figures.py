"""Figures of a sweep, on tables made from a model of two coupling modes with known onset."""

import numpy as np
import pandas as pd
import pytest
from matplotlib import image
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fe_squeal.report import figures
from fe_squeal.report.branches import collect_branches, find_mirror, parameter_symbol
from fe_squeal.report.curves import draw_growth
from fe_squeal.report.figures import plot_root_locus, plot_stability
from fe_squeal.sweep.noise import classify_noise

ONSET_COLUMNS = ["parameter", "value", "frequency_hz", "kind", "direction", "crossing_speed", "branch_a", "branch_b",
                 "uncertainty", "two_mode_value", "discretisation"]
SWEEP = np.linspace(0.0, 0.7, 36)


def coupled_tables(pairs, values, *, damping=0.0, uncertainty=1e-6, uncoupled=(), parameter="mu"):
    """Return modes and onsets of pairs (frequency, half split, mu_c): −λ² = a ± d sqrt(1 − mu/mu_c)."""
    rows, onsets = [], []
    for j, (frequency, split, critical) in enumerate(pairs):
        d = 2 * (2 * np.pi) ** 2 * frequency * split
        for value in values:
            root = d * np.sqrt(1 - value / critical + 0j)
            lam = 1j * np.sqrt((2 * np.pi * frequency) ** 2 + np.array([-root, root]))
            if value > critical:
                lam = lam[np.argsort(-lam.real)]
            rows += [(parameter, value, 2 * j + 1 + b, lam[b].real - damping, lam[b].imag) for b in range(2)]
        if damping == 0 and values[0] < critical < values[-1]:
            partners = (2 * j + 1, 2 * j + 2)
            onsets.append((parameter, critical, frequency, "flutter", "into", 1.0, *partners, 1e-9, critical, None))
    for i, frequency in enumerate(uncoupled):
        rows += [(parameter, v, 2 * len(pairs) + 1 + i, -damping, 2 * np.pi * frequency) for v in values]
    modes = pd.DataFrame(rows, columns=["parameter", "value", "branch", "re", "im"])
    modes["frequency_hz"] = modes.im / (2 * np.pi)
    modes["damping_ratio"] = -modes.re / np.hypot(modes.re, modes.im)
    modes["re_uncertainty"] = uncertainty
    modes["re_discretisation"] = np.nan
    grows, decays = modes.re > uncertainty, modes.re < -uncertainty
    modes["stability"] = np.select([grows, decays], ["unstable", "stable"], "marginal")
    modes["mode"] = modes.groupby("value").im.rank(method="first").astype(int)
    modes["noise"] = modes.frequency_hz.map(classify_noise).where(grows, "")
    return modes.sort_values(["value", "mode"], ignore_index=True), pd.DataFrame(onsets, columns=ONSET_COLUMNS)


def no_onsets():
    return pd.DataFrame(columns=ONSET_COLUMNS)


@pytest.fixture
def drawn(monkeypatch):
    """Keep the figures that are saved, so that what stands on them can be read."""
    kept: list[Figure] = []
    save = figures.save_figure
    monkeypatch.setattr(figures, "save_figure", lambda figure, path: (kept.append(figure), save(figure, path))[1])
    return kept


def texts(axes: Axes) -> list[str]:
    return [text.get_text() for text in axes.texts]


def thick_lines(axes: Axes) -> list[np.ndarray]:
    return [line.get_xydata() for line in axes.lines if line.get_linewidth() == 2.4 and len(line.get_xydata()) > 1]


def test_branch_starts_to_be_unstable_at_the_onset():
    modes, onsets = coupled_tables([(2413.0, 60.0, 0.312)], SWEEP, uncoupled=[5000.0])
    branches = collect_branches(modes, onsets)
    assert [(b.number, b.grows) for b in branches] == [(1, True), (2, False), (3, False)]
    inside = branches[0].unstable_segments()
    first = np.flatnonzero(inside)[0]
    assert branches[0].value[first] == 0.312 and branches[0].re[first] == 0.0
    assert inside[first:].all() and not inside[:first].any()
    assert not branches[1].unstable_segments().any()
    assert branches[0].re[branches[0].peak] == modes.re.max()


@pytest.mark.parametrize(("partner", "bar"), [(np.nan, 2.0), (2, 3.0)])
def test_the_bar_at_an_onset_is_that_of_the_onset_or_lies_between_its_neighbours(partner, bar):
    """A mode that crosses alone at 20 1/s per unit, known to 0.1, has 2 1/s; where two meet the slope says nothing."""
    modes = pd.DataFrame({
        "parameter": "mu", "value": [0.0, 1.0], "branch": 1, "re": [-10.0, 10.0], "frequency_hz": 100.0,
        "stability": ["stable", "unstable"], "re_uncertainty": [4.0, 2.0],
    })  # fmt: skip
    onsets = pd.DataFrame({
        "value": [0.5], "frequency_hz": [100.0], "direction": ["into"], "crossing_speed": [20.0], "uncertainty": [0.0],
        "discretisation": [0.1], "branch_a": [1], "branch_b": [partner],
    })  # fmt: skip
    [branch] = collect_branches(modes, onsets)
    np.testing.assert_allclose(branch.re_uncertainty, [4.0, bar, 2.0])


def test_branch_with_a_hole_is_not_joined_across_it():
    modes, _ = coupled_tables([(2413.0, 60.0, 0.312)], SWEEP)
    holed = modes[~((modes.branch == 1) & modes.value.between(0.4, 0.5))]
    branch = collect_branches(holed, no_onsets())[0]
    gap = np.flatnonzero(~branch.joined)
    assert len(gap) == 1
    assert branch.value[gap[0]] < 0.4 and branch.value[gap[0] + 1] > 0.5


def test_narrow_tongue_between_two_onsets_is_unstable():
    modes, onsets = coupled_tables([(2413.0, 60.0, 0.31)], SWEEP[:20], uncoupled=[5000.0])
    tongue = onsets.iloc[[0, 0]].assign(value=[0.103, 0.105], direction=["into", "out of"], branch_a=3, branch_b=np.nan,
                                        frequency_hz=5000.0)
    branch = collect_branches(modes, tongue)[2]
    inside = branch.unstable_segments()
    assert inside.sum() == 1 and branch.value[np.flatnonzero(inside)[0]] == 0.103


def test_mirror_is_the_partner_at_the_onset_else_the_one_of_the_same_frequency():
    modes, onsets = coupled_tables([(2413.0, 60.0, 0.312), (4000.0, 10.0, 0.2)], SWEEP, damping=30.0)
    branches = collect_branches(modes, onsets)
    assert [find_mirror(branches[i], branches, no_onsets()).number for i in (0, 2)] == [2, 4]
    named = no_onsets()
    named.loc[0] = {"value": 0.3, "frequency_hz": 2413.0, "branch_a": 4, "branch_b": 1, "direction": "into"}
    assert find_mirror(branches[0], branches, named).number == 4


def test_stability_of_one_unstable_branch(tmp_path, drawn):
    modes, onsets = coupled_tables([(2413.0, 60.0, 0.312)], SWEEP, uncoupled=np.linspace(0, 15000, 30))
    path = plot_stability(modes, onsets, tmp_path / "stability.png", "disc with two pads")
    picture = image.imread(path)
    assert picture.shape[:2] == (1200, 1500) and picture[..., :3].std() > 0.02
    top, bottom = drawn[0].axes
    assert texts(top) == ["μ = 0.312, 2.41 kHz"]
    [curve] = thick_lines(top)
    # it begins at the onset and is in kHz
    np.testing.assert_allclose(curve[0], [0.312, 2.413])
    [rate] = thick_lines(bottom)
    assert rate[-1, 1] == modes.re.max()
    assert bottom.get_xlabel() == "friction coefficient μ (–)" and bottom.get_ylabel() == "growth rate Re λ (1/s)"
    assert top.get_ylabel() == "frequency (kHz)" and drawn[0].get_suptitle() == "disc with two pads"
    assert "branch 1, 2.41 kHz" in [text.get_text() for text in top.get_legend().get_texts()]


def test_modes_that_decay_faster_than_they_swing_have_no_line(tmp_path, drawn):
    """They have no frequency to speak of; others, those that grow without swinging too, are drawn as before."""
    modes, _ = coupled_tables([], SWEEP, uncoupled=(900.0, 1500.0, 0.0, 0.0))
    modes.loc[modes.branch == 4, "re"] = -1e-7  # a motion at rest, within its uncertainty
    crowd = (modes.branch == 2) & (modes.value > 0.3)
    modes.loc[crowd, "re"] = -1.1 * modes.im[crowd]
    modes.loc[modes.branch == 3, "re"] = 40.0
    plot_stability(modes, no_onsets(), tmp_path / "stability.png")
    lines = [path.vertices for c in drawn[0].axes[0].collections for path in c.get_paths()]
    ends: dict[float, float] = {}
    at_rest = sum(bool(len(v)) and np.isfinite(v).all() and not v[:, 1].any() for v in lines)
    for v in lines:
        if len(v) and np.isfinite(v).all():
            height = round(float(v[-1, 1]), 6)
            ends[height] = max(ends.get(height, 0.0), float(v[:, 0].max()))
    last = float(SWEEP[SWEEP <= 0.3][-1])
    assert ends == pytest.approx({900.0: 0.7, 1500.0: last, 0.0: 0.7}, abs=1e-9)
    # Both modes without a frequency have a line in every step: the one that grows, and the one at rest.
    assert at_rest >= 2 * (len(SWEEP) - 1)


def test_labels_do_not_overlap_and_stay_inside(tmp_path, drawn):
    pairs = [(2400.0 + 40 * i, 15.0, 0.30 + 0.002 * i) for i in range(6)] + [(14900.0, 20.0, 0.69), (300.0, 5.0, 0.01)]
    plot_stability(*coupled_tables(pairs, SWEEP), tmp_path / "stability.png")
    top = drawn[0].axes[0]
    renderer = drawn[0].canvas.get_renderer()
    boxes = [text.get_bbox_patch().get_window_extent(renderer) for text in top.texts]
    assert len(boxes) == 8
    frame = top.get_window_extent(renderer)
    for i, box in enumerate(boxes):
        assert frame.x0 < box.x0 and box.x1 < frame.x1 and frame.y0 < box.y0 and box.y1 < frame.y1
        assert not any(box.overlaps(other) for other in boxes[:i])


@pytest.mark.slow
def test_twenty_branches_have_different_styles_and_no_labels(tmp_path, drawn):
    pairs = [(800.0 + 700 * i, 30.0, 0.05 + 0.03 * i) for i in range(20)]
    plot_stability(*coupled_tables(pairs, SWEEP), tmp_path / "stability.png")
    top = drawn[0].axes[0]
    entries = [line for line in top.get_legend().get_lines() if line.get_label().startswith("branch")]
    assert len(entries) == 20 and len({(str(e.get_color()), e.get_linestyle()) for e in entries}) == 20
    assert texts(top) == []
    assert len(thick_lines(top)) == 20


def test_no_unstable_mode_is_said(tmp_path, drawn):
    modes, onsets = coupled_tables([(2413.0, 60.0, 0.9)], SWEEP, damping=30.0)
    plot_stability(modes, onsets, tmp_path / "stability.png")
    bottom = drawn[0].axes[1]
    assert "no unstable mode" in texts(bottom)
    low, high = bottom.get_ylim()
    assert low < -30.0 < 0.0 < high


def test_single_value_is_drawn_with_markers(tmp_path, drawn):
    modes, onsets = coupled_tables([(2413.0, 60.0, 0.312)], SWEEP[30:31], uncoupled=[5000.0])
    plot_stability(modes, onsets, tmp_path / "stability.png")
    top, bottom = drawn[0].axes
    assert thick_lines(top) == []
    diamonds = [line.get_xydata() for axes in (top, bottom) for line in axes.lines if line.get_marker() == "D"]
    top_mode = modes.loc[modes.re.idxmax()]
    np.testing.assert_allclose(np.concatenate(diamonds)[:, 1], [top_mode.frequency_hz / 1e3, top_mode.re])
    assert top.get_xlim()[0] < 0.6 < top.get_xlim()[1]


@pytest.mark.slow
@pytest.mark.parametrize(("uncertainty", "bands"), [(20.0, 1), (1e-6, 0)])
def test_uncertainty_band_is_drawn_where_it_can_be_seen(tmp_path, drawn, uncertainty, bands):
    modes, onsets = coupled_tables([(2413.0, 60.0, 0.312)], SWEEP)
    plot_stability(modes.assign(re_uncertainty=uncertainty), onsets, tmp_path / "stability.png")
    collections = drawn[0].axes[1].collections
    assert sum(type(c).__name__ in ("PolyCollection", "FillBetweenPolyCollection") for c in collections) == bands


def test_the_band_of_uncertainty_goes_as_far_as_the_branch_before_a_gap():
    """A branch that is missing at some values has a band along each stretch, to its very end, and a bar where alone."""
    modes, onsets = coupled_tables([(2413.0, 60.0, 0.312)], SWEEP, uncertainty=20.0)
    gone = np.isclose(modes.value.to_numpy()[:, None], [0.50, 0.58, 0.62]).any(axis=1)
    [branch, _] = collect_branches(modes[~gone | (modes.branch != 1)], onsets)
    axes = Figure().subplots()
    draw_growth(axes, [branch], [branch], {1: {"color": "tab:blue"}}, onsets)
    bands = [c for c in axes.collections if "Poly" in type(c).__name__]
    spans = [(path.vertices[:, 0].min(), path.vertices[:, 0].max()) for band in bands for path in band.get_paths()]
    np.testing.assert_allclose(spans, [(0.0, 0.48), (0.52, 0.56), (0.64, 0.70)], atol=1e-12)
    [bar] = axes.containers
    np.testing.assert_allclose(bar[2][0].get_segments()[0][:, 0], 0.60)


@pytest.mark.slow
def test_other_parameters_go_by_their_path_and_wide_ranges_are_logarithmic(tmp_path, drawn):
    path = "contacts.outer.normal_stiffness"
    modes, onsets = coupled_tables([(1200.0, 60.0, 3e7)], np.geomspace(1e6, 1e8, 20), parameter=path)
    plot_stability(modes, onsets, tmp_path / "stability.png")
    top, bottom = drawn[0].axes
    assert bottom.get_xlabel() == path and bottom.get_xscale() == "log"
    assert texts(top) == ["normal_stiffness = 3e+07, 1.20 kHz"] and top.get_ylabel() == "frequency (Hz)"
    assert parameter_symbol("effects.friction.mu") == "μ"


@pytest.mark.parametrize(
    ("parameter", "symbol"),
    [
        ("materials.lining.youngs_modulus.0", "youngs_modulus.0"),
        ("springs.left.damping, springs.right.damping", "damping"),
        ("mu, springs.right.damping", "μ, …"),
        ("omega", "omega"),
    ],
)
def test_short_names_of_parameters_say_what_they_are(parameter, symbol):
    assert parameter_symbol(parameter) == symbol


@pytest.mark.slow
def test_empty_tables_are_drawn(tmp_path):
    modes, _ = coupled_tables([(2413.0, 60.0, 0.312)], SWEEP)
    for plot in (plot_stability, plot_root_locus):
        picture = image.imread(plot(modes.iloc[:0], no_onsets(), tmp_path / "empty.png"))
        assert picture[..., :3].std() > 0.01


@pytest.mark.parametrize(("covered", "ends", "label"), [
    ((0.0, 3000.0), [3.0], "all modes below 3.00 kHz"), ((12.0, None), [0.012], "all modes above 12 Hz"),
    ((12.0, 3000.0), [0.012, 3.0], "all modes from 12 Hz to 3.00 kHz"), ((0.0, None), [], None), (None, [], None),
])  # fmt: skip
def test_the_range_of_known_modes_is_drawn_with_both_ends(tmp_path, drawn, covered, ends, label):
    plot_root_locus(*coupled_tables([(2413.0, 60.0, 0.312)], SWEEP[:2]), tmp_path / "root_locus.png", "", covered)
    axes = drawn[0].axes[0]
    lines = [line.get_ydata()[0] for line in axes.lines if line.is_dashed() and line.get_color() == "0.45"]
    assert lines == pytest.approx(ends)
    told = axes.get_legend().get_texts() if axes.get_legend() else []
    assert [text.get_text() for text in told if "all modes" in text.get_text()] == ([label] if label else [])


def test_root_locus_shades_the_unstable_half_and_colours_by_value(tmp_path, drawn):
    modes, onsets = coupled_tables([(2413.0, 60.0, 0.312)], SWEEP)
    plot_root_locus(modes, onsets, tmp_path / "root_locus.png", "title")
    axes = drawn[0].axes[0]
    points = next(c for c in axes.collections if type(c).__name__ == "PathCollection")
    np.testing.assert_allclose(points.get_offsets(), modes[["re", "frequency_hz"]] * [1.0, 1e-3])
    np.testing.assert_allclose(points.get_array(), modes.value)
    assert axes.get_ylabel() == "Im λ / 2π (kHz)"
    assert axes.get_xlim()[0] < modes.re.min() and axes.get_xlim()[1] > modes.re.max()
    assert drawn[0].axes[1].get_ylabel() == "friction coefficient μ (–)"


def test_root_locus_without_damping_or_instability_is_symmetric_and_says_so(tmp_path, drawn):
    modes, onsets = coupled_tables([(2413.0, 60.0, 0.9)], SWEEP)
    plot_root_locus(modes, onsets, tmp_path / "root_locus.png")
    axes = drawn[0].axes[0]
    assert axes.get_xlim() == (-1.0, 1.0)
    assert "Re λ = 0 within its uncertainty" in axes.get_title(loc="left")


@pytest.mark.slow
@pytest.mark.parametrize("frequency", [0.0, 1500.0])
def test_root_locus_counts_eigenvalues_outside(tmp_path, drawn, frequency):
    modes, onsets = coupled_tables([(2413.0, 60.0, 0.312)], SWEEP, damping=30.0)
    far = modes.iloc[:2].assign(re=-1e6, im=2 * np.pi * frequency, frequency_hz=frequency)
    plot_root_locus(pd.concat([modes, far]), onsets, tmp_path / "root_locus.png")
    axes = drawn[0].axes[0]
    low, high = axes.get_xlim()
    assert -1e4 < low < modes.re.min() and high > modes.re.max()
    assert axes.get_title(loc="left") == "2 eigenvalues lie further left, down to Re λ = −1e+06 1/s"


def test_root_locus_shows_all_that_are_not_far_from_the_others(tmp_path, drawn):
    modes, onsets = coupled_tables([(2413.0, 60.0, 0.312)], SWEEP, damping=30.0)
    far = modes.iloc[:2].assign(re=1.5 * modes.re.min())
    plot_root_locus(pd.concat([modes, far]), onsets, tmp_path / "root_locus.png")
    assert drawn[0].axes[0].get_xlim()[0] < far.re.min() and not drawn[0].axes[0].get_title(loc="left")


@pytest.mark.parametrize("plot", [plot_stability, plot_root_locus])
def test_onsets_of_one_mesh_alone_have_markers_of_their_own(tmp_path, drawn, plot):
    """One that appears refined is no onset of the sweep; one that vanishes is, and is crossed."""
    pairs = [(2413.0, 60.0, 0.312), (5000.0, 60.0, 0.2), (8000.0, 60.0, 0.4)]
    modes, onsets = coupled_tables(pairs, SWEEP)
    onsets["discretisation"] = [np.inf, np.inf, 0.01]
    onsets.loc[0, ["branch_a", "branch_b"]] = [0, np.nan]
    onsets.loc[0, "frequency_hz"] = 1500.0  # where the mesh itself has no mode
    plot(modes, onsets, tmp_path / "figure.png")
    axes = drawn[0].axes[0]
    assert axes.get_ylim()[0] < 1.5
    marked = {line.get_label(): line.get_ydata().tolist() for line in axes.lines if "mesh" in line.get_label()}
    assert marked == {"on the refined mesh alone": [1.5], "vanishes on the refined mesh": [5.0]}
    [own] = [line for line in axes.lines if line.get_label() == "flutter: into instability"]
    assert own.get_ydata().tolist() == [5.0, 8.0]
    if plot is plot_stability:
        ends = {text.split(", ")[1]: text.split(", ")[2:] for text in texts(axes)}
        assert ends == {"1.50 kHz": ["refined only"], "5.00 kHz": ["vanishes refined"], "8.00 kHz": []}
