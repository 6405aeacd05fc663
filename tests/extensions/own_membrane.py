"""An element written outside of the package, against its contract: a triangle of a membrane.

Constant strain, plane stress, St. Venant-Kirchhoff: ``N = N0 + C (E + e0)`` per unit width with
Green's strain E of the midsurface. Source: Bonet and Wood (2008), chapters 4 and 9.
"""

from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np

from jaxcable.extend import (
    ElementState,
    Indices,
    Prestressable,
    Result,
    copy_with,
    floats_per_element,
    pytree,
    register,
    set_fields,
)


@pytree
class Strained(ElementState):
    """What phases change: an initial strain, the same in all directions; and areas, [n_elem].

    Also where the elements were when they were added, `moved` [n_elem, 3, 3] from their ends: there
    they are unstressed.
    """

    prestrain: object
    area: object
    moved: object
    present: object = None


@register
@pytree(indices=("links",))
class Membranes(Prestressable):
    """Triangles of a membrane.

    Args:
        links: corners, [n_elem, 3].
        stiffness: E t, scalar or [n_elem], N/m.
        poisson: ratio, scalar or [n_elem].
        weight: scalar or [n_elem], N/m2.
    """

    links: object
    stiffness: object
    poisson: object = 0.0
    weight: object = None

    per_element = ("stiffness", "poisson", "weight")
    results = (Result("membrane_forces", "N/m", ("xx", "yy", "xy")),)
    face = (0, 1, 2)
    phase_inputs = ("prestrain",)

    def __post_init__(self):
        if not isinstance(self.links, Indices):
            set_fields(self, links=Indices(np.asarray(self.links, np.int32)))
        for name in self.per_element:
            own = floats_per_element(getattr(self, name), len(self.links), name)
            set_fields(self, **{name: own})

    def start(self, ends):
        area = jax.vmap(lambda own: self._place(own)[2])(ends)
        return Strained(jnp.zeros_like(area), area, jnp.zeros_like(ends))

    def state_at_activation(self, state, ends, motion):
        none = jax.tree.map(jnp.zeros_like, state)
        return copy_with(
            none, area=self._place(ends + motion)[2], moved=motion, present=state.present
        )

    def apply_phase_inputs(self, state, ends, inputs):
        stated = inputs["prestrain"]
        return copy_with(state, prestrain=stated.select(stated.values, state.prestrain))

    def weights(self, state):
        return None if self.weight is None else self.weight * state.area

    def _place(self, ends):
        """Sides as columns in the plane of the triangle, x along the first, inverse; and area."""
        first, second = ends[1] - ends[0], ends[2] - ends[0]
        along = first / jnp.sqrt(first @ first)
        across = second - (second @ along) * along
        height = jnp.sqrt(across @ across)
        axes = jnp.stack([along, across / height])
        sides = axes @ jnp.stack([first, second], axis=1)
        return axes, jnp.linalg.inv(sides), 0.5 * jnp.sqrt(first @ first) * height

    def _strain(self, state, ends, motion):
        """Deformation gradient [3, 2], Green's strain and prestrain [2, 2], area."""
        axes, inverse, area = self._place(ends + state.moved)
        motion = motion - state.moved
        slope = jnp.stack([motion[1] - motion[0], motion[2] - motion[0]], axis=1) @ inverse
        cross = axes @ slope  # exact where the motion is small against the triangle
        strain = 0.5 * (cross + cross.T + slope.T @ slope)
        return axes.T + slope, strain + state.prestrain * jnp.eye(2), inverse, area

    def _forces(self, strain):
        size = self.stiffness / (1 - self.poisson**2)
        rest = jnp.trace(strain) * jnp.eye(2)
        return size * ((1 - self.poisson) * strain + self.poisson * rest)

    def membrane_forces(self, state, ends, motion):
        """Second Piola-Kirchhoff forces per width, along the first side and across, [3], N/m."""
        force = self._forces(self._strain(state, ends, motion)[1])
        return jnp.stack([force[0, 0], force[1, 1], force[0, 1]])

    def end_forces(self, state, ends, motion):
        gradient, strain, inverse, area = self._strain(state, ends, motion)
        sides = (area * gradient @ self._forces(strain) @ inverse.T).T
        return jnp.concatenate([-jnp.sum(sides, axis=0)[None], sides])

    def energy(self, state, ends, motion):
        _, strain, _, area = self._strain(state, ends, motion)
        return area * self._density(strain)

    def _density(self, strain):
        square = self.poisson * jnp.trace(strain) ** 2
        square = square + (1 - self.poisson) * jnp.sum(strain**2)
        return 0.5 * self.stiffness / (1 - self.poisson**2) * square


@pytree
class Stressed(Strained):
    """Also a force per width along warp and weft, [n_elem, 2], N/m."""

    stress: object = None


@register
@pytree(indices=("links",))
class Cloth(Membranes):
    """Triangles in the plane x, y, with warp along x and weft along y."""

    phase_inputs = ("pretension",)
    components: ClassVar = {"pretension": ("warp", "weft")}

    def start(self, ends):
        before = super().start(ends)
        stress = jnp.zeros((len(ends), 2))
        return Stressed(before.prestrain, before.area, before.moved, stress=stress)

    def apply_phase_inputs(self, state, ends, inputs):
        stated = inputs["pretension"]
        return copy_with(state, stress=stated.select(stated.values, state.stress))

    def _strain(self, state, ends, motion):
        gradient, strain, inverse, area = super()._strain(state, ends, motion)
        axes = self._place(ends + state.moved)[0][:, :2]
        return gradient, (strain, axes, state.stress), inverse, area

    def _forces(self, strain):
        strain, axes, stress = strain
        return super()._forces(strain) + axes @ jnp.diag(stress) @ axes.T

    def _density(self, strain):
        strain, axes, stress = strain
        stated = axes @ jnp.diag(stress) @ axes.T
        return super()._density(strain) + jnp.sum(stated * strain)


def sheet(n, size=1.0, warp=0.0, seed=0):
    """Nodes of a square of n x n quadrilaterals, moved in their plane by `warp`, and triangles."""
    x = np.linspace(0.0, size, n + 1)
    nodes = np.stack([*np.meshgrid(x, x, indexing="ij"), np.zeros((n + 1, n + 1))], axis=-1)
    inside = (slice(1, n), slice(1, n), slice(0, 2))
    nodes[inside] += warp * np.random.default_rng(seed).uniform(-1, 1, nodes[inside].shape)
    number = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    corners = [np.stack(own, axis=-1).reshape(-1, 3) for own in ((a, b, c), (a, c, d))]
    return nodes.reshape(-1, 3), np.concatenate(corners)


jax.config.update("jax_enable_x64", True)
