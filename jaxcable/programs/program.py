"""`Program`: a function of arrays, traced once, which NumPy evaluates or XLA compiles."""

from __future__ import annotations

import functools
import itertools
import math
import threading
from collections.abc import Callable, Hashable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..common import jax_internals as internals
from ..common import jaxprs
from ..common.compilation import without_garbage_collection
from ..common.jax_internals import held_weakly
from ..common.types import Array
from . import decision
from .evaluator import count_equations, write_program
from .known import KnownPrograms
from .writing import LimitReachedError

# Entries of the largest array of floats up to which a program is compiled with
# `quick_compile_options`: it is as fast for some hundred unknowns, and up to half as slow again
# for thousands.
_QUICK_ENTRIES = 2000
_SMALL = 300
"""Equations up to which a batch is evaluated as a whole; a larger one takes too long to trace."""


@held_weakly
class Program:
    """A function of arrays of certain shapes, traced once, which NumPy evaluates or XLA compiles.

    It is traced when it is first needed.

    Args:
        function: function of arrays to a pytree of arrays.
        leaves: arrays in the shapes and dtypes of its arguments; their values do not matter.
        avals: shapes and dtypes of the results, if these are known before it is traced.

    Attributes:
        arguments: shapes and dtypes of its arguments, as jax traces it.
        known: programs that were made of it, see `derived`.
        work: work that NumPy has done with it in all calls, see `decision`.
    """

    def __init__(
        self,
        function: Callable[..., Any],
        leaves: Sequence[Any],
        avals: list[Any] | None = None,
    ):
        self._function, self._avals = function, avals
        self.arguments = [internals.abstract_argument(x) for x in leaves]
        self._tree: Any = None
        self.work = 0.0
        self._has_rules = True
        self._numpy: Callable[..., list[np.ndarray]] | None = None
        self._xla: Callable[..., Any] | None = None
        self.known = KnownPrograms()
        self._lock = threading.RLock()

    def function(self, *leaves: Array) -> list[Array]:
        """Return the results for arrays, which may be traced, as a list of leaves.

        The function is traced by this call only if it has not been before.
        """
        if "traced" in self.__dict__:  # its equations: what it calls is not traced again
            return internals.function_of_jaxpr(self.traced.jaxpr)(*leaves)
        found, self._tree = jax.tree.flatten(self._function(*leaves))
        return found

    @functools.cached_property
    def traced(self) -> Any:
        """The function as `jax.jit` has traced it (of `jax.stages`)."""
        with self._lock, without_garbage_collection(), internals.same_context_as_outside():
            function = self.function  # a new object: jax forgets the trace together with it
            return jax.jit(function).trace(*self.arguments)

    @property
    def tree(self) -> Any:
        """Structure of the pytree that the function returns; None before it is traced."""
        return self._tree

    @property
    def avals(self) -> list[Any]:
        """Shapes and dtypes of the results."""
        return self._avals or list(self.traced.jaxpr.out_avals)

    def derived(self, key: Hashable, make: Callable[[], Any]) -> Any:
        """Return the program under a key that was made of this one, such as its derivative.

        `make` makes it if it is not known.
        """
        return self.known.find(key, make)

    @functools.cached_property
    def n_equation(self) -> int:
        """Number of equations of the program, counting those of a function at each call."""
        return count_equations(self.traced.jaxpr)

    def run(self, leaves: Sequence[Any]) -> list[Array]:
        """Return the results for known arrays, a list, by NumPy or by XLA (see `decision`)."""
        way = decision.current_way()
        if way == "numpy" or (way == "auto" and self._xla is None):
            found = self._run_by_numpy(way, leaves)
            if found is not None and decision.is_within_host_call():
                return found
            if found is not None:
                return internals.arrays_on_default_device(found, self._weak)
        if any(map(internals.is_placed_elsewhere, leaves)):
            return self._on_any_device(*leaves)
        with self._lock:
            if self._xla is None:
                sizes = [
                    math.prod(x.shape)
                    for x in self.arguments
                    if jax.dtypes.issubdtype(x.dtype, np.floating)
                ]
                quick = max(sizes, default=0) <= _QUICK_ENTRIES
                options = internals.quick_compile_options() if quick else None
                with without_garbage_collection():
                    self._xla = self.traced.lower().compile(options)
        return self._xla(*leaves)

    @functools.cached_property
    def _weak(self) -> list[bool]:
        """Whether the dtype of each result yields to that of others, as of numbers of Python."""
        return [x.weak_type for x in self.avals]

    @functools.cached_property
    def _on_any_device(self) -> Callable[..., list[Array]]:
        """The program for arguments that are bound to devices, or spread over several.

        `jax.jit` compiles it where they are.
        """
        return jax.jit(internals.function_of_jaxpr(self.traced.jaxpr))

    def _run_by_numpy(self, way, leaves):
        """Return the results by NumPy, a list; None if the program is to be compiled.

        That is so if a primitive has no rule, or the limit of work is reached, as `way` ("auto" or
        "numpy") has it.
        """
        if not self._has_rules or decision.is_worth_compiling(way, self.work, self.n_equation):
            return None
        work = [0.0, decision.work_limit(way, self.n_equation)]
        try:
            return self.evaluate(leaves, work)
        except LimitReachedError:
            return None
        except NotImplementedError:  # a primitive without a rule
            self._has_rules = False
            return None
        finally:
            self.work += work[0]

    def evaluate(self, leaves: Sequence[Any], work: list[float]) -> list[np.ndarray]:
        """Return the results by NumPy; `work` and errors are those of `evaluator.write_program`."""
        with self._lock:
            if self._numpy is None:
                with without_garbage_collection():
                    self._numpy = write_program(self.traced.jaxpr)
        return self._numpy(leaves, work)


