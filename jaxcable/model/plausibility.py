"""Warnings of legal input that is most likely not meant: huge strains, loads without effect.

A number does not show its unit, but a ratio without units can: an axial stiffness in kN makes a
strain of 200 % of a strain of 0.2 %. All checks run in NumPy on the host, on known values; traced
values are not checked. Each function issues what it finds as an `InputWarning`.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeAlias

import jax
import numpy as np

from ..common import checks, status
from ..common.types import ArrayLike, Bool, Float
from ..elements.element import Element
from ..sections import LinearSection
from .supports import FixedDofs

MAX_LENGTH_RATIO = 100.0
"""Ratio of an unstressed length to the distance of its nodes beyond which units are in doubt."""

MIN_UNIT_WEIGHT = 100.0
"""Weight over volume, N/m3, below which units are in doubt; foams have 150 and more, and steel,
whose weight is 77e3 N/m3, has 77 in kN/m3."""

DOUBTFUL_SPECIFIC_STIFFNESS = 1e9, 1e11
"""Range of EA over the weight per length, m, in which units are in doubt: steel has 2.7e6, carbon
fibre 2e7; with EA in N and the weight in kN/m, or with both in N and mm, a thousand times more.
Members that are meant to be rigid have more than that."""

DOUBTFUL_MODULI = (100.0, 240.0), (1e5, 2.4e5)
"""Ranges of moduli, Pa, in which units are in doubt: those of cables and steel in GPa and in MPa.
Rubber has 1e6 and more; problems without units have small numbers of any size."""

STATE_UNITS = 'a scene file may state other units, such as "units": "kN, m"'
"""End of messages on doubtful units."""

AXIS_TOLERANCE = 1e-6
"""Distance of a beam's axis from its centroid, over the section's size, beyond rounding."""

ZERO_BENDING = 1e-12
"""Bending stiffness over EA and the square of the section's size that is nothing but rounding."""

FixedMask: TypeAlias = 'Bool[np.ndarray, "n_row n_freedom"]'
"""True where a freedom is held, [n_row, 3 or 6]."""
Positions: TypeAlias = 'Float[np.ndarray, "n_node 3"]'
NamedGroups: TypeAlias = Sequence[tuple[str, Element]]
"""Pairs of (key in the elements as text, group)."""


def issues_warnings(judge: Callable[..., Iterator[str]]) -> Callable[..., None]:
    """Decorate a generator of messages: the function issues each of them as `InputWarning`.

    It returns None and takes positional arguments only.
    """

    @functools.wraps(judge)
    def warn(*args):
        with np.errstate(all="ignore"):  # numbers may be of any size
            texts = list(judge(*args))
        for text in texts:
            checks.warn_user(text)

    return warn


def warn_if_unstable(solution: Any) -> None:
    """Warn of phases of a `Solution` that end in an unstable equilibrium, unless it is traced."""
    if isinstance(solution.stable, jax.core.Tracer):
        return
    codes, each_stable = map(np.asarray, solution.phases.status_and_stability)
    found = np.flatnonzero((codes == status.OK) & ~each_stable).tolist()
    if not found:
        return
    several = len(found) > 1
    which = ", ".join(f"phases[{number}]" for number in found)
    numbers = ", ".join(str(number + 1) for number in found)
    checks.warn_user(
        f"{'phases' if several else 'phase'} {numbers} ({which}) {'end' if several else 'ends'} in "
        "an unstable equilibrium: pushed aside, the structure does not come back; its tangent "
        "stiffness has an eigenvalue below zero (trace_path shows the load factor at which that "
        "began), or of zero where a part turns or moves freely; stiffness.modes(structure, "
        "solution, n=1).shapes shows what moves",
        checks.UnstableWarning,
    )


def largest_movement(solution: Any, held: FixedDofs) -> tuple[int, float, float]:
    """Return (node, distance, extent) for the node of a `Solution` that has moved farthest.

    The distance counts beyond what supports account for, because somebody has moved those: `held`
    are the degrees of freedom that they hold. A support that is held in part counts along the
    directions that it holds; one that is rotated by an angle carries nodes in a distance of the
    extent along, by ``2 extent sin(angle / 2)``. The extent is the largest side of the bounding box
    of the nodes before they moved. Distances are in m; the node is 0 if no number is finite.
    """
    moved, now = map(np.asarray, (solution.displacement, solution.positions))
    sizes, extent = np.linalg.norm(moved, axis=1), float(np.ptp(now - moved, axis=0).max())
    node = int(np.nanargmax(sizes)) if np.isfinite(sizes).any() else 0
    turned = [] if solution.rotation is None else [np.asarray(solution.rotation)[:, 1:]]
    directions = np.eye(3) if held.axes is None else held.axes.array[: len(sizes)].swapaxes(1, 2)
    along = np.stack([moved, *(2 * extent * vectors for vectors in turned)], axis=1) @ directions
    along = np.where(held.array[: len(sizes)].reshape(along.shape), along, 0.0)
    of_supports = np.linalg.norm(along, axis=2).max(axis=0, initial=0.0).sum()
    return node, float(sizes[node] - of_supports), extent


