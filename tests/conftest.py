"""Being here, this file makes pytest put the folder `tests` on sys.path, so that tests can `import meshes`."""

import os

# Before NumPy is imported: the dense references are small, and OpenBLAS's threads wait for those of MKL and of whatever
# else runs on the machine, which makes them up to twenty times slower.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
