"""Being imported, this puts the folder of benchmarks on sys.path: their formulas and smallest rungs are tested."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))
