"""Matrices that other programs exported: every format read exactly, everything else refused in one line."""

from __future__ import annotations

import gzip
import io
import struct
from pathlib import Path

import numpy as np
import pytest
from scipy import io as scipy_io
from scipy import sparse

from fe_squeal.assembly.matrix_files import measure_symmetry, read_matrix
from fe_squeal.errors import SceneError

RNG = np.random.default_rng(7)
GENERAL = np.where(RNG.random((8, 8)) < 0.4, RNG.standard_normal((8, 8)), 0.0)
SYMMETRIC, SKEW = GENERAL + GENERAL.T, GENERAL - GENERAL.T
BY_KIND = {"general": GENERAL, "symmetric": SYMMETRIC, "skew-symmetric": SKEW}
HEAD = "%%MatrixMarket matrix coordinate real general\n"


def write(path: Path, A: np.ndarray, layout: str = "csc", **options: object) -> Path:
    """Write a matrix in the format of the suffix."""
    name = path.name.lower()
    if ".mtx" in name:
        stream = io.BytesIO()
        scipy_io.mmwrite(stream, sparse.coo_array(A) if layout != "dense" else A, **options)
        path.write_bytes(gzip.compress(stream.getvalue()) if name.endswith(".gz") else stream.getvalue())
    elif name.endswith(".npz"):
        sparse.save_npz(path, getattr(sparse, f"{layout}_array")(A), **options)
    elif name.endswith(".npy"):
        np.save(path, A)
    else:
        scipy_io.savemat(path, {"K": A if layout == "dense" else sparse.csc_array(A), "title": "pad"}, **options)
    return path


def refusal(path: Path, variable: str | None = None) -> str:
    with pytest.raises(SceneError) as caught:
        read_matrix(path, variable)
    message = str(caught.value)
    assert message.isprintable() and path.name in message and len(message) < 400 and caught.value.exit_code == 2
    return message


def text_file(folder: Path, text: str | bytes, name: str = "a.mtx") -> Path:
    (folder / name).write_bytes(text.encode() if isinstance(text, str) else text)
    return folder / name


@pytest.mark.parametrize("kind", BY_KIND)
@pytest.mark.parametrize(("name", "layout"), [("a.mtx", "coo"), ("a.mtx.gz", "coo"), ("A.MTX", "dense")])
def test_matrix_market(tmp_path, name, layout, kind):
    path = write(tmp_path / name, BY_KIND[kind], layout, symmetry=kind)
    assert np.array_equal(read_matrix(path).toarray(), BY_KIND[kind])


@pytest.mark.parametrize(
    ("name", "layout", "options"),
    [
        *((f"{layout}.npz", layout, {"compressed": layout != "csc"}) for layout in ("csr", "csc", "coo", "dia", "bsr")),
        ("a.npy", "dense", {}),
        *(("a.mat", layout, {"do_compression": packed}) for layout in ("csc", "dense") for packed in (False, True)),
        ("a.mat", "csc", {"format": "4"}),
        ("a.mat", "dense", {"format": "4"}),
    ],
)
@pytest.mark.parametrize("dtype", [np.float64, np.float32, np.int32])
def test_binary_formats(tmp_path, name, layout, options, dtype):
    A = (GENERAL * 8).astype(dtype)
    result = read_matrix(write(tmp_path / name, A, layout, **options))
    assert np.array_equal(result.toarray(), A)
    assert isinstance(result, sparse.csr_array) and result.dtype == np.float64
    assert result.has_sorted_indices and np.all(result.data != 0) and result.nnz == np.count_nonzero(A)


