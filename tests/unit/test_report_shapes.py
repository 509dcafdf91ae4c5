"""Mode shapes as VTK files and pictures: node order, normalisation, what is read back, what is drawn."""

import signal
import subprocess
import sys
import tempfile
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
import pyvista
import skfem
import vtk
from matplotlib import image

from fe_squeal.fem.cubic import CubicDofs, ElementHex3
from fe_squeal.report import pictures
from fe_squeal.report.export import exporting_shapes
from fe_squeal.report.pictures import compose_figure, draw_shape
from fe_squeal.report.results import read_shape
from fe_squeal.report.shape_names import shape_name
from fe_squeal.report.shapes import (
    REFERENCE_NODES,
    ShapeGrid,
    axis_frame,
    boundary_triangles,
    normalise_shape,
    semi_major_amplitude,
    shape_grid,
    sharp_edges,
)
from fe_squeal.report.views import AxialView, choose_view, widest_body
from fe_squeal.report.vtk_files import names_in, unstructured_grid, write_animation, write_shape

TET, HEX = skfem.MeshTet, skfem.MeshHex
VTK_CELLS = {10: vtk.vtkTetra, 24: vtk.vtkQuadraticTetra, 12: vtk.vtkHexahedron, 29: vtk.vtkTriQuadraticHexahedron,
             72: vtk.vtkLagrangeHexahedron}  # fmt: skip
BASES = [
    pytest.param(TET, skfem.ElementTetP1, id="tet1"),
    pytest.param(TET, skfem.ElementTetP2, id="tet2"),
    pytest.param(HEX, skfem.ElementHex1, id="hex1"),
    pytest.param(HEX, skfem.ElementHex2, id="hex2"),
    pytest.param(HEX, ElementHex3, id="hex3"),
]


def box(mesh_class, element, x, y, z, body=0, names=("box",)):
    mesh = mesh_class.init_tensor(x, y, z)
    return shape_grid(basis_of(mesh, element), np.full(mesh.nelements, body), names)


def basis_of(mesh, element):
    return skfem.CellBasis(mesh, element(), dofs=CubicDofs(mesh) if element is ElementHex3 else None)


def disc_with_pad(mesh_class=HEX, element=skfem.ElementHex2):
    """A ring 0.07 … 0.14 m with a pad segment on top, bent from boxes in (r, angle, z); the meshes do not meet."""
    names = ("disc", "pad")
    ring = box(mesh_class, element, np.linspace(0.07, 0.14, 4), np.linspace(0, 2 * np.pi, 33), [0, 0.012], 0, names)
    pad = box(mesh_class, element, [0.09, 0.13], np.linspace(1.0, 2.0, 7), [0.0125, 0.022], 1, names)
    r, angle, z = np.concatenate([ring.points, pad.points]).T
    cells = np.concatenate([ring.cells, pad.cells + len(ring.points)])
    points = np.column_stack([r * np.cos(angle), r * np.sin(angle), z])
    return ShapeGrid(points, cells, ring.vtk_cell_type, np.concatenate([ring.body, pad.body]), names)


def bending(grid, diameters, travelling=False):
    """u_z = cos nθ (or e^{inθ}), of an arbitrary size and phase."""
    u = np.zeros(grid.points.shape, dtype=complex)
    angle = np.arctan2(grid.points[:, 1], grid.points[:, 0])
    u[:, 2] = np.exp(1j * diameters * angle) if travelling else np.cos(diameters * angle)
    return u * (3.0 - 4.0j)


@pytest.mark.parametrize("kind", VTK_CELLS)
def test_reference_nodes_are_vtks(kind):
    cell = VTK_CELLS[kind]()
    if kind == 72:  # whose order follows from how many nodes it has
        cell.GetPointIds().SetNumberOfIds(64)
        cell.GetPoints().SetNumberOfPoints(64)
        cell.SetUniformOrderFromNumPoints(64)
    coordinates = np.reshape(cell.GetParametricCoords()[: 3 * cell.GetNumberOfPoints()], (-1, 3))
    np.testing.assert_allclose(REFERENCE_NODES[kind], coordinates, atol=2e-16)


