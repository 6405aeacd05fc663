"""What acts on a structure in a phase.

Nodal loads are dead: they keep direction and follow their node. Element loads (self-weight, line
loads) are evaluated from the state of the elements and go on acting in later phases. Supports may
be moved.
"""

import jax
import jax.numpy as jnp
import numpy as np

from . import _check
from ._tree import Indices, copy, pytree


@pytree(indices=("nodes",))
class NodalLoads:
    """Dead forces on nodes.

    Args:
        nodes: node numbers, [n]; a node may be named more than once, its forces add.
        forces: one force [3] for each of them, or [n, 3], N.
        moments: moments [3] or [n, 3], N m, on nodes that a beam is joined to rigidly. They keep
            their direction in space; such moments have no potential (unless they turn about a fixed
            axis) and make the tangent unsymmetric.
    """

    nodes: object
    forces: object
    moments: object = None

    def __post_init__(self):
        if not isinstance(self.nodes, Indices):
            object.__setattr__(self, "nodes", Indices(_check.integers(self.nodes, "load nodes")))
        forces = _check.floats(self.forces, "forces")
        if forces.shape not in ((3,), (len(self.nodes), 3)):
            raise ValueError(
                f"forces: expected shape (3,) or ({len(self.nodes)}, 3), got {forces.shape}"
            )
        object.__setattr__(self, "forces", forces)
        if self.moments is not None:
            moments = _check.floats(self.moments, "moments")
            if moments.shape not in ((3,), (len(self.nodes), 3)):
                raise ValueError(
                    f"moments: expected shape (3,) or ({len(self.nodes)}, 3), got {moments.shape}"
                )
            object.__setattr__(self, "moments", moments)

    def check(self, structure):
        """Raise ValueError if a node is unknown to the structure."""
        unknown = self.nodes.array >= structure.n_node
        if unknown.any():
            k = int(unknown.argmax())
            raise ValueError(
                f"load nodes[{k}] = {self.nodes[k]}: "
                f"the structure has nodes 0 to {structure.n_node - 1}"
            )
        if self.moments is not None:
            turns = structure.turns()[self.nodes.array]
            if not turns.all():
                k = int((~turns).argmax())
                raise ValueError(
                    f"moments: node {self.nodes[k]} has no rotation: no beam is joined rigidly"
                )

    def nodal_forces(self, shape, dtype):
        """Force, and moment if `shape` is [n_node, 6], on every node, N and N m."""
        each = jnp.broadcast_to(self.forces.astype(dtype), (len(self.nodes), 3))
        if shape[1] == 3:
            return jnp.zeros(shape, dtype).at[self.nodes].add(each)
        moments = 0.0 if self.moments is None else self.moments
        moments = jnp.broadcast_to(jnp.asarray(moments, dtype), each.shape)
        both = jnp.concatenate([each, moments], axis=1)
        return jnp.zeros(shape, dtype).at[self.nodes].add(both)


@pytree
class SelfWeight:
    """Self-weight of every group that has `weight`, half of each element to each end.

    The weight is that of the current unstressed length; a jack leaves it as it was when it began to
    pull, so that anchoring it moves nothing.

    Args:
        direction: direction and factor, [3]; (0, 0, -1) is once the weight downwards.
    """

    direction: object = (0.0, 0.0, -1.0)

    def __post_init__(self):
        direction = _check.floats(self.direction, "direction")
        if direction.shape != (3,):
            raise ValueError(f"direction: expected shape (3,), got {direction.shape}")
        object.__setattr__(self, "direction", direction)

    def check(self, structure):
        """Raise ValueError if no group has a weight."""
        if all(getattr(group, "weight", None) is None for group in structure.groups):
            raise ValueError("SelfWeight: no element group has a weight; give weight=... in N/m")

    def nodal_forces(self, groups, states, shape, dtype):
        """Force on every node, as `shape`, N, for the given element states."""
        total = jnp.zeros(shape[0], dtype)
        for group, state in zip(groups, states, strict=True):
            if group.weight is not None:
                total = total.at[group.links].add(group.weight_at_ends(state))
        return _padded(jnp.outer(total, self.direction.astype(dtype)), shape)

    def per_length(self, number, group, state):
        """Load per unstressed length that bends a group, [n_elem, 3], N/m, or None."""
        if group.weight is None:
            return None
        share = group.weight * state.weighing / state.rest_length
        return jnp.outer(share, self.direction)


