"""Shapes of universal files: references, roving hammers, coordinate systems and the line nearest to a frequency."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import pyuff
from scene_texts import SCENE, write_scene

import fe_squeal
from fe_squeal.cli import main
from fe_squeal.errors import SceneError
from fe_squeal.report.mac import mac
from fe_squeal.run.measured import read_measured
from fe_squeal.run.universal import UniversalShape, read_universal
from fe_squeal.run.universal_responses import read_lines

RNG = np.random.default_rng(11)
NODES = np.arange(1, 9) * 10
POINTS = RNG.uniform(0.5, 2.0, (8, 3))
SHAPE = RNG.standard_normal((8, 3)) + 1j * RNG.standard_normal((8, 3))
HZ = np.array([500.0, 600.0, 700.0])


def points_2411(points: np.ndarray = POINTS, definition: int = 0, displacement: int = 0) -> dict:
    own = np.full(len(points), 1)
    x, y, z = points.T
    return pyuff.prepare_2411(
        node_nums=NODES, def_cs=own * definition, disp_cs=own * displacement, color=own, x=x, y=y, z=z
    )


def function(
    response: tuple[int, int], reference: tuple[int, int], value: complex, kind: int = 4,
    quantities: tuple[int, int] = (12, 13),
) -> dict:  # fmt: skip
    """Return a data set 58: nodes and directions, the value at the second of three lines, and what both are."""
    return pyuff.prepare_58(
        binary=0, func_type=kind, rsp_node=int(response[0]), rsp_dir=response[1], ref_node=int(reference[0]),
        ref_dir=reference[1], data=value * np.array([0.3, 1.0, 0.2j]), x=HZ, id1="frf", rsp_ent_name="p",
        ref_ent_name="p", abscissa_spacing=1, ord_data_type=6, num_pts=3, abscissa_min=HZ[0], abscissa_inc=100.0,
        z_axis_value=0.0, abscissa_spec_data_type=18, abscissa_len_unit_exp=0, abscissa_force_unit_exp=0,
        abscissa_temp_unit_exp=0, ordinate_spec_data_type=quantities[0], ordinate_len_unit_exp=0,
        ordinate_force_unit_exp=0, ordinate_temp_unit_exp=0, orddenom_spec_data_type=quantities[1],
    )  # fmt: skip


def shape_55(hz: float, u: np.ndarray) -> dict:
    return pyuff.prepare_55(
        model_type=1, analysis_type=5, data_ch=2, spec_data_type=8, load_case=0, freq_step_n=1, freq=hz, data_type=5,
        n_data_per_node=3, node_nums=NODES, r1=u[:, 0], r2=u[:, 1], r3=u[:, 2],
    )  # fmt: skip


W = 2j * np.pi * 600.0
FACTORS = {8: 1.0, 11: W, 12: W**2, 13: 1.0}  # of u e^(iωt): displacement, velocity, acceleration; and a force


@pytest.mark.parametrize("kind", ["responses", "roving hammer", "transmissibility", "exchanged cross spectra"])
def test_displacements_velocities_and_accelerations_beside_each_other(kind: str) -> None:
    """A laser vibrometer beside accelerometers: derivatives of one motion in time have the factors 1, iω and (iω)²."""
    sets = []
    for i, n in enumerate(NODES):
        q, u = (8, 11, 12)[i % 3], SHAPE[i, 2]
        if kind == "responses":
            sets.append(function((n, 3), (10, 3), FACTORS[q] * u, 4, (q, 13)))
        elif kind == "roving hammer":
            sets.append(function((30, 3), (n, 3), FACTORS[q] * u, 4, (q, 13)))
        elif kind == "transmissibility":
            sets.append(function((n, 3), (10, 3), FACTORS[12] * u / FACTORS[q], 4, (12, q)))
        else:
            sets.append(function((30, 3), (n, 3), FACTORS[12] * SHAPE[2, 2] * np.conj(FACTORS[q] * u), 3, (12, q)))
    if kind == "transmissibility":  # which pyuff does not write
        sets = [{**f, "func_type": 5} for f in sets]
    found = read_lines(sets, 600.0, None, "a.unv")
    assert mac(np.array([found.rows[int(n)][2] for n in NODES]), SHAPE[:, 2]) == pytest.approx(1.0)
    said = "displacement, velocity, acceleration stand beside each other, and all are made displacements"
    assert found.notes[-1] == said


def test_quantities_that_are_all_alike_stay_and_others_are_refused(tmp_path: Path) -> None:
    for q in (0, 8, 11, 12):
        found = read(tmp_path, [points_2411(), *(function((n, 3), (10, 3), 2.0, 4, (q, 13)) for n in NODES)])
        assert found.notes == () and (found.u[:, 2] == 2.0).all()
    for pair, names in (((12, 0), "type 0, force"), ((3, 13), "type 3, acceleration"), ((0, 13), "type 0, acc")):
        sets = [function((n, 3), (10, 3), 2.0, 4, pair if n == 30 else (12, 13)) for n in NODES]
        with pytest.raises(SceneError, match=f"has functions of several quantities in one shape: {names}"):
            read(tmp_path, [points_2411(), *sets])


def mode_55(lam: complex, u: np.ndarray) -> dict:
    """Return a complex mode, with its eigenvalue."""
    return pyuff.prepare_55(
        model_type=1, analysis_type=7, data_ch=2, spec_data_type=8, load_case=0, mode_n=1, eig=lam, modal_a=0j,
        modal_b=0j, data_type=5, n_data_per_node=3, node_nums=NODES, r1=u[:, 0], r2=u[:, 1], r3=u[:, 2],
    )  # fmt: skip


def responses(to: tuple[int, int], count: int = 8, size: complex = 1.0, axis: int = 3) -> list[dict]:
    return [function((NODES[i], axis), to, size * SHAPE[i, axis - 1]) for i in range(count)]


def read(folder: Path, sets: list[dict], hz: float | None = 600.0, reference: str | None = None) -> UniversalShape:
    pyuff.UFF(str(folder / "test.unv")).write_sets(sets, mode="overwrite")
    return read_universal(folder / "test.unv", hz, reference, "measured[0].file")


def likeness(found: UniversalShape, u: np.ndarray = SHAPE) -> float:
    """Return the MAC with true displacements (8, 3), at the points and along the directions that were measured."""
    i = [int(np.argmin(np.linalg.norm(POINTS - x, axis=1))) for x in found.points]
    np.testing.assert_allclose(found.points, POINTS[i], atol=1e-9)
    return mac(found.u, np.einsum("pij,pj->pi", found.axes, u[i]))


@pytest.mark.parametrize("first", [True, False])
def test_responses_of_several_references_are_not_mixed(tmp_path: Path, first: bool) -> None:
    """The second reference has half of the points, seven times as large and turned: mixed, the MAC is far from 1."""
    whole, part = responses((10, 3)), responses((50, 3), 4, -7.0)
    found = read(tmp_path, [points_2411(), *(whole + part if first else part + whole)])
    assert len(found.points) == 8 and likeness(found) == pytest.approx(1.0)
    [note] = found.notes
    assert "10z is taken of references" in note and "10z with 8" in note and "50z with 4 directions" in note
    chosen = read(tmp_path, [points_2411(), *whole, *part], reference="50z")
    assert len(chosen.points) == 4 and likeness(chosen) == pytest.approx(1.0) and chosen.notes == ()
    assert chosen.u[0, 2] == pytest.approx(-7.0 * SHAPE[0, 2])


def test_of_references_without_all_points_one_has_to_be_chosen(tmp_path: Path) -> None:
    sets = [points_2411(), *responses((10, 3), 5), *responses((50, 1), 8, 2.0)[2:]]
    with pytest.raises(SceneError, match=r"references 50x with 6, 10z with 5 directions, and none has all 8 .*expected"
                       r" reference beside the file"):  # fmt: skip
        read(tmp_path, sets)
    assert likeness(read(tmp_path, sets, reference="50x")) == pytest.approx(1.0)
    with pytest.raises(SceneError, match=r'given reference = "7z"; expected one of references 50x with 6'):
        read(tmp_path, sets, reference="7z")
    with pytest.raises(SceneError, match=r'given reference = "50x", which belongs to frequency responses'):
        read(tmp_path, [points_2411(), shape_55(600.0, SHAPE)], reference="50x")


def test_directions_that_look_the_other_way(tmp_path: Path) -> None:
    """The sign of both directions counts: a force and a response that are both turned cancel."""
    signs = [(1, 1), (-1, 1), (1, -1), (-1, -1)] * 2
    sets = [function((NODES[i], a * 3), (10, b * 3), a * b * SHAPE[i, 2]) for i, (a, b) in enumerate(signs)]
    assert likeness(read(tmp_path, [points_2411(), *sets])) == pytest.approx(1.0)


def test_coherences_and_repeated_functions_are_left_out(tmp_path: Path) -> None:
    coherence = [function((n, 3), (10, 3), 0.9, kind=6) for n in NODES]
    again = function((10, 3), (10, 3), 99.0)
    found = read(tmp_path, [points_2411(), *responses((10, 3)), *coherence, again])
    assert likeness(found) == pytest.approx(1.0)
    assert found.notes == ("functions that are there again: 1; the first of each is taken",)
    with pytest.raises(SceneError, match="has functions of type 6; expected frequency responses, of type 4"):
        read(tmp_path, [points_2411(), *coherence])


@pytest.mark.parametrize("still", [1, 2])
def test_a_roving_hammer(tmp_path: Path, still: int) -> None:
    """One accelerometer, or one along two axes, and a force that moves and turns: reciprocity gives all components."""
    sets = [
        function((30, axis), (NODES[i], sign * along), sign * SHAPE[2, axis - 1] * SHAPE[i, along - 1])
        for axis in (3, 1)[:still] for i in range(8) for along, sign in ((1, 1), (3, -1))
    ]  # fmt: skip
    found = read(tmp_path, [points_2411(), *sets])
    assert len(found.points) == 8 and likeness(found) == pytest.approx(1.0)
    assert np.isfinite(found.u[:, [0, 2]]).all() and np.isnan(found.u[:, 1]).all()
    assert "the response 30z stands still and the references move, so by reciprocity" in found.notes[-1]
    assert ("30z is taken of fixed responses 30z with 16, 30x with 16" in found.notes[0]) == (still == 2)
    if still == 2:
        assert likeness(read(tmp_path, [points_2411(), *sets], reference="30x")) == pytest.approx(1.0)


def test_exchanged_channels_of_operating_data(tmp_path: Path) -> None:
    """A cross spectrum of response j and reference k is u_j u_k*, which gives u_k* as k moves; a transmissibility is
    u_j / u_k, and gives no shape."""
    cross = [function((30, 3), (n, 1), SHAPE[2, 2] * SHAPE[i, 0].conj(), kind=3) for i, n in enumerate(NODES)]
    assert likeness(read(tmp_path, [points_2411(), *cross])) == pytest.approx(1.0)
    ratios = [function((30, 3), (n, 1), SHAPE[2, 2] / SHAPE[i, 0]) for i, n in enumerate(NODES)]
    with pytest.raises(SceneError, match=r"has references .*, and none has all"):
        read_lines([{**f, "func_type": 5, "rsp_node": 30 + i % 2} for i, f in enumerate(ratios)], 600.0, None, "a.unv")
    assert len(read_lines([{**f, "func_type": 5} for f in ratios], 600.0, None, "a.unv").rows) == 1


def test_the_mode_of_a_conjugate_eigenvalue_is_conjugated(tmp_path: Path) -> None:
    """A wave exp(i(ωt − 2φ)) around the axis is kept as its shape with λ or as the conjugate with λ*: both travel the
    same way, and a wave that travels the other way is orthogonal to it."""
    wave = np.zeros((8, 3), complex)
    wave[:, 2] = np.exp(-2j * np.pi * 2 * np.arange(8) / 8)
    wave[:, :2] = 0.1 * wave[:, 2:]
    lam = -5.0 + 2j * np.pi * 600.0
    for sets in ([mode_55(lam.conjugate(), wave.conj())], [mode_55(lam.conjugate(), wave.conj()), mode_55(lam, wave)]):
        found = read(tmp_path, [points_2411(), *sets])
        assert likeness(found, wave) == pytest.approx(1.0) and likeness(found, wave.conj()) < 1e-9
        assert found.hz == pytest.approx(600.0, rel=1e-5)
        assert found.notes == ("the file has it for an eigenvalue with Im λ < 0, so its conjugate is taken",)
    plain = read(tmp_path, [points_2411(), mode_55(lam, wave)])
    assert likeness(plain, wave) == pytest.approx(1.0) and plain.notes == ()


@pytest.mark.parametrize("axes", [[2], [0, 2], [0, 1, 2]])
def test_components_that_are_zero_everywhere_were_not_measured(tmp_path: Path, axes: list[int]) -> None:
    """A laser sees one direction, and the format fills up with zeros: its MAC with the same motion is 1, along the
    axes of the nodes, which are turned here. A shape that is zero as a whole stays so."""
    own = systems_2420(0)
    [matrix] = own["CS_matrices"]
    local, seen = SHAPE @ matrix[:3].T, np.zeros_like(SHAPE)
    seen[:, axes] = local[:, axes]
    found = read(tmp_path, [own, points_2411(POINTS, 0, 7), shape_55(600.0, seen)])
    assert likeness(found) == pytest.approx(1.0)
    assert np.isfinite(found.u).all(axis=0).tolist() == [a in axes for a in range(3)]
    lost = " and ".join("xyz"[a] for a in range(3) if a not in axes)
    said = f"it is 0 along {lost} at all nodes, which is taken as not measured"
    assert found.notes == ((said,) if lost else ())
    still = read(tmp_path, [points_2411(), shape_55(600.0, 0 * SHAPE)])
    assert not still.u.any() and still.notes == ()


def rotation() -> np.ndarray:
    q, _ = np.linalg.qr(np.random.default_rng(2).standard_normal((3, 3)))
    return q * np.sign(np.linalg.det(q))


def place(kind: int, q: np.ndarray) -> np.ndarray:
    """Return the Cartesian place of coordinates (3,): radius, angle(s) in degrees and height."""
    if kind == 0:
        return q
    r, a, b = q
    a = np.deg2rad(a)
    if kind == 1:
        return np.array([r * np.cos(a), r * np.sin(a), b])
    b = np.deg2rad(b)
    return r * np.array([np.sin(a) * np.cos(b), np.sin(a) * np.sin(b), np.cos(a)])


def coordinates(kind: int, x: np.ndarray) -> np.ndarray:
    if kind == 0:
        return x
    angle = np.rad2deg(np.arctan2(x[1], x[0]))
    if kind == 1:
        return np.array([np.hypot(x[0], x[1]), angle, x[2]])
    return np.array([np.linalg.norm(x), np.rad2deg(np.arccos(x[2] / np.linalg.norm(x))), angle])


def directions(kind: int, q: np.ndarray) -> np.ndarray:
    """Return the unit vectors (3, 3), in rows, along which coordinates grow, by differences of the place."""
    d = np.stack([place(kind, q + h) - place(kind, q - h) for h in 1e-5 * np.eye(3)])
    return d / np.linalg.norm(d, axis=1, keepdims=True)


def systems_2420(*kinds: int) -> dict:
    matrix = np.vstack([rotation(), [0.3, -0.4, 0.7]])
    return {
        "type": 2420, "Part_UID": 1, "Part_Name": "part", "CS_sys_labels": [7 + i for i in range(len(kinds))],
        "CS_types": list(kinds), "CS_colors": [8] * len(kinds), "CS_names": [f"CS{i}" for i in range(len(kinds))],
        "CS_matrices": [matrix] * len(kinds),
    }  # fmt: skip


@pytest.mark.parametrize("data", ["55", "58 along the first direction alone"])
@pytest.mark.parametrize("kind", [0, 1, 2])
def test_coordinate_systems(tmp_path: Path, kind: int, data: str) -> None:
    """Places and displacements in a turned and moved system; directions by differences of the closed form."""
    own = systems_2420(kind)
    [matrix] = own["CS_matrices"]
    q = np.array([coordinates(kind, (x - matrix[3]) @ matrix[:3].T) for x in POINTS])
    local = np.array([directions(kind, c) @ matrix[:3] @ u for c, u in zip(q, SHAPE, strict=True)])
    if data == "55":
        measured = [shape_55(600.0, local)]
    else:
        measured = [function((NODES[i], 1), (10, 3), local[i, 0]) for i in range(8)]
    found = read(tmp_path, [own, points_2411(q, 7, 7), *measured])
    np.testing.assert_allclose(found.points, POINTS, atol=1e-12)
    assert likeness(found) == pytest.approx(1.0, abs=1e-9)
    assert np.isfinite(found.u).sum() == (24 if data == "55" else 8)
    name = ["Cartesian", "cylindrical", "spherical"][kind]
    assert found.notes == (f"8 points are given in the {name} coordinate system 7 of the file",)
    found = read(tmp_path, [own, points_2411(POINTS, 0, 7), *measured])
    assert likeness(found) == pytest.approx(1.0, abs=1e-9) and found.notes == ()


def test_a_cylindrical_system_as_it_is_written(tmp_path: Path) -> None:
    """Points on the y axis of the system: its first direction is the file's y, its second the file's -x."""
    rows = "".join(f"{v[0]:25.16E}{v[1]:25.16E}{v[2]:25.16E}\n".replace("E", "D") for v in [*np.eye(3), np.zeros(3)])
    points = "".join(f"{n:10d}{1:10d}{4:10d}{1:10d}\n{0:25.16E}{n:25.16E}{0:25.16E}\n" for n in (1, 2, 3))
    shape = "".join(f"{n:10d}\n{n:13.5E}{0.5:13.5E}{0.25:13.5E}\n" for n in (1, 2, 3))
    head = "NONE\n" * 5 + f"{1:10d}{2:10d}{2:10d}{8:10d}{2:10d}{3:10d}\n{2:10d}{4:10d}{0:10d}{1:10d}\n"
    text = (
        f"    -1\n  2420\n{1:10d}\nPart\n{4:10d}{1:10d}{8:10d}\nturned\n{rows}    -1\n    -1\n  2411\n{points}    -1\n"
        f"    -1\n    55\n{head}{600.0:13.5E}{1.0:13.5E}{0:13.5E}{0:13.5E}\n{shape}    -1\n"
    )
    (tmp_path / "written.unv").write_text(text)
    found = read_universal(tmp_path / "written.unv", 600.0, None, "file")
    u = np.einsum("pi,pij->pj", found.u, found.axes)
    np.testing.assert_allclose(u, [[-0.5, n, 0.25] for n in (1, 2, 3)], atol=1e-12)
    np.testing.assert_allclose(found.points, [[0, n, 0] for n in (1, 2, 3)])
    assert found.notes == ("coordinate system 1, which the file does not define, is taken as the file's axes",)


@pytest.mark.parametrize(("change", "said"), [
    (lambda s: s.update(CS_sys_labels=[3]), "has nodes in coordinate system 7, which no data set 2420 defines"),
    (lambda s: s.update(CS_types=[5]), "has coordinate system 7 of type 5; expected 0, 1 or 2"),
    (lambda s: s["CS_types"].pop(), "has a data set 2420 that is not whole"),
    (lambda s: s["CS_matrices"][0].__imul__(2), "has coordinate system 7, whose matrix is no rotation"),
    (lambda s: s["CS_matrices"][0].__setitem__(0, -s["CS_matrices"][0][0]), "7, whose matrix is no rotation"),
])  # fmt: skip
def test_coordinate_systems_that_are_refused(tmp_path: Path, monkeypatch, change, said: str) -> None:
    sets = [systems_2420(1), points_2411(POINTS, 0, 7), shape_55(600.0, SHAPE)]
    change(sets[0])
    monkeypatch.setattr(pyuff.UFF, "read_sets", lambda *_: sets)  # pyuff writes no set that is damaged
    with pytest.raises(SceneError, match=said):
        read(tmp_path, sets[1:])


@pytest.mark.parametrize(("hz", "said"), [
    (1664.0, "has lines from 500 to 700 Hz; given frequency_hz = 1664, expected one that was measured"),
    (480.0, "has lines from 500 to 700 Hz; given frequency_hz = 480"),
])  # fmt: skip
def test_frequencies_out_of_range_are_refused(tmp_path: Path, hz: float, said: str) -> None:
    with pytest.raises(SceneError, match=said):
        read(tmp_path, [points_2411(), *responses((10, 3))], hz)
    with pytest.raises(SceneError, match=said.replace("lines", "shapes")):
        read(tmp_path, [points_2411(), shape_55(500.0, SHAPE), shape_55(700.0, SHAPE)], hz)
    with pytest.raises(SceneError, match="has no shape but that at 600 Hz; given frequency_hz"):
        read(tmp_path, [points_2411(), shape_55(600.0, SHAPE)], hz)


def test_a_line_far_from_the_frequency_is_told(tmp_path: Path) -> None:
    sets = [points_2411(), *responses((10, 3))]
    near, far = read(tmp_path, sets, 608.0), read(tmp_path, sets, 630.0)
    assert near.hz == far.hz == 600.0 and near.warnings == ()
    assert far.warnings == ("the line nearest to 630 Hz is at 600 Hz, 4.8 % away",)
    far = read(tmp_path, [points_2411(), shape_55(500.0, SHAPE), shape_55(700.0, -SHAPE[::-1])], 630.0)
    assert far.warnings == ("the shape nearest to 630 Hz is at 700 Hz, 11 % away",) and far.hz == 700.0
    alone = read(tmp_path, [points_2411(), shape_55(0.0, SHAPE)], 630.0)  # 0 stands for a frequency that is not known
    assert alone.hz is None and alone.warnings == ()


def test_shapes_without_a_frequency_stand_back(tmp_path: Path) -> None:
    """Programs write 0 Hz for one that is not known, such as the mean of a test: it takes no other's place."""
    other, odd = RNG.standard_normal((2, 8, 3)) + 0j
    sets = [points_2411(), shape_55(0.0, odd), shape_55(400.0, other), shape_55(600.0, SHAPE)]
    found = read(tmp_path, sets, 605.0)
    assert found.hz == 600.0 and likeness(found) == pytest.approx(1.0)
    assert found.notes == ("shapes of the file without a frequency: 1; they are left out",)
    with pytest.raises(SceneError, match="has 2 shapes, none with its frequency; expected"):
        read(tmp_path, [points_2411(), shape_55(0.0, odd), shape_55(0.0, other)], 605.0)
    with pytest.raises(SceneError, match="has shapes from 400 to 600 Hz; given frequency_hz = 900"):
        read(tmp_path, sets, 900.0)
    with pytest.raises(SceneError, match=r"has 3 shapes, .* expected frequency_hz beside the file"):
        read(tmp_path, sets, None)


