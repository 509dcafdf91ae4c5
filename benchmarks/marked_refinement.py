"""What marked refinement of tetrahedra gains: python benchmarks/marked_refinement.py [--help] [CASE ...]

It compares the frequencies of a body on meshes that are refined as a whole and on meshes that are refined where
stresses jump (the difference of stresses from continuous ones: O. C. Zienkiewicz, J. Z. Zhu, Int. J. Numer. Meth. Eng.
24, 1987). Each time the elements with half of the error are refined. True values are extrapolated from the last two
marked meshes, and their uncertainty is printed too. It prints unknowns, seconds, the mean relative error of the squares
of the lowest frequencies, and fitted rates.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
import skfem
from planes import on_plane

import fe_squeal
from fe_squeal.eigen.request import Request
from fe_squeal.eigen.solve import solve_modes
from fe_squeal.fem.materials import Elasticity, elasticity
from fe_squeal.fem.node_sums import scatter
from fe_squeal.fem.spaces import DisplacementSpace
from fe_squeal.fem.stress import element_stress
from fe_squeal.mesh import LoadedMesh, from_skfem
from fe_squeal.mesh.marked import refine_marked
from fe_squeal.mesh.marking import doerfler
from fe_squeal.mesh.refining import refine
from fe_squeal.problem.problem import Problem

STEEL = {"youngs_modulus": 2e11, "poisson_ratio": 0.3, "density": 7800.0}
MODES = 4
PART = 0.5  # of the whole error: the elements that are refined each time have so much of it together


def block(counts: tuple[int, int, int], size: tuple[float, float, float]) -> LoadedMesh:
    """Return a box of tetrahedra with its six sides."""
    axes = [np.linspace(0, s, n + 1) for s, n in zip(size, counts, strict=True)]
    mesh = skfem.MeshTet.init_tensor(*axes)
    ends = {"left": (0, 0.0), "right": (0, size[0]), "front": (1, 0.0), "back": (1, size[1]), "bottom": (2, 0.0),
            "top": (2, size[2])}  # fmt: skip
    sides = {name: on_plane(axis, at) for name, (axis, at) in ends.items()}
    return from_skfem(mesh.with_subdomains({"body": np.arange(mesh.nelements)}).with_boundaries(sides))


def half_ring(counts: tuple[int, int, int], inner: float, outer: float, height: float) -> LoadedMesh:
    """Return one half of an annular disc, of curved tetrahedra: (radial, around, through) cells of six each."""
    flat = block(counts, (outer - inner, np.pi, height)).mesh
    curved = skfem.MeshTet2.from_mesh(flat)
    r, angle, z = curved.doflocs + np.array([[inner], [0.0], [0.0]])
    x = np.stack([r * np.cos(angle), r * np.sin(angle), z])
    return from_skfem(replace(curved, doflocs=x, _subdomains=flat.subdomains, _boundaries=flat.boundaries))


def walls() -> list[dict[str, str]]:
    """Return supports that let all sides slide: modes are products of cosines, without singularities."""
    sides = {"x": ("left", "right"), "y": ("front", "back"), "z": ("bottom", "top")}
    return [{"surface": side, "fixed": along} for along, pair in sides.items() for side in pair]


CASES: dict[str, tuple[Callable[[], LoadedMesh], list[dict[str, str]]]] = {
    "clamped thick plate": (lambda: block((3, 3, 1), (1.0, 1.0, 0.3)), [{"surface": "left", "fixed": "xyz"}]),
    "half a disc, clamped inside": (
        lambda: half_ring((2, 6, 1), 0.5, 1.0, 0.1),
        [{"surface": "left", "fixed": "xyz"}, {"surface": "front", "fixed": "y"}, {"surface": "back", "fixed": "y"}],
    ),
    "block between walls": (lambda: block((2, 2, 2), (1.0, 0.83, 0.71)), walls()),
}


def problem_on(loaded: LoadedMesh, supports: list[dict[str, str]]) -> Problem:
    scene = {"mesh": {"file": "none.msh", "order": 2}, "materials": {"steel": STEEL},
             "bodies": {"body": {"material": "steel"}}, "supports": supports}  # fmt: skip
    return fe_squeal.assemble(fe_squeal.parse_scene(scene), loaded)


def stress_jumps(space: DisplacementSpace, law: Elasticity, u: np.ndarray) -> np.ndarray:
    """Return ∫|σ* − σ|² over each element (e,); σ* is the continuous stress of order 2 that is nearest to σ in L²."""
    blocks, nodes, loads = [], [], np.zeros((space.nodes, 9))
    parts = list(element_stress(space, np.arange(space.mesh.nelements), law, u))
    for shapes, stress in parts:
        weighted = shapes.values * shapes.dx[:, None]
        blocks.append(np.einsum("eiq,ejq->eij", weighted, shapes.values, optimize=True))
        nodes.append(shapes.nodes)
        work = np.einsum("eiq,eabq->eiab", weighted, stress, optimize=True)
        np.add.at(loads, shapes.nodes, work.reshape(*shapes.nodes.shape, 9))
    mass = scatter(np.concatenate(blocks), np.concatenate(nodes), space.nodes)
    scale = sp.diags_array(1 / mass.diagonal())
    smooth = np.stack([spla.cg(mass, b, rtol=1e-6, M=scale)[0] for b in loads.T], axis=1)
    found = []
    for shapes, stress in parts:
        there = np.einsum("ejk,ejq->ekq", smooth[shapes.nodes], shapes.values).reshape(stress.shape)
        found.append((((there - stress) ** 2).sum(axis=(1, 2)) * shapes.dx).sum(axis=1))
    return np.concatenate(found)


def solved(loaded: LoadedMesh, supports: list[dict[str, str]]) -> tuple[int, np.ndarray, np.ndarray]:
    """Return unknowns, the lowest θ = ω² and each element's share in their relative errors."""
    problem = problem_on(loaded, supports)
    modes = solve_modes(problem.pencil(), Request(count=MODES + 2))
    theta = np.abs(modes.lam[:MODES]) ** 2
    space = problem.discretisation.space  # type: ignore[union-attr]
    law = elasticity(problem.source.scene.materials["steel"])  # type: ignore[union-attr]
    shares = np.zeros(loaded.mesh.nelements)
    for i in range(MODES):
        u = np.real(modes.right[:, i])
        mass = u @ (problem.pencil().M @ u)
        shares += stress_jumps(space, law, u) / (theta[i] * mass)
    return problem.unknowns, theta, shares


