"""The figure of the shares of terms: bars as long as the data, labels clear of each other."""

from itertools import combinations

import numpy as np
import pandas as pd
import pytest
import scipy.sparse as sp
from matplotlib import image
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from fe_squeal import sweep
from fe_squeal.problem.problem import Problem
from fe_squeal.problem.terms import Term
from fe_squeal.report.contributions import MAX_BRANCHES, MAX_TERMS, contributions_figure, plot_contributions
from fe_squeal.report.page.sections import mode_sections
from fe_squeal.report.results import Results

COLUMNS = ["parameter", "value", "mode", "branch", "term", "re_share", "energy_share"]


def tables(branches, contacts=("outer", "inner"), bodies=("disc", "linings"), springs=2, seed=0):
    """Return contributions and modes of branches that grow fastest at μ = 0.35, between 0.2 and 0.5."""
    rng = np.random.default_rng(seed)
    rows, modes = [], []
    for branch in range(1, branches + 1):
        for value, speed in ((0.2, 40.0), (0.35, 300.0), (0.5, 200.0)):
            kinetic, potential = rng.dirichlet(np.ones(len(bodies))), rng.dirichlet(np.ones(len(bodies)) * 3)
            parts = [(f"mass.{b}", 0.0, e) for b, e in zip(bodies, kinetic, strict=True)]
            parts += [(f"elastic.{b}", 0.0, 0.9 * e) for b, e in zip(bodies, potential, strict=True)]
            parts += [(f"spring.s{i}", -0.15 * speed, 0.1 / (springs + 1)) for i in range(springs)]
            parts += [(f"contact.{c}", 0.0, 0.1 / (springs + 1) / len(contacts)) for c in contacts]
            parts += [(f"friction.{c}", speed * rng.uniform(1, 2), np.nan) for c in contacts]
            parts += [(f"rayleigh.{b}", -0.2 * speed * rng.random(), np.nan) for b in bodies]
            total = sum(part[1] for part in parts)
            rows += [("mu", value, branch, branch, *part) for part in (*parts, ("sum", total, np.nan))]
            modes.append(("mu", value, branch, branch, total, 5000.0 * branch, 800.0 * branch))
    modes.append(("mu", 0.5, branches + 1, branches + 1, -1e4, 1.0, 1.0))  # a stable one beside them
    names = ["parameter", "value", "mode", "branch", "re", "im", "frequency_hz"]
    return pd.DataFrame(rows, columns=COLUMNS), pd.DataFrame(modes, columns=names)


def bars(axes, row):
    """Return {term: sum of the bar lengths} of a row, and its leftmost and rightmost ends."""
    lengths: dict[str, float] = {}
    ends = [0.0]
    for container in axes.containers:
        patch = container.patches[row]
        lengths[container.get_label()] = lengths.get(container.get_label(), 0.0) + patch.get_width()
        ends += [patch.get_x(), patch.get_x() + patch.get_width()]
    return lengths, min(ends), max(ends)


def drawn_texts(figure: Figure):
    """Return the texts that are seen, with their boxes in pixels, after a draw."""
    figure.canvas.draw()
    texts = list(figure.texts)
    legends = [*figure.legends, *(axes.get_legend() for axes in figure.axes if axes.get_legend())]
    for axes in figure.axes:
        texts += axes.texts
        for axis in (axes.xaxis, axes.yaxis) if axes.axison else ():
            low, high = sorted(axis.get_view_interval())
            ticks = [tick for tick in axis.get_major_ticks() if low <= tick.get_loc() <= high]
            texts += [axes.title, axis.label, *(label for tick in ticks for label in (tick.label1, tick.label2))]
    texts += [text for legend in legends for text in legend.get_texts()]
    seen = {id(t): t for t in texts if t.get_visible() and t.get_text().strip()}
    return [(t.get_text(), t.get_window_extent(figure.canvas.get_renderer())) for t in seen.values()]


def assert_nothing_overlaps(figure):
    found = drawn_texts(figure)
    for (a, box), (b, other) in combinations(found, 2):
        assert not box.overlaps(other), f"{a!r} and {b!r}"
    for text, box in found:
        assert box.x0 >= 0 and box.y0 >= 0, text
        assert box.x1 <= figure.bbox.x1 and box.y1 <= figure.bbox.y1, text
    panels = [axes.get_window_extent() for axes in figure.axes if axes.axison]
    for axes in figure.axes:
        if axes.get_legend():
            box = axes.get_legend().get_window_extent()
            assert not any(box.overlaps(panel) for panel in panels)


