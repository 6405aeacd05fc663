"""Straight two-node bar: tension and compression, any displacement and rotation.

Strain ``e = (l - L0) / L0``, force ``N = A s(e)``, end forces ``-+N (xj - xi) / l``.
Lengths are never subtracted: with the initial chord ``d`` of length ``l_s``, its elongation
``delta = l_s - L0`` and the relative end displacement ``w``,

    l - l_s = (2 d.w + w.w) / (l + l_s),      e = (delta + (l - l_s)) / L0,

so a prestress of 1e-8 of the axial stiffness keeps its digits (``l - L0`` would lose eight).
"""

import jax
import jax.numpy as jnp
import numpy as np

from .. import _check
from .._tree import Indices, copy, pytree

_PROPERTIES = (
    "axial_stiffness",
    "area",
    "rest_length",
    "weight",
    "expansion",
    "strength",
    "compliance",
)


@pytree
class AxialState:
    """Prestress of a group of bars or cables; what the phases change.

    Attributes:
        rest_length: unstressed length L0, [n_elem], m.
        elongation: initial chord minus unstressed length, carried by itself, [n_elem], m.
        held: force held by a jack during a phase, [n_elem], N, or None.
        weighing: unstressed length that has weight, [n_elem], m, or None if the group has none;
            it is `rest_length` but for what a jack has taken in.
    """

    rest_length: object
    elongation: object
    held: object = None
    weighing: object = None


