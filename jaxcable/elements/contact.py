"""Contact: a bar that carries compression only, with a gap between its ends if it has one.

At exactly zero strain the tangent is that of the closed contact, as that of a cable is the taut
one. Hence ``where(e > 0, 0, ...)``, which also passes a NaN on instead of calling the contact open.
"""

from __future__ import annotations

from typing import ClassVar

import jax.numpy as jnp

from ..common.rules import Rule
from ..common.tree import copy_with, pytree
from ..common.types import Array, ArrayLike, Bool, Float
from ..materials.law import Law
from .bar import TwoNodeStraight
from .element import SECTION_STRAIN, TENSION, Ends, Motion, Result, Scalar
from .prestress import AxialState, jack_value_or
from .straight import Straight

OPENING = Result("opening", "m")
"""Distance by which a contact or bearing is open, m; negative: it is compressed by so much."""


class CompressionOnly(Straight):
    """Straight elements that open: the force is zero where it would be a tension."""

    results: ClassVar[tuple[Result, ...]] = (TENSION, SECTION_STRAIN, OPENING)
    compression_only = True

    def opening(self, state: AxialState, ends: Ends, motion: Motion) -> Scalar:
        """Return the distance of the ends minus the unstressed length, m; negative: compressed."""
        return self.strain(state, ends, motion) * state.rest_length

    def force(self, strain: Scalar, memory: Float[Array, " n_memory"] | None = None) -> Scalar:
        """Return the axial force at a strain, N, not positive; zero in an open contact."""
        return jnp.where(self._is_open_at(strain, memory), 0.0, super().force(strain, memory))

    def energy_per_length(
        self, strain: Scalar, memory: Float[Array, " n_memory"] | None = None
    ) -> Scalar:
        """Return the stored energy per unstressed length, J/m; zero if open and without `memory`.

        With history variables, parts of a law that have yielded still pull and push each other in
        an open contact, and this energy remains.
        """
        return super().energy_per_length(self._strain_up_to_opening(strain, memory), memory)

    def fibre_stress(
        self, strain: Scalar, memory: Float[Array, " n_memory"] | None = None
    ) -> Float[Array, " n_fibre"] | Scalar:
        """Return the stress of every fibre, Pa; in an open contact those at which it has opened.

        They are zero unless the section has several laws and some have yielded. A contact with one
        law in place of a section has one stress, a scalar.
        """
        return super().fibre_stress(self._strain_up_to_opening(strain, memory), memory)

    def absolute_force(self, state: AxialState, ends: Ends, motion: Motion) -> Scalar:
        """Return the sum of absolute forces of the law's parts, N; zero in an open contact."""
        is_open = self.is_slack(state, ends, motion)
        return jnp.where(is_open, 0.0, super().absolute_force(state, ends, motion))

    def commit_memory(
        self, strain: Scalar, memory: Float[Array, " n_memory"], duration: float = 0.0
    ) -> Float[Array, " n_memory"]:
        """Return the history variables after an increment of a `duration`, s, ended at a strain.

        An open contact stays at the strain at which it has opened.
        """
        return super().commit_memory(self._strain_up_to_opening(strain, memory), memory, duration)

    def is_ruptured(self, strain: Scalar) -> Bool[Array, ""]:
        """Return whether a strain is beyond the rupture of the law in compression."""
        return super().is_ruptured(jnp.minimum(strain, 0.0))

    def is_slack(self, state: AxialState, ends: Ends, motion: Motion) -> Bool[Array, ""]:
        """Return whether one contact is open, and carries no force; False with a jack."""
        return jack_value_or(
            state,
            jnp.zeros((), bool),
            lambda: self._is_open_at(self.strain(state, ends, motion), state.memory),
        )

    def at_kink(self, state: AxialState, ends: Ends, motion: Motion) -> Bool[Array, ""]:
        """Return whether the strain of one contact is zero up to rounding: it opens or closes."""
        return self.is_unstressed(state, ends, motion)

    def unstressed_state(
        self, ends: Float[Array, "n_elem n_end 3"], slack: Bool[Array, " n_elem"]
    ) -> AxialState:
        """Return a state without stress: unstressed lengths are those of the initial chords.

        Elements that are `slack`, [n_elem] bool, have half of this length: they are open.
        """
        chord = self.chord(ends)
        gap = jnp.where(slack, 0.5 * chord, 0.0)
        return copy_with(self.start(ends), rest_length=chord - gap, elongation=gap)

    def _is_open_at(self, strain, memory):
        """Return whether a contact with history variables `memory` (or None) is open at a strain.

        Plastic strain has shortened it: the law says at which strain its force ends.
        """
        return strain > self._opening_strain(strain, memory)

    def _opening_strain(self, like, memory):
        """Return the strain above which the contact is open, in the shape of `like`.

        It is zero without history variables (`memory` is None).
        """
        if memory is None:
            return jnp.zeros_like(like)
        return self.strain_at(jnp.zeros_like(like), memory)

    def _strain_up_to_opening(self, strain, memory):
        """Return the strain, but not above that at which the contact opens: that of its material.

        `memory` has the history variables, or is None.
        """
        opening = self._opening_strain(strain, memory)
        return jnp.where(strain > opening, opening, strain)


