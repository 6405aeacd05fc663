"""Elements between taut and slack: where they have no derivative, and where they can slacken.

Nodes that only slack cables hold can be anywhere, and the iteration often leaves them where one of
their cables is just as long as its unstressed length, or has a tension below the tolerance of
equilibrium. This is a kink of the force of that cable, but no kink of the structure: the node can
move so that the cable is slack, and no force depends on it. Derivatives are those of the structure
in which such elements are slack.
"""

from __future__ import annotations

from typing import Any, NamedTuple, TypeAlias

import jax.numpy as jnp
import numpy as np
from jax import lax

from ..common.deferred import deferred
from ..common.tree import copy_with
from ..common.types import Array, Bool, Float
from ..elements.abilities import is_one_sided
from ..elements.prestress import AxialState
from ..spaces.space import Motion
from ..spaces.translations import drop_low_part
from .elementwise import evaluate_elements

System: TypeAlias = Any
"""`assembly.System`, which cannot be imported here: it stands on this module."""

_MOST_STEPS = 300
"""Steps of the search for a movement; random nets with ten such elements need up to 25."""

_LEAST_RATE = 1e-9
"""Shortening over the movement of the nodes below which it is rounding."""

_FAINT = 1e-9, 1e-4
"""Tension over the largest one below which it is rounding: ten times the tolerances of equilibrium
in double and in single precision."""

_SLACKENING = 1e-3
"""Strain by which released elements are slack; no derivative depends on it."""


class SlackenedElements(NamedTuple):
    """Elements that are just taut or just touching, where derivatives are those of one side or NaN.

    Attributes:
        released: which elements loose nodes can slacken, [n_elem] bool for each group, or None.
        at_kink: whether another element at a free node is at its kink, scalar bool.
    """

    released: list[Bool[Array, " n_elem"] | None]
    at_kink: Bool[Array, ""]


def find_slackened(system: System, x: Motion) -> SlackenedElements:
    """Find which elements of a system at a motion of all rows can slacken: `SlackenedElements`.

    An element is at its kink if its strain is zero up to rounding. Those whose law has history
    variables go slack at other strains and do not count. All is traced where a derivative is taken.
    """
    counted = [_has_kinks(group) for group in system.groups]
    places = [k for k, own in enumerate(counted) if own and _is_straight(system, k)]
    if not any(counted):
        return SlackenedElements([None] * len(counted), jnp.zeros((), bool))
    nothing = [jnp.zeros(len(system.groups[k].links), bool) for k in places]
    find = deferred(lambda s, x: _released_and_kinks(s, x, places), (nothing, jnp.zeros((), bool)))
    found, at_kink = find(*lax.stop_gradient((system, x)))
    released: list[Any] = [None] * len(counted)
    for k, own in zip(places, found, strict=True):
        released[k] = own
    return SlackenedElements(released, at_kink)


def slacken(system: System, released: list[Bool[Array, " n_elem"] | None]) -> System:
    """Return the system with the elements `released`, [n_elem] bool per group or None, slack.

    Their elongations change by a strain of 1e-3; the motion at which the system is looked at stays.
    """
    states = list(system.states)
    for k, (group, own) in enumerate(zip(system.groups, released, strict=True)):
        if own is not None:
            state: Any = states[k]
            sign = 1.0 if group.tension_only else -1.0
            shift = sign * _SLACKENING * lax.stop_gradient(state.rest_length)
            elongation = state.elongation - jnp.where(own, shift, 0.0)
            states[k] = copy_with(state, elongation=elongation)
    return copy_with(system, states=states)


def _released_and_kinks(system, x, places):
    """Return which elements loose nodes can slacken, and whether another one is at its kink.

    The former are a list with [n_elem] bool for each of the groups with the indices `places`, the
    latter is a scalar bool.
    """
    kinked = _masks_at_kinks(system, x)
    faint = _masks_of_faint_tension(system, x, places)
    counted = [own | kinked[k] for own, k in zip(faint, places, strict=True)]
    nothing = [jnp.zeros_like(own) for own in faint]
    search = deferred(lambda *at: _masks_of_slackening(*at, places), nothing)
    released = nothing
    if places:
        released = lax.cond(_any_element(counted), search, lambda *_: nothing, system, x, counted)
    for k, own in zip(places, released, strict=True):
        kinked[k] = kinked[k] & ~own
    return released, _any_element(kinked)


def _has_kinks(group):
    """Return whether elements of a group can be at a kink; laws with history have theirs elsewhere.

    The history of chains is what has slipped, and where it begins to slip they have a kink, too.
    """
    return is_one_sided(group) and (group.is_chain or not group.has_memory)


def _any_element(masks):
    """Return whether any entry of the arrays in a list is true, scalar bool; some may be None."""
    return jnp.any(jnp.stack([jnp.any(own) for own in masks if own is not None] or [False]))


def _is_straight(system, k):
    """Return whether the elements of the group with index `k` are straight, between two nodes."""
    group = system.groups[k]
    is_axial = isinstance(system.states[k], AxialState) and not group.shaped_by_load
    return is_axial and group.links.shape[1] == 2


