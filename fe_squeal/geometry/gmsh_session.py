"""Import gmsh only where it is needed, and leave a session of the caller's as it was."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import ModuleType

from fe_squeal.errors import MeshError

# Shared libraries that the gmsh wheel for Linux needs and does not contain (those that libgmsh.so.4.15 lists as
# NEEDED), with their Debian and Ubuntu packages.
_PACKAGES = {
    "libGLU.so.1": "libglu1-mesa",
    "libGL.so.1": "libgl1",
    "libXft.so.2": "libxft2",
    "libXcursor.so.1": "libxcursor1",
    "libXinerama.so.1": "libxinerama1",
    "libXrender.so.1": "libxrender1",
    "libXfixes.so.3": "libxfixes3",
    "libXext.so.6": "libxext6",
    "libX11.so.6": "libx11-6",
    "libfontconfig.so.1": "libfontconfig1",
    "libgomp.so.1": "libgomp1",
}


def import_gmsh() -> ModuleType:
    """Return the gmsh module.

    Raises
    ------
    MeshError
        gmsh is not installed, or a library of the system that it needs is missing; the message says what to install.
    """
    try:
        import gmsh
    except ImportError as error:
        raise MeshError(
            f'gmsh cannot be imported ({error}): `pip install gmsh`, or mesh with element = "hex", which needs no gmsh'
        ) from error
    except OSError as error:
        first = next((package for library, package in _PACKAGES.items() if library in str(error)), "libglu1-mesa")
        # The loader names only the first missing library; on a bare machine these others are missing too.
        others = [p for p in ("libglu1-mesa", "libxft2", "libxcursor1", "libxinerama1") if p != first]
        raise MeshError(
            f"gmsh cannot be loaded ({error}): on Debian or Ubuntu `apt-get install {first}` "
            f'(on a bare machine also {" ".join(others)}), or mesh with element = "hex", which needs no gmsh'
        ) from error
    return gmsh


@contextmanager
def gmsh_model(name: str, options: dict[str, float]) -> Iterator[ModuleType]:
    """Open a new gmsh model with some options for the block; afterwards remove it and restore the options.

    If the caller had initialised gmsh, it stays initialised with the caller's current model; otherwise it is finalised.

    Parameters
    ----------
    name : str
        Name of the model.
    options : dict of str to float
        gmsh's numeric options, such as "Mesh.Algorithm".

    Raises
    ------
    MeshError
        gmsh cannot be imported.
    """
    gmsh = import_gmsh()
    ours = not gmsh.isInitialized()
    if ours:
        # The user's .gmshrc is not read, since it could change the mesh. Ctrl-C stays with Python.
        with _unchanged_signals():
            gmsh.initialize([], readConfigFiles=False, interruptible=False)
    try:
        previous = gmsh.model.getCurrent()
        saved = {key: gmsh.option.getNumber(key) for key in options}
        gmsh.model.add(name)
        try:
            for key, value in options.items():
                gmsh.option.setNumber(key, value)
            yield gmsh
        finally:
            gmsh.model.setCurrent(name)
            gmsh.model.remove()
            for key, value in saved.items():
                gmsh.option.setNumber(key, value)
            if previous in gmsh.model.list():
                gmsh.model.setCurrent(previous)
    finally:
        if ours:
            gmsh.finalize()


@contextmanager
def _unchanged_signals() -> Iterator[None]:
    """Restore the handler of SIGPIPE after the block: gmsh resets it, and a broken pipe would then end the process."""
    name = getattr(signal, "SIGPIPE", None)  # Windows has none
    before = None if name is None else signal.getsignal(name)
    yield
    if name is not None and before is not None:
        with suppress(ValueError):  # only the main thread may
            signal.signal(name, before)
