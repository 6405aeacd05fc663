"""The interface of linear solvers, and the registry that chooses one of them.

A solver is an object registered by its name (`register`); `Newton(linear_solver=name)` takes that
name. It analyses a pattern once, and makes a factor of every matrix on it:

    analysis = solver.analyze(n, indptr, indices)     # compressed rows of the whole matrix
    factor = analysis.factorize(values, definite)     # None if the matrix is singular
    x = factor.solve(b)                                # b [n] or [n, m]; transposed=True for A^T
    factor.pivots; factor.n_bytes; factor.release(); analysis.release()

`host.AnalysedPattern` does all else, for every solver: it stores analyses and factors, scales
matrices to unit diagonal, refuses those that are not finite, and judges pivots. All of it is NumPy
on the host: a callback that calls jax can wait for itself for ever.
"""

from __future__ import annotations

import abc
import importlib.util
from typing import Any, TypeVar

import numpy as np

from ..common.types import Array, Bool, Float, Int

_REGISTERED: dict[str, Solver] = {}


class Solver:
    """Base class of linear solvers for sparse matrices, for users' own ones, too.

    Attributes:
        name: the name that users give.
        package: Python package that it needs, an extra of the solver's name; None if none.
        analysis: class whose objects analyse a sparsity pattern, derived from `Analysis`.
        offered: whether users may name it; otherwise it is only chosen by size.
        on_device: whether it solves inside of the compiled program; then `solve_definite` and
            `factorize` are called with matrices of jax, and `analyze` never.
        definite: whether it is only for matrices that are known to be positive semidefinite.
        fused: whether loops around it can become one function (`common.fusion`).
        exchanges_rows: whether it exchanges rows anywhere in the matrix, which a matrix with zeros
            on its diagonal needs.
        iterates: whether conjugate gradients with the factor of a similar matrix can be cheaper
            than a new factor.
    """

    name: str = None  # type: ignore[assignment]  # every solver has one
    package: str | None = None
    analysis: type[Analysis] | None = None
    offered: bool = True
    on_device: bool = False
    definite: bool = False
    fused: bool = False
    exchanges_rows: bool = True
    iterates: bool = True

    def is_installed(self) -> bool:
        """Tell whether the Python package that the solver needs is installed."""
        return self.package is None or importlib.util.find_spec(self.package) is not None

    def missing_message(self) -> str:
        """Return the text of the error that says that the solver is not installed."""
        extra = f"or install the extra jaxcable[{self.name}]"
        return f'{self.package} is not installed; use "superlu", {extra}'

    def begin_loading_library(self) -> None:
        """Begin to load the solver's library and return at once; before a program is compiled."""
        return None

    def is_suitable_for(self, n: int, banded: bool) -> bool:
        """Tell whether to choose this solver if users name none and none registered earlier suits.

        Args:
            n: number of unknowns.
            banded: whether the matrix has a small bandwidth.
        """
        return False

    def analyze(
        self, n: int, indptr: Int[np.ndarray, " n+1"], indices: Int[np.ndarray, " n_value"]
    ) -> Analysis:
        """Analyse a sparsity pattern once, for all matrices on it (not called if `on_device`).

        Args:
            n: number of unknowns.
            indptr, indices: compressed rows of the whole matrix (both triangles), columns
                ascending.
        """
        if self.analysis is None:
            raise NotImplementedError(f"{self.name}: has no class for the analysis of a pattern")
        return self.analysis(n, indptr, indices)

    def solve_definite(
        self,
        matrix: Any,  # a `pattern.SparseMatrix`; that module imports this one
        rhs: Float[Array, " n"],
    ) -> tuple[Float[Array, " n"], Bool[Array, ""]]:
        """Solve with a `SparseMatrix`: return x [n], and whether the matrix is positive definite.

        Only for solvers `on_device`, inside of the compiled program.
        """
        raise NotImplementedError(f"{self.name}: solves on the host")

    def factorize(self, matrix: Any, loose: Bool[Array, " n"]) -> Any:
        """Return a `direct.OnDeviceFactor` of a `SparseMatrix` without unknowns `loose`, [n] bool.

        Only for solvers `on_device`, inside of the compiled program.
        """
        raise NotImplementedError(f"{self.name}: solves on the host")

    def __repr__(self) -> str:
        return self.name