def _masks_at_kinks(system, x):
    """Return which elements at free nodes are between taut and slack, [n_elem] bool per group.

    None for groups that cannot be slack, or whose laws have history variables.
    """
    found, free, x = [], system.dof_map.movable_dofs(), drop_low_part(x)
    for group, state in zip(system.groups, system.states, strict=True):
        own = None
        if _has_kinks(group):
            moves = jnp.any(free[group.links], axis=(1, 2))
            own = evaluate_elements("at_kink", group, state, system.nodes, x) & moves
        found.append(own)
    return found


def _masks_of_faint_tension(system, x, places):
    """Return which elements have a force that is only rounding, [n_elem] bool per group.

    It is below 1e-9 of the largest one of these elements (1e-4 in single precision), and not zero.
    `places` are indices of groups; the list has their masks.
    """
    at = [(system.groups[k], system.states[k], system.nodes, x) for k in places]
    sizes = [jnp.abs(evaluate_elements("tension", *own)) for own in at]
    largest = jnp.max(jnp.concatenate(sizes)) if sizes else 0.0
    limit = _FAINT[x.dtype.itemsize < 8] * largest
    return [(size > 0) & (size <= limit) for size in sizes]


def _masks_of_slackening(system, x, counted, places):
    """Return which of the `counted` elements of the groups `places` slacken as loose nodes move.

    The result, like `counted`, is a list with [n_elem] bool for each of these groups.

    Loose nodes have only slack and counted elements. Either there is a movement of them that
    unloads all counted elements that end there (shortens cables, lengthens contacts), or these can
    be stressed against each other (Gordan's theorem): then none is released. The movement is the
    point next to zero of the convex hull of the forces that the elements exert on the nodes, found
    by pairwise steps of Frank and Wolfe (S. Lacoste-Julien and M. Jaggi, NIPS 28, 2015), which get
    near it also where forces are nearly opposite.
    """
    idle = system.slack(x)
    for k, own in zip(places, counted, strict=True):
        idle[k] = idle[k] | own
    loose = system.nodes_without_stiffness(x, idle)
    mask = loose[system.dof_map.row_of_unknown]
    groups = [system.groups[k] for k in places]
    at_ends = system.gather_at_ends(system.nodes + x[:, :3])
    signs = [1.0 if group.tension_only else -1.0 for group in groups]
    chords = [s * _second_minus_first_end(at_ends[k]) for k, s in zip(places, signs, strict=True)]
    along = jnp.concatenate(chords)
    along = along / jnp.sqrt(jnp.sum(along**2, axis=1, keepdims=True))
    ends = jnp.concatenate([group.links for group in groups])
    counted = jnp.concatenate(counted) & jnp.any(loose[ends], axis=1)

    def movement(force):  # of the unknowns, by forces along the elements
        pulls = jnp.stack([force, -force], axis=1)[..., None] * along[:, None, :]
        at_rows = jnp.zeros((len(system.nodes), 3), x.dtype).at[ends].add(pulls)
        return jnp.where(mask, system.space.restrict(system.space.pad_moments(at_rows), x), 0.0)

    def shortening(step):
        moved = system.space.prolong(x, step)[:, :3][ends]
        rate = -jnp.sum(_second_minus_first_end(moved) * along, axis=1)
        return jnp.where(counted, rate, jnp.inf)

    def improve(state):
        weights, step, rates, count = state
        shortest = jnp.argmax(jnp.where(weights > 0, rates, -jnp.inf))
        exchange = jnp.asarray(numbers == jnp.argmin(rates), x.dtype) - (numbers == shortest)
        towards = movement(exchange)
        part = -jnp.vdot(towards, step) / jnp.maximum(jnp.vdot(towards, towards), _LEAST_RATE**2)
        part = jnp.clip(part, 0.0, weights[shortest])  # beyond it would leave the convex hull
        step = step + part * towards
        return weights + part * exchange, step, shortening(step), count + 1

    def goes_on(state):
        _, step, rates, count = state  # no least rate exceeds the square of a step
        longer = (jnp.min(rates) <= _LEAST_RATE) & (jnp.vdot(step, step) > _LEAST_RATE)
        return longer & (count < _MOST_STEPS)

    weights = jnp.asarray(counted, x.dtype) / jnp.maximum(jnp.sum(counted), 1)
    numbers, step = jnp.arange(len(along)), movement(weights)
    end = lax.while_loop(goes_on, improve, (weights, step, shortening(step), 0))
    released = counted & (jnp.min(end[2]) > _LEAST_RATE)
    return jnp.split(released, np.cumsum([len(group.links) for group in groups])[:-1])


def _second_minus_first_end(values: Float[Array, "n_elem 2 3"]) -> Float[Array, "n_elem 3"]:
    """Return the values of second ends less those of first ends, [n_elem, 3]."""
    return values[:, 1] - values[:, 0]
