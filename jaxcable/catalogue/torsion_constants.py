"""Torsion constants of rolled and hollow sections with fillets, by the formulas of their tables.

The tables of EN 10365 and EN 10056-1 sections, as manufacturers print them, follow El Darwish and
Johnston, Torsion of Structural Shapes, Proc. ASCE 91 (ST1), 1965: plates, a disc that is inscribed
where they meet, and less for their ends. EN 10210-2 and EN 10219-2 give that of hollow sections.
"""

from __future__ import annotations

import numpy as np


def i_torsion(h: float, b: float, tw: float, tf: float, r: float) -> float:
    """Return the torsion constant of an I, m4.

    `h` and `b` are height and width, `tw` and `tf` thicknesses of web and flanges, `r` is the
    radius of the fillets, m.
    """
    alpha = (
        -0.042
        + 0.2204 * tw / tf
        + 0.1355 * r / tf
        - 0.0865 * r * tw / tf**2
        - 0.0725 * tw**2 / tf**2
    )
    disc = ((tf + r) ** 2 + (r + 0.25 * tw) * tw) / (2 * r + tf)
    plates = 2 / 3 * b * tf**3 + (h - 2 * tf) * tw**3 / 3
    return plates + 2 * alpha * disc**4 - 0.42 * tf**4


def u_torsion(h: float, b: float, tw: float, tf: float, r: float) -> float:
    """Return the torsion constant of a U, m4; arguments as of `i_torsion`.

    `tf` is the mean thickness of a flange.
    """
    plates = 2 / 3 * b * tf**3 + (h - 2 * tf) * tw**3 / 3
    return plates + 2 * _corner_constant(tw, tf, r) - 0.42 * tf**4


def l_torsion(a: float, t: float, r: float) -> float:
    """Return the torsion constant of an equal angle, m4.

    `a` is the length of a leg, `t` its thickness and `r` the radius of the fillet, m.
    """
    alpha = 0.0768 + 0.0479 * r / t
    disc = 2 * (3 * r + 2 * t - np.sqrt(2.0) * (2 * r + t))
    return (2 * a - t) * t**3 / 3 + alpha * disc**4 - 0.21 * t**4


def rectangular_torsion(h: float, b: float, t: float, outer: float, inner: float) -> float:
    """Return the torsion constant of a rectangular hollow section, m4 (EN 10210-2, annex A).

    `h` and `b` are height and width, `t` is the wall thickness, `outer` and `inner` are the radii
    of the corners, m.
    """
    mean = (outer + inner) / 2
    length = 2 * (b - t + h - t) - 2 * mean * (4 - np.pi)
    inside = (b - t) * (h - t) - mean**2 * (4 - np.pi)
    return t**3 * length / 3 + 4 * inside**2 * t / length


def _corner_constant(tw, tf, r):
    """Return what the disc inscribed in one corner of a U adds to its torsion constant, m4.

    `tw`, `tf` and `r` are as of `u_torsion`.
    """
    alpha = (
        -0.0908
        + 0.2621 * tw / tf
        + 0.1231 * r / tf
        - 0.0752 * r * tw / tf**2
        - 0.0945 * tw**2 / tf**2
    )
    disc = 2 * (3 * r + tw + tf - np.sqrt(2 * (2 * r + tw) * (2 * r + tf)))
    return alpha * disc**4