@pytest.mark.parametrize(("mesh_class", "element"), BASES)
@pytest.mark.parametrize("mirrored", [False, True])
def test_vtk_sees_positive_cells_that_fill_the_box(mesh_class, element, mirrored):
    x = np.array([0.0, 0.5, 0.7, 2.0])
    mesh = mesh_class.init_tensor(-x if mirrored else x, np.array([0.0, 1.0, 3.0]), np.array([0.0, 0.2, 0.5]))
    grid = shape_grid(basis_of(mesh, element), np.zeros(mesh.nelements, dtype=int), ("box",))
    data = unstructured_grid(grid, grid.points)
    volumes = data.compute_cell_sizes(length=False, area=False)["Volume"]
    assert (volumes > 0).all()
    # 1e-6: VTK keeps some of its quadrature points of quadratic cells in single precision
    assert volumes.sum() == pytest.approx(2.0 * 3.0 * 0.5, rel=1e-6)


@pytest.mark.parametrize(("mesh_class", "element"), BASES)
def test_a_shape_is_read_as_it_was_written(tmp_path, mesh_class, element):
    grid = disc_with_pad(mesh_class, element)
    read, shape = read_shape(write_shape(grid, bending(grid, 3), tmp_path / "shape.vtu", {"branch": 7}))
    assert read.vtk_cell_type == grid.vtk_cell_type and read.body_names == grid.body_names and shape.info["branch"] == 7
    np.testing.assert_array_equal(read.cells, grid.cells)
    np.testing.assert_allclose(read.points, grid.points, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(shape.u, normalise_shape(bending(grid, 3)), rtol=1e-6, atol=1e-6)


def test_point_of_the_grid_is_degree_of_freedom_of_the_basis():
    mesh = TET.init_tensor(*3 * [np.linspace(0, 1, 3)])
    basis = skfem.CellBasis(mesh, skfem.ElementTetP2())
    grid = shape_grid(basis, np.zeros(mesh.nelements, dtype=int), ("box",))
    nodal = basis.project(lambda x: x[0] + 2 * x[1] - x[2] ** 2)
    x, y, z = grid.points.T
    np.testing.assert_allclose(nodal, x + 2 * y - z**2, atol=1e-12)


def test_curved_mesh_keeps_its_middle_nodes_on_the_curve():
    flat = skfem.MeshTet2.from_mesh(TET.init_tensor([1.0, 2.0], np.linspace(0, 1, 5), [0.0, 0.5]))
    r, angle, z = flat.doflocs
    mesh = skfem.MeshTet2(np.array([r * np.cos(angle), r * np.sin(angle), z]), flat.t)
    grid = shape_grid(skfem.CellBasis(mesh, skfem.ElementTetP2()), np.zeros(mesh.nelements, dtype=int), ("ring",))
    radius = np.hypot(*grid.points.T[:2])
    assert set(np.round(radius, 9)) == {1.0, 1.5, 2.0}


def test_other_elements_are_refused():
    mesh = TET()
    with pytest.raises(ValueError, match="no VTK cell for ElementTetCR"):
        shape_grid(skfem.CellBasis(mesh, skfem.ElementTetCR()), np.zeros(mesh.nelements, dtype=int), ("a",))


def test_amplitude_is_the_largest_displacement_of_a_sampled_period():
    rng = np.random.default_rng(1)
    u = rng.standard_normal((200, 3)) + 1j * rng.standard_normal((200, 3))
    u[:3] = [[1, 1j, 0], [0, 0, 0], [1, 2, 3]]  # a circle, nothing, a line
    phases = np.exp(2j * np.pi * np.arange(2000) / 2000)
    sampled = np.linalg.norm((u[:, None, :] * phases[None, :, None]).real, axis=2).max(axis=1)
    # near the top the norm falls with half the square of the phase error, at most π/2000
    np.testing.assert_allclose(semi_major_amplitude(u), sampled, rtol=0.5 * (np.pi / 2000) ** 2)


@pytest.mark.parametrize("travelling", [False, True])
def test_normalised_shape_has_the_largest_real_part_and_unit_amplitude(travelling):
    u = bending(disc_with_pad(), 3, travelling)
    shape = normalise_shape(u)
    assert semi_major_amplitude(shape).max() == pytest.approx(1.0)
    assert shape.real.max() == pytest.approx(np.abs(shape.real).max())
    phases = np.exp(2j * np.pi * np.arange(90) / 90)
    fullest = max(np.sum((shape * phase).real ** 2) for phase in phases)
    assert np.sum(shape.real**2) >= fullest * (1 - 1e-12)
    ratio = shape[np.abs(u) > 1e-3] / u[np.abs(u) > 1e-3]
    np.testing.assert_allclose(ratio, ratio[0])
    # The phase and size that a solver happens to give do not matter. Of a wave that only travels every phase is equally
    # full, and which of its equal peaks comes first is up to rounding; of a standing one only the sign is free.
    other = normalise_shape(u * 7j * np.exp(0.4j))
    turn = np.vdot(other, shape) / np.vdot(shape, shape).real
    np.testing.assert_allclose(other * turn, shape, atol=1e-12)
    if not travelling:
        assert abs(turn.imag) < 1e-12


def test_zero_shape_stays_zero():
    assert (normalise_shape(np.zeros((4, 3))) == 0).all()


@pytest.mark.parametrize(("mesh_class", "element"), BASES)
def test_boundary_triangles_cover_the_surface_of_each_body(mesh_class, element):
    grid = box(mesh_class, element, [0.0, 1.0, 2.0], [0.0, 3.0], [0.0, 0.5, 1.0])
    halves = ShapeGrid(grid.points, grid.cells, grid.vtk_cell_type,
                       (grid.points[grid.cells].mean(axis=1)[:, 0] > 1).astype(int), ("left", "right"))
    triangles, body = boundary_triangles(halves)
    a, b, c = grid.points[triangles].swapaxes(0, 1)
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
    # each half is a 1 × 3 × 1 box: their common face counts for both
    assert [areas[body == i].sum() for i in (0, 1)] == pytest.approx([14.0, 14.0])
    assert len(boundary_triangles(halves, 1)[0]) == (body == 1).sum()
    edges = sharp_edges(grid.points, boundary_triangles(grid)[0])
    lengths = np.linalg.norm(np.diff(grid.points[edges], axis=1), axis=2)
    assert lengths.sum() == pytest.approx(4 * (2.0 + 3.0 + 1.0))


def test_shape_file_reads_back(tmp_path):
    grid = disc_with_pad(TET, skfem.ElementTetP2)
    u = bending(grid, 2, travelling=True)
    info = {"frequency_hz": 2413.25, "re": 12.5, "im": 15162.9, "parameter": "mu", "value": 0.6, "branch": 7}
    data = pyvista.read(write_shape(grid, u, tmp_path / "shape.vtu", info))
    shape = normalise_shape(u)
    np.testing.assert_array_equal(data["u_re"] + 1j * data["u_im"], shape)
    np.testing.assert_array_equal(data["amplitude"], semi_major_amplitude(shape))
    np.testing.assert_array_equal(data["body"], grid.body)
    np.testing.assert_array_equal(data.points, grid.points)
    np.testing.assert_array_equal(data.cells_dict[24], grid.cells)
    assert names_in(data, "parameter") == [info.pop("parameter")]
    assert {key: data.field_data[key][0] for key in info} == info
    assert names_in(data, "body") == ["disc", "pad"]
    assert b'compressor="vtkZLibDataCompressor"' in (tmp_path / "shape.vtu").read_bytes()[:500]


def test_animation_is_one_period(tmp_path):
    grid = disc_with_pad()
    u = bending(grid, 2, travelling=True)
    files = write_animation(grid, u, tmp_path / "mode.pvd", frames=8)
    sets = ElementTree.parse(files[0]).getroot().findall("Collection/DataSet")
    assert ElementTree.parse(files[0]).getroot().get("type") == "Collection"
    assert [entry.get("file") for entry in sets] == [f"mode_frames/mode_{k:02d}.vtu" for k in range(8)]
    assert files[1:] == [tmp_path / entry.get("file") for entry in sets]
    reader = pyvista.PVDReader(str(files[0]))
    assert list(reader.time_values) == [k / 8 for k in range(8)]
    size = np.linalg.norm(np.ptp(grid.points, axis=0))
    for k in (0, 3):
        reader.set_active_time_point(k)
        [frame] = reader.read()
        wanted = 0.05 * size * (normalise_shape(u) * np.exp(2j * np.pi * k / 8)).real
        # single precision
        np.testing.assert_allclose(frame["displacement"], wanted, atol=1e-6 * size)
        assert frame.points.dtype == np.float32 and frame["amplitude"].max() == pytest.approx(1.0)


@pytest.mark.slow
def test_exported_names_and_files(tmp_path):
    grid = disc_with_pad()
    info = {"parameter": "mu", "value": 0.6, "branch": 7, "mode": 4, "frequency_hz": 2413.2, "re": 12.0, "im": 15162.0}
    name = shape_name(info)
    assert name == "branch_07_mu_0.60_2413Hz"
    assert shape_name({**info, "branch": float("nan"), "parameter": "materials.a/b.E"}) == "mode_04_E_0.60_2413Hz"
    shape = (name, bending(grid, 3), info)
    with exporting_shapes(grid, [shape], tmp_path, frames=4) as files:
        pass
    frames = [tmp_path / f"{name}_frames" / f"{name}_{k:02d}.vtu" for k in range(4)]
    assert files == [tmp_path / f"{name}.vtu", tmp_path / f"{name}.pvd", *frames, tmp_path / f"{name}.png"]
    assert sorted(files) == sorted(p for p in tmp_path.rglob("*") if p.is_file())
    with pytest.raises(ValueError, match="same name"):
        exporting_shapes(grid, [shape, shape], tmp_path, pictures=False).__enter__()


def nodal_changes(picture):
    """Count how often red and blue follow one another around the right view, at 0.8 of its outer radius."""
    red, blue = picture[..., 0].astype(float), picture[..., 2].astype(float)
    half = picture.shape[1] // 2
    coloured = np.abs(red - blue) > 0.15
    coloured[int(0.88 * len(coloured)) :] = False  # the colour bars
    rows, columns = np.nonzero(coloured[:, half:])
    centre = np.array([rows.min() + rows.max(), columns.min() + columns.max()]) / 2
    radius = 0.8 * min(np.ptp(rows), np.ptp(columns)) / 2
    angle = np.linspace(0, 2 * np.pi, 720, endpoint=False)
    at = np.rint(centre + radius * np.column_stack([np.sin(angle), np.cos(angle)])).astype(int)
    difference = (red - blue)[:, half:][at[:, 0], at[:, 1]]
    sign = np.sign(difference[np.abs(difference) > 0.2])
    return np.count_nonzero(sign != np.roll(sign, 1))


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(signal, "SIGPIPE"), reason="a signal of POSIX")
def test_drawing_child_that_dies_at_once_takes_nobody_with_it(tmp_path):
    """Where a library has set SIGPIPE to its default, as gmsh does, a pipe to that child would end this process."""
    code = f"""
import signal, sys
sys.path.insert(0, {str(Path(__file__).parent)!r})
from test_report_shapes import bending, disc_with_pad, pictures, write_shape
from pathlib import Path
grid = disc_with_pad()
file = write_shape(grid, bending(grid, 2), Path(sys.argv[1]) / "mode.vtu")
job = pictures.PictureJob(file, file.with_suffix(".png"), "x" * 200_000)  # more than a pipe holds
signal.signal(signal.SIGPIPE, signal.SIG_DFL)
sys.executable = "/bin/false"
with pictures._child_that_draws([job], 60.0) as finish:
    print(finish())
"""
    done = subprocess.run([sys.executable, "-c", code, tmp_path], capture_output=True, text=True, check=False)
    assert done.returncode == 0 and "ended with code 1" in done.stdout, done.stderr


