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
import numpy as np

from .jax_internals import is_tracing, quick_compile_options

# Unknowns up to which a program is compiled with `quick_compile_options`: it is as fast for some
# hundred, and up to half as slow again for thousands.
_QUICK_UNKNOWNS = 400
MOST_PROGRAMS = 32
"""Programs of a function that are known at the same time, so that a process does not grow."""
_SETTINGS = (
    *("jax_enable_x64", "jax_default_device", "jax_default_matmul_precision"),
    *("jax_numpy_rank_promotion", "jax_numpy_dtype_promotion"),
)
_DEBUG_SETTINGS = "jax_disable_jit", "jax_debug_nans", "jax_debug_infs"
"""Settings by which jax runs every operation by itself, or checks it."""


def jit_program(function, static=()):
    """Compile a function as `jax.jit` does, with a faster compiler for programs of few unknowns.

    The result takes more arguments by keyword: ``size``, the number of unknowns, few up to
    `_QUICK_UNKNOWNS`; and ``axes`` for a batch, the axis of every leaf of the arguments, or None.

    Where it is called inside of another jax program, it becomes part of that program as with
    `jax.jit`, and ``size`` is ignored. A call from Python looks for the program among the last
    `MOST_PROGRAMS` of this function, and compiles it if it is not there.

    Args:
        function: its arguments are pytrees of arrays.
        static: names of static arguments, which are hashable and given by keyword. One with the
            name ``alone`` is set here: True if the function is called from Python, False inside of
            another program.
    """
    plain = jax.jit(function, static_argnames=static)
    known, lock = OrderedDict(), threading.Lock()

    @functools.wraps(function)
    def run(*arguments, size, axes=None, **options):
        leaves = jax.tree.leaves(arguments)
        alone = is_top_level_call(leaves)
        if "alone" in static:
            options["alone"] = alone
        if not alone or is_debugging():
            with without_garbage_collection():
                if axes is None:
                    return plain(*arguments, **options)
                tree = jax.tree.structure(arguments)
                return jax.vmap(lambda *own: plain(*tree.unflatten(own), **options), axes)(*leaves)
        return find(arguments, leaves, options, size, axes)(*leaves)

    def find(arguments, leaves, options, size, axes):
        """Return the compiled program: a known one, or a new one."""
        small = size <= _QUICK_UNKNOWNS
        key = (
            jax.tree.structure(arguments),
            tuple(map(argument_signature, leaves)),
            tuple(options.items()),
            small,
            axes,
            program_settings(),
        )
        with lock:
            compiled = known.pop(key, None)
        if compiled is None:
            compiled = _compile(function, arguments, leaves, options, small, axes)
        with lock:
            known[key] = compiled  # as the last one
            while len(known) > MOST_PROGRAMS:
                known.popitem(last=False)
        return compiled

    run.known = known
    _PROGRAMS.append(run)
    return run


def call_announced(program: Callable[..., Any], *arguments: Any) -> Any:
    """Call a function: nothing is announced; here until no caller asks for it."""
    return program(*arguments)


def _compile(function, arguments, leaves, options, small, axes):
    """Return the compiled program of `function`.

    It takes `leaves`, the arrays in the pytrees `arguments`; `options` are static arguments. With
    `small`, compiler options for few unknowns are used; `axes` are those of a batch, or None.
    """
    tree = jax.tree.structure(arguments)

    def own(*leaves):  # jax forgets what it has traced together with it
        return function(*tree.unflatten(leaves), **options)

    program = own if axes is None else jax.vmap(own, axes)
    quick = quick_compile_options() if small else None
    with without_garbage_collection():
        return jax.jit(program, compiler_options=quick).trace(*leaves).lower().compile()


def forget_programs() -> None:
    """Release all compiled programs, analyses of sparsity patterns and factors from memory.

    A process that analyses structures of many different shapes grows with each of them: up to 32
    programs of `jc.solve`, and as many of each similar function, stay in memory, and all programs
    of `jax.jit`. What is needed again is compiled again, or read from disk (`keep_programs`).

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
    # freed memory back to the system: of glibc; Windows cannot open the library of the process
    with contextlib.suppress(OSError, AttributeError, TypeError):
        ctypes.CDLL(None).malloc_trim(0)


_PROGRAMS: list[Any] = []
_FORGET: list[Callable[[], object]] = []


def on_forget_programs(function: Callable[[], object]) -> Callable[[], object]:
    """Register a function without arguments, which `forget_programs` will call; return it."""
    _FORGET.append(function)
    return function


def is_debugging() -> bool:
    """Tell whether settings of jax have it run every operation by itself, or check it."""
    return any(getattr(jax.config, name, False) for name in _DEBUG_SETTINGS)


def program_settings() -> tuple[Any, ...]:
    """Return the values of the jax settings that change a compiled program, such as enable_x64."""
    return tuple(getattr(jax.config, name, None) for name in _SETTINGS)


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
    """Tell whether a call with these arrays comes from Python, not from a traced function."""
    if any(isinstance(x, jax.core.Tracer) for x in leaves):
        return False
    return not is_tracing()


def argument_signature(x: Any) -> Any:
    """Return what a program depends on of an argument: shape, dtype and device; hashable.

    Arrays of NumPy, and those of jax that are bound to no device, are the same to a program.
    """
    if isinstance(x, jax.Array):
        free = not (x.weak_type or getattr(x, "committed", True))
        return (x.shape, x.dtype) if free else (x.shape, x.dtype, x.weak_type, x.sharding)
    plain = np.ndarray | np.generic | jax.ShapeDtypeStruct
    return (x.shape, x.dtype) if isinstance(x, plain) else type(x)
