"""Files of shapes and of the preload as other programs read them: meshio beside pyvista (whose VTK is ParaView's)."""

import meshio
import numpy as np
import pytest
import pyvista
import skfem

from fe_squeal.report.contact_face import ContactFace
from fe_squeal.report.preload import export_preload
from fe_squeal.report.shapes import normalise_shape, shape_grid
from fe_squeal.report.vtk_files import names_in, write_animation, write_shape

ELEMENTS = {
    "hexahedron": (skfem.MeshHex, skfem.ElementHex1), "hexahedron27": (skfem.MeshHex, skfem.ElementHex2),
    "tetra": (skfem.MeshTet, skfem.ElementTetP1), "tetra10": (skfem.MeshTet, skfem.ElementTetP2),
}  # fmt: skip
NAMES = ("disc", "Bremsbelag äußen <1>")
INFO = {"parameter": "springs.Führung.damping", "value": 0.3, "mode": 3, "branch": 5, "re": 1.5, "frequency_hz": 2e3}


def grid_of(kind, refined):
    mesh, element = ELEMENTS[kind]
    mesh = mesh().refined(refined)
    body = (np.arange(mesh.nelements) >= mesh.nelements // 2).astype(int)
    return shape_grid(skfem.CellBasis(mesh, element()), body, NAMES)


def shape_on(grid, seed=0):
    rng = np.random.default_rng(seed)
    return rng.normal(size=grid.points.shape) + 1j * rng.normal(size=grid.points.shape)


@pytest.mark.parametrize("kind", ELEMENTS)
@pytest.mark.parametrize("refined", [0, 3])
def test_shapes_in_meshio_and_pyvista(kind, refined, tmp_path):
    """Large enough, refined, that arrays take several blocks of the compressed file."""
    grid = grid_of(kind, refined)
    u = shape_on(grid)
    path = write_shape(grid, u, tmp_path / "shape.vtu", INFO)
    by_meshio, by_pyvista = meshio.read(path), pyvista.read(path)
    shape = normalise_shape(u)
    assert [block.type for block in by_meshio.cells] == [kind]
    np.testing.assert_array_equal(by_meshio.points, grid.points)
    np.testing.assert_array_equal(by_meshio.cells[0].data, grid.cells)
    np.testing.assert_array_equal(by_meshio.cell_data["body"][0], grid.body)
    for read in (by_meshio.point_data, by_pyvista.point_data):
        np.testing.assert_array_equal(read["u_re"] + 1j * read["u_im"], shape)
    np.testing.assert_array_equal(by_pyvista.cells_dict[by_pyvista.celltypes[0]], grid.cells)
    for read in (by_meshio.field_data, by_pyvista.field_data):
        assert [int(read[f"body: {name}"][0]) for name in NAMES] == [0, 1]
        assert read["value"][0] == 0.3 and read["mode"][0] == 3 and "parameter: springs.Führung.damping" in read
    assert names_in(by_pyvista, "body") == list(NAMES)


def test_frames_in_meshio_and_pyvista(tmp_path):
    grid = grid_of("tetra10", 2)
    for frame in write_animation(grid, shape_on(grid), tmp_path / "a.pvd", frames=3)[1:]:
        np.testing.assert_array_equal(
            meshio.read(frame).point_data["displacement"], pyvista.read(frame).point_data["displacement"]
        )


def test_preload_in_meshio_and_pyvista(tmp_path):
    grid = grid_of("hexahedron27", 2)
    one = np.ones(4)
    face = ContactFace(
        np.arange(12.0).reshape(4, 3), np.tile([0, 0, 1.0], (4, 1)), np.tile([1.0, 0, 0], (4, 1)), one, 1e5 * one,
        one > 0, 4e5, np.nan,
    )  # fmt: skip
    files = export_preload(grid, shape_on(grid).real, {"pad 1": face, "pad 2": face}, tmp_path, mu=0.4, picture=False)
    for path in files:
        read = meshio.read(path)
        assert int(read.field_data["contact: pad 2"][0]) == 1
        np.testing.assert_array_equal(read.points, pyvista.read(path).points)
    assert meshio.read(files[0]).field_data["mu"][0] == 0.4
    assert meshio.read(files[1]).point_data["contact_pressure"].max() == 1e5
