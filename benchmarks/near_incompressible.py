"""Locking of elements, and the mixed formulation: python benchmarks/near_incompressible.py [--write]

It measures the errors of the lowest frequencies over Poisson's ratio, in the standard and the mixed formulation, with
orders 1 and 2, hexahedra and tetrahedra. One problem is a block between smooth walls, whose modes are known, the other
one a lining that is clamped at one end, compared with an extrapolated reference. With `--write` the results are written
to docs/near_incompressible.md and docs/images/near_incompressible.png. It takes some minutes and 3 GiB.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path

import numpy as np
import skfem
from planes import on_plane

import fe_squeal
from fe_squeal.eigen.request import Request
from fe_squeal.eigen.solve import solve_modes

ROOT = Path(__file__).parents[1]
RATIOS = (0.3, 0.45, 0.49, 0.499, 0.4999, 0.49999)
MODES = 6
MODULUS, DENSITY = 2.0e8, 2000.0  # Pa, kg/m^3: a soft lining
WALLS, PAD = (0.1, 0.083, 0.071), (0.1, 0.05, 0.025)  # m
FINEST = 32  # elements along the pad in the reference
Counts = tuple[int, int, int]
SIDES = {"left": (0, 0), "right": (0, 1), "front": (1, 0), "back": (1, 1), "bottom": (2, 0), "top": (2, 1)}


@dataclass
class Row:
    """One kind of element: its unknowns and the largest relative error of a frequency at each Poisson's ratio."""

    kind: str
    order: int
    formulation: str
    unknowns: int = 0
    entries: int = 0
    errors: list[float] = field(default_factory=list)


def frequencies(
    kind: str, counts: Counts, size: Sequence[float], order: int, formulation: str, nu: float, held: dict[str, str]
) -> tuple[np.ndarray, int, int]:
    """Return the lowest frequencies in Hz of a block with held sides, its unknowns and the entries of K."""
    axes = [np.linspace(0, s, n + 1) for s, n in zip(size, counts, strict=True)]
    mesh = (skfem.MeshHex if kind == "hexahedra" else skfem.MeshTet).init_tensor(*axes)
    sides = {name: on_plane(axis, end * size[axis]) for name, (axis, end) in SIDES.items()}
    mesh = mesh.with_subdomains({"lining": np.arange(mesh.nelements)}).with_boundaries(sides)
    scene = fe_squeal.parse_scene({
        "mesh": {"file": "none.msh", "order": order},
        "materials": {"lining": {"youngs_modulus": MODULUS, "poisson_ratio": nu, "density": DENSITY}},
        "bodies": {"lining": {"material": "lining", "formulation": formulation}},
        "supports": [{"surface": s, "fixed": c} for s, c in held.items()],
    })  # fmt: skip
    problem = fe_squeal.assemble(scene, fe_squeal.from_skfem(mesh))
    pencil = problem.pencil()
    return solve_modes(pencil, Request(count=MODES)).frequency_hz[:MODES], problem.unknowns, pencil.K.nnz


def between_walls(nu: float) -> np.ndarray:
    """Return the exact lowest frequencies, Hz, of the block whose faces slide along smooth walls.

    Modes are u_i = A_i sin(k_i x_i) Π_{j≠i} cos(k_j x_j), k = π(l/Lx, m/Ly, n/Lz): pressure waves with A ∥ k, and shear
    waves with A ⊥ k.
    """
    shear = np.sqrt(MODULUS / (2 * (1 + nu)) / DENSITY)
    pressure = shear * np.sqrt((2 - 2 * nu) / (1 - 2 * nu))
    found: list[float] = []
    for lmn in product(range(5), repeat=3):
        k = np.linalg.norm(np.array(lmn) / np.array(WALLS)) / 2
        found += [pressure * k] * bool(k > 0) + [shear * k] * (np.count_nonzero(lmn) - 1)
    return np.sort(found)[:MODES]