def test_other_writers(tmp_path):
    np.save(tmp_path / "a.npy", np.asfortranarray(GENERAL.astype(">f8")))
    assert np.array_equal(read_matrix(tmp_path / "a.npy").toarray(), GENERAL)
    big_endian = struct.pack(">5i", 1000, 2, 2, 0, 2) + b"K\0" + np.arange(4, dtype=">f8").tobytes()
    assert read_matrix(text_file(tmp_path, big_endian, "b.mat")).toarray().tolist() == [[0, 2], [1, 3]]
    entries = "% of Fortran\r\n\r\n 3 3 6\r\n1 1 1.5D+03\r\n 2 3 -1\r\n2 3 .25\r\n3 1 2\r\n3 1 -2\r\n1 2 0\r\n"
    result = read_matrix(text_file(tmp_path, HEAD + entries))
    assert result.toarray().tolist() == [[1500, 0, 0], [0, 0, -0.75], [0, 0, 0]] and result.nnz == 2
    upper = HEAD.replace("general", "symmetric") + "2 2 1\n1 2 5\n"
    assert read_matrix(text_file(tmp_path, upper)).toarray().tolist() == [[0, 5], [5, 0]]
    assert read_matrix(text_file(tmp_path, HEAD + "4 4 0\n")).shape == (4, 4)
    assert read_matrix(text_file(tmp_path, HEAD.replace("real", "integer") + "1 1 1\n1 1 7\n")).data.tolist() == [7]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1 2 3\n", 'begins with "1 2 3"; expected "%%MatrixMarket'),
        (HEAD.replace("real", "complex") + "1 1 1\n1 1 1 1\n", "two terms, the latter with imaginary = true"),
        (HEAD.replace("real", "pattern") + "1 1 1\n1 1\n", '"pattern"; expected one of real, integer'),
        (HEAD.replace("general", "hermitian") + "1 1 0\n", '"hermitian"; expected one of general, symmetric, skew-'),
        (HEAD, "is not the line of the sizes"),
        (HEAD + "2 3 1\n1 1 1\n", "of 2x3; expected a square one"),
        (HEAD + "0 0 0\n", "of 0x0, empty"),
        (HEAD + "1000000000000 1000000000000 1\n1 1 1\n", "more than 20000000"),
        (HEAD + "2 2 1000000000000\n1 1 1\n", "promises 1000000000000 entries, the file holds 1; is it truncated?"),
        (HEAD.replace("coordinate", "array") + "9000000 9000000\n1\n", "entries, the file holds 1"),
        (HEAD + "2 2 1\n3 1 1\n", "whole numbers from 1 to 2"),
        (HEAD + "2 2 1\n1.5 1 1\n", "whole numbers from 1 to 2"),
        (HEAD + "2 2 1\n1 1 1.5x\n", "'1.5x'"),
        (HEAD + "2 2 1\n1 1 1 1\n", "4 numbers per entry"),
        (HEAD + "2 2 3\n1 2 1\n2 1 nan\n2 2 1e999\n", "2 of 3 entries are not finite, the first, nan, in row 2, col"),
        (HEAD.replace("general", "symmetric") + "2 2 2\n1 2 1\n2 1 1\n", "both (1, 2) and (2, 1) are given"),
        (HEAD.replace("general", "skew-symmetric") + "2 2 1\n2 2 1\n", "the diagonal entry of row 2 is not zero"),
    ],
)  # fmt: skip
def test_refused_matrix_market(tmp_path, text, message):
    assert message in refusal(text_file(tmp_path, text))


def test_refused_paths(tmp_path):
    path = write(tmp_path / "damping.npy", GENERAL)
    assert 'no such matrix file; did you mean "damping.npy"?' in refusal(tmp_path / "dampin.npy")
    assert "this is a folder" in refusal(tmp_path)
    assert "the file is empty" in refusal(text_file(tmp_path, "", "e.mat"))
    assert '".csv"; expected one of .mtx, .mtx.gz, .npz, .npy, .mat' in refusal(text_file(tmp_path, "1", "a.csv"))
    assert 'leave out variable "K"' in refusal(path, "K")
    wrong = {"one row of 8 numbers": GENERAL[0], "3x8": GENERAL[:3], "imaginary = true": 1j * GENERAL}
    for message, array in {**wrong, '"bool"': GENERAL > 0, "empty": np.zeros((0, 0))}.items():
        np.save(tmp_path / "b.npy", array)
        assert message in refusal(tmp_path / "b.npy")


def test_mat_variables(tmp_path):
    path = tmp_path / "export.mat"
    no_matrices = {"s": {"a": 1}, "c": np.array([1, "x"], dtype=object), "t": "pad"}
    scipy_io.savemat(path, {"K": SYMMETRIC, "D": GENERAL, "z": 1j * SKEW, **no_matrices})
    assert np.array_equal(read_matrix(path, "D").toarray(), GENERAL)
    assert "several matrices; name one by variable: K (8x8 double), D (8x8 double)" in refusal(path)
    assert 'no variable "k"' in refusal(path, "k") and "valid: D, K, c, s, t, z" in refusal(path, "stiff")
    assert "s (1x1 struct) is not a numeric matrix; valid: D, K, z" in refusal(path, "s")
    assert "c (1x2 cell)" in refusal(path, "c") and "imaginary = true" in refusal(path, "z")
    scipy_io.savemat(path, no_matrices)
    assert "holds no numeric matrix: s (1x1 struct), c (1x2 cell), t (1x3 char)" in refusal(path)
    data = bytearray(write(path, GENERAL).read_bytes())
    for code, kind in ((3, "object"), (16, "function"), (17, "opaque")):
        data[144] = code
        assert kind in refusal(text_file(tmp_path, bytes(data), "b.mat"), None)
    hdf = b"MATLAB 7.3 MAT-file".ljust(124) + b"\0\2IM" + bytes(384) + b"\x89HDF\r\n\x1a\n"
    assert "save it with -v7" in refusal(text_file(tmp_path, hdf, "c.mat"))
    data = bytearray(write(path, GENERAL).read_bytes())
    at = data.index(struct.pack("<2I", 9, 8 * np.count_nonzero(GENERAL)))
    struct.pack_into("<I", data, at, 0x3509)  # at which scipy.io.loadmat crashes
    assert "numbers of the type" in refusal(text_file(tmp_path, bytes(data), "d.mat"), "K")


