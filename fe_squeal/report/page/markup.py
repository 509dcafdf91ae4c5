"""Pieces of HTML; every text is escaped here."""

from __future__ import annotations

import base64
import re
from collections.abc import Iterable, Sequence
from html import escape

from fe_squeal.errors import one_line

_OPTION = re.compile(r"--[a-z]+(-[a-z]+)*")


def text(value: object) -> str:
    """Return a text as escaped HTML; control characters are spelled out."""
    return escape(one_line(str(value)))


def prose(value: object) -> str:
    """Return a text as escaped HTML in which a line does not break within an option, such as --estimate."""
    return _OPTION.sub(r'<span class="option">\g<0></span>', text(value))


def paragraph(*sentences: str) -> str:
    """Return sentences as a paragraph; "" if there are none."""
    return f"<p>{prose(' '.join(s for s in sentences if s))}</p>" if any(sentences) else ""


def bullets(items: Iterable[str]) -> str:
    """Return texts as a list; "" if there are none."""
    rows = "".join(f"<li>{prose(item)}</li>" for item in items)
    return f"<ul>{rows}</ul>" if rows else ""


def image(png: bytes, words: str) -> str:
    """Return a picture that is embedded in the page, with a text for those who cannot see it."""
    data = base64.b64encode(png).decode()
    return f'<img src="data:image/png;base64,{data}" alt="{text(words)}" style="max-width:100%">'


def table(caption: str, heads: Sequence[str], rows: Iterable[Sequence[object]], names: int = 1) -> str:
    """Return a table; "" without rows. The first `names` columns are words, aligned left, the others numbers."""
    body = "".join(
        "<tr>" + "".join(
            f'<th scope="row">{text(cell)}</th>' if i == 0 else f"<td{_side(i, names)}>{text(cell)}</td>"
            for i, cell in enumerate(row)
        ) + "</tr>"
        for row in rows
    )  # fmt: skip
    if not body:
        return ""
    head = "".join(f'<th scope="col"{_side(i, names)}>{text(h)}</th>' for i, h in enumerate(heads))
    return (
        f'<div class="scroll" tabindex="0" role="region" aria-label="{text(caption)}"><table><caption>{text(caption)}'
        f"</caption><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>"
    )


def _side(i: int, names: int) -> str:
    return ' class="number"' if i >= names else ""