class Analysis(abc.ABC):
    """Base class of a solver's analysis of a sparsity pattern, made once for all matrices on it.

    Args:
        n: number of unknowns.
        indptr, indices: compressed rows of the whole matrix (both triangles), columns ascending.
    """

    def __init__(
        self, n: int, indptr: Int[np.ndarray, " n+1"], indices: Int[np.ndarray, " n_value"]
    ):
        self.n, self.arguments = n, (n, indptr, indices)

    @abc.abstractmethod
    def factorize(
        self, values: Float[np.ndarray, " n_value"], definite: bool
    ) -> NumericFactor | None:
        """Factorise a matrix on the pattern; return None if it is singular to working precision.

        Args:
            values: entries in the order of `indices` of `Solver.analyze`, finite, float64; not to
                be changed. The diagonal is 1, -1 or 0.
            definite: True demands a symmetric positive definite matrix, and returns None for
                others. False allows indefinite and unsymmetric matrices.
        """

    def release(self) -> None:
        """Free memory that Python does not free with this object, such as that of a library."""
        return None


class NumericFactor(abc.ABC):
    """Base class of the factor of one matrix, made by `Analysis.factorize`.

    Attributes:
        pivots: pivots of the elimination, [n]: the matrix is regular if none of them is small, and
            positive definite if all of them are positive. None if `factorize` has judged this
            itself.
        n_bytes: memory that the factor takes.
    """

    pivots: Float[np.ndarray, " n"] | None = None
    n_bytes: int = 0

    @abc.abstractmethod
    def solve(
        self, b: Float[np.ndarray, "n ..."], transposed: bool = False
    ) -> Float[np.ndarray, "n ..."]:
        """Solve for right sides [n] or [n, m], with the matrix or its transpose."""

    def release(self) -> None:
        """Free memory that Python does not free with this object, such as that of a library."""
        return None


AnySolver = TypeVar("AnySolver", bound=Solver)


def register(solver: AnySolver) -> AnySolver:
    """Register a linear solver under its name, so that users can name it, and return it.

    Where users name none, it is chosen if it `is_suitable_for` the matrix and none registered
    before it is.

    Raises:
        ValueError: another solver has that name.
    """
    if _REGISTERED.setdefault(solver.name, solver) is not solver:
        raise ValueError(f"solver {solver.name!r}: this name is registered already")
    return solver


def solver_named(name: str) -> Solver:
    """Return the linear solver that is registered under a name."""
    return _REGISTERED[name]


def selectable_solver_names() -> tuple[str, ...]:
    """Return the names of the linear solvers that users may ask for."""
    return tuple(name for name, solver in _REGISTERED.items() if solver.offered)


def check_solver_name(name: str | None, exchanges_rows: bool = False) -> None:
    """Raise ValueError unless a name is None or that of an installed solver that users may name.

    With `exchanges_rows` it must also be a solver that exchanges rows.
    """
    if name is None:
        return
    if name not in selectable_solver_names():
        others = ", ".join(selectable_solver_names())
        raise ValueError(f"linear_solver = {name!r}: expected None or one of {others}")
    solver = solver_named(name)
    if not solver.is_installed():
        raise ValueError(f"linear_solver = {name!r}: {solver.missing_message()}")
    if exchanges_rows and not solver.exchanges_rows:
        able = ", ".join(
            repr(other) for other in selectable_solver_names() if solver_named(other).exchanges_rows
        )
        raise ValueError(
            f"linear_solver = {name!r}: cannot solve for forces of given lengths; use None or one "
            f"of {able}"
        )


def choose_solver(
    n: int,
    banded: bool,
    name: str | None = None,
    exchanges_rows: bool = False,
    definite: bool = False,
) -> Solver:
    """Return the linear solver with this name; if it is None, the first registered one that suits.

    Args:
        n: number of unknowns.
        banded: whether the matrix has a small bandwidth.
        name: name of an installed solver, or None.
        exchanges_rows: whether the solver must exchange rows.
        definite: whether all matrices are known to be positive semidefinite.
    """
    if name is not None:
        return solver_named(name)
    able = [s for s in _REGISTERED.values() if s.exchanges_rows or not exchanges_rows]
    able = [s for s in able if definite or not s.definite]
    return next(s for s in able if s.is_installed() and s.is_suitable_for(n, banded))
