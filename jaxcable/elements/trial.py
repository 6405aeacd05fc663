"""Tests of an element class: its declaration, shapes of its methods, forces against energy.

Every fault is a sentence that names the method or field, what is expected of it, and what it gave.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..common.tree import Indices
from ..numerics.rotations import IDENTITY, move_node
from .abilities import Hanging, Jackable
from .element import Element, Result
from .element_state import ElementState
from .prestress import single_element
from .state_trial import activation_faults, describe_error, describe_type, phase_input_faults

# Displacement at which a group is tested, over the mean distance of its ends: large enough that
# nonlinear terms show, small enough that laws stay within their curves.
_TRIAL_MOTION = 1e-2
_FIELD_SYNTAX = "fields of the class, `name: object` in its body"


def declaration_faults(group: Element, n_row: int) -> Iterator[str]:
    """Yield faults in the declaration of a class of elements: fields, results, node numbers.

    Args:
        group: object of a class that derives from `Element`.
        n_row: number of rows of motion.
    """
    kind = type(group)
    if "_all_fields" not in vars(kind):
        yield 'class: expected a `@pytree(indices=("links",))` class, got one without the decorator'
        return
    yield from _undeclared_array_faults(group, kind.__name__)
    if "links" not in kind._index_fields:  # type: ignore[attr-defined]
        yield 'links: expected an index field, @pytree(indices=("links",)), got another field'
    for result in group.results:
        if not isinstance(result, Result):
            yield f"results: expected `Result`, got {result!r}"
    links = group.links
    if not isinstance(links, Indices):
        yield (
            "links: expected `Indices` of node numbers [n_elem, n_end] (`Indices(links)` in "
            f"`__post_init__`), got a bare {type(links).__name__}"
        )
        return
    if len(links.shape) != 2 or 0 in links.shape or links.array.dtype.kind not in "iu":
        yield (
            "links: expected whole numbers [n_elem, n_end], got "
            f"{links.array.dtype} of shape {links.shape}"
        )
    elif links.array.min() < 0 or links.array.max() >= n_row:
        yield (
            f"links: expected node numbers from 0 to {n_row - 1}, got {links.array.min()} to "
            f"{links.array.max()}"
        )


def _undeclared_array_faults(obj, name):
    """Yield faults of arrays that an object has outside its pytree fields, or in static ones.

    `name` is what messages call the class of the object.
    """
    kind, known = type(obj), type(obj)._all_fields
    for attribute, value in vars(obj).items():
        arrays = [x for x in jax.tree.leaves(value) if isinstance(x, np.ndarray | jax.Array)]
        if attribute not in known and arrays and not attribute.endswith("_once"):
            yield (
                f"{attribute}: expected arrays of {name} to be {_FIELD_SYNTAX}; got one that is "
                "none, and is lost where jax takes the object apart"
            )
        if attribute in kind._static_fields and arrays:
            shape = _describe_shape(arrays[0])
            yield f"{attribute}: expected static fields without arrays, got {shape}"
    for attribute in getattr(kind, "per_element", ()):
        if attribute not in known and not isinstance(getattr(kind, attribute, None), property):
            yield f"per_element: expected {_FIELD_SYNTAX}, got {attribute!r}, which is none"


def method_faults(
    group: Element, nodes: Any, state: Any, motion: Any, tol: float, conservative: bool
) -> Iterator[str]:
    """Yield faults of the methods of a group, found by calling them, one sentence each.

    Arguments are those of `contract.check`.
    """
    nodes, links = jnp.asarray(nodes, float), np.asarray(group.links)
    ends = nodes[links]
    if state is None:
        try:
            state = group.start(ends)
        except Exception as error:  # of the author's code
            yield describe_error("start", "an `ElementState`", error)
            return
    if not isinstance(state, ElementState):
        yield f"start: expected an `ElementState`, got {type(state).__name__}"
        return
    if "_all_fields" not in vars(type(state)):
        yield f"start: expected a `@pytree` class, got {type(state).__name__} without the decorator"
        return
    yield from _undeclared_array_faults(state, type(state).__name__)
    faults = [*_field_faults(group, state, len(links))]
    if faults:
        yield from faults
        return
    motion = _random_motion(group, nodes, ends) if motion is None else jnp.asarray(motion, float)
    yield from _MethodTrial(group, state, ends, motion[links]).faults(tol, conservative)


class _MethodTrial:
    """Calls the methods of a group for all elements at once, and finds their faults.

    Attributes:
        group, state, ends, motion: arguments of the calls.
    """

    def __init__(self, group, state, ends, motion):
        self.group, self.state, self.ends, self.motion = group, state, ends, motion
        self.n_elem, self.n_end = ends.shape[:2]

    def for_every_element(self, method: Callable[..., Any], motion: Any = None) -> Any:
        """Return ``method(one, state, ends, motion)`` of all elements, stacked, called by vmap."""

        def one(properties, *at):
            return method(single_element(self.group, properties), *at)

        at = self.state, self.ends, self.motion if motion is None else motion
        return jax.vmap(one)(self.group.properties(), *at)

    def faults(self, tol: float, conservative: bool) -> Iterator[str]:
        """Yield the faults of all methods; `tol` and `conservative` are as for `contract.check`."""
        sizes = (self.n_end, self.group.n_freedom)
        square = 2 * (sizes[0] * sizes[1],)
        shapes = {"end_forces": (sizes,), "energy": ((),), "tangent": ((*sizes, *sizes), square)}
        still, bad = self._zero_motion(), []
        for name, allowed in shapes.items():
            for where, motion in (("", None), (" before any motion", still)):
                bad = [*self._returned_array_faults(name, allowed, where, motion)]
                yield from bad
                if bad:
                    break
            if bad and name != "tangent":
                return
        yield from self._named_result_faults()
        if self.group.has_memory:
            yield from self._memory_faults()
        yield from phase_input_faults(self.group, self.state, self.ends)
        yield from activation_faults(self.group, self.state, self.ends, self.motion)
        if not bad:
            yield from self._derivative_faults(tol, conservative)

    def _zero_motion(self):
        """Return a motion of no displacement, and of identity quaternions with rotations."""
        still = jnp.zeros_like(self.motion)
        return still.at[..., 3:].set(jnp.asarray(IDENTITY)) if self.group.rotates else still

    def _returned_array_faults(self, name, shapes, where, motion, *step):
        """Yield faults of type, shape and numbers of the array that a method, by name, returns.

        `shapes` are the allowed ones for an element, `where` is added in messages, and `step` is
        passed on to the method.
        """
        words = "a scalar" if shapes == ((),) else f"an array of shape {shapes[0]}"
        words += " of floats for an element"
        try:
            values = self.for_every_element(lambda one, *at: getattr(one, name)(*at, *step), motion)
        except Exception as error:  # of the author's code
            yield describe_error(name + where, words, error)
            return
        if not isinstance(values, jax.Array):
            yield f"{name}: expected {words}, got {describe_type(values)}"
            return
        # of the columns of inner rows the tangent has those that contain a number
        inner = name == "tangent" and self.group.inner_unknowns and values.ndim == 3
        if values.shape[1:] not in shapes and not (inner and len({*values.shape[1:]}) == 1):
            yield f"{name}: expected {words}, got shape {values.shape[1:]}"
            return
        if not jnp.issubdtype(values.dtype, jnp.floating):
            yield f"{name}: expected {words}, got {values.dtype}"
            return
        finite = np.isfinite(np.asarray(values)).reshape(self.n_elem, -1)
        if not finite.all():
            k = int(np.flatnonzero(~finite.all(axis=1))[0])
            wrong = np.asarray(values)[k].ravel()[~finite[k]][0]
            yield f"{name}{where}: expected finite numbers, got {wrong} of element {k}"

    def _named_result_faults(self):
        """Yield faults in the shapes of declared `results`, of `is_slack`, `at_kink`, `weights`."""
        group, state = self.group, self.state
        for result in group.results:
            name = result.name
            if not group.has_result(name, state):
                continue
            count = len(result.components)
            words = f"{count} components in the last axis" if count else "an array"
            try:
                values = self.for_every_element(lambda one, *at, name=name: getattr(one, name)(*at))
            except Exception as error:  # of the author's code
                yield describe_error(f"results: {name}", words, error)
                continue
            if not isinstance(values, jax.Array | np.ndarray):  # a field as it is
                got = describe_type(values)
                yield f"results: {name}: expected {words} for an element, got {got}"
            elif count and values.shape[-1:] != (count,):
                yield (
                    f"results: {name} has {count} components, and its last axis the shape "
                    f"{values.shape[1:]}"
                )
            elif result.places and values.shape[1 : values.ndim - (count > 0)] != (
                len(result.places),
            ):
                yield (
                    f"results: {name} has {len(result.places)} places, in the axis before its "
                    f"components if it has any, and the shape {values.shape[1:]}"
                )
        for name in ("is_slack", "at_kink"):
            try:
                flags = self.for_every_element(lambda one, *at, name=name: getattr(one, name)(*at))
            except Exception as error:  # of the author's code
                yield describe_error(name, "a bool of an element", error)
                continue
            if not isinstance(flags, jax.Array):
                yield f"{name}: expected a bool of an element, got {describe_type(flags)}"
            elif flags.shape != (self.n_elem,) or flags.dtype != bool:
                yield f"{name}: expected a bool of an element, got {flags.dtype} {flags.shape[1:]}"
        weights = group.weights(state)
        if (weights is None) != (group.weight is None):
            yield "weights: returns something where `weight` is None, or the other way about"

    def _memory_faults(self):
        """Yield faults of `committed_memory` and of `absolute_force`."""
        expected = jax.tree.map(lambda x: (x.shape, x.dtype), self.state.memory)
        words = "a memory like that of the state"
        try:
            after = self.for_every_element(lambda one, *at: one.committed_memory(*at, duration=0.0))
        except Exception as error:  # of the author's code
            yield describe_error("committed_memory", words, error)
        else:
            found = jax.tree.map(lambda x: (jnp.shape(x), jnp.result_type(x)), after)
            if jax.tree.structure(found) != jax.tree.structure(expected) or found != expected:
                text = f"{words}, {expected} for all elements, got {found}"
                yield f"committed_memory: expected {text}"
        yield from self._returned_array_faults("absolute_force", ((),), "", None)

    def _derivative_faults(self, tol, conservative):
        """Yield faults where end forces, tangent and energy are not each other's derivatives."""
        group, every = self.group, self.for_every_element
        shape = (*self.ends.shape[1:2], group.n_freedom)
        still = jnp.zeros(shape)
        forces = every(lambda one, *at: one.end_forces(*at))
        size = jnp.max(jnp.abs(forces))

        def moved(motion, step):
            return jax.vmap(move_node)(motion, step) if group.rotates else motion + step

        def about(one, *at):
            return jax.jacfwd(lambda step: one.end_forces_after_step(*at, step))(still)

        def slope(one, state, ends, motion):
            return jax.grad(lambda step: one.energy(state, ends, moved(motion, step)))(still)

        bad = [*self._returned_array_faults("end_forces_after_step", (shape,), "", None, still)]
        if bad:
            yield from bad
            return
        try:
            here = every(lambda one, *at: one.end_forces_after_step(*at, still))
            derivative = every(about).reshape(self.n_elem, still.size, still.size)
        except Exception as error:  # of the author's code
            yield describe_error(
                "end_forces_after_step", "a function that jax can differentiate", error
            )
            return
        if group.rotates:
            other = every(
                lambda one, *at: one.end_forces(*at), self.motion.at[..., 3:].multiply(-1.0)
            )
            if not _relative_difference(other, forces, size) <= tol:
                yield (
                    "end_forces: other forces for the quaternions q and -q, which are the same "
                    "rotation"
                )
        if not _relative_difference(here, forces, size) <= tol:
            yield "end_forces_after_step: at a step of zero it is not `end_forces`"
        tangent = every(lambda one, *at: one.tangent(*at))
        count = round((tangent.size // self.n_elem) ** 0.5)
        tangent = tangent.reshape(self.n_elem, count, count)
        largest = jnp.max(jnp.abs(tangent))
        if (
            not group.inner_unknowns
            and not _relative_difference(tangent, derivative, largest) <= tol
        ):
            yield "tangent: it is not the derivative of the end forces"
        across = _relative_difference(tangent, jnp.swapaxes(tangent, 1, 2), largest)
        if group.symmetric and not across <= tol:
            yield (
                f"symmetric: its tangent is not ({across:.1e} of the largest entry); state "
                "symmetric = False"
            )
        if conservative and not group.inner_unknowns:
            try:
                gradient = every(slope)
            except Exception as error:  # of the author's code
                yield describe_error("energy", "a function that jax can differentiate", error)
                return
            if not _relative_difference(gradient, forces, size) <= tol:
                yield "energy: the end forces are not its gradient"


def _field_faults(group, state, n_elem):
    """Yield faults of fields of a state and of a group that have no leading axis [n_elem].

    A field of the state that an ability needs, and that is missing, is a fault, too.
    """
    for name, leaf in ((n, x) for n, x in vars(state).items() if n in type(state)._all_fields):
        shapes = {np.shape(x)[:1] for x in jax.tree.leaves(leaf)}
        if shapes - {(n_elem,)}:
            yield (
                f"start: state.{name} has no leading axis [n_elem]: expected {n_elem} elements, "
                f"got the shape {np.shape(jax.tree.leaves(leaf)[0])}"
            )
    for name, value in group.properties().items():
        wrong = [x for x in jax.tree.leaves(value) if np.shape(x)[:1] != (n_elem,)]
        if wrong:
            yield (
                f"per_element: {name} has no leading axis [n_elem]: expected {n_elem} elements, "
                f"got the shape {np.shape(wrong[0])}"
            )
    known = type(state)._all_fields
    needs = (
        ("has_length", group.has_length, ("rest_length",)),
        ("has_memory", group.has_memory, ("memory",)),
        ("Jackable", isinstance(group, Jackable), ("jack_force", "jacked")),
        ("Hanging", isinstance(group, Hanging), ("rest_length",)),
        ("shaped_by_load", group.shaped_by_load, ("element_load",)),
        (
            "state_at_activation",
            type(group).state_at_activation is not Element.state_at_activation,
            ("present",),
        ),
    )
    for ability, has, names in needs:
        for name in names:
            if has and name not in known:
                yield f"{ability}: its state needs a field `{name}`"


def _describe_shape(array):
    """Return the words "an array of shape ..." for an array."""
    return f"an array of shape {np.shape(array)}"


def _relative_difference(one, other, size):
    """Return the largest absolute difference of two arrays over `size`; NaN if shapes differ.

    Where `size` is zero, the difference itself is returned.
    """
    if np.shape(one) != np.shape(other):
        return float("nan")
    return float(jnp.max(jnp.abs(one - other)) / jnp.where(size > 0, size, 1.0))


def _random_motion(group, nodes, ends):
    """Return a small random motion of all rows, [n_row, 3], or [n_row, 7] with rotations."""
    chord = group.chord(ends)
    size = _TRIAL_MOTION * (float(jnp.mean(chord)) if chord.size else 1.0)
    step = size * np.random.default_rng(0).uniform(-1, 1, (len(nodes), group.n_freedom))
    still = jnp.zeros_like(nodes)
    if not group.rotates:
        return still + step
    turn = jnp.broadcast_to(jnp.asarray(IDENTITY, nodes.dtype), (len(nodes), 4))
    return jax.vmap(move_node)(jnp.concatenate([still, turn], axis=1), jnp.asarray(step))
