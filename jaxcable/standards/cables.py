"""Resistance of cables by EN 1993-1-11:2006: breaking and proof force, fatigue."""

from __future__ import annotations

import jax.numpy as jnp

from ..common import checks
from ..common.rules import nan_if_broken, positive
from ..common.types import Array, ArrayLike, Float

TERMINATIONS = {
    "metal filled socket": 1.0,
    "resin filled socket": 1.0,
    "ferrule-secured eye": 0.9,
    "swaged socket": 0.9,
    "U-bolt grip": 0.8,
}
"""Loss factors k_e of terminations (EN 1993-1-11:2006, table 6.3)."""

SERVICE_FRACTIONS = {
    "service": 0.45,
    "service, with bending": 0.50,
    "construction": 0.55,
    "construction, first hours": 0.60,
}
"""Limits of stress over ultimate strength (EN 1993-1-11:2006, tables 7.1 and 7.2): in service,
where fatigue is designed without bending stresses or with them; during construction, after all
tension components are installed, or for the first of them for a few hours."""

FATIGUE_CATEGORIES = {
    "prestressing bar": 105e6,
    "full locked coil rope": 150e6,
    "spiral strand": 150e6,
    "parallel wire strand": 160e6,
    "bundle of parallel strands": 160e6,
    "bundle of parallel wires": 160e6,
}
"""Stress ranges at 2 million cycles, Pa (EN 1993-1-11:2006, table 9.1): ropes and strands in
sockets filled with metal or resin, parallel wires in epoxy."""

_REFERENCE_CYCLES = 2e6
_SLOPES = 4.0, 6.0  # of the fatigue curve before and beyond these cycles, figure 9.1


def termination_factor(termination: str | Float[ArrayLike, " ..."]) -> Float[ArrayLike, " ..."]:
    """Return the loss factor k_e of a termination, by its name in `TERMINATIONS` or as a number."""
    if not isinstance(termination, str):
        return _positive(termination, "termination")
    checks.require_one_of(termination, "termination", list(TERMINATIONS))
    return TERMINATIONS[termination]


def cable_resistance(
    breaking_force: Float[ArrayLike, " ..."],
    proof_force: Float[ArrayLike, " ..."] | None = None,
    *,
    termination: str | Float[ArrayLike, " ..."] = 1.0,
    gamma_r: Float[ArrayLike, " ..."] = 1.0,
) -> Float[Array, " ..."]:
    """Compute the design resistance ``F_Rd = min(k_e F_min / (1.5 gamma_r), F_k / gamma_r)``.

    Args:
        breaking_force: minimum breaking force F_min, N.
        proof_force: characteristic proof force F_k, N; None where it is known to be larger than the
            breaking force over 1.5, as for full locked coil ropes.

    Options:
        termination: name in `TERMINATIONS`, or the loss factor k_e.
        gamma_r: 1.0, or 0.9 where measures at the anchorage keep bending stresses small (table 6.2,
            recommended values).

    Returns:
        F_Rd, N.

    Raises:
        ValueError: an unknown termination, or a number that is not positive.

    Source: EN 1993-1-11:2006, 6.2, with (6.4) for k_e.

    Example:
        A strand of 20 mm with swaged sockets; its maker gives 245 kN:

        >>> force = jc.standards.cable_resistance(408e3, termination="swaged socket")
        >>> print(f"{force / 1e3:.1f} kN")
        244.8 kN
    """
    factor = termination_factor(termination)
    gamma_r = _positive(gamma_r, "gamma_r")
    resistance = factor * _positive(breaking_force, "breaking_force") / (1.5 * gamma_r)
    if proof_force is None:
        return jnp.asarray(resistance)
    return jnp.minimum(resistance, _positive(proof_force, "proof_force") / gamma_r)


def cable_fatigue_strength(
    category: str | Float[ArrayLike, ""], cycles: Float[ArrayLike, ""]
) -> Float[Array, ""]:
    """Compute the range of stress that a cable endures for a number of cycles, Pa.

    ``category (2e6 / cycles)^(1/m)``, with m = 4 up to 2 million cycles and 6 beyond.

    Args:
        category: name in `FATIGUE_CATEGORIES`, or the range at 2 million cycles, Pa.
        cycles: number of cycles.

    Raises:
        ValueError: an unknown category, or a number that is not positive.

    Source: EN 1993-1-11:2006, 9.2, figure 9.1 and table 9.1.

    Example:
        >>> print(f"{jc.standards.cable_fatigue_strength('spiral strand', 125e3) / 1e6:.0f} MPa")
        300 MPa
    """
    if isinstance(category, str):
        checks.require_one_of(category, "category", list(FATIGUE_CATEGORIES))
        category = FATIGUE_CATEGORIES[category]
    (first, second), cycles = _SLOPES, _positive(cycles, "cycles")
    xp = checks.numpy_or_jax(cycles)
    ratio = _REFERENCE_CYCLES / xp.asarray(cycles)
    return _positive(category, "category") * ratio ** xp.where(ratio >= 1, 1 / first, 1 / second)


def _positive(value, name):
    """Return a number as floats; not positive it raises ValueError, or is NaN if traced."""
    return nan_if_broken(positive(name, checks.as_floats(value, name)))
