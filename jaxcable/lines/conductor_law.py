"""Tension of a conductor from its strain: first loading, permanent set, creep, slack layers.

Each layer of a `Conductor` has the strain ``e = strain - expansion (t - temperature)``, from its
length without stress at the temperature of its curves. It follows its curve of first loading, or of
ten years of creep, and unloads by its final modulus to the permanent strain ``p``::

    stress = min(curve(e), modulus (e - p))

Layers around a core carry no compression: aluminum goes slack at heat, and steel alone carries.
(The strain-sum method with experimental plastic elongation; Cigre brochure 324, 2007.)
"""

from __future__ import annotations

from typing import TypeAlias

import jax
import jax.numpy as jnp
from jax import lax

from ..catalogue.conductors import Conductor, Layer
from ..common.types import Array, Bool, Float

Scalar: TypeAlias = 'Float[Array, ""]'

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
        size = max(len(layer.initial), len(layer.creep))
        creep, initial = (
            jnp.pad(jnp.asarray(x), (0, size - len(x))) for x in (layer.creep, layer.initial)
        )
        coefficients = jnp.where(creeps, creep, initial)
    first = _curve_stress(coefficients, strain, layer.limit)
    return jnp.minimum(first, layer.modulus * (strain - permanent))


def layer_stresses(
    conductor: Conductor,
    strain: Scalar,
    temperature: Scalar,
    permanent: Float[Array, " n_layer"],
    *,
    creeps: bool | Bool[Array, ""] = False,
) -> tuple[list[Scalar], list[Scalar]]:
    """Return the stresses of the layers, Pa over the whole area, and their own strains.

    Args:
        conductor: `Conductor`.
        strain: of the conductor, from its length without stress at the temperature of its curves.
        temperature: degrees C.
        permanent: permanent strains of the layers, [n_layer]; `NO_SET` for none.

    Options:
        creeps: whether layers follow their curves of creep in place of those of first loading.
    """
    warmer = temperature - conductor.temperature
    own = [strain - layer.expansion * warmer for layer in conductor.layers]
    stresses = [
        _layer_stress(layer, e, permanent[k], creeps)
        for k, (layer, e) in enumerate(zip(conductor.layers, own, strict=True))
    ]
    slack = [jnp.maximum(stress, 0.0) for stress in stresses[:-1]]
    return [*slack, stresses[-1]], own


def tension_at(
    conductor: Conductor,
    strain: Scalar,
    temperature: Scalar,
    permanent: Float[Array, " n_layer"],
    *,
    creeps: bool | Bool[Array, ""] = False,
) -> Scalar:
    """Return the tension of a conductor, N; arguments as of `layer_stresses`."""
    stresses, _ = layer_stresses(conductor, strain, temperature, permanent, creeps=creeps)
    return conductor.area * sum(stresses)


def tangent_law(
    conductor: Conductor,
    strain: Scalar,
    temperature: Scalar,
    permanent: Float[Array, " n_layer"],
    *,
    creeps: bool | Bool[Array, ""] = False,
    ahead: float | Scalar = 0.0,
) -> tuple[Scalar, Scalar]:
    """Return the tangent of the law at a strain: strain without tension, and EA, N.

    The tension beside `strain` is ``EA (strain - strain without tension)``. The strain counts as
    constant: at an equilibrium with this tension derivatives by all else are those of the law.
    The slope is that at the strain ``strain + ahead``: of the branch beyond a corner that is near.
    """
    strain = lax.stop_gradient(strain)

    def tension(e):
        return tension_at(conductor, e, temperature, permanent, creeps=creeps)

    _, stiffness = jax.jvp(tension, (strain + ahead,), (jnp.ones_like(strain),))
    return strain - tension(strain) / stiffness, stiffness


def strain_at(
    conductor: Conductor,
    tension: Scalar,
    temperature: Scalar,
    permanent: Float[Array, " n_layer"],
    *,
    creeps: bool | Bool[Array, ""] = False,
) -> Scalar:
    """Return the strain at a tension, N, by bisection; differentiable as the law is."""

    def force(e):
        return tension_at(conductor, e, temperature, permanent, creeps=creeps)

    def halve(_, bracket):
        low, high = bracket
        middle = 0.5 * (low + high)
        below = force(middle) < tension
        return jnp.where(below, middle, low), jnp.where(below, high, middle)

    start = jnp.full_like(tension, -_WIDEST), jnp.full_like(tension, _WIDEST)
    low, high = lax.stop_gradient(lax.fori_loop(0, _BISECTIONS, halve, start))
    free, stiffness = tangent_law(
        conductor, 0.5 * (low + high), temperature, permanent, creeps=creeps
    )
    return free + tension / stiffness


def permanent_strains(
    conductor: Conductor,
    strain: Scalar,
    temperature: Scalar,
    permanent: Float[Array, " n_layer"],
    *,
    creeps: bool | Bool[Array, ""] = False,
) -> Float[Array, " n_layer"]:
    """Return the permanent strains that a state leaves in the layers, [n_layer].

    They are at least those from before, `permanent`; other arguments as of `layer_stresses`.
    """
    stresses, own = layer_stresses(conductor, strain, temperature, permanent, creeps=creeps)
    left = [
        e - s / layer.modulus for s, e, layer in zip(stresses, own, conductor.layers, strict=True)
    ]
    return jnp.maximum(jnp.stack(left), permanent)
