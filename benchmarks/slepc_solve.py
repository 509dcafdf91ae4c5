"""One solve by SLEPc and MUMPS, run by the system's Python: slepc_solve.py FOLDER MODES SIDES

Prints the seconds on the clock and of the processor.
"""

import glob
import sys
import time

import numpy as np

for folder in glob.glob("/usr/lib/*dir/*/*/lib/python3/dist-packages"):
    sys.path.append(folder)  # a place where Debian installs petsc4py and slepc4py
from petsc4py import PETSc  # noqa: E402
from slepc4py import SLEPc  # noqa: E402


def matrix(path):
    """Read a CSR matrix."""
    with np.load(path) as file:
        n = len(file["indptr"]) - 1
        csr = (file["indptr"].astype(np.int32), file["indices"].astype(np.int32), file["data"])
        return PETSc.Mat().createAIJ((n, n), csr=csr)


K, M = matrix(f"{sys.argv[1]}/K.npz"), matrix(f"{sys.argv[1]}/M.npz")
start, processor = time.perf_counter(), time.process_time()
solver = SLEPc.EPS().create()
solver.setOperators(K, M)
solver.setProblemType(SLEPc.EPS.ProblemType.GNHEP)
solver.setDimensions(int(sys.argv[2]))
solver.setTwoSided(sys.argv[3] == "2")
solver.setTolerances(1e-8)
solver.setWhichEigenpairs(SLEPc.EPS.Which.TARGET_MAGNITUDE)
solver.setTarget(-((2 * np.pi * 100.0) ** 2))
transform = solver.getST()
transform.setType(SLEPc.ST.Type.SINVERT)
linear = transform.getKSP()
linear.setType("preonly")
linear.getPC().setType("lu")
linear.getPC().setFactorSolverType("mumps")
solver.solve()
if solver.getConverged() < int(sys.argv[2]):
    sys.exit(f"SLEPc: {solver.getConverged()} of {sys.argv[2]} modes")
print(time.perf_counter() - start, time.process_time() - processor)
