"""Sliding cable: one cable over several nodes without friction, so that it has one tension.

``N = EA (sum l - L0) / L0`` over the sum of its pieces: a running rope over pulleys, a cable in a
pocket of a membrane, a closed loop. (Aufaure 1993, Zhou, Accorsi and Leonard 2004: "hyper cable".)
Its energy is a function of a sum of lengths, hence as convex in the nodes as that of a cable.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..common import checks
from ..common.rules import Rule
from ..common.tree import Indices, index_array, pytree
from ..common.types import Array, ArrayLike, Float, Int
from .abilities import Jackable, RoundingEstimate
from .cable import TensionOnly
from .element import Element, Ends, Forces, Motion, Scalar
from .prestress import AxialState, jack_value_or


@pytree(indices=("links",))
class SlidingCables(TensionOnly, Jackable, RoundingEstimate):
    """A group of cables that slide without friction over their nodes; tension only.

    Every value per element is one value per cable: one tension, one unstressed length, one weight.

    The weight, and line loads per unstressed length, slide along with the cable: each piece between
    two nodes carries a share in proportion to its length, half of it at each of its ends. These
    loads have the potential ``-W sum (l_i / l) z_i`` with z of the middles of the pieces, which
    also pulls rope over to where it hangs lower, and is not convex. Line loads per initial or
    projected length stay with the pieces for which they are stated.

    Two free nodes that the cable pulls onto each other leave a piece without length, and an
    equilibrium without a tangent: the status then is COLLAPSED (join the nodes).

    Args:
        links: the nodes of each cable in order, a list of lists, or [n_elem, n_end]. A closed loop
            ends with its first node. Shorter chains are padded with their last node.
        axial_stiffness, area, law, section, rest_length, weight, expansion, strength, compliance:
            as of `Cables`; `rest_length` is that of the whole cable.

    Raises:
        ValueError: as of `Cables`; and for a chain with less than two nodes or a node twice in
            succession.

    Source: Aufaure (1993); Zhou, Accorsi and Leonard (2004).

    Example:
        A rope over a pulley that carries 600 N has one tension on both sides:

        >>> nodes = [[-4.0, 0.0, 3.0], [0.0, 0.0, 0.0], [4.0, 0.0, 3.0]]
        >>> rope = jc.SlidingCables([[0, 1, 2]], axial_stiffness=1e5)
        >>> structure = jc.Structure(nodes, rope, supports=jc.pinned([0, 2]))
        >>> weight = jc.NodalLoads([1], (0.0, 0.0, -600.0))
        >>> solution = jc.solve(structure, jc.Phase(pretension=500.0, loads=weight))
        >>> print(solution.status, jnp.round(solution.tension, 6))
        0 [500.]
        >>> print(jnp.round(solution.rest_length, 6))  # 10 m / (1 + 500 / 1e5)
        [9.950249]
    """

    links: Int[ArrayLike, "n_elem 2+"]

    # no `SecantStiffness`: the tension depends on all pieces, so that a single one has none
    shaped_by_load = slides = True
    tangent = Element.tangent  # that of `Axial` is for two nodes
    paired = False

    def __new__(cls, *_: Any, **fields: Any) -> Any:
        """Make an object of the subclass that has all `fields`: with friction `FrictionCables`."""
        for kind in (cls, *cls.__subclasses__()):
            if fields.keys() <= {field.name for field in dataclasses.fields(kind)}:
                return object.__new__(kind)
        return object.__new__(cls)

    def __post_init__(self):
        if not isinstance(self.links, Indices):
            object.__setattr__(self, "links", _checked_chains(self.links))
        super().__post_init__()

    def rules_at(self, nodes: Float[ArrayLike, "n_node 3"]) -> list[Rule]:
        """Return the condition that no two successive nodes of a cable coincide, at `nodes`, m."""
        links = index_array(self.links)

        def same(ends, links):
            return (ends[:, 1:] == ends[:, :-1]).all(axis=2) & (links[:, 1:] != links[:, :-1])

        def text(index, _, links):
            k, piece = index
            pair = links[k, piece : piece + 2].tolist()
            return f"links[{k}]: its nodes {pair} coincide; a piece has no length"

        return [Rule("nodes", (nodes[links], links), same, text)]

    def chord(self, ends: Float[Array, "n_elem n_end 3"]) -> Float[Array, " n_elem"]:
        """Return the initial length of every cable over all of its nodes, [n_elem], m."""
        return jnp.sum(_segments_with_lengths(ends)[1], axis=-1)

    def split_among_ends(
        self, amount: Float[Array, " n_elem"], ends: Float[Array, "n_elem n_end 3"]
    ) -> Float[Array, "n_elem n_end"]:
        """Split each `amount` among the nodes of a cable, by half the lengths of its pieces."""
        length = _segments_with_lengths(ends)[1]
        share = 0.5 * (jnp.pad(length, ((0, 0), (0, 1))) + jnp.pad(length, ((0, 0), (1, 0))))
        return amount[:, None] * share / jnp.sum(length, axis=-1, keepdims=True)

    def strain(self, state: AxialState, ends: Ends, motion: Motion) -> Scalar:
        """Return the strain of one cable: its elongation over its unstressed length."""
        return (state.elongation + self.length_change(ends, motion)) / state.rest_length

    def length_change(self, ends: Ends, motion: Motion) -> Scalar:
        """Return the change of the length of one cable over all nodes, m."""
        return jnp.sum(segment_length_changes(ends, motion)[0])

    def end_forces(self, state: AxialState, ends: Ends, motion: Motion) -> Forces:
        """Return the internal force of one cable at every node, sliding load included, N."""
        piece, length = moved_segments_with_lengths(ends, motion)
        unit = piece / jnp.where(length > 0, length, 1.0)[:, None]
        force = forces_of_segments(self.tension(state, ends, motion) * unit)
        return (
            force
            if state.line_load is None
            else force - self.sliding_load_forces(state, ends, motion)
        )

    def sliding_load_forces(self, state: AxialState, ends: Ends, motion: Motion) -> Forces:
        """Return nodal forces of the sliding load of one cable minus its initial shares, N."""
        return -jax.grad(self._sliding_potential, argnums=2)(state, ends, motion)

    def _sliding_potential(self, state, ends, motion):
        """Return the potential of the sliding load of one cable minus that of its shares, J.

        The shares are those of the nodes in the initial position. A constant is left out; because
        the shares add up to one, positions can be relative to the first node.
        """
        piece, length = moved_segments_with_lengths(ends, motion)
        middle = jnp.cumsum(piece, axis=0) - 0.5 * piece
        now = motion[0] + length @ middle / jnp.sum(length)
        share = self.split_among_ends(jnp.ones((1,), length.dtype), ends[None])[0]
        return state.rest_length * state.line_load @ (share @ motion - now)

    def has_tension_unknown(self, state: AxialState) -> bool:
        """Return whether the tension can be an unknown of the equations: no load slides along."""
        return state.line_load is None

    def energy(self, state: AxialState, ends: Ends, motion: Motion) -> Scalar:
        """Return stored energy, with a jack its work, plus potential of the sliding load, J."""

        def stored():
            strain = self.strain(state, ends, motion)
            return state.rest_length * self.energy_per_length(strain, state.memory)

        work = (
            None
            if state.jack_force is None
            else state.jack_force * self.length_change(ends, motion)
        )
        energy = jack_value_or(state, work, stored)
        return (
            energy
            if state.line_load is None
            else energy + self._sliding_potential(state, ends, motion)
        )

    def rounding_error(self, state: AxialState, ends: Ends, motion: Motion) -> Forces:
        """Return the error of the end forces from the rounding of displacements, [n_end, 3], N."""
        piece, length = moved_segments_with_lengths(ends, motion)
        unit = jnp.abs(piece) / jnp.where(length > 0, length, 1.0)[:, None]
        _, stiffness = self.tension_and_stiffness(state, ends, motion)
        moved = jnp.max(jnp.abs(motion)) * len(piece)
        pull = 8 * jnp.finfo(length.dtype).eps * moved * stiffness * unit
        return forces_of_segments(pull, 1.0)

    def state_at_activation(self, state: AxialState, ends: Ends, motion: Motion) -> AxialState:
        """Return the state of one cable activated here: unstressed, or with its `rest_length`."""
        start, length = (
            jnp.sum(of[1])
            for of in (_segments_with_lengths(ends), moved_segments_with_lengths(ends, motion))
        )
        return self._state_activated_at_length(
            state, length, self.length_change(ends, motion), start
        )

    def lock_off(self, state: AxialState, ends: Ends, motion: Motion) -> AxialState:
        """Return the state after lock-off: its new unstressed length gives the jack force here."""
        return self.locked_off_state(
            state,
            jnp.sum(moved_segments_with_lengths(ends, motion)[1]),
            self.length_change(ends, motion),
        )


def _segments_with_lengths(places):
    """Return the vectors from each of `places` [..., n, 3], m, to the next one, and their lengths.

    The shapes are [..., n - 1, 3] and [..., n - 1].
    """
    return _vectors_with_lengths(_successive_differences(places))


def moved_segments_with_lengths(ends, motion):
    """Return the vectors between successive nodes after a motion, [n - 1, 3], and their lengths, m.

    Positions and displacements are subtracted separately, so that positions far from the origin
    cost no digits.
    """
    return _vectors_with_lengths(_successive_differences(ends) + _successive_differences(motion))


def forces_of_segments(pull: Float[Array, "n 3"], sign: float = -1.0) -> Forces:
    """Return the forces at the nodes of one cable from the vectors of its tensions, [n_end, 3], N.

    A vector is added at the end of its segment, and at the start multiplied by `sign`.
    """
    return jnp.pad(pull, ((1, 0), (0, 0))) + sign * jnp.pad(pull, ((0, 1), (0, 0)))


def _successive_differences(places):
    """Return each of the positions [..., n, 3] minus the one before, [..., n - 1, 3]."""
    return places[..., 1:, :] - places[..., :-1, :]


def _vectors_with_lengths(piece):
    """Return vectors [..., 3], m, and their lengths [...], m; a zero length has derivative zero."""
    square = jnp.sum(piece**2, axis=-1)
    # padding with the last node makes pieces of length zero, whose derivative must be finite
    length = jnp.where(square > 0, jnp.sqrt(jnp.where(square > 0, square, 1.0)), 0.0)
    return piece, length


def segment_length_changes(
    ends: Ends, motion: Motion
) -> tuple[Float[Array, " n_segment"], Float[Array, " n_segment"], Float[Array, " n_segment"]]:
    """Return the changes of the lengths of all segments of a cable, m, and both lengths.

    The changes are computed without subtracting lengths, so that they keep their digits.
    """
    start, before = _segments_with_lengths(ends)
    w = _successive_differences(motion)
    after = moved_segments_with_lengths(ends, motion)[1]
    both = before + after
    change = jnp.sum((2 * start + w) * w, axis=-1) / jnp.where(both > 0, both, 1.0)
    return change, before, after


def _checked_chains(chains):
    """Return chains of nodes as `Indices`, padded with their last nodes; ValueError if wrong."""
    if not isinstance(chains, list | tuple | np.ndarray):
        raise ValueError(f"links: expected a list of chains, got {type(chains).__name__}")
    chains = [
        np.atleast_1d(checks.as_indices(chain, f"links[{k}]")) for k, chain in enumerate(chains)
    ]
    if not chains:
        raise ValueError("links: a group needs at least one element")
    for k, chain in enumerate(chains):
        if len(chain) < 2:
            text = "a cable has at least two nodes; give a list of chains, [[0, 1, 2]] for one"
            raise ValueError(f"links[{k}] = {chain.tolist()}: {text}")
        same = chain[1:] == chain[:-1]
        # repetitions of the last node are padding from an earlier call
        same[len(same) - int(np.cumprod(same[::-1]).sum()) :] = False
        if same.any() or (chain == chain[0]).all():
            j = int(same.argmax())
            raise ValueError(f"links[{k}] = {chain.tolist()}: node {chain[j]} twice in succession")
    width = max(len(chain) for chain in chains)
    return Indices(
        np.array([np.pad(chain, (0, width - len(chain)), mode="edge") for chain in chains])
    )
