"""Put the page together: one file that contains the JavaScript library for its charts."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from fe_squeal.report.files import replace_atomically
from fe_squeal.report.page.charts import chart_data
from fe_squeal.report.page.markup import bullets, text
from fe_squeal.report.page.sections import (
    certificate,
    interval_table,
    mac_table,
    mesh_error_section,
    mode_sections,
    onset_table,
    scene_section,
    verdict_section,
)
from fe_squeal.report.page.surface import shape_data
from fe_squeal.report.results import Results
from fe_squeal.version import __version__

Z_AXIS = (0.0, 0.0, 1.0)
Section = tuple[str, str, str]  # name, heading, HTML


def write_run_page(results: Results, path: Path) -> Path:
    """Write the page of a run.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    title = str(results.record.get("title") or "Results of a run")
    axis = (results.record.get("axis") or {}).get("direction") or Z_AXIS
    data: dict[str, Any] = {"charts": None, "shapes": None}
    said: list[str] = []
    if len(results.modes):
        data["charts"] = chart_data(results)
    if results.grid is not None and results.shapes:
        ordered = sorted(results.shapes, key=lambda s: -float(s.info.get("re", 0.0)))
        data["shapes"], said = shape_data(results.grid, ordered, axis)
        data["shapes"]["axis"] = [float(a) for a in axis]
    charts, shapes = _template("charts.html"), _template("shapes.html")
    no_shapes = "".join(f"<p>{text(lack)}</p>" for lack in results.lacks if "hape" in lack)
    mesh = mesh_error_section(results)
    drawn = charts + interval_table(results) + onset_table(results) + mac_table(results)
    sections: list[Section] = [
        ("verdict", "The answer", verdict_section(results)),
        ("charts", "Stability", drawn if data["charts"] else "<p>There are no modes to draw.</p>"),
        ("shapes", "Shapes", shapes + bullets(said) if data["shapes"] else no_shapes or "<p>There are no shapes.</p>"),
        ("modes", "Unstable modes", mode_sections(results)),
        *((("mesh", "Where the error of the mesh comes from", mesh),) if mesh else ()),
        ("certificate", "What it rests on", certificate(results)),
        ("scene", "The scene", scene_section(results)),
    ]  # fmt: skip
    return write_page(title, sections, path, data)


def write_page(title: str, sections: Sequence[Section], path: Path, data: dict[str, Any] | None = None) -> Path:
    """Write a page of some sections.

    Parameters
    ----------
    title : str
    sections : sequence of (name, heading, HTML)
    path : Path
    data : dict, optional
        What the page's JavaScript draws: "charts" and "shapes" of a run, or "plots", a list of {"id", "data", "layout"}
        with Plotly's data and layout for the element with this id.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    navigation = "".join(f'<a href="#{name}">{text(heading)}</a>' for name, heading, _ in sections)
    body = "".join(
        f'<section id="{name}" aria-labelledby="{name}-heading"><h2 id="{name}-heading">{text(heading)}</h2>{html}'
        "</section>"
        for name, heading, html in sections
    )
    # A text with "</script>" would end the script element that contains the data, so "<" is escaped.
    data_text = json.dumps(_finite(data or {}), ensure_ascii=False, allow_nan=False).replace("<", "\\u003c")
    pieces = {
        "title": text(title), "style": _template("page.css"), "navigation": navigation, "body": body,
        "version": text(__version__), "data": data_text, "plotly": _plotly(),
        "script": "".join(_template(name) for name in ("page.js", "charts.js", "shapes.js")),
    }  # fmt: skip
    page, *rest = _template("page.html").split("{{")
    for part in rest:
        name, tail = part.split("}}", 1)
        page += pieces[name] + tail
    with replace_atomically(path) as temporary:
        temporary.write_text(page, encoding="utf-8", newline="\n")
    return path


@lru_cache(maxsize=1)
def _plotly() -> str:
    from plotly.offline import get_plotlyjs  # read from the package, 5 MB

    return str(get_plotlyjs()).replace("</script", "<\\/script")


def _template(name: str) -> str:
    return files(__package__).joinpath("assets", name).read_text(encoding="utf-8")


def _finite(data: Any) -> Any:
    """Return data for JSON, with None in place of NaN and infinity, which JSON does not have."""
    if isinstance(data, dict):
        return {str(k): _finite(v) for k, v in data.items()}
    if isinstance(data, list | tuple):
        return [_finite(v) for v in data]
    if isinstance(data, float) and not math.isfinite(data):
        return None
    return data
