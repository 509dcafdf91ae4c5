"""Exact frequencies of elastic solids in three dimensions, without a plate or beam theory."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import count as count_up
from itertools import product

import numpy as np
from scipy.optimize import brentq

from fe_squeal.geometry import Block
from fe_squeal.scene import Scene

_SLIDING = {"left": "x", "right": "x", "front": "y", "back": "y", "bottom": "z", "top": "z"}
_SLIDING_EDGES = {"left": "yz", "right": "yz", "front": "xz", "back": "xz"}


def exact_frequencies(scene: Scene, count: int) -> np.ndarray | None:
    """Return the lowest exact frequencies (at most `count`), Hz, of a block or a square plate on sliding supports.

    For the plate there are no more than `sliding_plate` returns. For any other scene the result is None.
    """
    block, material = scene.mesh.geometry, next(iter(scene.materials.values()))
    if len(scene.bodies) == 1:
        material = scene.materials[next(iter(scene.bodies.values())).material]
    others = scene.contacts or scene.springs or scene.effect_names or scene.sweep
    if others or not isinstance(block, Block) or block.count > 1 or block.belt_thickness:
        return None
    E, nu = material.youngs_modulus, material.poisson_ratio
    if isinstance(E, list) or isinstance(nu, list):
        return None
    held: dict[str, str] = {}
    for support in scene.supports:
        held[support.surface] = "".join(sorted({*held.get(support.surface, ""), *support.fixed}))
    size = np.array([block.length, block.width, block.height]) * scene.mesh.scale
    speeds = wave_speeds(E, nu, material.density)
    if held == _SLIDING:
        return sliding_block(size.tolist(), speeds, count)
    if held == _SLIDING_EDGES and size[0] == size[1]:
        return sliding_plate(size[0], size[2], speeds, 0.999 * speeds[1] / (2 * size[2]))[:count]
    return None


def wave_speeds(youngs_modulus: float, poisson_ratio: float, density: float) -> tuple[float, float]:
    """Return the speeds of pressure and shear waves, m/s."""
    shear = np.sqrt(youngs_modulus / (2 * (1 + poisson_ratio)) / density)
    return float(shear * np.sqrt((2 - 2 * poisson_ratio) / (1 - 2 * poisson_ratio))), float(shear)


def sliding_block(size: Sequence[float], speeds: tuple[float, float], count: int) -> np.ndarray:
    """Return the lowest frequencies (count,), Hz, of a block with u·n = 0 and no shear stress on all faces.

    u_i = A_i sin(k_i x_i) Π_{j≠i} cos(k_j x_j), k = π(l/Lx, m/Ly, n/Lz), satisfies both conditions. A ∥ k gives one
    pressure wave with ω = c_p|k|, and A ⊥ k shear waves with ω = c_s|k|. Where k_i = 0 there is no u_i, so that z
    non-zero components of k give z − 1 shear waves.

    Examples
    --------
    >>> sliding_block((1.0, 1.0, 1.0), (2.0, 1.0), 3)  # three shear waves with two half-waves across
    array([0.70710678, 0.70710678, 0.70710678])
    """
    sides, limit = np.asarray(size, float), speeds[1] * np.pi / max(size)
    while True:
        found = []
        for lmn in product(*(range(int(limit * side / speeds[1] / np.pi) + 1) for side in sides)):
            k = np.pi * np.linalg.norm(np.array(lmn) / sides)
            found += [speeds[0] * k] * bool(k > 0) + [speeds[1] * k] * (np.count_nonzero(lmn) - 1)
        below = np.sort(found)
        if np.count_nonzero(below < limit) >= count:
            return np.asarray(below[:count] / (2 * np.pi))
        limit *= 1.5


def lamb(omega: float, k: float, thickness: float, speeds: tuple[float, float], antisymmetric: bool) -> float:
    """Return the Rayleigh–Lamb function, which is zero if ω and the wave number k are those of a wave in a plate.

    The equation is tan(qd)/tan(pd) = −((k² − q²)²/(4k²pq))^±1 with d = h/2, p² = ω²/c_p² − k², q² = ω²/c_s² − k²
    (K. F. Graff, Wave Motion in Elastic Solids, eq. 8.1.63 and 8.1.64). Multiplied out and divided by p or q it has
    neither poles nor trivial roots, and is real and even in p and q.
    """
    p, q = (np.sqrt(complex(omega**2 / c**2 - k**2)) for c in speeds)
    d = thickness / 2
    if antisymmetric:
        value = 4 * k**2 * q * np.sin(q * d) * np.cos(p * d) + (k**2 - q**2) ** 2 * np.sin(p * d) / p * np.cos(q * d)
    else:
        value = (k**2 - q**2) ** 2 * np.sin(q * d) / q * np.cos(p * d) + 4 * k**2 * p * np.sin(p * d) * np.cos(q * d)
    return float(value.real)


def sliding_plate(side: float, thickness: float, speeds: tuple[float, float], up_to_hz: float) -> np.ndarray:
    """Return all frequencies up to a limit, Hz, of a square plate with free faces; its edges slide along normals.

    At the edges u_z and the other tangential displacement are zero. Lamb waves with k = π√(m² + n²)/a, m, n ≥ 1,
    satisfy this exactly, and so do SH waves with ω = c_s k, also for m = 0 or n = 0. SH waves with nodes across the
    thickness, from ω = c_s π/h on, are not included, and so the limit has to be below c_s/(2h).
    """
    if 2 * np.pi * up_to_hz >= speeds[1] * np.pi / thickness:
        raise ValueError(f"up_to_hz = {up_to_hz:g}: expected less than {speeds[1] / (2 * thickness):g}")
    grid = 2 * np.pi * np.linspace(up_to_hz / 460, up_to_hz, 461)
    found: list[float] = []
    m, last = 0, -1
    while m < 2 or len(found) > last:
        last = len(found)
        for n in count_up():
            k, waves = np.pi * np.hypot(m, n) / side, []
            waves += [speeds[1] * k] if 0 < speeds[1] * k < grid[-1] else []
            for antisymmetric in (True, False) if m and n else ():
                rest = (k, thickness, speeds, antisymmetric)
                values = np.array([lamb(w, *rest) for w in grid])
                for i in np.flatnonzero(values[1:] * values[:-1] < 0):
                    waves.append(brentq(lamb, grid[i], grid[i + 1], args=rest, xtol=1e-9))
            found += waves
            if n and not waves:  # with more half-waves frequencies are higher
                break
        m += 1
    return np.sort(found) / (2 * np.pi)
