"""What would a solver in several processes take, where one net outgrows one machine?

Question   The tangent of a loaded saddle net, solved by two processes with half of it each:
           seconds, memory of each, iterations. Which nets would need that?
Reference  PARDISO, as jaxcable calls it in one process, with the same matrix.
Error      Residual over the load; largest difference from the reference's displacements over the
           largest of them. Of direct solvers it must be less than 1e-8.
Command    python experiments/domain_decomposition.py --side 577
           (writes experiments/results/domain_decomposition.txt; 61 nodes a side without --side;
           needs the extra jaxcable[pardiso])

With --mkl "mpiexec -n {} python" and --petsc "mpiexec -n {} /usr/bin/python3" also MKL's cluster
solver (packages mpich, mpi4py, mkl) and PETSc with MUMPS (python3-petsc4py of Debian); {} becomes
the number of processes.

Schur: each process eliminates its half; the line of nodes between them is solved as a dense matrix.
Schwarz: conjugate gradients to 1e-10 with factors of halves that overlap by some lines of nodes.
Boxes: the same in one process, with many boxes that overlap by 2, and a coarse space (bilinear
displacements between the corners of boxes). Factors are timed the second time, after the analysis
of the pattern and a first factor. Memory: peak of a process, less its libraries. Processes exchange
arrays through pipes, or by MPI.
"""

import argparse
import json
import math
import multiprocessing
import os
import subprocess
import tempfile
from pathlib import Path

import numpy as np
import substructures
from benchmarks.measure import table

PEER = Path(__file__).parent / "peers" / "distributed_solver_child.py"
PETSC = {"mumps": "MUMPS", "icc": "CG, incomplete factors", "gamg": "CG, algebraic multigrid"}
COUNTS = {"cluster": (1, 2, 4), "mumps": (1, 2, 4)}  # of processes; else two
SMALLEST = 200  # nodes a side from which on the compiler does not rule the memory
MEMORY = {"128 GB": 128e9, "1 TB": 1e12}


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--side", type=int, default=61, help="free nodes a side of the net")
    parser.add_argument("--petsc", help="command that starts {} processes with petsc4py")
    parser.add_argument("--mkl", help="command that starts {} processes with mpi4py and mkl")
    return parser.parse_args()


def work(name, job, rank, link, answers):
    """What a process of a pair does."""
    part, found = getattr(substructures, name)(job, substructures.Halves(rank, link, job["side"]))
    np.save(f"{job['folder']}/x_{rank}.npy", part)
    answers.put((rank, found))


def in_processes(name, count, job, threads=1):
    """Run a solver of `substructures` in one or two processes; times are those of the slower."""
    os.environ["OMP_NUM_THREADS"] = os.environ["MKL_NUM_THREADS"] = str(threads)
    os.environ["OPENBLAS_NUM_THREADS"] = str(threads)
    spawn = multiprocessing.get_context("spawn")
    answers, links = spawn.Queue(), spawn.Pipe() if count == 2 else (None,)
    processes = [
        spawn.Process(target=work, args=(name, job, rank, link, answers))
        for rank, link in enumerate(links)
    ]
    for process in processes:
        process.start()
    for link in links:
        if link is not None:
            link.close()  # so that a process whose other one has failed ends, too
    for process in processes:
        process.join()
        if process.exitcode:
            raise RuntimeError(f"{name}: a process ended with {process.exitcode}")
    (_, found), *others = sorted((answers.get() for _ in links), key=lambda own: own[0])
    found["memory"] = [found["memory"], *(other["memory"] for _, other in others)]
    return found


def by_mpi(name, count, job, command):
    """Run a solver of the child in processes that `command` starts; its last line is the answer."""
    line = [*command.format(count).split(), str(PEER), name, job["folder"]]
    run = subprocess.run(line, capture_output=True, text=True)
    if run.returncode:
        raise RuntimeError(f"{name}: {run.stderr[-2000:]}")
    return json.loads([row for row in run.stdout.splitlines() if row.startswith("{")][-1])


class Comparison:
    """Rows of the table, each beside the displacements of the first one."""

    def __init__(self, job):
        import scipy.sparse as sp

        self.job, self.rows, self.reference = job, [], None
        *arrays, self.load = substructures.read_rows(job["folder"])
        self.matrix = sp.csr_matrix(tuple(arrays[::-1]))

    def add(self, label, found):
        """Judge what a solver has left in the folder, and add a row."""
        parts = (np.load(f"{self.job['folder']}/x_{k}.npy") for k in range(len(found["memory"])))
        x = np.concatenate([*parts])
        if self.reference is None:
            self.reference = x
        residual = np.linalg.norm(self.matrix @ x - self.load) / np.linalg.norm(self.load)
        error = np.abs(x - self.reference).max() / np.abs(self.reference).max()
        assert error < 1e-8 or "steps" in found, (label, error)
        first, again, solve = found["times"]
        row = [label, str(len(found["memory"])), f"{first:.2f}", f"{again:.2f}", f"{solve:.3f}"]
        row += [" ".join(f"{own:.2f}" for own in found["memory"]), str(found.get("steps", "-"))]
        sent = f"{found['sent'] / 1e3:.0f}" if "sent" in found else "-"
        self.rows.append([*row, sent, f"{residual:.0e}", f"{error:.0e}"])
        print(*self.rows[-1], flush=True)
        return found


