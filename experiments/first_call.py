"""How long does the first call of an analysis take, and how large is its program?

Question   Seconds to trace, to lower and to compile, and lines of StableHLO, of the analysis of the
           scenes, by itself and as value with gradient; and what becomes of them with the phases.
Reference  A bare analysis of a net of 48 unknowns in the same run: elastic links that pull only,
           Newton steps by a dense Cholesky, two phases in one `lax.scan`. Its first call is the
           unit Y. (It has no other use: no statuses, no searches, one kind of element.)
Error      None: the results are those of the tests. Lines do not depend on the machine.
Command    python experiments/first_call.py [SCENE ...]   (writes experiments/results/first_call.txt
           and .json if no scene is named; ten minutes)

Every first call is one in a process of its own, without compilation cache; the unit is measured
before and after each of them, and its mean taken, since the machine is not as fast every minute.
"plain" is a call of `solve` as it is, with all its results; "jitted" the sum of the squares of the
displacements inside `jax.jit`, as a function of the nodes; "gradient" its value and gradient. Run:
median of 15 further calls, other nodes in each. "fused": after `jaxcable.fuse_loops`.
"""

import itertools
import json
import subprocess
import sys
import time

from record import write

PHASES = (2, 8, 32)
SCENES = {
    "flat net": "flat_net",
    "hypar": "hypar_net",
    "saddle 4 x 4": "saddle",
    "saddle 4 x 4, fused": "saddle fused",
    "cable truss": "cable_truss",
    "Geiger dome": "geiger_dome",
    "isolated cable": "isolated_cable",
    "suspended cable": "suspended_cable",
    "strung arch": "strung_arch",
    "guyed mast": "guyed_mast",
} | {f"flat net, {n} phases": f"phases {n}" for n in PHASES}


def bare():
    """The bare analysis: a function of prestress and load, and these."""
    import jax
    import jax.numpy as jnp
    import numpy as np
    from jax import lax

    import jaxcable as jc

    structure, _ = jc.scenes.saddle(4, 4)
    nodes, links = np.asarray(structure.nodes), structure.elements.links.array
    free = np.flatnonzero(~structure.fixed(structure.supports).array.ravel())
    number = np.full(nodes.size, len(free))
    number[free] = np.arange(len(free))
    place = number.reshape(-1, 3)[links].reshape(-1, 6)
    ends, stiffness = jnp.asarray(nodes[links].reshape(-1, 6)), 16e6
    length = jnp.linalg.norm(ends[:, 3:] - ends[:, :3], axis=1)
    down = jnp.asarray(np.where(free % 3 == 2, -1.0, 0.0))

    def end_forces(ends, motion, rest):
        vector = ends[3:] - ends[:3] + motion[3:] - motion[:3]
        now = jnp.sqrt(jnp.sum(vector**2))
        pull = stiffness * jnp.maximum(now - rest, 0.0) / rest * vector / now
        return jnp.concatenate([-pull, pull])

    def assembled(x, rest, load):
        motion = jnp.append(x, 0.0)[place]
        force = jax.vmap(end_forces)(ends, motion, rest)
        blocks = jax.vmap(jax.jacfwd(end_forces, 1))(ends, motion, rest)
        residual = jnp.zeros(len(free) + 1).at[place].add(force)[:-1] - load
        matrix = jnp.zeros((len(free) + 1,) * 2).at[place[:, :, None], place[:, None, :]]
        return residual, matrix.add(blocks)[:-1, :-1]

    def analyse(prestress, load):
        rest = length / (1 + prestress / stiffness)

        def phase(x, part):
            def turn(run):
                x, _, count = run
                residual, matrix = assembled(x, rest, part * load * down)
                factor = jax.scipy.linalg.cho_factor(matrix)
                x = x - jax.scipy.linalg.cho_solve(factor, residual)
                return x, jnp.max(jnp.abs(residual)), count + 1

            x, _, count = lax.while_loop(
                lambda run: (run[1] > 1e-6 * prestress) & (run[2] < 30), turn, (x, jnp.inf, 0)
            )
            return x, count

        return lax.scan(phase, jnp.zeros(len(free)), jnp.arange(2.0))

    return analyse, (20e3, 1000.0)


