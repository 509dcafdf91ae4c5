"""Lines of Nastran bulk data that would lose fields or entries are refused."""

from __future__ import annotations

import pytest

from fe_squeal.errors import MeshError
from fe_squeal.mesh.readers.nastran.text import read_cards


def cards(text):
    lines = [(line, f"a.bdf line {i}") for i, line in enumerate(text.splitlines(), 1)]
    return [(card.name, [f for f in card.fields if f]) for card in read_cards(lines)]


TEN = "CTETRA,1,1,1,2,3,4,5,6"


@pytest.mark.parametrize(("text", "message"), [
    (f"{TEN},7,8,9,10\n", "line 1: CTETRA has 12 fields on a line; expected at most 8"),
    ("SPC1,7,123,1,2,3,4,5,6,7\n", "line 1: SPC1 has 9 fields"),
    ("GRID*,1,,0.,0.,1.5\n", r"line 1: GRID\* has 5 fields on a line; expected at most 4"),
    ("GRID,1,,0.,0.,0.\n=,*(1),=,*(1.),==\n=(3)\n", 'line 2: "=" repeats an entry'),
    ("GRID           1              0.      0.      0.\n=        *(1)\n=4\n", 'line 2: "=" repeats an entry'),
    (f"{TEN},+A\nCTETRA,2,1,1,2,3,4,11,12,+B\n+A,7,8,9,10\n+B,13,14,15,16\n",
     'line 3: the continuation "\\+A" stands behind an entry that "\\+B" continues'),
    ("CTETRA         1       1       1       2       3       4       5       6+A\n"
     "CTETRA         2       1       1       2       3       4      11      12+B\n"
     "+A             7       8       9      10\n", 'line 3: the continuation "\\+A"'),
])  # fmt: skip
def test_what_would_be_lost_is_refused(text, message):
    with pytest.raises(MeshError, match=f"a.bdf {message}"):
        cards(text)


@pytest.mark.parametrize("text", [
    f"{TEN},+A\n+A,7,8,9,10\n", f"{TEN},A\n+A,7,8,9,10\n", f"{TEN},+\n+,7,8,9,10\n", f"{TEN}\n,7,8,9,10\n",
    f"{TEN},+1\n+1,7,8,9,10\n", f"{TEN},+1\n$\n+1,7,8,9,10\n",
    f"{TEN},+a\n+A,7,8,9,10,,,,,\n", f"{TEN},,,\n,7,8,9,10\n",
    "CTETRA         1       1       1       2       3       4       5       6+E  1\n"
    "+E  1          7       8       9      10\n",
    "CTETRA         1       1       1       2       3       4       5       600000010\n"
    "+              7       8       9      10" + 32 * " " + "00000020\n",
])  # fmt: skip
def test_continuations_in_their_place_are_read(text):
    assert cards(text) == [("CTETRA", [str(i) for i in (1, 1, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10)])]


@pytest.mark.parametrize("head", ["SPC1*   ", "SPC1   *", "SPC1 *  "])
def test_a_star_in_any_column_of_the_name_makes_fields_large(head):
    text = f"{head}{7:16d}{123:16d}{11:16d}{12:16d}*\n*       {13:16d}\n"
    assert cards(text) == [("SPC1", ["7", "123", "11", "12", "13"])]


def test_a_number_with_a_sign_is_no_mark():
    assert cards("GRID,1,,0.,0.,+1\nGRID,2,,0.,0.,+1\n")[0] == ("GRID", ["1", "0.", "0.", "+1"])
