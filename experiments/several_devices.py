"""Do many load cases give the same answers on several devices and in several processes?

Question: load cases of a saddle net of 48 unknowns, distributed over devices by `jc.batched`; their
displacements, and the gradient of their mean deflection with respect to all pretensions.
Reference: the same cases by `jax.vmap` on one device of the same process. Error: largest
difference, m and m/N. Time: of the second call, results on the devices.

One process, with one processor as four devices:

    python experiments/several_devices.py --devices 4

Two processes on one machine, two devices each (both commands at once, in two terminals):

    python experiments/several_devices.py --devices 2 --processes 2 --rank 0
    python experiments/several_devices.py --devices 2 --processes 2 --rank 1

On several machines give ``--address HOST:PORT`` of the first process. A net too large for dense
matrices runs in the same way (``--side 12``); its matrices are factorised on the host, one after
the other.
"""

import argparse
import json
import os
import time


def arguments():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--devices", type=int, default=1, help="devices of this process")
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--rank", type=int, default=0, help="number of this process, from 0")
    parser.add_argument("--address", default="127.0.0.1:47171", help="of process 0")
    parser.add_argument("--cases", type=int, default=1000)
    parser.add_argument("--chunk", type=int, default=128)
    parser.add_argument("--side", type=int, default=4, help="free nodes a side of the net")
    parser.add_argument("--tol", type=float, default=1e-10, help="of Newton's method")
    return parser.parse_args()


def main():
    given = arguments()
    flags = os.environ.get("XLA_FLAGS", "")
    os.environ["XLA_FLAGS"] = f"{flags} --xla_force_host_platform_device_count={given.devices}"
    # Devices made of one processor wait for each other in threads of one pool, which is as large as
    # the number of cores: with more devices than that they would wait for ever.
    if given.devices > 1:
        os.environ.setdefault("NPROC", str(max(os.cpu_count(), 4 * given.devices)))
    import jax

    jax.config.update("jax_enable_x64", True)
    if given.processes > 1:
        jax.distributed.initialize(given.address, given.processes, given.rank)
    import jax.numpy as jnp
    import numpy as np
    from jax.experimental import multihost_utils

    import jaxcable as jc

    structure, phases = jc.scenes.saddle(given.side, given.side)
    loaded = phases[1].loads.nodes.array
    forces = np.random.default_rng(0).uniform(-1000.0, 1000.0, (given.cases, len(loaded), 3))

    def displacement(pretension, force):
        loading = jc.Phase(loads=jc.NodalLoads(loaded, force))
        phases = [jc.Phase(pretension=pretension), loading]
        solution = jc.solve(structure, phases, jc.Newton(tol=given.tol))
        return jnp.where(solution.status == 0, solution.last.displacement, jnp.nan)

    def mapped(devices, chunk):
        def everywhere(pretension, forces):
            return jc.batched(lambda F: displacement(pretension, F), chunk, devices=devices)(forces)

        def mean(pretension, forces):
            return jnp.mean(everywhere(pretension, forces)[..., 2])

        return jax.jit(everywhere), jax.jit(jax.grad(mean))

    pretension = np.full(len(structure.elements.links), 20e3)
    answers, seconds = [], []
    for devices, chunk in ((jax.devices(), given.chunk), (jax.local_devices()[:1], None)):
        for function in mapped(devices, chunk):
            jax.block_until_ready(function(pretension, forces))
            begin = time.perf_counter()
            result = jax.block_until_ready(function(pretension, forces))
            seconds.append(time.perf_counter() - begin)
            answers.append(np.asarray(multihost_utils.process_allgather(result, tiled=True)))
    if len(answers[2]) > given.cases:  # of the processes' own copies one
        answers[2], answers[3] = answers[2][: given.cases], answers[3][: len(pretension)]
    figures = {
        "process": given.rank,
        "devices": len(jax.devices()),
        "cases": given.cases,
        "unknowns": 3 * len(loaded),
        "displacement_difference_m": float(np.abs(answers[0] - answers[2]).max()),
        "gradient_difference": float(np.abs(answers[1] - answers[3]).max()),
        "largest_displacement_m": float(np.abs(answers[2]).max()),
        "largest_gradient": float(np.abs(answers[3]).max()),
        "us_a_case": 1e6 * seconds[0] / given.cases,
        "us_a_case_on_one_device": 1e6 * seconds[2] / given.cases,
    }
    print(json.dumps(figures), flush=True)


if __name__ == "__main__":
    main()
