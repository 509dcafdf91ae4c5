"""Pictures and figures of docs/report.md: python benchmarks/report.py [--write] [--keep FOLDER]

It runs the two examples of the disc with two pads, compares them, opens their pages in Chromium (Debian's package,
driven by Playwright) and takes screenshots. --write puts the pictures into docs/images and the measurements into the
page.
"""

from __future__ import annotations

import argparse
import os
import shutil
import sys
import tempfile
import time
from pathlib import Path

for _key in ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(_key, "1")

from playwright.sync_api import Page, sync_playwright  # noqa: E402

from fe_squeal.cli import main as fe_squeal  # noqa: E402

ROOT = Path(__file__).parents[1]
PAGE, IMAGES = ROOT / "docs" / "report.md", ROOT / "docs" / "images"
BEGIN, END = "<!-- measured: python benchmarks/report.py --write -->\n", "<!-- end of measured -->\n"
OPTIONS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"]


def run(folder: Path) -> dict[str, Path]:
    """Run and compare the examples; return the folders of results."""
    out = {name: folder / name for name in ("disc_pad", "disc_pad_measured", "diff")}
    for name in ("disc_pad", "disc_pad_measured"):
        if not (out[name] / "report.html").exists():
            _done(fe_squeal(["run", str(ROOT / "examples" / f"{name}.toml"), "-o", str(out[name])]))
    _done(fe_squeal(["diff", str(out["disc_pad"]), str(out["disc_pad_measured"]), "-o", str(out["diff"])]))
    return out


def _done(code: int) -> None:
    if code:
        raise SystemExit(code)


def photograph(out: dict[str, Path], images: Path) -> list[str]:
    """Take the screenshots; return what was measured, a line each."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=OPTIONS)
        page = browser.new_page(viewport={"width": 1180, "height": 1120}, reduced_motion="reduce")
        start = time.perf_counter()
        page.goto((out["disc_pad"] / "report.html").as_uri())
        page.wait_for_selector("#shape canvas", state="attached")
        opened = time.perf_counter() - start
        page.wait_for_timeout(1500)
        page.screenshot(path=images / "page.png")
        _section(page, "#shapes", images / "page_shapes.png")
        _section(page, "#branch-19", images / "page_mode.png")
        page.set_viewport_size({"width": 360, "height": 740})
        page.reload()
        page.wait_for_selector("#stability .main-svg", state="attached")
        page.evaluate("document.getElementById('charts').scrollIntoView({ behavior: 'instant' })")
        page.wait_for_timeout(1500)
        page.screenshot(path=images / "page_narrow.png")
        browser.close()
    for name, folder in (("mac.png", "disc_pad_measured"), ("diff.png", "diff")):
        shutil.copyfile(out[folder] / name, images / name)
    size = (out["disc_pad"] / "report.html").stat().st_size / 1e6
    start = time.perf_counter()
    _done(fe_squeal(["report", str(out["disc_pad"])]))
    made = time.perf_counter() - start
    return [
        f"- `report.html` of `examples/disc_pad.toml`: {size:.1f} MB, made in {made:.1f} s.",
        f"- Opened and drawn by Chromium, without a graphics card, in {opened:.1f} s.",
    ]


def _section(page: Page, selector: str, path: Path) -> None:
    page.evaluate("(s) => document.querySelector(s).scrollIntoView({ behavior: 'instant' })", selector)
    page.wait_for_timeout(800)
    page.locator(selector).screenshot(path=path)


def main() -> None:
    """Run, photograph, and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true", help="put pictures and figures into docs/")
    parser.add_argument("--keep", type=Path, help="folder of the runs; what is there already is not run again")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        images = IMAGES if options.write else Path(scratch)
        lines = photograph(run(options.keep or Path(scratch)), images)
    print("\n".join(lines))
    if options.write:
        head, rest = PAGE.read_text(encoding="utf-8").split(BEGIN)
        PAGE.write_text(head + BEGIN + "\n".join(lines) + "\n" + END + rest.split(END)[1], encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