def test_what_was_chosen_reaches_the_console(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    sets = [points_2411(), *responses((10, 3)), *responses((50, 3))]
    pyuff.UFF(str(tmp_path / "test.unv")).write_sets(sets, mode="overwrite")
    text = SCENE + '[[measured]]\nfile = "test.unv"\nfrequency_hz = 630.0\nlabel = "rim"\n'
    scene = write_scene(tmp_path, text)
    found = read_measured(fe_squeal.load_scene(scene))
    assert found.shapes[0].hz == 600.0 and found.frequencies[0].hz == 630.0
    assert main(["check", str(scene)]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "measured shape rim: 10z is taken of references 10z with 8, 50z with 8 directions" in printed
    assert "warning: measured shape rim: the line nearest to 630 Hz is at 600 Hz, 4.8 % away" in printed
    taken = read_measured(fe_squeal.load_scene(write_scene(tmp_path, text + 'reference = "50z"\n')))
    assert taken.notes == ()
    (tmp_path / "shape.csv").write_text("x,y,z,ux_re\n0,0,0,1\n")
    with pytest.raises(SceneError, match=r"measured\[0\].reference: belongs to a universal file"):
        bad = write_scene(tmp_path, SCENE + '[[measured]]\nfile = "shape.csv"\nreference = "5z"\n')
        read_measured(fe_squeal.load_scene(bad))
