"""The whole structure: residual, tangent, energy and results of one loaded state.

A `System` holds everything that is fixed while equilibrium is sought at one load factor. Its
unknowns ``x`` are the free displacements, [n_free]; held ones are not among them. The `motion` of
the nodes, which the elements see, is their displacement, [n_node, 3]. Structures with beams have
rotations too: `frames.FrameSystem` has the same members for them.
"""

import jax
import jax.numpy as jnp

from . import linear
from ._tree import copy, pytree
from .elements.element import Rounding
from .elementwise import Elementwise, each
from .freedoms import along, carriers, combined, numbers_of


@pytree
class System(Elementwise):
    """One state of loading, ready to be brought to equilibrium.

    Attributes:
        nodes: initial positions, [n_node, 3], m.
        groups: element groups, their links arrays.
        states: element states, one per group (prestress).
        load: dead load on every node, [n_node, 3], N.
        held: displacement of every freedom along its own direction, used where it is held,
            [3 n_node], m.
        freedoms: numbering of the unknowns.
        followers: loads that depend on where the nodes are, a list of what has the
            members of `load_stacks.Following`, or None.
    """

    nodes: object
    groups: object
    states: object
    load: object
    held: object
    freedoms: object
    followers: object = None

    turning = False

    def motion(self, x):
        """Displacement of all nodes, [n_node, 3], from the unknowns [n_free]."""
        own = jnp.concatenate([x, self.held])[self.freedoms.source].reshape(self.nodes.shape)
        return own if self.freedoms.axes is None else combined(self.freedoms.axes, own)

    def unknowns(self, motion):
        """The unknowns [n_free] of a motion [n_node, 3]."""
        own = motion if self.freedoms.axes is None else along(self.freedoms.axes, motion)
        return own.reshape(-1)[self.freedoms.free]

    def place(self, x):
        """Unknowns to start from: `x` itself, which holds nothing of the supports."""
        return x

    def carried(self, x):
        """`x`, a constant, as a function of what supports do to free nodes: nothing."""
        return x

    def move(self, x, step):
        """The unknowns after a step [n_free]."""
        return x + step

    def reach(self, x):
        """Largest displacement of a point, m."""
        return jnp.max(jnp.abs(x), initial=0.0)

    def chart(self, x):
        """Residual as a function of numbers [n_free], the numbers of `x`, and the way back.

        What only other phases leave free stays where it is: it has some stiffness, and no force.
        """
        return (lambda x: self._held_still(self.residual(x), x)), x, lambda numbers: numbers

    def _held_still(self, residual, numbers):
        """Residual [n_free], about `numbers`, with that of what is held in this phase only."""
        bound = self.freedoms.bound
        if bound is None:
            return residual
        return residual + jnp.where(bound, numbers - jax.lax.stop_gradient(numbers), 0.0)

    def internal_force(self, motion, end_forces=None):
        """Sum of the end forces at every node, [n_node, 3], and of their norms, [n_node], N.

        `end_forces` are those of every group, if they are at hand.
        """
        if end_forces is None:
            end_forces = self.reading(motion, "end_forces")["end_forces"]
        rows, ends = self._at_ends(end_forces)
        force = jnp.zeros_like(motion).at[rows].add(ends)
        size = jnp.zeros_like(motion[:, 0]).at[rows].add(jnp.sqrt(jnp.sum(ends**2, axis=-1)))
        for group, state in zip(self.groups, self.states, strict=True):
            if group.remembers:
                size = size.at[group.links].add(self.part_sizes(group, state, motion))
        return force, size

    def _at_ends(self, values):
        """Rows of the ends of all groups one after the other, and values [n_elem, n_end, ...]."""
        rows = [group.links.reshape(-1) for group in self.groups]
        values = [own.reshape(-1, *own.shape[2:]) for own in values]
        return (own[0] if len(own) == 1 else jnp.concatenate(own) for own in (rows, values))

    def part_sizes(self, group, state, motion):
        """Forces inside elements that can balance each other there, at both ends, [n_elem, 2], N.

        An unloaded elastic-plastic element is in equilibrium to the rounding of these.
        """
        sizes = each("size", group, state, self.nodes, motion)[:, None]
        return jnp.repeat(sizes, group.links.shape[1], axis=1)

    def all_load(self, motion):
        """Dead and following loads on every node, as `load`, N."""
        if self.followers is None:
            return self.load
        following = self.following(self.nodes + motion[:, :3])
        if self.load.shape[1] > 3:
            following = jnp.pad(following, ((0, 0), (0, 3)))
        return self.load + following

    def following(self, moved):
        """Following loads on every node at the positions `moved`, both [n_node, 3], N."""
        arguments = self.groups, self.states, self.nodes, moved
        return sum(own.following_forces(*arguments) for own in self.followers)

    def unbalanced(self, motion, end_forces=None):
        """Internal force minus load at every node, [n_node, 3], N."""
        return self.internal_force(motion, end_forces)[0] - self.all_load(motion)

    def residual(self, x):
        """Unbalanced force at every free freedom, [n_free], N."""
        return self.collected(self.unbalanced(self.motion(x)))

    def evaluated(self, x):
        """`residual_and_scale`, and tangents of elements that are found with it, for `tangent`."""
        end_forces, tangents = self.linearized(self.motion(x))
        return *self.residual_and_scale(x, end_forces), tangents

    def residual_and_scale(self, x, end_forces=None):
        """Residual [n_free], and the force it is judged by, N.

        The scale is the largest, over nodes, of the sum of absolute end forces plus the load.
        """
        motion = self.motion(x)
        (force, size), load = self.internal_force(motion, end_forces), self.all_load(motion)
        scale = jnp.max(size + jnp.sqrt(jnp.sum(load**2, axis=-1)))
        return self.collected(force - load), scale

    @property
    def rounds(self):
        """Whether any element may be without force and yet have the rounding of its stiffness."""
        return any(isinstance(group, Rounding) for group in self.groups)

    def rounding(self, x):
        """Residual that the rounding of displacements leaves at every freedom, [n_free], N."""
        motion = self.motion(x)
        left = jnp.zeros_like(self.load)
        for group, state in zip(self.groups, self.states, strict=True):
            if isinstance(group, Rounding):
                ends = each("rounding", group, state, self.nodes, motion)
                left = left.at[group.links, : ends.shape[-1]].add(ends)
        return self.collected(left)

    def collected(self, force):
        """Forces on the nodes [n_node, 3] at the free freedoms, [n_free], N."""
        return self.freedoms.released(self.unknowns(force))

    def load_norm(self, x):
        """Euclidean norm of the load on the free freedoms, N."""
        return jnp.linalg.norm(self.collected(self.all_load(self.motion(x))))

    def unsymmetric(self):
        """Whether the tangent is not symmetric: loads follow."""
        return self.followed

    @property
    def followed(self):
        """Whether a load follows the nodes, scalar bool: of a later phase it does not act yet."""
        if self.followers is None:
            return jnp.zeros((), bool)
        return jnp.any(jnp.stack([own.acts for own in self.followers]))

    def tangent(self, x, known=None):
        """Tangent stiffness, a matrix of `linear`, N/m: autodiff of the element forces.

        Dense [n_free, n_free], or sparse if the freedoms have a pattern. `known` are tangents of
        elements that are at hand, see `linearized`.
        """
        motion = self.motion(x)
        parts = self.parts(self.tangents(motion, known), motion)
        return self._assemble(parts + self._following_blocks(motion))

    def parts(self, matrices, motion):
        """Matrices [n_elem, d, d] of the elements of all groups as `linear.assemble` takes them."""
        pairs = zip(matrices, self.groups, strict=True)
        return [self._part(b, g.links, g.n_freedom, motion, g.inner) for b, g in pairs]

    def assembled(self, parts, motion):
        """A matrix as `tangent` from those of elements, list of ([n_elem, d, d], their group)."""
        return self._assemble(
            [self._part(b, group.links, group.n_freedom, motion, group.inner) for b, group in parts]
        )

    def _following_blocks(self, motion):
        """What following loads take from the tangent, as `parts`."""
        if self.followers is None:
            return []
        arguments = self.groups, self.states, self.nodes, self.nodes + motion[:, :3]
        return [
            self._part(-blocks, links, 3, motion)
            for own in self.followers
            for blocks, links in own.following_blocks(*arguments)
        ]

    def _part(self, blocks, links, width, motion, inner=()):
        """Matrices of elements as `linear.assemble` takes them, by the unknowns of their ends."""
        freedoms = self.freedoms
        number = numbers_of(freedoms.number, links, width, inner, freedoms.carried)
        n_elem = len(blocks)
        blocks = blocks.reshape(n_elem, -1, round((blocks.size // n_elem) ** 0.5))
        slopes = self._slopes(motion)
        if slopes is not None:
            n_end = links.shape[1] - (1 + max((row for row, _ in inner), default=-1))
            own = slopes[links[:, :n_end], :width]
            if freedoms.carried is None:
                own = own[..., :width]
            blocks = _by_numbers(blocks, own, len(inner))
        return blocks, number

    def _slopes(self, motion):
        """Change of a row's motion by the numbers of its unknowns; None if these are the same.

        [n_row, 3, 3]: the directions of its freedoms.
        """
        axes = self.freedoms.axes
        return None if axes is None else jnp.swapaxes(jnp.asarray(axes), 1, 2)

    def secant(self, before, x):
        """Secant stiffness between two states, each [n_free], as `tangent`, N/m."""
        before, motion = self.motion(before), self.motion(x)
        return self._assemble(self.parts(self.secants(before, motion), motion))

    def displaced_by(self, motion):
        """Displacements of all rows by the unknowns, [n_row, 3, n_free], about a motion."""
        freedoms, n_row = self.freedoms, len(motion)
        number, slopes = freedoms.number, self._slopes(motion)
        if freedoms.carried is not None:
            number = number[carriers(n_row, freedoms.carried)]
        if slopes is None:
            number = number[:, :3]
            slopes = jnp.broadcast_to(jnp.eye(3, dtype=motion.dtype), (n_row, 3, 3))
        moved = jnp.zeros((n_row, 3, freedoms.free.shape[0] + 1), motion.dtype)
        at = jnp.arange(n_row)[:, None, None], jnp.arange(3)[None, :, None], number[:, None, :]
        return moved.at[at].add(slopes[:, :3])[..., :-1]

    def _assemble(self, parts):
        matrix = linear.assemble(parts, self.freedoms.free.shape[0], self.freedoms.pattern)
        bound = self.freedoms.bound
        return matrix if bound is None else linear.held_at(matrix, bound)

    def potential(self, x):
        """Stored energy minus the work of the dead loads, J; the residual is its gradient.

        Following loads are left out: they need not have a potential.
        """
        motion = self.motion(x)
        return self.stored_energy(motion) - jnp.sum(self.load * motion)

    def reactions(self, motion, end_forces=None):
        """Forces of the supports on the structure, [n_node, 3], N; zero where free."""
        force, axes = self.unbalanced(motion, end_forces), self.freedoms.axes
        if axes is None:
            return jnp.where(self.freedoms.fixed, force, 0.0)
        return combined(axes, jnp.where(self.freedoms.fixed, along(axes, force), 0.0))

    def loose_nodes(self, motion, slack=None):
        """Nodes that are not wholly supported and touch only slack elements, [n_node] bool."""
        slack = self.slack(motion) if slack is None else slack
        pairs = zip(self.groups, slack, strict=True)
        rows, taut = self._at_ends([jnp.repeat(~s[:, None], g.links.shape[1], 1) for g, s in pairs])
        held_up = jnp.zeros(self.nodes.shape[0], bool).at[rows].max(taut)
        if self.freedoms.rows is not None:
            held_up = held_up.at[self.freedoms.rows].max(held_up)
        return ~held_up & ~jnp.all(self.freedoms.fixed, axis=-1)

    def kinked(self, motion):
        """Whether a cable that moves with free nodes is exactly unstressed.

        Equilibrium then has no derivative. (Laws with plastic strains slacken elsewhere.)
        """
        found, free = jnp.zeros((), bool), self.freedoms.moves()
        for group, state in zip(self.groups, self.states, strict=True):
            if group.tension_only and not group.remembers:
                moves = jnp.any(free[group.links], axis=(1, 2))
                kink = each("at_kink", group, state, self.nodes, motion)
                found = found | jnp.any(kink & moves)
        return found

    @property
    def may_be_convex(self):
        """Whether the energy is convex while loads are dead: tension-only groups of rising laws."""
        return all(group.tension_only and group.rising for group in self.groups)

    @property
    def always_convex(self):
        """Whether it is convex, and no load follows or slides, in this phase or a later one."""
        return self.may_be_convex and self.followers is None and not self._sliding

    @property
    def convex(self):
        """Whether the energy is convex, scalar bool."""
        if self.always_convex or not self.may_be_convex:
            return jnp.asarray(self.always_convex)
        still = [jnp.all(load == 0) for load in self._sliding]
        return jnp.all(jnp.stack([~self.followed, *still]))

    @property
    def _sliding(self):
        """Loads that slide along elements, a list of [n_elem, 3], N/m."""
        pairs = zip(self.groups, self.states, strict=True)
        loads = [state.line_load for group, state in pairs if group.slides]
        return [load for load in loads if load is not None]

    def softened(self, compliance):
        """The same system with a spring in series with every element, strain per force, 1/N."""
        return copy(self, groups=[group.softened(compliance) for group in self.groups])


def _by_numbers(blocks, slopes, n_inner):
    """Matrices [n_elem, d, d] of ends by those of the numbers behind them; inner numbers stay.

    `slopes`: change of each end by its numbers, [n_elem, n_end, width, n_number].
    """
    n_elem, n_end, width, n_number = slopes.shape
    whole = jnp.zeros((n_elem, n_end * width + n_inner, n_end * n_number + n_inner), blocks.dtype)
    for k in range(n_end):
        rows, columns = slice(k * width, (k + 1) * width), slice(k * n_number, (k + 1) * n_number)
        whole = whole.at[:, rows, columns].set(slopes[:, k].astype(blocks.dtype))
    if n_inner:
        whole = whole.at[:, n_end * width :, n_end * n_number :].set(jnp.eye(n_inner))
    return jnp.einsum("eai,eab,ebj->eij", whole, blocks, whole)