@pytest.mark.parametrize(("broken", "element"), [
    pytest.param(False, skfem.ElementHex2, marks=pytest.mark.slow),
    pytest.param(False, ElementHex3, marks=pytest.mark.slow), (True, skfem.ElementHex2),
])  # fmt: skip
def test_picture_shows_the_nodal_diameters(tmp_path, monkeypatch, broken, element):
    """With VTK where it can draw, and with the plain fallback where its process dies."""
    grid = disc_with_pad(element=element)
    if broken:
        monkeypatch.setattr(sys, "executable", "/bin/false")
        with pytest.warns(RuntimeWarning, match="ended with code 1"):
            renderer = draw_shape(grid, bending(grid, 3), tmp_path / "mode.png", "branch 7")
        assert renderer == "matplotlib"
    else:
        renderer = draw_shape(grid, bending(grid, 3), tmp_path / "mode.png", "branch 7")
        assert renderer in ("pyvista", "matplotlib")
    picture = image.imread(tmp_path / "mode.png")[..., :3]
    assert nodal_changes(picture) == 6
    left = picture[100:-120, : picture.shape[1] // 2]
    assert np.ptp(left, axis=2).max() > 0.3 and left.std() > 0.1


@pytest.mark.slow
def test_shape_without_nodal_lines(tmp_path, recwarn):
    """A body that tilts, but moves to one side all over, has no nodal line, which VTK's contours end in an error."""
    grid = disc_with_pad()
    tilted = np.zeros(grid.points.shape, dtype=complex)
    tilted[:, 2] = 1.0 + grid.points[:, 0]
    draw_shape(grid, tilted, tmp_path / "mode.png", "branch 7")
    assert not [w for w in recwarn if "ValueError" in str(w.message)]
    assert nodal_changes(image.imread(tmp_path / "mode.png")[..., :3]) == 0


def test_child_that_hangs_is_ended(tmp_path, monkeypatch):
    grid = disc_with_pad()
    file = write_shape(grid, bending(grid, 2), tmp_path / "mode.vtu")
    job = pictures.PictureJob(file, tmp_path / "mode.png", "title")
    with pytest.warns(RuntimeWarning, match="not done after"):
        assert pictures.draw_shapes(grid, [bending(grid, 2)], [job], seconds=0.01) == ["matplotlib"]
    assert nodal_changes(image.imread(job.picture)[..., :3]) == 4
    assert pictures.draw_shapes(grid, [], []) == []


def test_without_a_folder_for_temporary_files(tmp_path, monkeypatch):
    """The child cannot be told what to draw; Matplotlib draws, more plainly."""
    grid = disc_with_pad()
    file = write_shape(grid, bending(grid, 2), tmp_path / "mode.vtu")
    job = pictures.PictureJob(file, tmp_path / "mode.png", "title")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "absent"))
    with pytest.warns(RuntimeWarning, match="no process could be started"):
        assert pictures.draw_shapes(grid, [bending(grid, 2)], [job]) == ["matplotlib"]
    assert nodal_changes(image.imread(job.picture)[..., :3]) == 4


