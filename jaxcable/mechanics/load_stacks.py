"""Element loads of all phases: loads of one kind are stacked and evaluated together.

A load acts from the phase that adds it on; before this phase its factor is zero. Hence the program
of an analysis contains every kind of load once, however many phases there are.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..common.rules import are_rules_kept, collect_rules
from ..common.tree import Indices, copy_with, pytree
from ..common.types import Array, ArrayLike, Bool, Float, Int, PyTree
from ..elements.element import Element
from ..elements.element_state import ElementLoad, ElementState
from ..loads import load as kinds
from ..loads.varying import Amplitude, stack_amplitudes
from ..programs.joining import stack_trees
from .bundles import Bundles


@pytree(static=("late",))
class LoadStack:
    """Element loads of one kind, of all phases, with their numbers stacked.

    Attributes:
        load: all loads as one object, whose numbers have a leading axis, [m].
        phase: index of the phase that adds each load, [m]; -1 if it acts from the beginning.
        late: whether a phase after the first one adds a load.
        amplitude: amplitude of each load in the phase that adds it, [m]; None if all are
            proportional to the load factor.
        factors: what each load is multiplied by at present, [m]; None on the host, before the
            program of an analysis begins.
        begun: positions of the nodes at the start of the phase that adds each load, [m, n_row, 3],
            m; None if the loads do not need them.
    """

    load: kinds.PersistentLoad
    phase: Int[ArrayLike, " m"]
    late: bool = False
    amplitude: Amplitude | None = None
    factors: Float[Array, " m"] = None  # type: ignore[assignment]  # given in a program
    begun: Float[Array, "m n_row 3"] | None = None

    @property
    def follows(self) -> bool:
        """Whether these are follower loads, which depend on the current positions of nodes."""
        return isinstance(self.load, kinds.FollowerLoad)

    def up_to_phase(self, phase: Int[ArrayLike, ""]) -> LoadStack:
        """Return the stack with zeros (also for NaN) in loads of phases after `phase`."""
        if not self.late:
            return self

        def known(x):
            return jnp.where((self.phase <= phase).reshape(-1, *(1,) * (x.ndim - 1)), x, 0)

        load, amplitude = jax.tree.map(known, (self.load, self.amplitude))
        return copy_with(self, load=load, amplitude=amplitude)

    def at_load_factor(
        self, added: Bool[Array, " m"], parameter: Float[ArrayLike, ""]
    ) -> LoadStack:
        """Return the stack at a load factor (`parameter`) of the present phase.

        `added`, [m] bool, are the loads that this phase adds; factors of others stay.
        """
        now = parameter if self.amplitude is None else self.amplitude.factor_at(parameter)
        return copy_with(self, factors=jnp.where(added, now, self.factors))

    def keeps_rules(self) -> Bool[Array, " m"]:
        """Return whether the numbers of each load satisfy its rules, [m] bool."""
        good = self.for_each_load(lambda load: are_rules_kept(collect_rules(load)))
        if self.amplitude is None:
            return good
        return good & jax.vmap(lambda amplitude: are_rules_kept(amplitude.rules()))(self.amplitude)

    def on_bundles(self, bundles: Bundles) -> LoadStack:
        """Return the stack with loads on bundles (groups joined to one) in place of groups."""
        return copy_with(self, load=jax.vmap(lambda load: load.on_bundles(bundles))(self.load))

    def coupled_nodes(self, groups: list[Element], bundles: Bundles) -> list[Indices]:
        """Return nodes whose forces depend on each other's positions, a list of [n, k]."""
        load: Any = self.load.with_bundle_indices(bundles)  # only called for following loads
        return load.coupled_nodes(groups)

    def before_phases(self, begun: Float[Array, "n_row 3"]) -> LoadStack:
        """Return the stack as it is before the first phase: with factors of zero.

        `begun` are the positions of all rows then, [n_row, 3], m.
        """
        m = self.phase.shape[0]
        there = jnp.broadcast_to(begun, (m, *begun.shape)) if self.load.needs_begin_nodes else None
        return copy_with(self, factors=jnp.zeros(m, begun.dtype), begun=there)

    def with_start_positions(
        self, added: Bool[Array, " m"], moved: Float[Array, "n_row 3"]
    ) -> LoadStack:
        """Return a copy in which a phase that adds the loads `added` starts at positions `moved`.

        They are [m] bool, and [n_row, 3], m.
        """
        if self.begun is None:
            return self
        return copy_with(self, begun=jnp.where(added[:, None, None], moved, self.begun))

    @property
    def is_acting(self) -> Bool[Array, ""]:
        """Whether any of these loads has a factor that is not zero, scalar bool."""
        return jnp.any(self.factors != 0)

    def following_forces(self, *arguments: Any) -> Float[Array, "n_row 3"]:
        """Return forces on every node, [n_row, 3], N (see `FollowerLoad.following_forces`)."""
        return self.weighted_sum(lambda load: load.following_forces(*arguments))

    def following_blocks(
        self, *arguments: Any
    ) -> list[tuple[Float[Array, "n k 3 k 3"], Int[ArrayLike, "n k"]]]:
        """Return derivatives of the forces by positions (`FollowerLoad.following_blocks`).

        The list has pairs (blocks [n, k, 3, k, 3], N/m, nodes [n, k]).
        """
        links = []

        def blocks(load):
            parts = load.following_blocks(*arguments)
            links[:] = [nodes for _, nodes in parts]  # the same for all loads of a stack
            return [block for block, _ in parts]

        return list(zip(self.weighted_sum(blocks), links, strict=True))

    def weighted_sum(self, function: Callable[[Any], PyTree[Array]]) -> PyTree[Array]:
        """Return the sum of factor times ``function(load)`` over all loads, a pytree or None."""
        values = self.for_each_load(function, self.begun)
        if self.phase.shape[0] == 1:
            return jax.tree.map(lambda x: self.factors[0] * x[0], values)
        return jax.tree.map(lambda x: jnp.tensordot(self.factors, x, 1), values)

    def for_each_load(
        self,
        function: Callable[[Any], PyTree[Array]],
        begun: Float[Array, "m n_row 3"] | None = None,
    ) -> PyTree[Float[Array, "m ..."]]:
        """Call ``function(load)`` for every load; return a pytree of arrays [m, ...].

        `begun` sets the positions at the start of each load's phase, [m, n_row, 3], m, if given.
        """
        leaves, tree = jax.tree.flatten(self.load)

        def one(leaves, begun):
            load = jax.tree.unflatten(tree, leaves)
            return function(load if begun is None else copy_with(load, begin_nodes=begun))

        if self.phase.shape[0] == 1:
            value = one(*jax.tree.map(lambda x: x[0], (leaves, begun)))
            return jax.tree.map(lambda x: x[None], value)
        return jax.vmap(one)(leaves, begun)


