"""The mixed formulation converges with twice the order of the elements, at ν = 0.3 and near ½, to the same limit."""

from __future__ import annotations

import numpy as np
import pytest
from mixed_cases import SCHEMES, SIZE, formulated, lining, relative_errors
from selection import some

from meshes import box, make_problem, modes_of

CELLS = {("hex1", 1): (4, 6, 8), ("tet1", 1): (4, 6, 8), ("hex1", 2): (2, 3, 4), ("tet1", 2): (3, 4, 5)}


@pytest.mark.parametrize(
    ("kind", "order", "nu"),
    some(
        [(*scheme, nu) for scheme in SCHEMES for nu in (0.3, 0.4999)],
        lambda kind, order, nu: nu > 0.4 and (kind, order) != ("tet1", 2),
    ),
)
def test_eigenvalues_converge_with_order_2p(kind, order, nu):
    """Slope of log error(ω²) over log h between walls: 2p within 0.25 (Boffi, Brezzi, Gastaldi, Math. Comp. 69, 2000).

    Quadratic tetrahedra come from below, as they do in the standard form, and more slowly: at 0.4999 3.1, 3.2, 3.3,
    3.4 on 3, 4, 5, 6 and 8 cells; there it must grow. P0 pressures with order 2 would stay at 2.
    """
    cells = CELLS[kind, order]
    errors = [np.abs(relative_errors(box(kind, (n, n, n), SIZE), order, nu, 4)).sum() for n in cells]
    rates = -np.diff(np.log(errors)) / np.diff(np.log(cells))
    if (kind, order) == ("tet1", 2):
        assert 3 < rates[0] < rates[1] < 4.2, rates
    else:
        assert rates == pytest.approx(2 * order, abs=0.25), rates


@pytest.mark.parametrize(("kind", "order"), some(SCHEMES, lambda kind, order: (kind, order) == ("hex1", 1)))
def test_same_limit_as_the_standard_form(kind, order):
    """A block bonded on one side, which has singular edges and no closed form: at ν = 0.3 the two forms differ by less
    than either moves from mesh to mesh, and ever less."""
    found = {}
    for n in CELLS[kind, order]:
        for formulation in ("standard", "mixed"):
            problem = make_problem(
                box(kind, (n, n, n), SIZE), order=order, supports=[{"surface": "bottom", "fixed": "xyz"}],
                materials={"lining": lining(0.3)}, bodies=formulated("block", formulation),
            )  # fmt: skip
            found[n, formulation] = modes_of(problem, 5).lam.imag[:5]
    a, b, c = (found[n, "standard"] - found[n, "mixed"] for n in CELLS[kind, order])
    assert np.abs(c).max() < 0.8 * np.abs(b).max() < 0.64 * np.abs(a).max()
    moved = np.abs(found[CELLS[kind, order][0], "standard"] - found[CELLS[kind, order][2], "standard"]).max()
    assert np.abs(c).max() < moved