def scene_of(name):
    """Structure and phases."""
    import numpy as np

    import jaxcable as jc

    name = name.removesuffix(" fused")
    if not name.startswith("phases"):
        return getattr(jc.scenes, name)(*((4, 4) if name == "saddle" else ()))[:2]
    structure, (prestress, loading) = jc.scenes.flat_net(load=15.0)
    count = int(name.split()[1])
    part = np.asarray(loading.loads.forces) / (count - 1)
    load = jc.Phase(loads=jc.NodalLoads(loading.loads.nodes, part), increments=1)
    return structure, [prestress] + [load] * (count - 1)


def stages(function, *arguments):
    """Seconds to trace, lower and compile, and lines of a jitted function; and what runs."""
    times = [time.perf_counter()]
    traced = function.trace(*arguments)
    times.append(time.perf_counter())
    lowered = traced.lower()
    times.append(time.perf_counter())
    compiled = lowered.compile()
    times.append(time.perf_counter())
    lines = lowered.as_text().count("\n")
    return [b - a for a, b in itertools.pairwise(times)], lines, compiled


def median_run(function, arguments):
    """Median of 15 calls, ms; a list of arguments for each."""
    import jax
    import numpy as np

    spent = []
    for own in arguments:
        begin = time.perf_counter()
        jax.block_until_ready(function(own))
        spent.append(time.perf_counter() - begin)
    return 1e3 * float(np.median(spent[1:]))


def measured(name, kind):
    """One first call, in this process: a dict."""
    import jax

    jax.config.update("jax_enable_x64", True)
    import jax.numpy as jnp
    import numpy as np

    import jaxcable as jc

    if kind == "bare":
        function, numbers = bare()
        seconds, lines, _ = stages(jax.jit(function), *numbers)
        return {"first": sum(seconds), "lines": lines}
    if name.endswith("fused"):
        jc.fuse_loops()
    structure, phases = scene_of(name)
    nodes = np.asarray(structure.nodes)

    def solve(nodes):
        return jc.solve(jc.replace(structure, nodes=nodes), phases)

    others = [nodes * (1 + 1e-9 * k) for k in range(16)]
    if kind == "plain":
        begin = time.perf_counter()
        solution = jax.block_until_ready(solve(nodes))
        first = time.perf_counter() - begin
        return {"first": first, "run": median_run(solve, others), "status": int(solution.status)}

    def moved(nodes):  # nothing is called before: not even its tracing is done
        return jnp.sum(solve(nodes).displacement ** 2)

    function = moved if kind == "jitted" else jax.value_and_grad(moved)
    seconds, lines, compiled = stages(jax.jit(function), jnp.asarray(nodes))
    run = median_run(compiled, [jnp.asarray(own) for own in others])
    return {"first": sum(seconds), "stages": seconds, "lines": lines, "run": run}


def apart(name, kind):
    """`measured` in a process of its own."""
    command = [sys.executable, __file__, "--one", name, kind]
    run = subprocess.run(command, capture_output=True, text=True, check=True)
    return json.loads(run.stdout.splitlines()[-1])


def main(names):
    from record import RESULTS, Record

    record = Record("first_call")
    record(
        "\nY: first call of the bare analysis. plain, jitted, gradient: first calls in Y. Then of\n"
        "jitted | gradient: seconds to trace, lower, compile; lines of StableHLO; a run, ms.\n"
    )
    record(f"{'':22}{'Y, s':>6}{'plain':>7}{'jitted':>8}{'gradient':>9}   g/j")
    rows = {}
    for label in names:
        units, found = [apart("", "bare")["first"]], {}
        for kind in ("plain", "jitted", "gradient"):
            found[kind] = apart(SCENES[label], kind)
            units.append(apart("", "bare")["first"])
        unit = sum(units) / len(units)
        rows[label] = found | {"unit": unit}
        plain, jitted, gradient = (found[kind] for kind in ("plain", "jitted", "gradient"))
        shown = "  ".join(
            f"{own['stages'][0]:.1f} {own['stages'][1]:.1f} {own['stages'][2]:.1f} s"
            f"{own['lines']:7d}{own['run']:8.2f}"
            for own in (jitted, gradient)
        )
        record(
            f"{label:22}{unit:6.2f}{plain['first'] / unit:7.2f}{jitted['first'] / unit:8.2f}"
            f"{gradient['first'] / unit:9.2f}{gradient['first'] / jitted['first']:6.2f}   {shown}"
        )
    if set(names) == set(SCENES):
        record.close()
        write(RESULTS / "first_call.json", json.dumps(rows, indent=1) + "\n")


if __name__ == "__main__":
    if sys.argv[1:2] == ["--one"]:
        print(json.dumps(measured(*sys.argv[2:])))
    else:
        main(sys.argv[1:] or list(SCENES))
