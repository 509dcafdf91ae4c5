"""Reading a matrix by the suffix of its file."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
from scipy import sparse

from ...errors import SceneError, suggest
from .checks import checked, in_a_line, refuse_size
from .matlab import read_matlab
from .matrix_market import read_matrix_market, unpacked
from .numpy_files import read_array, read_scipy_sparse

_KINDS = {
    ".mtx": "Matrix Market", ".mtx.gz": "Matrix Market", ".npz": "SciPy sparse", ".npy": "NumPy", ".mat": "MATLAB",
}  # fmt: skip


def read_matrix(path: Path, variable: str | None = None) -> sparse.csr_array:
    """Read one real square matrix that another program exported. Nothing in the file is executed or unpickled.

    Parameters
    ----------
    path
        .mtx or .mtx.gz (Matrix Market), .npz (scipy.sparse.save_npz), .npy (a dense array) or .mat (MATLAB up to -v7).
    variable
        The matrix's name in a .mat file; not needed where the file holds one numeric matrix.

    Returns
    -------
    csr_array
        float64 with sorted indices. Entries given more than once are summed, as all Matrix Market readers do, the
        other triangle of symmetric and skew-symmetric files is filled in, and explicit zeros are dropped.

    Raises
    ------
    SceneError
        Whatever is wrong with the file, in one line.

    Examples
    --------
    >>> import tempfile
    >>> from fe_squeal.assembly.matrix_files import measure_symmetry
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = Path(folder, "damping.npy")
    ...     np.save(file, [[2.0, -1.0], [-1.0, 0.0]])
    ...     matrix = read_matrix(file)
    >>> matrix.toarray().tolist(), matrix.nnz, measure_symmetry(matrix)
    ([[2.0, -1.0], [-1.0, 0.0]], 3, 'symmetric')
    """
    path, source = Path(path), Path(path).name
    kind = next((suffix for suffix in _KINDS if source.lower().endswith(suffix)), None)
    try:
        if path.is_dir():
            raise SceneError(f"{path}: this is a folder; expected a matrix file ({', '.join(_KINDS)})")
        if not path.is_file():
            near = [p.name for p in path.parent.iterdir() if p.is_file()] if path.parent.is_dir() else []
            raise SceneError(f"{path}: no such matrix file" + (suggest(source, near) if near else ""))
        if kind is None:
            raise SceneError(
                f'{source}: no matrix format is known by the suffix "{path.suffix}"; expected one of '
                + ", ".join(_KINDS)
            )
        if variable is not None and kind != ".mat":
            raise SceneError(f'{source}: only a .mat file has variables; leave out variable "{variable}"')
        refuse_size(path.stat().st_size, source)
        data = path.read_bytes()
    except (OSError, ValueError) as error:  # a ValueError: the path itself has a null character
        raise SceneError(f"{path}: the file cannot be read ({getattr(error, 'strerror', '') or error})") from error
    if not data:
        raise SceneError(f"{source}: the file is empty; expected a {_KINDS[kind]} file")
    try:
        # From memory, since a read from there returns what there is, whatever size a damaged header asks for.
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            return checked(_read(kind, data, variable, source), source)
    except SceneError:
        raise
    except MemoryError as error:
        raise SceneError(f"{source}: reading takes more memory than there is; is the file damaged?") from error
    except Exception as error:  # the readers stop at damaged files with almost any exception
        reason = in_a_line(str(error).split(";")[0]) or type(error).__name__
        raise SceneError(f"{source}: not a readable {_KINDS[kind]} file ({reason}); export it again") from error


def _read(kind: str, data: bytes, variable: str | None, source: str) -> Any:
    if kind == ".npz":
        return read_scipy_sparse(data, source)
    if kind == ".npy":
        return read_array(data, source, "iufc")
    if kind == ".mat":
        return read_matlab(data, variable, source)
    return read_matrix_market(unpacked(data, source) if kind == ".mtx.gz" else data, source)
