"""Run pytest under mpiexec: process 0 runs it, and the others take part in factorisations; see make test-mpi."""

from __future__ import annotations

import sys

import pytest

from fe_squeal.eigen.linear.processes import dismiss, help_out, prepare
from fe_squeal.process.ranks import is_helper

if __name__ == "__main__":
    if is_helper():
        sys.exit(help_out())
    prepare()
    code = int(pytest.main([*sys.argv[1:], "-p", "no:cacheprovider"]))
    dismiss(code)
    sys.exit(code)
