"""Where the axis of a section is, its second moments and its initial stiffness.

The functions are methods of `Section`.
"""

import jax.numpy as jnp

from ..common.tree import copy
from .arrays import stack


def shifted(section, y=0.0, z=0.0):
    """The section moved by `y`, `z`, m, against the axis of the element; no beam warns of that.

    Example:
        >>> section = jc.Section.rectangle(0.1, 0.2, jc.Elastic(1.0)).shifted(z=0.1)
        >>> print(f"{section.z.min():.2f} to {section.z.max():.2f} m")  # middles of ten layers
        0.01 to 0.19 m
    """
    points = None if section.points is None else section.points + stack(y, z)[None]
    return copy(section, y=section.y + y, z=section.z + z, points=points, placed=True)


def centroid(section):
    """Centroid ``(y, z)``, m: of the area, or of ``E A`` where laws of several moduli meet.

    Elongation of the axis through it (at the initial moduli) takes no moment.

    Example:
        >>> section = jc.Section.rectangle(0.1, 0.2, jc.Elastic(1.0)).shifted(z=0.1)
        >>> y, z = section.centroid()
        >>> print(f"{z:.3f} m")
        0.100 m
    """
    weight = section.area
    if len(section.laws) > 1:
        weight = weight * section._per_fibre([law.modulus for law in section.laws])
    total = weight.sum()
    return weight @ section.y / total, weight @ section.z / total


def centred(section):
    """The section with its axis at its `centroid`.

    Example:
        An L of 100 x 100 x 10 mm whose corner was the origin:

        >>> corners = [[0, 0], [0.1, 0], [0.1, 0.01], [0.01, 0.01], [0.01, 0.1], [0, 0.1]]
        >>> section = jc.Section.polygon(corners, None, jc.Elastic(210e9), size=0.01).centred()
        >>> Iy, Iz, Iyz = section.inertia()
        >>> print(f"{1e8 * Iy:.1f} cm4, {1e8 * Iyz:.1f} cm4")
        180.0 cm4, -106.6 cm4
        >>> lowest, highest = section.points[:, 1].min(), section.points[:, 1].max()
        >>> print(f"{1e3 * lowest:.1f} to {1e3 * highest:.1f} mm")  # 28.7 mm below, 71.3 mm above
        -28.7 to 71.3 mm
    """
    y, z = centroid(section)
    return shifted(section, -y, -z)


def inertia(section):
    """Second moments of area about the axes: ``Iy, Iz, Iyz``, the integrals of z^2, y^2, yz, m4.

    Exact for all shapes, whatever their mesh; of fibres given one by one the sums of
    ``A z^2, A y^2, A y z``. Unless Iyz is zero a moment about one axis bends about both: that is in
    all forces and strains.

    Example:
        >>> section = jc.Section.rectangle(0.1, 0.2, jc.Elastic(1.0), shape=(10, 10))
        >>> print(f"{section.inertia()[0] / (0.1 * 0.2**3 / 12):.6f}")  # b h^3 / 12
        1.000000
    """
    y, z = section.y, section.z
    total = [jnp.sum(section.area * v) for v in (z * z, y * y, y * z)]
    if section.own is not None:
        total = [v + jnp.sum(own) for v, own in zip(total, section.own.T, strict=True)]
    return tuple(total)


def stiffness(section):
    """Initial stiffness, N, N m and N m2: forces per (e0, ky, kz), [3, 3].

    Exact if all laws are linear; else that of the fibres, of second order in their size (ten layers
    have 1 % less than a rectangle), because forces are theirs.

    Example:
        >>> section = jc.Section.rectangle(0.1, 0.2, jc.Elastic(200e9), shape=(10, 10))
        >>> EA, EIy, EIz = jnp.diagonal(section.stiffness()) / 1e6
        >>> print(f"{EA:.0f} MN, {EIy:.2f} MN m2, {EIz:.2f} MN m2")
        4000 MN, 13.33 MN m2, 3.33 MN m2
    """
    lever = section._levers()
    modulus = section._per_fibre([law.modulus for law in section.laws])
    total = lever.T @ ((section.area * modulus)[:, None] * lever)
    if section.own is None or not section.is_elastic:
        return total
    z2, y2, yz = modulus @ section.own
    zero = jnp.zeros_like(z2)
    rows = [[zero, zero, zero], [zero, z2, -yz], [zero, -yz, y2]]
    return total + jnp.stack([jnp.stack(row) for row in rows])


def torsional_stiffness(section, poisson=0.3):
    """Initial torsional stiffness ``sum G J`` with ``G = E / 2 (1 + poisson)``.

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
            "torsional_stiffness: missing; this section has no known torsion constant (a composite "
            "has one if it is stated: Section.composite(..., torsion=...))"
        )
    shear = jnp.stack([law.modulus / (2 * (1 + poisson)) for law in section.laws])
    return jnp.sum(shear * section.torsion)
