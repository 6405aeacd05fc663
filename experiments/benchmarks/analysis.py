"""Measure one analysis, or one batch of load cases, in this process.

Reads a case as a line of JSON from stdin, and answers with a line of JSON. Keys of a case, all but
the first optional:

    scene         name of a ready scene, "saddle 20" (20 x 20 free nodes) or "bare"; with
                  " fused" after it, `jaxcable.fuse_loops` comes first
    load          N, down on each free node of a saddle
    kinds         of "jitted" (a number of its results inside of `jax.jit`; the default) and
                  "gradient" (the same with its gradient)
    of            what they are functions of: "nodes" (sum of squared displacements, the default) or
                  "pretension" (deflection of the middle of a saddle)
    repeats       warm calls of each kind by turns; default 0
    solver, tol   of `Newton`
    pieces        whether to time assembly and the bare linear solver
    cases, chunk, devices         of a batch of random loads, the devices made of one processor
    platform, dtype               "cpu" or "gpu"; "float64" (default) or "float32"

Answer: of each kind first_s (until the first result), ms (list, warm), stages (seconds to trace,
lower, compile) and lines (of StableHLO); peak_MB (largest resident memory, with
the first kind and with all); status, and with pretensions z_middle, iterations, factorizations,
residual (relative, largest of the phases) and slack; the pieces: assembly_ms (residual and
tangent), factor_ms, solve_ms (of the loaded state, outside of jax). Of a batch: us_a_case and
us_a_gradient (lists), first_s and cores (processor time over wall time) of both, iterations
(largest), failed. Always jax, its version.
"""

import functools
import itertools
import json
import os
import re
import sys
import time
from pathlib import Path

import numpy as np

DEFAULTS = {"load": None, "kinds": ["jitted"], "of": "nodes", "repeats": 0, "solver": None}
DEFAULTS |= {"tol": None, "pieces": False, "cases": None, "chunk": None, "devices": 1}
DEFAULTS |= {"platform": None, "dtype": "float64"}


def started(case):
    """Import jax with the platform, devices and precision of the case."""
    if case["devices"] > 1:  # see several_devices.py
        flag = f"--xla_force_host_platform_device_count={case['devices']}"
        os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} {flag}"
        os.environ.setdefault("NPROC", str(max(os.cpu_count(), 4 * case["devices"])))
    import jax

    jax.config.update("jax_enable_x64", True)
    if case["platform"]:
        jax.config.update("jax_default_device", jax.devices(case["platform"])[0])
    import jaxcable as jc

    if "fused" in case["scene"].split():
        jc.fuse_loops()
    jax.block_until_ready(jax.numpy.zeros(3) + 1.0)


def scene_of(case):
    """Structure and phases."""
    import scenes

    import jaxcable as jc

    name, *words = case["scene"].removesuffix(" fused").split()
    if name == "saddle":
        options = {} if case["load"] is None else {"load": case["load"]}
        structure, phases = jc.scenes.saddle(int(words[0]), int(words[0]), **options)
    else:
        structure, phases = scenes.EVERY[name]()
    return jc.replace(structure, nodes=np.asarray(structure.nodes, case["dtype"])), phases


def peak():
    """Largest resident memory of this process so far, MB."""
    text = Path("/proc/self/status").read_text(encoding="utf-8")
    return int(re.search(r"VmHWM:\s+(\d+)", text).group(1)) / 1e3


def compiled(function, argument):
    """The program of a jitted function, seconds to trace, lower and compile it, and its lines."""
    times = [time.perf_counter()]
    traced = function.trace(argument)
    times.append(time.perf_counter())
    lowered = traced.lower()
    times.append(time.perf_counter())
    program = lowered.compile()
    times.append(time.perf_counter())
    stages = [b - a for a, b in itertools.pairwise(times)]
    return program, {"stages": stages, "lines": lowered.as_text().count("\n")}


