"""Call an analysis some times in this process: a line of JSON on stdin, another one as the answer.

Keys: scene (name of a ready scene), kind ("plain", "gradient", "after": the gradient after a plain
call, "hessian", "batch": 64 scaled nets, "modes": after a plain call, "fit": of the phases'
pretension, "tune": of shortenings of a footbridge), way (of `jaxcable.evaluation`), calls, kept
(folder of kept programs, or null).
Answer: seconds of each call (list), programs that XLA has compiled, version of jax.
"""

import json
import sys
import time
from pathlib import Path


def main():
    case = json.loads(sys.stdin.readline())
    import jax

    jax.config.update("jax_enable_x64", True)
    import jax.numpy as jnp
    import numpy as np

    sys.path.insert(0, str(Path(__file__).parents[1]))
    import scenes

    import jaxcable as jc

    compiled = []

    def hear(event, *_, **__):
        if "backend_compile" in event:
            compiled.append(event)

    jax.monitoring.register_event_duration_secs_listener(hear)
    jc.evaluation(case["way"])
    if case.get("kept"):
        jax.config.update("jax_compilation_cache_dir", case["kept"])
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    structure, phases = scenes.EVERY[case["scene"]]()
    nodes = np.asarray(structure.nodes)

    def solve(x):
        return jc.solve(jc.replace(structure, nodes=x), phases)

    def square(x):
        return jnp.sum(solve(x).displacement ** 2)

    def moved(pair):
        return jnp.sum(solve(nodes * pair[0]).displacement ** 2) * pair[1]

    def fit(k):
        """Find the pretension of every cable from their forces under load."""
        given = np.full(len(structure.elements.links), phases[0].pretension)

        def tension(p):
            return jc.solve(structure, [jc.replace(phases[0], pretension=p), *phases[1:]]).tension

        measured = np.asarray(tension(given * (1.02 + 1e-3 * k)))
        return jc.fit(lambda p: tension(p) - measured, given)

    def tune(k):
        """Level the deck of a footbridge in stages by its nine hangers."""
        bridge, stages = jc.scenes.suspension_footbridge(10)
        turned = dict.fromkeys(bridge.elements) | {"hangers": np.zeros(9)}
        stages[-1] = jc.replace(stages[-1], shortening=turned)
        level = jc.design.Target("positions", 1e-3 * k, at=(np.arange(16, 25), 2))
        return jc.design.tune(bridge, stages, [(-1 % len(stages), "shortening")], level)

    factors = np.linspace(0.9, 1.1, 64)
    functions = {
        "plain": lambda k: solve(nodes * (1 + 1e-7 * k)),
        "gradient": lambda k: jax.grad(square)(nodes * (1 + 1e-7 * k)),
        "hessian": lambda k: jax.hessian(moved)(np.array([1 + 1e-7 * k, 1.0])),
        "batch": lambda k: jax.vmap(lambda f: solve(nodes * (1 + 1e-3 * f)).tension)(factors + k),
        "modes": lambda k: jc.dynamics.modes(
            structure, solve(nodes * (1 + 1e-7 * k)), masses=np.full(len(nodes), 10.0)
        ),
        "fit": fit,
        "tune": tune,
    }
    functions["after"] = functions["gradient"]
    if case["kind"] in ("after", "modes"):
        jax.block_until_ready(functions["plain"](0))
    times = []
    for k in range(case["calls"]):
        begin = time.perf_counter()
        found = jax.block_until_ready(functions[case["kind"]](k))
        times.append(time.perf_counter() - begin)
    if case["kind"] in ("plain", "fit", "tune"):
        status = jc.describe(found.status)
        assert status.startswith("converged"), status
    print(json.dumps({"s": times, "compiled": len(compiled), "jax": jax.__version__}))


if __name__ == "__main__":
    main()
