"""What every element with an axis shares: its prestress, its weight, and how phases change them."""

import jax.numpy as jnp
import numpy as np

from .. import _check
from .._tree import Indices, copy, pytree


@pytree
class AxialState:
    """What the phases change in a group of bars, cables or beams.

    Attributes:
        rest_length: unstressed length L0, [n_elem], m.
        elongation: initial chord minus unstressed length, carried by itself, [n_elem], m.
        held: force held by a jack during a phase, [n_elem], N, or None.
        weighing: unstressed length that has weight, [n_elem], m, or None if the group has none;
            it is `rest_length` but for what a jack has taken in.
        plastic: plastic strains that the law remembers, leading axis [n_elem], or None.
        line_load: dead load per unstressed length, [n_elem, 3], N/m, of elements that bend under
            it, or None.
    """

    rest_length: object
    elongation: object
    held: object = None
    weighing: object = None
    plastic: object = None
    line_load: object = None


class Prestressed:
    """Members of a group (see `elements`) that only need its unstressed length.

    The group has `links`, `rest_length`, `weight`, `expansion`, and gives `strain_at(force,
    plastic)` and `virgin()`, the plastic strains of all its unused elements or None.
    """

    def start(self, ends):
        """State before the first phase: the group's unstressed length, or the chord itself."""
        chord = jnp.linalg.norm(ends[:, 1] - ends[:, 0], axis=-1)
        if self.rest_length is None:
            rest_length, elongation = chord, jnp.zeros_like(chord)
        else:
            rest_length, elongation = self.rest_length, chord - self.rest_length
        weighing = None if self.weight is None else rest_length
        return AxialState(rest_length, elongation, weighing=weighing, plastic=self.virgin())

    def weight_at_ends(self, state):
        """Half of each element's self-weight for each of its ends, [n_elem, 2], N."""
        return jnp.repeat((0.5 * self.weight * state.weighing)[:, None], 2, axis=1)

    def restate(self, state, chord, inputs):
        """State after the prestress statements of a phase, for a whole group.

        `chord` is the initial length [n_elem]; `inputs` maps the names of `Phase` to [n_elem].
        Absolute statements come first, then the increments (shortening, temperature).
        """
        strain = None
        if "pretension" in inputs:
            strain = self.strain_at(inputs["pretension"], state.plastic)
        elif "force_density" in inputs:
            strain = self.strain_at(inputs["force_density"] * chord, state.plastic)
        elif "prestrain" in inputs:
            strain = inputs["prestrain"]
        if strain is not None:
            rest_length, elongation = chord / (1 + strain), chord * (strain / (1 + strain))
        elif "rest_length" in inputs:
            rest_length = inputs["rest_length"]
            elongation = chord - rest_length
        else:
            rest_length, elongation = state.rest_length, state.elongation
        if "shortening" in inputs:
            rest_length = rest_length - inputs["shortening"]
            elongation = elongation + inputs["shortening"]
        if "temperature" in inputs:
            change = rest_length * self.expansion * inputs["temperature"]
            rest_length, elongation = rest_length + change, elongation - change
        weighing = state.weighing
        if weighing is not None:
            absolute = set(inputs) - {"shortening", "temperature"}
            change = rest_length - state.rest_length
            weighing = rest_length if absolute else weighing + change
        return copy(state, rest_length=rest_length, elongation=elongation, weighing=weighing)


def stretch(ends, motion):
    """Current vector, current length, change of length (without subtraction), initial length."""
    chord, w = ends[1] - ends[0], motion[1] - motion[0]
    vector = chord + w
    start, length = jnp.sqrt(chord @ chord), jnp.sqrt(vector @ vector)
    return vector, length, (2 * chord + w) @ w / (length + start), start


def element(group, properties):
    """The group reduced to one element, inside vmap over `properties`."""
    return copy(group, links=None, **properties)


def checked_links(links):
    """Links [n_elem, 2] as `Indices`; ValueError for equal ends and repeated links."""
    if isinstance(links, Indices):
        return links
    links = _check.integers(links, "links", width=2)
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
