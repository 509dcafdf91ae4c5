"""Files of the static state read back, and the picture of the contact pressure."""

from dataclasses import replace

import numpy as np
import pytest
import pyvista
import skfem
from matplotlib import image
from matplotlib.colors import to_rgb
from matplotlib.patches import FancyArrowPatch
from selection import some
from test_report_contributions import assert_nothing_overlaps

from fe_squeal.report.contact_face import ContactFace
from fe_squeal.report.preload import export_preload
from fe_squeal.report.pressure import OPEN_COLOUR, PULLING_COLOUR, face_frame, plot_pressure, pressure_figure
from fe_squeal.report.shapes import axis_frame, shape_grid
from fe_squeal.report.vtk_files import names_in

GREY, RED = to_rgb(OPEN_COLOUR), to_rgb(PULLING_COLOUR)


def face(pressure, axis=(0, 0, 1), sliding=(1, 0), nx=20, ny=12, torque=np.nan, slot=0.0):
    """Return a face 60 mm × 30 mm across `axis` with `pressure(x, y)` in Pa, x and y from 0 to 1; open below zero."""
    x, y = (a.ravel() for a in np.meshgrid((np.arange(nx) + 0.5) / nx, (np.arange(ny) + 0.5) / ny))
    kept = np.abs(x - 0.5) >= slot / 2
    x, y = x[kept], y[kept]
    frame = axis_frame(axis)
    p = np.broadcast_to(np.asarray(pressure(x, y), dtype=float), x.shape)
    weights = np.full(len(x), 0.06 * 0.03 / (nx * ny))
    return ContactFace(
        points=np.column_stack([0.06 * x, 0.03 * y]) @ frame[:2] + 0.1 * frame[2],
        normals=np.tile(frame[2], (len(x), 1)),
        directions=np.tile(np.asarray(sliding, dtype=float) @ frame[:2], (len(x), 1)), weights=weights,
        pressure=np.where(p > 0, p, 0.0), closed=p > 0, normal_force=float(p[p > 0] @ weights[p > 0]), torque=torque,
    )  # fmt: skip


def pixels(figure, panel=0):
    """Return the (m, 3) colours of the drawn face and the image's extent, mm."""
    shown = figure.axes[panel].images[0]
    rgba = np.asarray(shown.get_array())
    return rgba[rgba[..., 3] > 0][:, :3], rgba[..., 3] > 0, shown.get_extent()


def arrows(figure, panel=0):
    patches = [p for p in figure.axes[panel].patches if isinstance(p, FancyArrowPatch)]
    return [np.subtract(p._posA_posB[1], p._posA_posB[0]) for p in patches]


def part_of(colours, colour):
    return np.isclose(colours, colour, atol=0.01).all(axis=1).mean()


@pytest.fixture
def grid():
    mesh = skfem.MeshHex.init_tensor([0.0, 0.1, 0.3], [0.0, 0.2], [0.0, 0.1])
    return shape_grid(skfem.CellBasis(mesh, skfem.ElementHex2()), np.array([0, 1]), ("disc", "pad"))


@pytest.mark.slow
def test_files_read_back(grid, tmp_path):
    rng = np.random.default_rng(3)
    u, stress = 1e-6 * rng.standard_normal(grid.points.shape), np.array([1.5e6, 2.5e6])
    outer, belt = face(lambda x, y: 1e6 * (x - 0.3), torque=12.5), face(lambda x, y: 2e5, (1, 2, 3), ny=5)
    contacts = {"outer": outer, "belt": belt}
    files = export_preload(grid, u, contacts, tmp_path / "out", mu=0.45, von_mises=stress, title="brake")
    assert [f.name for f in files] == ["preload.vtu", "preload_contacts.vtu", "preload.png"]
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == sorted(f.name for f in files)

    data = pyvista.read(files[0])
    np.testing.assert_array_equal(data.points, grid.points)
    np.testing.assert_array_equal(data.point_data["displacement"], u)
    np.testing.assert_array_equal(data.cell_data["von_mises"], stress)
    np.testing.assert_array_equal(data.cell_data["body"], [0, 1])
    assert names_in(data, "body") == ["disc", "pad"]
    assert names_in(data, "contact") == ["outer", "belt"]
    assert data.field_data["mu"][0] == 0.45
    np.testing.assert_array_equal(data.field_data["normal_force"], [f.normal_force for f in contacts.values()])
    np.testing.assert_array_equal(data.field_data["torque"], [12.5, np.nan])

    points = pyvista.read(files[1])
    assert set(points.celltypes) == {pyvista.CellType.VERTEX} and points.n_cells == 240 + 100
    for i, one in enumerate(contacts.values()):
        mine = points.point_data["contact"] == i
        np.testing.assert_array_equal(points.points[mine], one.points)
        for name, array in (("contact_pressure", one.pressure), ("closed", one.closed), ("normal", one.normals),
                            ("sliding_direction", one.directions), ("weight", one.weights)):  # fmt: skip
            np.testing.assert_array_equal(points.point_data[name][mine], array)
    assert image.imread(files[2])[..., :3].std() > 0.05


