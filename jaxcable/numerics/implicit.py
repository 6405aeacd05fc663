"""The derivative of an equilibrium by the implicit function theorem: adjoint and tangent solves.

With ``R(x, p) = 0`` the derivative of ``x`` is ``dx = -K^-1 R_p dp``, whatever iteration found
``x`` and however many increments it took. `implicit_root` attaches it to ``x`` and to the results
of elements there, in forward mode (one solve with K) and reverse mode (one adjoint solve with K^T),
to any order. Results without a valid derivative get NaN, never a silent zero.
"""

from __future__ import annotations

from typing import Any, NamedTuple, TypeAlias, TypeVar

import jax
import jax.numpy as jnp
from jax import lax

from .. import linear
from ..common.jax_internals import is_tracing
from ..common.tree import merge_indices, select_tree, split_indices
from ..common.types import Array, ArrayLike, Bool, Float, Int, PyTree
from ..linear.sparse import FactorRecord
from .implicit_root import TangentSolver, implicit_root
from .nan_marks import nan_unless_valid

Tree = TypeVar("Tree")
System: TypeAlias = Any
"""`mechanics.assembly.System`, which cannot be imported here: it stands on this room."""


class DerivativeMarks(NamedTuple):
    """Zeros whose derivative is NaN where that of an equilibrium is not defined.

    Attributes:
        of_rows: for the motion of every row, [n_row].
        of_forces: for all forces of elements, which do not depend on nodes without stiffness.
    """

    of_rows: Float[Array, " n_row"]
    of_forces: Float[Array, ""]


def stop_gradient_unless(open_: Bool[ArrayLike, ""], tree: Tree) -> Tree:
    """Return `tree`, with the derivatives of its floats stopped (zero) unless `open_` is true.

    A select does it, because zero times a NaN of the backward pass would be NaN.
    """

    def one(x):
        x = jnp.asarray(x)
        floating = jnp.issubdtype(x.dtype, jnp.floating)
        return select_tree(open_, x, lax.stop_gradient(x)) if floating else x

    return jax.tree.map(one, tree)


def attach_derivative(
    system: System, x: Float[Array, "n_row n_motion"], valid: Bool[ArrayLike, ""]
) -> Float[Array, "n_row n_motion"]:
    """Return the equilibrium `x` of a system with its derivative by the implicit function theorem.

    Args:
        system: the differentiable `System`, whose equilibrium it is.
        x: motion of all nodes; the derivative of this argument is ignored.
        valid: whether `x` is an equilibrium; if not, the derivative is zero.
    """
    return attach_derivative_with_marks(system, x, valid)[0]


def attach_derivative_with_marks(
    system: System,
    x: Float[Array, "n_row n_motion"],
    valid: Bool[ArrayLike, ""],
    factored: FactorRecord | None = None,
    tol: Float[ArrayLike, ""] = 0.0,
    limit: Int[ArrayLike, ""] = 0,
    results: dict[str, Any] | None = None,
) -> tuple[
    Float[Array, "n_row n_motion"],
    Float[Array, "n_row n_motion"],
    DerivativeMarks,
    dict[str, Any],
]:
    """Attach the implicit derivative to an equilibrium, and mark where it is not defined.

    The derivative is not defined at nodes without stiffness, and at a cable exactly between taut
    and slack, unless such nodes can slacken it (`mechanics.kinks`).

    Args:
        system: the differentiable `System`, whose equilibrium it is.
        x: motion of all rows; the derivative of this argument is ignored.
        valid: whether `x` is an equilibrium. If not, the caller has to make all derivatives NaN.
        factored, tol, limit: for conjugate gradients with an earlier factor, as in
            `linear.factorize`.
        results: known results of elements, dict by name, whose derivatives are wanted.

    Returns:
        x: the equilibrium, with derivative NaN where it is not defined.
        bare: the equilibrium, with derivative zero where it is not defined.
        marks: `DerivativeMarks`. Results are computed from `bare`, and the marks are added at the
            end: a NaN in a product would be multiplied by zero in second derivatives, and all of
            them would be NaN.
        results: the results with their derivatives at `bare`.
    """
    x = lax.stop_gradient(x)
    _, numbers, back = system.local_residual(system.with_support_rotations(x))
    # Marks are further unknowns beside the root. A NaN in the root itself would enter the residual
    # there, where second derivatives would multiply it by zero.
    start = jnp.concatenate([numbers, jnp.zeros_like(numbers), jnp.zeros(1, numbers.dtype)])
    known = results or {}
    problem = split_indices((system, x, valid, factored, tol, limit))

    def equation(found, problem):
        return _residual_and_results(found, problem, known)

    solver = TangentSolver(_solve_tangent, _solve_adjoint)
    found, known = implicit_root(equation, start, problem, solver, known)
    found, mark, of_forces = _split_unknowns_and_marks(found)
    if not numbers.size:  # nothing is free: the point depends on supports only, not on the root
        nothing = jnp.zeros(system.nodes.shape[0], x.dtype)
        return back(numbers), back(numbers), DerivativeMarks(nothing, jnp.zeros((), x.dtype)), known
    number, numbering = system.dof_map.unknown_of_dof, system.dof_map.unknown_assembly
    if numbering is None:
        of_dofs = linear.append_zero(mark)[number]
    else:  # whose transpose needs no scatter
        of_dofs = numbering.apply_transpose(mark).reshape(number.shape)
    marks = DerivativeMarks(jnp.sum(of_dofs, axis=1), of_forces[0])
    return back(found + mark), back(found), marks, known


