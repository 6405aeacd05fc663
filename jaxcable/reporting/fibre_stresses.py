"""Minimum and maximum stress in the fibres of every element, in every converged increment."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import jax
import numpy as np

from ..analysis.solution import Solution
from ..common import status
from ..common.types import Float
from ..elements import Beams
from ..elements.abilities import POINT_LOADS
from ..elements.bending import gauss_lobatto
from ..elements.element import Element
from ..model.result_parts import end_nodes, present_elements, values_per_group
from ..model.structure import Structure
from ..results import fibre_stress
from ..results.interpolation import (
    acting_point_loads,
    forces_between_point_loads,
    forces_of_point_loads,
)
from . import extremes

# Difference over the largest stress below which fibres have the same stress: above the rounding of
# strains, 1e-10, and below what bending of any interest makes of them.
_SAME = 1e-6


class SectionPoints(NamedTuple):
    """Points of a cross-section at which stresses are evaluated.

    Attributes:
        y, z: coordinates of the points, [n_fibre], m.
        modulus: Young's modulus at each point of a beam with linear laws, [n_fibre], Pa; None for
            other laws and elements.
    """

    y: Float[np.ndarray, " n_fibre"]
    z: Float[np.ndarray, " n_fibre"]
    modulus: Float[np.ndarray, " n_fibre"] | None


class ExtremeStresses(NamedTuple):
    """Extreme stresses of elements in one increment.

    Attributes:
        low, high: [4, n_elem]: minimum and maximum stress of any fibre, Pa; its place along the
            element, from 0 to 1; y and z of its fibre, m. NaN for an inactive element, for places
            along bars and cables, and for fibres where all have the same stress.
        used: utilization, stress / strength of the law, the largest in each element, [n_elem]; NaN
            for laws without a strength.
    """

    low: Float[np.ndarray, "4 n_elem"]
    high: Float[np.ndarray, "4 n_elem"]
    used: Float[np.ndarray, " n_elem"]


class IncrementStresses(NamedTuple):
    """Extreme stresses of all elements in one converged increment.

    Attributes:
        name: name of the phase or case, with the load factor unless that is 1.
        groups: indices of the groups that have stresses.
        stresses: `ExtremeStresses` of the elements of these groups, one group after the other.
    """

    name: str
    groups: list[int]
    stresses: ExtremeStresses


def has_stresses(structure: Structure, solution: Solution) -> bool:
    """Return whether any group can have stresses, which need a section or an area."""
    strain = solution.phases[0].path.strain
    return strain is not None or any(group.area is not None for group in structure.groups)


def increment_stresses(
    structure: Structure, solution: Solution, names: Sequence[str], from_phase: int = 0
) -> list[IncrementStresses]:
    """Return the `IncrementStresses` of every converged increment of some phases.

    Args:
        structure: `Structure`.
        solution: its `Solution`.
        names: names of the phases from the first to the last one that counts.
        from_phase: index of the first phase that counts.

    Returns:
        A list; empty if no element has stresses.
    """
    found, points = [], [stress_points(group) for group in structure.groups]
    for name, phase in list(zip(names, solution.phases, strict=False))[from_phase:]:
        path = phase.path
        stress = _group_stresses(structure, points, phase)
        kept = [k for k, values in enumerate(stress) if values is not None]
        good = np.flatnonzero(np.asarray(path.status) == status.OK).tolist()
        for n in good if kept else ():
            active = jax.tree.map(lambda x, n=n: np.asarray(x)[n], path.present)
            present, parts = present_elements(structure, active), []
            for k in kept:
                loads, own = _point_loads_of_beams(structure, path, k, n), np.asarray(stress[k][n])
                group = structure.groups[k]
                parts.append(_extreme_stresses(group, points[k], own, present[k], loads))
            factor = float(path.load_factor[n])
            called = name if factor == 1 else f"{name}, {factor:.3g}"
            joined = (np.concatenate(x, axis=-1) for x in zip(*parts, strict=True))
            found.append(IncrementStresses(called, kept, ExtremeStresses(*joined)))
    return found


def stress_points(group: Element) -> SectionPoints | None:
    """Return the `SectionPoints` of a group's section; None for a group without fibres.

    Beams with linear laws have the corners of the mesh, hence the edge of the section; all other
    elements have the centers of the fibres.
    """
    section = group.section
    if section is None or not section.n_fibre:
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
    return SectionPoints(y, z, modulus)


def _group_stresses(structure, points, phase):
    """Return the stresses of each group in all increments of a phase, Pa, a list over groups.

    Items are [n_inc, n_elem, n_fibre], of beams [n_inc, n_elem, n_point, n_fibre], or None for a
    group without stresses. `points` are the `SectionPoints` of each group, and `phase` is the
    `PhaseResult`.
    """
    strain = phase.path.strain
    strains = [None] * len(points) if strain is None else values_per_group(structure, strain)
    linear = [p is not None and p.modulus is not None for p in points]
    found = strains
    if not all(linear):
        found = values_per_group(structure, fibre_stress(structure, phase))
    for k, (place, strain) in enumerate(zip(points, strains, strict=True)):
        if linear[k]:
            levers = np.stack([np.ones_like(place.y), place.z, -place.y])
            found[k] = np.asarray(strain, float) @ (levers * place.modulus)
    return found


def _point_loads_of_beams(structure, path, k, n):
    """Return the `acting_point_loads` of a group of beams in an increment, and chord lengths, m.

    None for a group without concentrated loads. `path` is that of the phase, `k` the index of the
    group and `n` that of the increment.
    """
    loads = values_per_group(structure, (path.results or {}).get(POINT_LOADS.name))[k]
    if loads is None:
        return None
    nodes = np.asarray(structure.nodes, float)
    positions = nodes + np.asarray(path.motion, float)[n, : len(nodes), :3]
    ends = positions[end_nodes(structure.groups[k])]
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    return acting_point_loads(np.asarray(loads[n], float)), lengths


def _extreme_stresses(group, points, stress, present, loads):
    """Return the `ExtremeStresses` of a group in one increment.

    Along beams with linear laws the stress of a fibre is a parabola, plus a piecewise linear part
    between concentrated loads; with other laws only the stresses at the integration points count.

    Args:
        group: elements.
        points: their `SectionPoints`, or None.
        stress: [n_elem, n_fibre], or of beams [n_elem, n_point, n_fibre], Pa.
        present: whether each element is active, [n_elem].
        loads: of beams, as of `_point_loads_of_beams`; None without concentrated loads.
    """
    stress = stress.reshape(len(stress), *(1,) * (3 - stress.ndim), *stress.shape[1:])
    stress = np.where(present[:, None, None], stress, np.nan)
    fibres = np.swapaxes(stress, 1, 2)  # [n_elem, n_fibre, n_point]
    is_beam = isinstance(group, Beams)
    places = gauss_lobatto(stress.shape[1])[0] if is_beam else np.array([np.nan])
    if is_beam and group.section.is_elastic:
        found = _extremes_of_linear_fibres(group, points, fibres, places, loads)
    else:
        found = extremes.sampled_extremes(fibres[:, :, None], places[None])
    return ExtremeStresses(
        _governing_fibre(points, found.low, found.low_at, 1),
        _governing_fibre(points, found.high, found.high_at, -1),
        _stress_utilization(group, stress),
    )


def _extremes_of_linear_fibres(group, points, fibres, places, loads):
    """Return the `Extremes` of the stress along each fibre with a linear law, [n_elem, n_fibre].

    Args:
        group: beams.
        points: their `SectionPoints`.
        fibres: stresses at the integration points, [n_elem, n_fibre, n_point], Pa.
        places: integration points, from 0 to 1.
        loads: as of `_point_loads_of_beams`, or None.
    """
    whole = np.array([0.0, 1.0])
    if loads is None:
        return extremes.polynomial_extremes(extremes.fit_parabola(fibres, places), whole)
    loads, length = loads
    levers = np.stack([np.ones_like(points.y), points.z, -points.y]) * points.modulus
    strain_of_force = np.linalg.inv(np.asarray(group.section.stiffness(), float))

    def stress_of(forces):
        """Return stresses [n_elem, n_fibre, n_place] under section forces of the loads."""
        return np.swapaxes(forces[..., [0, 4, 5]] @ strain_of_force @ levers, 1, 2)

    smooth = fibres - stress_of(forces_of_point_loads(loads, length, places[None]))
    ends = extremes.merge_piece_ends(whole, loads[..., 0])
    starts, stops = forces_between_point_loads(loads, length, ends)
    ends = ends[:, None]
    pieces = extremes.split_cubics(extremes.fit_parabola(smooth, places), whole, ends)
    pieces = extremes.add_linear_terms(pieces, stress_of(starts), stress_of(stops))
    return extremes.polynomial_extremes(pieces, ends)


def _governing_fibre(points, values, at, sign):
    """Return the extreme stress of each element with its place, [4, n_elem], over its fibres.

    Rows are stress, Pa, its place along the element, and y and z of its fibre, m, as in
    `ExtremeStresses`.

    Args:
        points: `SectionPoints`, or None.
        values: extreme stress along each fibre, [n_elem, n_fibre], Pa.
        at: its place along the element, [n_elem, n_fibre].
        sign: 1 for the minimum, -1 for the maximum.
    """
    first, each = _index_of_first_smallest(sign * values), np.arange(len(values))
    found = np.full((4, len(values)), np.nan)
    found[:2] = values[each, first], at[each, first]
    if points is not None:
        found[2:] = np.where(first < 0, np.nan, [points.y[first], points.z[first]])
    return np.where(np.isnan(found[0]), np.nan, found)


def _index_of_first_smallest(values):
    """Return the index of the first smallest value in each row; -1 where all are equal.

    Values that differ by less than 1e-6 of the largest count as equal.
    """
    near = _SAME * np.nanmax(np.abs(values), initial=0.0)
    least = values.min(axis=1, keepdims=True)
    first = (values <= least + near).argmax(axis=1)
    return np.where((values <= least + near).all(axis=1), -1, first)


def _stress_utilization(group, stress):
    """Return the largest |stress| / strength in each element, [n_elem]; NaN without a strength.

    `stress` is [n_elem, n_point, n_fibre], Pa.
    """
    low, high = _stress_limits(group)
    limit = np.where(stress < 0, -low, high)
    known = np.isfinite(limit) & (limit > 0)
    ratio = np.where(known, np.abs(stress) / np.where(known, limit, 1.0), np.nan)
    ratio = ratio.reshape(len(stress), -1)
    some = ~np.isnan(ratio).all(axis=1)
    return np.where(some, np.nanmax(np.where(some[:, None], ratio, 0.0), axis=1), np.nan)


def _stress_limits(group):
    """Return the stresses at rupture in compression and in tension, Pa; infinite without rupture.

    Both are [n_elem, 1, 1] for elements with an area, [n_fibre] for a section, or scalars.
    """
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
