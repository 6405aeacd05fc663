"""Warnings of legal input that is most likely not meant: huge strains, loads without effect.

A number does not show its unit, but a ratio without units can: an axial stiffness in kN makes a
strain of 200 % of a strain of 0.2 %. All checks run in NumPy on the host, on known values; traced
values are not checked. Each function issues what it finds as an `InputWarning`.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeAlias

import jax
import numpy as np

from ..common import checks, status
from ..common.types import ArrayLike, Bool, Float
from ..elements.element import Element
from ..elements.stated import Stated

STRAIN = 0.15
"""Stated strain above which no cable has a constant stiffness; steel breaks at 0.02 to 0.04."""

LOADED = 0.5
"""Limit of strains from loads; larger, because a batch or a search may contain large loads."""

FAR = 100.0
"""Ratio of an unstressed length to the distance of its nodes beyond which units are in doubt."""

LIGHT = 50.0
"""Weight over volume, N/m3, below which units are in doubt; foams have 100 and more."""

OFF_AXIS = 1e-6
"""Distance of a beam's axis from its centroid, over the section's size, beyond rounding."""

STIFFLESS = 1e-12
"""Bending stiffness over EA and the square of the section's size that is nothing but rounding."""

Held: TypeAlias = 'Bool[np.ndarray, "n_row n_freedom"]'
"""True where a freedom is held, [n_row, 3 or 6]."""
Positions: TypeAlias = 'Float[np.ndarray, "n_node 3"]'
Named: TypeAlias = Sequence[tuple[str, Element]]
"""Pairs of (key in the elements as text, group)."""

_UNITS = "are stiffness and forces in N, areas in m2, moduli in Pa?"


def warns(judge: Callable[..., Iterator[str]]) -> Callable[..., None]:
    """Wrap a generator of texts as a function that issues these texts as warnings."""

    @functools.wraps(judge)
    def warn(*args):
        with np.errstate(all="ignore"):  # numbers may be of any size
            texts = list(judge(*args))
        for text in texts:
            checks.warn_user(text)

    return warn


def stability(solution: Any) -> None:
    """Warn of phases that end in an unstable equilibrium, unless they are being traced."""
    if isinstance(solution.stable, jax.core.Tracer):
        return
    for number, (code, stable) in enumerate(zip(*solution.phases.verdicts, strict=True)):
        if int(code) == status.OK and not bool(stable):
            checks.warn_user(
                f"phases[{number}] ends in an unstable equilibrium: its tangent stiffness has a "
                "negative eigenvalue, and the structure will not stay there; trace_path shows "
                "where it became so",
                checks.UnstableWarning,
            )


@warns
def precision(nodes: Float[ArrayLike, "n_node 3"]) -> Iterator[str]:
    """Warn of nodes in double precision if JAX works in single precision."""
    given = getattr(nodes, "dtype", None)
    if given == np.float64 and jax.dtypes.canonicalize_dtype(np.float64) != np.float64:
        yield (
            "nodes: float64, but jax works in float32 here and tensions keep a few digits only; "
            'put jax.config.update("jax_enable_x64", True) at the start of the program, or give '
            "nodes.astype(numpy.float32) to say that float32 is meant"
        )


@warns
def turned(name: str, rotations: Float[np.ndarray, "... 3"]) -> Iterator[str]:
    """Warn of rotation vectors of more than half a turn, which are most likely in degrees.

    No support of a structure turns so far in a phase, and no rotation vector needs to be longer:
    one of the opposite direction leads to the same orientation.
    """
    angle = np.sqrt(np.sum(np.square(rotations), axis=-1)).reshape(-1)
    wrong = angle > np.pi
    if wrong.any():
        k = int(wrong.argmax())
        at = "" if rotations.ndim == 1 else f"[{k}]"
        yield (
            f"{name}{at}: a turn of {angle[k]:.6g} rad, which is {np.degrees(angle[k]):.6g} "
            "degrees; rotations are in radians: numpy.radians(...) of degrees"
        )


