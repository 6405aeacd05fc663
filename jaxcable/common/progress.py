"""Progress of long work: reports of increments of an analysis and of steps of an optimization.

Compiled programs contain the calls to a listener only if there is a listener.
"""

from __future__ import annotations

import contextlib
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextvars import ContextVar
from typing import IO, Any, NamedTuple

import jax
import numpy as np

from . import host_calls, status
from .types import Array, Float

__all__ = ["Increment", "Printer", "Step", "Trial"]

_PAUSE = 0.5  # seconds between two printed lines, and before the first line
_COMPILE_LISTENER: ContextVar[Callable[[Any], object] | None] = ContextVar(
    "_COMPILE_LISTENER", default=None
)


class Increment(NamedTuple):
    """Report of an increment of `solve` that has just ended.

    Attributes:
        phase, phases: number of its phase, from 1, and number of phases.
        number, count: number of the increment, from 1, and number of increments of its phase.
        load_factor: of the phase.
        iterations: number of linear solves.
        residual: largest unbalanced force, N.
        relative_residual: the residual divided by the force that it is compared with.
        status: code so far.

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
        """Whether the work has just begun."""
        return self.phase == 1 and self.number == 1


class Step(NamedTuple):
    """Report of a step of `minimize` that has just been accepted.

    Attributes:
        number, count: number of the step, 0 at the start, and number of steps allowed.
        loss, gradient_norm: after the step, as in `History`.
        failures: number of trials of this step in which the analysis failed.

    Example:
        >>> reports = []
        >>> found = jc.minimize(lambda x: (x - 2.0) ** 2, jnp.array(0.0), progress=reports.append)
        >>> jax.effects_barrier()
        >>> min(reports).number, min(reports).loss
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
        >>> jax.effects_barrier()
        >>> min(reports).number, min(reports).misfit
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
        """Whether the work has just begun."""
        return self.number == 0


def _failure_text(code: int) -> str:
    """Return the text of a failure status, to be appended to a line; "" if nothing has failed."""
    return f", {status.describe(code)}" if code != status.OK else ""


class Printer:
    """Print the progress of long work on stderr (also in notebooks), a line every half second.

    Nothing is printed for work that ends before the first half second.

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
            self.print_line(news)

    def __reduce__(self) -> str:
        """The printer of ``progress=True`` is known by its name, for programs kept on disk."""
        if self is SHOW:
            return "SHOW"
        raise TypeError("a Printer cannot be pickled")

    def print_line(self, text: object) -> None:
        """Print a line at once."""
        print(text, file=self.stream or sys.stderr, flush=True)


SHOW = Printer()
"""The listener for ``progress=True``: always the same object, so that nothing is recompiled."""


def as_listener(progress: bool | Callable[[Any], object] | None) -> Callable[[Any], object] | None:
    """Return the function to call with reports of progress, or None if there is none to call.

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


@contextlib.contextmanager
def with_compile_listener(listen: Callable[[Any], object] | None) -> Iterator[None]:
    """Set, for a block, the listener of `announce_compilation` where that is given none."""
    token = _COMPILE_LISTENER.set(listen)
    try:
        yield
    finally:
        _COMPILE_LISTENER.reset(token)


@contextlib.contextmanager
def announce_compilation(listen: Callable[[Any], object] | None) -> Iterator[None]:
    """Print "compiling" if the block takes long and nothing has been reported meanwhile.

    Nothing is printed unless `listen`, or else the listener set by `with_compile_listener`, is a
    `Printer`.
    """
    listen = _COMPILE_LISTENER.get() if listen is None else listen
    if not isinstance(listen, Printer):
        yield
        return
    count = listen.count

    def still():
        if listen.count == count:
            listen.print_line("compiling")

    timer = threading.Timer(listen.pause, still)
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


def report_progress(
    listen: Callable[[Any], object],
    kind: type[Increment] | type[Step] | type[Trial],
    known: Mapping[str, Any],
    traced: Mapping[str, Float[Array, ""]],
) -> None:
    """Report progress to `listen` from inside of a compiled program.

    Args:
        listen: the function to call.
        kind: class of the report, `Increment`, `Step` or `Trial`.
        known: the field of the report that is known when the program is compiled, an integer, as a
            dict.
        traced: fields that the program computes, a dict of scalars.
    """
    if listen is SHOW:  # by name, so that the program can be kept on disk
        ((field, number),) = known.items()
        host_calls.call_without_results(
            [make_printing_reporter, kind.__name__, field, str(number), *traced], *traced.values()
        )
        return
    jax.debug.callback(_make_reporter(listen, kind, known, tuple(traced)), *traced.values())


def _make_reporter(listen, kind, known, names):
    """Return a function that calls `listen` with a report, a `kind`, of the values it is given."""

    def function(*values):
        computed = {
            name: np.asarray(value).item() for name, value in zip(names, values, strict=True)
        }
        listen(kind(**known, **computed))
        return ()

    return function


@host_calls.host_function_family
def make_printing_reporter(kind, field, number, *names):
    """Return the NumPy function that prints a report with `SHOW`; called by `report_progress`."""
    kinds = {cls.__name__: cls for cls in (Increment, Step, Trial)}
    return _make_reporter(SHOW, kinds[kind], {field: int(number)}, names)
