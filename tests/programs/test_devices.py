"""Programs of arrays that are bound to a device, or spread over several, in a process with two."""

import os
import subprocess
import sys
import textwrap

CODE = """
    import jax
    import numpy as np
    from jax.sharding import Mesh, NamedSharding, PartitionSpec

    from jaxcable.programs.program_calls import as_program

    jax.config.update("jax_enable_x64", True)
    devices, x = jax.devices(), np.arange(4.0)
    assert len(devices) == 2
    run = as_program(lambda x, a: a * x**2)
    spread = NamedSharding(Mesh(np.asarray(devices), ("cases",)), PartitionSpec("cases"))
    for place in (None, devices[1], spread, devices[0]):
        at = x if place is None else jax.device_put(x, place)
        where = {devices[0]} if place is None else at.sharding.device_set
        batch, change = jax.vmap(run, (0, None))(at, 2.0), jax.jvp(run, (at, 2.0), (x, 0.0))[1]
        found = run(at, 2.0), batch, change
        for own, other in zip(found, (2 * x**2, 2 * x**2, 4 * x**2), strict=True):
            assert own.sharding.device_set == where
            np.testing.assert_array_equal(own, other)
"""


def test_programs_run_where_their_arrays_are():
    environment = {**os.environ, "JAX_PLATFORMS": "cpu"}
    environment["XLA_FLAGS"] = "--xla_force_host_platform_device_count=2"
    words = [sys.executable, "-c", textwrap.dedent(CODE)]
    subprocess.run(words, env=environment, check=True, timeout=300)