@pytree(indices=("links",))
class Contacts(CompressionOnly, TwoNodeStraight):
    """A group of straight two-node contacts: as `Bars`, but in compression only, with a gap.

    ``N = min(EA e, 0)`` or ``N = min(A s(e), 0)`` with ``e = (l - L0) / L0``; at ``e = 0`` the
    tangent is that of the closed contact. A contact closes where the distance of its ends falls to
    its unstressed length L0 (a gap element), and opens above it; props, masonry and bearings that
    cannot be pulled are contacts without a gap. It presses along the line through its ends, which
    turns with them: nodes that it presses need something else that holds them sideways. For a
    bearing that presses along a fixed direction on one node see `GroundContacts`. (A gap that
    closes in tension, a hook, is one of `Cables` with a `rest_length` above the distance of its
    ends.)

    Reports count open contacts among the slack elements. The energy of compressed elements is not
    convex, so that a structure can have several equilibria; they are found as those of `Bars`.

    Args:
        links: node numbers, [n_elem, 2].
        axial_stiffness: EA, scalar or [n_elem], N.
        area: cross-section, scalar or [n_elem], m2; together with `law`.
        law: uniaxial law of all elements of the group, which must have a branch of compression; its
            tension is left out. Together with `area`.
        section: fibre section shared by the group, as in `Bars`; the contact opens where the sum of
            all fibres would be a tension.
        rest_length: unstressed length before any phase, scalar or [n_elem], m; default the
            initial chord. Not together with `gap`.
        weight: self-weight per unstressed length, scalar or [n_elem], N/m.
        expansion: thermal expansion coefficient, scalar or [n_elem], 1/K.
        strength: compressive strength of the element, scalar or [n_elem], N; for utilization in
            reports and design.
        compliance: strain per force of a spring in series with every element, scalar or [n_elem],
            1/N.
        gap: initial chord minus unstressed length, scalar or [n_elem], m: by so much the ends
            approach each other until the contact closes. Negative: compressed from the start. Of an
            element that a phase adds it is measured where its ends are then.

    Raises:
        ValueError: as for `Bars`; `gap` and `rest_length` together; a law without compression; a
            gap that is as long as the distance of the ends.

    Example:
        600 N press a bar of EA = 1e5 N onto a stop, 2 mm before its end, of the same stiffness. The
        bar takes 200 N until the gap has closed, then both share alike, ``200 + 400 / 2``:

        >>> nodes = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]]
        >>> stop = jc.Contacts([[1, 2]], axial_stiffness=1e5, gap=0.002)
        >>> elements = {"bar": jc.Bars([[0, 1]], axial_stiffness=1e5), "stop": stop}
        >>> held = jc.pinned([0, 2]) + jc.restrained([1], "yz")
        >>> structure = jc.Structure(nodes, elements, held)
        >>> push = jc.NodalLoads([1], (600.0, 0.0, 0.0))
        >>> solution = jc.solve(structure, jc.Phase(loads=push))
        >>> bar, stop = (float(solution.tension[name][0]) for name in ("bar", "stop"))
        >>> print(solution.status, f"{bar:.1f} {stop:.1f}")  # stop: EA / (1 m - 2 mm) is stiffer
        0 399.8 -200.2
    """

    gap: Float[ArrayLike, " n_elem"] | None = None

    per_element = (*Straight.per_element, "gap")  # type: ignore[assignment]  # one more

    def __post_init__(self):
        super().__post_init__()
        if self.gap is not None and self.rest_length is not None:
            raise ValueError("gap: give either gap or rest_length, not both")

    def rules(self) -> list[Rule]:
        """Return the conditions of `Bars`, and that the law has a branch of compression, a list."""
        rules = super().rules()
        if isinstance(self.law, Law):
            text = "the law has no branch of compression, so that the contact could not press"
            rules.append(Rule("law", self.law.capacity[0], lambda low: low >= 0, text))
        return rules

    def rules_at(self, nodes: Float[ArrayLike, "n_node 3"]) -> list[Rule]:
        """Return the condition that gaps are shorter than the distances of the ends, a list."""
        if self.gap is None:
            return []
        chord = self.chord(nodes[self.links])
        text = "must be less than the initial distance of the ends of the element"
        return [Rule("gap", (self.gap, chord), lambda gap, chord: gap >= chord, text)]

    def start(self, ends: Float[Array, "n_elem n_end 3"]) -> AxialState:
        """Return the state before the first phase; without gap or length it is unstressed."""
        state = super().start(ends)
        if self.gap is None:
            return state
        rest_length = state.rest_length - self.gap
        elongation = jnp.broadcast_to(jnp.asarray(self.gap, rest_length.dtype), rest_length.shape)
        return copy_with(
            state, rest_length=rest_length, elongation=elongation, loaded_length=rest_length
        )

    def _state_activated_at_length(self, state, length, change, start):
        """Return the state of one contact activated at a present `length`, m, with its gap there.

        `change` is by how much this exceeds the initial length `start`, m.
        """
        state = super()._state_activated_at_length(state, length, change, start)
        if self.gap is None:
            return state
        rest_length, elongation = length - self.gap, self.gap - change
        return copy_with(
            state, rest_length=rest_length, elongation=elongation, loaded_length=rest_length
        )
