"""How programs are traced and compiled: those of small analyses in half the time."""

from __future__ import annotations

import contextlib
import functools
import gc
from collections.abc import Iterator

import jax
import jax.numpy as jnp

# XLA's older emitters of CPU code take half as long to compile as the present ones (jax 0.10). What
# they make is as fast for some hundred unknowns, and up to half as slow again for thousands.
_QUICK = {"xla_cpu_use_fusion_emitters": False}
_SMALL = 400  # unknowns


def program(function, static=()):
    """`jax.jit` of a function, which gets one more argument, ``size``: the number of unknowns.

    If they are few it is compiled quickly. Inside of another program that one's compilation counts,
    and the argument is ignored.
    """
    plain = jax.jit(function, static_argnames=static)
    quick = jax.jit(function, static_argnames=static, compiler_options=_QUICK)

    @functools.wraps(function)
    def run(*arguments, size, **options):
        small = size <= _SMALL and _by_itself(arguments) and _has_quick()
        with without_collection():
            return (quick if small else plain)(*arguments, **options)

    run.sizes = lambda: plain._cache_size() + quick._cache_size()
    run.plain = plain
    return run


@contextlib.contextmanager
def without_collection() -> Iterator[None]:
    """Python's collector of cyclic garbage does not run meanwhile.

    To trace a program makes a million objects, hardly any of them garbage; the collector would take
    up to a third of that time to find this out.
    """
    if not gc.isenabled():
        yield
        return
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


def _by_itself(arguments):
    """Whether a program is compiled by itself and not as part of another one."""
    if any(isinstance(x, jax.core.Tracer) for x in jax.tree.leaves(arguments)):
        return False
    return not isinstance(jnp.zeros(()), jax.core.Tracer)  # what is made anew while one is traced


@functools.cache
def _has_quick():
    """Whether this XLA knows the option, and compiles for CPUs."""
    if jax.default_backend() != "cpu":
        return False
    try:
        jax.jit(lambda: jnp.zeros(()), compiler_options=_QUICK)()
    except jax.errors.JaxRuntimeError:
        return False
    return True