def clamped_reference(nu: float, finest: int = FINEST) -> tuple[np.ndarray, float]:
    """Return extrapolated frequencies, Hz, of the clamped lining, and the largest relative change by the extrapolation.

    They come from mixed hexahedra of order 2 on three meshes. Because of singular clamped edges the rate is not four.
    """
    a, b, c = (
        frequencies("hexahedra", (n, n // 2, n // 4), PAD, 2, "mixed", nu, {"left": "xyz"})[0]
        for n in (finest // 4, finest // 2, finest)
    )
    found = c - (b - c) ** 2 / ((a - b) - (b - c))  # Aitken's formula, which does not need the rate
    return found, float(np.abs(c / found - 1).max())


def measure(
    size: Sequence[float], counts: dict[int, Counts], held: dict[str, str], exact: Callable[[float], np.ndarray],
    ratios: Sequence[float],
) -> list[Row]:  # fmt: skip
    """Return a row for each kind, order and formulation."""
    rows = [
        Row(kind, order, formulation)
        for kind in ("hexahedra", "tetrahedra") for order in (1, 2) for formulation in ("standard", "mixed")
    ]  # fmt: skip
    for nu in ratios:
        known = exact(nu)
        for row in rows:
            found, row.unknowns, row.entries = frequencies(
                row.kind, counts[row.order], size, row.order, row.formulation, nu, held
            )
            row.errors.append(float(np.abs(found / known - 1).max()))
    return rows


def table(rows: Sequence[Row], ratios: Sequence[float]) -> str:
    """Return rows as Markdown; errors in per cent."""
    head = ["elements", "order", "formulation", "unknowns", "entries of K", *(f"ν = {nu:g}" for nu in ratios)]
    lines = [head, ["---"] * len(head)]
    for r in rows:
        errors = [f"{100 * e:.2g} %" if e < 0.995 else f"× {1 + e:.2g}" for e in r.errors]
        lines.append([r.kind, str(r.order), r.formulation, str(r.unknowns), str(r.entries), *errors])
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def chart(panels: dict[str, Sequence[Row]], ratios: Sequence[float], path: Path) -> None:
    """Draw the errors over 1 − 2ν, a panel for each problem."""
    import matplotlib.pyplot as plt

    plt.switch_backend("Agg")
    figure, axes = plt.subplots(1, len(panels), figsize=(11.0, 5.0), sharey=True, layout="constrained", squeeze=False)
    colours = {("hexahedra", 1): "#e08a1e", ("hexahedra", 2): "#b3341f", ("tetrahedra", 1): "#5aa4d6",
               ("tetrahedra", 2): "#1f4e8c"}  # fmt: skip
    for ax, (title, rows) in zip(axes[0], panels.items(), strict=True):
        for r in rows:
            mixed = r.formulation == "mixed"
            ax.loglog(
                1 - 2 * np.array(ratios), r.errors, color=colours[r.kind, r.order], marker="o" if mixed else "x",
                linestyle="-" if mixed else "--", label=f"{r.kind}, order {r.order}, {r.formulation}",
            )  # fmt: skip
        ax.invert_xaxis()
        ax.set_xticks(1 - 2 * np.array(ratios), [f"{nu:g}" for nu in ratios], fontsize=8)
        ax.minorticks_off()
        ax.set_xlabel("Poisson's ratio ν (scale: 1 − 2ν)")
        ax.set_title(title, fontsize=11)
        ax.grid(alpha=0.3)
    axes[0][0].set_ylabel(f"largest relative error of the {MODES} lowest frequencies")
    handles, labels = axes[0][0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncol=4, fontsize=8, frameon=False)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
    plt.close(figure)


PAGE = """# Nearly incompressible linings

![Errors of frequencies over Poisson's ratio](images/near_incompressible.png)

As Poisson's ratio ν tends to ½, a material resists every change of volume. Standard elements of order 1 can then hardly
move at all, and those of order 2 lose accuracy: they *lock*, and frequencies come out too high without any other sign.
`fe-squeal` warns where a standard body has ν > 0.48. The way out is one key of the body:

```toml
[bodies.pad]
material = "lining"
formulation = "mixed"
```

## What it does

Stress is σ = 2με(u) + p 1 with a pressure p of its own, p/λ = div u weakly, λ = Eν/((1 + ν)(1 − 2ν)). Pressures are
discontinuous between elements and of the displacements' order less one: constant for order 1, linear in x, y, z for
order 2. So they are eliminated in each element, exactly, and leave the stiffness

    ∫ 2μ ε(δu):ε(u) + λ ∫ Π(div δu) Π(div u),    Π the projection on the pressures,

symmetric, positive semidefinite, in displacements alone. Contacts, damping, preload, sweeps and the solvers need to
know nothing of it.

The pair must be stable (inf-sup condition), or errors come back as the mesh is refined. For this, elements inside a
mixed body have more displacements than those of their nodes:

| elements | order | displacements | pressure |
|---|---|---|---|
| hexahedra | 1 | trilinear + a bubble along the normal of each face between elements | constant |
| tetrahedra | 1 | linear + the same | constant |
| hexahedra | 2 | triquadratic (27 nodes), nothing more | linear |
| tetrahedra | 2 | quadratic + the same + three bubbles in each cell | linear |

Bubbles vanish at nodes and on the body's surface, so contacts, supports, springs and exported shapes are those of the
nodes. They are unknowns like others: *unknowns* and *entries of K* below are what they cost. Hexahedra of order 2 cost
nothing more, and are what to take. Wedges and mixed meshes are split into tetrahedra before. (Bernardi and Raugel,
Math. Comp. 44, 1985; Girault and Raviart, Finite Element Methods for Navier–Stokes Equations, 1986; Boffi, Brezzi and
Fortin, Mixed Finite Element Methods and Applications, 2013, chapter 8.)

It holds for isotropic materials with −1 < ν < ½, and for bodies that do not rotate; otherwise it is refused with a
message. ν = ½ itself would need pressures as unknowns; 0.4999 is as good, see the columns. At ν = 0.3 it is no worse
than the standard form. Rayleigh and structural damping act on the mixed stiffness; stress stiffening and the von Mises
stress of a preload take the stress with p; E may be swept as ever, and ν at the price of an assembly for each value.

"""


def page(
    walls: Sequence[Row], clamped: Sequence[Row], ratios: Sequence[float], order: dict[int, Counts], moved: float
) -> str:  # fmt: skip
    """Return the page."""
    grid = {o: "×".join(map(str, n)) for o, n in order.items()}
    finest, step = f"{FINEST}×{FINEST // 2}×{FINEST // 4}", f"{100 * moved:.1g} %"
    return f"""{PAGE}## A block between smooth walls

Faces that slide without friction, u·n = 0: exact modes in three dimensions. From ν = 0.45 on all of the lowest are
shear waves, which do not depend on λ; at 0.3 one is a pressure wave, and the sixth is a longer one than later. The
block of {WALLS[0]} × {WALLS[1]} × {WALLS[2]} m has 8 × 8 × 8 cells for order 1 and 4 × 4 × 4 for order 2, the same
nodes; tetrahedra are a sixth of such a cell each. The largest relative error among the {MODES} lowest frequencies;
"× 3" is a frequency three times too high.

{table(walls, ratios)}
## A lining clamped at one end

{PAD[0]} × {PAD[1]} × {PAD[2]} m, clamped on its smallest side: bending, torsion and shear, with singular edges at the
clamp, {grid[1]} cells for order 1 and {grid[2]} for order 2. The reference is extrapolated from mixed hexahedra of
order 2 on meshes up to {finest}; its last step, {step} at most, says how well it is known.

{table(clamped, ratios)}
Made by `python benchmarks/near_incompressible.py --write`, {time.strftime("%Y-%m-%d")}.
"""


def main() -> None:
    """Print the tables, or write the page."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--write", action="store_true", help="write docs/near_incompressible.md and its picture")
    given = parser.parse_args()
    smooth = {s: "xyz"[axis] for s, (axis, _) in SIDES.items()}
    walls = measure(WALLS, {1: (8, 8, 8), 2: (4, 4, 4)}, smooth, between_walls, RATIOS)
    print(table(walls, RATIOS), flush=True)
    counts: dict[int, Counts] = {1: (16, 8, 4), 2: (8, 4, 2)}
    references = {nu: clamped_reference(nu) for nu in RATIOS}
    moved = max(step for _, step in references.values())
    clamped = measure(PAD, counts, {"left": "xyz"}, lambda nu: references[nu][0], RATIOS)
    print(table(clamped, RATIOS), f"\nlast step of the reference: {moved:.2g}", flush=True)
    if given.write:
        panels = {"Block between smooth walls": walls, "Lining clamped at one end": clamped}
        chart(panels, RATIOS, ROOT / "docs/images/near_incompressible.png")
        (ROOT / "docs/near_incompressible.md").write_text(page(walls, clamped, RATIOS, counts, moved), encoding="utf-8")


if __name__ == "__main__":
    main()
