"""Solvers of `domain_decomposition.py`: a net in one process, or half of it in each of two.

Every solver gets a job (folder of the matrix, side of the net, settings) and a `Halves`; it returns
its part of the displacements, and a dictionary with times of its stages and memory. Nothing but
NumPy is imported before it is needed: a process has no jax unless it uses it.
"""

import ctypes
import functools
import itertools
import math
import time

import numpy as np
from peers.distributed_solver_child import memory, read_rows

TOL, CG_STEPS = 1e-10, 3000
OVERLAP = 2  # lines of nodes by which boxes reach into their neighbors


def export(job, halves):
    """Write the tangents of the prestressed and the loaded net, whole rows, and the load."""
    import jax
    import jax.numpy as jnp
    import scipy.sparse as sp

    import jaxcable as jc
    from jaxcable.common.tree import merge_indices, split_indices
    from jaxcable.mechanics.restart_state import make_system
    from jaxcable.spaces.dof_map import make_dof_map

    jax.config.update("jax_enable_x64", True)
    empty, side = memory("VmRSS"), job["side"]
    structure, phases = jc.scenes.saddle(side, side, load=5000.0 / (side + 1))
    links = tuple((group.links, group.n_freedom, ()) for group in structure.groups)
    dof_map = make_dof_map(structure.fixed(structure.supports), None, links, "pardiso")
    for name, own in (("old", phases[:1]), ("values", phases)):
        solution = jc.solve(structure, own, jc.Newton(tol=1e-8))
        jc.raise_if_failed(solution)
        bare, arrays = split_indices((structure.nodes, structure.groups, solution.last.restart))
        nodes, groups, restart = merge_indices(bare, [jnp.asarray(array) for array in arrays])
        system = make_system(nodes, groups, restart, restart.motion, dof_map)
        K = system.tangent(restart.motion)
        rows = np.asarray(K.values), np.asarray(K.pattern.indices), np.asarray(K.pattern.indptr)
        upper = sp.csr_matrix(rows, K.shape).tocoo()
        off, i, j, values = upper.row != upper.col, upper.row, upper.col, upper.data
        ends = np.append(i, j[off]), np.append(j, i[off])
        whole = sp.csr_matrix((np.append(values, values[off]), ends), K.shape)  # keeps its zeros
        whole.sort_indices()
        np.save(f"{job['folder']}/{name}.npy", whole.data)
    load = np.tile([0.0, 0.0, -5000.0 / (side + 1)], side**2)
    for name, array in (("indptr", whole.indptr), ("indices", whole.indices), ("load", load)):
        np.save(f"{job['folder']}/{name}.npy", array)
    return load, {"memory": memory("VmHWM") - empty}


def block(job, low, high, left, right, values="values"):
    """Rows `low` to `high` and columns `left` to `right` of the tangent, and the loads of rows."""
    import scipy.sparse as sp

    indptr, indices, entries, load = read_rows(job["folder"], low, high, values)
    rows = sp.csr_matrix((entries, indices, indptr), (high - low, 3 * job["side"] ** 2))
    return rows[:, left:right], load


@functools.cache
def load_pardiso():
    from pypardiso.pardiso_wrapper import PyPardisoSolver

    pardiso = PyPardisoSolver().libmkl.pardiso
    pardiso.argtypes, pardiso.restype = [ctypes.c_void_p] * 16, None
    return pardiso


