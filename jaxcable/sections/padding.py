"""Padding of sections to equal numbers of fibres, so that their elements share one program."""

from __future__ import annotations

from collections.abc import Hashable, Sequence

import jax
import numpy as np

from ..common.tree import copy_with
from ..programs.joining import concatenate
from .section import Section


def padding_key(section: Section) -> Hashable:
    """Return a key, equal for sections that `pad_to_equal` can give equal numbers of fibres."""
    laws = [jax.tree.flatten(law) for law in section.laws]
    # history variables are results of every fibre: the number of such fibres cannot be changed
    counts = section.counts if section.has_memory else len(section.counts)
    missing = tuple(getattr(section, n) is None for n in ("own", "torsion", "GAy", "GAz"))
    return counts, missing, tuple((tree, tuple(map(np.shape, leaves))) for leaves, tree in laws)


def pad_to_equal(sections: Sequence[Section]) -> list[Section]:
    """Return sections with equal numbers of fibres of each law, and with unchanged forces.

    The sections must have the same `padding_key`. Where fibres are missing, the last fibre of a law
    is split into equal parts.
    """
    counts = tuple(max(n) for n in zip(*(section.counts for section in sections), strict=True))
    return [_split_last_fibres(section, counts) for section in sections]


def _split_last_fibres(section: Section, counts: tuple[int, ...]) -> Section:
    """Return a section with `counts` fibres of each law, by splitting each law's last fibre.

    Forces are unchanged. The mesh of the section, which is for pictures, is left out.
    """
    section = copy_with(section, points=None, cells=None, placed=True)
    if section.counts == counts:
        return section
    pieces = [wanted - count + 1 for wanted, count in zip(counts, section.counts, strict=True)]

    def spread(values, shared):
        parts, start = [], 0
        for count, n in zip(section.counts, pieces, strict=True):
            last = values[start + count - 1 : start + count]
            parts += [values[start : start + count - 1], *[last / n if shared else last] * n]
            start += count
        return concatenate(parts)

    moments = None if section.own is None else spread(section.own, True)
    places = {name: spread(getattr(section, name), False) for name in ("y", "z")}
    return copy_with(section, area=spread(section.area, True), own=moments, counts=counts, **places)
