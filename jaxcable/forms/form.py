"""The result of form finding, `Form`: a shape in equilibrium, ready to be analysed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import jax.numpy as jnp
from jax import lax

from ..common import status
from ..common.tree import copy, pytree
from ..common.types import Array, Float, Int, PyTree
from ..elements.bar import Straight
from ..model.structure import Structure
from ..numerics import implicit, scaled
from .along import carries


@pytree
class Form:
    """A shape, its forces, and the unstressed lengths to cut.

    The structure ``jc.replace(structure, nodes=form.positions)`` is in equilibrium at once in an
    analysis with ``jc.Phase(pretension=form.tension, loads=loads)``, or with
    ``rest_length=form.rest_length``. Unless the status is OK everything but the status, the
    residuals and the iterations is NaN, with NaN derivatives.

    Attributes:
        positions: positions of all nodes, [n_node, 3], m.
        tension: axial force per element in the shape of `elements`, each [n_elem], N.
        length: distance of an element's ends, likewise, m.
        rest_length: unstressed length, likewise, m: `length` over one plus the strain that belongs
            to the tension by the group's law.
        force_density: tension over length, likewise, N/m.
        status: status code; `describe` has the texts.
        residual: largest unbalanced force at a free freedom, N.
        relative_residual: `residual` over its scale: the largest, over nodes, of the sum of the
            absolute end forces plus the load.
        iterations: number of linear solves, or of time steps of a relaxation.
        nearest: node numbers of the element that has shortened most in the search, by its ratio,
            [2]; the nodes that have met, if the status says so. Known of failed forms, too.

    Example:
        A saddle of four cables with 500 N each, whose middle ends halfway, from any start:

        >>> nodes = [[1.0, 0, 1], [-1, 0, 1], [0, 1, -1], [0, -1, -1], [0.3, 0.1, 0.2]]
        >>> cables = jc.Cables([[0, 4], [1, 4], [2, 4], [3, 4]], axial_stiffness=1e5)
        >>> structure = jc.Structure(nodes, cables, supports=jc.pinned([0, 1, 2, 3]))
        >>> form = jc.find_form(structure, tension=500.0)
        >>> print(jc.describe(form.status), jnp.round(form.positions[4], 6) + 0.0)
        converged [0. 0. 0.]
        >>> print(f"{form.length[0]:.6f} m, {form.force_density[0]:.3f} N/m")  # sqrt(2), N / l
        1.414214 m, 353.553 N/m
        >>> print(f"{form.rest_length[0]:.6f} m")  # l / (1 + 500 / 1e5)
        1.407178 m
    """

    _shown: ClassVar[str] = "positions m, tension N, length m, residual N, iterations"

    positions: Float[Array, "n_node 3"]
    tension: PyTree[Float[Array, " n_elem"]]
    length: PyTree[Float[Array, " n_elem"]]
    rest_length: PyTree[Float[Array, " n_elem"]]
    force_density: PyTree[Float[Array, " n_elem"]]
    status: Int[Array, ""]
    residual: Float[Array, ""]
    relative_residual: Float[Array, ""]
    iterations: Int[Array, ""]
    nearest: Int[Array, " 2"]


def nearest(
    groups: Sequence[Straight],
    start: Float[Array, "n_node 3"],
    positions: Float[Array, "n_node 3"],
) -> Int[Array, " 2"]:
    """Node numbers of the element whose length is smallest over that at the start, [2]."""
    links = jnp.concatenate([jnp.asarray(group.links) for group in groups])
    before, after = (
        jnp.sum((x[links[:, 1]] - x[links[:, 0]]) ** 2, axis=1) for x in (start, positions)
    )
    ratio = jnp.where((before > 0) & jnp.isfinite(after), after / before, jnp.inf)
    return links[jnp.argmin(ratio)]


def make_form(
    groups: Sequence[Straight],
    positions: Float[Array, "n_node 3"],
    tensions: Sequence[Float[Array, " n_elem"]],
    code: Int[Array, ""],
    residual: Float[Array, ""],
    scale: Float[Array, ""],
    iterations: Int[Array, ""],
    parameters: PyTree[Array],
    met: Int[Array, " 2"],
    rests: Sequence[Float[Array, " n_elem"]] | None = None,
) -> Form:
    """The `Form` of a shape and its forces, with lists per group in place of the elements' shape.

    The status is MATERIAL_FAILURE if a law cannot carry its force; see `arranged` for the shape.

    Args:
        groups: element groups, with links as arrays.
        positions: positions of all nodes, [n_node, 3], m.
        tensions: axial forces per group, [n_elem], N.
        code: status of the search.
        residual, scale: largest unbalanced force, and the force that it is compared with, N.
        iterations: number of linear solves or time steps.
        parameters: everything that the form depends on.
        met: node numbers of the element that has shortened most, see `nearest`.
        rests: unstressed lengths per group, [n_elem], m, if they are known; else they follow from
            the tensions.
    """
    carried = carries(*lax.stop_gradient((groups, tensions)))
    law_code = jnp.where(carried, status.OK, status.MATERIAL_FAILURE)
    code = status.first_failure(code, law_code).astype(jnp.int32)
    ok = code == status.OK
    # forces beyond the curve of a law, or NaN, must not pollute the other cases of a batch
    groups, positions, tensions = implicit.gate(ok, (groups, positions, tensions))
    lengths = [group.chord(positions[group.links]) for group in groups]
    pairs = list(zip(lengths, tensions, strict=True))
    densities = [force / length for length, force in pairs]
    if rests is None:
        rests = [
            length / (1 + group.strain_at(force, group.initial_memory()))
            for group, (length, force) in zip(groups, pairs, strict=True)
        ]
    values = positions, tensions, lengths, rests, densities
    positions, tensions, lengths, rests, densities = implicit.nan_unless(ok, values, parameters)
    relative = scaled.relative(residual, scale)
    arrays = positions, tensions, lengths, rests, densities
    return Form(*arrays, code, residual, relative, iterations, met)


def arranged(form: Form, structure: Structure) -> Form:
    """A `Form` with its lists per group brought into the shape of the structure's elements."""
    names = ("tension", "length", "rest_length", "force_density")
    return copy(form, **{name: structure.arrange(getattr(form, name)) for name in names})
