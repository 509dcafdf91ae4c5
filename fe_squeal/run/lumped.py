"""What `fe-squeal lumped --study` writes."""

from __future__ import annotations

import os
from pathlib import Path

import lumped

from ..report.files import replace_atomically
from .folder import hold_folder


def study_model(model: str, study: str, out: Path) -> list[Path]:
    """Compute a study of a lumped model, or all of them; return the files written, as `lumped.run_study` names them.

    Raises
    ------
    ValueError
        The model or the study is unknown.
    OutputError
        The folder cannot be used, or a file cannot be written.
    """
    with hold_folder(out) as held:
        written = lumped.run_study(model, study, held.scratch())
        for path in written:
            with replace_atomically(out / path.name) as temporary:
                os.replace(path, temporary)
    return [out / path.name for path in written]
