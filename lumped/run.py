"""Studies to files, and the plain numbers of a model at given parameters."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from .models import MODELS
from .parameters import read_settings, suggest
from .studies import STUDIES
from .study import Notes, Study


def run_study(model_name: str, study_name: str, out_dir: str | os.PathLike[str]) -> list[Path]:
    """Compute a study and write its table, figure and notes: `MODEL_STUDY.csv`, `.png` and `.md`.

    Parameters
    ----------
    model_name : str
        A key of `MODELS`.
    study_name : str
        A key of `STUDIES[model_name]`, or `all`.
    out_dir : path
        Made where it does not exist.

    Returns
    -------
    list of Path
        The files written.

    Raises
    ------
    ValueError
        The model or the study is unknown; the nearest one is suggested.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     [p.name for p in run_study("oscillator", "noise-map", folder)]
    ['oscillator_noise-map.csv', 'oscillator_noise-map.png', 'oscillator_noise-map.md']
    """
    _check_model(model_name)
    studies = STUDIES[model_name]
    if study_name != "all" and study_name not in studies:
        raise ValueError(f'{model_name}: no study "{study_name}"{suggest(study_name, [*studies, "all"])}')
    folder = Path(out_dir)
    folder.mkdir(parents=True, exist_ok=True)
    chosen = studies.values() if study_name == "all" else [studies[study_name]]
    return [path for study in chosen for path in _write_study(model_name, study, folder)]


def evaluate(model_name: str, settings: Mapping[str, str]) -> dict[str, Any]:
    """Return the eigenvalues and critical friction coefficients of a model at given parameters, ready for JSON.

    Parameters
    ----------
    model_name : str
        A key of `MODELS`.
    settings : mapping of str to str
        Parameters that differ from the defaults, `mu`, and `friction` (the reading of the friction force).

    Returns
    -------
    dict
        `eigenvalues`: [[Re, Im], ...], rad/s, ascending by Im λ; `critical_mu`: the μ > 0 at which a flutter begins;
        `critical_mu_complete`: `sure`, `what` was searched, and what is `open` because of rounding, in sentences; also
        `mu`, `uncertainty` (of each λ, rad/s) and `stability` (`unstable`, `marginal` or `stable`).

    Raises
    ------
    ValueError
        A name is unknown or a value is bad; the message says which and what is expected.

    Examples
    --------
    >>> result = evaluate("minimal", {"k2": "20", "mu": "0.4", "friction": "contact"})
    >>> [round(mu, 9) for mu in result["critical_mu"]], result["stability"]
    ([0.577350269], 'marginal')
    """
    _check_model(model_name)
    model_class = MODELS[model_name]
    values, mu = read_settings(model_name, model_class, settings, model_class.default_mu)
    model = model_class(**values)
    spectrum, found = model.spectrum(mu), model.search_critical_points()
    return {
        "eigenvalues": [[x.real, x.imag] for x in spectrum.lam.tolist()],
        "critical_mu": model.critical_mu(),
        "critical_mu_complete": found.completeness,
        "mu": mu,
        "uncertainty": spectrum.uncertainty.tolist(),
        "stability": spectrum.stability,
    }


def write_notes(title: str, section: str, notes: Notes) -> str:
    """Return the notes of a study as Markdown below a heading.

    Examples
    --------
    >>> print(write_notes("A study", "1.2.2", Notes("Two curves.", "Stay below.")))
    # A study
    <BLANKLINE>
    Section 1.2.2 of the source.
    <BLANKLINE>
    Two curves.
    <BLANKLINE>
    For the designer: Stay below.
    <BLANKLINE>
    """
    parts = [f"# {title}", f"Section {section} of the source.", notes.see, f"For the designer: {notes.follows}"]
    if notes.contradicts:
        parts.append(f"Contradicted by the source's own equations: {notes.contradicts}")
    return "\n\n".join(parts) + "\n"


def _check_model(name: str) -> None:
    if name not in MODELS:
        raise ValueError(f'no lumped model "{name}"{suggest(name, MODELS)}')


def _write_study(model_name: str, study: Study, folder: Path) -> list[Path]:
    from .figures import draw_study
    from .tables import write_csv

    result = study.compute()
    stem = f"{model_name}_{study.name}"
    table = write_csv(result, folder / f"{stem}.csv")
    figure = draw_study(result, study.title, folder / f"{stem}.png", study.spatial)
    text = folder / f"{stem}.md"
    text.write_text(write_notes(study.title, study.section, study.notes(result)), encoding="utf-8")
    return [table, figure, text]