def stack_loads(
    acting: Sequence[Sequence[tuple[kinds.PersistentLoad, Amplitude | None]]],
) -> list[LoadStack]:
    """Stack the element loads of all phases by kind, on the host.

    Args:
        acting: for every phase a list of pairs: load in the form of an analysis
            (`OnGroups.with_group_indices`), and its amplitude or None.

    Returns:
        List of `LoadStack`, in the order in which their kinds appear.
    """
    found = {}
    for phase, loads in enumerate(acting):
        for load, amplitude in loads:
            kind = jax.tree.structure(load), tuple(np.shape(x) for x in jax.tree.leaves(load))
            found.setdefault(kind, []).append((phase, load, amplitude))
    return [
        LoadStack(
            stack_trees([load for _, load, _ in members]),
            np.array([phase for phase, _, _ in members], np.int32),
            late=any(phase > 0 for phase, _, _ in members),
            amplitude=stack_amplitudes([amplitude for _, _, amplitude in members]),
        )
        for members in found.values()
    ]


def acting_from_start(stack: LoadStack) -> LoadStack:
    """Return a stack whose loads act from the beginning, for the continuation of an analysis."""
    return copy_with(stack, phase=np.full(stack.phase.shape, -1, np.int32), late=False)


def dead_load(
    nodes: Float[Array, "n_row 3"], groups: list[Element], restart: Any
) -> Float[Array, "n_row n_freedom"]:
    """Return nodal and dead element loads of a `RestartState`, [n_row, 3 or 6], N and N m."""
    load = restart.nodal_load
    arguments = groups, restart.states, nodes, load.shape, nodes.dtype
    for stack in restart.loads:
        if not stack.follows:
            load = load + stack.weighted_sum(lambda one: one.element_forces(*arguments))
    return load


def element_load(
    number: int, group: Element, state: ElementState, nodes: Float[Array, "n_row 3"], restart: Any
) -> ElementLoad | None:
    """Return what acts along the elements of the group with index `number`, or None.

    It is the sum of the loads of a `RestartState`: force per length, bending pressures, and
    concentrated loads.
    """
    line, pressures, points = None, {}, []
    for stack in restart.loads:
        if not stack.follows:
            concentrated = stack.for_each_load(lambda load: load.point_loads(number, state))
            if concentrated is not None:
                points.append(_scale_point_loads(concentrated, stack.factors))
            force = stack.weighted_sum(
                lambda load: load.load_per_length(number, group, state, nodes)
            )
            if force is not None:
                line = force if line is None else line + force
            continue
        for k in range(stack.phase.shape[0]):
            load = jax.tree.map(lambda x, k=k: x[k], stack.load)
            pressing = load.bending_pressure(number, group)
            if pressing is not None:
                per, pressure, axis = pressing
                pressures.setdefault(per, []).append((stack.factors[k] * pressure, axis))
    if line is None and not pressures and not points:
        return None
    return ElementLoad(line, pressures or None, _join_point_loads(points))


def _scale_point_loads(points, factors):
    """Return concentrated loads of m loads, [m, n_elem, k, 4 or 7], times factors [m].

    They are joined to [n_elem, m k, 4 or 7]; `ElementLoad` says what they are.
    """
    values = factors[:, None, None, None] * points[..., 1:]
    points = jnp.moveaxis(jnp.concatenate([points[..., :1], values], axis=-1), 0, 1)
    return points.reshape(points.shape[0], -1, points.shape[-1])


def _join_point_loads(parts):
    """Join concentrated loads, a list of arrays [n_elem, k, 4 or 7], along their second axis.

    Missing moments become zero. None if the list is empty.
    """
    if not parts:
        return None
    most = max(part.shape[-1] for part in parts)
    wide = [jnp.pad(part, ((0, 0), (0, 0), (0, most - part.shape[-1]))) for part in parts]
    return wide[0] if len(wide) == 1 else jnp.concatenate(wide, axis=1)
