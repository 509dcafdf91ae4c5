"""docs/hard_cases.md is what the tests of this folder come to; last by its name, so that their results are there."""

from __future__ import annotations

from hard_page import PAGE, RECORDED, SLACK, known_cases, read_page, summary


def test_page_has_every_case_and_no_other():
    assert sorted(read_page()) == sorted(known_cases()), f"run python benchmarks/hard_cases.py --write for {PAGE.name}"
    assert all(known_cases().values())  # a docstring each, which the page quotes


def test_page_has_the_digits_of_this_run(request):
    """Of those cases of which every run was made."""
    page, known = read_page(), known_cases()
    for name, results in request.config.stash.get(RECORDED, {}).items():
        assert name in known and name in page
        row = page[name]
        if len(results) < row.runs:
            continue
        assert len(results) == row.runs
        worst, there, _ = summary(results)
        assert abs(worst.digits - row.digits) <= SLACK, f"{name}: {worst.digits:.1f}, {PAGE.name} has {row.digits}"
        # What another program comes to is rounding where it fails, and may be anything on another machine.
        assert (there is None) == (row.there is None), name
