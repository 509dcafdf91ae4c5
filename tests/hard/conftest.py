"""What a hard case came to goes on docs/hard_cases.md; each run is held against what the page says."""

from __future__ import annotations

from dataclasses import astuple

import pytest
from hard_page import PAGE, RECORDED, SLACK, Result, case_name, read_page


@pytest.fixture
def record(request):
    """Return a function that notes the result of a case: (digits, here, there, drift, elsewhere).

    `digits` are those of this program and `there` those of `eigs`, None where it cannot be asked; `here` and
    `elsewhere` say what happens; `drift` is its |Re λ| / |λ| where that is 0. Unless the page is being written, it
    must have the case with as many digits.
    """

    def note(
        digits: float, here: str, there: float | None = None, drift: float = 0.0, elsewhere: str = ""
    ) -> None:
        name = case_name(request.node)
        result = Result(float(digits), here, None if there is None else float(there), float(drift), elsewhere)
        request.config.stash.setdefault(RECORDED, {}).setdefault(name, []).append(result)
        request.node.user_properties.append((name, list(astuple(result))))  # plain, to go between processes
        if request.config.pluginmanager.hasplugin("write-hard-cases"):
            return
        row = read_page().get(name)
        assert row is not None, f"{PAGE.name} lacks {name}: run python benchmarks/hard_cases.py --write"
        assert result.digits >= row.digits - SLACK, f"{PAGE.name} promises {row.digits} digits"

    return note
