"""Shear stiffnesses of sections: stated as numbers, and textbook shear coefficients for them."""

from __future__ import annotations

from typing import Literal, TypeVar

import jax.numpy as jnp

from ..common import checks
from ..common.rules import Rule, nan_if_broken
from ..common.tree import replace
from ..common.types import Array, ArrayLike, Float
from .fibres import Fibres

AnySection = TypeVar("AnySection", bound=Fibres)


def with_shear(
    section: AnySection,
    GAy: Float[ArrayLike, ""] | None = None,
    GAz: Float[ArrayLike, ""] | None = None,
) -> AnySection:
    """Return the section with shear stiffnesses, so that beams of it are flexible in shear.

    The angle between a cross-section and the normal of the axis is ``V / GA``. It is linear
    whatever the laws of the fibres, which see no shear stress.

    Args:
        GAy, GAz: shear stiffnesses along y and z, scalars, N: shear modulus times area times the
            shear coefficient (`sections.shear_coefficient`), or times the area of the webs of an I
            or a box. None: rigid in shear in this direction, also where it had a
            stiffness before.

    Returns:
        `Section`.

    Raises:
        ValueError: a stiffness that is no scalar, or not positive.

    Example:
        >>> section = jc.Section.rectangle(0.1, 0.4, jc.Elastic(30e9))
        >>> GA = 30e9 / (2 * 1.2) * 0.1 * 0.4  # Poisson's ratio 0.2
        >>> k = jc.sections.shear_coefficient("rectangle", poisson=0.2)
        >>> section = section.with_shear(GAy=k * GA, GAz=k * GA)
        >>> print(f"{section.GAz / 1e6:.1f} MN")
        422.5 MN
    """
    return replace(section, GAy=GAy, GAz=GAz)


def shear_coefficient(
    shape: Literal["rectangle", "disc", "ring"],
    poisson: Float[ArrayLike, ""] = 0.3,
    inner: Float[ArrayLike, ""] | None = None,
) -> Float[ArrayLike, ""]:
    """Return Cowper's shear coefficient k of a shape, of which ``k G A`` is the shear stiffness.

    Args:
        shape: "rectangle", "disc" or "ring".
        poisson: Poisson's ratio, scalar.
        inner: inner over outer diameter of a ring, scalar from 0 to below 1; near 1 for a thin
            wall. Rings need it, other shapes have none.

    Returns:
        Scalar.

    Raises:
        ValueError: another shape; a Poisson's ratio that is not from 0 to 0.5; an `inner` that is
            not from 0 to below 1, is missing for a ring, or given for another shape.

    Source: Cowper, The shear coefficient in Timoshenko's beam theory, J. Appl. Mech. 33 (1966).

    Example:
        >>> for shape in ("rectangle", "disc"):
        ...     print(f"{jc.sections.shear_coefficient(shape):.4f}")
        0.8497
        0.8864
        >>> print(f"{jc.sections.shear_coefficient('ring', inner=0.98):.4f}")  # a thin tube
        0.5307
    """
    text = "must be from 0 to 0.5"
    poisson = checks.as_scalar(poisson, "poisson")
    v = nan_if_broken(Rule("poisson", poisson, lambda v: (v < 0) | (v > 0.5), text))
    checks.require_one_of(shape, "shape", ("rectangle", "disc", "ring"))
    if (inner is not None) != (shape == "ring"):
        what = "missing; give inner over outer diameter" if shape == "ring" else "of a ring only"
        raise ValueError(f"inner: {what}")
    if shape == "rectangle":
        return 10 * (1 + v) / (12 + 11 * v)
    inner = checks.as_scalar(0.0 if inner is None else inner, "inner")
    text = "must be from 0 to below 1"
    m = nan_if_broken(Rule("inner", inner, lambda m: (m < 0) | (m >= 1), text))
    whole = (1 + m**2) ** 2
    return 6 * (1 + v) * whole / ((7 + 6 * v) * whole + (20 + 12 * v) * m**2)


def shear_arrays(section: Fibres) -> tuple[Float[Array, ""] | None, Float[Array, ""] | None]:
    """Return the shear stiffnesses GAy and GAz as arrays of jax, N, None where rigid in shear."""
    along_y, along_z = section.GAy, section.GAz
    return (
        None if along_y is None else jnp.asarray(along_y),
        None if along_z is None else jnp.asarray(along_z),
    )
