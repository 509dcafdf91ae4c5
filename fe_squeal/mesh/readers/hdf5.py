"""Check XDMF and HDF5 files before they are read, since their libraries follow references to any other file."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from fe_squeal.eigen.memory import available_memory, memory_text
from fe_squeal.errors import MeshError

from .sources import Sources

_MOST_OBJECTS = 100_000  # arrays and groups in a file: with more it is refused


def check_references(sources: Sources) -> None:
    """Check that a file refers to no data outside of the allowed folders, and has no array larger than the free memory.

    Raises
    ------
    MeshError
        Such a reference or array, or more than `_MOST_OBJECTS` arrays and groups.
    """
    path, source = sources.path, sources.path.name
    if path.suffix.lower() in (".xdmf", ".xmf"):
        for item in ElementTree.parse(path).iter("DataItem"):
            kind = item.get("Format", "XML").upper()
            if kind in ("HDF", "BINARY") and item.text:
                text = item.text.strip()
                name = text.rpartition(":")[0] if kind == "HDF" and ":" in text else text
                target = sources.find(name, path, "DataItem")
                if kind == "HDF":
                    _check_hdf5(target, source)
    elif _is_hdf5(path):
        _check_hdf5(path, source)


def _is_hdf5(path: Path) -> bool:
    with path.open("rb") as file:
        return file.read(8) == b"\x89HDF\r\n\x1a\n"


def _check_hdf5(path: Path, source: str) -> None:
    import h5py

    free, seen = available_memory(), set()
    with h5py.File(path, "r") as file:
        groups: list[Any] = [file]
        while groups:
            group = groups.pop()
            for name in group:
                if isinstance(group.get(name, getlink=True), h5py.ExternalLink):
                    raise _refused(source, path, name, "a link into another file")
                found = group.get(name)  # None for a link that leads nowhere
                if found is None or (place := h5py.h5o.get_info(found.id).addr) in seen:
                    continue
                seen.add(place)
                if len(seen) > _MOST_OBJECTS:
                    raise MeshError(f"{source}: {path.name} has more than {_MOST_OBJECTS} arrays and groups")
                if isinstance(found, h5py.Group):
                    groups.append(found)
                elif isinstance(found, h5py.Dataset):
                    sources = found.virtual_sources() if found.is_virtual else []
                    if found.external or any(s.file_name != "." for s in sources):
                        raise _refused(source, path, name, "data in another file")
                    if found.nbytes > free:
                        raise MeshError(
                            f'{source}: {path.name}: "{name}" promises {memory_text(found.nbytes)}, and'
                            f" {memory_text(free)} are free; is the file damaged?"
                        )


def _refused(source: str, path: Path, name: str, what: str) -> MeshError:
    return MeshError(f'{source}: {path.name}: "{name}" is {what}, which is not followed; save all arrays in one file')
