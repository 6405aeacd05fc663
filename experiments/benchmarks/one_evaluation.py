"""Call an analysis some times in this process: a line of JSON on stdin, another one as the answer.

Keys: scene (name of a ready scene), kind ("plain", "gradient", "after": the gradient after a plain
call, "hessian", "batch": 64 load factors, "modes"), way (of `jaxcable.evaluation`), calls.
Answer: seconds of each call (list), programs that XLA has compiled, status.
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
    structure, phases = scenes.EVERY[case["scene"]]()
    nodes = np.asarray(structure.nodes)

    def solve(x):
        return jc.solve(jc.replace(structure, nodes=x), phases)

    def square(x):
        return jnp.sum(solve(x).displacement ** 2)

    def moved(pair):
        return jnp.sum(solve(nodes * pair[0]).displacement ** 2) * pair[1]

    factors = np.linspace(0.9, 1.1, 64)
    functions = {
        "plain": lambda k: solve(nodes * (1 + 1e-7 * k)),
        "gradient": lambda k: jax.grad(square)(nodes * (1 + 1e-7 * k)),
        "hessian": lambda k: jax.hessian(moved)(np.array([1 + 1e-7 * k, 1.0])),
        "batch": lambda k: jax.vmap(lambda f: solve(nodes * (1 + 1e-3 * f)).tension)(factors + k),
        "modes": lambda k: jc.natural_frequencies(structure, solve(nodes * (1 + 1e-7 * k)), n=4),
    }
    functions["after"] = functions["gradient"]
    if case["kind"] == "after":
        jax.block_until_ready(functions["plain"](0))
    times = []
    for k in range(case["calls"]):
        begin = time.perf_counter()
        found = jax.block_until_ready(functions[case["kind"]](k))
        times.append(time.perf_counter() - begin)
    status = int(found.status) if case["kind"] == "plain" else None
    print(json.dumps({"s": times, "compiled": len(compiled), "status": status}))


if __name__ == "__main__":
    main()
