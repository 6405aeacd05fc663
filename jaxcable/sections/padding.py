"""Sections of one kind with equal numbers of fibres, for elements that share a program."""

from __future__ import annotations

from collections.abc import Hashable, Sequence

import jax
import numpy as np

from ..common.tree import copy, joined
from .section import Section


def sort(section: Section) -> Hashable:
    """Key, hashable, that is equal for sections which `evened` can give equal shapes."""
    laws = [jax.tree.flatten(law) for law in section.laws]
    # memory is a result of every fibre: the numbers of fibres with memory cannot be changed
    counts = section.counts if section.remembers else len(section.counts)
    missing = section.own is None, section.torsion is None
    return counts, missing, tuple((tree, tuple(map(np.shape, leaves))) for leaves, tree in laws)


def evened(sections: Sequence[Section]) -> list[Section]:
    """Sections of one `sort`, padded to equal numbers of fibres; without meshes for pictures."""
    counts = tuple(max(n) for n in zip(*(section.counts for section in sections), strict=True))
    return [_padded(section, counts) for section in sections]


def _padded(section, counts):
    """The section with `counts` fibres of each law: its last fibre is split into equal parts."""
    section = copy(section, points=None, cells=None, placed=True)
    if section.counts == counts:
        return section
    pieces = [wanted - count + 1 for wanted, count in zip(counts, section.counts, strict=True)]

    def spread(values, shared):
        parts, start = [], 0
        for count, n in zip(section.counts, pieces, strict=True):
            last = values[start + count - 1 : start + count]
            parts += [values[start : start + count - 1], *[last / n if shared else last] * n]
            start += count
        return joined(parts)

    moments = None if section.own is None else spread(section.own, True)
    places = {name: spread(getattr(section, name), False) for name in ("y", "z")}
    return copy(section, area=spread(section.area, True), own=moments, counts=counts, **places)
