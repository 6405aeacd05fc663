"""Dynamic factors of a motion against the static states before and after an event."""

from __future__ import annotations

import jax
import jax.numpy as jnp

from ..analysis.solution import Solution, State
from ..common.types import Array, Float, PyTree
from ..programs.program_calls import as_program
from .response import Transient


def dynamic_factors(
    motion: Transient, before: Solution | State, after: Solution | State
) -> PyTree[Float[Array, " n_elem"]]:
    """Return the dynamic factor of each element: largest change of its force over the static one.

    For a cable that breaks these are the factors of `design.loss_of_cable`::

        factor = largest of (N(t) - N_before) / (N_after - N_before)

    with the forces of the motion, and those of the static states before and after the removal. 1 is
    a removal that takes its time, 2 the sudden one of a mass on a spring; several modes, slack
    cables and large displacements make it more or less.

    Args:
        motion: `Transient` with the history "tension".
        before: state from which the motion begins.
        after: static state after the same event, ``solve(..., Phase(removes=...), start=before)``.

    Returns:
        In the shape of `elements`, each [n_elem]; NaN for an element whose static force does not
        change (to 1e-9 of the largest one), and for those that are not there in `after`. A cable
        that is slack in `after` has a factor, too.

    Example:
        Two cables carry 20 kN; one breaks.

        >>> cables = jc.Cables([[0, 2], [1, 2]], axial_stiffness=1e7)
        >>> held = jc.pinned([0, 1]) + jc.restrained([2], "xy")
        >>> nodes = [[-3.0, 0.0, 4.0], [3.0, 0.0, 4.0], [0.0, 0.0, 0.0]]
        >>> structure = jc.Structure(nodes, cables, supports=held)
        >>> load = jc.PointMasses([2], 20e3 / 9.80665)
        >>> before = jc.solve(structure, jc.Phase(loads=load))
        >>> after = jc.solve(structure, jc.Phase(removes=jc.only([1])), start=before)
        >>> gone = jc.dynamics.Removal(jc.only([1]))
        >>> times = {"start": before, "dt": 1e-3, "steps": 300}
        >>> moved = jc.dynamics.transient(structure, **times, masses=load, removes=gone)
        >>> factors = jc.dynamics.dynamic_factors(moved, before, after)
        >>> print(moved.status, after.status, factors.round(3))
        0 0 [ 2. nan]
    """
    first, last = (part.last if isinstance(part, Solution) else part for part in (before, after))
    present = last.present
    if present is None:
        present = jax.tree.map(jnp.ones_like, last.tension)
    else:  # groups without tension have an entry, too
        present = jax.tree.map(
            lambda force, own: None if force is None else own,
            *(last.tension, present),
            is_leaf=lambda x: x is None,
        )
    return _largest_dynamic_factors(motion.tension, first.tension, last.tension, present)


@as_program
def _largest_dynamic_factors(history, before, after, present):
    """Return the largest value in time of (history - before) / (after - before), [n_elem] each.

    `history` has forces in time, [steps + 1, n_elem], `present` is 1 for elements that are present
    after the event. NaN where an element is absent then, or its static force does not change.
    """
    forces = jax.tree.leaves((before, after))
    largest = jnp.max(jnp.concatenate([jnp.max(jnp.abs(x), keepdims=True) for x in forces]))

    def one(history, before, after, present):
        change = after - before
        counts = (jnp.abs(change) > 1e-9 * largest) & (present > 0)
        ratio = (history - before[None]) / jnp.where(counts, change, jnp.nan)[None]
        return jnp.max(ratio, axis=0)

    return jax.tree.map(one, history, before, after, present)
