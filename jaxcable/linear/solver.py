"""What a linear solver is, and those that are known: the one place where a solver is chosen.

A solver is an object of its own, registered by its name (`register`), which `Newton(linear_solver=
name)` then takes. It analyses a pattern once, and makes a factor of every matrix on it:

    analysis = solver.analyse(n, indptr, indices)     # compressed rows of the whole matrix
    factor = analysis.factorize(values, definite)     # None if the matrix is singular
    x = factor.solve(b)                                # b [n] or [n, m]; transposed=True for A^T
    factor.n_bytes; factor.release(); analysis.release()

All of it is NumPy on the host: a callback that calls jax can wait for itself.
"""

from __future__ import annotations

import abc
from typing import TypeVar

import numpy as np

from ..common.types import Float, Int

_KNOWN: dict[str, Solver] = {}


class Solver(abc.ABC):
    """A way to solve sparse systems of equations.

    Attributes:
        name: by which it is asked for.
        offered: whether users may name it; else it is only chosen.
        on_device: the matrix becomes a dense array that is solved inside of the program; then there
            is nothing to analyse.
        exchanges_rows: also over long ways, which a matrix with zeros on its diagonal needs.
        iterates: whether conjugate gradients with the factor of a similar matrix can be cheaper
            than a factor.
    """

    name: str = None  # type: ignore[assignment]  # every solver has one
    offered: bool = True
    on_device: bool = False
    exchanges_rows: bool = True
    iterates: bool = True

    def available(self) -> bool:
        """Whether it is installed."""
        return True

    def missing(self) -> str:
        """What to do where it is not installed, in words."""
        return "is not installed"

    def suits(self, n: int, banded: bool) -> bool:
        """Whether it is the one for `n` unknowns, if none is named and none before it is.

        `banded`: whether the matrix has a small bandwidth.
        """
        return False

    @abc.abstractmethod
    def analyse(
        self, n: int, indptr: Int[np.ndarray, " n+1"], indices: Int[np.ndarray, " n_value"]
    ) -> Analysis:
        """Make a pattern ready: an `Analysis`.

        Args:
            n: number of unknowns.
            indptr, indices: compressed rows of the whole matrix (both triangles), columns
                ascending.
        """

    def __repr__(self) -> str:
        return self.name


class Analysis(abc.ABC):
    """A pattern made ready by a solver."""

    @abc.abstractmethod
    def factorize(
        self, values: Float[np.ndarray, " n_value"], definite: bool
    ) -> NumericFactor | None:
        """A `NumericFactor` of a matrix; None if it is singular to working precision.

        Args:
            values: in the order of the rows given to `Solver.analyse`, float64; not to be changed.
            definite: demand a symmetric positive definite matrix, None for others; else it may be
                indefinite, and unsymmetric.
        """

    def release(self) -> None:
        """Give back what does not go with this object."""
        return None


class NumericFactor(abc.ABC):
    """A numeric factor.

    Attributes:
        n_bytes: memory that it takes.
    """

    n_bytes: int = 0

    @abc.abstractmethod
    def solve(
        self, b: Float[np.ndarray, "n ..."], transposed: bool = False
    ) -> Float[np.ndarray, "n ..."]:
        """The solution for right sides [n] or [n, m], or that of the transposed matrix."""

    def release(self) -> None:
        """Give back what does not go with this object."""
        return None


Own = TypeVar("Own", bound=Solver)


def register(solver: Own) -> Own:
    """Make a solver known by its name; it is chosen by itself where it alone `suits`.

    Raises:
        ValueError: another one has that name.
    """
    if _KNOWN.setdefault(solver.name, solver) is not solver:
        raise ValueError(f"solver {solver.name!r}: another one has that name")
    return solver


def named(name: str) -> Solver:
    """The solver of a name."""
    return _KNOWN[name]


def offered() -> tuple[str, ...]:
    """Names that users may ask for, a tuple."""
    return tuple(name for name, solver in _KNOWN.items() if solver.offered)


def check(name: str | None, exchanges_rows: bool = False) -> None:
    """Raise ValueError unless a name is None or that of a solver which is there.

    With `exchanges_rows` it has to be able to do that, too.
    """
    if name is None:
        return
    if name not in offered():
        raise ValueError(
            f"linear_solver = {name!r}: expected None or one of {', '.join(offered())}"
        )
    solver = named(name)
    if not solver.available():
        raise ValueError(f"linear_solver = {name!r}: {solver.missing()}")
    if exchanges_rows and not solver.exchanges_rows:
        able = ", ".join(repr(other) for other in offered() if named(other).exchanges_rows)
        raise ValueError(
            f"linear_solver = {name!r}: cannot solve for forces of given lengths; use None or one "
            f"of {able}"
        )


def choose(n: int, banded: bool, name: str | None = None, exchanges_rows: bool = False) -> Solver:
    """The solver of a name, or if that is None, the first of those known that suits.

    Args:
        n: number of unknowns.
        banded: whether the matrix has a small bandwidth.
        name: of a solver that is there, or None.
        exchanges_rows: whether the solver has to be able to.
    """
    if name is not None:
        return named(name)
    able = [s for s in _KNOWN.values() if s.exchanges_rows or not exchanges_rows]
    return next(s for s in able if s.available() and s.suits(n, banded))