@warns
def places(nodes: Positions, touched: Bool[np.ndarray, " n_node"], fixed: Held) -> Iterator[str]:
    """Warn of two nodes at the same position that are not joined, unless both are held.

    Args:
        nodes: initial positions, [n_node, 3], NumPy.
        touched: True where an element touches a node, [n_node].
        fixed: True where a freedom is held, [n_row, 3 or 6].
    """
    key = nodes[:, 0] + np.pi * nodes[:, 1] + np.e * nodes[:, 2]  # equal for equal positions
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
            f"nodes[{second[k]}]: at the place of nodes[{first[k]}] and not joined to it; if they "
            "are one node, name it by one number in links"
        )


@warns
def members(group: Element, where: str, nodes: Positions) -> Iterator[str]:
    """Warn of unstressed lengths and cross-sections that do not fit the positions of the nodes.

    Args:
        group: element group.
        where: its key in the elements, as text.
        nodes: initial positions, [n_node, 3], NumPy.
    """
    rest, area = _there(group.rest_length), _there(group.area)
    if rest is not None:
        yield from _judge_lengths(f"elements{where}.rest_length", rest, _chords(group, nodes))
    if area is not None:
        text = "thicker than the element is long; is it in m2?"
        yield from _first(f"elements{where}.area", area, area > _chords(group, nodes) ** 2, text)
    weight = _there(group.weight)
    if weight is not None and area is not None:
        light = (weight > 0) & (weight < LIGHT * area)
        text = "of a volume that weighs less than any solid; is it in N/m, and the area in m2?"
        yield from _first(f"elements{where}.weight", weight, light, text)
    if group.rotates and group.section is not None:
        section = group.section
        fibres = [_there(section.y), _there(section.z)]
        size = 0.0 if any(f is None for f in fibres) else max(np.ptp(f) for f in fibres)
        if size > np.ptp(nodes, axis=0).max():
            yield (
                f"elements{where}.section: fibres {size:.3g} m apart, further than all nodes; is "
                "it in m?"
            )
        yield from _judge_axis(f"elements{where}.section", section)


@warns
def bending(named: Named, fixed: Held) -> Iterator[str]:
    """Warn of beams whose section does not resist bending.

    No error: under tension a beam without bending stiffness can have an equilibrium, as a cable.

    Args:
        named: pairs of (key in the elements as text, group).
        fixed: True where a freedom of a node is held, [n_node, 3 or 6].
    """
    plane = bool(fixed[:, :3].all(axis=0).any())  # no node leaves it
    for where, group in named:
        if group.rotates and group.section is not None:
            yield from _judge_bending(f"elements{where}.section", group.section, plane)


@warns
def prestress(
    name: str, stated: Stated, group: Element, where: str, nodes: Float[ArrayLike, "n_node 3"]
) -> Iterator[str]:
    """Warn of a statement of prestress that no cable can bear.

    Args:
        name: of the statement, as in `Phase`.
        stated: `Stated` for the group.
        group: element group.
        where: its key in the elements, as text.
        nodes: initial positions of the structure, [n_node, 3].
    """
    value, nodes = _there(stated.values), _there(nodes)
    if value is None or nodes is None:
        return
    value = value if stated.chosen is None else np.where(stated.chosen, value, np.nan)
    label, stiffness = name + where, axial_stiffness(group)
    if name in ("pretension", "jacking", "force_density"):
        force = value * _chords(group, nodes) if name == "force_density" else value
        strength = _there(group.strength)
        if strength is not None:
            text = "more than the strength of the element"
            yield from _first(label, value, force > strength, text)
        if stiffness is not None:
            yield from _judge_strain(label, value, force / stiffness, _UNITS)
    elif name == "prestrain":
        strain = np.maximum(value, 0.0) if group.tension_only else value  # slack is no strain
        yield from _judge_strain(label, value, strain, "it is a ratio, not a percentage")
    elif name == "temperature" and _there(group.expansion) is not None:
        strain = value * _there(group.expansion)
        yield from _judge_strain(label, value, strain, "is expansion in 1/K?")
    elif name == "rest_length":
        yield from _judge_lengths(label, value, _chords(group, nodes))


