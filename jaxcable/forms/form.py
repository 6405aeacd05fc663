"""The result of form finding, `Form`: a shape in equilibrium, ready to be analysed."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

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
    ``rest_length=form.rest_length``. Beams that have bent cannot begin so: analyse the structure as
    drawn, with a phase that states the `rest_length` of the groups with prescribed values
    (``rest_length={name: form.rest_length[name] ...}``) and has the loads. It leads to the form, as
    does ``jacking`` with their tensions, and later analyses go on from it by ``start=``. Loads that
    refer to drawn lengths or areas differ then: state line loads per "unstressed" length.

    Unless the status is OK, all fields but the status, the residuals, the iterations and `nearest`
    are NaN, with NaN derivatives.

    Attributes:
        positions: positions of all nodes, [n_node, 3], m.
        tension: axial force per element in the shape of `elements`, each [n_elem], N; None for a
            group of elements without one.
        length: distance of an element's ends, along all its nodes if it has more, in the shape of
            `elements`, m; None for elements of one node, and faces.
        rest_length: unstressed length, in the shape of `elements`, m: `length` over one plus the
            strain that the group's law gives for the tension; of a group without prescribed values
            the one that it has.
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
    tensions: Sequence[Float[Array, " n_elem"]] = (),
) -> Int[Array, " 2"]:
    """Return both nodes of the element with the smallest ratio of length to start length, [2].

    Where prescribed `tensions` are given, [n_elem] per group, N, only elements with one count, if
    there are any: force densities always have a form, and elements of given length, whose forces
    are 0 here, are crushed by others.
    """
    links = jnp.concatenate([jnp.asarray(group.links) for group in groups])
    before, after = (
        jnp.sum((x[links[:, 1]] - x[links[:, 0]]) ** 2, axis=1) for x in (start, positions)
    )
    ratio = jnp.where((before > 0) & jnp.isfinite(after), after / before, jnp.inf)
    if tensions:
        pulled = jnp.concatenate(list(tensions)) != 0
        ratio = jnp.where(pulled | ~jnp.any(pulled), ratio, jnp.inf)
    return links[jnp.argmin(ratio)]


def make_judged_form(
    groups: Sequence[Any],
    positions: Float[Array, "n_node 3"],
    tensions: Sequence[Any],
    code: Int[Array, ""],
    residual: Float[Array, ""],
    scale: Float[Array, ""],
    iterations: Int[Array, ""],
    parameters: PyTree[Array],
    met: Int[Array, " 2"],
    rests: Sequence[Any] | None = None,
    follows_law: Sequence[bool] | None = None,
) -> Form:
    """Judge a shape and its forces, and make the `Form`, whose values per element are lists.

    Of a search without failure the status becomes PUSHING_CABLE if a cable is in compression, and
    MATERIAL_FAILURE if a law cannot carry its force. A failed form has NaN.
    `arrange_form_as_elements` gives the lists the pytree of the elements.

    Args:
        groups: element groups, with links as arrays.
        positions: positions of all nodes, [n_node, 3], m.
        tensions: axial forces per group, [n_elem], N; None for a group without axial forces.
        code: status of the search.
        residual, scale: largest unbalanced force, and the force that it is compared with, N.
        iterations: number of linear solves or time steps.
        parameters: everything that the form depends on; its derivatives are NaN if the form failed.
        met: from `most_shortened_element`, [2].
        rests: unstressed lengths per group, [n_elem], m; None: they follow from the tensions.
        follows_law: for each group whether its unstressed lengths follow from its tensions, by a
            law that must carry them, in spite of `rests`; None: as `rests` says.
    """
    judged = [True] * len(groups) if follows_law is None else follows_law
    by_law = [group for group, own in zip(groups, judged, strict=True) if own]
    forces = [force for force, own in zip(tensions, judged, strict=True) if own]
    pushing = [
        jnp.any(force < 0)
        for group, force in zip(by_law, forces, strict=True)
        if group.tension_only
    ]
    carried = laws_can_carry_tensions(*lax.stop_gradient((by_law, forces)))
    force_code = jnp.where(carried, status.OK, status.MATERIAL_FAILURE)
    if pushing:
        force_code = jnp.where(jnp.any(jnp.stack(pushing)), status.PUSHING_CABLE, force_code)
    code = status.first_failure(code, force_code).astype(jnp.int32)
    ok = code == status.OK
    # forces beyond the curve of a law, or NaN, must not make other cases of a batch NaN
    groups, positions, tensions = implicit.stop_gradient_unless(ok, (groups, positions, tensions))
    lengths = [_lengths_along_nodes(group, positions[group.links]) for group in groups]
    pairs = list(zip(lengths, tensions, strict=True))
    densities = [
        None if force is None or length is None else force / length for length, force in pairs
    ]
    if rests is None or follows_law is not None:
        known = [None] * len(groups) if rests is None else rests
        rests = [
            length / (1 + group.strain_at(force, group.initial_memory())) if own else rest
            for group, (length, force), own, rest in zip(groups, pairs, judged, known, strict=True)
        ]
    values = positions, tensions, lengths, rests, densities
    positions, tensions, lengths, rests, densities = implicit.nan_unless(ok, values, parameters)
    relative = scaled.relative_residual(residual, scale)
    arrays = positions, tensions, lengths, rests, densities
    return Form(*arrays, code, residual, relative, iterations, met)


def _lengths_along_nodes(group, ends):
    """Return the length of every element of a group along its nodes, [n_elem], m.

    `ends` are their positions, [n_elem, n_end, 3], m. None for faces, and elements of one node.
    """
    n_end = ends.shape[1]
    if n_end == 2:
        return group.chord(ends)
    if n_end == 1 or group.face is not None:
        return None
    return jnp.sum(jnp.linalg.norm(ends[:, 1:] - ends[:, :-1], axis=-1), axis=1)


def arrange_form_as_elements(form: Form, structure: Structure) -> Form:
    """Return a `Form` of `make_judged_form`, its lists of groups in the pytree of the elements."""
    names = ("tension", "length", "rest_length", "force_density")
    return copy_with(form, **{name: structure.arrange(getattr(form, name)) for name in names})
