"""State of elements with an unstressed length: prestress, temperature, weight."""

from __future__ import annotations

import abc
from collections.abc import Callable, Mapping
from typing import Any, Self

import jax
import jax.numpy as jnp
import numpy as np

from ..common import checks
from ..common.tree import Indices, copy_with, pytree
from ..common.types import Array, ArrayLike, Bool, Float, Int, PyTree
from ..numerics.vectors import scalar_product
from .abilities import PHASE_INPUTS, Prestressable
from .element import Ends, Motion, Scalar
from .element_state import ElementLoad, ElementState
from .phase_input import InputValues


@pytree
class AxialState(ElementState):
    """State of a group of bars, cables or beams: lengths, jacks, temperature, history, loads.

    Attributes:
        rest_length: unstressed length L0, [n_elem], m.
        elongation: initial chord minus unstressed length, [n_elem], m; stored, because their
            difference would lose digits.
        jack_force: force that a jack prescribes during a phase, [n_elem], N, or None.
        jacked: which elements have a jack, [n_elem] bool; None: all of them, or no `jack_force`.
        loaded_length: unstressed length on which weight and loads per unstressed length act,
            [n_elem], m: at the reference temperature, because heat adds no mass, and, in the phase
            of a jack, before it pulls. None: `rest_length`.
        thermal_stretch: unstressed length over that at the reference temperature, [n_elem], ``1 +
            expansion sum(dt)`` over the changes of temperature since then; None in a group without
            thermal expansion. The reference temperature is that before the first phase, or that at
            which an element was added.
        memory: history variables of the law, such as plastic strains, axis [n_elem], or None.
        element_load: loads along elements that shape them (bending, sag, sliding), or None.
        present: which elements are active, [n_elem] bool; None if all are, in all phases.
        kinks: for beams that are activated between rotated nodes, the rotations of the ends against
            the chord at which they are unstressed, [n_elem, 2, 3], rad; else None.

    Example:
        A cable of 4.98 m between ends that are 5 m apart, before its first phase:

        >>> cable = jc.Cables([[0, 1]], axial_stiffness=1e5, rest_length=4.98)
        >>> state = cable.start(jnp.array([[[0.0, 0.0, 0.0], [3.0, 4.0, 0.0]]]))
        >>> print(state.rest_length, jnp.round(state.elongation, 6))
        [4.98] [0.02]
    """

    rest_length: Float[Array, " n_elem"] = None  # type: ignore[assignment]  # never None here
    elongation: Float[Array, " n_elem"] = None  # type: ignore[assignment]  # always given
    jack_force: Float[Array, " n_elem"] | None = None
    jacked: Bool[Array, " n_elem"] | None = None
    loaded_length: Float[Array, " n_elem"] | None = None
    thermal_stretch: Float[Array, " n_elem"] | None = None
    memory: PyTree[Float[Array, "n_elem ..."]] | None = None
    element_load: ElementLoad | None = None
    present: Bool[Array, " n_elem"] | None = None
    kinks: Float[Array, "n_elem 2 3"] | None = None

    def reset_load_bearing_length(self) -> Self:
        """Return the state at the start of a phase: weight and loads act on the unstressed length.

        In the phase of a jack they act on the length before, and from then on on that which it has
        left, however the force was stated.
        """
        stretch = 1.0 if self.thermal_stretch is None else self.thermal_stretch
        return copy_with(self, loaded_length=self.rest_length / stretch)

    @property
    def load_bearing_length(self) -> Float[Array, " n_elem"]:
        """Length that weight and loads act on, [n_elem], m: `loaded_length`, or `rest_length`."""
        return self.rest_length if self.loaded_length is None else self.loaded_length


