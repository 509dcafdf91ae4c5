"""Imported by Python at its start if PYTHONPATH names this folder: so commands vary as the tests that start them."""

import os
import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1]))

import varied_imports

varied_imports.vary_imports(os.environ)
