"""What programs depend on, where a call comes from, and how programs are forgotten."""

from __future__ import annotations

import contextlib
import ctypes
import gc
import threading
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import jax

from .jax_internals import is_tracing

_SETTINGS = (
    *("jax_enable_x64", "jax_default_device", "jax_default_matmul_precision"),
    *("jax_numpy_rank_promotion", "jax_numpy_dtype_promotion"),
    *("jax_default_prng_impl", "jax_threefry_partitionable"),
)
_DEBUG_SETTINGS = "jax_disable_jit", "jax_debug_nans", "jax_debug_infs"
"""Settings by which jax runs every operation by itself, or checks it."""


def forget_programs() -> None:
    """Release all compiled programs, analyses of sparsity patterns and factors from memory.

    A process that analyses structures of many different shapes grows with each of them: up to 32
    programs of `jc.solve`, and as many of each similar function, stay in memory, and all programs
    of `jax.jit`. What is needed again is made again.

    Example:
        >>> structure, phases = jc.scenes.flat_net()
        >>> solution = jc.solve(structure, phases)
        >>> jc.forget_programs()
        >>> print(f"{solution.displacement[3, 2]:.4f} m")  # results stay
        -0.0466 m
    """
    jax.clear_caches()
    for forget in _FORGET:
        forget()
    gc.collect()
    # freed memory back to the system: of glibc; Windows cannot open the library of the process
    with contextlib.suppress(OSError, AttributeError, TypeError):
        ctypes.CDLL(None).malloc_trim(0)


_FORGET: list[Callable[[], object]] = []


def on_forget_programs(function: Callable[[], object]) -> Callable[[], object]:
    """Register a function without arguments, which `forget_programs` will call; return it."""
    _FORGET.append(function)
    return function


def is_debugging() -> bool:
    """Tell whether settings of jax disable jit, or have it look for NaN or infinity."""
    return any(getattr(jax.config, name, False) for name in _DEBUG_SETTINGS)


def program_settings() -> tuple[Any, ...]:
    """Return the values of the jax settings that change a compiled program, such as enable_x64."""
    return tuple(getattr(jax.config, name, None) for name in _SETTINGS)


_trace_key = jax.make_user_context()


def trace_cache_context(key: Any) -> contextlib.AbstractContextManager[Any]:
    """Return a context for ``with`` in which jax finds traces of functions made with this key only.

    None is the key outside of all such contexts; a new object as key has no traces.
    """
    return _trace_key(key)


@contextlib.contextmanager
def without_garbage_collection() -> Iterator[None]:
    """Pause Python's garbage collector of cyclic references while a ``with`` block runs.

    Tracing a program makes a million objects, hardly any of them garbage; the collector would take
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


def is_top_level_call(leaves: Sequence[Any]) -> bool:
    """Tell whether a call with these arrays comes from plain Python, not from a traced function.

    `leaves` are the arrays among its arguments; a traced one means that it does not.
    """
    if any(isinstance(x, jax.core.Tracer) for x in leaves):
        return False
    return not is_tracing()
