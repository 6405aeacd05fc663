"""Word of long work while it is being done: increments of an analysis, steps of an optimization.

The compiled programs call back only where they are asked to; without a listener there is nothing of
it in them.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Mapping
from typing import IO, Any, NamedTuple

import jax
import numpy as np

from . import status
from .types import Array, Float

__all__ = ["Increment", "Printer", "Step"]

_PAUSE = 0.5  # seconds between two lines that are printed, and before the first


class Increment(NamedTuple):
    """An increment of `solve` that has just ended.

    Attributes:
        phase, phases: its phase, from 1, and how many there are.
        number, count: the increment, from 1, and how many its phase has.
        load_factor: of the phase.
        iterations: linear solves.
        residual: largest unbalanced force, N.
        relative_residual: the same over the force it is judged by.
        status: code so far.

    Example:
        >>> told = []
        >>> structure, phases = jc.scenes.flat_net(load=15.0)
        >>> solution = jc.solve(structure, phases, progress=told.append)
        >>> jax.effects_barrier()  # what is told may come a little after the result
        >>> last = max(told, key=lambda news: (news.phase, news.number))
        >>> last.phase, last.number, last.count, last.status
        (2, 10, 10, 0)
    """

    phase: int
    phases: int
    number: int
    count: int  # type: ignore[assignment]  # of tuples: a method
    load_factor: float
    iterations: int
    residual: float
    relative_residual: float
    status: int

    def __str__(self) -> str:
        return (
            f"phase {self.phase} of {self.phases}, increment {self.number} of {self.count}: "
            f"{self.iterations} iterations, residual {self.residual:.1e} N "
            f"({self.relative_residual:.1e}){_failed(self.status)}"
        )

    @property
    def first(self) -> bool:
        """Whether the work has just begun."""
        return self.phase == 1 and self.number == 1


class Step(NamedTuple):
    """A step of `minimize` that has just been accepted.

    Attributes:
        number, count: the step, 0 at the start, and how many are allowed.
        loss, gradient_norm: there, as in `History`.
        failures: trial points of this step at which the analysis failed.

    Example:
        >>> told = []
        >>> found = jc.minimize(lambda x: (x - 2.0) ** 2, jnp.array(0.0), progress=told.append)
        >>> jax.effects_barrier()
        >>> min(told).number, min(told).loss
        (0, 4.0)
    """

    number: int
    count: int  # type: ignore[assignment]  # of tuples: a method
    loss: float
    gradient_norm: float
    failures: int

    def __str__(self) -> str:
        failed = f", {self.failures} trials failed" if self.failures else ""
        return (
            f"step {self.number} of {self.count}: loss {self.loss:.6g}, "
            f"gradient {self.gradient_norm:.1e}{failed}"
        )

    @property
    def first(self) -> bool:
        """Whether the work has just begun."""
        return self.number == 0


def _failed(code: int) -> str:
    return f", {status.describe(code)}" if code != status.OK else ""


class Printer:
    """Prints on stderr (also in notebooks) how long work goes on, a line every half second.

    Work that ends before prints nothing.

    Args:
        pause: seconds between two lines.
        stream: where to print; default stderr.

    Example:
        >>> import sys
        >>> show = jc.progress.Printer(pause=0.0, stream=sys.stdout)
        >>> show(jc.progress.Step(number=3, count=100, loss=2.5, gradient_norm=1e-3, failures=0))
        step 3 of 100: loss 2.5, gradient 1.0e-03
    """

    def __init__(self, pause: float = _PAUSE, stream: IO[str] | None = None):
        self.pause, self.stream = pause, stream
        self.last: float | None = None

    def __call__(self, news: Increment | Step) -> None:
        """Print `news`, an `Increment` or a `Step`, if there was none lately."""
        now = time.monotonic()
        if news.first or self.last is None:
            self.last = now
        if now - self.last >= self.pause:
            self.last = now
            print(news, file=self.stream or sys.stderr, flush=True)


SHOW = Printer()
"""What ``progress=True`` stands for: one object, so that it does not compile anew."""


def listener(progress: bool | Callable[[Any], object] | None) -> Callable[[Any], object] | None:
    """The function to call, or None; `progress` is None, a bool or such a function.

    Raises:
        ValueError: anything else.
    """
    if progress is None or progress is False:
        return None
    if progress is True:
        return SHOW
    if not callable(progress):
        raise ValueError(
            f"progress = {progress!r}: expected True, or a function of what has just been done"
        )
    return progress


def tell(
    listen: Callable[[Any], object],
    kind: type[Increment] | type[Step],
    known: Mapping[str, Any],
    traced: Mapping[str, Float[Array, ""]],
) -> None:
    """Call `listen` with `kind` (`Increment` or `Step`) from inside of a compiled program.

    Args:
        listen: the function.
        kind: class of the news.
        known: dict of fields that are known while compiling.
        traced: dict of scalars that are computed.
    """
    names = tuple(traced)

    def call(*values):
        own = {name: np.asarray(value).item() for name, value in zip(names, values, strict=True)}
        listen(kind(**known, **own))

    jax.debug.callback(call, *traced.values())
