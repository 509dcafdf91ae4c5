"""What breaks brake-squeal codes, and what happens here: python benchmarks/hard_cases.py [--write]

Runs tests/hard and makes docs/hard_cases.md of what its tests record.
"""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

import numpy  # noqa: E402
import pytest  # noqa: E402
import scipy  # noqa: E402
from hard_page import HEADER, PAGE, Result, known_cases, write_row  # noqa: E402

NOTE = """# Hard cases

What breaks brake-squeal codes, each with a known answer: a closed form, exact algebra on the rounded matrices, or a
dense reference. The tests are in `tests/hard/`. Beside them `scipy.sparse.linalg.eigs` runs as a script calls it, with
`sigma = 0`, on `K φ = θ M φ` or on the companion linearisation; "fails" means fewer than three digits of one of the
modes asked for, "holds" that it does not. Digits are the fewest of all runs of a case, relative to |λ| unless the text
says otherwise, and 15 at most. Cases without `eigs` ask for something that it does not give.

Made by `python benchmarks/hard_cases.py --write`. The tests fail when a case is missing here or the digits are
off by more than an order of magnitude and rounding."""


class Recorder:
    """Collects the results that tests record."""

    def __init__(self) -> None:
        self.results: dict[str, list[Result]] = {}

    def pytest_configure(self, config: pytest.Config) -> None:
        """Switch the comparison with the page off."""
        config.pluginmanager.register(object(), "write-hard-cases")

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.when == "call":
            for name, values in report.user_properties:
                self.results.setdefault(name, []).append(Result(*values))


def main() -> int:
    """Run the tests and print or write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true", help="write docs/hard_cases.md instead of printing it")
    arguments = parser.parse_args()
    recorder = Recorder()
    folder = ROOT / "tests" / "hard"
    ignored = f"--ignore={folder / 'test_zz_page.py'}"  # it compares results with the page, which is only written now
    code = pytest.main([str(folder), ignored, "-p", "no:cacheprovider"], plugins=[recorder])
    if code:
        return int(code)
    rows = [write_row(name, breaks, recorder.results[name]) for name, breaks in known_cases().items()]
    rule = "|" + "---|" * (HEADER.count("|") - 1)
    versions = f"NumPy {numpy.__version__}, SciPy {scipy.__version__}."
    text = "\n".join([NOTE, "", versions, "", HEADER, rule, *rows, ""])
    if arguments.write:
        PAGE.write_text(text, encoding="utf-8")
    else:
        print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