@pytree(static=("on",))
class LineLoads:
    """Dead loads along the elements, per unstressed length; beams bend under them.

    Half of each element's load goes to each end; beams get the work on their deflection as well
    (consistent end moments that turn with the element). A jacked element counts with the unstressed
    length with which the jack began, until it is anchored.

    Args:
        forces: force per length, [3], N/m.
        on: key of the loaded group in the structure's elements (a dict's key, a list's number);
            None loads all groups.
    """

    forces: object
    on: object = None

    def __post_init__(self):
        forces = _check.floats(self.forces, "forces")
        if forces.shape != (3,):
            raise ValueError(f"forces: expected shape (3,), got {forces.shape}")
        object.__setattr__(self, "forces", forces)

    def check(self, structure):
        """Raise ValueError if the structure has no such group."""
        self.among(structure)

    def among(self, structure):
        """The load with `on` turned into the numbers of its groups."""
        count = len(structure.groups)
        if self.on is None:
            return copy(self, on=tuple(range(count)))
        numbers = structure.arrange(list(range(count)))
        try:
            chosen = numbers[self.on]
        except (KeyError, IndexError, TypeError):
            raise ValueError(f"on = {self.on!r}: no such key in the structure's elements") from None
        return copy(self, on=tuple(jax.tree.leaves(chosen)))

    def nodal_forces(self, groups, states, shape, dtype):
        """Force on every node, as `shape`, N, for the given element states."""
        total = jnp.zeros(shape[0], dtype)
        for number, (group, state) in enumerate(zip(groups, states, strict=True)):
            if number in self.on:
                half = jnp.repeat((0.5 * state.rest_length)[:, None], 2, axis=1)
                total = total.at[group.links].add(half)
        return _padded(jnp.outer(total, self.forces.astype(dtype)), shape)

    def per_length(self, number, group, state):
        """Load per unstressed length that bends a group, [n_elem, 3], N/m, or None."""
        if number not in self.on:
            return None
        return jnp.broadcast_to(self.forces, (len(state.rest_length), 3))


@pytree(indices=("nodes",))
class SupportMovement:
    """Displacement of supports, by increments, from where they are.

    Args:
        nodes: node numbers, [n].
        displacements: [3] or [n, 3], m, or None; along freedoms that are held in the phase.
        rotations: rotation vectors [3] or [n, 3], rad, of clamped nodes; default none.
    """

    nodes: object
    displacements: object
    rotations: object = None

    def __post_init__(self):
        if not isinstance(self.nodes, Indices):
            object.__setattr__(self, "nodes", Indices(_check.integers(self.nodes, "moved nodes")))
        if self.displacements is None:
            object.__setattr__(self, "displacements", (0.0, 0.0, 0.0))
        for name in ("displacements", "rotations"):
            value = getattr(self, name)
            if value is None:
                continue
            value = _check.floats(value, name)
            if value.shape not in ((3,), (len(self.nodes), 3)):
                raise ValueError(
                    f"{name}: expected shape (3,) or ({len(self.nodes)}, 3), got {value.shape}"
                )
            object.__setattr__(self, name, value)

    def check(self, structure):
        """Raise ValueError if a node is unknown to the structure."""
        unknown = self.nodes.array >= structure.n_node
        if unknown.any():
            k = int(unknown.argmax())
            raise ValueError(
                f"moved nodes[{k}] = {self.nodes[k]}: "
                f"the structure has nodes 0 to {structure.n_node - 1}"
            )
        if self.rotations is not None and not structure.turns()[self.nodes.array].all():
            k = int((~structure.turns()[self.nodes.array]).argmax())
            raise ValueError(f"rotations: node {self.nodes[k]} has no rotation")

    def check_supported(self, fixed):
        """Raise ValueError if a moved freedom is not held; `fixed`, [n_node, 3 or 6]."""
        own = fixed[self.nodes.array]
        for k, node in enumerate(self.nodes.array):
            moves = _check.concrete(self.displacements)
            moves = np.ones((len(own), 3)) if moves is None else moves  # traced: could be any
            loose = (np.broadcast_to(moves, (len(own), 3))[k] != 0) & ~own[k, :3]
            if loose.any():
                raise ValueError(
                    f"displacements[{k}]: node {node} is free along "
                    f"{'xyz'[int(loose.argmax())]}; only what is held can be moved"
                )
            if self.rotations is not None and not own[k, 3:].all():
                raise ValueError(f"rotations[{k}]: node {node} is not clamped")

    def steps(self, shape, dtype):
        """Steps of all nodes, as `shape`: translation, and rotation vector of six columns."""
        step = jnp.broadcast_to(self.displacements.astype(dtype), (len(self.nodes), 3))
        if shape[1] == 6:
            turn = 0.0 if self.rotations is None else self.rotations
            turn = jnp.broadcast_to(jnp.asarray(turn, dtype), step.shape)
            step = jnp.concatenate([step, turn], axis=1)
        return jnp.zeros(shape, dtype).at[self.nodes].add(step)


def _padded(forces, shape):
    """Forces [n_node, 3] with no moments beside them if `shape` has columns for them."""
    return forces if shape[1] == 3 else jnp.pad(forces, ((0, 0), (0, 3)))


def as_list(loads):
    """Loads of a phase as a list: None, one load, or a list or tuple of loads."""
    if loads is None:
        return []
    items = list(loads) if isinstance(loads, list | tuple) else [loads]
    for k, load in enumerate(items):
        if not hasattr(load, "nodal_forces") and not isinstance(load, SupportMovement):
            raise ValueError(f"loads[{k}]: {type(load).__name__} is not a load")
    return items
