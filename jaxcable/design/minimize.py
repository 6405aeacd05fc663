"""Minimise a loss over any pytree of parameters with any optax transformation, in one program."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import optax
from jax.flatten_util import ravel_pytree

from ..analysis.solution import Solution
from ..common import status
from ..common.progress import Step, listener
from ..common.tree import pytree, where
from ..common.types import Array, ArrayLike, Float, Int, PyTree
from .box import Box, checked_call, default_tol, make_box, numbers, spread
from .descent import Descent
from .outcome import split_loss
from .programs import Programs, underivable

_PART = 0.1  # of its size: a typical change of a parameter


@pytree
class History:
    """What happened in each accepted step, first of all the start; NaN or -1 after the last one.

    Attributes:
        loss: [steps + 1].
        gradient_norm: what `tol` bounds (see `minimize`), [steps + 1].
        status: 0, or the code of the inner analysis that failed last on the way to this point, so
            that the step had to be shortened, [steps + 1].
        failures: number of such failures in this step, [steps + 1].
        shortened: how often the step was shortened, for this or for a loss that did not fall,
            [steps + 1].

    Example:
        >>> loss = lambda x: (x[0] - 3.0) ** 2 + 10.0 * (x[1] - 1.0) ** 2 + 5.0
        >>> found = jc.minimize(loss, jnp.array([0.0, 0.0]), bounds=(0.0, 2.0))
        >>> losses = np.asarray(found.history.loss[: found.steps + 1])
        >>> print(found.status, losses[0], losses[-1].round(4), (np.diff(losses) < 0).all())
        0 24.0 6.0 True
    """

    loss: Float[Array, " steps+1"]
    gradient_norm: Float[Array, " steps+1"]
    status: Int[Array, " steps+1"]
    failures: Int[Array, " steps+1"]
    shortened: Int[Array, " steps+1"]


@pytree
class Design:
    """Result of `minimize`.

    Attributes:
        params: where the loss was lowest (within 1e-9 of it if converged), in the shape of the
            start.
        loss: there.
        gradient: there, in the shape of `params`; not projected.
        gradient_norm: there, as in `History`.
        history: `History`.
        status: 0 if `gradient_norm` fell to `tol`; `describe` has the texts.
        steps: number of accepted steps.
        evaluations: number of times that the loop asked for loss and gradient (a line search of the
            optimizer asks for more).
        failures: number of trial points at which the inner analysis failed, those of a last step
            that led nowhere included.

    Example:
        >>> loss = lambda x: (x[0] - 3.0) ** 2 + 10.0 * (x[1] - 1.0) ** 2 + 5.0
        >>> found = jc.minimize(loss, jnp.array([0.0, 0.0]), bounds=(0.0, 2.0))
        >>> print(jc.describe(found.status), jnp.round(found.params, 4), f"{found.loss:.4f}")
        converged [2. 1.] 6.0000
        >>> print(f"{found.gradient[0]:.4f}")  # the bound holds the first
        -2.0000
    """

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
    loss: Callable[
        ...,
        Float[ArrayLike, ""]
        | tuple[Float[ArrayLike, ""], PyTree[Solution | Int[ArrayLike, " ..."]]],
    ],
    params: PyTree[Float[ArrayLike, " ..."]],
    bounds: tuple[PyTree[Float[ArrayLike, " ..."]] | None, PyTree[Float[ArrayLike, " ..."]] | None]
    | None = None,
    optimizer: optax.GradientTransformation | None = None,
    *,
    steps: int = 100,
    tol: float | None = None,
    args: tuple[Any, ...] = (),
    scale: PyTree[Float[ArrayLike, " ..."]] | None = None,
    progress: bool | Callable[[Step], Any] | None = None,
) -> Design:
    """Minimise a loss, within bounds, by an optax transformation.

    Args:
        loss: function ``loss(params, *args)`` to a scalar, or to (scalar, `Solution`), or (scalar,
            status codes); with a second part the loop knows what failed. A batch of solutions fails
            if one of them does.
        params: start, any pytree of floats.
        bounds: (lower, upper), each None, a scalar, an array or a prefix pytree of `params`.
        optimizer: any optax transformation, also one with a line search of its own such as
            `optax.lbfgs()`; it sees the parameters in their own units. Default: L-BFGS with a
            search along the projected path that accepts nothing but a lower loss; it does not
            depend on units.
        steps: number of accepted steps, at most.
        tol: stop when ``gradient_norm = max_i |g_i| s / max(|loss|, |loss at the start| / 10)`` is
            at most `tol`: a change of a parameter by its own size promises less than `tol` of the
            loss, or of a tenth of the first one. (So a start with a huge loss asks for a smaller
            `tol`.) The size ``s`` is the largest entry
            of the parameter's array, now or at the start (if all are zero there, of its finite
            bounds, or 1); entries at a bound that the step would cross do not count. The default
            optimizer asks for more: that its whole step promises no more than that. Default: 1e-6
            in float64, 1e-3 in float32.
        args: tuple of further arguments of the loss, any pytrees. The loss is compiled once for a
            function object, as by `jax.jit`: what it takes from outside is frozen then. Pass what
            changes here.
        scale: sizes of a typical change, as `bounds`: the optimizer sees the parameters divided by
            them. Default: a tenth of ``s`` at the start for the default optimizer, 1 for others.

        progress: True to have long work say on stderr where it is (step, loss, gradient); or a
            function of a `progress.Step`, called after each.

    Returns:
        `Design`. Works under jit and vmap (many starts at once); to differentiate it is an error.

    Raises:
        ValueError: no optax transformation, a loss that is no scalar, bounds that leave no room, a
            start outside of them. While they are traced the latter two are the status OUTSIDE.

    Bounds hold exactly at every point at which the loss is asked for (projection). Entries at a
    bound that the step would cross are hidden from the optimizer, so that a quasi-Newton method
    works in the space that is left (Bertsekas, *Projected Newton methods for optimization problems
    with simple constraints*, 1982). A point at which the analysis fails is never accepted: the step
    is halved and tried again, up to 40 times; then the status is STALLED. Near the minimum, where
    the loss has no digits left, its slope decides (Hager and Zhang, *Algorithm 851*, 2006).

    Example:
        The force density at which 600 N hang 3 m under their supports, ``2 q 3 = 600``:

        >>> nodes = [[-4.0, 0.0, 3.0], [0.0, 0.0, 3.0], [4.0, 0.0, 3.0]]
        >>> cables = jc.Cables([[0, 1], [1, 2]], axial_stiffness=1e5)
        >>> structure = jc.Structure(nodes, cables, supports=jc.pinned([0, 2]))
        >>> loads = jc.NodalLoads([1], (0.0, 0.0, -600.0))
        >>> def loss(q):  # m2
        ...     return jc.force_density(structure, q, loads)[1, 2] ** 2
        >>> found = jc.minimize(loss, jnp.array(150.0), bounds=(50.0, 400.0))
        >>> print(f"{jc.describe(found.status)}: {found.params:.1f} N/m")
        converged: 100.0 N/m
    """
    args = checked_call(loss, args, steps, "loss")
    if optimizer is not None and not isinstance(optimizer, optax.GradientTransformation):
        raise ValueError(
            "optimizer: expected an optax transformation such as optax.adam(0.1), got "
            f"{type(optimizer).__name__}"
        )
    params = numbers(params)
    box = make_box(bounds, params)
    tol = default_tol(params) if tol is None else tol
    floor = jax.tree.map(_floor, params, box.lower, box.upper)
    if scale is None and optimizer is None:
        scale = jax.tree.map(lambda s: _PART * s, floor)
    else:
        scale = spread(scale, params, "scale", absent=1.0, positive=True)
    return _programs(loss, optimizer, int(steps), listener(progress))(
        params, args, box, floor, scale, tol
    )


def _floor(x, low, high):
    """Least size of every entry: the largest of its array at the start, of its bounds, or 1."""
    ends = jnp.stack([jnp.where(jnp.isfinite(b), jnp.abs(b), 0.0) for b in (low, high)])
    start, bound = jnp.max(jnp.abs(x), initial=0.0), jnp.max(ends, initial=0.0)
    size = jnp.where(start > 0, start, jnp.where(bound > 0, bound, 1.0))
    return jnp.full_like(x, size)


def _make(reference, optimizer, steps, listen):
    """The program for the loss that `reference()` gives."""

    @jax.jit
    def run(params, args, box, floor, scale, tol):
        params, args = underivable((params, args))
        start, back = ravel_pytree(params)
        flat = Box(ravel_pytree(box.lower)[0], ravel_pytree(box.upper)[0])
        floor, scale = ravel_pytree(floor)[0], ravel_pytree(scale)[0]

        def value(params):
            return split_loss(reference()(params, *args))

        def sizes(x):
            largest = jax.tree.map(lambda v: jnp.full_like(v, jnp.max(jnp.abs(v))), back(x))
            return jnp.maximum(floor, ravel_pytree(largest)[0])

        descent = Descent(value, back, optimizer, steps, flat, sizes, scale, tol, listen)
        end = descent.run(start)
        converged = end.code == status.OK
        point = where(converged, end.at, end.best)
        log = end.log
        return underivable(
            Design(
                params=back(point.x),
                loss=point.loss,
                gradient=back(point.gradient),
                gradient_norm=point.measure,
                history=History(*log),
                status=jnp.where(box.holds(params), end.code, status.OUTSIDE),
                steps=jnp.maximum(end.n, 0),
                evaluations=end.evaluations,
                # those of accepted steps, and of the last one if it led nowhere
                failures=jnp.sum(jnp.maximum(log.failures, 0)) + end.failures,
            )
        )

    return run


_programs = Programs(_make)
