"""jax_fdm's side of the force density benchmark: its sparse equilibrium model on one net.

Run by the interpreter named in JAX_FDM_PYTHON, with the path of an .npz file as argument: nodes,
links, anchors, load (the net), q (force densities, [n_call, n_elem], one row for every call).
Answers lines of JSON on stdin, {"call": k, "what": "value" | "gradient", "solver": ...}, with the
time of that call, ms; {"save": path} writes positions and gradient of the first row. Solvers:

    scipy     as it comes: `scipy.sparse.linalg.spsolve` (SuperLU) in a callback
    pardiso   the callback replaced by `pypardiso.spsolve`, if that is installed beside it
"""

import json
import os
import sys
import time

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import jax

jax.config.update("jax_enable_x64", True)
import jax.numpy as jnp
import numpy as np
from jax_fdm.equilibrium import (
    EquilibriumModelSparse,
    EquilibriumParametersState,
    EquilibriumStructureSparse,
    LoadState,
)
from jax_fdm.equilibrium import sparse as fdm_sparse

net = np.load(sys.argv[1])
nodes, links, anchors = net["nodes"], net["links"], net["anchors"]
supports = np.zeros(len(nodes), int)
supports[anchors] = 1
structure = EquilibriumStructureSparse(np.arange(len(nodes)), links, supports)
model = EquilibriumModelSparse(tmax=1)
held, loads = jnp.asarray(nodes[anchors]), LoadState(jnp.asarray(net["load"]), 0.0, 0.0)
rows = [jax.block_until_ready(jnp.asarray(row)) for row in net["q"]]


def positions(q):
    parameters = EquilibriumParametersState(q, held, loads)
    free = model.nodes_free_positions(q, held, parameters.loads.nodes, structure)
    return model.nodes_positions(free, held, structure)


def measure(q):
    x = positions(q)
    along = x[links[:, 1]] - x[links[:, 0]]
    return jnp.sum(along**2)


def spsolve_pardiso(A, b):
    import pypardiso
    import scipy.sparse as sp

    def callback(data, indices, indptr, b):
        data, indices, indptr, b = map(np.asarray, (data, indices, indptr, b))
        matrix = sp.csr_matrix((data, indices, indptr), A.shape)  # symmetric
        return pypardiso.spsolve(matrix, b).reshape(b.shape)

    return jax.pure_callback(callback, b, A.data, A.indices, A.indptr, b)


original, programs = fdm_sparse.spsolve, {}


def program(what, solver):
    """The compiled function; compiled while its solver is in place."""
    if (what, solver) not in programs:
        fdm_sparse.spsolve = original if solver == "scipy" else spsolve_pardiso
        function = jax.jit(positions if what == "value" else jax.value_and_grad(measure))
        jax.block_until_ready(function(rows[0]))
        programs[what, solver] = function
    return programs[what, solver]


for line in sys.stdin:
    order = json.loads(line)
    if "save" in order:
        solver = order["solver"]
        x, (_, gradient) = (program(w, solver)(rows[0]) for w in ("value", "gradient"))
        np.savez(order["save"], x=np.asarray(x), gradient=np.asarray(gradient))
        answer = {"version": __import__("jax_fdm").__version__, "jax": jax.__version__}
    else:
        function, q = program(order["what"], order["solver"]), rows[order["call"]]
        begin = time.perf_counter()
        jax.block_until_ready(function(q))
        answer = {"ms": 1e3 * (time.perf_counter() - begin)}
    print(json.dumps(answer), flush=True)
