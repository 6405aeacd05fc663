"""Progress of long work: reports of increments of an analysis and of steps of an optimization.

Compiled programs contain the calls to a listener only if there is a listener.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Mapping
from typing import IO, Any, NamedTuple

import jax
import numpy as np

from . import host_calls, status
from .types import Array, Float

__all__ = ["Increment", "Printer", "Step", "Trial"]

_PAUSE = 0.5  # seconds between two printed lines, and before the first line


class Increment(NamedTuple):
    """Report of a load increment of `solve` that has just ended.

    Attributes:
        phase, phases: number of its phase, from 1, and number of phases.
        number, count: number of the increment, from 1, and number of increments of its phase.
        load_factor: load factor of the phase at its end.
        iterations: number of linear solves.
        residual: largest unbalanced force, N.
        relative_residual: the residual divided by the force that it is compared with.
        status: status code of the analysis so far.

    Example:
        >>> reports = []
        >>> structure, phases = jc.scenes.flat_net(load=15.0)
        >>> solution = jc.solve(structure, phases, progress=reports.append)
        >>> jax.effects_barrier()  # reports may arrive a little after the result
        >>> last = max(reports, key=lambda news: (news.phase, news.number))
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
            f"({self.relative_residual:.1e}){_failure_text(self.status)}"
        )

    @property
    def first(self) -> bool:
        """Whether this is the first increment of the first phase."""
        return self.phase == 1 and self.number == 1


class Step(NamedTuple):
    """Report of a step of `minimize` that has just been accepted.

    Attributes:
        number, count: number of the step, 0 at the start, and number of steps allowed.
        loss, gradient_norm: the loss after the step, and the norm of its gradient.
        failures: number of trials of this step in which the analysis failed.

    Example:
        >>> reports = []
        >>> found = jc.minimize(lambda x: (x - 2.0) ** 2, jnp.array(0.0), progress=reports.append)
        >>> reports[0].number, reports[0].loss
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
        """Whether this is the report of the start, before any step of the optimization."""
        return self.number == 0


class Trial(NamedTuple):
    """Report of a trial point of `fit` or `tune` that has just been evaluated.

    Attributes:
        number, count: number of the point, 0 at the start, and number of points allowed.
        misfit: Euclidean norm of the residuals there; NaN where the analysis failed.
        accepted: 1 if the point was accepted, else 0.
        status: code of the inner analysis at the point.

    Example:
        >>> reports = []
        >>> found = jc.fit(lambda x: x - 2.0, jnp.array([0.0]), progress=reports.append)
        >>> reports[0].number, reports[0].misfit
        (0, 2.0)
    """

    number: int
    count: int  # type: ignore[assignment]  # of tuples: a method
    misfit: float
    accepted: int
    status: int

    def __str__(self) -> str:
        taken = "" if self.accepted else ", not accepted"
        return (
            f"trial {self.number} of {self.count}: misfit {self.misfit:.6g}{taken}"
            f"{_failure_text(self.status)}"
        )

    @property
    def first(self) -> bool:
        """Whether this is the report of the start, the first trial point."""
        return self.number == 0


def _failure_text(code: int) -> str:
    """Return ", " and the text of a status code, to end a line of progress; "" for OK."""
    return f", {status.describe(code)}" if code != status.OK else ""


class Printer:
    """Listener that prints reports of progress, a line every half second.

    It prints to stderr (also in notebooks), and nothing for work that ends within half a second.

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
        self.count = 0  # reports so far

    def __call__(self, news: Increment | Step | Trial) -> None:
        """Print `news`, such as an `Increment`, unless a line was printed within the pause."""
        self.count += 1
        now = time.monotonic()
        if news.first or self.last is None:
            self.last = now
        if now - self.last >= self.pause:
            self.last = now
            print(news, file=self.stream or sys.stderr, flush=True)


SHOW = Printer()
"""The listener for ``progress=True``: always the same object, so that nothing is recompiled."""


def as_listener(progress: bool | Callable[[Any], object] | None) -> Callable[[Any], object] | None:
    """Return the function that is called with every report of progress, or None.

    Args:
        progress: None or False for no function, True for `SHOW`, or a function.

    Raises:
        ValueError: `progress` is anything else.
    """
    if progress is None or progress is False:
        return None
    if progress is True:
        return SHOW
    if not callable(progress):
        raise ValueError(
            f"progress = {progress!r}: expected True, or a function to call with every report"
        )
    return progress


def report_increment(
    listen: Callable[[Any], object], phases: int, traced: Mapping[str, Float[Array, ""]]
) -> None:
    """Call `listen` with the report of an increment from inside of a compiled program.

    Args:
        listen: function of an `Increment`.
        phases: its field of this name, known when the program is compiled.
        traced: the other fields, which the program computes, a dict of scalars.
    """
    if listen is SHOW:  # by name, so that the program can be kept on disk
        words: list[Any] = [make_printing_reporter, str(phases), *traced]
        host_calls.call_without_results(words, *traced.values())
        return
    jax.debug.callback(_make_reporter(listen, phases, tuple(traced)), *traced.values())


def _make_reporter(listen, phases, names):
    """Return a NumPy function of scalars that calls `listen` with an `Increment` made of them.

    `names` are the fields of `Increment` that the scalars are, in their order; `phases` is known.
    """

    def function(*values):
        computed = {
            name: np.asarray(value).item() for name, value in zip(names, values, strict=True)
        }
        listen(Increment(phases=phases, **computed))
        return ()

    return function


@host_calls.register_host_function_family
def make_printing_reporter(phases, *names):
    """Return the NumPy function that makes an `Increment` of its arguments and prints it."""
    return _make_reporter(SHOW, int(phases), names)
