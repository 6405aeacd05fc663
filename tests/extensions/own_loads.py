"""A load written outside of the package, against its contract: wind that grows with height."""

import jax.numpy as jnp
import numpy as np

from jaxcable.extend import DeadLoad, as_floats, pytree, register, set_fields

PLACES, WEIGHTS = np.polynomial.legendre.leggauss(4)
PLACES, WEIGHTS = 0.5 * (1 + PLACES), 0.5 * WEIGHTS  # from 0 to 1 along an element


@register
@pytree
class PowerLawWind(DeadLoad):
    """Wind on all elements of two ends, by the power law of the height z of their initial places.

    The force per length is ``reference (z / 10 m)**exponent``; heights below the ground have none.

    Args:
        reference: force per length at 10 m, [3], N/m.
        exponent: scalar.
    """

    reference: object
    exponent: object

    scales = ("reference",)

    def __post_init__(self):
        set_fields(self, reference=as_floats(self.reference, "reference"))
        set_fields(self, exponent=as_floats(self.exponent, "exponent"))

    def check(self, structure):
        if any(group.links.shape[1] != 2 for group in structure.groups):
            raise ValueError("PowerLawWind: elements of two ends only")

    def element_forces(self, groups, states, nodes, shape, dtype):
        total = jnp.zeros(shape, dtype)
        for group in groups:
            first, second = nodes[group.links[:, 0]], nodes[group.links[:, 1]]
            length = jnp.linalg.norm(second - first, axis=1)
            heights = first[:, 2:] + jnp.outer(second[:, 2] - first[:, 2], PLACES)
            blown = heights > 0
            profile = (jnp.where(blown, heights, 10.0) / 10.0) ** self.exponent * blown
            for end, shape_function in ((0, 1 - PLACES), (1, PLACES)):
                amount = length * (profile @ (WEIGHTS * shape_function))
                force = jnp.outer(amount, self.reference)
                total = total.at[group.links[:, end], :3].add(force)
        return total
