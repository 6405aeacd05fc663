"""How fast is the force density method and its gradient, beside jax_fdm's sparse model?

Question   Time of the positions of a net from its force densities, and of the gradient of the sum
           of squared lengths with respect to all of them, with the numbers changed in every call.
Reference  jax_fdm (Pastrana et al., https://github.com/arpastrana/jax_fdm), its
           `EquilibriumModelSparse` with `tmax=1`, jitted, in a process of its own: as it comes (its
           linear solver is SciPy's SuperLU), with one and with two threads of BLAS, and with that
           solver replaced by PARDISO. jaxcable with PARDISO (its default here) and SuperLU.
Error      Largest difference of positions and of gradients between the two programs, over the
           largest entry, -; asserted below 1e-12 and 1e-11 (rounding times condition).
Results    force_density.txt; three minutes. JAX_FDM_PYTHON names an interpreter that has jax_fdm,
           and pypardiso for the last row.

Nets: `jaxcable.scenes.saddle` of n x n free nodes, every node loaded, force densities random
between 500 and 2 000 N/m. All sides are fed the same file and work by turns in changing order on
the same machine, five calls each turn, of which the first is not counted: it finds the caches full
of the other programs. Each call is blocked on completion and has numbers that this program has not
seen (factors are kept by value). Threads of OpenMP that have nothing to do sleep at once
(KMP_BLOCKTIME=0): else they would spin for 0.2 s and slow down whoever is next. Times are wall
milliseconds, median and quartiles; ratios are medians, with their quartiles, of the ratios of calls
on the same numbers: the other program's time over that of jaxcable with PARDISO.
"""

import os
import sys
import tempfile

os.environ["KMP_BLOCKTIME"] = "0"

import jax
import jax.numpy as jnp
import numpy as np
from record import Record

import jaxcable as jc
from jaxcable import linear
from jaxcable.forms import force_density

from .measure import Peer, clock, quartiles

CHILD = "jax_fdm_child.py"
TURNS, CALLS = 9, 5
THEIRS = (("scipy", 1), ("scipy", 2), ("pardiso", 1))  # solver, threads of BLAS


def net(n):
    """Structure, its loads, and force densities for every call."""
    structure, _ = jc.scenes.saddle(n, n)
    rng = np.random.default_rng(0)
    load = np.zeros((structure.n_node, 3))
    free = ~structure.held_displacements()[:, 0]
    load[free] = rng.normal(size=(free.sum(), 3)) * 10 + [0, 0, -50]
    q = rng.uniform(500, 2000, (2 * TURNS * CALLS, len(structure.elements.links)))
    return structure, load, q


def ours(structure, load, solver):
    """Value and gradient, compiled."""
    links = structure.elements.links.array
    loads = jc.NodalLoads(np.arange(structure.n_node), load)

    def positions(q):
        return force_density(structure, q, loads, solver)

    def measure(q):
        x = positions(q)
        return jnp.sum((x[links[:, 1]] - x[links[:, 0]]) ** 2)

    return {"value": jax.jit(positions), "gradient": jax.jit(jax.value_and_grad(measure))}


def compare(n, record):
    """One net: all programs by turns."""
    structure, load, q = net(n)
    mine = ["superlu", *(["pardiso"] if linear.solver_named("pardiso").is_installed() else [])]
    functions = {solver: ours(structure, load, solver) for solver in mine}
    rows = [jax.block_until_ready(jnp.asarray(row)) for row in q]
    with tempfile.TemporaryDirectory() as folder:
        path = f"{folder}/net.npz"
        anchors = np.asarray(structure.supports.nodes.array)
        links = structure.elements.links.array
        np.savez(path, nodes=structure.nodes, links=links, anchors=anchors, load=load, q=q)
        peers = {
            threads: Peer("JAX_FDM_PYTHON", CHILD, path, OPENBLAS_NUM_THREADS=str(threads))
            for _, threads in THEIRS
        }
        version = check(functions, rows, peers, f"{folder}/answer.npz", record)

        def time_of(who, what, call):
            if who[0] == "jax_fdm":
                return peers[who[2]].ask(call=call, what=what, solver=who[1])["ms"]
            return 1e3 * clock(functions[who[1]][what], rows[call])[0]

        everyone = [("jaxcable", s) for s in mine] + [("jax_fdm", s, t) for s, t in THEIRS]
        times = {(who, what): [] for who in everyone for what in ("value", "gradient")}
        for turn in range(TURNS):
            for who in everyone if turn % 2 else everyone[::-1]:
                for k, what in enumerate(("value", "gradient")):
                    first = (2 * turn + k) * CALLS
                    own = [time_of(who, what, first + call) for call in range(CALLS)]
                    times[who, what] += own[1:]
        for peer in peers.values():
            peer.close()
    times = {key: np.array(ms) for key, ms in times.items()}
    base = {what: times[("jaxcable", mine[-1]), what] for what in ("value", "gradient")}
    for who in everyone:
        name = " ".join((who[0], *map(str, who[1:2]))) + (
            f", {who[2]} thread{'s' * (who[2] > 1)}" if who[0] == "jax_fdm" else ""
        )
        value, gradient = (times[who, what] for what in ("value", "gradient"))
        record(
            f"{n * n:8} {name:26} {quartiles(value, 1):>21} {quartiles(gradient, 1):>21} "
            f"{quartiles(value / base['value']):>18} "
            f"{quartiles(gradient / base['gradient']):>18}"
        )
    return version


def check(functions, rows, peers, path, record):
    """Assert that all programs agree on the first row; returns the versions of the other one."""
    for solver, threads in THEIRS:
        version = peers[threads].ask(save=path, solver=solver)
        theirs = np.load(path)
        for name, both in functions.items():
            x, (_, gradient) = both["value"](rows[0]), both["gradient"](rows[0])
            apart = np.abs(x - theirs["x"]).max() / np.abs(theirs["x"]).max()
            largest = np.abs(theirs["gradient"]).max()
            gradients = np.abs(gradient - theirs["gradient"]).max() / largest
            assert apart < 1e-12 and gradients < 1e-11, (solver, name, apart, gradients)
            if threads == 1:
                record(
                    f"{len(x):8} nodes, jaxcable {name}, jax_fdm {solver}: positions "
                    f"{apart:.1e} apart, gradients {gradients:.1e}"
                )
    return version


def run(cases, _):
    if "JAX_FDM_PYTHON" not in os.environ:
        sys.exit("JAX_FDM_PYTHON is not set: the interpreter of an environment with jax_fdm")
    record = Record("force_density")
    record(
        "\nms, median (quartiles); ratios are over jaxcable with PARDISO\n"
        f"{'unknowns':>8} {'':26} {'value':>21} {'value and gradient':>21} {'ratio, value':>18} "
        f"{'ratio, gradient':>18}"
    )
    for n in cases.forms:
        version = compare(n, record)
    record(f"\njax_fdm {version['version']} on jax {version['jax']}")
    record.close()
