"""jaxcable's side of the scaling benchmark: one net in one process.

Reads a case, a line of JSON on stdin, and answers with a line. Keys of a case:

    n             free nodes a side of `jaxcable.scenes.saddle`
    load          N, down on each free node
    solver        linear solver; None is the default
    repeats       timed calls, values and gradients by turns
    gradient      whether to time gradients
    pieces        whether to time assembly and the bare solver
    increments    of the second phase; optional, 1
    plain         optional: solves by conjugate gradients with an old factor are switched off
    searched      optional: plain Newton steps are switched off
    fused         optional: XLA compiles loops to one function each (`jaxcable.fuse_loops`)

Answer: first_s (the first call: analysis of the pattern, compilation, run), value_ms and
gradient_ms (lists, warm), iterations, factorizations, residual (relative, largest of the phases),
status, slack, z_middle, peak_rss_MB after the values alone and after the gradients, and the pieces:
assembly_ms (residual and tangent), factor_ms and solve_ms (the bare solver outside of jax, on the
tangent of the loaded state).
"""

import json
import re
import sys
import time
from pathlib import Path

import jax

jax.config.update("jax_enable_x64", True)
import jax.numpy as jnp
import numpy as np

import jaxcable as jc
from jaxcable.equilibrium import globalisation, newton_step


def peak():
    """Largest resident memory of this process so far, MB."""
    text = Path("/proc/self/status").read_text()
    return int(re.search(r"VmHWM:\s+(\d+)", text).group(1)) / 1e3


def timed(function, *arguments):
    begin = time.perf_counter()
    result = jax.block_until_ready(function(*arguments))
    return 1e3 * (time.perf_counter() - begin), result


def system(structure, solution, solver):
    """The loaded state as a `System` of arrays, and the motion of its nodes."""
    from jaxcable.common.tree import fill, thaw
    from jaxcable.mechanics.carry import make_system
    from jaxcable.spaces.freedoms import number_freedoms

    fixed = structure.fixed(structure.supports)
    links = tuple((group.links, group.n_freedom, ()) for group in structure.groups)
    freedoms = number_freedoms(fixed, None, links, solver)
    thawed, arrays = thaw((structure.nodes, structure.groups, solution.last.carry))
    nodes, groups, carry = fill(thawed, [jnp.asarray(array) for array in arrays])
    made = make_system(nodes, groups, carry, carry.motion, freedoms)
    return made, carry.motion


def pieces(structure, solution, solver, repeats):
    """Times of assembly and of the bare solver, ms."""
    made, x = system(structure, solution, solver)
    assemble = jax.jit(lambda made, x: (made.residual_and_scale(x), made.tangent(x)))
    timed(assemble, made, x)
    times, results = zip(*(timed(assemble, made, x) for _ in range(repeats)), strict=True)
    (residual, _), matrix = results[-1]
    pattern, values = matrix.pattern, np.asarray(matrix.values)
    from jaxcable import linear
    from jaxcable.linear import host

    analysed = host.Analysed(
        linear.named(solver), True, *(np.asarray(a) for a in (pattern.indptr, pattern.indices))
    )
    whole, b = values[analysed.take], np.ones(len(residual))
    factors, solves = [], []
    for k in range(repeats + 1):
        begin = time.perf_counter()
        factor = analysed.analysis.factorize(whole, True)
        middle = time.perf_counter()
        factor.solve(b)
        end = time.perf_counter()
        factor.release()
        if k > 0:  # the first makes the analysis
            factors.append(1e3 * (middle - begin))
            solves.append(1e3 * (end - middle))
    return {"assembly_ms": times, "factor_ms": factors, "solve_ms": solves}


def main():
    case = json.loads(sys.stdin.readline())
    if case.get("fused"):
        jc.fuse_loops()
    if case.get("plain"):
        newton_step.WORTH = 0
    if case.get("searched"):
        globalisation._SPRINT = 0
    n = case["n"]
    structure, phases = jc.scenes.saddle(
        n, n, load=case["load"], increments=(1, case.get("increments", 1))
    )
    middle = int(phases[1].loads.nodes.array[(n // 2) * n + n // 2])
    method = jc.Newton(tol=1e-8, linear_solver=case["solver"])

    def analyse(pretension):
        solution = jc.solve(structure, [jc.Phase(pretension=pretension), phases[1]], method)
        return solution.displacement[middle, 2], solution

    def deflection(pretension):
        z, solution = analyse(pretension)
        return z, solution.tension

    value = jax.jit(deflection)
    gradient = jax.jit(jax.value_and_grad(deflection, has_aux=True))
    T = jnp.full(len(structure.elements.links), 20e3)
    first, _ = timed(value, T)
    answer = {"first_s": first / 1e3, "value_ms": [], "gradient_ms": []}
    answer["peak_rss_MB"] = [peak()]
    if case["gradient"]:
        timed(gradient, T)
    for k in range(case["repeats"]):  # always new numbers: factors are kept by value
        answer["value_ms"].append(timed(value, T * (1 + 1e-7 * (2 * k + 1)))[0])
        if case["gradient"]:
            answer["gradient_ms"].append(timed(gradient, T * (1 + 1e-7 * (2 * k + 2)))[0])
    answer["peak_rss_MB"].append(peak())
    solution = jax.jit(lambda T: analyse(T)[1])(T)
    paths = [phase.path for phase in solution.phases]
    answer |= {
        "status": int(solution.status),
        "z_middle": float(solution.displacement[middle, 2]),
        "iterations": int(sum(path.iterations.sum() for path in paths)),
        "factorizations": int(sum(path.factorizations.sum() for path in paths)),
        "residual": float(max(path.relative_residual[-1] for path in paths)),
        "slack": int(paths[-1].n_slack[-1]),
    }
    if case["pieces"]:
        answer |= pieces(structure, solution, case["solver"], case["repeats"])
    print(json.dumps(answer), flush=True)


if __name__ == "__main__":
    main()