def measure(given, job):
    """All solvers by turns: the table, and what the model needs."""
    table = Comparison(job)

    def own(label, name, count=1, threads=1, **more):
        return table.add(label, in_processes(name, count, {**job, **more}, threads))

    reference = own("PARDISO, 1 thread", "direct")
    own("PARDISO, 2 threads", "direct", threads=2)
    dense = own("Schur complement", "schur", 2)
    for kind, command in (("cluster", given.mkl), *((name, given.petsc) for name in PETSC)):
        label = f"PETSc: {PETSC[kind]}" if kind in PETSC else "MKL's cluster solver"
        for count in COUNTS.get(kind, (2,)) if command else ():
            table.add(label, by_mpi(kind, count, job, command))
    own("CG, factor before the load", "direct", old=True)
    for overlap in (0, 1, 2, 4):
        own(f"Schwarz, overlap {overlap}", "schwarz", 2, overlap=overlap)
    for count in (4, 8):
        for coarse in (False, True):
            label = f"{count} x {count} boxes" + ", coarse space" * coarse
            own(label, "boxes", boxes=count, coarse=coarse)
    return table.rows, reference, dense


def entries_by_size(small, large):
    """Entries of the factor for each unknown, a + b log2(n), through two measured sizes."""
    (n, first), (m, second) = small, large
    slope = (second / m - first / n) / math.log2(m / n)
    return lambda size: second / m + slope * math.log2(size / m)


def model(record, whole, entries, dense):
    """Print what one process, and what separators, would take for larger nets.

    Args:
        record: where it is printed.
        whole: unknowns and largest memory, GB, of the whole analysis.
        entries: function that gives entries of the factor for each unknown.
        dense: unknowns of the separator that was measured, and seconds of its dense factor.
    """
    n, peak = whole
    others = peak * 1e9 / n - 8 * entries(n)  # bytes for each unknown that are not the factor
    rate = dense[0] ** 3 / 3 / dense[1]
    record(
        f"\nThe analysis itself takes {peak:.2f} GB, {peak * 1e9 / n:.0f} bytes for each unknown;"
    )
    record(
        f"the factor has {entries(n):.0f} entries for each. Dense factors: {rate / 1e9:.0f} Gflop/s"
    )

    def needed(size):
        return size * (others + 8 * entries(size))

    rows = []
    for name, limit in MEMORY.items():
        low, high = 1.0, 1e12
        while high > 1.001 * low:
            middle = math.sqrt(low * high)
            low, high = (middle, high) if needed(middle) < limit else (low, middle)
        side = math.sqrt(low / 3)
        for parts in (2, 4, 16, 64):
            border = 3 * side * (1 if parts == 2 else 2 * (math.sqrt(parts) - 1))
            cells = name, f"{low / 1e6:.0f}", f"{side:.0f}", f"{8e-9 * low * entries(low):.0f}"
            cells = *cells, str(parts), f"{border:.0f}", f"{8e-9 * border**2:.1f}"
            rows.append([*cells, f"{border**3 / 3 / rate:.0f}"])
    record("\nLargest net of one machine, and its interface between P boxes as one dense matrix\n")
    head = "memory,million unknowns,side,factor GB,P,interface,GB,factor s".split(",")
    record(table(head, rows))


def main():
    given = arguments()
    from record import Record  # imports jax, which processes shall not have unless they use it

    record = Record("domain_decomposition")
    with tempfile.TemporaryDirectory() as folder:
        job = {"folder": folder, "side": given.side}
        whole = in_processes("export", 1, job, threads=2)
        quarter = in_processes("direct", 1, {**job, "quarter": True})
        rows, reference, dense = measure(given, job)
    n, less = 3 * given.side**2, 3 * (given.side // 2) ** 2
    record(f"\nSaddle net of {given.side} x {given.side} free nodes, {n} unknowns\n")
    head = "solver,processes,first s,factor s,solve s,memory GB,steps,sent kB,residual,error"
    record(table(head.split(","), rows))
    if given.side < SMALLEST:
        record(f"\nWith {SMALLEST} nodes a side or more, also a table of larger nets")
        return record.close()
    entries = entries_by_size((less, quarter["entries"]), (n, reference["entries"]))
    model(record, (n, whole["memory"][0]), entries, (3 * given.side, dense["dense_s"]))
    return record.close()


if __name__ == "__main__":
    main()
