"""Being here, this file makes pytest put the folder `tests` on sys.path, so that tests can `import meshes`."""

import os
import sys
from pathlib import Path

# Before NumPy is imported: the dense references are small, and OpenBLAS's threads wait for those of MKL and of whatever
# else runs on the machine, which makes them up to twenty times slower.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# Formulas and smallest rungs of the benchmarks are tested; names of the tests' own modules come first.
sys.path.append(str(Path(__file__).parents[1] / "benchmarks"))
