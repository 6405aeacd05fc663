"""Solvers of other libraries in several processes, for `domain_decomposition.py`.

Started once for each process by MPI, with the name of a solver and a folder: indptr.npy,
indices.npy, values.npy (rows of a symmetric positive definite matrix, in blocks of 3) and load.npy.
Every process reads its own rows, and writes its part of the solution to x_RANK.npy; the first one
prints a line of JSON. Solvers:

    cluster          MKL's PARDISO for clusters: mpi4py and mkl, with MPICH or Intel's MPI
    mumps            PETSc: MUMPS
    icc, gamg        PETSc: conjugate gradients with an incomplete factor of each process's block,
                     or with algebraic multigrid
"""

import ctypes
import json
import os
import sys
import time
from pathlib import Path

import numpy as np

ITERATIVE = "ksp_type=cg ksp_norm_type=unpreconditioned ksp_rtol=1e-10 ksp_max_it=3000"
PETSC = {
    "mumps": "ksp_type=preonly pc_type=cholesky pc_factor_mat_solver_type=mumps "
    "mat_mumps_icntl_14=100",  # percent more workspace than it estimates
    "icc": f"{ITERATIVE} pc_type=bjacobi sub_pc_type=icc",
    "gamg": f"{ITERATIVE} pc_type=gamg pc_gamg_threshold=0.01",
}
LIBRARIES = "mpi", "mkl_core", "mkl_sequential", "mkl_intel_lp64", "mkl_blacs_intelmpi_lp64"


def memory(key):
    """Memory of this process, GB: VmRSS now, VmHWM the largest so far."""
    lines = Path("/proc/self/status").read_text(encoding="utf-8").splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(key)) * 1024 / 1e9


def read_rows(folder, low=0, high=None, values="values"):
    """Rows of the matrix (indptr, indices, values), and their loads."""
    names = "indptr", "indices", values, "load"
    indptr, *rest, load = (np.load(f"{folder}/{name}.npy", mmap_mode="r") for name in names)
    high = len(load) if high is None else high
    begin, end = indptr[low], indptr[high]
    arrays = (np.array(a[begin:end]) for a in rest)
    return indptr[low : high + 1] - begin, *arrays, np.array(load[low:high])


def share(n, rank, count):
    """First and last row of a process, whole nodes."""
    return tuple(n // 3 * k // count * 3 for k in (rank, rank + 1))


def cluster(folder):
    """Return the solution of these rows, times of the stages, and the memory without libraries."""
    from mpi4py import MPI

    world, places = MPI.COMM_WORLD, Path(sys.prefix) / "lib"
    found = (str(max(places.glob(f"lib{name}.so*"))) for name in LIBRARIES)
    libraries = [ctypes.CDLL(path, ctypes.RTLD_GLOBAL | os.RTLD_LAZY) for path in found]
    pardiso = libraries[-2].CLUSTER_SPARSE_SOLVER
    empty, n = memory("VmRSS"), len(np.load(f"{folder}/load.npy", mmap_mode="r"))
    low, high = share(n, world.rank, world.size)
    indptr, indices, values, b = read_rows(folder, low, high)
    row = np.repeat(np.arange(low, high), np.diff(indptr))
    upper = indices >= row
    count = np.bincount(row[upper] - low, minlength=high - low)
    indptr = np.append(0, np.cumsum(count)).astype(np.int32)
    indices, values = indices[upper].astype(np.int32), values[upper]
    handle, iparm, x = np.zeros(64, np.int64), np.zeros(64, np.int32), np.zeros_like(b)
    # nested dissection; perturbed pivots; indices from zero; rows of each process
    iparm[[0, 1, 9, 34, 39, 40, 41]] = 1, 2, 13, 1, 2, low, high - 1
    moments = []
    for phase in (None, 11, 22, 22, 33):
        if phase:
            numbers = (1, 1, 2, phase, n, 0, 1, 0, world.py2f(), 0)
            most, slot, kind, phase, size, order, sides, silent, mpi, error = (
                np.array([k], np.int32) for k in numbers
            )
            arrays = most, slot, kind, phase, size, values, indptr, indices, order, sides, iparm
            arrays = (handle, *arrays, silent, b, x, mpi, error)
            pardiso(*(ctypes.c_void_p(a.ctypes.data) for a in arrays))
            assert error[0] == 0, error
        world.barrier()
        moments.append(time.perf_counter())
    start, _, ready, factored, end = moments
    found = {"times": (ready - start, factored - ready, end - factored)}
    return world, x, found, memory("VmHWM") - empty


def petsc(folder, options):
    """The same by PETSc, with the settings `options`."""
    import petsc4py

    petsc4py.init(sys.argv[:1])
    from petsc4py import PETSc

    for option in options.split():
        PETSc.Options()[option.split("=")[0]] = option.split("=")[1]
    world = PETSc.COMM_WORLD.tompi4py()
    empty, n = memory("VmRSS"), len(np.load(f"{folder}/load.npy", mmap_mode="r"))
    low, high = share(n, world.rank, world.size)
    *rows, load = read_rows(folder, low, high)
    size = (high - low, n), (high - low, n)
    matrix = PETSc.Mat().createAIJ(size, bsize=3, csr=rows)
    matrix.setOption(PETSc.Mat.Option.SPD, True)
    b = PETSc.Vec().createWithArray(load)
    x, solver = b.duplicate(), PETSc.KSP().create()
    solver.setFromOptions()
    moments = [time.perf_counter()]
    for _ in range(2):
        matrix.stateIncrease()  # as if it had new numbers
        solver.setOperators(matrix)
        solver.setUp()
        solver.setUpOnBlocks()
        world.barrier()
        moments.append(time.perf_counter())
    solver.solve(b, x)
    assert solver.getConvergedReason() > 0, solver.getConvergedReason()
    world.barrier()
    start, ready, factored, end = (*moments, time.perf_counter())
    found = {"times": (ready - start, factored - ready, end - factored)}
    if "=cg" in options:
        found["steps"] = solver.getIterationNumber()
    return world, x.getArray(), found, memory("VmHWM") - empty


if __name__ == "__main__":
    name, folder = sys.argv[1:]
    world, x, found, own = cluster(folder) if name == "cluster" else petsc(folder, PETSC[name])
    np.save(f"{folder}/x_{world.rank}.npy", x)
    found["memory"] = world.gather(own)
    if world.rank == 0:
        print(json.dumps(found), flush=True)
