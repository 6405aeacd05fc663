"""Several sections side by side as one."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, TypeVar

import jax.numpy as jnp
import numpy as np

from ..common import checks
from ..common.rules import nan_if_broken, positive
from ..common.types import ArrayLike, Float, Int
from ..materials.law import Law
from ..programs.joining import concatenate, stack_trees
from .fibres import Fibres
from .torsion import are_concentric_circles

NewSection = TypeVar("NewSection", bound=Any)  # `Section`, which imports this


def composite(
    cls: type[NewSection],
    sections: Iterable[Fibres],
    torsion: Float[ArrayLike, "#n_law"] | None = None,
) -> NewSection:
    """Join several sections to one; overlapping parts are not subtracted.

    A concrete-filled tube is made of a disc and a ring, and so is a strand with a soft core.
    The axis is at the origin of the parts (`Section.centred` moves it).

    Torsion constants add up only where all parts are discs and rings about one centre. Otherwise
    the torsion constant depends on how the parts are joined (that of a closed box is hundreds of
    times the sum of its plates) and has to be given; see `sections.bredt_torsion`.

    Args:
        sections: list of `Section`, each at its place (see `Section.shifted`).
        torsion: torsion constant of the whole, m4; a scalar if there is one law, else [n_law], the
            share of each law, in the order in which the laws first appear in `sections`.

    Returns:
        `Section`, its fibres sorted by law. If `torsion` is not given, the torsion constant is
        the sum of the parts for discs and rings about one centre, that of the part for a single
        part, and None otherwise. For traced parts that are no such discs and rings it is NaN.

    Raises:
        ValueError: no section; a part with a shear stiffness; a torsion constant of the wrong
            shape, or not positive.

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
    if not sections:
        raise ValueError("sections: is empty; a composite needs at least one section")
    for k, section in enumerate(sections):
        if section.GAy is not None or section.GAz is not None:
            raise ValueError(
                f"sections[{k}]: has a shear stiffness, and shear stiffnesses of parts do not add "
                "up; give that of the whole, by with_shear of the composite"
            )
    parts = []  # one for each law of each section: section, law, slice of fibres, torsion constant
    for section in sections:
        constants = [None] * len(section.laws) if section.torsion is None else section.torsion
        for law, part, constant in zip(section.laws, section._law_slices(), constants, strict=True):
            parts.append((section, law, part, constant))
    laws = [law for _, law, part, _ in parts for _ in range(part.stop - part.start)]
    kinds, order, counts = group_by_law(laws)

    def join(name):
        arrays = [getattr(section, name) for section in sections]
        return None if any(array is None for array in arrays) else concatenate(arrays)

    points, cells, own = join("points"), None, join("own")
    if points is not None:
        cells, count = [], 0  # a list, and the number of the points before
        for section in sections:
            cells.append(section.cells.array + count)
            count += section.points.shape[0]
        cells = np.concatenate(cells)[order]
    return cls(
        *(join(name)[order] for name in ("y", "z", "area")),
        kinds,
        counts,
        _sum_torsion_constants(sections, parts, kinds)
        if torsion is None
        else _checked_torsion(torsion, len(kinds)),
        points,
        cells,
        None if own is None else own[order],
        placed=False,
    )


def group_by_law(
    laws: Sequence[Law],
) -> tuple[tuple[Law, ...], Int[np.ndarray, " n_fibre"], tuple[int, ...]]:
    """Group fibres by their laws.

    Args:
        laws: the law of every fibre; the same object for the same law.

    Returns:
        The different laws; the order that sorts the fibres by law; the number of fibres of each.
    """
    kinds = {id(law): law for law in laws}
    numbers = {key: number for number, key in enumerate(kinds)}
    number = np.array([numbers[id(law)] for law in laws])
    counts = tuple(np.bincount(number).tolist())
    return tuple(kinds.values()), np.argsort(number, kind="stable"), counts


def _checked_torsion(torsion, n_law):
    """Return given torsion constants, m4, as [n_law].

    ValueError for a wrong shape, or one that is not positive (NaN if that is traced).
    """
    torsion = checks.as_floats(torsion, "torsion")
    if torsion.shape != (n_law,) and not (n_law == 1 and torsion.shape == ()):
        raise ValueError(
            f"torsion: expected {'a scalar' if n_law == 1 else f'shape ({n_law},)'}, one constant "
            f"per law, got shape {torsion.shape}"
        )
    return nan_if_broken(positive("torsion", torsion)).reshape(n_law)


def _sum_torsion_constants(sections, parts, kinds):
    """Return the sum of torsion constants for each law in `kinds`, [n_law]; None if invalid.

    It is valid for a single section, and for discs and rings about one centre; NaN if this is not
    known. `parts` has (section, law, slice of fibres, torsion constant) of each part.
    """
    if any(constant is None for *_, constant in parts):
        return None
    total = stack_trees([sum(c for _, law, _, c in parts if law is kind) for kind in kinds])
    if len(sections) == 1:
        return total
    alike = are_concentric_circles(
        [
            (s.y[part], s.z[part], s.area[part], None if s.own is None else s.own[part], constant)
            for s, _, part, constant in parts
        ]
    )
    if checks.array_if_known(alike) is None:
        return jnp.where(alike, total, jnp.nan)
    return total if alike else None