def test_bars_are_as_long_as_the_shares():
    contributions, modes = tables(3)
    figure = contributions_figure(contributions, modes, "disc")
    growth, potential, kinetic = figure.axes[:3]
    fastest = modes[modes.value == 0.35].sort_values("re", ascending=False)
    for row, branch in enumerate(fastest.branch):
        data = contributions[(contributions.branch == branch) & (contributions.value == 0.35)].set_index("term")
        shares = data.re_share.drop("sum")
        lengths, left, right = bars(growth, row)
        assert lengths == pytest.approx(shares[shares != 0].to_dict())
        assert left == pytest.approx(shares.clip(upper=0).sum()) and right == pytest.approx(shares.clip(lower=0).sum())
        stored = data.energy_share.dropna()
        moving = stored.index.str.startswith("mass.")
        assert bars(kinetic, row)[0] == pytest.approx(stored[moving].to_dict())
        lengths = bars(potential, row)[0]
        assert sum(lengths.values()) == pytest.approx(1.0)
        assert lengths["elastic.disc"] == pytest.approx(stored["elastic.disc"])
    diamonds = growth.lines[-1]
    np.testing.assert_allclose(diamonds.get_xdata(), fastest.re)
    first = fastest.branch.iloc[0]
    text = f"branch {first}, {800 * first} Hz\nμ = 0.35: Re λ = {fastest.re.iloc[0]:+.4g} 1/s"
    assert first == 1 and growth.get_yticklabels()[0].get_text() == text


@pytest.mark.slow
@pytest.mark.parametrize("branches", [1, 5, 30])
def test_no_text_covers_another(branches):
    figure = contributions_figure(*tables(branches), "A disc with two pads and a title of some length")
    assert_nothing_overlaps(figure)
    assert len(figure.axes[0].get_yticklabels()) == min(branches, MAX_BRANCHES)


@pytest.mark.slow
def test_many_long_names_find_room():
    contacts = [f"pad_{i}_{'of_the_fixed_calliper_' * (1 + i % 3)}" for i in range(8)]
    bodies = [f"body_{i}_{'with_a_long_name_' * (1 + i % 4)}" for i in range(9)]
    figure = contributions_figure(*tables(6, contacts, bodies, springs=9), "A long title, " * 20)
    assert_nothing_overlaps(figure)
    for legend, panels in ((3, (0,)), (4, (1, 2))):
        named = len(figure.axes[legend].get_legend().get_texts())
        assert named <= MAX_TERMS * len(panels) + 2


@pytest.mark.slow
def test_branches_left_out_are_said():
    figure = contributions_figure(*tables(30))
    assert figure.get_suptitle() == f"the {MAX_BRANCHES} fastest growing of 30 unstable branches"
    assert contributions_figure(*tables(MAX_BRANCHES), "all").get_suptitle() == "all"


def test_small_terms_are_gathered_and_nothing_is_lost():
    contributions, modes = tables(2, springs=30)
    figure = contributions_figure(contributions, modes)
    lengths, _, right = bars(figure.axes[1], 0)
    assert "other" in lengths and not any(name.startswith("spring.") for name in lengths)
    assert sum(lengths.values()) == pytest.approx(1.0) and right == pytest.approx(1.0)
    assert "other" in [text.get_text() for text in figure.axes[4].get_legend().get_texts()]


def test_negative_energy_lies_left_of_zero_in_view():
    contributions, modes = tables(1)
    extra = contributions.iloc[[0, 0, 0]].assign(term="convection.disc", energy_share=-0.2, value=[0.2, 0.35, 0.5])
    axes = contributions_figure(pd.concat([contributions, extra]), modes).axes[1]
    lengths, left, _ = bars(axes, 0)
    assert lengths["convection.disc"] == left == -0.2
    assert axes.get_xlim()[0] < -0.2