def test_frame_about_an_axis_is_a_rotation():
    for axis in ([0, 0, 1], [0, 0, -3], [1, 0, 0], [0.3, -2, 0.5]):
        frame = axis_frame(axis)
        np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-15)
        assert np.linalg.det(frame) == pytest.approx(1.0)
        np.testing.assert_allclose(frame[2], np.array(axis) / np.linalg.norm(axis))


def test_widest_body_is_the_disc():
    grid = disc_with_pad()
    assert widest_body(grid.points, grid.cells, grid.body) == 0


def viewed(u, grid=None):
    grid = grid or disc_with_pad()
    shape = np.asarray(u(grid.points), dtype=complex)
    shape = shape / np.linalg.norm(shape, axis=1).max()
    return choose_view(grid.points, shape.real, semi_major_amplitude(shape), grid.cells, grid.body, np.eye(3)), grid


@pytest.mark.parametrize(("way", "label"), [
    (lambda x: np.column_stack([-x[:, 1], x[:, 0], 0 * x[:, 0]]), "displacement around the centre"),
    (lambda x: np.column_stack([x[:, 0], x[:, 1], 0 * x[:, 0]]), "displacement away from the centre"),
    (lambda x: np.tile([0.6, 0.8, 0.0], (len(x), 1)), "displacement along (0.6, 0.8, 0)"),
    (lambda x: np.tile([0.6, 0.0, 0.8], (len(x), 1)), "displacement along z"),
])  # fmt: skip
def test_what_is_shown_is_what_moves(way, label):
    """A shape in the plane has dust along the axis, which is not drawn as a pattern."""
    view, _ = viewed(lambda x: way(x) + 1e-3 * np.sin(50 * x[:, :1]) * [0, 0, 1])
    assert view.label == label and view.body == 0 and view.side == 1 and view.limit == pytest.approx(1.0, abs=0.25)