def test_without_stress_contacts_or_picture_the_rest_is_written(grid, tmp_path):
    u = np.zeros(grid.points.shape)
    [only] = export_preload(grid, u, {}, tmp_path)
    assert "von_mises" not in pyvista.read(only).cell_data
    files = export_preload(grid, u, {"a": face(lambda x, y: 1e5)}, tmp_path, picture=False)
    assert [f.name for f in files] == ["preload.vtu", "preload_contacts.vtu"]


def test_arrays_that_do_not_fit_the_grid_are_refused(grid, tmp_path):
    with pytest.raises(ValueError, match="displacement"):
        export_preload(grid, np.zeros((3, 3)), {}, tmp_path)
    with pytest.raises(ValueError, match="von_mises"):
        export_preload(grid, np.zeros(grid.points.shape), {}, tmp_path, von_mises=np.zeros(7))
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_open_part_is_grey_and_as_large_as_it_is():
    figure = pressure_figure({"outer": face(lambda x, y: 2.6e6 * (x - 0.25), torque=31.25)}, "brake")
    colours, drawn, extent = pixels(figure)
    # the picture ends half a spacing, 1.5 mm, inside of the edge
    assert part_of(colours, GREY) == pytest.approx((15 - 1.5) / 57, abs=0.01)
    step = (extent[1] - extent[0]) / drawn.shape[1]
    assert drawn.sum() * step**2 == pytest.approx(57 * 27.5, rel=0.01)
    axes = figure.axes[0]
    title = axes.get_title()
    assert "closed 75 % of the area" in title and "peak 1.89 MPa" in title and "torque 31.25 N m" in title
    assert "normal force 1.316 kN" in title and "seen from +z" in title
    assert axes.get_xlabel() == "x (mm)" and axes.get_ylabel() == "y (mm)" and axes.get_aspect() == 1.0
    assert figure.axes[1].get_ylabel() == "contact pressure (MPa)"


def test_a_scene_in_units_of_its_own_has_its_numbers_without_names_of_units():
    """The same face in t, mm and s, so N, MPa and N mm."""
    one = face(lambda x, y: 2.6e6 * (x - 0.25), torque=31.25)
    other = replace(one, points=1e3 * one.points, weights=1e6 * one.weights, pressure=1e-6 * one.pressure, torque=31250)
    figure = pressure_figure({"outer": other}, units="any")
    (drawn, place, extent), (own, there, of_si) = (pixels(f) for f in (figure, pressure_figure({"outer": one})))
    np.testing.assert_allclose(extent, of_si)
    np.testing.assert_allclose(drawn, own, atol=1e-12)
    np.testing.assert_array_equal(place, there)
    axes = figure.axes[0]
    assert axes.get_title().split("\n")[2:] == [
        "normal force 1316, closed 75 % of the area", "peak 1.89, braking torque 3.125e+04"
    ]  # fmt: skip
    assert (axes.get_xlabel(), axes.get_ylabel(), figure.axes[1].get_ylabel()) == ("x", "y", "contact pressure")


@pytest.mark.slow
@pytest.mark.parametrize("axis", [(0, 0, 1), (0, 0, -1), (0, 1, 0), (-1, 0, 0), (1, 1, 1), (0.3, -2, 0.1)])
def test_face_of_any_orientation_is_seen_along_its_normal(axis):
    one = face(lambda x, y: 1e5 + 1e5 * x, axis, sliding=(0.6, 0.8))
    np.testing.assert_allclose(face_frame(one)[2], np.array(axis) / np.linalg.norm(axis), atol=1e-12)
    figure = pressure_figure({"c": one})
    left, right, bottom, top = pixels(figure)[2]
    assert right - left == pytest.approx(57, abs=6) and top - bottom == pytest.approx(27.5, abs=6)
    [arrow] = arrows(figure)
    np.testing.assert_allclose(arrow / np.linalg.norm(arrow), [0.6, 0.8], atol=1e-12)
    assert "torque" not in figure.axes[0].get_title()
    assert_nothing_overlaps(figure)


@pytest.mark.slow
def test_contact_without_a_closed_point():
    figure = pressure_figure({"open": face(lambda x, y: -1.0), "closed": face(lambda x, y: 3e3)})
    assert part_of(pixels(figure)[0], GREY) == 1.0 and part_of(pixels(figure, 1)[0], GREY) == 0.0
    assert "closed 0 % of the area\npeak 0 Pa" in figure.axes[0].get_title()
    assert_nothing_overlaps(figure)
    assert_nothing_overlaps(pressure_figure({"open": face(lambda x, y: -1.0)}, "nothing presses"))