def where_stresses_jump(loaded: LoadedMesh, shares: np.ndarray, halvings: int = 3) -> LoadedMesh:
    return refine_marked(loaded, doerfler(shares, PART), halvings)[0]


def refined(
    make: Callable[[], LoadedMesh], supports: list[dict[str, str]], steps: int,
    how: Callable[[LoadedMesh, np.ndarray], LoadedMesh],
) -> Iterator[tuple[int, float, np.ndarray]]:  # fmt: skip
    """Yield, for each mesh of a sequence, its unknowns, the seconds since the beginning, and the lowest θ."""
    loaded, begun = make(), time.perf_counter()
    for step in range(steps):
        unknowns, theta, shares = solved(loaded, supports)
        yield unknowns, time.perf_counter() - begun, theta
        if step + 1 < steps:
            loaded = how(loaded, shares)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=8)
    parser.add_argument("--halvings", type=int, default=3, help="of a marked element in a round")
    parser.add_argument("--levels", type=int, default=3)
    parser.add_argument("cases", nargs="*", default=list(CASES))
    given = parser.parse_args()
    for name in given.cases:
        rows = {
            "as a whole": list(refined(*CASES[name], given.levels, lambda loaded, shares: refine(loaded))),
            "marked": list(refined(*CASES[name], given.rounds, partial(where_stresses_jump, halvings=given.halvings))),
        }
        (n, _, last), (m, _, before) = rows["marked"][-1], rows["marked"][-2]
        rate = 4 / 3  # power of the unknowns by which errors of smooth modes fall
        true = last - (before - last) / ((n / m) ** rate - 1)
        print(f"\n{name}: lowest ω²; reference surer than {np.mean(np.abs(last / true - 1)):.1e}")
        for how, found in rows.items():
            errors = np.array([np.mean(theta / true - 1) for _, _, theta in found])
            for (unknowns, seconds, _), error in zip(found, errors, strict=True):
                print(f"  {how:<11} {unknowns:>8} unknowns {seconds:7.1f} s  {error:.2e}")
            some = slice(len(found) // 3, len(found) if how == "as a whole" else -2)
            slope = -np.polyfit(np.log([n for n, *_ in found[some]]), np.log(np.abs(errors[some])), 1)[0]
            print(f"  {how:<11} error ~ unknowns^-{slope:.2f}")


if __name__ == "__main__":
    main()