@warns
def loading(
    number: int,
    loads: Sequence[Any],
    fixed: Held,
    groups: Sequence[Element],
    alone: bool,
    waits: Held | None = None,
) -> Iterator[str]:
    """Warn of nodal loads that only what holds still takes, or that their elements cannot bear.

    The elements at a free node balance its load. Hence at least one of them has a strain of the
    load over the sum of their axial stiffnesses, or more.

    Args:
        number: of the phase, from 0.
        loads: the nodal loads of the phase, a list.
        fixed: True where a freedom is held, [n_row, 3 or 6].
        groups: the element groups of the structure.
        alone: whether the phase has no other input than these loads.
        waits: True where a freedom is held because no element that is there touches it,
            [n_row, 3 or 6]; None if all elements are always there.
    """
    known = [load.at_nodes() for load in loads]
    forces = [None if pair is None else _there(pair[1]) for pair in known]
    if not loads or any(f is None for f in forces):
        return
    total = np.zeros((len(fixed), 3))
    for (named, _), force in zip(known, forces, strict=True):
        nodes, each = named.array, np.full((len(named), 3), force)
        for axis in np.flatnonzero(each.any(axis=0)):
            total[:, axis] += np.bincount(nodes, each[:, axis], len(fixed))
    acts = total != 0
    alone = alone and not any(load.has_moments for load in loads)
    if alone and acts.any() and not (acts & ~fixed[:, :3]).any():
        yield (
            f"loads of phases[{number}]: all of them act on supports (node "
            f"{int(acts.any(axis=1).argmax())}) and strain nothing; look at the numbers of the "
            "nodes, which start at 0, and at the supports"
        )
    elif alone and waits is not None and acts.any() and not (acts & ~(fixed | waits)[:, :3]).any():
        node = int((acts & waits[:, :3]).any(axis=1).argmax())
        yield (
            f"loads of phases[{number}]: all of them act on supports, or on nodes that no element "
            f"touches in this phase (node {node}); these act when an element is added there"
        )
    if any(group.rotates for group in groups):  # beams bend
        return
    size = np.sqrt(np.sum(total**2, axis=1))
    given = [axial_stiffness(group) for group in groups]
    known = [np.array([np.inf]) if along is None else along for along in given]
    if size.max() <= LOADED * min(along.min() for along in known):
        return
    stiffness = np.zeros(len(fixed))
    for group, along in zip(groups, known, strict=True):
        ends = group.links.array
        passing = 1 if ends.shape[1] == 2 else 2  # two pieces of a sliding cable meet at its nodes
        along = np.broadcast_to(passing * along[:, None], ends.shape)
        stiffness += np.bincount(ends.ravel(), along.ravel(), len(fixed))
    high = ~fixed.any(axis=1) & (size > LOADED * stiffness) & np.isfinite(size)
    if high.any():
        node = int(high.argmax())
        yield (
            f"loads of phases[{number}]: {size[node]:.4g} N on node {node}, whose elements have "
            f"axial stiffnesses of {stiffness[node]:.4g} N together: strained by "
            f"{100 * size[node] / stiffness[node]:.3g} % at least; {_UNITS}"
        )


@warns
def weights(named: Named, weighed: bool) -> Iterator[str]:
    """Warn of weights in an analysis under other loads, or with a stated sag, that never act.

    Args:
        named: pairs of (key in the elements as text, group).
        weighed: whether any phase, or an analysis before it, has `SelfWeight`.
    """
    for where, group in [] if weighed else named:
        weight = _there(group.weight)
        if weight is not None and np.any(weight):
            yield (
                f"elements{where}.weight: no phase has SelfWeight, so that the weight is mass and "
                "no load; add loads=SelfWeight() to a phase if it is to act"
            )
            return


