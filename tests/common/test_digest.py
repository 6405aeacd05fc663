"""Digests of functions: of what they compute, with all constants, the same in every process."""

import dataclasses
import functools
import os
import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np

from jaxcable.common import digest


def of(function, *arguments):
    return digest.of_function(function, *(arguments or (np.ones(3),)))


def test_what_is_computed_counts_and_not_how_it_is_called():
    values = np.arange(3.0)

    def named(x):
        helper = jax.jit(lambda y: y * values)
        return {"a": helper(x)}

    def other_name(z):
        return {"a": jax.jit(lambda y: y * np.arange(3.0))(z)}

    assert of(named) == of(named) == of(other_name)
    found = [
        of(named),
        of(lambda x: {"b": jax.jit(lambda y: y * values)(x)}),  # another name of the result
        of(lambda x: {"a": jax.jit(lambda y: y + values)(x)}),
        of(lambda x: {"a": jax.jit(lambda y: y * (values + 1))(x)}),
        of(named, np.ones(3, np.float32)),
        of(lambda x: x),
        of(lambda x: x, np.ones((2, 3))),
        of(lambda x: 2.0 * x),
        of(lambda x: jax.lax.scan(lambda s, _: (s * x, None), x, None, length=3)[0]),
        of(lambda x: jax.lax.scan(lambda s, _: (s * x, None), x, None, length=4)[0]),
        of(lambda x: jax.lax.cond(x[0] > 0, lambda: x, lambda: -x)),
        of(lambda x: jax.lax.cond(x[0] > 0, lambda: x, lambda: -2 * x)),
        of(lambda x: x + jax.random.normal(jax.random.key(0))),
        of(lambda x: x + jax.random.normal(jax.random.key(1))),
    ]
    assert len(set(found)) == len(found)


def test_large_constants_count_to_their_last_byte():
    values = np.zeros(200_000)
    before = of(lambda x: x + jnp.asarray(values).sum())
    values[123_456] = 1e-300
    assert of(lambda x: x + jnp.asarray(values).sum()) != before


@dataclasses.dataclass(eq=False)
class Offset:
    by: np.ndarray

    def __call__(self, x):
        return np.asarray(x) + self.by


def test_functions_on_the_host_count_by_code_and_closure():
    def calls(function):
        shape = jax.ShapeDtypeStruct((3,), float)
        return lambda x: jax.pure_callback(function, shape, x)

    def times(factor):
        return lambda x: np.asarray(x) * factor

    def recursive(depth):
        def again(x):
            return x if depth else again(x)

        return again

    large = np.zeros(5000)
    large[2500] = 1.0
    found = [
        of(calls(times(2.0))),
        of(calls(times(3.0))),
        of(calls(times(large))),
        of(calls(times(2 * large))),
        of(calls(lambda x: np.asarray(x) + 2.0)),
        of(calls(Offset(large))),
        of(calls(Offset(2 * large))),
        of(calls(functools.partial(np.multiply, 2.0))),
        of(calls(functools.partial(np.multiply, 3.0))),
        of(calls(Offset(large).__call__)),
        of(calls(Offset(2 * large).__call__)),
        of(calls(recursive(0))),
        of(calls(recursive(1))),
    ]
    assert len(set(found)) == len(found)
    assert of(calls(times(2.0))) == found[0] and of(calls(Offset(large))) == found[5]


PROGRAM = """
import jax, numpy as np
jax.config.update("jax_enable_x64", True)
import jaxcable as jc
from jaxcable.common import digest

structure, phases = jc.scenes.flat_net()
def analysed(load):
    loads = [jc.replace(one, forces=one.forces * load) for one in jc.loads.as_list(phases[1].loads)]
    solution = jc.solve(structure, [phases[0], jc.replace(phases[1], loads=loads)])
    return {"z": solution.displacement, "names": {k: solution.status for k in {"a", "b", "c"}}}
print(digest.of_function(jc.batched(analysed, 4), np.ones(5)))
def host(x):
    return jax.pure_callback(lambda y: np.asarray(y) * 2.0, jax.ShapeDtypeStruct((), float), x)
print(digest.of_function(host, 1.0))
"""


def test_processes_agree():
    """Texts have other hashes, and objects other addresses, in every process."""
    told = set()
    for seed in ("1", "2"):
        environment = {**os.environ, "PYTHONHASHSEED": seed}
        command = [sys.executable, "-c", PROGRAM]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
        told.add(done.stdout)
    (both,) = told
    assert len(set(both.split())) == 2
