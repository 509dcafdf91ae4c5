"""Random damage to scenes and files, and what the command may do with the result."""

from __future__ import annotations

import copy
import json
import signal
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from fe_squeal.cli import main

SECONDS = 10.0  # CPU time that the slowest input may take; most take hundredths of a second
Rng = np.random.Generator

ODD = [
    0, -1, 1, 3, 0.0, -0.0, 1e-9, -1e-9, 1e-300, 5e-324, 1e9, -1e9, 1e49, 1e300, 1.7e308, 10**9, 10**18, 2**63,
    -(2**63), 10**30, 10**400, float("nan"), float("inf"), -float("inf"), True, False, "", " ", "x", "0.3", "mu", "é",
    "\0", "\n", "../../x", "/", "..", "a" * 5000, "😀", "\u202e", "rigid", "bottom", "top", [], {}, [[]], [0, 0, 0],
    [1, 0], [1e300] * 3, [1, 2, 3, 4], ["x"], [True, 0, 0], {"x": 1}, [{}], [[1, 0, 0], [1, 0, 0]], 0.49999999, 0.5,
]  # fmt: skip
SNIPPETS = [
    "é", "😀", "\0", "\x1b[31m", "\u202e", "\ufeff", '"', "'", '"""', "[", "]]", "{", "}", "=", ".", ",", "\n", "\r",
    "#", "1e400", "-", "nan", "inf", "0x", "1979-05-27", "[a.b", "[[springs]]\n", "[mesh]\n", "[" * 2000, "{a=" * 300,
    "a." * 3000 + "b = 1\n", "x = 1\n", "true", "1_000", "9" * 5000,
]  # fmt: skip


class TooSlowError(BaseException):
    """An input took too long. It is no Exception, so that no handler of the program catches it."""


@contextmanager
def time_limit(seconds: float = SECONDS) -> Iterator[None]:
    """Raise TooSlowError if the block takes more CPU time of this process, however busy the machine is."""

    def late(*_: object) -> None:
        raise TooSlowError

    before = signal.signal(signal.SIGPROF, late)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)


def dump(data: dict[str, Any]) -> str:
    """Return nested tables as TOML; each inner table is written in one line."""
    return "\n".join(f"{_key(key)} = {_value(value)}" for key, value in data.items()) + "\n"


def _key(key: str) -> str:
    return _text(key)


def _text(text: str) -> str:
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def _value(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{_key(k)} = {_value(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_value(v) for v in value) + "]"
    if isinstance(value, bool):
        return "true" if value else "false"
    return _text(value) if isinstance(value, str) else repr(value)


def places(data: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Return the paths of all entries of nested tables and lists."""
    inner = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    return [place for key, value in inner for place in ((*path, key), *places(value, (*path, key)))]


def holder(data: Any, place: tuple[Any, ...]) -> Any:
    for key in place[:-1]:
        data = data[key]
    return data


def mutated_data(base: dict[str, Any], rng: Rng) -> dict[str, Any]:
    """Return a scene with one to three faults: odd values, and entries that are missing, doubled, renamed or moved."""
    data = copy.deepcopy(base)
    for _ in range(rng.choice([1, 1, 1, 2, 3])):
        known = places(data)
        if not known:
            break
        place = known[rng.integers(len(known))]
        inside, key = holder(data, place), place[-1]
        kind = rng.integers(10)
        if kind < 4:
            inside[key] = copy.deepcopy(ODD[rng.integers(len(ODD))])
        elif kind == 4:
            del inside[key]
        elif kind == 5 and isinstance(inside, dict):
            name = str(key)
            at = int(rng.integers(len(name) + 1))
            names = ["", name[:at] + "x" + name[at:], name.upper(), name[::-1], "é" + name]
            inside[names[rng.integers(len(names))]] = inside.pop(key)
        elif kind == 6:
            other = known[rng.integers(len(known))]
            inside[key] = copy.deepcopy(holder(data, other)[other[-1]])
        elif kind == 7 and isinstance(inside, list):
            inside.append(copy.deepcopy(inside[key]))
        elif kind == 8 and isinstance(inside[key], int | float) and not isinstance(inside[key], bool):
            inside[key] = inside[key] * float(rng.choice([-1, 0, 1e-12, 1e-3, 1e3, 1e12, 1e40])) ** 1.0
        elif kind == 9:
            value: Any = inside[key]
            for _ in range(int(rng.choice([1, 5, 60]))):
                value = [value] if rng.integers(2) else {"a": value}
            inside[key] = value
    return data


def mutated_bytes(base: bytes, rng: Rng) -> bytes:
    """Return the content of a file with some bytes flipped, cut off, doubled, moved, or with other bytes inserted."""
    data = bytearray(base)
    for _ in range(rng.choice([1, 1, 2, 3])):
        at = int(rng.integers(len(data) + 1))
        end = min(len(data), at + int(rng.integers(1, 40)))
        kind = rng.integers(7)
        if kind == 0:
            for i in rng.integers(0, max(len(data), 1), 3):
                if i < len(data):
                    data[i] ^= 1 << int(rng.integers(8))
        elif kind == 1:
            data = data[:at]
        elif kind == 2:
            del data[at:end]
        elif kind == 3:
            data[at:at] = data[at:end]
        elif kind == 4:
            data[at:at] = SNIPPETS[rng.integers(len(SNIPPETS))].encode()
        elif kind == 5:
            lines = bytes(data).split(b"\n")
            i, j = rng.integers(0, len(lines), 2)
            lines[i], lines[j] = lines[j], lines[i]
            data = bytearray(b"\n".join(lines))
        else:
            data[at:end] = bytes(rng.integers(0, 256, end - at, dtype=np.uint8))
    return bytes(data)


def outcome(arguments: list[str], out: Path, capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    """Run the command in this process and hold it to its promises; return exit code and message."""
    capsys.readouterr()
    with time_limit(), warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        code = main(arguments)
    said = capsys.readouterr().err
    assert code in (0, 2, 3), said
    assert "Traceback" not in said
    # The user would see these lines of Python.
    seen = [f"{w.filename}:{w.lineno}: {w.message}" for w in caught]
    assert not [s for s, w in zip(seen, caught, strict=True) if issubclass(w.category, RuntimeWarning | UserWarning)]
    if code == 2:
        assert said.startswith("error: ") and said.count("\n") == 1 and said.endswith("\n"), said
    if code == 3:
        assert said.startswith("not converged: ") and said.count("\n") == 1, said
    if out.exists():
        assert not [p for p in out.rglob("*") if ".partial" in p.name or p.name == ".lock"]
        record = json.loads((out / "run.json").read_text("utf-8"))
        assert record["status"] == {0: "complete", 3: "not converged"}[code]
        if record["values"]:
            table = pd.read_csv(out / "modes.csv")
            assert set(table["value"]) <= set(record["values"])
            assert np.isfinite(table[["re", "im", "value"]].astype(float).to_numpy()).all()
    return code, said


def growth_of_memory(peak: Callable[[], float | None], before: float | None) -> float:
    """Return the MiB by which the peak has risen; 0 where the system does not tell."""
    now = peak()
    return 0.0 if now is None or before is None else now - before


needs_timer = pytest.mark.skipif(sys.platform == "win32", reason="no interval timers")
