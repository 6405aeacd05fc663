"""How programs are traced and compiled: programs of small analyses in half the time."""

from __future__ import annotations

import contextlib
import ctypes
import functools
import gc
import threading
from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import jax

from .jax_internals import is_tracing, quick_options
from .keeping import kept, kind_of
from .progress import compiling

_SMALL = 400  # unknowns up to which a program is compiled quickly
MOST = 32
"""Programs of a function that are known at the same time."""
_SETTINGS = (
    *("jax_enable_x64", "jax_default_device", "jax_default_matmul_precision"),
    *("jax_numpy_rank_promotion", "jax_numpy_dtype_promotion"),
)
_CHECKS = "jax_disable_jit", "jax_debug_nans", "jax_debug_infs"
"""Settings by which jax runs every operation by itself, or checks it."""


def program(function, static=()):
    """`jax.jit` of a function, with one more argument, ``size``: the number of unknowns.

    A program with few unknowns is compiled quickly. Called by itself, the function is compiled here
    and not by `jax.jit`: the last `MOST` programs are known, and no more; they may come from disk
    (`keeping`). Inside of another program the function is compiled as part of that program, and
    `size` is ignored. A function with a static argument ``alone`` is told whether it is called by
    itself.

    Args:
        function: its arguments are pytrees of arrays.
        static: names of further arguments, hashable, to be given by keyword.
    """
    plain = jax.jit(function, static_argnames=static)
    known, lock = OrderedDict(), threading.Lock()

    @functools.wraps(function)
    def run(*arguments, size, **options):
        leaves, tree = jax.tree.flatten(arguments)
        alone = by_itself(leaves)
        if "alone" in static:
            options["alone"] = alone
        if not alone or any(getattr(jax.config, name, False) for name in _CHECKS):
            with without_collection():
                return plain(*arguments, **options)
        small = size <= _SMALL
        key = tree, tuple(map(kind_of, leaves)), tuple(options.items()), small, settings()
        with lock:
            compiled = known.pop(key, None)
        if compiled is None:
            compiled = _compiled(function, arguments, leaves, options, small)
        with lock:
            known[key] = compiled  # as the last one
            while len(known) > MOST:
                known.popitem(last=False)
        return compiled(*leaves)

    run.known = known
    _PROGRAMS.append(run)
    return run


def _compiled(function, arguments, leaves, options, small):
    """The program of a function for arguments like these: from disk, or compiled now.

    It takes the leaves of the arguments, so that a call does not look for them once more.
    """
    words, tree = (function.__module__, function.__qualname__, small), jax.tree.structure(arguments)

    def own(*leaves):  # jax forgets what it has traced together with it
        return function(*tree.unflatten(leaves), **options)

    def compiled():
        quick = quick_options() if small else None
        with compiling(options.get("listen")):
            return jax.jit(own, compiler_options=quick).trace(*leaves).lower().compile()

    with without_collection():
        return kept(compiled, words, arguments, options)


def forget_programs() -> None:
    """Forget all compiled programs, analyses of patterns and factors, and give their memory back.

    A process that analyses structures of many different shapes grows with each of them. The
    programs of the last 32 analyses by `jc.solve` and its like are known at most; those of
    `jax.jit` are as many as there are functions. What is used again is compiled again, or comes
    from disk (`keep_programs`).

    Example:
        >>> structure, phases = jc.scenes.flat_net()
        >>> solution = jc.solve(structure, phases)
        >>> jc.forget_programs()
        >>> print(f"{solution.displacement[3, 2]:.4f} m")  # results stay
        -0.0466 m
    """
    for run in _PROGRAMS:
        run.known.clear()
    jax.clear_caches()
    for forget in _FORGET:
        forget()
    gc.collect()
    with contextlib.suppress(OSError, AttributeError):  # glibc: freed memory back to the system
        ctypes.CDLL(None).malloc_trim(0)


_PROGRAMS: list[Any] = []
_FORGET: list[Callable[[], object]] = []


def forgets(function: Callable[[], object]) -> Callable[[], object]:
    """Have `forget_programs` call a function."""
    _FORGET.append(function)
    return function


def settings() -> tuple[Any, ...]:
    """What a program depends on of jax's settings."""
    return tuple(getattr(jax.config, name, None) for name in _SETTINGS)


@contextlib.contextmanager
def without_collection() -> Iterator[None]:
    """Python's collector of cyclic garbage does not run meanwhile.

    To trace a program makes a million objects, hardly any of them garbage; the collector would take
    up to a third of that time to find this out.
    """
    entered = False
    try:  # an interrupt may come at any line
        with _lock:
            _enabled.append(gc.isenabled())
            entered = True
            gc.disable()
        yield
    finally:
        with _lock:
            # of the first thread, which has found it enabled: the last one here
            if entered and _enabled.pop():
                gc.enable()


_lock = threading.Lock()
_enabled: list[bool] = []  # whether the collector ran when each of the threads that trace came


def by_itself(leaves: Sequence[Any]) -> bool:
    """Whether a program of these arrays is compiled by itself, not as part of another program."""
    if any(isinstance(x, jax.core.Tracer) for x in leaves):
        return False
    return not is_tracing()
