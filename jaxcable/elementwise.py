"""What is read off the elements of a structure, group by group."""

import jax
import jax.numpy as jnp

from .elements.prestress import element


class Elementwise:
    """What a `System` says of its elements; it has `nodes`, `groups` and their `states`."""

    def stored_energy(self, motion):
        """Energy stored in the elements, J."""
        return sum(
            jnp.sum(each("energy", group, state, self.nodes, motion))
            for group, state in zip(self.groups, self.states, strict=True)
        )

    def tensions(self, motion):
        """Axial forces, one array [n_elem] per group, N."""
        return [
            each("tension", group, state, self.nodes, motion)
            for group, state in zip(self.groups, self.states, strict=True)
        ]

    def peak_tensions(self, motion):
        """Axial forces of largest size along the elements; None where they are the `tensions`.

        Without load along an element its axial force is the same everywhere.
        """
        return [
            each("peak_tension", group, state, self.nodes, motion)
            if hasattr(group, "peak_tension") and state.line_load is not None
            else None
            for group, state in zip(self.groups, self.states, strict=True)
        ]

    def slack(self, motion):
        """Slack elements, one boolean array [n_elem] per group."""
        return [
            each("is_slack", group, state, self.nodes, motion)
            for group, state in zip(self.groups, self.states, strict=True)
        ]

    @property
    def remembers(self):
        """Whether any group has plastic strains."""
        return any(group.remembers for group in self.groups)

    @property
    def breaks(self):
        """Whether any element can be strained beyond its curve."""
        return any(group.breaks for group in self.groups)

    def beyond(self, motion):
        """Whether any element is strained beyond its curve."""
        return jnp.any(self.broken(motion))

    def broken(self, motion):
        """Elements strained beyond their curve, all groups one after the other, bool."""
        return jnp.concatenate(
            [
                each("beyond", group, state, self.nodes, motion)
                if group.breaks
                else jnp.zeros(len(group.links), bool)
                for group, state in zip(self.groups, self.states, strict=True)
            ]
        )

    def settle(self, motion):
        """Plastic strains after an increment that ended here, per group, or None."""
        return [
            each("settle", group, state, self.nodes, motion) if group.remembers else None
            for group, state in zip(self.groups, self.states, strict=True)
        ]

    def strains(self, motion):
        """Strains of the elements of every group whose law is not a mere stiffness, else None."""
        return [
            each("section_strain", group, state, self.nodes, motion)
            if getattr(group, "section", None) is not None or group.breaks
            else None
            for group, state in zip(self.groups, self.states, strict=True)
        ]

    def length_scale(self):
        """A length to measure steps by: the mean initial element length, m."""
        return jnp.mean(jnp.concatenate([g.chord(self.nodes[g.links]) for g in self.groups]))

    def extent(self):
        """Size of the whole structure: diagonal of its bounding box, m."""
        return jnp.linalg.norm(jnp.max(self.nodes, axis=0) - jnp.min(self.nodes, axis=0))


def each(method, group, state, nodes, motion):
    """Evaluate an element method for all elements of a group by vmap."""

    def one(properties, state, ends, motion):
        return getattr(element(group, properties), method)(state, ends, motion)

    ends, motion = nodes[group.links], motion_of(group, motion)
    return jax.vmap(one)(group.properties(), state, ends, motion)


def motion_of(group, motion):
    """What the ends of a group's elements see of the motion, [n_elem, n_end, 3 or 7]."""
    width = 3 if group.n_freedom == 3 else 7
    at_ends = motion[group.links]
    return at_ends if at_ends.shape[-1] == width else at_ends[..., :width]
