"""jaxcable's side of the batches in `scaling.py`: random loads on a net of 48 unknowns.

Reads a case, a line of JSON on stdin, with the keys cases, chunk, devices (made of one processor)
and, optional, fused (`jaxcable.fuse_loops`, chunks by threads). Answers with a line: first_s
(compilation and run), us_a_case (a list, warm, both phases for every case), us_a_gradient (of the
mean deflection with respect to all pretensions and all loads; if fused, of that of every case with
respect to all pretensions), cores (processor time over wall time), iterations (largest), failed.
"""

import functools
import json
import os
import sys
import time

CASE = json.loads(sys.stdin.readline())
FLAG = f"--xla_force_host_platform_device_count={CASE['devices']}"
os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} {FLAG}"
if CASE["devices"] > 1:  # see distributed.py
    os.environ.setdefault("NPROC", str(max(os.cpu_count(), 4 * CASE["devices"])))

import jax

jax.config.update("jax_enable_x64", True)
import jax.numpy as jnp
import numpy as np

import jaxcable as jc

if CASE.get("fused"):
    jc.fuse_loops()


def main():
    structure, phases = jc.scenes.saddle(4, 4)
    loaded = phases[1].loads.nodes.array
    method = jc.Newton(tol=1e-8)
    forces = np.random.default_rng(0).uniform(-1000.0, 1000.0, (CASE["cases"], 16, 3))
    pretension = jnp.full(len(structure.elements.links), 20e3)

    def one(pretension, force):
        loading = jc.Phase(loads=jc.NodalLoads(loaded, force))
        solution = jc.solve(structure, [jc.Phase(pretension=pretension), loading], method)
        steps = sum(phase.path.iterations.sum() for phase in solution.phases)
        return solution.displacement, solution.tension, solution.status, steps

    def mean(pretension, forces):
        return jnp.mean(cases(pretension, forces)[0][..., 2])

    devices = jax.devices() if CASE["devices"] > 1 else None

    def cases(pretension, forces):
        return jc.batched(lambda F: one(pretension, F), CASE["chunk"], devices=devices)(forces)

    def height(pretension, force):
        return jnp.mean(one(pretension, force)[0][:, 2])

    functions = {"case": jax.jit(cases), "gradient": jax.jit(jax.grad(mean, argnums=(0, 1)))}
    if CASE.get("fused"):
        each = {"case": one, "gradient": jax.grad(height)}
        each = {name: functools.partial(own, pretension) for name, own in each.items()}
        batches = {name: jc.batched(own, CASE["chunk"]) for name, own in each.items()}
        functions = {name: lambda _, F, own=own: own(F) for name, own in batches.items()}
    answer = {}
    for name, function in functions.items():
        begin = time.perf_counter()
        result = jax.block_until_ready(function(pretension, forces))
        first = time.perf_counter() - begin
        times, busy = [], time.process_time()
        begun = time.perf_counter()
        for _ in range(9):
            begin = time.perf_counter()
            result = jax.block_until_ready(function(pretension, forces))
            times.append(1e6 * (time.perf_counter() - begin) / CASE["cases"])
        busy = (time.process_time() - busy) / (time.perf_counter() - begun)
        if name == "case":
            answer["iterations"] = int(result[3].max())
            answer["failed"] = int((result[2] != 0).sum())
        answer |= {f"us_a_{name}": times, f"first_{name}_s": first, f"cores_{name}": busy}
    print(json.dumps(answer), flush=True)


if __name__ == "__main__":
    main()
