"""Inertia at a reference point that a rotating body is tied to, and damping of bodies that rotate."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fe_squeal.errors import SceneError
from fe_squeal.fem.element_matrices import element_shapes
from meshes import STEEL, annulus, join, make_problem, modes_of

SPEED, TILT = 300.0, 4e4  # rad/s; N m/rad of the two springs that hold the rotor


def about_z(*bodies, speed):
    return {"bodies": list(bodies), "axis": [0, 0, 1], "centre": [0, 0, 0], "speed": speed}


def rotor(part, speed=SPEED, mass=0.0, inertia=None, at=(0.0, 0.0, 0.01), ties="rigid"):
    """A stiff ring of `part` of the density of steel, tied to a reference that tilts against two springs."""
    springs = [{"axis": list(e), "stiffness": TILT} for e in np.eye(3)[:2]]
    tie = {"name": "wheel", "surface": "hub", "reference": list(at), "springs": springs, "fixed": "xyz rz"}
    tie["mass"] = mass
    if inertia is not None:
        tie["inertia"] = list(inertia)
    steel = {**STEEL, "youngs_modulus": 2e12, "density": part * STEEL["density"]}
    effects = {"rotation": about_z("disc", speed=speed)} if speed else {}
    mesh = annulus("hex2", (1, 12, 1), 0.06, 0.10, 0.02)
    return make_problem(mesh, materials={"steel": steel}, effects=effects, **{ties: [tie]})


def moments(problem):
    """Mass, polar moment, and moment across the axis about (0, 0, 0.01), of the ring at full density."""
    numbers = np.zeros(3)
    for shapes in element_shapes(problem.discretisation.space, problem.discretisation.bodies["disc"]):
        x, y, z = (shapes.points[:, i] for i in range(3))
        w = STEEL["density"] * shapes.dx
        numbers += [w.sum(), ((x**2 + y**2) * w).sum(), ((y**2 + (z - 0.01) ** 2) * w).sum()]
    return numbers


@pytest.mark.parametrize("ties", ["rigid", "averaged"])
def test_a_rotor_whose_inertia_is_at_its_reference_precesses_like_one_of_elements(ties):
    """I_d ω² ∓ I_p Ω ω − k = 0 of a rigid rotor on two springs."""
    mass, polar, across = moments(rotor(1.0, 0.0))
    exact = np.array([(s * polar * SPEED + np.sqrt((polar * SPEED) ** 2 + 4 * across * TILT)) / (2 * across)
                      for s in (-1, 1)])  # fmt: skip
    six = [0.9 * across, 0.9 * across, 0.9 * polar, 0.0, 0.0, 0.0]
    of_elements = modes_of(rotor(1.0, ties=ties), 2).lam.imag
    with_reference = modes_of(rotor(0.1, mass=0.9 * mass, inertia=six, ties=ties), 2).lam.imag
    assert exact[1] / exact[0] > 1.3  # the gyroscopic moment is not small
    np.testing.assert_allclose(of_elements, exact, rtol=0.02)  # convected inertia without the centrifugal stress
    np.testing.assert_allclose(with_reference, exact, rtol=0.002)


def test_the_gyroscopic_moment_turns_with_its_axis():
    six = [1e-3, 1e-3, 2e-3, 0.0, 0.0, 0.0]
    one, other = (rotor(1.0, SPEED * s, inertia=six) for s in (1, -1))
    (A,), (B,) = ([t for t in p.terms if t.name == "gyroscopic.wheel"] for p in (one, other))
    assert A.skew and abs(A.matrix + B.matrix).max() < 1e-15 and abs(A.matrix + A.matrix.T).max() == 0
    assert abs(A.matrix).max() > 0


@pytest.mark.parametrize(
    ("more", "said"),
    [({"inertia": [1.0, 2.0, 2.5, 0, 0, 0]}, "its inertia is not the same all around the axis"),
     ({"mass": 1.0, "at": (0.01, 0.0, 0.0)}, "lies 0.01 m beside the axis")],
)  # fmt: skip
def test_what_changes_as_the_body_turns_is_refused(more, said):
    with pytest.raises(SceneError, match=said):
        rotor(1.0, **more)


def disc(**tables):
    mesh = annulus("hex2", (1, 16, 1), 0.06, 0.10, 0.01)
    return make_problem(mesh, supports=[{"surface": "hub", "fixed": "xyz"}], **tables)


def test_frozen_structural_damping_of_a_rotating_body_is_its_rayleigh_damping():
    """Both are C = βK in the body, so that both bring the same circulatory stiffness."""
    beta, hz = 2e-7, 1500.0
    rotation = about_z("disc", speed=900.0)
    lossy = {**STEEL, "loss_factor": beta * 2 * np.pi * hz}
    structural = {"reference_frequency_hz": hz}
    frozen = disc(materials={"steel": lossy}, effects={"rotation": rotation, "structural_damping": structural})
    rayleigh = disc(effects={"rotation": rotation, "rayleigh": {"beta": beta}})
    one, other = (modes_of(p, 6).lam for p in (frozen, rayleigh))
    np.testing.assert_allclose(one, other, rtol=1e-9)
    assert np.ptp(other.real / other.imag**2) > 0.05 * np.abs(other.real / other.imag**2).max()  # not βω²/2 alone


def test_a_body_that_is_glued_to_one_that_rotates_is_told():
    sizes = {"a": (0.06, 0.08), "b": (0.08, 0.10)}
    rings = join(*(annulus("hex2", (1, 12, 1), *radii, 0.01, name=name) for name, radii in sizes.items()))
    tied = {"name": "c", "surface": "rim_a", "counterface": "hub_b", "normal_stiffness": 1e14, "kind": "tied"}

    def told(bodies):
        supports, effects = [{"surface": "hub_a", "fixed": "xyz"}], {"rotation": about_z(*bodies, speed=10.0)}
        problem = make_problem(rings, supports=supports, contacts=[tied], effects=effects)
        return [w for w in problem.discretisation.warnings if "which does not" in w]

    assert told(["a", "b"]) == []
    (sentence,) = told(["a"])
    assert "body a rotates and is tied to body b by contact c" in sentence


def test_the_inertia_at_a_reference_turns_once_however_many_bodies_it_holds():
    """A wheel of two bodies that share nodes, and the same wheel as one body."""
    mesh = annulus("hex2", (1, 12, 2), 0.06, 0.10, 0.02)
    height = mesh.p[2][mesh.t].mean(axis=0)
    halves = {"a": np.flatnonzero(height < 0.01), "b": np.flatnonzero(height > 0.01)}
    tie = {"name": "wheel", "surface": "hub", "reference": [0.0, 0.0, 0.01], "fixed": "xyz rz",
           "inertia": [1e-3, 1e-3, 2e-3, 0.0, 0.0, 0.0],
           "springs": [{"axis": list(e), "stiffness": TILT} for e in np.eye(3)[:2]]}  # fmt: skip
    one, two = (
        make_problem(replace(mesh, _subdomains=parts), rigid=[tie], effects={"rotation": about_z(*parts, speed=SPEED)})
        for parts in ({"a": np.arange(mesh.nelements)}, halves)
    )
    np.testing.assert_allclose(modes_of(two, 2).lam, modes_of(one, 2).lam, rtol=1e-9)


def sliding(name, body, speed):
    """A ring that slides on a body, which turns with it."""
    return {"name": name, "surface": f"bottom_{name}", "counterface": f"top_{body}", "normal_stiffness": 1e10,
            "kind": "frictionless", "sliding": {"axis": [0.0, 0.0, 1.0], "speed": speed}}  # fmt: skip


@pytest.mark.parametrize("speed", [10.0, -20.0])
def test_bodies_that_are_glued_and_turn_differently_are_told(speed):
    at = {"a": (0.06, 0.08, 0.0), "b": (0.08, 0.10, 0.0), "p": (0.06, 0.07, 0.01), "q": (0.09, 0.10, 0.01)}
    mesh = join(*(annulus("hex1", (1, 12, 1), r, R, 0.01, bottom=z, name=name) for name, (r, R, z) in at.items()))
    tied = {"name": "c", "surface": "rim_a", "counterface": "hub_b", "normal_stiffness": 1e14, "kind": "tied"}
    held = [{"surface": f"top_{pad}", "fixed": "xyz"} for pad in "pq"]
    problem = make_problem(mesh, 1, supports=held, contacts=[tied, sliding("p", "a", 10.0), sliding("q", "b", speed)],
                           effects={"rotation": {"bodies": ["a", "b"]}})  # fmt: skip
    told = [w for w in problem.discretisation.warnings if "no particle can do both" in w]
    assert len(told) == (speed != 10.0)
    assert all("body a rotates and is tied to body b by contact c, which turns otherwise" in w for w in told)


@pytest.mark.parametrize(("ties", "count"), [("rigid", 1), ("averaged", 0)])
def test_a_rigid_body_over_one_that_rotates_and_one_that_does_not_is_told(ties, count):
    sizes = {"a": (0.06, 0.08), "b": (0.08, 0.10)}
    rings = join(*(annulus("hex1", (1, 12, 1), *radii, 0.01, name=name) for name, radii in sizes.items()))
    faces = np.concatenate([rings.boundaries["bottom_a"], rings.boundaries["bottom_b"]])
    rings = replace(rings, _boundaries={**rings.boundaries, "both": faces})
    problem = make_problem(rings, 1, effects={"rotation": about_z("a", speed=10.0)},
                           **{ties: [{"name": "plate", "surface": "both"}]})  # fmt: skip
    told = [w for w in problem.discretisation.warnings if "no particle can do both" in w]
    assert len(told) == count
    assert all("body a rotates and is tied to body b by rigid[0], which does not" in w for w in told)


def test_damping_of_a_tied_contact_turns_with_the_bodies():
    """Bending waves that run with and against the turning see λ ± inΩ of the same λ: they decay alike.

    A damper that stood still would damp them as their own frequencies ω ± nΩ.
    """
    at = {"a": 0.0, "b": 0.004}
    mesh = join(*(annulus("hex2", (1, 16, 1), 0.06, 0.10, 0.004, bottom=z, name=name) for name, z in at.items()))
    tied = {"name": "c", "surface": "top_a", "counterface": "bottom_b", "normal_stiffness": 1e13, "kind": "tied",
            "normal_damping": 1e6}  # fmt: skip

    def waves(damping, speed):
        effects = {"rotation": about_z("a", "b", speed=speed)} if speed else {}
        held = [{"surface": "hub_a", "fixed": "xyz"}]
        problem = make_problem(mesh, supports=held, contacts=[{**tied, "normal_damping": damping}], effects=effects)
        return problem, modes_of(problem, 6).lam

    speed = 400.0
    problem, lam = waves(tied["normal_damping"], speed)
    (term,) = [t for t in problem.terms if t.name == "rotating_damping.c"]
    assert term.skew and abs(term.matrix + term.matrix.T).max() == 0
    apart = np.diff(np.sort(lam.imag))
    backward = int(np.argmax(apart > 1.8 * speed))  # the first doublet that is split by 2 nΩ
    pair = lam[np.argsort(lam.imag)][backward : backward + 2]
    assert np.ptp(pair.imag) / pair.imag.mean() > 0.03
    assert np.ptp(pair.real) < 0.01 * np.abs(pair.real).mean()


@pytest.mark.parametrize("speed", [0.0, 400.0])
@pytest.mark.parametrize("kind", ["frictionless", "sliding"])
def test_damping_of_a_gap_between_bodies_that_turn_alike_turns_with_them(kind, speed):
    """Two equal thin discs on springs k and dampers c between them, per area, at rest and as they turn together.

    Against each other they move as each one alone on 2k and 2c, so that every such mode, with ρh for its mass per area,
    decays with c/(ρh): also waves that run with and against the turning. Together they do not decay.
    """
    thickness, damping = 0.004, 1e4
    mesh = join(*(annulus("hex2", (1, 16, 1), 0.06, 0.10, thickness, bottom=z, name=name)
                  for name, z in (("a", 0.0), ("b", thickness))))  # fmt: skip
    contact = {"name": "c", "surface": "top_a", "counterface": "bottom_b", "normal_stiffness": 1e9, "kind": kind,
               "normal_damping": damping, "sliding": {"axis": [0, 0, 1], "speed": speed or 1.0}}  # fmt: skip
    held = [{"surface": f"hub_{name}", "fixed": "xyz"} for name in "ab"]
    effects = {"rotation": about_z("a", "b", speed=speed)} if speed else {}
    lam = modes_of(make_problem(mesh, supports=held, contacts=[contact], effects=effects), 10).lam
    apart = lam[lam.real < -1.0]
    assert 3 <= len(apart) <= 7 and np.abs(lam.real[lam.real >= -1.0]).max() < 1e-6
    np.testing.assert_allclose(apart.real, -damping / (STEEL["density"] * thickness), rtol=0.01)
    assert np.ptp(apart.imag) > 1.5 * speed


def rotating_disc(speed=900.0, **ties):
    """A damped disc whose hub is held, and λ of its first six modes."""
    effects = {"rotation": about_z("disc", speed=speed), "rayleigh": {"beta": 2e-7}}
    held = [{"surface": "hub", "fixed": "xyz"}]
    problem = make_problem(annulus("hex2", (1, 16, 1), 0.06, 0.10, 0.01), supports=held, effects=effects, **ties)
    return modes_of(problem, 6).lam


def test_a_mean_on_which_nothing_acts_does_not_change_damping_that_turns():
    """It is a change of unknowns alone, whose columns are far from unit vectors."""
    alone = rotating_disc()
    np.testing.assert_allclose(rotating_disc(averaged=[{"name": "a", "surface": "rim"}]), alone, rtol=1e-9)


def test_waves_with_and_against_the_turning_decay_alike_beside_a_rigid_rim():
    """Damping inside a body does not see the frame: both of a doublet decay as at rest, by β ω₀²/2."""
    lam = rotating_disc(rigid=[{"name": "r", "surface": "rim"}])
    order = np.argsort(lam.imag)
    first = int(np.argmax(np.diff(lam.imag[order]) > 1.8 * 900.0))
    pair = lam[order][first : first + 2]
    assert np.ptp(pair.imag) > 1.8 * 900.0
    assert np.ptp(pair.real) < 1e-3 * np.abs(pair.real).mean()


PAIR = join(*(annulus("hex1", (1, 12, 1), 0.06, 0.10, 0.01, bottom=z, name=name)
              for name, z in (("wheel", 0.0), ("pad", 0.01))))  # fmt: skip


def rubbing(surface, speed, turning=("wheel",), effects=None, **contact):
    """A ring on a ring, of which some turn at 20 rad/s, with friction between them."""
    faces = {"wheel": "top_wheel", "pad": "bottom_pad"}
    other = "pad" if surface == "wheel" else "wheel"
    contact = {"name": "c", "surface": faces[surface], "counterface": faces[other], "normal_stiffness": 1e10,
               "sliding": {"axis": [0, 0, 1], "speed": speed}, **contact}  # fmt: skip
    effects = {"friction": {"mu": 0.3}} if effects is None else effects
    return make_problem(PAIR, 1, contacts=[contact], effects={**effects, "rotation": about_z(*turning, speed=20.0)})


@pytest.mark.parametrize(
    ("surface", "speed", "more", "said"),
    [
        ("pad", 20.0, {}, None),
        ("wheel", -20.0, {}, None),
        ("wheel", 20.0, {}, r"contacts\.c\.sliding: given 20 rad/s, .* turns body wheel, .* \(0, 0, 20\) rad/s;"),
        ("wheel", -10.0, {}, r"contacts\.c\.sliding: given -10 rad/s"),
        ("wheel", 20.0, {"counterface": "rigid"}, r"contacts\.c\.sliding: given 20 rad/s"),
        ("wheel", 5.0, {"sliding": {"direction": [-1, 0, 0], "speed": -5.0}}, r"contacts\.c\.sliding: given -5 m/s"),
        ("pad", 20.0, {"turning": ("wheel", "pad")}, r"contacts\.c\.kind: .* turns body pad, .* as well as body wheel"),
        ("pad", 20.0, {"turning": ("wheel", "pad"), "kind": "frictionless", "effects": {}}, None),
        ("pad", 20.0, {"turning": ("wheel", "pad"), "friction_ratio": 0.0}, None),
        ("pad", 20.0, {"turning": ("wheel", "pad"), "effects": {}}, None),
    ],
)
def test_friction_acts_at_the_velocity_that_the_bodies_have(surface, speed, more, said):
    if said is None:
        rubbing(surface, speed, **more)
        return
    with pytest.raises(SceneError, match=said):
        rubbing(surface, speed, **more)


def test_the_surface_of_a_contact_may_be_on_the_body_that_turns():
    """What slides on what is a matter of names: on faces that match, friction and slip damping are the same."""
    effects = {"friction": {"mu": 0.3}, "friction_damping": {"contact_pressure": 1e6}}
    one, other = (rubbing(s, v, effects=effects).pencil() for s, v in (("pad", 20.0), ("wheel", -20.0)))
    for A, B in ((one.K, other.K), (one.C, other.C)):
        assert abs(A - B).max() <= 1e-9 * abs(A).max()
