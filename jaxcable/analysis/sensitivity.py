"""Results of all phases with their derivatives by inputs of the phases, by one compiled program.

The program takes all numbers as arguments: those of the structure and the phases, and the
directions in which inputs of the phases change. Other numbers do not compile it again, nor does
what is then computed from the results. As in `solve`, one loop runs over all phases, and over their
derivatives.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..common.tree import copy_with
from ..common.types import Array, Float, Int
from ..equilibrium.incremental import Incremental
from ..equilibrium.newton import Newton
from ..model.structure import Structure
from ..numerics import implicit
from ..programs.program_calls import as_program
from .phase_loop import analyse
from .phases import Phase
from .preparation import prepare
from .recalled_derivative import recalled_results
from .solution import Solution, State
from .states import as_user_solution

_MAX_DIRECTIONS = 32
"""Largest number of directions in one run of the program: their results are in memory together."""


class MeasuredAnalysis:
    """A function of inputs of the phases: quantities of their solution, with their Jacobian.

    Args:
        structure, method, start: as for `solve`.
        phases_of: function of the inputs x [n] that returns the phases with these inputs.
        measure: function of the `Solution` to the quantities, an array [m].
        names: names of the results of phases that `measure` uses; few of them compile faster.
    """

    def __init__(
        self,
        structure: Structure,
        phases_of: Callable[[Float[Array, " n"]], Sequence[Phase]],
        measure: Callable[[Solution], Float[Array, " m"]],
        names: tuple[str, ...],
        method: Newton | Incremental | None,
        start: Solution | State | None,
    ):
        self.structure, self.method, self.start = structure, method, start
        self.phases_of, self.measure, self.names = phases_of, measure, names
        self._task: Any = None
        self._measured = as_program(self._measured_values_and_derivatives)

    def __call__(
        self, x: Float[Array, " n"]
    ) -> tuple[Float[Array, " m"], Float[np.ndarray, "m n"], Int[Array, ""]]:
        """Solve the phases for inputs x, [n].

        Returns:
            The quantities [m], their Jacobian [m, n] by the inputs, and the status of the analysis.
        """
        tree: Any
        moving: tuple[int, ...] = ()

        def moved(x):
            """Return the arguments of the analysis that are traced: they depend on the inputs."""
            nonlocal moving
            task = prepare(self.structure, self.phases_of(x), self.method, self.start, to_end=True)
            leaves = jax.tree.leaves(_arguments_of_compiled_analysis(task))
            moving = tuple(k for k, leaf in enumerate(leaves) if isinstance(leaf, jax.core.Tracer))
            self._task = task
            return [leaves[k] for k in moving]

        values, push = jax.linearize(moved, x)
        leaves, tree = jax.tree.flatten(_arguments_of_compiled_analysis(self._task))
        bundles = self._task.bundles

        def core(values):
            """Return the arguments of the analysis with some values of those that are traced."""
            own = dict(zip(moving, values, strict=True))
            return tree.unflatten([own.get(k, leaf) for k, leaf in enumerate(leaves)])

        # the program of `solve`
        solution, points = analyse(
            *core(values), differentiate_path=False, listen=None, bundles=bundles
        )
        wanted = _indices_of_float_results(solution, self.names)
        every_result = jax.tree.leaves(solution)
        known = [every_result[k] for k in wanted]

        def results(values):
            given = {"bundles": bundles, "wanted": wanted, "value": known}
            return recalled_results(core(values), points, **given)

        _, push_results = jax.linearize(results, values)
        together = min(x.size, _MAX_DIRECTIONS)
        every = np.eye(x.size + -x.size % together, x.size, dtype=x.dtype)
        columns = []
        for k in range(0, x.size, together):
            changed = jax.vmap(push_results)(jax.vmap(push)(every[k : k + together]))
            found, column = self._measured(solution, changed)
            columns.append(np.asarray(column))
        return found, np.concatenate(columns)[: x.size].T, solution.status

    def _measured_values_and_derivatives(self, solution, result_derivatives):
        """Return the quantities, [m], and their derivatives in some directions, [n_direction, m].

        `result_derivatives` are those of the results `names` at the ends of the phases in these
        directions, a list of arrays [n_direction, ...]. All other results have no derivatives.
        """
        phases = solution.phases
        floats, back = _take_out_float_results(phases, self.names)

        def value(floats):
            # paths have no derivatives (`solve`): those by the ends are NaN, too
            paths = implicit.with_nan_derivative(phases.paths, floats)
            changed = copy_with(back(floats), paths=paths)
            whole = copy_with(solution, phases=changed)
            return self.measure(as_user_solution(self.structure, whole, self._task))

        found, push = jax.linearize(value, floats)
        return found, jax.vmap(push)(result_derivatives)


def _arguments_of_compiled_analysis(task):
    """Return the arrays and the method of a prepared analysis, for `phase_loop.analyse`."""
    return task.without_indices, task.arrays, task.method, task.code


def _results_by_name(phases, names):
    """Return the results `names` at the ends of phases, a dict, and `PhaseResults.moved_before`."""
    return {name: getattr(phases.ends, name) for name in names}, phases.moved_before


def _indices_of_float_results(solution, names):
    """Return the indices of float results of phases among all leaves of a `Solution`, a tuple.

    They are those that `_take_out_float_results` takes: float arrays among the results `names`.
    """
    leaves, tree = jax.tree.flatten(solution)
    phases = tree.unflatten(range(len(leaves))).phases
    places = jax.tree.leaves(_results_by_name(phases, names))
    return tuple(k for k in places if jnp.issubdtype(leaves[k].dtype, jnp.floating))


def _take_out_float_results(phases, names):
    """Return the float arrays among the results `names` of `phases`, as a list.

    Returns, too, a function from such a list to phases with these arrays in their place.
    """
    leaves, shape = jax.tree.flatten(_results_by_name(phases, names))
    real = [jnp.issubdtype(jnp.result_type(x), jnp.floating) for x in leaves]

    def back(floats):
        floats = iter(floats)
        replaced = [next(floats) if own else x for own, x in zip(real, leaves, strict=True)]
        ends, moved_before = shape.unflatten(replaced)
        return copy_with(phases, ends=copy_with(phases.ends, **ends), moved_before=moved_before)

    return [x for own, x in zip(real, leaves, strict=True) if own], back
