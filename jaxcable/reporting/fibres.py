"""Extreme stresses of the fibres of every element, in every converged increment."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..analysis.phase_results import Path
from ..analysis.solution import Solution
from ..common import status
from ..common.types import Bool, Float
from ..elements import Beams
from ..elements.bending import lobatto
from ..elements.element import Element
from ..model.parts import per_group, there
from ..model.structure import Structure
from ..results import fibre_stress
from . import extremes

_SAME = 1e-6  # of the largest stress: fibres whose stresses differ by less have the same


class Points(NamedTuple):
    """Points of a section.

    Attributes:
        y, z: places, [n_fibre], m.
        modulus: of the linear laws of a beam, [n_fibre], Pa; None for other laws and elements.
    """

    y: Float[np.ndarray, " n_fibre"]
    z: Float[np.ndarray, " n_fibre"]
    modulus: Float[np.ndarray, " n_fibre"] | None


class Stresses(NamedTuple):
    """Extreme stresses of elements in one increment.

    Attributes:
        low, high: lowest and highest stress of any fibre, Pa, where along the element it is, from 0
            to 1, and the y and z of its fibre, m, [4, n_elem]; NaN for an element that is not
            there, for places along bars and cables, and for fibres where all have the same stress.
        used: largest stress over the strength of its law, [n_elem]; NaN if no law ends.
    """

    low: Float[np.ndarray, "4 n_elem"]
    high: Float[np.ndarray, "4 n_elem"]
    used: Float[np.ndarray, " n_elem"]


class Instant(NamedTuple):
    """One converged increment.

    Attributes:
        name: of its phase or case, with the load factor unless it is the end.
        groups: numbers of the groups that have stresses.
        stresses: of their elements, one group after the other.
    """

    name: str
    groups: list[int]
    stresses: Stresses


def stressed(structure: Structure, solution: Solution) -> bool:
    """Whether any group can have stresses; groups that have a stiffness only have none."""
    strain = solution.phases[0].path.strain
    return strain is not None or any(group.area is not None for group in structure.groups)


def instants(
    structure: Structure,
    solution: Solution,
    names: Sequence[str],
    from_phase: int = 0,
) -> list[Instant]:
    """The `Instant` of every converged increment of the phases `names`, from one of them on.

    There is none where no element tells stresses.

    Args:
        structure, solution: of an analysis.
        names: of the first phases.
        from_phase: number of the first phase that counts, from 0.
    """
    found, points = [], [points_of(group) for group in structure.groups]
    for number in range(from_phase, len(names)):
        name, phase = names[number], solution.phases[number]
        path = phase.path
        stress = _stress(structure, points, phase)
        kept = [k for k, values in enumerate(stress) if values is not None]
        good = np.flatnonzero(np.asarray(path.status) == status.OK).tolist()
        for n in good if kept else ():
            own = zip(structure.groups, points, stress, _there(structure, path, n), strict=True)
            parts = [
                _extremes(group, place, np.asarray(values[n], float), present)
                for group, place, values, present in own
                if values is not None
            ]
            factor = float(path.load_factor[n])
            called = name if factor == 1 else f"{name}, {factor:.3g}"
            joined = (np.concatenate(x, axis=-1) for x in zip(*parts, strict=True))
            found.append(Instant(called, kept, Stresses(*joined)))
    return found


def points_of(group: Element) -> Points | None:
    """The `Points` of a section at which stresses are told; None for a group without a section.

    Of beams with linear laws these are the corners of the mesh, hence the edge of the section, of
    all others the fibres.
    """
    section = group.section
    if section is None:
        return None
    y, z, modulus = np.asarray(section.y, float), np.asarray(section.z, float), None
    if isinstance(group, Beams) and section.is_elastic:
        modulus = np.repeat([float(law.modulus) for law in section.laws], section.counts)
        if section.cells is not None:
            law = np.repeat(np.arange(len(section.laws)), section.counts)
            cells = section.cells.array
            pairs = np.stack([np.repeat(law, cells.shape[1]), cells.ravel()], axis=1)
            pairs, first = np.unique(pairs, axis=0, return_index=True)
            y, z = np.asarray(section.points, float)[pairs[:, 1]].T
            modulus = modulus[first // cells.shape[1]]
    return Points(y, z, modulus)


def _stress(structure, points, phase):
    """Stresses of every group, or None: beams [n_inc, n_elem, n_point, n_fibre]; a list."""
    strain = phase.path.strain
    strains = [None] * len(points) if strain is None else per_group(structure, strain)
    linear = [p is not None and p.modulus is not None for p in points]
    if all(linear):
        found = strains
    else:
        found = per_group(structure, fibre_stress(structure, phase))
    for k, (place, strain) in enumerate(zip(points, strains, strict=True)):
        if linear[k]:
            levers = np.stack([np.ones_like(place.y), place.z, -place.y])
            found[k] = np.asarray(strain, float) @ (levers * place.modulus)
    return found


def _there(structure: Structure, path: Path, k: int) -> list[Bool[np.ndarray, " n_elem"]]:
    """Which elements are there in increment k, a list with [n_elem] bool for every group."""
    if path.present is None:
        return there(structure, None)
    return [np.asarray(found)[k] > 0 for found in per_group(structure, path.present)]


def _extremes(group, points, stress, present):
    """`Stresses` of a group from stresses [n_elem], with axes [n_fibre] or [n_point, n_fibre].

    Along beams of linear laws they are parabolas; of other laws those at the integration points
    count.
    """
    stress = stress.reshape(len(stress), *(1,) * (3 - stress.ndim), *stress.shape[1:])
    stress = np.where(present[:, None, None], stress, np.nan)
    fibres = np.swapaxes(stress, 1, 2)  # [n_elem, n_fibre, n_point]
    if isinstance(group, Beams):
        places = lobatto(stress.shape[1])[0]
        if group.section.is_elastic:
            ends = np.array([0.0, 1.0])
            found = extremes.along(extremes.parabola(fibres, places), ends)
        else:
            found = extremes.among(fibres[:, :, None], places[None])
    else:
        found = extremes.among(fibres[:, :, None], np.full((1, 1), np.nan))
    low, high = (found.low, found.low_at, 1), (found.high, found.high_at, -1)
    return Stresses(_fibre(points, *low), _fibre(points, *high), _used(group, stress))


def _fibre(points, values, at, sign):
    """The smallest of `sign` times the values [n_elem, n_fibre], and where; see `Stresses`."""
    first, each = _first(sign * values), np.arange(len(values))
    found = np.full((4, len(values)), np.nan)
    found[:2] = values[each, first], at[each, first]
    if points is not None:
        found[2:] = np.where(first < 0, np.nan, [points.y[first], points.z[first]])
    return np.where(np.isnan(found[0]), np.nan, found)


def _first(values):
    """Number of the first of the smallest values of every line; -1 where all are the same."""
    near = _SAME * np.nanmax(np.abs(values), initial=0.0)
    least = values.min(axis=1, keepdims=True)
    first = (values <= least + near).argmax(axis=1)
    return np.where((values <= least + near).all(axis=1), -1, first)


def _used(group, stress):
    """Largest stress over strength [n_elem] of stresses [n_elem, n_point, n_fibre]; NaN if none."""
    low, high = _limits(group)
    limit = np.where(stress < 0, -low, high)
    known = np.isfinite(limit) & (limit > 0)
    share = np.where(known, np.abs(stress) / np.where(known, limit, 1.0), np.nan)
    share = share.reshape(len(stress), -1)
    some = ~np.isnan(share).all(axis=1)
    return np.where(some, np.nanmax(np.where(some[:, None], share, 0.0), axis=1), np.nan)


def _limits(group):
    """Smallest and largest stress of laws that end: scalars, [n_elem, 1, 1] or [n_fibre], Pa."""
    none = np.array(-np.inf), np.array(np.inf)
    if not group.has_rupture:
        return none
    if group.section is None:
        if group.area is None:
            return none
        limits = [np.asarray(force) / np.asarray(group.area) for force in group.capacity()]
        return [limit.reshape(-1, 1, 1) for limit in limits]
    pairs = [law.capacity if law.has_rupture else none for law in group.section.laws]
    return [np.repeat([float(pair[k]) for pair in pairs], group.section.counts) for k in (0, 1)]
