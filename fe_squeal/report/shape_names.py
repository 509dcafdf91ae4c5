"""The name of the file of a mode shape, and the text above its picture."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from fe_squeal.report.branches import parameter_symbol, value_text
from fe_squeal.report.looks import body_text, diameters_text, in_plane_text, way_text


def shape_name(info: Mapping[str, Any], exact: bool = False) -> str:
    """Return a file name without suffix, made so that names sort by branch and then by the value of the sweep.

    Values that agree in six digits have names of their own where they are `exact`, with all digits.

    Examples
    --------
    >>> shape_name({"parameter": "mu", "value": 0.6, "branch": 7, "frequency_hz": 2413.2})
    'branch_07_mu_0.60_2413Hz'
    >>> shape_name({"parameter": "springs.piston.damping", "value": 1.5e7, "mode": 3, "frequency_hz": 0.25})
    'mode_03_damping_1.5e+07_0.25Hz'
    """
    branch = info.get("branch")
    known = branch is not None and np.isfinite(branch)
    parts = [f"branch_{int(info['branch']):02d}" if known else f"mode_{int(info.get('mode', 0)):02d}"]
    if "value" in info:
        short = str(info.get("parameter", "value")).rsplit(".", 1)[-1]
        value = float(info["value"])
        parts += [re.sub(r"[^A-Za-z0-9_-]+", "-", short), repr(value) if exact else value_text(value)]
    if "frequency_hz" in info:
        frequency = float(info["frequency_hz"])
        parts.append(f"{frequency:.0f}Hz" if frequency >= 100 else f"{frequency:.3g}Hz")
    return "_".join(parts)


def shape_title(info: Mapping[str, Any]) -> str:
    """Return the text above a picture.

    Examples
    --------
    >>> shape_title({"parameter": "mu", "value": 0.6, "branch": 7, "frequency_hz": 2413.2, "re": 12.345})
    'branch 7:  2413 Hz,  Re λ = +12.35 1/s,  μ = 0.60'
    """
    parts = []
    if "frequency_hz" in info:
        frequency = float(info["frequency_hz"])
        parts.append(f"{frequency:.0f} Hz" if frequency >= 1000 else f"{frequency:.4g} Hz")
    if "re" in info:
        parts.append(f"Re λ = {float(info['re']):+.4g} 1/s")
    if "value" in info:
        parts.append(f"{parameter_symbol(str(info.get('parameter', 'value')))} = {value_text(float(info['value']))}")
    head = next((f"{key} {int(info[key])}:  " for key in ("branch", "mode")
                 if info.get(key) is not None and np.isfinite(info[key])), "")
    texts = diameters_text(info), in_plane_text(info), body_text(info), way_text(info)
    looks = ", ".join(text for text in texts if text)
    return head + ",  ".join(parts) + (f"\n{looks}" if looks else "")
