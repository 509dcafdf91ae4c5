"""One solve by SLEPc and MUMPS, run by the system's Python: slepc_solve.py FOLDER MODES SIDES

Prints the seconds on the clock and of the processor, and writes the eigenvalues into theta.npy of the folder. Under
mpiexec each process has its rows of the matrices.
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
    """Read the rows of a CSR matrix that belong to this process."""
    with np.load(path) as file:
        indptr, n = file["indptr"], len(file["indptr"]) - 1
        low, high = (n * (rank + i) // count for i in range(2))
        part = slice(indptr[low], indptr[high])
        csr = ((indptr[low : high + 1] - indptr[low]).astype(np.int32), file["indices"][part].astype(np.int32),
               file["data"][part])
        return PETSc.Mat().createAIJ(((high - low, n), (high - low, n)), csr=csr)


rank, count = PETSc.COMM_WORLD.getRank(), PETSc.COMM_WORLD.getSize()
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
if rank == 0:
    theta = [complex(solver.getEigenvalue(i)) for i in range(solver.getConverged())]
    np.save(f"{sys.argv[1]}/theta.npy", theta)
    print(time.perf_counter() - start, time.process_time() - processor)
