"""Implicit roots: a known root with the derivative of its equation, as a primitive of jax.

Beside the root, further quantities can be known that depend on it and on the parameters, such as
the results of elements at an equilibrium. One function then returns the residual and these
quantities, and is linearized once for the derivatives of all.

`lax.custom_root` is a custom rule. jax 0.10 drops custom rules when it takes a reverse-mode
derivative of a `lax.scan`, and derivatives of this derivative are then silently zero (jax 0.12 does
not). Primitives are not dropped.

The parameters of the equation are arguments of the primitive, so that the equation is traced only
if a derivative is taken. The derivative is a primitive, too, so that reverse mode stores the
parameters and no intermediate results of the linearization (except in batches of changes, where the
derivative is traced). Its linear systems are implicit roots again: what their derivatives need is
traced for second derivatives only.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple, TypeAlias, TypeVar

import jax
import jax.numpy as jnp
from jax import lax

from ..common import jax_internals as internals
from ..common.compilation import without_garbage_collection
from ..common.types import Array, Float, PyTree

Tree = TypeVar("Tree")
Vector: TypeAlias = 'Float[Array, "*n"]'


class TangentSolver(NamedTuple):
    """How to solve with the derivative ``f_x`` of an equation ``f(x, p) = 0`` at its root.

    Both are functions of the parameters p, of a linear function of x, and of a right side.

    Attributes:
        forward: solves with ``f_x``, the linear function.
        adjoint: solves with its transpose, the linear function.
    """

    forward: Callable[..., Vector]
    adjoint: Callable[..., Vector]


def implicit_root(
    function: Callable[[Vector, PyTree[Any]], Any],
    root: Vector,
    parameters: PyTree[Any],
    solver: TangentSolver | None,
    outputs: Tree | None = None,
) -> Any:
    """Return the known root x of ``f(x, p) = 0``, with its derivatives by p, of any order.

    The implicit function theorem gives ``dx = -f_x^-1 f_p dp``. f is traced only if a derivative is
    taken.

    Args:
        function: ``f(x, p)``, an array like `x`; it depends on no other traced values. With
            `outputs` it returns a pair: f, and a pytree like these.
        root: x, an array, which may have no entries; the derivative of this argument is ignored.
        parameters: p, a pytree.
        solver: `TangentSolver`; None if the root has no entries.
        outputs: known quantities ``y = g(x, p)``, a pytree of floats; the derivatives of this
            argument are ignored. None: there are none.

    Returns:
        The root; with `outputs`, the pair of root and outputs.
    """
    leaves, tree = jax.tree.flatten(parameters)
    shape: Any
    known, shape = jax.tree.flatten(outputs)

    def equation(x, *leaves):
        found = function(x, tree.unflatten(leaves))
        residual, further = (found, None) if outputs is None else found
        return [residual, *jax.tree.leaves(further)]

    def forward(x, rhs, *leaves):
        by = partial(_multiply_by_jacobian, equation)
        return solver.forward(tree.unflatten(leaves), lambda change: by(change, x, *leaves), rhs)

    def adjoint(x, rhs, *leaves):
        by = partial(_multiply_by_transposed_jacobian, equation)
        return solver.adjoint(tree.unflatten(leaves), lambda force: by(force, x, *leaves), rhs)

    arrays = [lax.stop_gradient(jnp.asarray(x)) for x in (root, *known)]
    found, *known = _ROOT.bind(
        *arrays,
        *map(jnp.asarray, leaves),
        count=len(arrays),
        equation=equation,
        solver=TangentSolver(forward, adjoint),
    )
    return found if outputs is None else (found, shape.unflatten(known))


def with_deferred_derivative(
    function: Callable[[PyTree[Any]], Tree], values: Tree, parameters: PyTree[Any]
) -> Tree:
    """Return known values of a function, which is traced only if their derivative is taken.

    Args:
        function: function of the parameters, which returns a pytree of floats; it depends on no
            other traced values.
        values: ``function(parameters)``; the derivatives of this argument are ignored.
        parameters: a pytree.
    """
    return implicit_root(lambda x, p: (x, function(p)), jnp.zeros(0), parameters, None, values)[1]


def _known_values(*arrays, count, equation, solver):
    """Return the first `count` arguments, root and outputs, as they are.

    This is the value of the primitive `_ROOT`; applied to shapes, it is its shape rule.
    """
    return list(arrays[:count])


def _drop_unused_root_outputs(used, n_argument, *, count, equation, solver):
    """Drop unused outputs of `_ROOT`, and the arguments with their values.

    Args:
        used: whether each result (root, then outputs) is used.
        n_argument: number of arguments of the primitive.
        count, equation, solver: parameters of the primitive.

    Returns:
        Which results and which arguments are kept, bool lists, and the new parameters, a dict, as
        `define_primitive` asks for.
    """
    kept = [True, *used[1:]]
    arguments = kept + [True] * (n_argument - count)
    given = {"count": sum(kept), "equation": _keep_outputs(equation, kept), "solver": solver}
    return kept, arguments, given


def _drop_unused_tangent_outputs(used, n_argument, *, shapes, equation, **given):
    """Drop the tangents of unused outputs of `_ROOT_TANGENT`, as `_drop_unused_root_outputs`."""
    kept = [True, *used[1:]]
    shapes = tuple(shape for shape, own in zip(shapes, kept[1:], strict=True) if own)
    given |= {"shapes": shapes, "equation": _keep_outputs(equation, kept)}
    return kept, [True] * n_argument, given


def _keep_outputs(equation, kept):
    """Return the function `equation` with only those results for which `kept`, bool, is true."""

    def fewer(x, *leaves):
        pairs = zip(equation(x, *leaves), kept, strict=True)
        return [found for found, own in pairs if own]

    return fewer


def _root_jvp(primals, tangents, *, count, **given):
    """JVP rule of `_ROOT`: return root and outputs, and their tangents by `_ROOT_TANGENT`.

    The first `count` of the arguments are root and outputs, others the parameters.
    """
    found = _ROOT.bind(*primals, count=count, **given)
    moving = internals.differentiated_arguments(primals[count:], tangents[count:])
    if not moving:
        return found, [internals.zero_tangent(x) for x in found]
    # shapes, not outputs themselves: reverse mode would store them
    shapes = tuple(jax.ShapeDtypeStruct(x.shape, x.dtype) for x in found[1:])
    given |= {"shapes": shapes, "moving": moving}
    changes = [tangents[count + k] for k in moving]
    return found, _ROOT_TANGENT.bind(found[0], *primals[count:], *changes, **given)


class _Linearization(NamedTuple):
    """A root with outputs and parameters, about which it is to be differentiated.

    Attributes:
        root: x.
        leaves: the parameters p, arrays.
        moving: indices of the parameters that have tangents; derivatives by others are not needed.
        equation: function of x and the leaves to a list of residual and outputs.
        solver: pair of functions of x, a right side and the leaves.
    """

    root: Vector
    leaves: Sequence[Array]
    moving: tuple[int, ...]
    equation: Callable[..., list[Array]]
    solver: TangentSolver

    @classmethod
    def split_from_arguments(cls, root, *arrays, moving, equation, solver):
        """Split the arguments of `_ROOT_TANGENT`: return the linearization, and the tangents.

        `arrays` are all parameters, then the tangents of those with the indices `moving`.
        """
        last = len(arrays) - len(moving)
        return cls(root, arrays[:last], moving, equation, solver), arrays[last:]

    def function_and_point(self, wanted):
        """Return a function to be differentiated, and the point where: values of its arguments.

        Its arguments are the root and the parameters `moving`; it returns a list of the residual
        and of the outputs with the indices `wanted`.
        """

        def function(x, *some):
            leaves = internals.replace_entries(self.leaves, self.moving, some)
            residual, *outputs = self.equation(x, *leaves)
            return [residual, *(outputs[k] for k in wanted)]

        return function, (self.root, *(self.leaves[k] for k in self.moving))

    def solve(self, rhs, adjoint):
        """Return ``f_x^-1 rhs``, or with `adjoint` ``f_x^-T rhs``, by the Jacobian f_x at the root.

        The solution is an implicit root: its derivatives by `rhs`, root and leaves are exact.
        """
        if not rhs.size:
            return rhs
        product = _multiply_by_transposed_jacobian if adjoint else _multiply_by_jacobian
        solvers = [
            lambda p, _, b, own=own: own(p[1], b, *p[2:])
            for own in (reversed(self.solver) if adjoint else self.solver)
        ]
        equation = self.equation
        parameters = rhs, self.root, *self.leaves
        answer = solvers[0](lax.stop_gradient(parameters), None, lax.stop_gradient(rhs))
        return implicit_root(
            lambda y, p: product(equation, y, *p[1:]) - p[0],
            answer,
            parameters,
            TangentSolver(*solvers),
        )


def _multiply_by_jacobian(equation, change, x, *leaves):
    """Return ``f_x change`` for the Jacobian f_x of the residual, the first result of `equation`.

    It is taken at the root x and the parameters `leaves`; `change` is shaped like x.
    """
    return jax.jvp(lambda x: equation(x, *leaves)[0], (x,), (change,))[1]


def _multiply_by_transposed_jacobian(equation, force, x, *leaves):
    """Return ``f_x^T force`` for the Jacobian of `_multiply_by_jacobian`.

    `force` is shaped like the residual, the result like x.
    """
    return jax.vjp(lambda x: equation(x, *leaves)[0], x)[1](force)[0]


def _root_tangent(*arrays, shapes, **given):
    """Return the tangents of root and outputs: the value of the primitive `_ROOT_TANGENT`.

    The arguments are root, all parameters, and the tangents dp of those with the indices `moving`;
    `shapes` are those of the outputs. The tangent of the root is ``-f_x^-1 f_p dp``.
    """
    here, changes = _Linearization.split_from_arguments(*arrays, **given)
    function, at = here.function_and_point(range(len(shapes)))
    if not shapes:
        rhs = jax.jvp(partial(function, here.root), at[1:], tuple(changes))[1][0]
        return [-here.solve(rhs, adjoint=False)]
    _, product = jax.linearize(function, *at)
    change = -here.solve(product(jnp.zeros_like(here.root), *changes)[0], adjoint=False)
    return [change, *product(change, *changes)[1:]]


def _root_tangent_shapes(root, *_, shapes, **__):
    """Return shapes and dtypes of the tangents: the shape rule of `_ROOT_TANGENT`.

    They are those of `root`, and `shapes`, those of the outputs.
    """
    return [root, *map(internals.abstract_array, shapes)]


def _root_tangent_jvp(primals, tangents, *, moving, **given):
    """Forward derivative of `_ROOT_TANGENT`, which is linear in the tangents of parameters.

    A derivative by the parameters themselves is traced.
    """
    count = len(primals) - len(moving)
    evaluate = partial(_root_tangent, moving=moving, **given)
    out = _ROOT_TANGENT.bind(*primals, moving=moving, **given)
    if all(internals.is_zero_tangent(t) for t in tangents[:count]):
        further = [internals.instantiate_tangent(t) for t in tangents[count:]]
        return out, _ROOT_TANGENT.bind(*primals[:count], *further, moving=moving, **given)
    return out, internals.value_and_tangents(evaluate, primals, tangents)[1]


@without_garbage_collection()
@internals.same_context_as_outside()
def _root_tangent_transpose(cotangents, *arrays, shapes, **given):
    """Transpose rule of `_ROOT_TANGENT`: return cotangents of parameters, by an adjoint solve.

    With outputs, their cotangents first add to that of the root; then one product with the
    transposed derivative gives those of the parameters.
    """
    here, changes = _Linearization.split_from_arguments(*arrays, **given)
    back, *further = cotangents
    wanted = [k for k, x in enumerate(further) if not internals.is_zero_tangent(x)]
    if not wanted and internals.is_zero_tangent(back):
        return [None] * len(arrays)
    back, further = internals.instantiate_tangent(back), [further[k] for k in wanted]
    function, at = here.function_and_point(wanted)
    _, pull = jax.vjp(function, *at)  # once for both products
    if wanted:
        back = back + pull([jnp.zeros_like(here.root), *further])[0]
    force = -here.solve(back, adjoint=True)
    pulled = pull([force, *further])[1:]
    return [None] * (len(arrays) - len(changes)) + list(pulled)


def _root_tangent_batch_rule(arrays, axes, **given):
    """Rule for `jax.vmap` of `_ROOT_TANGENT`: trace `_root_tangent` for a batch."""
    found = jax.vmap(partial(_root_tangent, **given), axes)(*arrays)
    return found, [0] * len(found)


def _root_batch_rule(arrays, axes, *, count, equation, solver):
    """Rule for `jax.vmap` of `_ROOT`: the primitive again, with equation and solver mapped."""
    size = next(x.shape[a] for x, a in zip(arrays, axes, strict=True) if a is not None)
    arrays = [x if a is None else jnp.moveaxis(x, a, 0) for x, a in zip(arrays, axes, strict=True)]
    known = [
        jnp.broadcast_to(x, (size, *x.shape)) if a is None else x
        for x, a in zip(arrays[:count], axes[:count], strict=True)
    ]
    leaf_axes = [None if a is None else 0 for a in axes[count:]]
    found = _ROOT.bind(
        *known,
        *arrays[count:],
        count=count,
        equation=jax.vmap(equation, (0, *leaf_axes), axis_size=size),
        solver=TangentSolver(
            *(jax.vmap(solve, (0, 0, *leaf_axes), axis_size=size) for solve in solver)
        ),
    )
    return found, [0] * count


_ROOT = internals.define_primitive(
    "rooted",
    _known_values,
    _known_values,
    _root_jvp,
    _root_batch_rule,
    multiple_results=True,
    narrow=_drop_unused_root_outputs,
)
# derivative of a root and its outputs, linear in the changes of parameters
_ROOT_TANGENT = internals.define_primitive(
    "root_change",
    _root_tangent,
    _root_tangent_shapes,
    _root_tangent_jvp,
    _root_tangent_batch_rule,
    _root_tangent_transpose,
    multiple_results=True,
    narrow=_drop_unused_tangent_outputs,
)