@issues_warnings
def warn_of_collapse(solution: Any, jacked: bool, held: FixedDofs) -> Iterator[str]:
    """Warn of a node that has moved by the extent of the structure, unless numbers are traced.

    `jacked` says whether prescribed forces (jacks) draw nodes together; without, the limit is 1.5
    times the extent, because slender rods may be bent into circles. `held` are the degrees of
    freedom that supports hold.
    """
    if any(isinstance(x, jax.core.Tracer) for x in (solution.status, solution.positions)):
        return
    node, moved, extent = largest_movement(solution, held)
    if moved > (1.0 if jacked else 1.5) * extent > 0:
        yield (
            f"node {node} has moved by {moved:.4g} m, and the extent of the structure is "
            f"{extent:.4g} m: it has fallen over, or hangs; are all parts held, and are forces and "
            "lengths in N and m?"
        )


@issues_warnings
def warn_of_lost_precision(nodes: Float[ArrayLike, "n_node 3"]) -> Iterator[str]:
    """Warn of nodes in double precision if JAX works in single precision."""
    given = getattr(nodes, "dtype", None)
    if given == np.float64 and jax.dtypes.canonicalize_dtype(np.float64) != np.float64:
        yield (
            "nodes: float64, but jax works in float32 here and tensions keep a few digits only; "
            'put jax.config.update("jax_enable_x64", True) at the start of the program, or give '
            "nodes.astype(numpy.float32) to say that float32 is meant"
        )


@issues_warnings
def warn_of_degrees(name: str, rotations: Float[np.ndarray, "... 3"]) -> Iterator[str]:
    """Warn of rotation vectors longer than pi, which are most likely in degrees.

    No support of a structure turns so far in a phase, and no rotation vector needs to be longer:
    one of the opposite direction leads to the same orientation. `name` is the argument, for the
    message, and `rotations` are in rad.
    """
    angle = np.sqrt(np.sum(np.square(rotations), axis=-1)).reshape(-1)
    wrong = angle > np.pi
    if wrong.any():
        k = int(wrong.argmax())
        at = "" if rotations.ndim == 1 else f"[{k}]"
        yield (
            f"{name}{at}: a rotation of {angle[k]:.6g} rad is {np.degrees(angle[k]):.6g} "
            "degrees; is it meant in degrees? Rotations are in radians: give numpy.radians(...)"
        )


@issues_warnings
def warn_of_coincident_nodes(
    nodes: Positions, touched: Bool[np.ndarray, " n_node"], fixed: FixedMask
) -> Iterator[str]:
    """Warn of two nodes at the same position with different numbers, unless both are held.

    Args:
        nodes: initial positions, [n_node, 3], NumPy.
        touched: True where an element touches a node, [n_node].
        fixed: True where a freedom is held, [n_row, 3 or 6].
    """
    key = nodes[:, 0] + math.pi * nodes[:, 1] + math.e * nodes[:, 2]  # equal for equal positions
    order = np.argsort(key, kind="stable")
    first, second = order[:-1], order[1:]
    same = (nodes[first] == nodes[second]).all(axis=1)
    if not same.any():
        return
    free: Bool[ArrayLike, " n_node"] = ~fixed[: len(nodes), :3].all(axis=1)
    same &= (free[first] | free[second]) & touched[first] & touched[second]
    if same.any():
        k = int(same.argmax())
        yield (
            f"nodes[{first[k]}] and nodes[{second[k]}] are at the same place but not joined; if "
            "they are one node, use one number for it in links; if not, ignore this warning"
        )


