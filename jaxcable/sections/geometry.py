"""Axis, centroid, second moments and torsional stiffness of a section: methods of `Section`."""

from __future__ import annotations

from typing import TypeVar

import jax.numpy as jnp

from ..common.tree import copy_with
from ..common.types import Array, ArrayLike, Float
from ..programs.joining import stack_trees
from .fibres import Fibres

AnySection = TypeVar("AnySection", bound=Fibres)


def shifted(
    section: AnySection, y: Float[ArrayLike, ""] = 0.0, z: Float[ArrayLike, ""] = 0.0
) -> AnySection:
    """Return the section moved by `y`, `z`, m, relative to the axis of the element.

    Beams then take its position as intended, and do not warn of an axis off the centroid.

    Example:
        >>> section = jc.Section.rectangle(0.1, 0.2, jc.Elastic(1.0)).shifted(z=0.1)
        >>> print(f"{section.z.min():.2f} to {section.z.max():.2f} m")  # middles of ten layers
        0.01 to 0.19 m
    """
    points = None if section.points is None else section.points + stack_trees([y, z])[None]
    return copy_with(section, y=section.y + y, z=section.z + z, points=points, placed=True)


def centroid(section: Fibres) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Return the centroid ``(y, z)``, m: of the area, or of ``E A`` if there are several laws.

    At the initial moduli, elongation of an axis through the centroid causes no moment.

    Example:
        >>> section = jc.Section.rectangle(0.1, 0.2, jc.Elastic(1.0)).shifted(z=0.1)
        >>> y, z = section.centroid()
        >>> print(f"{z:.3f} m")
        0.100 m
    """
    weight = section.area
    if len(section.laws) > 1:
        weight = weight * section._repeat_per_fibre([law.modulus for law in section.laws])
    total = weight.sum()
    return weight @ section.y / total, weight @ section.z / total


def centred(section: AnySection) -> AnySection:
    """Return the section moved so that its `centroid` is at the axis of the element.

    Example:
        An L of 100 x 100 x 10 mm whose corner was the origin:

        >>> corners = [[0, 0], [0.1, 0], [0.1, 0.01], [0.01, 0.01], [0.01, 0.1], [0, 0.1]]
        >>> section = jc.Section.polygon(corners, None, jc.Elastic(210e9), size=0.01).centred()
        >>> Iy, Iz, Iyz = section.inertia()
        >>> print(f"{1e8 * Iy:.1f} cm4, {1e8 * Iyz:.1f} cm4")
        180.0 cm4, -106.6 cm4
        >>> lowest, highest = section.points[:, 1].min(), section.points[:, 1].max()
        >>> print(f"{1e3 * lowest:.1f} to {1e3 * highest:.1f} mm")  # from the axis
        -28.7 to 71.3 mm
    """
    y, z = centroid(section)
    return shifted(section, -y, -z)


def inertia(section: Fibres) -> tuple[Float[Array, ""], Float[Array, ""], Float[Array, ""]]:
    """Return the second moments of area ``Iy, Iz, Iyz``: integrals of z^2, y^2, yz, m4.

    Exact for all constructed shapes, whatever their mesh; for fibres given one by one, the sums of
    ``A z^2, A y^2, A y z``. Unless Iyz is zero, a moment about one axis bends about both axes: all
    forces and strains take account of this.

    Example:
        >>> section = jc.Section.rectangle(0.1, 0.2, jc.Elastic(1.0), shape=(10, 10))
        >>> print(f"{section.inertia()[0] / (0.1 * 0.2**3 / 12):.6f}")  # b h^3 / 12
        1.000000
    """
    y, z = section.y, section.z
    total = [jnp.sum(section.area * v) for v in (z * z, y * y, y * z)]
    if section.own is not None:
        total = [v + jnp.sum(moment) for v, moment in zip(total, section.own.T, strict=True)]
    Iy, Iz, Iyz = total
    return Iy, Iz, Iyz


def torsional_stiffness(section: Fibres, poisson: Float[ArrayLike, ""] = 0.3) -> Float[Array, ""]:
    """Return the initial torsional stiffness ``sum G J`` with ``G = E / (2 (1 + poisson))``.

    Args:
        poisson: Poisson's ratio of all laws.

    Returns:
        Scalar, N m2.

    Raises:
        ValueError: the section has no known torsion constant.

    Example:
        >>> section = jc.Section.disc(0.05, jc.Elastic(210e9))
        >>> print(f"{section.torsional_stiffness() / 1e3:.2f} kN m2")  # G pi d^4 / 32
        49.56 kN m2
    """
    if section.torsion is None:
        raise ValueError(
            "torsional_stiffness: missing; this section has no torsion constant: give "
            "the element a torsional_stiffness, or a composite its torsion constant: "
            "Section.composite(..., torsion=...)"
        )
    shear = jnp.stack([law.modulus / (2 * (1 + poisson)) for law in section.laws])
    return jnp.sum(shear * section.torsion)