def analyses(case):
    """First and warm calls of each kind."""
    import jax
    import jax.numpy as jnp
    from measure import by_turns, clock

    import jaxcable as jc

    structure, phases = scene_of(case)
    method = jc.Newton(tol=case["tol"], linear_solver=case["solver"])
    by_pretension = case["of"] == "pretension"
    if by_pretension:
        start = np.full(len(structure.elements.links), phases[0].pretension, case["dtype"])
        free = phases[1].loads.nodes.array
        side = round(len(free) ** 0.5)
        middle = int(free[side // 2 * side + side // 2])
    else:
        start = structure.nodes

    def solve(x):
        if by_pretension:
            prestress = jc.replace(phases[0], pretension=x)
            return jc.solve(structure, [prestress, *phases[1:]], method)
        return jc.solve(jc.replace(structure, nodes=x), phases, method)

    def number(x):
        solution = solve(x)
        if by_pretension:
            return solution.displacement[middle, 2], (solution.tension, solution.status)
        return jnp.sum(solution.displacement**2), solution.status

    kinds = {"jitted": number, "gradient": jax.value_and_grad(number, has_aux=True)}
    answer, functions, peaks = {}, [], []
    for kind in case["kinds"]:
        begin = time.perf_counter()
        start = jnp.asarray(start)
        function, told = compiled(jax.jit(kinds[kind]), start)
        result = jax.block_until_ready(function(start))
        answer[kind] = {"first_s": time.perf_counter() - begin, **told}
        functions.append(function)
        peaks.append(peak())
    status = result[1] if kind == "jitted" else result[0][1]
    answer["status"] = int(status[1] if by_pretension else status)
    warm = by_turns(functions, case["repeats"], lambda k: start * (1 + 1e-8 * k))
    for kind, own in zip(case["kinds"], warm.T, strict=True):
        answer[kind]["ms"] = own.tolist()
    answer["peak_MB"] = [peaks[0], peak()]
    if by_pretension:
        solution = jax.jit(solve)(start)
        paths = [phase.path for phase in solution.phases]
        answer |= {
            "z_middle": float(solution.displacement[middle, 2]),
            "iterations": int(sum(path.iterations.sum() for path in paths)),
            "factorizations": int(sum(path.factorizations.sum() for path in paths)),
            "residual": float(max(path.relative_residual[-1] for path in paths)),
            "slack": int(paths[-1].n_slack[-1]),
        }
        if case["pieces"]:
            answer |= pieces(structure, solution, case, clock)
    return answer


def pieces(structure, solution, case, clock):
    """Times of assembly and of the bare solver, ms."""
    import jax
    import jax.numpy as jnp

    from jaxcable import linear
    from jaxcable.common.tree import merge_indices, split_indices
    from jaxcable.linear import host
    from jaxcable.mechanics.restart_state import make_system
    from jaxcable.spaces.dof_map import make_dof_map

    fixed = structure.fixed(structure.supports)
    links = tuple((group.links, group.n_freedom, ()) for group in structure.groups)
    dof_map = make_dof_map(fixed, None, links, case["solver"])
    without_indices, arrays = split_indices(
        (structure.nodes, structure.groups, solution.last.restart)
    )
    nodes, groups, restart = merge_indices(
        without_indices, [jnp.asarray(array) for array in arrays]
    )
    system = make_system(nodes, groups, restart, restart.motion, dof_map)
    assemble = jax.jit(lambda system, x: (system.residual_and_scale(x), system.tangent(x)))
    calls = [clock(assemble, system, restart.motion) for _ in range(1 + case["repeats"])]
    matrix = calls[-1][1][1]
    pattern = (np.asarray(a) for a in (matrix.pattern.indptr, matrix.pattern.indices))
    analysed = host.AnalysedPattern(linear.solver_named(case["solver"]), True, *pattern)
    values, b = np.asarray(matrix.values)[analysed.take], np.ones(analysed.n)
    pairs = []
    for _ in range(1 + case["repeats"]):  # the first makes the analysis
        begin = time.perf_counter()
        factor = analysed.analysis.factorize(values, True)
        halfway = time.perf_counter()
        factor.solve(b)
        pairs.append((1e3 * (halfway - begin), 1e3 * (time.perf_counter() - halfway)))
        factor.release()
    factors, solves = zip(*pairs[1:], strict=True)
    assembly = [1e3 * spent for spent, _ in calls[1:]]
    return {"assembly_ms": assembly, "factor_ms": factors, "solve_ms": solves}


def batch(case):
    """Random loads on all free nodes of a saddle."""
    import jax
    import jax.numpy as jnp
    from measure import clock

    import jaxcable as jc

    structure, phases = scene_of(case)
    loaded = phases[1].loads.nodes.array
    method = jc.Newton(tol=case["tol"])
    rng, shape = np.random.default_rng(0), (case["cases"], len(loaded), 3)
    forces = jnp.asarray(rng.uniform(-1000.0, 1000.0, shape), case["dtype"])
    pretension = jnp.full(len(structure.elements.links), 20e3, case["dtype"])

    def one(pretension, force):
        loading = jc.Phase(loads=jc.NodalLoads(loaded, force))
        solution = jc.solve(structure, [jc.Phase(pretension=pretension), loading], method)
        steps = sum(phase.path.iterations.sum() for phase in solution.phases)
        return solution.displacement, solution.tension, solution.status, steps

    def height(pretension, force):
        return jnp.mean(one(pretension, force)[0][:, 2])

    devices = jax.devices() if case["devices"] > 1 else None

    def every(pretension, forces):
        own = functools.partial(one, pretension)
        return jc.batched(own, case["chunk"], devices=devices)(forces)

    def mean(pretension, forces):
        return jnp.mean(every(pretension, forces)[0][..., 2])

    if "fused" in case["scene"]:  # chunks by threads, and the gradient of every case
        own = {"case": one, "gradient": jax.grad(height)}
        functions = {
            kind: jc.batched(functools.partial(function, pretension), case["chunk"])
            for kind, function in own.items()
        }
    else:
        functions = {
            "case": functools.partial(jax.jit(every), pretension),
            "gradient": functools.partial(jax.jit(jax.grad(mean, argnums=(0, 1))), pretension),
        }
    answer = {}
    for kind, function in functions.items():
        first, result = clock(function, forces)
        busy, begun = time.process_time(), time.perf_counter()
        times = [clock(function, forces)[0] for _ in range(case["repeats"])]
        busy = (time.process_time() - busy) / (time.perf_counter() - begun)
        if kind == "case":
            answer["iterations"] = int(result[3].max())
            answer["failed"] = int((result[2] != 0).sum())
        answer[f"us_a_{kind}"] = [1e6 * own / case["cases"] for own in times]
        answer |= {f"first_{kind}_s": first, f"cores_{kind}": busy}
    return answer


def main():
    case = DEFAULTS | json.loads(sys.stdin.readline())
    sys.path.insert(0, str(Path(__file__).parent.parent))
    started(case)
    import jax

    if case["scene"] == "bare":
        from bare import bare

        function, numbers = bare()
        _, told = compiled(jax.jit(lambda own: function(*own)), numbers)
        answer = told | {"first_s": sum(told["stages"])}
    else:
        answer = analyses(case) if case["cases"] is None else batch(case)
    print(json.dumps(answer | {"jax": jax.__version__}), flush=True)


if __name__ == "__main__":
    main()
