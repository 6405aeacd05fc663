"""Default axes of beams: which elements are vertical, and which sections need no axes."""

from __future__ import annotations

import jax
import jax.numpy as jnp

from ..common import checks
from ..common.types import Array, Bool
from ..sections import LinearSection, Section

# Sine of the angle to z below which an element counts as vertical, 0.06 degrees: more than what the
# rounding of coordinates to four digits makes of it.
VERTICAL_SINE = 1e-3
# Sine below which an element that leans needs `up`, 6 degrees: default axes of elements that are
# vertical and of those that are not differ by 90 degrees.
LEANING_SINE = 0.1


def is_known_anisotropic(section: Section | LinearSection) -> bool:
    """Return whether the bending stiffness of a section is known to depend on the direction.

    False where numbers of the section are traced, hence not known.
    """
    if any(checks.array_if_known(leaf) is None for leaf in jax.tree.leaves(section)):
        return False  # traced numbers are judged by `start`
    with jax.ensure_compile_time_eval():
        return not bool(is_isotropic(section))


def is_isotropic(section: Section | LinearSection) -> Bool[Array, ""]:
    """Return whether bending and shear stiffness of a section are the same in all directions."""
    stiffness = section.stiffness()
    scale = jnp.maximum(stiffness[1, 1], stiffness[2, 2])
    radius = jnp.sqrt(stiffness[0, 0] * scale)
    apart = jnp.abs(stiffness[1, 1] - stiffness[2, 2]) + jnp.abs(stiffness[1, 2])
    off = jnp.abs(stiffness[0, 1]) + jnp.abs(stiffness[0, 2])
    tiny = 1e3 * jnp.finfo(stiffness.dtype).eps  # sums over some hundred fibres
    alike = (apart <= tiny * scale) & (off <= tiny * radius)
    if (section.GAy is None) != (section.GAz is None):
        return jnp.zeros((), bool)
    if section.GAy is None or section.GAz is None:
        return alike
    return alike & (jnp.abs(section.GAy - section.GAz) <= tiny * section.GAy)
