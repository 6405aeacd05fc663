"""Sags and lowest points of cables: catenaries, and chains of elements between named nodes."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..analysis.element_shapes import (
    CATENARIES,
    ElementShapes,
    StateOrPhase,
    element_shapes,
    map_shapes,
    results_of_state,
    straight_shapes,
    tensions_of_shapes,
)
from ..common import checks
from ..common.types import Array, ArrayLike, Float, Int, PyTree
from ..elements.abilities import Hanging
from ..loads.groups import indices_of_groups
from ..model.structure import Structure
from ..programs.program_calls import as_program
from .sag import sag_of_segments


def sags(
    structure: Structure,
    state: StateOrPhase,
    chains: Mapping[str, Int[ArrayLike, " n"]] | None = None,
) -> Any:
    """Find sags, deflections and lowest points of catenaries, or of chains of elements.

    A sag is vertical: the distance of the cable from its chord, the straight line between its ends.
    `Sag.deflection` is the distance at right angles to the chord, in the direction of all loads.

    Catenaries are exact, under the whole load along them. In a chain each pair of neighbors is
    joined by its active catenary, if there is one, and otherwise by a straight line: beams count by
    their nodes. (Of two catenaries between the same nodes the last one counts.)

    Pure functions, differentiable like the solution; of a chain the derivatives of `largest` and
    `deflection` have kinks where another node becomes the farthest one, and those of `largest_at`
    and `lowest` jump there. Where the lowest point reaches an end, its height has a derivative, its
    place has one-sided ones.

    Args:
        structure: the `Structure` that was analysed.
        state: `Solution` (NaN if it has failed) or `State`, or one of
            ``solution.phases`` for the end of that phase; batches have leading axes.
        chains: node numbers from end to end, [n], of every chain, by its name; `nodes_along` has
            those of elements. None: the catenaries, each between its own ends.

    Returns:
        `Sag` of each chain, a dict by name; without chains a pytree like the structure's
        `elements`, `Sag` for catenaries and None for other groups; of `SlidingCatenaries` it is
        that of every segment. NaN where elements are not active, for fillers of shorter cables, and
        for `midspan` and `largest` where the ends lie above each other.

    Raises:
        ValueError: not a state; no catenaries, and no chains; nodes that do not exist, or that no
            element joins.

    Example:
        A cable of a net, three links long, by its nodes:

        >>> structure, phases = jc.scenes.flat_net(load=15.0)
        >>> solution = jc.solve(structure, phases)
        >>> found = jc.results.sags(structure, solution, {"x": [2, 3, 4, 5]})["x"]
        >>> print(solution.status, f"{found.midspan:.6f} m")
        0 0.012838 m
    """
    if chains is not None:
        if not isinstance(chains, Mapping):
            raise ValueError(
                "chains: expected a dict of node numbers by the name of each chain, such as "
                f'{{"main": [0, 1, 2]}}, got {type(chains).__name__}'
            )
        positions = results_of_state(structure, state).positions
        every = element_shapes(structure, state)
        return {
            name: _chain_sag(_chain_shapes(structure, positions, every, name, nodes))
            for name, nodes in chains.items()
        }
    if not any(isinstance(group, CATENARIES) for group in structure.groups):
        raise ValueError(
            "structure: has no catenaries; for the sag of a chain of other elements give "
            'chains={"name": nodes}'
        )
    found: list[Any] = []
    for group, (shapes, there) in zip(
        structure.groups, element_shapes(structure, state), strict=True
    ):
        if not isinstance(group, CATENARIES):
            found.append(None)
            continue
        shapes, there = _without_fillers_and_mask(group, shapes, there)
        own = map_shapes(_element_sag, shapes)
        found.append(jax.tree.map(lambda x, there=there: _nan_where_inactive(there, x), own))
    return structure.arrange(found)


def horizontal_tensions(
    structure: Structure, state: StateOrPhase
) -> PyTree[Float[Array, " n_elem"] | None]:
    """Return the horizontal parts of the tensions of cables, along the plan of their chords.

    Of a catenary it is that in the middle of its unstressed length. Under vertical load, and under
    wind at right angles to the chord, it is the same all along it: the H of the parabola
    ``w l^2 / (8 f)``. Of a straight element it is the axial force times the slope's cosine.

    Args:
        structure: the `Structure` that was analysed.
        state: `Solution` (NaN if it has failed) or `State`, or one of
            ``solution.phases`` for the end of that phase; batches have leading axes.

    Returns:
        Forces in the shape of `elements`, each [n_elem], N, positive in tension and zero for
        elements that are not active; of `SlidingCatenaries` [n_elem, n_segment], zero for fillers;
        None for other groups without an axial force or with more than two nodes an element. NaN
        where the ends lie above each other.

    Raises:
        ValueError: not a state, or of another structure.

    Example:
        >>> line = jc.Catenaries([[0, 1]], axial_stiffness=33e6, weight=16.0)
        >>> nodes = [[0.0, 0.0, 0.0], [300.0, 0.0, 0.0]]
        >>> structure = jc.Structure(nodes, line, supports=jc.pinned([0, 1]))
        >>> strung = jc.solve(structure, jc.Phase(sag=8.0, loads=jc.SelfWeight()))
        >>> force = jc.results.horizontal_tensions(structure, strung)  # w l^2 / (8 f) = 22.5 kN
        >>> print(strung.status, f"{force[0] / 1e3:.3f} kN")
        0 22.506 kN
    """
    found: list[Any] = []
    forces = tensions_of_shapes(structure, state)
    every = element_shapes(structure, state)
    for group, force, (shapes, there) in zip(structure.groups, forces, every, strict=True):
        hangs = isinstance(group, CATENARIES)
        if force is None or (not hangs and group.links.shape[1] != 2):
            found.append(None)
            continue
        if hangs:
            shapes, there = _without_fillers_and_mask(group, shapes, there)
        own = map_shapes(ElementShapes.horizontal_part, shapes)
        found.append(_horizontal_parts(shapes, own, force, there))
    return structure.arrange(found)


@as_program
def _horizontal_parts(shapes, own, force, there):
    """Return the horizontal parts of tensions, [..., n_elem], N, zero for inactive elements.

    `own` is that part of elements that hang, N, or the cosine of the slope of straight ones;
    `force` is the axial force, N, `there` which elements are active.
    """
    return jnp.where(there, jnp.where(shapes.hangs, own, own * force), 0.0)


def nodes_along(structure: Structure, elements: Sequence[int], on: Any = None) -> list[int]:
    """Return the nodes along a chain of elements, from end to end.

    Args:
        structure: `Structure`.
        elements: indices of the elements in order, each joined to the next one.
        on: the group that has them, its key in the structure's elements; None if there is one
            group.

    Raises:
        ValueError: no such group or element, or an element that does not join the one before it.

    Example:
        >>> cables = jc.Cables([[1, 0], [1, 2], [3, 2]], axial_stiffness=1e6)
        >>> nodes = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [3.0, 0.0, 0.0]]
        >>> structure = jc.Structure(nodes, cables, supports=jc.pinned([0, 3]))
        >>> jc.results.nodes_along(structure, [0, 1, 2])
        [0, 1, 2, 3]
    """
    numbers = indices_of_groups(on, structure)
    if len(numbers) != 1:
        raise ValueError(f"on = {on!r}: means {len(numbers)} groups; give the key of one group")
    owner = structure.groups[numbers[0]]
    if owner.face is not None:
        raise ValueError(f"on = {on!r}: its elements are faces, along which no chain goes")
    links = _nodes_in_order(owner)
    chosen = checks.as_indices(elements, "elements", things="element").tolist()
    wrong = [k for k in chosen if k >= len(links)]
    if wrong or not chosen:
        what = f"no element {wrong[0]}" if wrong else "none; a chain has at least one"
        raise ValueError(f"elements: {what}; the group has {len(links)}")
    # (shorter chains of pulleys are filled up by their last node)
    rows = [list(dict.fromkeys(links[k].tolist())) for k in chosen]
    first = rows[0]
    if len(rows) > 1 and first[0] in (rows[1][0], rows[1][-1]):
        first = first[::-1]
    nodes = list(first)
    for k, row in itertools.islice(zip(chosen, rows, strict=True), 1, None):
        if nodes[-1] not in (row[0], row[-1]):
            ends = [row[0], row[-1]]
            raise ValueError(
                f"elements: element {k} has the nodes {ends}, and does not go on from node "
                f"{nodes[-1]}"
            )
        nodes += row[1:] if row[0] == nodes[-1] else row[-2::-1]
    return nodes


def _without_fillers_and_mask(group, shapes, there):
    """Return `ElementShapes`, level lines in place of fillers of shorter cables, and a mask.

    The mask says which elements, or segments of cables that slide, are active and no fillers.
    Fillers have no length: derivatives by it would be NaN.
    """
    if not group.slides:
        return shapes, there
    real = np.broadcast_to(
        group.links.array[:, 1:] != group.links.array[:, :-1], shapes.hangs.shape
    )
    level = straight_shapes(shapes.first, shapes.first.at[..., 0].add(1.0))
    return _select_shapes(real, shapes, level), there[..., None] & real


@as_program
def _nan_where_inactive(there, values):
    """Return values [..., n_elem, ...], NaN for elements that are not active (`there`, bool)."""
    there = there.reshape(*there.shape, *(1,) * (values.ndim - there.ndim))
    return jnp.where(there, values, jnp.nan)


def _chain_shapes(structure, positions, every, name, nodes):
    """Return the `ElementShapes` of a chain, one segment for each pair of nodes on the first axis.

    `positions` are those of all nodes, `every` is from `element_shapes`, `nodes` are the
    chain's.
    """
    nodes = checks.as_indices(nodes, f"chains[{name!r}]")
    checks.require_known_nodes(nodes, structure.n_node, f"chains[{name!r}]")
    if len(nodes) < 2:
        raise ValueError(f"chains[{name!r}]: a chain has at least 2 nodes, got {len(nodes)}")
    positions, segments = jnp.asarray(positions), []
    axis = positions.ndim - 2  # that of elements, after those of a batch
    # catenaries last: where they join nodes that another element joins, too, they count
    groups = sorted(
        zip(structure.groups, every, strict=True), key=lambda pair: isinstance(pair[0], CATENARIES)
    )
    joined = [(group, _elements_by_pair(group), *own) for group, own in groups]
    for a, b in itertools.pairwise(nodes.tolist()):
        if not any((a, b) in pairs for _, pairs, *_ in joined):
            raise ValueError(f"chains[{name!r}]: no element joins the nodes {a} and {b}")
        straight = straight_shapes(positions[..., a, :], positions[..., b, :])
        segment = jax.tree.map(lambda x: jnp.full_like(x, jnp.nan), straight)  # none is active
        for group, pairs, shapes, there in joined:
            for *at, backward in pairs.get((a, b), ()):
                one, k = straight, at[0]
                if isinstance(group, CATENARIES):
                    one = shapes
                    for number in at if group.slides else at[:1]:
                        one = jax.tree.map(lambda x, n=number: jnp.take(x, n, axis), one)
                    one = one.reversed() if backward else one
                segment = _select_shapes(jnp.take(there, k, -1), one, segment)
        segments.append(segment)
    return jax.tree.map(lambda *x: jnp.stack(x, axis), *segments)


def _elements_by_pair(group):
    """Return the elements that join two successive nodes.

    It is a dict: pair -> [(index, index of its segment, whether backwards)].
    """
    found: dict[tuple[int, int], list[tuple[int, int, bool]]] = {}
    for k, nodes in enumerate(_nodes_in_order(group).tolist()):
        for j, (a, b) in enumerate(itertools.pairwise(nodes)):
            if a != b:  # chains that are shorter than others end with the same node
                found.setdefault((a, b), []).append((k, j, False))
                found.setdefault((b, a), []).append((k, j, True))
    return found


def _nodes_in_order(group):
    """Return the nodes along the elements of a group, or around its faces, [n_elem, n]."""
    links = group.links.array
    if isinstance(group, Hanging):
        return links[:, [0, -1]]
    if group.outline is not None:
        return links[:, list(group.outline)]
    return links if group.face is None else links[:, [*group.face, group.face[0]]]


def _select_shapes(chosen, one, other):
    """Return `ElementShapes`, those of `one` where the mask `chosen` is true, else of `other`."""

    def select(x, y):
        return jnp.where(chosen.reshape(*chosen.shape, *(1,) * (x.ndim - chosen.ndim)), x, y)

    return jax.tree.map(select, one, other)


@as_program
def _chain_sag(segments):
    """Return the `Sag` of a chain of segments, arrays [..., n_segment], over leading axes."""
    function = sag_of_segments
    for _ in range(segments.rest_length.ndim - 1):
        function = jax.vmap(function)
    return function(segments)


def _element_sag(shape):
    """Return the `Sag` of one element, given by its `ElementShapes` without leading axes."""
    return sag_of_segments(jax.tree.map(lambda x: x[None], shape))