class Cholesky:
    """PARDISO's factor of a definite matrix; of its last `border` unknowns the Schur complement."""

    def __init__(self, matrix, border=0):
        import scipy.sparse as sp

        upper = sp.triu(matrix, format="csr")
        upper.sort_indices()
        self.border, self.n = border, matrix.shape[0]
        self.matrix = upper.data, *(a.astype(np.int32) for a in (upper.indptr, upper.indices))
        self.in_border = (np.arange(self.n) >= self.n - border).astype(np.int32)
        self.handle, self.iparm = np.zeros(64, np.int64), np.zeros(64, np.int32)
        self.iparm[[0, 1, 9, 34]] = 1, 2, 13, 1  # nested dissection; indices from zero
        self.iparm[[23, 35]] = (1, 2) if border else (0, 0)
        self.call(11)

    def call(self, phase, b=None, x=None):
        numbers = (np.array([k], np.int32) for k in (1, 1, 2, phase, self.n, 1, 0, 0))
        *head, sides, silent, error = numbers
        b, x = (silent if a is None else a for a in (b, x))
        arrays = self.handle, *head, *self.matrix, self.in_border, sides, self.iparm
        arrays = *arrays, silent, b, x, error
        load_pardiso()(*(a.ctypes.data for a in arrays))
        assert error[0] == 0, error

    def factorize(self):
        schur = np.zeros((self.border, self.border))
        self.call(22, np.zeros_like(schur), schur)
        return schur

    def solve(self, b, phase=33):
        """Phases 331 and 333 end before, and begin after, the solution for the border."""
        b, x = np.array(b), np.zeros(len(b))
        self.call(phase, b, x)
        return x


class Halves:
    """One of two processes: what it exchanges with the other one."""

    def __init__(self, rank, link, side):
        self.rank, self.link, self.line, self.sent = rank, link, 3 * side, 0
        self.cut, self.n = side // 2 * self.line, side * self.line

    def exchange(self, array=()):
        """Send an array, and return that of the other process."""
        data = np.ascontiguousarray(array, float).tobytes()
        self.sent += len(data)
        if self.rank == 0:
            self.link.send_bytes(data)
        got = np.frombuffer(self.link.recv_bytes())
        if self.rank == 1:
            self.link.send_bytes(data)
        return got

    def edge(self, v, count):
        """The `count` numbers of v next to the other process."""
        return v[len(v) - count :] if self.rank == 0 else v[:count]

    def extended(self, v, count):
        """The part v, and `count` numbers of the other process behind its edge."""
        far = self.exchange(self.edge(v, count))
        return np.concatenate([v, far] if self.rank == 0 else [far, v])

    def dot(self, a, b):
        return float(a @ b + self.exchange([a @ b])[0])


def conjugate_gradients(product, precondition, dot, b):
    x, r, p, before, steps = np.zeros_like(b), b.copy(), np.zeros_like(b), np.inf, 0
    limit = TOL * math.sqrt(dot(b, b))
    while math.sqrt(dot(r, r)) > limit and steps < CG_STEPS:
        z = precondition(r)
        now = dot(r, z)
        p = z + now / before * p
        q = product(p)
        length = now / dot(p, q)
        x, r, before, steps = x + length * p, r - length * q, now, steps + 1
    return x, steps


def factorize_twice(factor, halves, moments):
    """Factorise, and factorise again; append the moments, return the Schur complement."""
    for _ in range(2):
        schur = factor.factorize()
        halves.exchange()
        moments.append(time.perf_counter())
    return schur


def answer(moments, empty, **more):
    """Seconds of analysis with a first factor, of another factor, of the solution; memory."""
    times = np.diff([*moments, time.perf_counter()]).tolist()
    return {"times": times, "memory": memory("VmHWM") - empty, **more}


def direct(job, halves):
    """jaxcable's solver, if asked for of a net of half the side.

    Or conjugate gradients with its factor of the prestressed net.
    """
    import scipy.sparse as sp

    from jaxcable.linear import solver_named

    empty, old = memory("VmRSS"), job.get("old")
    indptr, indices, values, load = read_rows(job["folder"])
    if job.get("quarter"):
        near = np.arange(job["side"]) < job["side"] // 2
        keep = np.repeat(np.outer(near, near).ravel(), 3)
        part = sp.csr_matrix((values, indices, indptr))[keep][:, keep]
        indptr, indices, values, load = part.indptr, part.indices, part.data, load[keep]
    before = np.load(f"{job['folder']}/old.npy") if old else values
    moments = [time.perf_counter()]
    analysis = solver_named("pardiso").analyze(len(load), indptr, indices)
    analysis.factorize(before, True).release()
    moments.append(time.perf_counter())
    factor = analysis.factorize(before, True)
    moments.append(time.perf_counter())
    if not old:
        return factor.solve(load), answer(moments, empty, entries=factor.n_bytes / 8)
    matrix = sp.csr_matrix((values, indices, indptr))
    x, steps = conjugate_gradients(matrix.dot, factor.solve, np.dot, load)
    return x, answer(moments, empty, steps=steps)