def test_a_body_at_rest_is_not_shown_instead_of_the_one_that_moves():
    grid = disc_with_pad()
    pad = np.isin(np.arange(len(grid.points)), grid.cells[grid.body == 1])
    low = grid.points[pad, 2].min()
    thick = np.ptp(grid.points[pad, 2])

    def held_above(x):
        return np.where(pad, 1 - (x[:, 2] - low) / thick, 1e-6)[:, None] * [0.0, 0.0, 1.0]

    view, _ = viewed(held_above, grid)
    assert view.body == 1 and view.side == -1  # its upper face is held


@pytest.mark.parametrize(("axis", "side", "told"), [
    ((0, 0, 1), 1, "seen from +z"), ((0, 0, 1), -1, "seen from −z"), ((0, -2, 0), 1, "seen from −y"),
    ((0, 3, 4), -1, "seen from (0, -0.6, -0.8)"),
])  # fmt: skip
def test_the_picture_says_from_where_it_is_seen(axis, side, told):
    """The camera stands where the axis points to, or on the other side, and not along the line of sight."""
    view = AxialView(0, np.zeros(1), "displacement along z", 1.0, side)
    _, _, right = compose_figure("brake", "disc", view, axis)
    assert right.get_title() == f"disc, {told}; nodal lines black"
