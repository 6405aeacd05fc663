"""Laws of common materials, each with the source of its numbers."""

from __future__ import annotations

from typing import Literal

import numpy as np

from ..common import checks
from ..common.rules import positive, refuse_if_broken
from ..common.types import ArrayLike, Float
from .polygonal import Polygonal

LEAST_STRAIN = 1e-5
"""Strength over E below which units are in doubt; steel has 1e-3, concrete in tension 1e-4."""


def steel(
    yield_stress: Float[ArrayLike, ""] = 235e6,
    E: Float[ArrayLike, ""] = 210e9,
    hardening: Float[ArrayLike, ""] = 0.01,
    *,
    ultimate_strain: Float[ArrayLike, ""] = 0.05,
    unloading: Literal["reversible", "elastic"] = "elastic",
) -> Polygonal:
    """Make the law of structural steel: bilinear, the same in tension and compression.

    Args:
        yield_stress: f_y, Pa; 235e6 is S235 up to 40 mm (EN 1993-1-1, table 3.1).
        E: Young's modulus, Pa (EN 1993-1-1, 3.2.6).
        hardening: slope after yield, relative to E; default 1/100 (EN 1993-1-5, C.6 c).

    Options:
        ultimate_strain: strain at which the fibre counts as failed; default 5 % (EN 1993-1-5, C.8).
        unloading: "elastic" (default) or "reversible", see `Polygonal`.

    Returns:
        `Polygonal`.

    Raises:
        ValueError: a number is not positive; those of `Polygonal`.

    Warns:
        InputWarning: a strength below a hundred-thousandth of E, as of one in MPa.

    Example:
        >>> law = jc.materials.steel(355e6)
        >>> print(jnp.round(law.stress_at(jnp.array([0.001, -0.001, 0.01])) / 1e6, 1))  # MPa
        [ 210.  -210.   372.4]
    """
    _require_positive(yield_stress=yield_stress, E=E, ultimate_strain=ultimate_strain)
    _warn_of_weak_material("yield_stress", yield_stress, E)
    e = yield_stress / E
    top = yield_stress + hardening * E * (ultimate_strain - e)
    strain = [-ultimate_strain, -e, 0.0, e, ultimate_strain]
    return Polygonal(strain, [-top, -yield_stress, 0.0, yield_stress, top], unloading)


def strand(
    strength: Float[ArrayLike, ""] = 1860e6,
    E: Float[ArrayLike, ""] = 195e9,
    ultimate_strain: Float[ArrayLike, ""] = 0.02 / 0.9,
    *,
    unloading: Literal["reversible", "elastic"] = "elastic",
) -> Polygonal:
    """Make the law of prestressing strand: bilinear, tension only.

    Elastic to 0.9 of the strength, then inclined to the strength at the ultimate strain.

    Args:
        strength: f_pk, Pa.
        E: Young's modulus, Pa.
        ultimate_strain: strain at the strength.

    Options:
        unloading: "elastic" (default) or "reversible", see `Polygonal`.

    Returns:
        `Polygonal`.

    Raises:
        ValueError: a number is not positive; those of `Polygonal`.

    Warns:
        InputWarning: a strength below a hundred-thousandth of E, as of one in MPa.

    Source: EN 1992-1-1, 3.3.6 (6) for E, (7) with the recommended values: 0.9, and 0.02 for 0.9 of
    the ultimate strain.

    Example:
        >>> law = jc.materials.strand()
        >>> print(f"{law.stress_at(0.005) / 1e6:.0f}, {law.capacity[1] / 1e6:.0f} MPa")
        975, 1860 MPa
    """
    _require_positive(strength=strength, E=E, ultimate_strain=ultimate_strain)
    _warn_of_weak_material("strength", strength, E)
    proof = 0.9 * strength
    return Polygonal([0.0, proof / E, ultimate_strain], [0.0, proof, strength], unloading)


def tension_only(
    E: Float[ArrayLike, ""],
    strength: Float[ArrayLike, ""] = np.inf,
    ultimate_strain: Float[ArrayLike, ""] | None = None,
    *,
    unloading: Literal["reversible", "elastic"] = "reversible",
) -> Polygonal:
    """Make a law that is linear up to the strength, then failed, and slack in compression.

    Args:
        E: Young's modulus, Pa.
        strength: Pa; the line ends at the strength or at a strain of 1, whichever comes first.
        ultimate_strain: if given, the stress stays at the strength up to this strain.

    Options:
        unloading: "reversible" (default) or "elastic", see `Polygonal`.

    Returns:
        `Polygonal`.

    Raises:
        ValueError: a number is not positive; those of `Polygonal`.

    Warns:
        InputWarning: a strength below a hundred-thousandth of E, as of one in MPa.

    Example:
        >>> law = jc.materials.tension_only(E=165e9, strength=1500e6)
        >>> print(jnp.round(law.stress_at(jnp.array([-0.001, 0.001, 0.01])) / 1e6, 1))  # MPa
        [  0. 165.   0.]
    """
    _require_positive(strength=strength, E=E)
    _warn_of_weak_material("strength", strength, E)
    e = min(strength / E, 1.0)
    if ultimate_strain is None:
        return Polygonal([0.0, e], [0.0, E * e], unloading)
    return Polygonal([0.0, e, ultimate_strain], [0.0, E * e, E * e], unloading)


def _require_positive(**numbers):
    """Raise ValueError unless all numbers, which are given by name, are positive."""
    for name, value in numbers.items():
        refuse_if_broken([positive(name, checks.as_floats(value, name))])


def _warn_of_weak_material(name, strength, E):
    """Warn of a `strength` below `LEAST_STRAIN` times E, both Pa, unless one of them is traced.

    `name` is the argument that the warning names.
    """
    known = checks.array_if_known(strength), checks.array_if_known(E)
    if all(value is not None for value in known) and np.any(known[0] < LEAST_STRAIN * known[1]):
        low, modulus = (float(np.min(value)) for value in known)
        checks.warn_user(
            f"{name} = {low:.6g}: Pa, and E is {modulus:.6g} Pa: a strain of {low / modulus:.1e}, "
            "of steel 1e-3; is it in MPa?"
        )