@pytree(indices=("links",))
class Bars:
    """A group of straight two-node bars (struts, ties): tension and compression.

    Args:
        links: node numbers, [n_elem, 2].
        axial_stiffness: EA, scalar or [n_elem], N; or instead of it
        area, law: cross-section, scalar or [n_elem], m2, and a uniaxial law such as `Elastic`.
        rest_length: unstressed length before any phase, scalar or [n_elem], m; default the
            initial chord.
        weight: self-weight per unstressed length, scalar or [n_elem], N/m; acts where a phase
            has `SelfWeight`.
        expansion: thermal expansion coefficient, scalar or [n_elem], 1/K.
        strength: breaking force, scalar or [n_elem], N; kept with the group for reports.
        compliance: strain per force of a spring in series, scalar or [n_elem], 1/N (soft end
            fittings); the equilibrium iteration softens a net for a while by it.

    Raises:
        ValueError: wrong shapes, equal ends, repeated links, non-positive stiffness or length,
            both or neither of `axial_stiffness` and `area`.
    """

    links: object
    axial_stiffness: object = None
    area: object = None
    law: object = None
    rest_length: object = None
    weight: object = None
    expansion: object = None
    strength: object = None
    compliance: object = None

    tension_only = False

    def __post_init__(self):
        links = self.links if isinstance(self.links, Indices) else _links(self.links)
        object.__setattr__(self, "links", links)
        for name in _PROPERTIES:
            value = _check.per_element(getattr(self, name), len(links), name)
            object.__setattr__(self, name, value)
        if self.axial_stiffness is not None and (self.area is not None or self.law is not None):
            raise ValueError(
                "axial_stiffness, area: give either axial_stiffness or area with law, not both"
            )
        if self.axial_stiffness is None and (self.area is None or self.law is None):
            raise ValueError("axial_stiffness: missing; give axial_stiffness, or area with law")
        for name in ("axial_stiffness", "area", "rest_length", "strength"):
            if getattr(self, name) is not None:
                _check.require(getattr(self, name), lambda v: v > 0, name, "must be positive")
        for name in ("weight", "compliance"):
            if getattr(self, name) is not None:
                _check.require(getattr(self, name), lambda v: v >= 0, name, "must not be negative")

    def properties(self):
        """The arrays with one value per element, by name."""
        values = {name: getattr(self, name) for name in _PROPERTIES}
        return {name: value for name, value in values.items() if value is not None}

    # --- the section: force from strain, energy from strain, strain from force

    def force(self, strain):
        """Axial force, N, at `strain`."""
        stiffness, law = self._section()
        return stiffness * strain if law is None else self.area * law.stress(strain)

    def energy_per_length(self, strain):
        """Stored energy per unstressed length, J/m."""
        stiffness, law = self._section()
        return 0.5 * stiffness * strain**2 if law is None else self.area * law.energy(strain)

    def strain_at(self, force):
        """Strain at an axial force, N."""
        stiffness, law = self._section()
        return force / stiffness if law is None else law.strain(force / self.area)

    def _section(self):
        """Axial stiffness or law, with the series compliance in it."""
        if self.compliance is None:
            return self.axial_stiffness, self.law
        if self.law is None:
            return self.axial_stiffness / (1 + self.compliance * self.axial_stiffness), None
        return None, self.law.softened(self.compliance * self.area)

    def softened(self, compliance):
        """The group with a spring of `compliance`, scalar, 1/N, added to every element."""
        own = 0.0 if self.compliance is None else self.compliance
        return copy(self, compliance=own + jnp.broadcast_to(compliance, len(self.links)))

    # --- the group

    def start(self, ends):
        """State before the first phase: the group's unstressed length, or the chord itself."""
        chord = jnp.linalg.norm(ends[:, 1] - ends[:, 0], axis=-1)
        if self.rest_length is None:
            rest_length, elongation = chord, jnp.zeros_like(chord)
        else:
            rest_length, elongation = self.rest_length, chord - self.rest_length
        weighing = None if self.weight is None else rest_length
        return AxialState(rest_length, elongation, weighing=weighing)

    def weight_at_ends(self, state):
        """Half of each element's self-weight for each of its ends, [n_elem, 2], N."""
        return jnp.repeat((0.5 * self.weight * state.weighing)[:, None], 2, axis=1)

    # --- one element

    def strain(self, state, ends, motion):
        """Engineering strain on the unstressed length."""
        _, _, change, _ = stretch(ends, motion)
        return (state.elongation + change) / state.rest_length

    def tension(self, state, ends, motion):
        """Axial force, N, tension positive."""
        if state.held is not None:
            return state.held
        return self.force(self.strain(state, ends, motion))

    def end_forces(self, state, ends, motion):
        """Internal force at both ends, [2, 3], N."""
        vector, length, _, _ = stretch(ends, motion)
        pull = self.tension(state, ends, motion) * vector / length
        return jnp.stack([-pull, pull])

    def energy(self, state, ends, motion):
        """Stored energy, J; of a held force its work on the change of length."""
        if state.held is not None:
            return state.held * stretch(ends, motion)[2]
        return state.rest_length * self.energy_per_length(self.strain(state, ends, motion))

    def is_slack(self, state, ends, motion):
        """A bar holds in compression too: never slack."""
        return jnp.zeros((), bool)

    def secant(self, state, ends, before, motion):
        """Symmetric secant stiffness, [2, 3, 2, 3]: K (u - u0) = f(u) - f(u0) exactly.

        Between the chord ``d`` at u0 (length l_0, force density q_0) and ``d + w`` at u (l, q),
        with m = 2 d + w and m.w = l^2 - l_0^2, the difference q (d + w) - q_0 d equals
        [(q + q_0)/2 I + c/2 m m^T] w. The factor c = (q - q_0)/(m.w) is expanded so that nothing
        cancels: c = (E_sec / L0 - q_0) / (l (l + l_0)) with E_sec the secant of the force-strain
        curve between the two states.
        """
        start, length = stretch(ends, before)[1], stretch(ends, motion)[1]
        then, now = self.strain(state, ends, before), self.strain(state, ends, motion)
        if state.held is None:
            force_then, tangent = jax.jvp(self.force, (then,), (jnp.ones_like(then),))
            force_now = self.force(now)
            apart = jnp.abs(now - then) > jnp.sqrt(jnp.finfo(now.dtype).eps) * jnp.abs(then)
            modulus = jnp.where(
                apart, (force_now - force_then) / jnp.where(apart, now - then, 1.0), tangent
            )
        else:
            force_then = force_now = state.held
            modulus = jnp.zeros_like(now)
        q_then, q_now = force_then / start, force_now / length
        c = (modulus / state.rest_length - q_then) / (length * (length + start))
        m = 2 * (ends[1] - ends[0]) + (before[1] - before[0]) + (motion[1] - motion[0])
        block = 0.5 * (q_then + q_now) * jnp.eye(3, dtype=m.dtype) + 0.5 * c * jnp.outer(m, m)
        return jnp.stack([jnp.stack([block, -block], 1), jnp.stack([-block, block], 1)])

    # --- prestress

    def restate(self, state, chord, inputs):
        """State after the prestress statements of a phase, for a whole group.

        `chord` is the initial length [n_elem]; `inputs` maps the names of `Phase` to [n_elem].
        Absolute statements come first, then the increments (shortening, temperature).
        """
        strain = None
        if "pretension" in inputs:
            strain = self.strain_at(inputs["pretension"])
        elif "force_density" in inputs:
            strain = self.strain_at(inputs["force_density"] * chord)
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
        return AxialState(rest_length, elongation, weighing=weighing)

    def lock(self, state, ends, motion):
        """State of an anchored jack: the unstressed length that gives the held force here."""
        _, length, change, _ = stretch(ends, motion)
        strain = self.strain_at(state.held)
        rest_length = length / (1 + strain)
        return AxialState(rest_length, rest_length * strain - change, weighing=state.weighing)


def stretch(ends, motion):
    """Current vector, current length, change of length (without subtraction), initial length."""
    chord, w = ends[1] - ends[0], motion[1] - motion[0]
    vector = chord + w
    start, length = jnp.sqrt(chord @ chord), jnp.sqrt(vector @ vector)
    return vector, length, (2 * chord + w) @ w / (length + start), start


def element(group, properties):
    """The group reduced to one element, inside vmap over `properties`."""
    return copy(group, links=None, **properties)


def _links(links):
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
