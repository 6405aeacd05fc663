"""Minimize a loss over any pytree of parameters with any optax transformation."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
import optax

from ..common import status
from ..common.progress import Step
from ..common.tree import pytree
from ..common.types import Array, ArrayLike, Float, Int, PyTree
from ..programs.program_calls import as_program
from ..programs.traced_function import evaluate_traced, trace_function
from .bounds import (
    broadcast_to_params,
    check_call_arguments,
    check_search_arguments,
    flat_vector,
    unflatten_params,
)
from .descent import Descent, History
from .returned_values import loss_and_status
from .trials import call_search, unevaluated_point


@pytree
class Design:
    """Result of `minimize`: the parameters of lowest loss, their loss, the status and the history.

    Attributes:
        params: parameters of the lowest loss found (if converged, those of the last accepted point,
            whose loss is within 1e-9 of the lowest in float64), a pytree like the start.
        loss: loss at `params`.
        gradient: gradient at `params`, a pytree like these, with the entries that bounds block.
        gradient_norm: dimensionless size of the gradient at `params` without the blocked entries,
            which `tol` limits.
        history: `History` of the accepted points.
        status: status code, 0 (OK) if converged by the criteria of `minimize`; `describe` has the
            texts.
        steps: number of accepted steps.
        evaluations: number of evaluations of loss and gradient by the loop; a line search of the
            optimizer adds its own.
        failures: number of trial points at which the inner analysis failed, including those of a
            last step that was never accepted.

    Example:
        >>> loss = lambda x: (x[0] - 3.0) ** 2 + 10.0 * (x[1] - 1.0) ** 2 + 5.0
        >>> found = jc.minimize(loss, jnp.array([0.0, 0.0]), bounds=(0.0, 2.0))
        >>> print(jc.describe(found.status), jnp.round(found.params, 4), f"{found.loss:.4f}")
        converged [2. 1.] 6.0000
        >>> print(f"{found.gradient[0]:.4f}")  # the upper bound blocks the first parameter
        -2.0000
    """

    _shown: ClassVar[str] = "loss, gradient_norm, params, steps, evaluations, failures"

    params: PyTree[Float[Array, " ..."]]
    loss: Float[Array, ""]
    gradient: PyTree[Float[Array, " ..."]]
    gradient_norm: Float[Array, ""]
    history: History
    status: Int[Array, ""]
    steps: Int[Array, ""]
    evaluations: Int[Array, ""]
    failures: Int[Array, ""]


def minimize(
    loss: Callable[..., Any],
    params: PyTree[Float[ArrayLike, " ..."]],
    bounds: tuple[PyTree[Any] | None, PyTree[Any] | None] | None = None,
    optimizer: optax.GradientTransformation | None = None,
    *,
    steps: int = 100,
    tol: float | None = None,
    args: tuple[Any, ...] = (),
    scale: PyTree[Float[ArrayLike, " ..."]] | None = None,
    progress: bool | Callable[[Step], Any] | None = None,
) -> Design:
    """Minimize a loss, within bounds, by an optax transformation.

    Args:
        loss: function ``loss(params, *args)`` that returns a scalar, or (scalar, `Solution`), or
            (scalar, status codes). The second part shows which trial points failed; a batch of
            solutions fails if one of them does.
        params: start, any pytree of floats.
        bounds: (lower, upper), each None, a scalar, an array or a prefix pytree of `params`.
        optimizer: any optax transformation, also one with its own line search such as
            `optax.lbfgs()`; it works in the units of the parameters unless `scale` is given.
            Default: L-BFGS with a search along the projected path that accepts lower losses only
            and does not depend on units.

    Options:
        steps: largest number of accepted steps.
        tol: tolerance of convergence, see below. Default: 1e-6 in float64, 1e-3 in float32.
        args: tuple of further arguments of the loss, any pytrees. The loss is traced once in every
            call, so that it sees what it reads from outside now. Pass here what changes from call
            to call: numbers of Python that it reads are in its program, and others need a new one.
        scale: size of a typical change of every parameter, in the forms that a bound can have; the
            optimizer works on the parameters divided by it. Default: a tenth of the size at the
            start for the default optimizer, 1 for others.
        progress: True to show progress on stderr (step, loss, gradient norm); or a function of a
            `progress.Step`, called at the start and after every accepted step. Default
            and False: as for `solve`.

    Returns:
        `Design`. Works under jit and vmap (many starts at once); differentiating it is an error.
        Trial points, and the end, may be unstable equilibria, of which a search says nothing: look
        at `stable` of the `Solution` at `Design.params`.

    The search is a loop on the host, and every trial point a program of the loss and its gradient.
    Mapped cases are searched one after the other. Within `jit` the program calls the search, which
    NumPy computes then: a loss that takes long is faster outside.

    Raises:
        ValueError: no optax transformation, a loss that is no scalar, lower bounds above upper
            ones, or a start outside of the bounds. Where the numbers are traced, such bounds or
            such a start end in the status OUTSIDE.

    The status is OUT_OF_STEPS after `steps` accepted steps, and OK (converged) if all of these
    hold. Entries at a bound that the step would cross do not count.

    - Gradient: ``gradient_norm = max_i |g_i| s / max(|loss|, |loss at the start| / 10)`` is at most
      `tol`. The size ``s`` of a parameter is the largest entry of its array, now or at the start
      (if all are zero at the start, the largest finite bound, or 1).
    - Every entry of the gradient: ``|g_i| s`` is at most `tol` of the present loss, or ``|g_i|`` at
      most tol^2 of the largest that it has been.
    - Loss: the next step promises at most `tol` of the present loss. (Both hold for a loss that has
      fallen to tol^3 of that at the start, which is taken for zero.)
    - Parameters: the next step changes them by at most sqrt(tol) of the largest entry of their
      array now, or tol^1.5 of that at the start. (From a minimum flatter than a parabola, such as
      that of ``(x - 1)^4``, they may be some times as far.)

    The next step is that of L-BFGS, which must have learned the curvature; of other optimizers it
    is the one to the minimum along the last step, by the slopes at its ends. A gradient of exactly
    zero is converged after a step, and STATIONARY at the start, which may as well be a maximum.
    A point has also converged if the gradient is small (with `tol` in place of tol^2) and no step,
    down to that length, lowers the loss. In directions in which the loss has no slope from the
    start on, as across a plane of symmetry, the point may be a maximum: this is not checked.

    Source: Gill, Murray and Wright, Practical Optimization (1981), section 8.2.3; Dennis and
    Schnabel, Numerical Methods for Unconstrained Optimization (1983), section 7.2.

    Bounds hold exactly at every point at which the loss is evaluated (projection). Entries at a
    bound that the step would cross are hidden from the optimizer, so that a quasi-Newton method
    works in the space that remains (Bertsekas, *Projected Newton methods for optimization problems
    with simple constraints*, 1982). A point at which the analysis fails is never accepted: the step
    is halved and tried again, up to 40 times; then the status is STALLED. Near the minimum, where
    the loss has no digits left, its slope decides (Hager and Zhang, *Algorithm 851*, 2006).

    Example:
        The force density of four cables at which 40 N push the middle of a saddle down by 0.1 m,
        ``4 q 0.1 = 40``:

        >>> nodes = [[1.0, 0, 1], [-1, 0, 1], [0, 1, -1], [0, -1, -1], [0, 0, 0]]
        >>> cables = jc.Cables([[0, 4], [1, 4], [2, 4], [3, 4]], axial_stiffness=1e5)
        >>> structure = jc.Structure(nodes, cables, supports=jc.pinned([0, 1, 2, 3]))
        >>> loads = jc.NodalLoads([4], (0.0, 0.0, -40.0))
        >>> def loss(q):  # m2
        ...     return (jc.force_density(structure, q, loads)[4, 2] + 0.1) ** 2
        >>> found = jc.minimize(loss, jnp.array(150.0), bounds=(50.0, 400.0))
        >>> print(f"{jc.describe(found.status)}: {found.params:.1f} N/m")
        converged: 100.0 N/m
    """
    args = check_call_arguments(loss, args, steps, "loss")
    if optimizer is not None and not isinstance(optimizer, optax.GradientTransformation):
        raise ValueError(
            "optimizer: expected an optax transformation such as optax.adam(0.1), got "
            f"{type(optimizer).__name__}"
        )
    params, box, tol = check_search_arguments(params, bounds, tol)
    if scale is not None or optimizer is not None:
        scale = broadcast_to_params(scale, params, "scale", absent=1.0, positive=True)
    start = flat_vector(params)

    def flat_loss(x, *args):
        value, code = loss_and_status(loss(unflatten_params(x, params), *args))
        return value.astype(x.dtype), code

    traced = trace_function(flat_loss, start, *args)
    own = None
    if optimizer is not None:
        own = _trace_optimizer(optimizer, traced, args, params, box)
    return call_search(_search, (traced, own, args), (params, box, scale), tol, steps, progress)


def _search(loss, optimizer, args, params, box, scale, tol, steps, listen):
    """Return the `Design` that `minimize` finds, for known numbers; further arguments as of it.

    The loss is a `TracedFunction` of flat parameters [n] and further arguments `args`;
    `optimizer` is the result of `_trace_optimizer`, or None. Where numbers that were traced
    break a rule nothing is evaluated.
    """
    params, box, scale = jax.tree.map(np.asarray, (params, box, scale))
    scale = None if scale is None else flat_vector(scale)
    propose = None
    if optimizer is not None:
        propose = _optimizer_step_function(*optimizer, (loss, args, box, scale))

    def evaluate(x):
        return _loss_and_gradient(loss, x, args)

    given = evaluate, params, box, tol, steps, listen
    search = Descent(*given, scale=scale, propose=propose)
    code = search.run_if_valid()
    end = search.current if code in (status.OK, status.STATIONARY) else search.best
    point = unevaluated_point(search.start, 1, code) if end is None else end.point
    return Design(
        params=unflatten_params(point.x, params),
        loss=point.loss,
        gradient=unflatten_params(point.gradient, params),
        gradient_norm=point.loss * np.nan if end is None else end.measure,
        history=History(*search.history(True, True, False, False, False)),
        status=np.int32(code),
        steps=np.int32(max(len(search.rows) - 1, 0)),
        evaluations=np.int32(search.evaluations),
        failures=np.int32(search.failures),
    )


@as_program
def _loss_and_gradient(loss, x, args):
    """Return a loss, its gradient [n] and the status at flat parameters `x` [n].

    `loss` is a `TracedFunction` of `x` and of further arguments `args`.
    """
    (value, code), gradient = jax.value_and_grad(loss, has_aux=True)(x, *args)
    return value, gradient, code


def _trace_optimizer(optimizer, loss, args, params, box):
    """Trace a user's optax transformation, for a loss with further arguments `args`, within bounds.

    It is traced in every call, because it may read variables that have changed. Its parameters,
    a pytree like `params`, are one array [n] outside.

    Returns:
        Two of `TracedFunction`: from start and scale, [n], to the first state; and from loss,
        `args`, bounds, scale, parameters, value, gradient and state to the step, [n], and the
        next state.
    """
    optimizer, start = optax.with_extra_args_support(optimizer), flat_vector(params)

    def init(x, scale):
        return optimizer.init(unflatten_params(x / scale, params))

    def update(loss, args, box, scale, x, value, gradient, state):
        def value_of(scaled):  # for optimizers with a line search: infinite for a failed analysis
            x = jnp.clip(flat_vector(scaled) * scale, box.lower, box.upper)
            value, code = loss(x, *args)
            return jnp.where((code == status.OK) & jnp.isfinite(value), value, jnp.inf)

        slope = unflatten_params(scale * gradient, params)
        given = {"value": value, "grad": slope, "value_fn": value_of}
        step, new = optimizer.update(slope, state, unflatten_params(x / scale, params), **given)
        # the next step needs a state of the same types
        new = jax.tree.map(lambda a, b: jnp.asarray(b, jnp.asarray(a).dtype), state, new)
        return flat_vector(step).astype(x.dtype) * scale, new

    first = trace_function(init, start, start)
    given = loss, args, box, start, start, loss.result[0], start, first.result
    return first, trace_function(update, *given)


def _optimizer_step_function(init, update, given):
    """Return a function of an accepted point to the step, [n], that a user's optimizer proposes.

    `init` and `update` are of `_trace_optimizer`; `given` are the first arguments of `update`.
    """
    state: Any = None

    def propose(current):
        nonlocal state
        x, loss = current.point.x, current.point.loss
        if state is None:
            state = evaluate_traced(init, x, given[-1])
        step, state = evaluate_traced(update, *given, x, loss, current.inside, state)
        return np.asarray(step)

    return propose