@issues_warnings
def warn_of_dimensions(group: Element, where: str, nodes: Positions) -> Iterator[str]:
    """Warn of unstressed lengths, areas, weights or sections of a group that suggest wrong units.

    Args:
        group: element group.
        where: its key in the elements, as text.
        nodes: initial positions, [n_node, 3], NumPy.
    """
    rest, area = array_or_none(group.rest_length), array_or_none(group.area)
    if rest is not None:
        yield from describe_unlikely_length(
            f"elements{where}.rest_length", rest, lengths_over_nodes(group, nodes)
        )
    if area is not None:
        text = "thicker than the element is long; is the area in m2?"
        yield from describe_first_wrong(
            f"elements{where}.area", area, area > lengths_over_nodes(group, nodes) ** 2, text
        )
    weight = array_or_none(group.weight)
    if weight is not None and area is not None:
        light = (weight > 0) & (weight < MIN_UNIT_WEIGHT * area)
        text = (
            f"less than {MIN_UNIT_WEIGHT:g} N/m3 with its area, lighter than any solid; is the "
            f"weight in N/m, and the area in m2? {STATE_UNITS}"
        )
        yield from describe_first_wrong(f"elements{where}.weight", weight, light, text)
    yield from _describe_unlikely_stiffness(group, where, weight if area is None else None)
    if group.rotates and isinstance(group.section, LinearSection):
        yield from _describe_thick_section(f"elements{where}.section", group.section, nodes)
    elif group.rotates and group.section is not None:
        section = group.section
        fibres = [array_or_none(section.y), array_or_none(section.z)]
        size = 0.0 if any(f is None for f in fibres) else max(np.ptp(f) for f in fibres)
        if size > np.ptp(nodes, axis=0).max():
            yield (
                f"elements{where}.section: {size:.3g} m from fibre to fibre is more than the size "
                "of the structure; are its coordinates in m?"
            )
        yield from _describe_axis_off_centroid(f"elements{where}.section", section)


@issues_warnings
def warn_of_zero_bending(named: NamedGroups, fixed: FixedMask) -> Iterator[str]:
    """Warn of beams whose section does not resist bending.

    No error: under tension a beam without bending stiffness can have an equilibrium, as a cable.

    Args:
        named: pairs of (key in the elements as text, group).
        fixed: True where a freedom of a node is held, [n_node, 3 or 6].
    """
    plane = bool(fixed[:, :3].all(axis=0).any())  # no node leaves it
    for where, group in named:
        if group.rotates and not isinstance(group.section, LinearSection | None):
            yield from _describe_zero_bending(f"elements{where}.section", group.section, plane)


def _describe_unlikely_stiffness(group, where, weight):
    """Yield messages on a stiffness that no material has, by its modulus, or by EA over the weight.

    `where` is the key of the group in the elements, as text; `weight`, [n_elem], N/m, is that of a
    group without an area, else None.
    """
    stiffness = array_or_none(group.linear_axial_stiffness())
    if weight is not None and stiffness is not None and weight.shape == stiffness.shape:
        low, high = (bound * weight for bound in DOUBTFUL_SPECIFIC_STIFFNESS)
        stiff = (weight > 0) & (stiffness > low) & (stiffness < high)
        text = (
            "the stiffness EA is more than 1e9 m times this, and of steel 2.7e6 m; are EA in N, "
            f"the weight in N/m, and lengths in m? {STATE_UNITS}"
        )
        yield from describe_first_wrong(f"elements{where}.weight", weight, stiff, text)
    area, moduli = array_or_none(group.area), []
    if area is not None and stiffness is not None and area.shape == stiffness.shape:
        moduli.append(("law", np.asarray((stiffness / area)[:1])))
    if group.section is not None and not isinstance(group.section, LinearSection):
        moduli += [("section.laws", array_or_none(law.modulus)) for law in group.section.laws]
    for name, modulus in moduli:
        if modulus is not None and any(
            np.all((modulus >= low) & (modulus <= high)) for low, high in DOUBTFUL_MODULI
        ):
            yield (
                f"elements{where}.{name}: its modulus is {float(np.ravel(modulus)[0]):.6g} Pa, "
                f"softer than rubber; is it in MPa or GPa? {STATE_UNITS}, which makes it kN/m2"
            )
            return


def array_or_none(value):
    """Return `value` as a NumPy array; None if it is None or being traced by jax."""
    return checks.array_if_known(value)


def drawn_or_given_lengths(group: Element, nodes: Positions) -> Float[np.ndarray, " n_elem"]:
    """Return the unstressed lengths given for a group, else those over its nodes, [n_elem], m."""
    given, drawn = array_or_none(group.rest_length), lengths_over_nodes(group, nodes)
    return drawn if given is None else np.broadcast_to(given, len(drawn))


