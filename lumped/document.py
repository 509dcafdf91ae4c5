"""The page docs/lumped.md: every study with its figure and what it says. `python -m lumped.document docs`."""

from __future__ import annotations

import os
import sys
from dataclasses import fields
from pathlib import Path

from .figures import draw_study
from .models import MODELS, Minimal, NineDof, Oscillator, TwoMass
from .models.uncoupled_disc import RigidPad
from .studies import STUDIES
from .study import Study

_DPI = 80
_HEADINGS = {
    "oscillator": "The friction oscillator",
    "minimal": "The minimal model",
    "two-mass": "The two-mass model",
    "nine-dof": "The nine-degree-of-freedom model",
    "uncoupled-disc": "The disc without diagonal springs",
}

_INTRODUCTION = """# The lumped models

Small systems of rigid masses and springs on a moving belt. They are the references for the finite-element solver: their
eigenvalues and critical friction coefficients are known to machine precision, most of them in closed form. The studies
are those of a course text on models of brake noise (Y. Kim, U. A. Özkasap and others; supervisor M. Sailer), here
called the source, which builds on Hoffmann, Fischer, Allgaier and Gaul (Mech. Res. Commun. 29, 2002). This page is
written by `python -m lumped.document docs`; nearly every number on it is computed when it is written.

All models are (λ² M + λ C + K(μ)) u = 0 with K(μ) = K0 + μ F; x points along the belt's velocity, y out of the belt. A
spring at the angle θ acts along (sin θ, −cos θ), except in the two-mass model, whose angle is counted from the belt:
(cos θ, −sin θ). The numbers are small (stiffnesses near 10 N/m), so frequencies are given in rad/s.

## How friction follows the normal force

| `friction=` | the friction force is μ times | for |
|---|---|---|
| `printed` | all stiffness that opposes the normal motion | the matrices as the source prints them; the default |
| `contact` | the force of the contact spring alone | virtual work; what a finite-element contact does |
| `full` | the whole equation of the normal motion | the reaction of the belt, whatever carries it |

Friction follows the springs only, not the dampers. The nine-degree-of-freedom model and the uncoupled disc know
`contact` only.

## On the command line

`fe-squeal lumped minimal k2=20 friction=contact` sets parameters by their names and prints eigenvalues and critical
friction coefficients; `--json` prints them for other programs. A study (`--study NAME`) has parameters of its own and
takes neither.

## Marginal is not unstable

Where two frequencies are equal, λ changes like the square root of a perturbation: rounding of 1e-15 in a matrix
gives growth rates of 1e-8 that mean nothing. Each λ therefore carries an uncertainty, the change it suffers when the
entries of the matrix are perturbed by rounding, and a system is called unstable only if a growth rate exceeds it. The
base values of the minimal model are such a case.

## Critical friction coefficients

"""

_CLOSING = """## Where the source contradicts its own equations

Collected from the studies above.

"""


def write_document(folder: str | os.PathLike[str]) -> list[Path]:
    """Write `lumped.md` and the figures `lumped/*.png` into a folder.

    Returns
    -------
    list of Path
        The page, then the figures.
    """
    page = Path(folder) / "lumped.md"
    pictures = page.with_suffix("")
    pictures.mkdir(parents=True, exist_ok=True)
    parts, files, contradictions = [_INTRODUCTION + _critical_table()], [], []
    for model_name in MODELS:
        parts.append(f"## {_HEADINGS[model_name]}\n\n{_describe(model_name)}")
        for study in STUDIES[model_name].values():
            picture = pictures / f"{model_name}_{study.name}.png"
            text, contradiction = _write_part(model_name, study, picture)
            parts.append(text)
            files.append(picture)
            if contradiction:
                contradictions.append(f"- {model_name}, {study.title} (section {study.section}): {contradiction}")
    parts.append(_CLOSING + "\n".join(contradictions))
    page.write_text("\n\n".join(part.strip() for part in parts) + "\n", encoding="utf-8")
    return [page, *files]


def _write_part(model_name: str, study: Study, picture: Path) -> tuple[str, str]:
    result = study.compute()
    draw_study(result, study.title, picture, study.spatial, dpi=_DPI)
    notes = study.notes(result)
    lines = [
        f"### {study.title[0].upper()}{study.title[1:]}",
        f"`fe-squeal lumped {model_name} --study {study.name}` (section {study.section} of the source)",
        f"![{study.title}](lumped/{picture.name})",
        notes.see,
        f"**For the designer:** {notes.follows}",
    ]
    if notes.contradicts:
        lines.append(f"**Contradicted by the equations:** {notes.contradicts}")
    return "\n\n".join(lines), notes.contradicts


def _describe(model_name: str) -> str:
    """Return the first words on a model and the list of its parameters, from the class itself."""
    cls = MODELS[model_name]
    text = " ".join((cls.__doc__ or "").split("Examples")[0].split())
    numbers = [f for f in fields(cls) if "bound" in f.metadata]
    names = ", ".join(f"`{f.name}` = {f.default:g} {f.metadata['unit']}" for f in numbers)
    return f"{text}\n\nParameters: {names}."


def _critical_table() -> str:
    rows = ["| model | printed | contact | full |", "|---|---|---|---|"]
    for label, cls, values in (
        ("oscillator", Oscillator, {}), ("minimal, k2 = 20 N/m", Minimal, {"k2": 20.0}), ("two-mass", TwoMass, {}),
    ):  # fmt: skip
        mu = (cls(**values, friction=f).critical_mu()[0] for f in ("printed", "contact", "full"))
        rows.append(f"| {label} | " + " | ".join(f"{value:.12f}" for value in mu) + " |")
    nine = ", ".join(f"{o.mu:.12f}" for o in NineDof().critical_points(0, 4))
    rows.append(f"| nine-dof | | {nine} | |")
    rows.append("| uncoupled-disc | | none | |")
    rows.append(f"| rigid pad (counter-example) | | {RigidPad().critical_mu()[0]:.12f} | |")
    rows.append("| minimal, base values | none | none | none |")
    return "\n".join(rows)


if __name__ == "__main__":
    for path in write_document(sys.argv[1] if len(sys.argv) > 1 else "docs"):
        print(path)
