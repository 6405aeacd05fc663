"""How programs are traced and compiled: programs of small analyses in half the time."""

from __future__ import annotations

import contextlib
import functools
import gc
from collections.abc import Iterator
from typing import Any

import jax
import jax.numpy as jnp
from jax.extend.core import get_opaque_trace_state

# XLA's older emitters of CPU code compile in half the time of the present ones (jax 0.10). Their
# programs are as fast for some hundred unknowns, and take up to half as long again for thousands.
_QUICK = {"xla_cpu_use_fusion_emitters": False}
_SMALL = 400  # unknowns
_UNTRACED = get_opaque_trace_state()  # as long as nothing is being traced


def program(function, static=()):
    """`jax.jit` of a function, with one more argument, ``size``: the number of unknowns.

    A program with few unknowns is compiled quickly. Inside of another program the argument is
    ignored: the function is compiled as part of that program.
    """
    plain = jax.jit(function, static_argnames=static)
    quick = jax.jit(function, static_argnames=static, compiler_options=_QUICK)

    @functools.wraps(function)
    def run(*arguments, size, **options):
        small = size <= _SMALL and by_itself(arguments) and _has_quick()
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


def by_itself(arguments: Any) -> bool:
    """Whether a program is compiled by itself and not as part of another program."""
    if any(isinstance(x, jax.core.Tracer) for x in jax.tree.leaves(arguments)):
        return False
    return get_opaque_trace_state() == _UNTRACED


@functools.cache
def _has_quick():
    """Whether this version of XLA has the option of quick compilation, and compiles for CPUs."""
    if jax.default_backend() != "cpu":
        return False
    try:
        jax.jit(lambda: jnp.zeros(()), compiler_options=_QUICK)()
    except jax.errors.JaxRuntimeError:
        return False
    return True
