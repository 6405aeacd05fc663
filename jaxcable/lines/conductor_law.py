"""Tension of a conductor from its strain: first loading, permanent set, creep, slack layers.

Each layer of a `Conductor` has the strain ``e = strain - expansion (t - temperature)``, from its
length without stress at the temperature of its curves. It follows its curve of first loading, or of
ten years of creep, and unloads by its final modulus to the permanent strain ``p``::

    stress = min(curve(e), modulus (e - p))

Layers around a core carry no compression: aluminum goes slack at heat, and steel alone carries.
(The strain-sum method with experimental plastic elongation; Cigre brochure 324, 2007.)
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from ..catalogue.conductors import Conductor, Layer
from ..common.types import Array, ArrayLike, Bool, Float

NO_SET = -1.0
"""Permanent strain of a layer that has never been loaded: far below all strains."""

_BISECTIONS = 60
_WIDEST = 0.05  # strain, beyond which no conductor is sought


def _curve_stress(coefficients, strain, limit):
    """Return the polynomial of a curve at a strain, Pa; beyond `limit` its tangent there."""
    inside = jnp.minimum(strain, limit)
    value = jnp.polyval(coefficients[::-1], inside)
    slope = jnp.polyval(jnp.polyder(coefficients[::-1]), jnp.asarray(limit))
    return value + slope * (strain - inside)


def _layer_stress(layer: Layer, strain, permanent, creeps):
    """Return the stress of one layer at its strain, Pa; `permanent` is its permanent strain."""
    coefficients = jnp.asarray(layer.initial)
    if layer.creep is not None:
        both = [jnp.asarray(x) for x in (layer.creep, layer.initial)]
        size = max(map(len, both))
        creep, initial = (jnp.pad(x, (0, size - len(x))) for x in both)
        coefficients = jnp.where(creeps, creep, initial)
    first = _curve_stress(coefficients, strain, layer.limit)
    return jnp.minimum(first, layer.modulus * (strain - permanent))


class ConductorLaw(NamedTuple):
    """The law of a conductor at one temperature, in one span or in spans, [...].

    Strains of the conductor are from its length without stress at the temperature of its curves.

    Attributes:
        conductor: `Conductor`.
        temperature: degrees C.
        permanent: permanent strains of the layers, [..., n_layer]; `NO_SET` for none.
        creeps: whether layers follow their curves of creep in place of those of first loading.
    """

    conductor: Conductor
    temperature: Float[ArrayLike, ""]
    permanent: Float[Array, "... n_layer"]
    creeps: bool | Bool[Array, ""] = False

    def layer_stresses(
        self, strain: Float[Array, " ..."]
    ) -> tuple[list[Float[Array, " ..."]], list[Float[Array, " ..."]]]:
        """Return the stresses of the layers, Pa over the whole area, and their own strains."""
        layers = self.conductor.layers
        warmer = self.temperature - self.conductor.temperature
        own = [strain - layer.expansion * warmer for layer in layers]
        stresses = [
            _layer_stress(layer, own[k], self.permanent[..., k], self.creeps)
            for k, layer in enumerate(layers)
        ]
        return [*(jnp.maximum(stress, 0.0) for stress in stresses[:-1]), stresses[-1]], own

    def tension(self, strain: Float[Array, " ..."]) -> Float[Array, " ..."]:
        """Return the tension at a strain, N."""
        return self.conductor.area * sum(self.layer_stresses(strain)[0])

    def tangent(
        self, strain: Float[Array, " ..."], ahead: Float[ArrayLike, ""] = 0.0
    ) -> tuple[Float[Array, " ..."], Float[Array, " ..."]]:
        """Return the tangent of the law at a strain: strain without tension, and EA, N.

        The tension beside `strain` is ``EA (strain - strain without tension)``. The strain counts
        as constant: at an equilibrium with this tension derivatives by all else are those of the
        law. The slope is that at the strain ``strain + ahead``: of the branch beyond a corner that
        is near.
        """
        strain = lax.stop_gradient(strain)
        _, stiffness = jax.jvp(self.tension, (strain + ahead,), (jnp.ones_like(strain),))
        return strain - self.tension(strain) / stiffness, stiffness

    def strain(self, tension: Float[ArrayLike, ""]) -> Float[Array, " ..."]:
        """Return the strain at a tension, N, by bisection; differentiable as the law is."""

        def halve(_, bracket):
            low, high = bracket
            middle = 0.5 * (low + high)
            below = self.tension(middle) < tension
            return jnp.where(below, middle, low), jnp.where(below, high, middle)

        widest = jnp.full(jnp.shape(self.permanent)[:-1], _WIDEST, jnp.result_type(tension))
        bracket = lax.fori_loop(0, _BISECTIONS, halve, (-widest, widest))
        low, high = lax.stop_gradient(bracket)
        free, stiffness = self.tangent(0.5 * (low + high))
        return free + tension / stiffness

    def permanent_after(self, strain: Float[Array, " ..."]) -> Float[Array, "... n_layer"]:
        """Return the permanent strains that a state leaves, at least those from before."""
        both = zip(*self.layer_stresses(strain), self.conductor.layers, strict=True)
        left = jnp.stack([own - stress / layer.modulus for stress, own, layer in both], axis=-1)
        return jnp.maximum(left, self.permanent)


def mean_tension(pulls: Float[Array, "n_span 2 3"]) -> Float[Array, " n_span"]:
    """Return the mean tensions along the unstressed lengths of catenaries, [n_span], N.

    Across the load the tension is constant, H, and along it u changes evenly from end to end, so
    that it is the mean of ``sqrt(H^2 + u^2)``. `pulls` are the forces on the nodes at both ends, N.
    """
    load = jnp.sum(pulls, axis=1, keepdims=True)
    whole = jnp.sqrt(jnp.sum(load**2, axis=-1))
    along = jnp.sum(pulls * load, axis=-1) / whole
    across2 = jnp.sum(pulls[:, 0] ** 2, axis=-1) - along[:, 0] ** 2
    level = jnp.sqrt(across2)[:, None]
    area = 0.5 * (along * jnp.hypot(level, along) + level**2 * jnp.arcsinh(along / level))
    return jnp.sum(area, axis=1) / whole[:, 0]
