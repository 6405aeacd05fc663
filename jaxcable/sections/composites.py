"""Several sections side by side as one."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, TypeVar

import jax.numpy as jnp
import numpy as np

from ..common import checks
from ..common.rules import or_nan, positive
from ..common.types import ArrayLike, Float
from .arrays import concatenate, stack
from .fibres import Fibres
from .torsion import are_round

Made = TypeVar("Made", bound=Any)  # `Section`, which imports this


def composite(
    cls: type[Made],
    sections: Iterable[Fibres],
    torsion: Float[ArrayLike, "#n_law"] | None = None,
) -> Made:
    """Several sections side by side as one; overlapping parts are not subtracted.

    A concrete-filled tube is made of a disc and a ring, and so is a strand with a soft core.
    The axis is at the origin of the parts (`Section.centred` moves it).

    Torsion constants add up only where all parts are discs and rings about one centre. Otherwise
    the torsion constant depends on how the parts are joined (that of a closed box is hundreds of
    times the sum of its plates) and has to be stated; see `sections.bredt_torsion`.

    Args:
        sections: list of `Section`, each at its place (see `Section.shifted`).
        torsion: torsion constant of the whole, m4; a scalar if there is one law, else [n_law], the
            share of each law, in the order in which the laws first appear in `sections`.

    Returns:
        `Section`, its fibres sorted by law. If `torsion` is not stated, the torsion constant is
        the sum of the parts for discs and rings about one centre, that of the part for a single
        part, and None otherwise. For traced parts that are no such discs and rings it is NaN.

    Raises:
        ValueError: no section; a torsion constant of the wrong shape, or not positive.

    Example:
        A concrete-filled tube:

        >>> tube = jc.Section.ring(0.2, 0.01, jc.Elastic(210e9))
        >>> core = jc.Section.disc(0.18, jc.Elastic(30e9))
        >>> section = jc.Section.composite([tube, core])
        >>> print(f"{1e4 * section.total_area:.2f} cm2")  # pi 0.2^2 / 4
        314.16 cm2
        >>> print(f"{section.stiffness()[0, 0] / 1e6:.0f} MN")  # sum E A
        2017 MN
        >>> print(f"{section.torsional_stiffness() / 1e6:.3f} MN m2")  # sum G J
        5.552 MN m2
    """
    sections = list(sections)
    parts = []  # one for each law of each section: section, law, slice of fibres, torsion constant
    for section in sections:
        for k, (law, part) in enumerate(zip(section.laws, section._parts(), strict=True)):
            constant = None if section.torsion is None else section.torsion[k]
            parts.append((section, law, part, constant))
    if not parts:
        raise ValueError("sections: a composite needs at least one section")
    kinds = list({id(law): law for _, law, _, _ in parts}.values())
    parts = [p for kind in kinds for p in parts if p[1] is kind]
    starts, n_point = {}, 0
    for section in sections:
        starts[id(section)] = n_point
        n_point += 0 if section.points is None else len(section.points)
    meshed = all(section.points is not None for section in sections)
    known = all(section.own is not None for section in sections)

    def join(name):
        return concatenate([getattr(section, name)[part] for section, _, part, _ in parts])

    return cls(
        join("y"),
        join("z"),
        join("area"),
        tuple(kinds),
        tuple(
            sum(part.stop - part.start for _, law, part, _ in parts if law is kind)
            for kind in kinds
        ),
        _summed(sections, parts, kinds) if torsion is None else _stated(torsion, len(kinds)),
        concatenate([section.points for section in sections]) if meshed else None,
        np.concatenate(
            [s.cells[part] + starts[id(s)] for s, _, part, _ in parts]  # type: ignore[index]  # all
        )
        if meshed
        else None,
        join("own") if known else None,
        placed=False,
    )


def _stated(torsion, n_law):
    """A stated torsion constant, checked, [n_law]."""
    torsion = checks.floats(torsion, "torsion")
    if torsion.shape != (n_law,) and not (n_law == 1 and torsion.shape == ()):
        raise ValueError(
            f"torsion: expected {'a scalar' if n_law == 1 else f'shape ({n_law},)'}, one constant "
            f"per law, got shape {torsion.shape}"
        )
    return or_nan(positive("torsion", torsion)).reshape(n_law)


def _summed(sections, parts, kinds):
    """Torsion constants per law, or None where they do not add up."""
    if any(constant is None for *_, constant in parts):
        return None
    total = stack(*[sum(c for _, law, _, c in parts if law is kind) for kind in kinds])
    if len(sections) == 1:
        return total
    alike = are_round(
        [
            (s.y[part], s.z[part], s.area[part], None if s.own is None else s.own[part], constant)
            for s, _, part, constant in parts
        ]
    )
    if checks.concrete(alike) is None:
        return jnp.where(alike, total, jnp.nan)
    return total if alike else None