def schur(job, halves):
    """Exact: both halves eliminated, their Schur complements added and solved."""
    from scipy.linalg import cho_factor, cho_solve

    empty, line = memory("VmRSS"), halves.line
    low, high = (0, halves.cut + line) if halves.rank == 0 else (halves.cut, halves.n)
    matrix, b = block(job, low, high, low, high)
    # the line between the halves comes last, with its whole stiffness in both; the load is in one
    order, border = np.roll(np.arange(high - low), -line * halves.rank), high - low - line
    matrix, b = matrix[order][:, order], b[order]
    b[border:] *= halves.rank == 0
    moments = [time.perf_counter()]
    factor = Cholesky(matrix, line)
    own = factorize_twice(factor, halves, moments)
    total = own + halves.exchange(own).reshape(own.shape) - matrix[border:, border:].toarray()
    begin = time.perf_counter()
    dense = cho_factor(total)
    dense_s = time.perf_counter() - begin
    moments[-1] = time.perf_counter()
    y = factor.solve(b, 331)
    y[border:] = cho_solve(dense, y[border:] + halves.exchange(y[border:]))
    x = factor.solve(y, 333)
    found = answer(moments, empty, sent=halves.sent, dense_s=dense_s)
    return x if halves.rank == 0 else x[:border], found


def schwarz(job, halves):
    """Conjugate gradients with factors of two halves that reach some lines over the cut."""
    empty, rank, over = memory("VmRSS"), halves.rank, job["overlap"] * halves.line
    low, high = (0, halves.cut) if rank == 0 else (halves.cut, halves.n)
    far = (low, high + over) if rank == 0 else (low - over, high)
    left, right = max(low - halves.line, 0), min(high + halves.line, halves.n)
    matrix, b = block(job, low, high, left, right)
    local = block(job, *far, *far)[0]
    moments = [time.perf_counter()]
    factor = Cholesky(local)
    factorize_twice(factor, halves, moments)

    def precondition(r):
        if not over:
            return factor.solve(r)
        y = factor.solve(halves.extended(r, over))
        own, far = (y[:-over], y[-over:]) if rank == 0 else (y[over:], y[:over])
        halves.edge(own, over)[:] += halves.exchange(far)
        return own

    def product(p):
        return matrix @ halves.extended(p, halves.line)

    sent = halves.sent
    x, steps = conjugate_gradients(product, precondition, halves.dot, b)
    return x, answer(moments, empty, steps=steps, sent=(halves.sent - sent) / steps)


def boxes(job, halves):
    """Conjugate gradients with factors of k x k boxes, if asked for with a coarse space."""
    import scipy.sparse as sp

    empty, side, k = memory("VmRSS"), job["side"], job["boxes"]
    matrix, b = block(job, 0, halves.n, 0, halves.n)
    moments, parts = [time.perf_counter()], []
    ends = [side * i // k for i in range(k + 1)]
    spans = [
        np.arange(max(low - OVERLAP, 0), min(high + OVERLAP, side))
        for low, high in itertools.pairwise(ends)
    ]
    for down, across in itertools.product(spans, spans):
        nodes = (down[:, None] * side + across).ravel()
        own = (3 * nodes[:, None] + np.arange(3)).ravel()
        parts.append((own, Cholesky(matrix[own][:, own])))
    moments += [time.perf_counter()] * 2
    for _, factor in parts:
        factor.factorize()
    hats = np.maximum(1 - np.abs(np.arange(side)[:, None] + 0.5 - ends[1:-1]) * k / side, 0)
    coarse = sp.kron(sp.kron(hats, hats), sp.eye(3), format="csr")
    inner = Cholesky(coarse.T @ matrix @ coarse)
    inner.factorize()
    moments[-1] = time.perf_counter()

    def precondition(r):
        z = coarse @ inner.solve(coarse.T @ r) if job["coarse"] else np.zeros_like(r)
        for own, factor in parts:
            z[own] += factor.solve(r[own])
        return z

    x, steps = conjugate_gradients(matrix.dot, precondition, np.dot, b)
    return x, answer(moments, empty, steps=steps)
