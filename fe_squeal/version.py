"""The version of what is installed."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError
from importlib.metadata import version as installed_version

try:
    __version__ = installed_version("fe-squeal")
except PackageNotFoundError:  # run from a source tree that is not installed
    __version__ = "0+unknown"
