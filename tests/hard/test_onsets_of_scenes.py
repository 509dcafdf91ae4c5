"""Onsets of random small scenes of finite elements: every mode that is unstable at one of many values is explained."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

import fe_squeal
from fe_squeal.eigen.request import Request
from fe_squeal.eigen.solve import solve_modes
from meshes import STEEL

MODES = 14
# What is random, size of the elements, and how many values of the grid lie in each step of a sweep.
SEEDS = [(seed, 1.0, 4) for seed in range(2)] + [(4, 0.6, 3), (8, 0.6, 3), (9, 0.4, 2)]


def scene_of(seed, scale):
    """Return a scene with its parameter and values: a pad on a belt, or a disc with a pad.

    Its elements are larger by `scale`.
    """
    rng = np.random.default_rng(seed)

    def stiffness(low, high):
        return float(10 ** rng.uniform(low, high))

    disc = bool(rng.integers(2))
    if disc:
        geometry = {
            "inner_radius": 0.07, "outer_radius": 0.13, "thickness": 0.012, "pad_inner_radius": 0.085,
            "pad_outer_radius": 0.128, "pad_angle_deg": 50, "pad_thickness": 0.011, "size": 0.03 * scale, "pads": 1,
        }  # fmt: skip
        names, on = {"pad_1": "lining", "disc": "steel"}, ("pad_back_1", "pad_trailing_1", "pad_inner_edge_1")
        contact = {"surface": "pad_face_1", "counterface": "disc_face_1", "sliding": {"axis": [0, 0, 1], "speed": 3.0}}
        held = "hub"
    else:
        geometry = {"length": 0.08, "width": 0.04, "height": 0.015, "size": 0.02 * scale, "belt_thickness": 0.012}
        names, on = {"block": "lining", "belt": "steel"}, ("top", "right", "front")
        contact = {"surface": "bottom", "counterface": "belt_top", "sliding": {"direction": [1, 0.2, 0], "speed": 1.0}}
        held = "belt_bottom"
    lining = {"youngs_modulus": stiffness(8.5, 10.5), "poisson_ratio": 0.25, "density": 2600.0, "loss_factor": 0.01}
    directions = ([0, 0, 1], [0, 1, 0] if disc else [1, 0, 0], [1, 0, 0] if disc else [0, 1, 0])
    effects = {"friction": {"mu": float(rng.uniform(0.3, 0.8))}}
    damping = rng.choice(["", "rayleigh", "structural_damping"], p=[0.5, 0.25, 0.25])
    if damping:
        effects[damping] = {"alpha": stiffness(-1, 1), "beta": stiffness(-9, -7)} if damping == "rayleigh" else {}
    scene = {
        "mesh": {"order": 1, "disc_pad" if disc else "block": geometry},
        "materials": {"lining": lining, "steel": STEEL},
        "bodies": {body: {"material": material} for body, material in names.items()},
        "supports": [{"surface": held, "fixed": "xyz"}],
        "springs": [
            {"name": f"s{i}", "surface": s, "direction": d, "stiffness": stiffness(6, 8.5)}
            for i, (s, d) in enumerate(zip(on, directions, strict=True))
        ],
        "contacts": [{"name": "face", "normal_stiffness": stiffness(9.5, 11.5), **contact}],
        "effects": effects,
    }
    parameter, values = [
        ("mu", np.linspace(0.0, 0.9, 7)),
        ("contacts.face.normal_stiffness", np.geomspace(1e9, 1e12, 10)),
        ("springs.s1.stiffness", np.geomspace(1e6, 1e9, 7)),
    ][int(rng.integers(3))]
    return fe_squeal.assemble(fe_squeal.parse_scene(scene)), parameter, values


def unstable_at(problem, parameter, value):
    """Return the frequencies, Hz, of unstable modes, and that up to which modes are known."""
    modes = solve_modes(problem.pencil({parameter: float(value)}), Request(count=MODES + 4))
    return modes.frequency_hz[modes.stability == "unstable"], modes.frequency_hz.max()


def passed(result):
    """Return which frequencies (lowest, highest) unstable branches, and those with an onset, pass in each step."""
    spans = [(o.frequency_hz, o.frequency_hz) for o in result.onsets]
    for ends in itertools.pairwise(result.points):
        found = [dict(zip(p.branches.tolist(), p.modes.frequency_hz, strict=True)) for p in ends]
        named = {int(b) for p in ends for b in p.branches[p.modes.stability == "unstable"]}
        for o in result.onsets:
            if ends[0].value <= o.value <= ends[1].value:
                named |= {b for b in (o.branch_a, o.branch_b) if b is not None}
        own = [[f[b] for f in found if b in f] for b in named]
        spans += [(min(f), max(f)) for f in own if f]
    return spans


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "scale", "finer"), SEEDS)
def test_onsets_of_random_scenes(seed, scale, finer):
    """Up to a frequency that no unstable mode crosses, the number of unstable modes at any value is the first one and
    what the onsets before add; the sweep of the reduced model says the same. `finer` is how many values of a grid each
    step of the sweep has."""
    problem, parameter, values = scene_of(seed, scale)
    result = fe_squeal.sweep(problem, values, parameter, modes=MODES, method="direct")
    reduced = fe_squeal.sweep(problem, values, parameter, modes=MODES, method="reduced")
    between = np.linspace(0, 1, finer, endpoint=False)
    grid = np.append((values[:-1, None] + np.diff(values)[:, None] * between).ravel(), values[-1])
    found = [unstable_at(problem, parameter, p) for p in grid]
    known = min(min(top for _, top in found), min(p.modes.frequency_hz.max() for p in result.points))
    spans = [(f, f) for frequencies, _ in found for f in frequencies] + passed(result)
    limit = next(x for x in known * np.linspace(0.97, 0.1, 300) if all(x < 0.99 * a or x > 1.01 * b for a, b in spans))
    for listed in (result, reduced):
        onsets = [o for o in listed.onsets if o.frequency_hz < limit]
        for p, (frequencies, _) in zip(grid, found, strict=True):
            if any(abs(o.value - p) <= 2 * o.uncertainty for o in onsets):
                continue
            gained = sum(1 if o.direction == "into" else -1 for o in onsets if o.value < p)
            now, first = (int((f < limit).sum()) for f in (frequencies, found[0][0]))
            assert now == first + gained, (listed.method, parameter, p)
    here, there = ([o for o in r.onsets if o.frequency_hz < limit] for r in (result, reduced))
    assert [o.direction for o in here] == [o.direction for o in there]
    for o, other in zip(here, there, strict=True):
        assert abs(o.value - other.value) <= o.uncertainty + other.uncertainty + 1e-6 * o.value
