"""Read and check a mesh file; its suffix decides which reader takes it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from fe_squeal.eigen.memory import available_memory, memory_text
from fe_squeal.errors import MeshError, suggest

from .building import build_mesh
from .groups import LoadedMesh
from .raw import RawMesh
from .readers.abaqus.read import read_abaqus
from .readers.ansys import read_ansys
from .readers.gmsh import read_gmsh
from .readers.nastran.deck import read_nastran
from .readers.others import read_with_meshio
from .readers.sources import Sources
from .readers.unv import read_unv

UNITS = {"m": 1.0, "mm": 1e-3}
_READERS: dict[str, Callable[[Sources], RawMesh]] = {
    ".inp": read_abaqus, ".msh": lambda sources: read_gmsh(sources.path),
    ".cdb": read_ansys, ".unv": read_unv,
    ".bdf": read_nastran, ".nas": read_nastran, ".dat": read_nastran, ".fem": read_nastran, ".blk": read_nastran,
}  # fmt: skip


def load_mesh(
    path: str | Path, length_unit: str = "m", folders: Sequence[str | Path] = (), allow_outside: bool = False
) -> LoadedMesh:
    """Read a mesh file and check it.

    Parameters
    ----------
    path : str or Path
        .msh (Gmsh 2.2, 4.0, 4.1), .inp (Abaqus), .cdb (Ansys), .bdf, .nas, .dat, .fem (Nastran), .unv (universal
        files), .vtu, .vtk, .xdmf, .med or whatever else meshio reads, but no Exodus file.
    length_unit : "m" or "mm"
        The unit of the file's coordinates.
    folders : sequence of str or Path
        Folders in which, and below which, files that the mesh file includes may lie, besides its own folder.
    allow_outside : bool
        Whether these files may lie anywhere.

    Returns
    -------
    LoadedMesh
        With coordinates in metres.

    Raises
    ------
    MeshError
        The file cannot be read, its elements are flat, inverted or broken, or its groups do not fit them: what is wrong
        and how to mend it, in one sentence.

    Examples
    --------
    >>> import tempfile
    >>> text = '''*NODE
    ... 1, 0., 0., 0.
    ... 2, 60., 0., 0.
    ... 3, 0., 60., 0.
    ... 4, 0., 0., 60.
    ... *ELEMENT, TYPE=C3D4, ELSET=PAD
    ... 1, 1, 2, 3, 4
    ... *SURFACE, NAME=BACK
    ... PAD, S1
    ... '''
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = Path(folder, "pad.inp").write_text(text)
    ...     loaded = load_mesh(Path(folder, "pad.inp"), length_unit="mm")
    >>> float(loaded.mesh.p.max().round(6)), list(loaded.mesh.subdomains), list(loaded.mesh.boundaries)
    (0.06, ['PAD'], ['BACK'])
    """
    path = Path(path)
    if length_unit not in UNITS:
        raise MeshError(f'{path.name}: length_unit "{length_unit}" is not known{suggest(length_unit, UNITS)}')
    return build_mesh(read_raw(path, folders, allow_outside), path.name, UNITS[length_unit])


def read_raw(path: Path, folders: Sequence[str | Path] = (), allow_outside: bool = False) -> RawMesh:
    """Return the mesh as its file gives it, without checks, so that its groups are known even if elements are bad.

    Raises
    ------
    MeshError
        The file cannot be read as a mesh.
    """
    with guarded_reading(path):
        sources = Sources(path, tuple(map(Path, folders)), allow_outside)
        return _READERS.get(path.suffix.lower(), read_with_meshio)(sources)


def _is_mesh(path: Path) -> bool:
    import meshio

    return path.is_file() and path.suffix.lower() in {*_READERS, *meshio.extension_to_filetypes}


@contextmanager
def guarded_reading(path: Path) -> Iterator[None]:
    """Check that a mesh file can be read before the block reads it, and turn errors of the block into one sentence.

    Raises
    ------
    MeshError
        The file does not exist, is empty, larger than the free memory, or cannot be read.
    """
    try:
        if path.is_dir():
            raise MeshError(f"{path}: this is a folder; expected a mesh file")
        if not path.is_file():
            near = sorted(p.name for p in path.parent.iterdir() if _is_mesh(p)) if path.parent.is_dir() else []
            raise MeshError(f"{path}: no such mesh file" + (suggest(path.name, near) if near else ""))
        if path.stat().st_size == 0:
            raise MeshError(f"{path.name}: the file is empty; expected a mesh")
        size, free = path.stat().st_size, available_memory()
        if size > free:
            raise MeshError(f"{path.name}: has {memory_text(size)}, and {memory_text(free)} are free")
        with np.errstate(all="ignore"):  # `build_mesh` refuses numbers that are not finite, and names the node
            yield
    except OSError as error:
        raise MeshError(f"{path}: the file cannot be read ({error.strerror or error})") from error
    except MemoryError as error:
        raise MeshError(
            f"{path.name}: the file asks for more memory than there is; it is damaged or too large"
        ) from error
