"""Who runs a program: NumPy at once, or XLA after it has compiled. Counted, not timed.

XLA needs some thousand times as long to compile a program as to run it, NumPy some ten times as
long to run it as XLA. A program is compiled when the work that NumPy has done with it, in calls of
NumPy functions, comes near to what the compiler takes. Work is counted while programs are written
and run, so that a script does the same every time.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Iterator
from types import TracebackType
from typing import Literal, get_args

import jax

from ..common.fusion import are_loops_fused

Way = Literal["auto", "numpy", "xla"]

# What compiling takes for each equation of a program, in calls of NumPy functions (1.2 us each).
_COMPILING = 800
_OVER_CALLS = 0.7  # part of it that earlier calls may have taken before a call is compiled
_IN_A_CALL = 0.25  # part of it after which a call ends and begins again, compiled

_ways: list[Way] = ["auto"]  # the way that is set, in this process
_thread = threading.local()  # with `host_calls`, how many calls of the host it is in


class evaluation:  # noqa: N801  (called as a function, used in a `with` block)
    """Say how analyses run outside of `jax.jit`: evaluated by NumPy, or compiled by XLA.

    A call sets it for the whole process; in a ``with`` block it is for the block.

    - "auto", the default: NumPy evaluates a program until it has worked nearly as long as XLA would
      take to compile it; later calls are compiled. A call that is long begins again, compiled,
      unless it has reported progress. This is counted, not timed: a script does the same in every
      run.
    - "numpy": NumPy evaluates all programs that it can. First calls are quick.
    - "xla": all programs are compiled, as within `jax.jit`. Later calls are quick.

    Results differ by rounding (1e-12 of the largest value), and so may the number of iterations of
    an increment that ends close to its tolerance. Programs inside of a user's `jax.jit`, on
    accelerators, and after `fuse_loops` are compiled, whatever is set.

    Args:
        way: "auto", "numpy" or "xla".

    Raises:
        ValueError: `way` is none of these.

    Example:
        >>> structure, phases = jc.scenes.flat_net()
        >>> with jc.evaluation("numpy"):
        ...     solution = jc.solve(structure, phases)
        >>> print(f"{solution.displacement[3, 2]:.4f} m")
        -0.0466 m
    """

    def __init__(self, way: Way):
        if way not in get_args(Way):
            raise ValueError(f'way = {way!r}: expected "auto", "numpy" or "xla"')
        self._before = _ways[0]
        _ways[0] = way

    def __enter__(self) -> evaluation:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        _ways[0] = self._before


def current_way() -> Way:
    """Return how programs run now: "numpy" for as long as NumPy can, "xla", or "auto".

    It is the setting of `evaluation`, except: accelerators, several devices and fused loops need
    compiled programs, and a function that a compiled program calls on the host needs NumPy.
    """
    if is_within_host_call():
        return "numpy"
    if jax.default_backend() != "cpu" or jax.device_count() > 1 or are_loops_fused():
        return "xla"
    return _ways[0]


def is_worth_compiling(way: Way, work: float, n_equation: int) -> bool:
    """Tell whether a program is compiled, after earlier calls by NumPy have done some `work`.

    `work` is in calls of NumPy functions, and `n_equation` the number of equations to compile.
    """
    return way == "xla" or (way == "auto" and work > _OVER_CALLS * _COMPILING * n_equation)


def work_limit(way: Way, n_equation: int) -> float:
    """Return the work that NumPy may do in one call of a program before the call is compiled.

    It is in calls of NumPy functions; infinite if `way` is "numpy".
    """
    return float("inf") if way == "numpy" else _IN_A_CALL * _COMPILING * n_equation


@contextlib.contextmanager
def within_host_call() -> Iterator[None]:
    """Have NumPy evaluate all programs in a ``with`` block of this thread, without arrays of jax.

    For functions that a compiled program calls on the host: XLA may wait for their end.
    """
    _thread.host_calls = getattr(_thread, "host_calls", 0) + 1
    try:
        yield
    finally:
        _thread.host_calls -= 1


def is_within_host_call() -> bool:
    """Tell whether this thread is in a block of `within_host_call`."""
    return getattr(_thread, "host_calls", 0) > 0
