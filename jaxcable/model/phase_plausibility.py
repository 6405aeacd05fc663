"""Warnings of legal input of phases that is most likely not meant: huge strains, idle loads.

As in `plausibility`, known values are checked in NumPy on the host; traced values are not checked.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from ..common.types import ArrayLike, Float, Int
from ..elements.element import Element
from ..elements.phase_input import InputValues
from ..elements.sliding_catenaries import SlidingCatenaries
from .plausibility import (
    STATE_UNITS,
    FixedMask,
    NamedGroups,
    array_or_none,
    describe_first_wrong,
    describe_unlikely_length,
    drawn_or_given_lengths,
    issues_warnings,
    lengths_over_nodes,
)

MAX_STATED_STRAIN = 0.15
"""Stated strain above which no cable has a constant stiffness: steel breaks at 0.02 to 0.04, ropes
of polyester at some 0.12."""

MAX_LOAD_STRAIN = 0.5
"""Limit of strains from loads; larger, because a batch or a search may contain large loads."""

_DEEP = 4.0
"""Sag over the distance of the ends above which a loop is most likely given in other units."""

_ONE_SIDE = 0.45
"""Cosine of the angle between a cable and the mean of those at its node from which all of them pull
to one side: corners of nets up to 120 degrees do, flat kinks of chains and edges do not."""

_HANGS = 0.7
"""Upward part of the mean direction of cables above which their node hangs by them."""

_UNITS = f"check the units: stiffness and forces in N, areas in m2, moduli in Pa; {STATE_UNITS}"


@issues_warnings
def warn_of_prestress(
    name: str, stated: InputValues, group: Element, label: str, nodes: Float[ArrayLike, "n_node 3"]
) -> Iterator[str]:
    """Warn of prestress that no cable can bear.

    Args:
        name: what is stated: "pretension", "temperature" or another argument of `Phase`.
        stated: values for the elements of the group, and which elements they concern.
        group: element group.
        label: how a user writes it, for the message: ``phases[0].pretension['guys']``.
        nodes: initial positions of the structure, [n_node, 3], m.
    """
    value, nodes = array_or_none(stated.values), array_or_none(nodes)
    if value is None or nodes is None:
        return
    value = value if stated.chosen is None else np.where(stated.chosen, value, np.nan)
    stiffness = known_axial_stiffness(group)
    if name in ("pretension", "jacking", "force_density", "end_tension", "horizontal_tension"):
        force = value * lengths_over_nodes(group, nodes) if name == "force_density" else value
        strength = array_or_none(group.strength)
        if strength is not None:
            over = force > strength
            most = zip((force / strength)[over][:1], strength[over], strict=False)
            text = "".join(f"{r:.4g} times its strength, {s:.6g} N" for r, s in most)
            yield from describe_first_wrong(label, value, over, text)
        if stiffness is not None:
            yield from _describe_unlikely_strain(label, value, force / stiffness, _UNITS, stiffness)
    elif name == "prestrain":
        strain = np.maximum(value, 0.0) if group.tension_only else value  # slack is no strain
        hint = "a prestrain is a ratio, not a percentage"
        yield from _describe_unlikely_strain(label, value, strain, hint)
    elif name == "temperature" and array_or_none(group.expansion) is not None:
        strain = value * array_or_none(group.expansion)
        yield from _describe_unlikely_strain(label, value, strain, "is the expansion in 1/K?")
    elif name in ("sag", "built_sag"):
        chord = lengths_over_nodes(group, nodes)
        over = value > _DEEP * chord
        text = "".join(f"its ends are {d:.4g} m apart; is the sag in m?" for d in chord[over][:1])
        yield from describe_first_wrong(label, value, over, text)
    elif name == "shortening":
        length = drawn_or_given_lengths(group, nodes)
        over = (np.abs(value) > length) & (length > 0)
        text = "".join(
            f"the element has {own:.4g} m; is it in m, and can a turnbuckle do it?"
            for own in length[over][:1]
        )
        yield from describe_first_wrong(label, value, over, text)
    elif name == "rest_length":
        yield from describe_unlikely_length(label, value, lengths_over_nodes(group, nodes))


@issues_warnings
def warn_of_nodal_loads(
    number: int,
    loads: Sequence[Any],
    fixed: FixedMask,
    groups: Sequence[Element],
    alone: bool,
    inactive: FixedMask | None = None,
) -> Iterator[str]:
    """Warn of nodal loads that act on supports only, or that strain their elements beyond reason.

    The elements at a free node balance its load. Hence at least one of them has a strain of the
    load over the sum of their axial stiffnesses, or more.

    Args:
        number: index of the phase, from 0.
        loads: nodal loads of the phase, a list.
        fixed: True where a support holds a degree of freedom, [n_row, 3 or 6].
        groups: element groups of the structure.
        alone: whether the phase has no other input than these loads.
        inactive: True where a degree of freedom is held because no element of this phase has it,
            [n_row, 3 or 6]; None if all elements are always there.
    """
    known = [load.forces_at_nodes() for load in loads]
    forces = [None if pair is None else array_or_none(pair[1]) for pair in known]
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
            f"phases[{number}].loads: all of them act on supports (node "
            f"{int(acts.any(axis=1).argmax())}) and strain nothing; check the numbers of the "
            "nodes, which start at 0, and the supports"
        )
    elif (
        alone
        and inactive is not None
        and acts.any()
        and not (acts & ~(fixed | inactive)[:, :3]).any()
    ):
        node = int((acts & inactive[:, :3]).any(axis=1).argmax())
        yield (
            f"phases[{number}].loads: all of them act on supports, or on nodes that no element "
            f"touches in this phase (node {node}); these act when an element is added there"
        )
    if any(group.rotates for group in groups):  # beams bend
        return
    size = np.sqrt(np.sum(total**2, axis=1))
    given = [known_axial_stiffness(group) for group in groups]
    known = [np.array([np.inf]) if along is None else along for along in given]
    if size.max() <= MAX_LOAD_STRAIN * min(along.min() for along in known):
        return
    stiffness = np.zeros(len(fixed))
    for group, along in zip(groups, known, strict=True):
        ends = group.links.array
        passing = 1 if ends.shape[1] == 2 else 2  # two pieces of a sliding cable meet at its nodes
        along = np.broadcast_to(passing * along[:, None], ends.shape)
        stiffness += np.bincount(ends.ravel(), along.ravel(), len(fixed))
    high = ~fixed.any(axis=1) & (size > MAX_LOAD_STRAIN * stiffness) & np.isfinite(size)
    if high.any():
        node = int(high.argmax())
        yield (
            f"phases[{number}].loads: {size[node]:.4g} N on node {node} strains its elements by "
            f"{100 * size[node] / stiffness[node]:.3g} % or more: the sum of their axial "
            f"stiffnesses EA is {stiffness[node]:.4g} N; {_UNITS}"
        )


@issues_warnings
def warn_of_unused_weight(named: NamedGroups, weighed: bool) -> Iterator[str]:
    """Warn of groups with a weight if no phase has `SelfWeight`, so that it is no load.

    Args:
        named: pairs of (key in the elements as text, group).
        weighed: whether any phase, or an analysis before it, has `SelfWeight`.
    """
    known = [(where, array_or_none(group.weight)) for where, group in named if not weighed]
    found = [
        f"elements{where}.weight"
        for where, weight in known
        if weight is not None and np.any(weight)
    ]
    if found:
        yield (
            f"{', '.join(found)}: no phase has SelfWeight, so that the weight is no load; "
            "give a phase loads=SelfWeight() if it shall act"
        )


@issues_warnings
def warn_of_free_ends(
    nodes: Float[ArrayLike, "n_node 3"],
    named: NamedGroups,
    fixed: Sequence[FixedMask],
    joined: Sequence[Int[np.ndarray, " n"]],
) -> Iterator[str]:
    """Warn of nodes without support and load that cables alone hold, all of them from one side.

    Such cables can have no tension. Most likely a support is missing: at the end of a cable, or at
    a corner of a net. Several cables that hold a node from above are not meant: it hangs there.

    Args:
        nodes: initial positions, [n_node, 3], m.
        named: pairs of (key in the elements as text, group).
        fixed: True where a degree of freedom is held, [n_node, 3 or 6], at the start and by phase.
        joined: arrays of nodes that loads act on, or that rigid links join.
    """
    free, at = ~np.any([held[:, :3].any(axis=1) for held in fixed], axis=0), array_or_none(nodes)
    cables = [(where, g) for where, g in named if g.tension_only and g.face is None]
    others = [g.links.array for _, g in named if not g.tension_only or g.face is not None]
    for touched in (*joined, *others):
        free[touched.ravel()] = False
    if at is None or not cables or not free.any():
        return
    chains = [group.links.array for _, group in cables]
    ends = np.concatenate([np.stack([c[:, :-1], c[:, 1:]], -1).reshape(-1, 2) for c in chains])
    node, other = np.concatenate([ends, ends[:, ::-1]]).T
    pull = at[other] - at[node]
    pull = pull / np.linalg.norm(pull, axis=1)[:, None]
    total = np.stack([np.bincount(node, along, len(at)) for along in pull.T], axis=1)
    total = total / np.linalg.norm(total, axis=1)[:, None]
    count = np.bincount(node, minlength=len(at))
    free[node[~(np.sum(pull * total[node], axis=1) > _ONE_SIDE)]] = False
    free &= (count == 1) | ((count > 1) & (total[:, 2] < _HANGS))
    for where, group in cables:
        alone = free[group.links.array]
        if alone.any():
            k, side = np.argwhere(alone)[0]
            first = group.links.array[k, side]
            what = "the free end" if count[first] == 1 else "a free corner"
            more = len(np.unique(group.links.array[alone])) - 1
            yield (
                f"nodes[{first}] is {what} of elements{where}.links[{k}]"
                f"{f' (and {more} more of this group)' if more else ''}: no phase supports it or "
                f"has a load on it, so that cables there can have no tension; "
                "is a support or a joint missing? If it hangs there freely, ignore this warning"
            )
            free[group.links.array[alone]] = False


@issues_warnings
def warn_of_cables_paid_out(
    number: int, groups: Sequence[Element], inputs: Sequence[Mapping[str, Any]]
) -> Iterator[str]:
    """Warn of jacks on hanging cables with friction in a phase of one increment that loads them.

    From the straight line as drawn such a cable is paid out into its spans, and not pulled.

    Args:
        number: index of the phase, from 0.
        groups: element groups of the structure.
        inputs: what the phase states for each of them, by name.
    """
    for cables, own in zip(groups, inputs, strict=True):
        if isinstance(cables, SlidingCatenaries) and cables.has_friction and "jacking" in own:
            yield (
                f"phases[{number}].jacking: in one increment a hanging cable is paid out from its "
                "straight line as drawn, and friction acts against that; with increments=2 or more "
                "the jack pulls at last"
            )


@issues_warnings
def warn_if_all_nodes_held(
    number: int, fixed: FixedMask, groups: Sequence[Element]
) -> Iterator[str]:
    """Warn if supports hold every node of a phase, unless elements can still deform under load.

    Args:
        number: index of the phase, from 0.
        fixed: True where a degree of freedom is held, [n_row, 3 or 6].
        groups: element groups of the structure.
    """
    own = [g.shaped_by_load and (g.has_memory or not g.slides) for g in groups]  # or with friction
    if fixed.all() and not any(own):
        yield (
            f"phases[{number}].supports: every node is held, so that nothing can move; give "
            "pinned(nodes) the numbers of the anchors only"
        )


def known_axial_stiffness(group: Element) -> Float[np.ndarray, " n_elem"] | None:
    """Return EA of a group, [n_elem], N, NumPy; None if it is traced or the law is not linear."""
    return array_or_none(group.linear_axial_stiffness())


def _describe_unlikely_strain(label, value, strain, hint, stiffness=None):
    """Yield a message about the first element whose strain no cable bears (above 0.15), or nothing.

    Args:
        label: how a user writes the input, such as ``phases[0].pretension``.
        value: the input that makes the strain, [n_elem].
        strain: [n_elem], without unit; NaN for elements that it does not concern.
        hint: end of the message.
        stiffness: EA, [n_elem], N, which the message mentions; or None.
    """
    wrong = (np.abs(strain) > MAX_STATED_STRAIN) & np.isfinite(strain)
    text = ""
    if wrong.any():
        k = int(wrong.argmax())
        given = "" if stiffness is None else f" with EA = {stiffness[k]:.6g} N"
        text = f"a strain of {100 * strain[k]:.3g} %{given}, and steel breaks at 2 to 4 %; {hint}"
    yield from describe_first_wrong(label, value, wrong, text)