def test_a_body_has_one_colour_and_all_terms_differ():
    figure = contributions_figure(*tables(4))
    colours: dict[str, str] = {}
    for axes in figure.axes[:3]:
        colours |= {c.get_label(): to_hex(c.patches[0].get_facecolor()) for c in axes.containers}
    assert colours["elastic.disc"] == colours["mass.disc"] != colours["elastic.linings"]
    others = [colour for term, colour in colours.items() if not term.startswith("mass.")]
    assert len(set(others)) == len(others)


def test_without_unstable_modes_the_figure_says_so(tmp_path):
    contributions, modes = tables(1)
    figure = contributions_figure(contributions.iloc[:0], modes, "disc")
    assert "no unstable mode" in [text.get_text() for text in figure.texts]
    assert_nothing_overlaps(figure)
    assert image.imread(plot_contributions(contributions.iloc[:0], modes, tmp_path / "none.png")).std() > 0.01


@pytest.mark.slow
def test_file_is_written_in_the_format_of_its_suffix(tmp_path):
    contributions, modes = tables(2)
    path = plot_contributions(contributions, modes, tmp_path / "new" / "contributions.png", "disc")
    assert image.imread(path)[..., :3].std() > 0.05
    assert plot_contributions(contributions, modes, tmp_path / "c.pdf").read_bytes().startswith(b"%PDF")
    assert sorted(p.name for p in tmp_path.rglob("*.p*")) == ["c.pdf", "contributions.png"]


def test_modes_without_branch_numbers_stand_for_themselves():
    contributions, modes = tables(2)
    contributions["branch"] = modes["branch"] = np.nan
    figure = contributions_figure(contributions, modes)
    assert len(figure.axes[0].get_yticklabels()) == 6
    assert figure.axes[0].get_yticklabels()[0].get_text().startswith("mode ")


@pytest.mark.slow
def test_tables_read_back_from_csv_give_the_same_figure(tmp_path):
    contributions, modes = tables(3)
    modes["value"] = modes["value"] / 3
    contributions["value"] = contributions["value"] / 3
    read = []
    for frame in (contributions, modes):
        frame.to_csv(tmp_path / "table.csv", index=False)
        # Older versions of pandas read the last digit of a float in their own way.
        floats = dict.fromkeys(frame.select_dtypes(float).columns, float)
        read.append(pd.read_csv(tmp_path / "table.csv", dtype=dict.fromkeys(floats, str)).astype(floats))
    again = contributions_figure(*read)
    assert bars(again.axes[0], 1) == bars(contributions_figure(contributions, modes).axes[0], 1)


@pytest.mark.parametrize("name", ["reference.caliper.mass", "added_mass"])
def test_masses_that_are_no_bodies_have_kinetic_energy(name):
    """Whatever a term of M is called: each panel adds up to 1.

    K = [[2, μ − ½], [−μ − ½, 2]] and M = 1 flutter beyond μ = ½ with |u₂/u₁|² = (μ + ½)/(μ − ½), which is 3 at μ = 1.
    Half of the mass of u₂ is the other term's, whose share is ½ · ¾.
    """
    M, K, F = np.diag([1.0, 0.5]), np.array([[2.0, -0.5], [-0.5, 2.0]]), np.array([[0.0, 1.0], [-1.0, 0.0]])
    terms = [Term("mass.disc", "M", sp.csr_array(M), True), Term(name, "M", sp.csr_array(np.eye(2) - M), True),
             Term("elastic.disc", "K", sp.csr_array(K), True),
             Term("friction", "K", sp.csr_array(F), False, {"mu": 1}, skew=True)]  # fmt: skip
    result = sweep(Problem(tuple(terms), {"mu": 0.0}), [0.0, 1.0], "mu", modes=2)
    modes, shares = result.to_dataframe(), result.contributions_dataframe()
    _, potential, kinetic = contributions_figure(shares, modes).axes[:3]
    assert bars(potential, 0)[0] == pytest.approx({"elastic.disc": 1.0})
    assert bars(kinetic, 0)[0] == pytest.approx({"mass.disc": 0.625, name: 0.375}, rel=1e-6)
    page = mode_sections(Results({}, modes, result.onsets_dataframe(), shares, pd.DataFrame()))
    table = page.partition("Energy by body")[2].partition("</table>")[0]
    assert f'{name}</th><td class="number">37.5 %</td><td class="number">–' in table
    assert 'disc</th><td class="number">62.5 %</td><td class="number">100 %' in table and page.count(name) == 1
