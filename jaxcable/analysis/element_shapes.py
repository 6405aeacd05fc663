"""Shapes of elements at the end of an analysis or of a phase: straight lines and catenaries."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np

from ..common.tree import copy_with, pytree
from ..common.types import Array, Bool, Float, PyTree
from ..elements import hanging
from ..elements.abilities import END_PULL, Hanging
from ..elements.element import Scalar
from ..elements.friction_state import SEGMENT_TENSION
from ..elements.sliding_catenaries import SEGMENT_LENGTH, SEGMENT_PULL, SlidingCatenaries
from ..model.result_parts import items_per_group
from ..model.structure import Structure
from ..model.topology import require_same_topology
from ..numerics.roots import bracketed_root
from ..numerics.vectors import scalar_product
from ..programs.program_calls import as_program
from .phase_results import PhaseResult
from .results import StateResults
from .solution import Solution, State

_SAMPLES = 16
"""Parts into which an element is divided to find the one with the extreme point of a function."""

CATENARIES = Hanging, SlidingCatenaries
"""Classes of elements that are elastic catenaries: between their ends, or in every segment."""

StateOrPhase: TypeAlias = "Solution | State | PhaseResult"


@pytree
class ElementShapes:
    """Shapes of elements: each is a straight line or an elastic catenary; axes [..., n_elem].

    Along the unstressed length the tension is ``T(s) = T1 - q s``, and the tangent has its
    direction. Inside of `map_shapes` the same object stands for one element.

    Attributes:
        first, last: positions of the ends, [..., n_elem, 3], m.
        pull: force of the element on its first node, T1, [..., n_elem, 3], N; of a straight element
            its chord, m.
        load: whole load along the element, ``q L0``, [..., n_elem, 3], N; zero of straight ones.
        rest_length: unstressed length, [..., n_elem], m.
        stiffness: axial stiffness, [..., n_elem], N.
        hangs: whether the element is a catenary, [..., n_elem] bool.
    """

    first: Float[Array, "n_elem 3"]
    last: Float[Array, "n_elem 3"]
    pull: Float[Array, "n_elem 3"]
    load: Float[Array, "n_elem 3"]
    rest_length: Float[Array, " n_elem"]
    stiffness: Float[Array, " n_elem"]
    hangs: Bool[Array, " n_elem"]

    def point(self, part: Scalar) -> Float[Array, " 3"]:
        """Return the point of one element at `part` (0 to 1) of its unstressed length, [3], m."""
        middle = jnp.where(self.hangs, self.pull - 0.5 * self.load, 1.0)
        args = (middle, jnp.zeros(()), self.load / self.rest_length, self.rest_length)
        hung = hanging.positions_along(part[None], *args, self.stiffness)[0]
        return self.first + jnp.where(self.hangs, hung, part * (self.last - self.first))

    def tangent(self, part: Scalar) -> Float[Array, " 3"]:
        """Return a vector along the tangent of one element, [3], not of length 1.

        It is the tension, N, at `part` (0 to 1) of the unstressed length of a catenary, directed to
        the last end; of a straight element the chord, m.
        """
        return self.pull - part * self.load

    def highest_part(
        self, direction: Float[Array, " 3"], low: Scalar, high: Scalar
    ) -> Float[Array, ""]:
        """Return where one element is farthest along the vector `direction`.

        The place is a part of the unstressed length (0 to 1), between `low` and `high`.

        Exact: ``direction @ T(s)`` is linear along the element and zero there, or this is an end.
        """
        at_first = scalar_product(self.pull, direction)
        fall = scalar_product(self.load, direction)
        bent = fall > 0  # the element is concave towards the direction
        inside = jnp.clip(at_first / jnp.where(bent, fall, 1.0), low, high)
        rises = scalar_product(self.point(high) - self.point(low), direction) > 0
        return jnp.where(bent, inside, jnp.where(rises, high, low))

    def horizontal_part(self) -> Float[Array, ""]:
        """Return the tension of one catenary along its chord in plan, N; else the slope's cosine.

        It is that in the middle of the unstressed length.
        """
        chord = self.last - self.first
        span = jnp.sqrt(scalar_product(chord[:2], chord[:2]))
        pull = self.tangent(jnp.full((), 0.5, chord.dtype))
        size = jnp.where(self.hangs, 1.0, jnp.sqrt(scalar_product(chord, chord)))
        return scalar_product(pull[:2], chord[:2]) / span / size

    def midspan_sag(self) -> Float[Array, ""]:
        """Return the vertical distance of one element below its chord at midspan, m.

        Midspan is at half of the horizontal distance of the ends.
        """
        chord = self.last - self.first
        span2 = scalar_product(chord[:2], chord[:2])

        def balance(part):
            moved = self.point(part) - self.first
            return scalar_product(moved[:2], chord[:2]) / span2 - 0.5

        # beyond its ends a catenary goes on, so that a root at an end is inside of the bracket
        guess = jnp.full_like(span2, 0.5)
        part = bracketed_root(balance, guess, guess - 0.75, guess + 0.75)
        return 0.5 * chord[2] - (self.point(part) - self.first)[2]

    def reversed(self) -> ElementShapes:
        """Return the same shapes, run through from the last end to the first."""
        pull = jnp.where(self.hangs[..., None], self.load - self.pull, self.first - self.last)
        return copy_with(self, first=self.last, last=self.first, pull=pull)

    def argmin_along(self, function: Callable[[Float[Array, " 3"]], Scalar]) -> Float[Array, ""]:
        """Return where along one element (0 to 1) a smooth function of the position is least.

        The function is evaluated at 17 places; between the neighbors of the least one, the place
        where its derivative along the element is zero is found to rounding. Of several minima
        closer than 1/16 of the element it may find another one.
        """
        parts = jnp.linspace(0.0, 1.0, _SAMPLES + 1, dtype=self.first.dtype)
        values = jax.vmap(lambda part: function(self.point(part)))(parts)
        k = jnp.argmin(jax.lax.stop_gradient(values))
        low, high = parts[jnp.maximum(k - 1, 0)], parts[jnp.minimum(k + 1, _SAMPLES)]

        def slope(part):
            return scalar_product(jax.grad(function)(self.point(part)), self.tangent(part))

        inside = (slope(low) < 0) & (slope(high) > 0)
        middle = parts[k]

        def balance(part):  # where there is no root inside: one that is known
            return jnp.where(inside, slope(part), part - 0.5 * (low + high))

        root = bracketed_root(balance, middle, low, high)
        return jnp.where(inside, root, middle)


def element_shapes(
    structure: Structure, state: StateOrPhase
) -> list[tuple[ElementShapes, Bool[Array, " n_elem"]]]:
    """Return the shapes of all groups, and which elements are active, a list of pairs.

    Elements of three and more nodes are divided into straight lines, so that the arrays of their
    groups have two axes, [..., n_elem, n_line].

    Args:
        structure: the `Structure` that was analysed.
        state: `Solution` (NaN if it has failed), `State`, or one of
            ``solution.phases``; batches have leading axes.

    Raises:
        ValueError: not a state, or of another structure.
    """
    known = results_of_state(structure, state)
    results = {**(known.results or {}), "rest_length": known.rest_length}

    def one_of(*names):
        """Return for each group the first of the named results that it has, or None."""
        every = (items_per_group(structure, results.get(name)) for name in names)
        return [next((x for x in own if x is not None), None) for own in zip(*every, strict=True)]

    pulls = one_of(SEGMENT_PULL.name, END_PULL.name)
    lengths = one_of(SEGMENT_LENGTH.name, "rest_length")
    present = items_per_group(structure, known.present)
    return _shapes_and_activity(list(structure.groups), known.positions, pulls, present, lengths)


def tensions_of_shapes(structure: Structure, state: StateOrPhase) -> list[Any]:
    """Return the tensions of all groups, a list of arrays [..., n_elem], N; None without tensions.

    Of hanging cables that slide over nodes they are those of segments, [..., n_elem, n_segment].
    """
    known = results_of_state(structure, state)
    whole = items_per_group(structure, known.tension)
    segments = items_per_group(structure, (known.results or {}).get(SEGMENT_TENSION.name))
    return [
        part if isinstance(group, SlidingCatenaries) else own
        for group, own, part in zip(structure.groups, whole, segments, strict=True)
    ]


@as_program
def _shapes_and_activity(groups, positions, *parts):
    """Return pairs of `ElementShapes` and which elements are active, [n_elem] bool, by group.

    `parts` are results of elements, a list per group each: forces, whether elements are there, and
    unstressed lengths.
    """
    found = []
    for group, pull, there, length in zip(groups, *parts, strict=True):
        if isinstance(group, CATENARIES):
            shapes = _catenary_shapes(group, positions, pull, length)
        else:
            shapes = _straight_shapes(group, positions)
        if there is None:
            there = jnp.ones(len(group.links), bool)
        count = positions.ndim - 2
        there = jnp.broadcast_to(there > 0, (*shapes.hangs.shape[:count], len(group.links)))
        found.append((shapes, there))
    return found


def results_of_state(structure: Structure, state: StateOrPhase) -> StateResults:
    """Return a state, which has `StateResults`, after checks.

    Raises:
        ValueError: not a state, or of another structure.
    """
    if not isinstance(state, Solution | State | PhaseResult):
        raise ValueError(
            "state: expected a Solution, its .last or one of its .phases, got "
            f"{type(state).__name__}"
        )
    if isinstance(state, Solution | State):
        end = state.last if isinstance(state, Solution) else state
        require_same_topology(structure, end.topology, "state")
    n_node = state.positions.shape[-2]
    if n_node != structure.n_node:
        raise ValueError(f"state: has {n_node} nodes, the structure has {structure.n_node}")
    return state


def straight_shapes(first: Float[Array, "... 3"], last: Float[Array, "... 3"]) -> ElementShapes:
    """Return the `ElementShapes` of straight lines between two ends each, [..., 3], m."""
    ones = jnp.ones(first.shape[:-1], first.dtype)
    chord = last - first
    return ElementShapes(
        first, last, chord, jnp.zeros_like(chord), ones, ones, jnp.zeros(ones.shape, bool)
    )


def _straight_shapes(group, positions):
    """Return the shapes of a group of straight elements; of lines [..., n_elem, n_line] if several.

    Chains that are shorter than others end with lines of length zero.
    """
    chain = group.links.array
    if group.face is not None and group.outline is None:
        chain = chain[:, [*group.face, group.face[0]]]
    elif group.outline is not None:
        chain = chain[:, list(group.outline)]
    ends = chain[:, :-1], chain[:, 1:]
    if chain.shape[1] <= 2:  # a spring at one node is a line without length
        ends = chain[:, 0], chain[:, -1]
    return straight_shapes(*(jnp.asarray(positions)[..., nodes, :] for nodes in ends))


def _catenary_shapes(group, positions, pull, length):
    """Return the shapes of a group of catenaries from its results; arguments are per group.

    Of hanging cables that slide over nodes there is a line for each segment, [..., n_elem, n_line].

    `pull` is the result `END_PULL`, None if no phase has loads along the elements: then they are
    straight.
    """
    chain = group.links.array
    ends = (chain[:, :-1], chain[:, 1:]) if group.slides else (chain[:, 0], chain[:, -1])
    first, last = (jnp.asarray(positions)[..., nodes, :] for nodes in ends)
    if pull is None:
        if END_PULL not in group.results:
            raise ValueError(
                f"elements: {type(group).__name__} has no result {END_PULL.name!r}, from which its "
                "shape follows; list elements.abilities.END_PULL among its results"
            )
        return straight_shapes(first, last)
    pull = pull.reshape(*first.shape[:-1], 2, 3)
    stiffness = jnp.asarray(group.stiffness_with_spring, first.dtype)
    if group.slides:
        stiffness = stiffness[..., None]
    stiffness = jnp.broadcast_to(stiffness, first.shape[:-1])
    load = pull[..., 0, :] + pull[..., 1, :]
    length = jnp.broadcast_to(jnp.asarray(length, first.dtype), first.shape[:-1])
    # a slack cable without load has no force; its shape is not known, and it is taken as straight
    hangs = jnp.any(pull[..., 0, :] != 0, axis=-1)
    chord = last - first
    own = jnp.where(hangs[..., None], pull[..., 0, :], chord)
    if group.slides:  # fillers of shorter cables have no direction and length: any, for derivatives
        filler = np.broadcast_to(chain[:, 1:] == chain[:, :-1], length.shape)
        own = jnp.where(filler[..., None], jnp.ones_like(own), own)
        length = jnp.where(filler, 1.0, length)
    return ElementShapes(first, last, own, load, length, stiffness, hangs)


def map_shapes(function: Callable[..., Any], shapes: ElementShapes, *others: PyTree[Array]) -> Any:
    """Call ``function(shape, *others)`` for every element, a program; results have leading axes.

    `function` is one of a module, because programs are known by it; `others` are the same for all
    elements.
    """
    return _map_shapes(shapes, *others, function=function)


@functools.partial(as_program, static=("function",))
def _map_shapes(shapes, *others, function):
    """Return ``function(shape, *others)`` for every element, by vmap over all axes; a program."""
    for _ in range(shapes.rest_length.ndim):
        function = jax.vmap(function, in_axes=(0, *(None,) * len(others)))
    return function(shapes, *others)
