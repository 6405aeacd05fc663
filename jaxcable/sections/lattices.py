"""Lattice masts as one beam: stiffnesses of the section that replaces legs and bracing."""

from __future__ import annotations

from typing import Literal

import numpy as np

from ..common import checks
from ..common.rules import nan_if_broken, positive
from ..common.types import ArrayLike, Float
from .linear_section import LinearSection


def lattice(
    sides: Literal[3, 4],
    width: Float[ArrayLike, ""],
    panel: Float[ArrayLike, ""],
    EA_leg: Float[ArrayLike, ""],
    EA_diagonal: Float[ArrayLike, ""],
    EA_strut: Float[ArrayLike, ""] | None = None,
    pattern: Literal["X", "N", "W", "K"] = "X",
) -> LinearSection:
    """Return the section whose beam replaces a lattice mast of three or four equal faces.

    Joints are pinned. With the height of a panel ``a``, the width of a face ``b`` and the length of
    a diagonal ``d``, a shear force V in a face shears it by the angle ``V / S``:

    - "X", two diagonals that cross: each has ``V d / 2b``, hence ``1/S = d^3 / (2 a b^2 EA_d)``;
    - "W", one diagonal a panel, in zigzag: it has ``V d / b``, ``1/S = d^3 / (a b^2 EA_d)``;
    - "N", one diagonal a panel, and a strut that has V: ``b / (a EA_s)`` in addition;
    - "K", two diagonals from the legs to the middle of a strut: each has ``V d / b`` with
      ``d^2 = a^2 + b^2/4``, the strut plus and minus ``V/2``:
      ``1/S = 2 d^3 / (a b^2 EA_d) + b / (4 a EA_s)``.

    Of n faces, ``GA = n S / 2`` in every direction. Torsion T is a shear flow around the mast,
    ``V = T / (n r)`` in each face at the distance r from the axis: ``GJ = n S r^2``. The legs give
    ``EA = n EA_leg`` and ``EI = n EA_leg R^2 / 2`` at the distance R. Struts between crossing
    diagonals ("X") prevent these from giving way as the legs shorten; with the force of diagonals
    and struts in equilibrium, faces then add to EA and EI.

    Diagonals of "N" and "W" in neighboring faces are taken to mirror each other, which three faces
    cannot: torsion then also loads the legs, and GJ is too large, of three faces with "W" by 3 %
    for diagonals with a fifth of the legs' EA and by 8 % with half of it, with "N" by 1 % and 2 %.
    If all diagonals of four faces rise in the same sense of rotation, GJ is smaller, too.

    Args:
        sides: number of faces and of legs, 3 or 4.
        width: of a face, between the axes of its legs, scalar, m.
        panel: height of a panel, from joint to joint of a leg, scalar, m.
        EA_leg: axial stiffness of a leg, scalar, N.
        EA_diagonal: axial stiffness of a diagonal, scalar, N. Where diagonals go slack under
            compression (rods with "X"), take "N" with the one in tension.
        EA_strut: axial stiffness of a horizontal strut, one a panel and face, scalar, N; needed for
            "N" and "K"; None: there is none.
        pattern: of the bracing: "X", "N", "W" or "K".

    Returns:
        `LinearSection`, the same in all directions.

    Raises:
        ValueError: another number of sides or another pattern; a missing `EA_strut`; a number that
            is no scalar or not positive.

    Source: statics of a panel, as above; for "N", "W" and "X" also EN 1993-1-1, figure 6.9
    (shear stiffness of lacings), and Petersen, Stahlbau (lattice columns).

    Example:
        A square mast, 0.6 m wide, with X bracing:

        >>> mast = jc.sections.lattice(4, 0.6, 0.6, EA_leg=200e6, EA_diagonal=40e6)
        >>> print(f"EA {mast.EA / 1e6:.0f} MN, EI {mast.EIy / 1e6:.0f} MN m2")
        EA 800 MN, EI 72 MN m2
        >>> print(f"GA {mast.GAy / 1e6:.1f} MN, GJ {mast.GJ / 1e6:.2f} MN m2")
        GA 56.6 MN, GJ 10.18 MN m2
    """
    if sides not in (3, 4) or isinstance(sides, bool):
        raise ValueError(f"sides = {sides!r}: expected 3 or 4")
    if pattern not in ("X", "N", "W", "K"):
        raise ValueError(f"pattern = {pattern!r}: expected one of ('X', 'N', 'W', 'K')")
    if EA_strut is None and pattern in ("N", "K"):
        raise ValueError(f"EA_strut: missing; bracing {pattern!r} needs struts")
    b, a, leg, brace = (
        _positive_number(value, name)
        for name, value in (
            *(("width", width), ("panel", panel)),
            *(("EA_leg", EA_leg), ("EA_diagonal", EA_diagonal)),
        )
    )
    strut = None if EA_strut is None else _positive_number(EA_strut, "EA_strut")
    across = b / 2 if pattern == "K" else b
    d = (a**2 + across**2) ** 0.5
    soft = {"X": 0.5, "N": 1.0, "W": 1.0, "K": 2.0}[pattern] * d**3 / (a * b**2 * brace)
    if strut is not None:
        soft = soft + {"X": 0.0, "N": 1.0, "W": 0.0, "K": 0.25}[pattern] * b / (a * strut)
    to_face, to_leg = b / (2 * np.tan(np.pi / sides)), b / (2 * np.sin(np.pi / sides))
    EA, EI = sides * leg, sides * leg * to_leg**2 / 2
    if strut is not None and pattern == "X":
        # strain e of the legs and h of the struts: that of a diagonal is (a/d)^2 e + (b/d)^2 h
        pair, beam = 2 * brace * d, strut * b
        face = (a / d) ** 4 * pair * beam / (beam + pair * (b / d) ** 4) / a
        EA, EI = EA + sides * face, EI + sides * face * to_face**2 / 2
    GA, GJ = sides / soft / 2, sides / soft * to_face**2
    return LinearSection(EA, EI, EI, GJ, GA, GA)


def _positive_number(value, name):
    """Return a scalar; one that is not positive: ValueError, or NaN if traced."""
    return nan_if_broken(positive(name, checks.as_scalar(value, name)))
