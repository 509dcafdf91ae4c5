"""Every study of the source document, by model and name."""

from __future__ import annotations

from ..study import Study
from . import minimal, nine_dof, oscillator, two_mass, uncoupled_disc

STUDIES: dict[str, dict[str, Study]] = {
    name: {study.name: study for study in module.STUDIES}
    for name, module in {
        "oscillator": oscillator, "minimal": minimal, "two-mass": two_mass, "nine-dof": nine_dof,
        "uncoupled-disc": uncoupled_disc,
    }.items()
}  # fmt: skip
