"""Check that a class of elements keeps the contract of `element` and `abilities`.

`require` is asked of every group of a structure, by attributes alone. `check` is for authors of
elements: it calls the methods of a group, and compares forces, tangent and energy.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..common.types import ArrayLike, Float
from ..numerics.rotations import IDENTITY, turned
from .abilities import STATEMENTS, Jacked, Prestressable, Sagging
from .element import SECTION_STRAIN, Element, ElementState
from .prestress import element

METHODS = {
    "remembers": ("settle", "size", "initial_memory"),
    "breaks": ("beyond",),
    "tension_only": ("is_slack", "at_kink"),
    "rotates": ("end_forces_about",),
    "slides": ("slid",),
}
"""Methods that a group must have where an attribute is true, see the table in `abilities`."""

_MOVED = 1e-2  # displacement at which a group is tried, over the mean distance of its ends


def require(group: Element, name: str) -> None:
    """Raise ValueError if a group lacks what its attributes promise.

    Args:
        group: element group.
        name: of the group, as a user writes it, for messages.
    """
    for text in _lacks(group):
        raise ValueError(f"{name} ({type(group).__name__}): {text}")


def _lacks(group):
    """Iterate over what a group lacks by its attributes, in words."""
    kind = type(group)
    for attribute, methods in METHODS.items():
        for method in methods:
            if getattr(group, attribute) and _inherits(kind, method):
                yield f"{attribute} = True needs a method `{method}`"
    names = [result.name for result in group.results]
    for attribute in ("remembers", "breaks"):
        if getattr(group, attribute) and SECTION_STRAIN.name not in names:
            yield f"{attribute} = True needs the result `{SECTION_STRAIN.name}`"
    for name in names:
        if not callable(getattr(group, name, None)):
            yield f"results: {name!r} is not a method of the group"
    if isinstance(group, Prestressable):
        for name in group.statements:
            if name not in STATEMENTS:
                yield f"statements: {name!r} is none of {', '.join(STATEMENTS)}"
        for name, ability in (("jacking", Jacked), ("sag", Sagging)):
            # groups that derive from `Prestressed` list all statements, and refuse these
            own = "statements" in vars(kind)
            if own and name in group.statements and not isinstance(group, ability):
                yield f"statements: {name!r} needs the ability `{ability.__name__}`"


def _inherits(kind, method):
    """Whether a class has nothing but the default of `Element` for a method."""
    return getattr(kind, method) is getattr(Element, method)


def check(
    group: Element,
    nodes: Float[ArrayLike, "n_node 3"],
    state: ElementState | None = None,
    motion: Float[ArrayLike, "n_row n_motion"] | None = None,
    *,
    tol: float = 1e-6,
    conservative: bool | None = None,
) -> None:
    """Try a class of elements of your own: its methods, their shapes, forces against energy.

    The end forces must be the gradient of the energy and the tangent symmetric, unless the group
    says ``symmetric = False``; the tangent must be the derivative of the end forces in any case.

    Args:
        group: element group, with some elements.
        nodes: initial positions, [n_node, 3], m. Elements with inner numbers need a row for each
            inner row after the nodes, at any position, and links that name these rows.
        state: state of the group; default that before the first phase.
        motion: of all rows, [n_row, 3], or with rotations [n_row, 7]; default a random one of 1 %
            of the mean distance of the ends (1 cm for elements of one end). It should strain the
            elements, and be off their kinks.

    Options:
        tol: largest difference, relative to the largest entry; it must allow for the rounding of
            forces (use double precision).
        conservative: whether forces are to be compared with the energy; default `symmetric`.

    Raises:
        ValueError: the group does not keep the contract; the message has all that was found.

    Example:
        >>> nodes = [[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [3.0, 4.0, 0.0]]
        >>> bars = jc.Bars([[0, 1], [1, 2]], axial_stiffness=1e6)
        >>> jc.elements.check(bars, nodes)  # it says nothing
    """
    found = [*_lacks(group), *_tried(group, nodes, state, motion, tol, conservative)]
    if found:
        raise ValueError(f"{type(group).__name__}: " + "; ".join(found))


def _tried(group, nodes, state, motion, tol, conservative):
    """Iterate over what `check` finds by calling methods, in words."""
    nodes, links = jnp.asarray(nodes, float), np.asarray(group.links)
    ends = nodes[links]
    state = group.start(ends) if state is None else state
    if not isinstance(state, ElementState):
        yield f"start: returns {type(state).__name__}, expected an `ElementState`"
        return
    yield from _fields(group, state, len(links))
    motion = _shaken(group, nodes, ends) if motion is None else jnp.asarray(motion, float)
    at = state, ends, motion[links]

    def every(method: Callable[..., Any]) -> Any:
        """``method(element, state, ends, motion)`` of every element."""

        def one(properties, *at):
            return method(element(group, properties), *at)

        return jax.vmap(one)(group.properties(), *at)

    n_elem, n_end = links.shape
    forces = every(lambda one, *at: one.end_forces(*at))
    if forces.shape != (n_elem, n_end, group.n_freedom):
        yield (
            f"end_forces: expected shape {(n_end, group.n_freedom)} of an element, got "
            f"{forces.shape[1:]}"
        )
        return
    energy = every(lambda one, *at: one.energy(*at))
    if energy.shape != (n_elem,):
        yield f"energy: expected a scalar of an element, got shape {energy.shape[1:]}"
        return
    yield from _named(group, state, every, n_elem)
    yield from _derivatives(group, every, forces, links, tol, conservative)


def _fields(group, state, n_elem):
    """What is wrong with the state and the arrays of a group."""
    for name, leaf in ((n, x) for n, x in vars(state).items() if n in type(state)._all_fields):
        shapes = {np.shape(x)[:1] for x in jax.tree.leaves(leaf)}
        if shapes - {(n_elem,)}:
            yield f"start: state.{name} has no leading axis [n_elem]"
    for name, value in group.properties().items():
        if any(np.shape(x)[:1] != (n_elem,) for x in jax.tree.leaves(value)):
            yield f"per_element: {name} has no leading axis [n_elem]"
    known = type(state)._all_fields
    needs = (
        ("has_length", group.has_length, ("rest_length",)),
        ("remembers", group.remembers, ("memory",)),
        ("Jacked", isinstance(group, Jacked), ("jack_force", "jacked")),
        ("Sagging", isinstance(group, Sagging), ("rest_length",)),
        ("shaped_by_load", group.shaped_by_load, ("line_load", "pressed")),
        ("found", not _inherits(type(group), "found"), ("present",)),
    )
    for ability, has, names in needs:
        for name in names:
            if has and name not in known:
                yield f"{ability}: its state needs a field `{name}`"


def _named(group, state, every, n_elem):
    """What is wrong with results, and with what the group says of slackness."""
    for result in group.results:
        if not group.has_result(result.name, state):
            continue
        values = every(lambda one, *at, name=result.name: getattr(one, name)(*at))
        if result.components and values.shape[-1:] != (len(result.components),):
            yield (
                f"results: {result.name} has {len(result.components)} components, and its last "
                f"axis the shape {values.shape[1:]}"
            )
    for name in ("is_slack", "at_kink"):
        flags = every(lambda one, *at, name=name: getattr(one, name)(*at))
        if flags.shape != (n_elem,) or flags.dtype != bool:
            yield f"{name}: expected a bool of an element, got {flags.dtype} {flags.shape[1:]}"
    weights = group.weights(state)
    if (weights is None) != (group.weight is None):
        yield "weights: returns something where `weight` is None, or the other way about"


def _derivatives(group, every, forces, links, tol, conservative):
    """What is wrong with the forces about a step, the tangent, and the energy."""
    shape = (*links.shape[1:], group.n_freedom)
    still, size = jnp.zeros(shape), jnp.max(jnp.abs(forces))

    def moved(motion, step):
        return jax.vmap(turned)(motion, step) if group.rotates else motion + step

    def about(one, *at):
        return jax.jacfwd(lambda step: one.end_forces_about(*at, step))(still)

    def slope(one, state, ends, motion):
        return jax.grad(lambda step: one.energy(state, ends, moved(motion, step)))(still)

    here = every(lambda one, *at: one.end_forces_about(*at, still))
    if _apart(here, forces, size) > tol:
        yield "end_forces_about: at a step of zero it is not `end_forces`"
    derivative = every(about).reshape(len(links), still.size, still.size)
    tangent = every(lambda one, *at: one.tangent(*at))
    count = round((tangent.size // len(links)) ** 0.5)
    tangent = tangent.reshape(len(links), count, count)
    largest = jnp.max(jnp.abs(tangent))
    if not group.inner and _apart(tangent, derivative, largest) > tol:
        yield "tangent: it is not the derivative of the end forces"
    across = _apart(tangent, jnp.swapaxes(tangent, 1, 2), largest)
    if group.symmetric and across > tol:
        yield (
            f"symmetric: its tangent is not ({across:.1e} of the largest entry); state symmetric = "
            "False"
        )
    conservative = group.symmetric if conservative is None else conservative
    if conservative and not group.inner and _apart(every(slope), forces, size) > tol:
        yield "energy: the end forces are not its gradient"


def _apart(one, other, size):
    """Largest difference over a size."""
    return float(jnp.max(jnp.abs(one - other)) / jnp.where(size > 0, size, 1.0))


def _shaken(group, nodes, ends):
    """A random motion of all rows, [n_row, 3 or 7]."""
    chord = group.chord(ends)
    size = _MOVED * (float(jnp.mean(chord)) if chord.size else 1.0)
    step = size * np.random.default_rng(0).uniform(-1, 1, (len(nodes), group.n_freedom))
    still = jnp.zeros_like(nodes)
    if not group.rotates:
        return still + step
    turn = jnp.broadcast_to(jnp.asarray(IDENTITY, nodes.dtype), (len(nodes), 4))
    return jax.vmap(turned)(jnp.concatenate([still, turn], axis=1), jnp.asarray(step))