def _split_unknowns_and_marks(values):
    """Split a vector [2 n + 1] into unknowns, [n], their marks, [n], and the mark of forces, [1].

    Marks are the further unknowns that become `DerivativeMarks`.
    """
    count = len(values) // 2
    return jnp.split(values, (count, 2 * count))


def _residual_and_results(found, problem, names):
    """Return the equations of which `implicit_root` takes the derivative, and results of elements.

    Args:
        found: step of the unknowns, then the marks, [2 n + 1].
        problem: the split arguments of `attach_derivative_with_marks`.
        names: names of the results.

    Returns:
        The residual after the step, then the marks, which are zero at the root, [2 n + 1]; the
        results there.
    """
    system, x, *_ = merge_indices(*problem)
    system = system.slacken(system.find_slackened(x).released)
    step, *marks = _split_unknowns_and_marks(found)
    begin = system.impose_supports(system.with_support_rotations(x))
    residual, results = system.after_step(begin, step, *names)
    # NaN if the adjoint solution is, by all parameters: slack elements pass none of it on
    marks = [mark + 0.0 * gradient_probe(system) for mark in marks]
    return jnp.concatenate([residual, *marks]), {name: results[name] for name in names}


def _solve_tangent(problem, _, both):
    """Return ``K^-1 b`` for the tangent K, and marks, NaN where undefined, together [2 n + 1].

    The arguments are those of `TangentSolver.forward`: the split arguments of
    `attach_derivative_with_marks`, a function that is not needed, and b with marks, [2 n + 1].
    """
    factor = _factorize_tangent(problem)
    answer, unknown = factor.solve_with_undefined_mask(both[: len(both) // 2])
    # what loose nodes do has no influence on forces
    fails = jnp.any(unknown & ~factor.loose)
    return jnp.concatenate([answer, jnp.where(jnp.append(unknown, fails), jnp.nan, 0.0)])


def _solve_adjoint(problem, _, both):
    """Return ``K^-T b`` and marks, NaN if this is not defined, together [2 n + 1].

    K is not assembled where b is zero. The arguments are those of `_solve_tangent`.
    """
    b, marks = jnp.split(both, (len(both) // 2,))
    answer = lax.cond(
        jnp.any(b != 0), lambda b: _factorize_tangent(problem).solve_adjoint(b), jnp.zeros_like, b
    )
    return jnp.concatenate([answer, jnp.where(jnp.any(jnp.isnan(answer)), jnp.nan, marks)])


def _factorize_tangent(problem):
    """Factorize the tangent stiffness at the equilibrium x of `problem`.

    `problem` has the split arguments of `attach_derivative_with_marks`. The matrix is the identity
    if x is not valid, and NaN if the residual has a kink at x.
    """
    system, x, valid, *known = merge_indices(*lax.stop_gradient(problem))
    slackened = system.find_slackened(x)
    system = system.slacken(slackened.released)
    matrix = linear.identity_unless(system.tangent(x), valid)
    matrix = linear.nan_unless(matrix, ~(slackened.at_kink & valid))
    loose = system.nodes_without_stiffness(x)[system.dof_map.row_of_unknown] & valid
    return linear.factorize(matrix, loose, *known)


def with_nan_derivative(tree: Tree, parameters: PyTree[Any]) -> Tree:
    """Return `tree`, with NaN for its derivatives with respect to `parameters`.

    It serves for results whose derivative is not computed: a zero would be silently wrong.
    """
    probe = gradient_probe(parameters)
    shape: Any
    leaves, shape = jax.tree.flatten(tree)
    leaves = [jnp.asarray(x) for x in leaves]
    places = [k for k, x in enumerate(leaves) if jnp.issubdtype(x.dtype, jnp.floating)]
    floats = [lax.stop_gradient(leaves[k]) for k in places]
    for k, x in zip(places, _with_nan_derivatives_once(floats, probe), strict=True):
        leaves[k] = x
    return shape.unflatten(leaves)


def first_derivative_only(tree: Tree) -> Tree:
    """Return `tree` with its first derivative, and NaN for all higher derivatives.

    It serves for results whose derivative is exact to first order only.
    """

    def one(x):
        floating = jnp.issubdtype(jnp.asarray(x).dtype, jnp.floating)
        return _identity_with_nan_second_derivative(x) if floating else x

    return jax.tree.map(one, tree)


def nan_unless(ok: Bool[ArrayLike, ""], tree: Tree, parameters: PyTree[Any]) -> Tree:
    """Return `tree` if `ok`, a scalar, else NaN with NaN derivatives by all of `parameters`."""
    return nan_unless_probed(ok, tree, gradient_probe(parameters))


def nan_unless_probed(ok: Bool[ArrayLike, ""], tree: Tree, probe: Float[Array, ""]) -> Tree:
    """Return `tree` if `ok`, else NaN with NaN derivatives by all that a probe depends on.

    Args:
        ok: whether the values are valid, bool, a scalar or for each entry along the first axis.
        tree: the values.
        probe: ``gradient_probe(parameters)``, which is cheaper if it is computed outside of loops.
    """
    shape: Any
    leaves, shape = jax.tree.flatten(tree)
    return shape.unflatten(nan_unless_valid(ok, [jnp.asarray(x) for x in leaves], probe))


def _as_one_subprogram(function):
    """Return `function` such that all its calls in a traced program share one subprogram.

    While nothing is traced, `function` itself runs. It has a `jax.custom_jvp`, whose rule is
    another object in every trace, so that jax would not find two calls to be the same.
    """
    once = jax.jit(function)
    return lambda *arguments: (once if is_tracing() else function)(*arguments)


def gradient_probe(parameters: PyTree[Any]) -> Float[Array, ""]:
    """Return a zero that has derivative 1 with respect to every float in `parameters`.

    What is computed from this zero gets a derivative by all of them, such as NaN.
    """
    leaves = [jnp.asarray(x) for x in jax.tree.leaves(parameters)]
    return _probe_once([x for x in leaves if jnp.issubdtype(x.dtype, jnp.floating)])


@jax.custom_jvp
def _probe_of_floats(floats):
    """Return a zero that has derivative 1 with respect to every entry of a list of float arrays."""
    # a select, so that the zero has the axes that the floats have in a batch
    return sum((jnp.where(x.ravel()[0] > 0, 0.0, 0.0) for x in floats if x.size), jnp.zeros(()))


@_probe_of_floats.defjvp
def _probe_of_floats_jvp(primals, tangents):
    """Forward derivative of `_probe_of_floats`: return the zero, and the sum of all tangents."""
    return _probe_of_floats(*primals), sum((jnp.sum(x) for x in tangents[0]), jnp.zeros(()))


_probe_once = _as_one_subprogram(_probe_of_floats)


@jax.custom_jvp
def _with_nan_derivatives(arrays, probe):
    """Return a list of float arrays as it is, with NaN derivatives by all that `probe` depends on.

    `probe` is the zero of `gradient_probe`.
    """
    return arrays


@_with_nan_derivatives.defjvp
def _with_nan_derivatives_jvp(primals, tangents):
    """Return the arrays and their tangents: NaN if the tangent of the probe is not zero."""
    arrays = primals[0]
    return arrays, nan_unless_valid(False, [jnp.zeros_like(x) for x in arrays], tangents[1])


_with_nan_derivatives_once = _as_one_subprogram(_with_nan_derivatives)


@jax.custom_jvp
def _identity_with_nan_second_derivative(x):
    """Return the array `x` with its first derivative, and NaN for the second one."""
    return x


@_identity_with_nan_second_derivative.defjvp
def _identity_with_nan_second_derivative_jvp(primals, tangents):
    """Return `x` and its tangent, whose own derivative is NaN."""
    (x,), (change,) = primals, tangents
    (one,) = _with_nan_derivatives([jnp.ones((), x.dtype)], jnp.sum(x))
    return x, change * one