@pytest.mark.parametrize(
    ("layout", "lies"),
    [
        ("csr", {"indices": [0, 1, 9]}), ("csr", {"indices": [0, -1, 1]}), ("csr", {"indptr": [0, 2, 1, 3]}),
        ("csr", {"indptr": [0, 2, 3, 0]}), ("csr", {"indptr": [0, 2, 3, -(2**63)]}), ("csr", {"indptr": [0, 1, 2, 9]}),
        ("csc", {"indptr": [0, 3]}), ("csc", {"shape": [3, 10**12]}), ("csr", {"shape": [10**12, 10**12]}),
        ("coo", {"row": [0, 1, 5]}), ("coo", {"col": [0, -1, 2]}), ("coo", {"row": [0.0, 1.0, 2.0]}),
        ("dia", {"offsets": [0, 1]}), ("bsr", {"indices": [0, 1, 9]}), ("csr", {"format": b"lil"}),
    ],
)  # fmt: skip
def test_lying_npz(tmp_path, layout, lies):
    sparse.save_npz(tmp_path / "a.npz", getattr(sparse, f"{layout}_array")(np.diag([1.0, 2.0, 3.0])))
    with np.load(tmp_path / "a.npz") as archive:
        np.savez(tmp_path / "b.npz", **{**archive, **{name: np.array(value) for name, value in lies.items()}})
    refusal(tmp_path / "b.npz")


class Trap:
    """Makes a file when it is unpickled."""

    def __init__(self, marker: Path) -> None:
        self.marker = marker

    def __reduce__(self) -> tuple[object, tuple[Path]]:
        return Path.touch, (self.marker,)


def test_nothing_is_unpickled(tmp_path):
    marker = tmp_path / "sprung"
    trap = np.array([[Trap(marker)]], dtype=object)
    np.save(tmp_path / "a.npy", trap)
    np.savez(tmp_path / "a.npz", format="csr", shape=[1, 1], data=trap, indices=[0], indptr=[0, 1])
    np.savez(tmp_path / "b.npz", format=trap, shape=[1, 1], data=[1.0], indices=[0], indptr=[0, 1])
    for name in ("a.npy", "a.npz", "b.npz"):
        assert "Python objects (pickled), which are never read" in refusal(tmp_path / name)
    assert not marker.exists()
    np.load(tmp_path / "a.npy", allow_pickle=True)
    assert marker.exists()  # the trap is one
    np.savez(tmp_path / "c.npz", K=GENERAL)
    assert "saved with scipy.sparse.save_npz" in refusal(tmp_path / "c.npz")


@pytest.mark.parametrize(
    ("name", "layout", "options"),
    [
        ("a.mtx", "coo", {"symmetry": "symmetric"}), ("a.mtx", "dense", {}), ("a.mtx.gz", "coo", {}), ("a.npy", "", {}),
        ("a.npz", "csr", {"compressed": False}), ("a.npz", "coo", {}), ("a.mat", "csc", {"do_compression": True}),
        ("a.mat", "csc", {}), ("a.mat", "dense", {}), ("a.mat", "csc", {"format": "4"}), ("a.mat", "", {"format": "4"}),
    ],
)  # fmt: skip
def test_damaged(tmp_path, name, layout, options):
    path = write(tmp_path / name, SYMMETRIC, layout, **options)
    data, rng, refused = path.read_bytes(), np.random.default_rng(3), 0
    for round_ in range(120):
        bad = bytearray(data)
        if round_ % 3 == 0:
            del bad[len(bad) * round_ // 120 :]
        for at in rng.integers(0, len(data), round_ % 5):
            if at < len(bad):
                bad[at] = rng.integers(256) if round_ % 2 else rng.choice(list(b"0123456789-. \n\xffeD"))
        path.write_bytes(bytes(bad))
        try:
            result = read_matrix(path)
        except SceneError as error:
            assert str(error).isprintable()
            refused += 1
        else:
            result.check_format(full_check=True)
            assert result.shape[0] == result.shape[1] > 0 and np.isfinite(result.data).all()
    assert refused > 30


def test_symmetry():
    noise = 1 + 2e-16 * RNG.integers(-2, 3, (8, 8))
    scale = np.diag(10.0 ** np.arange(-12, 12, 3))  # as between translations and rotations
    for A, expected in ((SYMMETRIC, "symmetric"), (SKEW, "skew"), (GENERAL, "general"), (0 * SKEW, "symmetric")):
        for B in (A, A * noise, scale @ A @ scale, 1e300 * A, 1e-290 * A):
            assert measure_symmetry(sparse.csr_array(B)) == expected
    penalty = np.diag([1e20, 0, 0]) + np.array([[0, 0, 0], [0, 0, 1e3], [0, -2e3, 1e3]])
    assert measure_symmetry(sparse.csr_array(penalty)) == "general"
    cancelled = np.array([[1e9, 1e-8], [0, 1e9]])  # what is left of a sum of stiffnesses
    assert measure_symmetry(sparse.csr_array(cancelled)) == "symmetric"
    assert measure_symmetry(sparse.csr_array(cancelled * [[1, 1e6], [1, 1]])) == "general"