class Prestressed(Prestressable):
    """Base of bars, cables and beams: elements with an unstressed length that phases can change.

    The length is kept in their state, an `AxialState`. Inputs of a phase (`PHASE_INPUTS`, such as
    a pretension, a shortening or a temperature) are applied to it by `apply_phase_inputs`.
    Classes have the fields `rest_length`, `weight` and `expansion`, each of which may be None, and
    write `strain_at`.
    """

    has_length = True
    phase_inputs = tuple(PHASE_INPUTS)

    def weights(self, state: AxialState) -> Float[Array, " n_elem"] | None:
        """Return the weight of every element, [n_elem], N; None if the group has no weight."""
        if self.weight is None:
            return None
        return state.zero_where_absent(self.weight * state.load_bearing_length)

    @abc.abstractmethod
    def strain_at(
        self, force: Scalar, memory: PyTree[Float[Array, " ..."]] | None = None
    ) -> Scalar:
        """Return the strain at a force, N, with history variables or None; NaN if out of reach."""

    def interpolate_states(self, start: AxialState, end: AxialState, factor: Scalar) -> AxialState:
        """Return the state at a load factor; lengths are NaN where a shortening exceeds them."""
        mixed = super().interpolate_states(start, end, factor)
        length = jnp.where(mixed.rest_length > 0, mixed.rest_length, jnp.nan)
        return copy_with(mixed, rest_length=length)

    def start(self, ends: Float[Array, "n_elem n_end 3"]) -> AxialState:
        """Return the state before the first phase; without `rest_length` it is unstressed."""
        chord = self.chord(ends)
        if self.rest_length is None:
            rest_length, elongation = chord, jnp.zeros_like(chord)
        else:
            rest_length, elongation = self.rest_length, chord - self.rest_length
        thermal_stretch = None if self.expansion is None else jnp.ones_like(rest_length)
        return AxialState(
            rest_length,
            elongation,
            loaded_length=rest_length,
            thermal_stretch=thermal_stretch,
            memory=self.initial_memory(),
        )

    def unstressed_state(
        self, ends: Float[Array, "n_elem n_end 3"], slack: Bool[Array, " n_elem"]
    ) -> AxialState:
        """Return a state without stress or prestress at the initial positions `ends`, m.

        Unstressed lengths are the initial chords. Elements that are `slack`, [n_elem] bool, have
        twice this length, so that they stay slack under small displacements.
        """
        chord = self.chord(ends)
        longer = jnp.where(slack, chord, 0.0)
        return copy_with(self.start(ends), rest_length=chord + longer, elongation=-longer)

    def state_at_activation(self, state: AxialState, ends: Ends, motion: Motion) -> AxialState:
        """Return the state of one element activated here: unstressed, or with its `rest_length`."""
        _, length, change, start = measure_chord(ends[:2], motion[:2, :3])
        return self._state_activated_at_length(state, length, change, start)

    def _state_activated_at_length(self, state, length, change, start):
        """Return the state of one element activated at a present `length`, m.

        `change` is by how much this exceeds the initial length `start`, m.
        """
        rest_length, elongation = length, -change
        if self.rest_length is not None:
            rest_length, elongation = self.rest_length, start - self.rest_length
        thermal_stretch = (
            None if state.thermal_stretch is None else jnp.ones_like(state.thermal_stretch)
        )
        return copy_with(
            state,
            rest_length=rest_length,
            elongation=elongation,
            loaded_length=rest_length,
            thermal_stretch=thermal_stretch,
        )

    def apply_phase_inputs(
        self,
        state: AxialState,
        ends: Float[Array, "n_elem n_end 3"],
        inputs: Mapping[str, InputValues],
    ) -> AxialState:
        """Return the state of the group after the prestress inputs of a phase have changed it.

        `ends` are the initial ends [n_elem, n_end, 3]; `inputs` are `InputValues` by name.
        Inputs of a tension, strain, length or sag come first, then shortening, then
        temperature. The first ones describe the element at its present temperature: they replace
        what was stated before, shortenings included, and keep the temperature. A shortening is
        measured at the present temperature, too. Changes of temperature add up: the unstressed
        length is ``L (1 + expansion sum(dt))``, with L at the reference temperature
        (`AxialState.thermal_stretch`).
        """
        chord = self.chord(ends)
        rest_length, elongation, loaded = (
            state.rest_length,
            state.elongation,
            state.load_bearing_length,
        )
        thermal_stretch: float | Float[Array, " n_elem"] = (
            1.0 if state.thermal_stretch is None else state.thermal_stretch
        )
        for name, stated in inputs.items():
            if name in ("shortening", "temperature"):
                continue
            if name == "rest_length":
                rest = stated.select(stated.values, chord)
                lengths = rest, chord - rest
            else:
                strain = self.required_chord_strain(name, stated, state, ends, chord)
                lengths = chord / (1 + strain), chord * (strain / (1 + strain))
            rest_length, elongation = map(stated.select, lengths, (rest_length, elongation))
            loaded = stated.select(rest_length / thermal_stretch, loaded)
        if "shortening" in inputs:
            change = inputs["shortening"].values
            rest_length, elongation = rest_length - change, elongation + change
            loaded = loaded - change / thermal_stretch
        if "temperature" in inputs:
            strain = self.expansion * inputs["temperature"].values
            change = rest_length / thermal_stretch * strain
            rest_length, elongation = rest_length + change, elongation - change
            thermal_stretch = thermal_stretch + strain
        return copy_with(
            state,
            rest_length=rest_length,
            elongation=elongation,
            loaded_length=loaded,
            thermal_stretch=None if state.thermal_stretch is None else thermal_stretch,
        )

    def required_chord_strain(
        self,
        name: str,
        stated: InputValues,
        state: AxialState,
        ends: Float[Array, "n_elem n_end 3"],
        chord: Float[Array, " n_elem"],
    ) -> Float[Array, " n_elem"]:
        """Return the strain of the initial chords that a prestress input requires, [n_elem].

        Args:
            name: "pretension", "force_density", "sag", or one whose values are strains already, as
                those of "prestrain" are; not a length, a temperature or a jack.
            stated: its values, and the elements that it concerns.
            state: state before the input: its history variables, and its thermal stretch.
            ends: initial positions of the ends, m.
            chord: their distances, m.
        """
        if name == "pretension":
            return call_each_element("strain_at", self, stated.values, state.memory)
        if name == "force_density":
            return call_each_element("strain_at", self, stated.values * chord, state.memory)
        if name == "sag":
            sag = stated.select(stated.values, 0.1 * chord)
            if stated.chosen is not None:  # others may be plumb: level spans have derivatives
                level = jnp.zeros_like(ends).at[:, 1, 0].set(chord)
                ends = jnp.where(jnp.asarray(stated.chosen)[:, None, None], ends, level)
            hung = self.strain_at_sag  # type: ignore[attr-defined]  # it is `Hanging`
            return hung(ends, sag, 1.0 if state.thermal_stretch is None else state.thermal_stretch)
        if name != "prestrain" and name in PHASE_INPUTS:
            raise AssertionError(f"{name} is no strain")
        return stated.values


