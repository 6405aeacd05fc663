"""Capacity of a section: the interaction surface of axial force and two moments."""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp

from ..programs.program_calls import as_program
from .fibres import Fibres, SectionForces


def interaction(section: Fibres, n_angle: int = 24, n_axial: int = 21) -> SectionForces:
    """Return the interaction surface N-My-Mz, on which the first fibre reaches its rupture strain.

    Strains are scaled up along directions that cover all ratios of elongation to curvature and all
    axes of bending, until the first fibre reaches the end of its stress-strain curve. With monotone
    laws no equilibrium exists beyond this surface.

    Args:
        section: `Section`; a law without a compression branch does not limit compression.
        n_angle: number of directions of bending, evenly over the full circle.
        n_axial: number of ratios of elongation to curvature, from pure compression to pure tension.

    Returns:
        ``N, My, Mz``, [n_axial, n_angle] each, N, N m, N m; infinite where no fibre ever fails.

    Raises:
        ValueError: no law of the section ends in a rupture; fewer than two ratios, or no direction.

    Example:
        The smallest and largest axial force of an area of 20 000 mm2 that carries 100 MPa:

        >>> law = jc.Polygonal([-1e-3, 0.0, 1e-3], [-100e6, 0.0, 100e6])
        >>> section = jc.Section.rectangle(0.1, 0.2, law, shape=(10, 10))
        >>> N, My, Mz = section.interaction(n_angle=4, n_axial=3)  # [3, 4] each
        >>> print(f"{N[0, 0] / 1e6:.2f} MN, {N[-1, 0] / 1e6:.2f} MN")
        -2.00 MN, 2.00 MN
    """
    for name, count, least in (("n_angle", n_angle, 1), ("n_axial", n_axial, 2)):
        if count < least:
            raise ValueError(f"{name} = {count}: expected at least {least}")
    if not section.has_rupture:
        raise ValueError(
            "interaction: the capacity of this section is unlimited, because no law of it has a "
            "rupture strain; give it a law that ends, such as Polygonal"
        )
    return _interaction_surface(section, n_angle=int(n_angle), n_axial=int(n_axial))


@functools.partial(as_program, static=("n_angle", "n_axial"))
def _interaction_surface(section, n_angle, n_axial):
    """Return N, N, and My, Mz, N m, on the interaction surface, [n_axial, n_angle] each; a program.

    Arguments are those of `interaction`.
    """
    slant = jnp.pi * (jnp.arange(n_axial) / (n_axial - 1) - 0.5)  # -90 to 90 degrees
    angle = 2 * jnp.pi * jnp.arange(n_angle) / n_angle
    size = jnp.maximum(jnp.max(jnp.abs(section.y)), jnp.max(jnp.abs(section.z)))

    def point(slant, angle):
        bend = jnp.cos(slant) / size
        direction = jnp.stack([jnp.sin(slant), bend * jnp.cos(angle), bend * jnp.sin(angle)])
        rate = section.fibre_strain(*direction)
        factors = []
        for law, part in zip(section.laws, section._law_slices(), strict=True):
            (low, high), fibre_rate = law.strain_limits, rate[part]
            moving = jnp.where(fibre_rate == 0, 1.0, fibre_rate)
            factor = jnp.where(fibre_rate > 0, high / moving, low / moving)
            factors.append(jnp.where(fibre_rate == 0, jnp.inf, factor))
        factor = jnp.min(jnp.concatenate(factors))
        ends = jnp.isfinite(factor)
        forces = section.extrapolated().forces(*(jnp.where(ends, factor, 0.0) * direction))
        return tuple(jnp.where(ends, force, jnp.inf) for force in forces)

    return jax.vmap(lambda t: jax.vmap(lambda a: point(t, a))(angle))(slant)
