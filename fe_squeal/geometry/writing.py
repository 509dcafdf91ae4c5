"""Mesh a parametric geometry, into memory or into a gmsh file."""

from __future__ import annotations

import os
import secrets
from pathlib import Path

from fe_squeal.errors import MeshError, OutputError
from fe_squeal.geometry.block import Block
from fe_squeal.geometry.disc_pad import DiscPad
from fe_squeal.geometry.grouped import GroupedMesh, as_raw
from fe_squeal.geometry.msh_file import is_ours, mark_as_ours, write_msh
from fe_squeal.geometry.structured import structured_block, structured_disc_pad
from fe_squeal.geometry.tetrahedra import mesh_tetrahedra, write_tetrahedra
from fe_squeal.mesh.raw import RawMesh

# More than the solvers can take. A size in the wrong unit would ask for thousands of times more and fill the memory.
MAX_ELEMENTS = 3_000_000


def make_mesh(geometry: DiscPad | Block) -> RawMesh:
    """Return the mesh of a geometry, in its own unit of length: the mesh that `write_mesh` would write to a file.

    Raises
    ------
    MeshError
        The size asks for too many elements; or, with element = "tet", gmsh cannot be loaded or fails.

    Examples
    --------
    >>> make_mesh(Block(length=0.08, width=0.04, height=0.015, size=0.01)).points.shape
    (135, 3)
    """
    _check_number_of_elements(geometry)
    if geometry.element == "tet":
        return mesh_tetrahedra(geometry)
    return as_raw(_structured(geometry))


def write_mesh(geometry: DiscPad | Block, path: str | os.PathLike[str], keep_others: bool = False) -> Path:
    """Mesh a geometry and write it as a gmsh .msh file (version 4.1, text), in the geometry's own unit of length.

    The same geometry gives the same bytes each time. An older file of this name is replaced when the new one is
    complete.

    Parameters
    ----------
    geometry : DiscPad or Block
    path : str or path-like
        The file to write, with the suffix .msh, in an existing folder.
    keep_others : bool
        Whether to refuse to replace a file that this function did not write.

    Returns
    -------
    path : Path
        Where the mesh was written.

    Raises
    ------
    OutputError
        The name does not end in .msh, the file cannot be written, or `keep_others` forbids to replace it.
    MeshError
        The size asks for too many elements; or, with element = "tet", gmsh cannot be loaded or fails.

    Examples
    --------
    >>> import tempfile
    >>> block = Block(length=0.08, width=0.04, height=0.015, size=0.01)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_mesh(block, Path(folder) / "block.msh").name
    'block.msh'
    """
    path = Path(path)
    if path.suffix != ".msh":
        raise OutputError(f"{path}: a mesh is written as a gmsh file; expected a name that ends in .msh")
    if not path.parent.is_dir():
        raise OutputError(f"{path}: there is no folder {path.parent}; make it first")
    if keep_others and path.exists() and not _may_replace(path):
        raise OutputError(f"{path}: there is a file that fe-squeal mesh did not write; give another (-o) or --force")
    _check_number_of_elements(geometry)
    # The name of the partial file is random, so that it is no file that exists already, and ends in .msh, since gmsh
    # chooses the format by the ending.
    partial = path.with_name(f".{path.stem}.{secrets.token_hex(8)}.partial.msh")
    try:
        partial.touch(exist_ok=False)  # a folder that cannot be written is found before the meshing, not after it
        if geometry.element == "tet":
            write_tetrahedra(geometry, partial)
            mark_as_ours(partial)
        else:
            write_msh(_structured(geometry), partial)
        os.replace(partial, path)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror or error})") from error
    finally:
        partial.unlink(missing_ok=True)
    return path


def _structured(geometry: DiscPad | Block) -> GroupedMesh:
    return structured_disc_pad(geometry) if isinstance(geometry, DiscPad) else structured_block(geometry)


def _may_replace(path: Path) -> bool:
    try:
        return path.stat().st_size == 0 or is_ours(path)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror or error})") from error


def _check_number_of_elements(geometry: DiscPad | Block) -> None:
    # A regular tetrahedron of edge a has the volume a^3 / (6 sqrt 2).
    elements = geometry.cells * (8.5 if geometry.element == "tet" else 1.0)
    if elements > MAX_ELEMENTS:
        raise MeshError(
            f"size = {geometry.edge_length:g} makes about {elements:.2g} elements, and at most {MAX_ELEMENTS:.2g} are "
            "meshed; choose a larger size (in the same unit as the other lengths) or fewer layers"
        )