@jax.jit  # traced once, although a program calls it many times
def measure_chord(ends: Ends, motion: Motion) -> tuple[Float[Array, " 3"], Scalar, Scalar, Scalar]:
    """Return chord vector [3], its length, the change of length, and the initial length, all m.

    The change is computed without subtracting lengths, so that it keeps its digits.
    """
    chord, w = ends[1] - ends[0], motion[1] - motion[0]
    vector = chord + w
    start, length = jnp.sqrt(scalar_product(chord, chord)), jnp.sqrt(scalar_product(vector, vector))
    return vector, length, scalar_product(2 * chord + w, w) / (length + start), start


def jack_value_or(
    state: AxialState, force: Float[ArrayLike, " ..."], otherwise: Callable[[], Array]
) -> Array:
    """Return `force` if a jack prescribes the force of the element, or else ``otherwise()``."""
    if state.jack_force is None:
        return otherwise()
    return force if state.jacked is None else jnp.where(state.jacked, force, otherwise())


def single_element(group: Any, properties: Mapping[str, PyTree[Array]]) -> Any:
    """Return the group with the `properties` of one element, which it then stands for in vmap."""
    return copy_with(group, links=None, **properties)


def call_each_element(
    method: str, group: Any, *arguments: PyTree[Array], **shared: Any
) -> PyTree[Array]:
    """Call a method, by name, of every element of a group by vmap; return results [n_elem, ...].

    `arguments` have a leading axis [n_elem]; `shared` ones are the same for all elements.
    """

    def one(properties, *values):
        return getattr(single_element(group, properties), method)(*values, **shared)

    return jax.vmap(one, axis_size=len(group.links))(group.properties(), *arguments)


def checked_links(links: Int[ArrayLike, "n_elem 2"]) -> Indices:
    """Return links as `Indices`; ValueError for equal ends, or links that occur twice."""
    if isinstance(links, Indices):
        return links
    links = checks.as_indices(links, "links", width=2)
    if len(links) == 0:
        raise ValueError("links: a group needs at least one element")
    same = links[:, 0] == links[:, 1]
    if same.any():
        k = int(same.argmax())
        raise ValueError(f"links[{k}] = {links[k].tolist()}: the two ends must differ")
    _, first, inverse = np.unique(
        np.sort(links, axis=1), axis=0, return_index=True, return_inverse=True
    )
    inverse = inverse.ravel()
    repeated = first[inverse] != np.arange(len(links))
    if repeated.any():
        k = int(repeated.argmax())
        raise ValueError(
            f"links[{k}] = {links[k].tolist()}: repeats links[{int(first[inverse[k]])}]; "
            "add their stiffnesses instead"
        )
    return Indices(links)
