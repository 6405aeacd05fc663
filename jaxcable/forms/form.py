"""The result of form finding, `Form`: a shape in equilibrium, ready to be analysed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import jax.numpy as jnp
from jax import lax

from ..common import status
from ..common.tree import copy_with, pytree
from ..common.types import Array, Float, Int, PyTree
from ..elements.bar import Straight
from ..model.structure import Structure
from ..numerics import implicit, scaled
from .form_dependent_loads import laws_can_carry_tensions


@pytree
class Form:
    """The result of form finding: a shape in equilibrium, its forces, and the lengths to cut.

    An analysis of ``jc.replace(structure, nodes=form.positions)`` begins in equilibrium with
    ``jc.Phase(pretension=form.tension, loads=loads)``, and so it does with
    ``rest_length=form.rest_length``. Unless the status is OK, all fields but the status, the
    residuals, the iterations and `nearest` are NaN, with NaN derivatives.

    Attributes:
        positions: positions of all nodes, [n_node, 3], m.
        tension: axial force per element in the shape of `elements`, each [n_elem], N.
        length: distance of an element's ends, in the shape of `elements`, m.
        rest_length: unstressed length, in the shape of `elements`, m: `length` over one plus the
            strain that the group's law gives for the tension.
        force_density: tension over length, in the shape of `elements`, N/m.
        status: status code; `describe` has the texts.
        residual: largest unbalanced force at a free degree of freedom, N.
        relative_residual: `residual` over a scale: the sum of absolute end forces plus the load at
            a node, its largest value over all nodes.
        iterations: number of linear solves, or of time steps of a dynamic relaxation.
        nearest: both node numbers of the element whose length has fallen to the smallest fraction
            of its start, [2]. If the status says that nodes have met, these have. Known of failed
            forms, too.

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


def most_shortened_element(
    groups: Sequence[Straight],
    start: Float[Array, "n_node 3"],
    positions: Float[Array, "n_node 3"],
) -> Int[Array, " 2"]:
    """Return both nodes of the element with the smallest ratio of length to start length, [2]."""
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
    """Make a `Form` from a shape and its forces, whose values per element are lists of groups.

    The status is MATERIAL_FAILURE if a law cannot carry its force. `arrange_form_as_elements` gives
    the lists the pytree structure of the elements.

    Args:
        groups: element groups, with links as arrays.
        positions: positions of all nodes, [n_node, 3], m.
        tensions: axial forces per group, [n_elem], N.
        code: status of the search.
        residual, scale: largest unbalanced force, and the force that it is compared with, N.
        iterations: number of linear solves or time steps.
        parameters: everything that the form depends on; its derivatives are NaN if the form failed.
        met: from `most_shortened_element`, [2].
        rests: unstressed lengths per group, [n_elem], m; None: they follow from the tensions.
    """
    carried = laws_can_carry_tensions(*lax.stop_gradient((groups, tensions)))
    law_code = jnp.where(carried, status.OK, status.MATERIAL_FAILURE)
    code = status.first_failure(code, law_code).astype(jnp.int32)
    ok = code == status.OK
    # forces beyond the curve of a law, or NaN, must not make other cases of a batch NaN
    groups, positions, tensions = implicit.stop_gradient_unless(ok, (groups, positions, tensions))
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
    relative = scaled.relative_residual(residual, scale)
    arrays = positions, tensions, lengths, rests, densities
    return Form(*arrays, code, residual, relative, iterations, met)


def arrange_form_as_elements(form: Form, structure: Structure) -> Form:
    """Return a `Form` from `make_form` with its lists per group in the pytree of the elements."""
    names = ("tension", "length", "rest_length", "force_density")
    return copy_with(form, **{name: structure.arrange(getattr(form, name)) for name in names})