def test_contact_that_is_held_closed_shows_where_it_pulls():
    one = face(lambda x, y: 1e4)
    pulled = replace(one, pressure=np.where(one.points[:, 0] < 0.03, -1e3, 1e4))
    figure = pressure_figure({"held": pulled})
    assert part_of(pixels(figure)[0], RED) == pytest.approx(0.5, abs=0.01)
    assert figure.legends[0].get_texts()[0].get_text() == "pulls (held closed)"


def test_slot_stays_empty_and_stretched_spacing_leaves_no_gaps():
    slotted, stretched = face(lambda x, y: 1e4, slot=0.2), face(lambda x, y: 1e4, nx=6, ny=60)
    figure = pressure_figure({"slot": slotted, "stretched": stretched})
    for panel, area in ((0, 2 * (24 - 3) * 27.5), (1, 50 * 29.5)):
        _, drawn, extent = pixels(figure, panel)
        assert drawn.sum() * ((extent[1] - extent[0]) / drawn.shape[1]) ** 2 == pytest.approx(area, rel=0.01)


def test_face_that_slides_in_circles_has_several_arrows_and_one_at_rest_none():
    angle, radius = (a.ravel() for a in np.meshgrid(np.arange(60) * np.pi / 30, np.linspace(0.05, 0.08, 8)))
    out = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    ring = ContactFace(
        points=radius[:, None] * out, normals=np.tile([0.0, 0.0, 1.0], (480, 1)), directions=np.cross([0, 0, 1], out),
        weights=radius * np.pi / 30 * 0.03 / 7, pressure=np.full(480, 2e4), closed=np.ones(480, bool), normal_force=1.0,
    )  # fmt: skip
    figure = pressure_figure({"ring": ring, "tied": face(lambda x, y: 1e4, sliding=(0, 0))})
    assert len(arrows(figure)) == 6 and arrows(figure, 1) == []
    _, drawn, extent = pixels(figure)
    centre = drawn.shape[0] // 2
    assert not drawn[centre, centre]
    step = (extent[1] - extent[0]) / drawn.shape[1]
    assert drawn.sum() * step**2 == pytest.approx(np.pi * (80**2 - 50**2), rel=0.02)


def test_face_around_a_cylinder_is_seen_where_it_presses_most():
    angle, z = (a.ravel() for a in np.meshgrid(np.arange(60) * np.pi / 30, np.linspace(0, 0.03, 6)))
    normals = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    points = 0.1 * normals + np.outer(z, [0, 0, 1])
    drum = ContactFace(points, normals, np.cross([0, 0, 1], normals), np.full(360, 6.3e-5), 1e4 * (1 + np.sin(angle)),
                       np.ones(360, bool), 10.0, 1.0)  # fmt: skip
    np.testing.assert_allclose(face_frame(drum)[2], [0, 1, 0], atol=1e-12)
    figure = pressure_figure({"drum": drum})
    assert pixels(figure)[1].mean() > 0.5 and len(arrows(figure)) == 1


@pytest.mark.parametrize("count", [1, 2])
def test_few_points_are_drawn_as_discs(count):
    one = face(lambda x, y: 1e5, nx=count, ny=1)
    assert pixels(pressure_figure({"c": one}))[1].any()


@pytest.mark.slow
def test_seven_contacts_with_long_names_overlap_nothing():
    axes = [(0, 0, 1), (1, 1, 1), (0, 1, 0), (0, 0, -1), (1, 0, 0), (1, 2, 0), (0, 1, 1)]
    contacts = {f"contact_{i}_of_the_outer_pad_with_the_friction_ring": face(lambda x, y: 1e5 * x, axis, torque=1e3 / 3)
                for i, axis in enumerate(axes)}  # fmt: skip
    figure = pressure_figure(contacts, "A long title of a brake, " * 8)
    assert_nothing_overlaps(figure)
    assert len([axes for axes in figure.axes if axes.images]) == 7


@pytest.mark.parametrize("nx, ny", some([(10, 6), (20, 12), (20, 3), (4, 12)], lambda nx, ny: abs(nx - ny) > 4))
def test_nothing_is_cut_off(tmp_path, nx, ny):
    """Nothing stands at the edges of the picture as it is written, not even the label of the colours."""
    pressed = face(lambda x, y: 1.73e6 * (1 - 0.6 * x), nx=nx, ny=ny)
    drawn = image.imread(plot_pressure({"belt": pressed}, tmp_path / "p.png", "pad that lifts off, pressure swept"))
    assert all((edge == 1.0).all() for edge in (drawn[:, :4], drawn[:, -4:], drawn[:4], drawn[-4:]))