@held_weakly
class MappedProgram(Program):
    """A program mapped over a batch of cases.

    NumPy evaluates a large program case by case, and a small one for all cases at once.

    Args:
        base: `Program` of one case.
        axes: axis of each argument along which the cases are, None for what they share.
        leaves: arguments of the batch, in their shapes.

    Attributes:
        is_mapped: for each result whether it has a row for each case. Indices that do not depend on
            the case have none: gathers by them are quicker. Floats always do: where jax has to
            repeat them, it compiles a program for each shape.
    """

    def __init__(self, base: Program, axes: Sequence[int | None], leaves: Sequence[Any]):
        depends = jaxprs.results_that_depend(
            base.traced.jaxpr.jaxpr, [axis is not None for axis in axes]
        )
        self.is_mapped = [
            own or bool(jnp.issubdtype(x.dtype, jnp.floating))
            for x, own in zip(base.avals, depends, strict=True)
        ]
        results = [0 if mapped else None for mapped in self.is_mapped]
        super().__init__(jax.vmap(base.function, tuple(axes), results), leaves)
        self._base, self._axes = base, axes
        self.arguments = [  # numbers of Python, too, may be arrays of NumPy by now
            x.update(weak_type=own.weak_type)
            for x, own in zip(self.arguments, base.arguments, strict=True)
        ]
        pairs = zip(self.arguments, axes, strict=True)
        self._n_case = next(x.shape[axis] for x, axis in pairs if axis is not None)

    @property
    def tree(self) -> Any:
        """Structure of the pytree that the function returns, as of one case."""
        return self._base.tree

    @property
    def n_equation(self) -> int:
        """Estimated number of equations to compile: six times those of one case.

        Batched loops have three times as many, and tracing them takes as long again.
        """
        return 6 * self._base.n_equation

    @property
    def avals(self) -> list[Any]:
        """Shapes and dtypes of the results."""
        return [
            x.update(shape=(self._n_case, *x.shape)) if mapped else x
            for x, mapped in zip(self._base.avals, self.is_mapped, strict=True)
        ]

    def evaluate(self, leaves: Sequence[Any], work: list[float]) -> list[np.ndarray]:
        """Return the results by NumPy: case by case unless the program is small."""
        is_small = self._base.n_equation <= _SMALL and self._n_case > 1
        if is_small or self._n_case == 0:  # what has no cases has shapes nevertheless
            return super().evaluate(leaves, work)
        rows = [
            itertools.repeat(x) if axis is None else np.moveaxis(x, axis, 0)
            for x, axis in zip(map(np.asarray, leaves), self._axes, strict=True)
        ]
        cases = itertools.islice(zip(*rows, strict=False), self._n_case)
        found = [self._base.evaluate(case, work) for case in cases]
        return [
            np.stack(parts) if mapped else parts[0]
            for parts, mapped in zip(zip(*found, strict=True), self.is_mapped, strict=True)
        ]