@warns
def nothing_free(number: int, fixed: Held, groups: Sequence[Element]) -> Iterator[str]:
    """Warn of supports that hold every node, unless elements change their shape under load."""
    if fixed.all() and not any(group.shaped_by_load and not group.slides for group in groups):
        yield (
            f"supports of phases[{number}]: every node is held, nothing can move; pinned(nodes) "
            "names the anchors only"
        )


def axial_stiffness(group: Element) -> Float[np.ndarray, " n_elem"] | None:
    """EA of a group with a linear law, [n_elem], N, NumPy; None if it is not known."""
    return _there(group.stiffness_along())


def _there(value):
    """`value` as NumPy; None if it is None or being traced."""
    return checks.array_if_known(value)


def _chords(group, nodes):
    """Length over all nodes of every element, [n_elem], m."""
    return np.linalg.norm(np.diff(nodes[group.links.array], axis=1), axis=2).sum(axis=1)


def _judge_axis(label, section):
    """Yield a warning if the axis of a beam is off its centroid and was not placed by the user."""
    if section.placed:
        return
    if any(_there(leaf) is None for leaf in jax.tree.leaves(section)):
        return
    off = np.array([float(v) for v in section.centroid()])
    size = max(np.ptp(section.y), np.ptp(section.z), float(section.total_area) ** 0.5)
    if np.abs(off).max() > OFF_AXIS * size:
        yield (
            f"{label}: its centroid is at y = {off[0]:.6g}, z = {off[1]:.6g} m from the axis of "
            "the beam, which is the origin of its points or parts; .centred() puts the axis there, "
            ".shifted() says that it is meant as it is"
        )


def _judge_bending(label, section, plane):
    """Yield a warning if a section does not resist bending; in a plane only if about no axis."""
    moduli = [_there(law.modulus) for law in section.laws]
    if any(part is None for part in (*moduli, *map(_there, jax.tree.leaves(section)))):
        return
    area, y, z = (np.asarray(v, float) for v in (section.area, section.y, section.z))
    stiffness = np.repeat(np.array(moduli, float), section.counts) * area
    places = np.stack([z, y])
    off = places - (places @ stiffness / stiffness.sum())[:, None]
    bending = (stiffness * off) @ off.T  # EIy, EIz and EIyz about the centroid
    if section.own is not None and section.is_elastic:  # see `Section.own`
        z2, y2, yz = (stiffness / area) @ np.asarray(section.own, float)
        bending += [[z2, yz], [yz, y2]]
    nothing = STIFFLESS * stiffness.sum() * np.abs(places).max() ** 2
    least, most = np.linalg.eigvalsh(bending)
    layers = section.own is not None  # of a mesh that somebody has made for bending in a plane
    if not (most if plane or layers else least) > nothing:
        shape = "one axis: its fibres are points on one line"
        if not most > nothing:
            shape = "all axes: its fibres are one point"
        own = "give `own` (second moments of z^2, y^2 and yz of each fibre, m4), or more fibres"
        yield (
            f"{label}: its bending stiffness EI is zero about {shape}; "
            f"{own if section.is_elastic else 'give more fibres'}, or use Bars for members that do "
            "not bend"
        )


def _judge_lengths(label, rest, chord):
    """Yield a warning for the first unstressed length far from the distance of its nodes."""
    wrong = (rest > FAR * chord) | (rest * FAR < chord)
    texts = [f"its nodes are {length:.3g} m apart; is it in m?" for length in chord[wrong][:1]]
    yield from _first(label, rest, wrong, *texts)


def _judge_strain(label, value, strain, question):
    """Yield a warning for the first value that makes a strain which no cable bears."""
    wrong = (np.abs(strain) > STRAIN) & np.isfinite(strain)
    texts = [
        f"a strain of {100 * e:.3g} %, and steel breaks at 2 to 4 %; {question}"
        for e in strain[wrong][:1]
    ]
    yield from _first(label, value, wrong, *texts)


def _first(label, value, wrong, text=""):
    """Yield a warning for the first entry that is `wrong`."""
    if wrong.any():
        k = int(wrong.argmax())
        yield (f"{label}[{k}] = {value[k]:.6g}: {text}")