def lengths_over_nodes(group, nodes):
    """Return the initial length of each element, the sum from node to node, [n_elem], m, NumPy.

    `nodes` are initial positions, [n_node, 3], m.
    """
    return np.linalg.norm(np.diff(nodes[group.links.array], axis=1), axis=2).sum(axis=1)


def _describe_thick_section(label, section, nodes):
    """Yield a message if the radius of gyration of a `LinearSection` exceeds the structure's size.

    `label` is how a user writes the section; `nodes` are initial positions, [n_node, 3], m.
    """
    known = [array_or_none(v) for v in (section.EA, section.EIy, section.EIz)]
    if all(v is not None for v in known):
        radius = float(np.sqrt(max(known[1:]) / known[0]))
        if radius > np.ptp(nodes, axis=0).max():
            yield (
                f"{label}: the radius of gyration, the root of EI / EA, is {radius:.3g} m, more "
                "than the size of the structure; is EI in N m2, and EA in N?"
            )


def _describe_axis_off_centroid(label, section):
    """Yield a message if a beam's axis, the origin of its section, lies off the section's centroid.

    Nothing for a section whose eccentricity is meant (``placed``), or with traced numbers. `label`
    is how a user writes it.
    """
    if section.placed or any(array_or_none(leaf) is None for leaf in jax.tree.leaves(section)):
        return
    off = np.array([float(v) for v in section.centroid()])
    size = max(np.ptp(section.y), np.ptp(section.z), float(section.total_area) ** 0.5)
    if np.abs(off).max() > AXIS_TOLERANCE * size:
        yield (
            f"{label}: its centroid is at y = {off[0]:.6g} m, z = {off[1]:.6g} m, away from the "
            "axis of the beam (the origin of its points or parts); take section.centred() to put "
            "the axis into the centroid, or section.shifted() if the eccentricity is meant"
        )


def _describe_zero_bending(label, section, plane):
    """Yield a message if a section has no bending stiffness about an axis, or nothing.

    With `plane`, the structure is plane, and only a section without any bending stiffness counts.
    `label` is how a user writes it.
    """
    moduli = [array_or_none(law.modulus) for law in section.laws]
    if any(part is None for part in (*moduli, *map(array_or_none, jax.tree.leaves(section)))):
        return
    area, y, z = (np.asarray(v, float) for v in (section.area, section.y, section.z))
    stiffness = np.repeat(np.array(moduli, float), section.counts) * area
    places = np.stack([z, y])
    off = places - (places @ stiffness / stiffness.sum())[:, None]
    bending = (stiffness * off) @ off.T  # EIy, EIz and EIyz about the centroid
    if section.own is not None and section.is_elastic:  # see `Section.own`
        z2, y2, yz = (stiffness / area) @ np.asarray(section.own, float)
        bending += [[z2, yz], [yz, y2]]
    nothing = ZERO_BENDING * stiffness.sum() * np.abs(places).max() ** 2
    least, most = np.linalg.eigvalsh(bending)
    layers = section.own is not None  # of a mesh that somebody has made for bending in a plane
    if not (most if plane or layers else least) > nothing:
        shape = "one axis, because its fibres lie on one line"
        if not most > nothing:
            shape = "all axes, because it is a single fibre"
        own = "give `own` (second moments of z^2, y^2 and yz of each fibre, m4), or more fibres"
        yield (
            f"{label}: its bending stiffness EI is zero about {shape}; "
            f"{own if section.is_elastic else 'give more fibres'}, or use Bars for elements that "
            "do not bend"
        )


def describe_unlikely_length(label, rest, chord):
    """Yield a message if an unstressed length and the distance of its nodes differ 100 times.

    Args:
        label: how a user writes the lengths, for the message.
        rest: unstressed lengths, [n_elem], m.
        chord: lengths over the nodes, [n_elem], m.
    """
    wrong = (rest > MAX_LENGTH_RATIO * chord) | (rest * MAX_LENGTH_RATIO < chord)
    texts = [
        f"its nodes are {length:.3g} m apart; is the length in m?" for length in chord[wrong][:1]
    ]
    yield from describe_first_wrong(label, rest, wrong, *texts)


def describe_first_wrong(label, value, wrong, text=""):
    """Yield the message ``label[k] = value: text`` for the first True in `wrong`, or nothing."""
    if wrong.any():
        k = int(wrong.argmax())
        yield (f"{label}[{k}] = {value[k]:.6g}: {text}")
