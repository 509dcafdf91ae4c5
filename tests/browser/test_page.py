"""The page of a run in a real browser: it asks for nothing, draws its charts, links them, and its shape moves."""

from __future__ import annotations

import io
import json
import re
import shutil
from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from opened import Opened
from PIL import Image
from playwright.sync_api import Browser

import fe_squeal.report.export
from fe_squeal.cli import main
from fe_squeal.report.page import surface
from fe_squeal.run.page import write_run_report

EXAMPLE = Path(__file__).parents[2] / "examples/disc_pad.toml"


@pytest.fixture(scope="session")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The results of a coarse disc with two pads, with the shapes of all modes; ParaView's pictures are left out."""
    folder = tmp_path_factory.mktemp("page")
    text = EXAMPLE.read_text(encoding="utf-8").replace('file = "../meshes/disc_pad.msh"', "order = 1")
    for old, new in (("size = 0.014", "size = 0.02"), ("points = 22", "points = 5"),
                     ("max_frequency = 6500.0", "max_frequency = 7000.0")):  # fmt: skip
        assert old in text
        text = text.replace(old, new)
    scene = folder / "brake.toml"
    scene.write_text(f'{text}\n[output]\nshapes = "all"\n', encoding="utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(fe_squeal.report.export, "drawing_shapes", lambda *_: nullcontext())
        patch.setattr(fe_squeal.report.export, "write_animation", lambda *_a, **_k: [])
        assert main(["run", str(scene), "-o", str(folder / "out")]) == 0
    return folder / "out"


@pytest.fixture(scope="session")
def opened(browser: Browser, results: Path) -> Iterator[Opened]:
    """The page of the brake in a wide window; for whom wants no motion, so that it waits until a test has it play."""
    page = browser.new_page(viewport={"width": 1280, "height": 900}, reduced_motion="reduce")
    yield Opened(page, results / "report.html")
    page.close()

pytestmark = pytest.mark.slow


def picture(opened, selector="#shape"):
    """Return the pixels of an element, (rows, columns, 3) int."""
    shot = opened.page.locator(selector).screenshot(animations="disabled")
    return np.asarray(Image.open(io.BytesIO(shot)).convert("RGB")).astype(int)


def test_nothing_leaves_the_page_and_nothing_is_complained_about(opened):
    opened.page.wait_for_timeout(500)
    assert [url for url in opened.requests if not url.startswith(("file:", "data:", "blob:"))] == []
    assert len([url for url in opened.requests if url.startswith("file:")]) == 1
    assert opened.complaints == []


def test_charts_have_every_mode(opened, results):
    """As many dots as modes.csv has rows for the chosen value, and a line for each branch."""
    modes = pd.read_csv(results / "modes.csv")
    last = modes[modes["value"] == modes["value"].max()]
    dots = opened.page.evaluate("document.getElementById('damping').data[1].x.length")
    assert dots == len(last) > 10
    drawn = opened.page.evaluate("document.querySelectorAll('#damping .scatterlayer path.point').length")
    assert drawn >= dots
    found = opened.page.evaluate("document.getElementById('locus').data.length")
    assert found == modes["branch"].nunique() + 1
    ratios = opened.page.evaluate("document.getElementById('damping').data[1].y")
    assert sorted(ratios) == pytest.approx(sorted(100 * last["damping_ratio"]), abs=1e-9)


def test_the_slider_moves_the_damping_ratios(opened, results):
    modes = pd.read_csv(results / "modes.csv")
    opened.page.fill("#value", "0")
    first = modes[modes["value"] == modes["value"].min()]
    hz = opened.page.evaluate("document.getElementById('damping').data[1].x")
    assert sorted(hz) == pytest.approx(sorted(first["frequency_hz"] / 1000), rel=1e-9)


def test_a_click_on_a_mode_changes_shape_table_and_every_chart(opened, results):
    """The dot of a mode in the chart of damping ratios, clicked with the mouse where it is drawn."""
    page = opened.page
    before = page.inner_text("#chosen"), page.inner_text("#shape-text")
    page.evaluate("document.getElementById('damping').scrollIntoView({ block: 'center', behavior: 'instant' })")
    box = page.locator("#damping").bounding_box()
    branch, *place = page.evaluate("""(now) => {
      const chart = document.getElementById('damping'), data = chart.data[1], layout = chart._fullLayout;
      const alone = data.x.map((x, i) => String(data.customdata[i]) === now ? 0
        : Math.min(...data.x.map((o, k) => k === i ? 1e9 : Math.abs(o - x))));
      const i = alone.indexOf(Math.max(...alone));
      return [data.customdata[i], layout.xaxis._offset + layout.xaxis.d2p(data.x[i]),
              layout.yaxis._offset + layout.yaxis.d2p(data.y[i])];
    }""", page.input_value("#mode"))
    page.mouse.move(box["x"] + place[0] - 3, box["y"] + place[1])
    page.mouse.click(box["x"] + place[0], box["y"] + place[1])
    page.wait_for_timeout(300)
    assert page.input_value("#mode") == str(branch)
    assert page.inner_text("#chosen") != before[0]
    assert page.inner_text("#chosen").startswith(f"Branch {branch} ")
    assert page.inner_text("#shape-text").startswith(f"Branch {branch} ") and before[1]
    marked = page.evaluate("document.getElementById('locus').data.at(-1).y")
    modes = pd.read_csv(results / "modes.csv")
    own = modes[modes["branch"] == branch].sort_values("value")
    assert marked == pytest.approx(list(own["frequency_hz"] / 1000))
    line = page.evaluate("document.getElementById('stability').data.at(-2).y")
    assert len(line) >= len(own)
    assert page.locator("tr.chosen").count() >= 1


def test_the_shape_moves_while_playing_and_stands_while_paused(opened):
    page = opened.page
    resize(page, "320px", "220px")  # software draws every pixel
    page.locator("#shape").scroll_into_view_if_needed()
    assert page.inner_text("#play") == "Play"  # the window is one that wants no motion
    page.click("#play")
    page.wait_for_timeout(500)
    assert page.inner_text("#play") == "Pause"
    # Where other work takes the cores, software draws a picture in more than half a second.
    first = picture(opened)
    assert any((np.abs(first - later).max(axis=2) > 20).mean() > 0.002 for later in pictures(opened))
    page.click("#play")
    last = picture(opened)
    for third in pictures(opened):
        if (third == last).all():
            break
        last = third
    page.wait_for_timeout(1000)
    assert (np.abs(third - picture(opened)).max(axis=2) > 20).mean() == 0.0
    coloured = (np.ptp(third, axis=2) > 40).mean()
    assert coloured > 0.05  # the model fills some of the picture
    resize(page, "", "")


def pictures(opened):
    """Half a second apart, for half a minute."""
    for _ in range(60):
        opened.page.wait_for_timeout(500)
        yield picture(opened)


def resize(page, width, height):
    page.evaluate("""([width, height]) => {
      const place = document.getElementById('shape');
      place.style.width = width;
      place.style.height = height;
      return Plotly.Plots.resize(place);
    }""", [width, height])


def test_controls_of_the_shape(opened):
    """Seen along the axis, coloured by axial displacement, without a body, without amplitude: each changes pixels."""
    page = opened.page
    page.locator("#shape").scroll_into_view_if_needed()
    page.fill("#phase", "0")
    page.wait_for_timeout(300)
    last = picture(opened)
    steps = {
        "view": lambda: page.click("button[data-view=axis]"),
        "colour": lambda: page.select_option("#colour", "axial"),
        "body": lambda: page.locator("#bodies input").first.uncheck(),
        "edges": lambda: page.uncheck("#edges"),
    }
    for name, step in steps.items():
        step()
        page.wait_for_timeout(400)
        now = picture(opened)
        assert (np.abs(now - last).max(axis=2) > 20).mean() > 0.001, name
        last = now
    page.locator("#bodies input").first.check()
    page.check("#edges")
    page.click("button[data-view=side]")
    page.fill("#amplitude", "0")
    page.wait_for_timeout(400)
    still = picture(opened)
    page.fill("#phase", "90")
    page.wait_for_timeout(400)
    moved = picture(opened)
    edge = lambda image: (image.sum(axis=2) < 720)  # noqa: E731  what is not background
    assert (edge(still) != edge(moved)).mean() < 1e-3
    page.fill("#amplitude", "35")


def test_nothing_is_wider_than_the_window(browser, results, opened):
    assert opened.page.evaluate("document.documentElement.scrollWidth") <= 1280
    page = browser.new_page(viewport={"width": 360, "height": 800}, reduced_motion="reduce")
    page.goto((results / "report.html").as_uri())
    page.wait_for_selector("#stability .main-svg", state="attached")
    assert page.evaluate("document.documentElement.scrollWidth") <= 360
    shot = np.asarray(Image.open(io.BytesIO(page.screenshot())).convert("RGB"))
    assert shot.shape[1] == 360 and np.ptp(shot) > 200
    page.close()


def test_keyboard_and_screen_readers_reach_everything(opened):
    """Every control has a name, tab stops at all of them, and a key changes the chosen mode."""
    page = opened.page
    nameless = page.evaluate("""() => [...document.querySelectorAll('button, select, input')].filter((e) =>
      !((e.labels && e.labels.length) || e.getAttribute('aria-label') || e.textContent.trim())).map((e) => e.id)""")
    assert nameless == []
    charts = page.evaluate("[...document.querySelectorAll('.chart')].every((c) => c.getAttribute('aria-label'))")
    assert charts and page.evaluate("document.documentElement.lang") == "en"
    page.focus("#mode")
    before = page.inner_text("#chosen")
    page.keyboard.press("ArrowDown")
    page.wait_for_timeout(200)
    assert page.inner_text("#chosen") != before
    page.focus("#value")
    page.keyboard.press("Home")
    assert page.inner_text("#value-text") == "0.00"
    reached = set()
    page.focus("#mode")
    for _ in range(60):
        page.keyboard.press("Tab")
        reached.add(page.evaluate("document.activeElement.id"))
    assert {"value", "play", "amplitude", "phase", "colour", "shape-mode", "edges"} <= reached


def test_tables_behind_the_charts_have_every_number(opened, results):
    page = opened.page
    page.evaluate("document.getElementById('all-values').open = true")
    page.wait_for_timeout(200)
    modes = pd.read_csv(results / "modes.csv")
    assert page.locator("#all-values tbody tr").count() == len(modes)


def test_printing_gives_every_section(opened, tmp_path):
    """All headings are on the printed page, and controls are not."""
    page = opened.page
    page.emulate_media(media="print")
    for name in ("verdict", "charts", "shapes", "modes", "certificate", "scene"):
        assert page.locator(f"#{name} > h2").is_visible()
    assert not page.locator(".controls").first.is_visible()
    pdf = page.pdf(format="A4")
    page.emulate_media(media="screen")
    assert pdf.startswith(b"%PDF") and len(pdf) > 50_000


def test_a_browser_without_webgl_says_so(browser, results):
    page = browser.new_page(viewport={"width": 1000, "height": 800}, reduced_motion="reduce")
    page.add_init_script("HTMLCanvasElement.prototype.getContext = ((own) => function (kind, ...rest) {"
                         " return String(kind).includes('webgl') ? null : own.call(this, kind, ...rest); })"
                         "(HTMLCanvasElement.prototype.getContext)")  # fmt: skip
    page.goto((results / "report.html").as_uri())
    page.wait_for_selector("#stability .main-svg", state="attached")
    assert "cannot draw in three dimensions" in page.inner_text("#shape-text")
    assert page.inner_text("#chosen").startswith("Branch ")
    page.close()


def test_names_of_the_scene_are_no_markup(browser, results, tmp_path):
    """A title that would end a script, a body and a branch with tags: shown as they are, and nothing runs."""
    folder = tmp_path / "out"
    shutil.copytree(results, folder)
    record = json.loads((folder / "run.json").read_text())
    record["title"] = evil = "</script><script>window.hurt = 1</script><img src=x onerror='window.hurt=1'>"
    record["warnings"] = [evil]
    (folder / "run.json").write_text(json.dumps(record))
    modes = pd.read_csv(folder / "modes.csv")
    modes["body"] = evil
    modes.to_csv(folder / "modes.csv", index=False)
    write_run_report(folder, tmp_path / "evil.html")
    page = browser.new_page(reduced_motion="reduce")
    page.goto((tmp_path / "evil.html").as_uri())
    page.wait_for_selector("#stability .main-svg", state="attached")
    page.locator("#stability").hover(position={"x": 300, "y": 200})
    assert page.evaluate("window.hurt") is None
    assert page.inner_text("h1") == evil
    page.close()


def test_why_a_mode_has_no_shape(browser, results, tmp_path, monkeypatch):
    """There is no room for it, its file is lost though it is unstable, or it is stable and none was written."""
    folder = tmp_path / "out"
    shutil.copytree(results, folder)
    modes = pd.read_csv(folder / "modes.csv")
    unstable = set(modes[modes["stability"] == "unstable"]["branch"])
    stable = sorted(set(modes["branch"]) - unstable)
    lost = max(unstable, key=lambda b: modes[modes["branch"] == b]["re"].max())
    for branch in (lost, stable[0]):
        for file in folder.glob(f"shapes/branch_{branch:02d}_*.vtu"):
            file.unlink()
    monkeypatch.setattr(surface, "BUDGET", 50_000)  # four shapes
    write_run_report(folder, tmp_path / "few.html")
    page = browser.new_page(reduced_motion="reduce")
    page.goto((tmp_path / "few.html").as_uri())
    page.wait_for_selector("#stability .main-svg", state="attached")
    [left, *_] = page.evaluate("DATA.shapes.left_out")
    for branch, why in ((left, f"The shape of branch {left:.0f} is not on this page"),
                        (lost, f"Branch {lost} is unstable, but its shape could not be shown"),
                        (stable[0], f"Of branch {stable[0]} there is no shape here: it is not unstable")):  # fmt: skip
        page.evaluate(f"choose({branch})")
        assert page.inner_text("#shape-text").startswith(why)
    page.close()


def test_any_count_of_modes_has_its_largest_number(opened):
    """A call takes only so many arguments: with 1e5 modes and more the page had no charts."""
    found = opened.page.evaluate("""() => {
      const many = new Array(500000).fill(0).map((_, i) => Math.abs(i - 1000));
      let called = 0;
      try { called = Math.max(...many); } catch { called = -1; }
      return [called, largest(many, 0), smallest(many.map((x) => -x), 0), largest([], 2), smallest([], -2)];
    }""")
    assert found == [-1, 498999, -498999, 2, -2]
    code = "".join(path.read_text("utf-8") for path in Path(surface.__file__).parent.glob("assets/*.js"))
    assert not re.search(r"Math\.(max|min)\(\.\.\.[^;]*C\.", code)  # over the modes of the charts
