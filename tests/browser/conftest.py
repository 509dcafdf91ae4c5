"""A page of a coarse brake in Chromium, which Playwright drives; the browser is the system's own package."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, sync_playwright

import fe_squeal.report.export
from fe_squeal.cli import main

EXAMPLE = Path(__file__).parents[2] / "examples/disc_pad.toml"
# Drawing in software, so that a machine without a graphics card shows the shapes too.
OPTIONS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"]


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
        patch.setattr(fe_squeal.report.export, "draw_shapes", lambda *_: None)
        patch.setattr(fe_squeal.report.export, "write_animation", lambda *_a, **_k: [])
        assert main(["run", str(scene), "-o", str(folder / "out")]) == 0
    return folder / "out"


@pytest.fixture(scope="session")
def browser() -> Iterator[Browser]:
    """Debian's Chromium; a machine without it fails these tests, which .ci/run installs it for."""
    path = os.environ.get("CHROMIUM") or shutil.which("chromium") or shutil.which("chromium-browser")
    assert path, "Chromium is missing: apt-get install chromium"
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=OPTIONS)
        yield browser
        browser.close()


class Opened:
    """A page with what it asked for and complained about."""

    def __init__(self, page: Page, file: Path) -> None:
        self.page, self.requests, self.complaints = page, [], []
        page.on("request", lambda r: self.requests.append(r.url))
        page.on("console", lambda m: self.complaints.append(m.text) if m.type == "error" else None)
        page.on("pageerror", lambda e: self.complaints.append(str(e)))
        page.goto(file.absolute().as_uri())
        page.wait_for_selector("#stability .main-svg", state="attached", timeout=60_000)


@pytest.fixture(scope="session")
def opened(browser: Browser, results: Path) -> Iterator[Opened]:
    """The page of the brake in a wide window; for whom wants no motion, so that it waits until a test has it play."""
    page = browser.new_page(viewport={"width": 1280, "height": 900}, reduced_motion="reduce")
    yield Opened(page, results / "report.html")
    page.close()
