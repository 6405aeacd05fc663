"""Hanging cables: curves and end forces of catenaries, and chains of straight elements."""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
from jax import lax

from .. import linear
from ..analysis.element_shapes import (
    CATENARIES,
    StateOrPhase,
    element_shapes,
    map_shapes,
    tensions_of_shapes,
)
from ..common import checks
from ..common.rules import Rule, nan_if_broken, positive, refuse_if_broken
from ..common.types import Array, ArrayLike, Float, PyTree
from ..elements import hanging, hanging_sag
from ..model.structure import Structure
from ..programs.program_calls import as_program


def catenary_curves(
    structure: Structure, solution: StateOrPhase, n: int = 21
) -> PyTree[Float[Array, "n_elem n 3"] | None]:
    """Return positions along catenaries, for pictures; `results.sags` has their sags exactly.

    Args:
        structure: the `Structure` that was analysed.
        solution: `Solution` (NaN if it has failed) or `State`, or one of
            ``solution.phases`` for the end of that phase; batches have leading axes.
        n: number of positions per element, evenly along its unstressed length.

    Returns:
        Positions in the shape of `elements`, each [n_elem, n, 3], m, NaN for elements that are not
        there; None for other groups. `SlidingCatenaries` have a curve for each segment,
        [n_elem, n_segment, n, 3]; fillers of shorter cables are points at their last node.

    Raises:
        ValueError: not a state, or a structure without catenaries.

    Example:
        Half of a catenary (see `Catenaries`). Without strain it is ``H/w (cosh(w x/H) - 1)`` deep:

        >>> s, H, w, EA = 60.0, 6000.0, 30.0, 60e6  # m, N, N/m, N
        >>> x = H / w * np.arcsinh(w * s / H) + H * s / EA  # half of the span, m
        >>> nodes = [[-x, 0.0, 9.0], [0.0, 0.0, 0.0], [x, 0.0, 9.0]]
        >>> cables = jc.Catenaries([[0, 1], [1, 2]], axial_stiffness=EA, weight=w, rest_length=s)
        >>> structure = jc.Structure(nodes, cables, supports=jc.pinned([0, 2]))
        >>> solution = jc.solve(structure, jc.Phase(loads=jc.SelfWeight()))
        >>> curves = jc.forms.catenary_curves(structure, solution, n=5)  # [n_elem, n, 3]
        >>> depth = curves[0, 0, 2] - curves[0, -1, 2]
        >>> print(solution.status, f"{depth:.3f} m, {H / w * (np.cosh(w * x / H) - 1):.3f} m")
        0 8.807 m, 8.808 m
    """
    parts = jnp.linspace(0.0, 1.0, n)

    def of_group(shapes, there, _):
        curves = map_shapes(_positions_at, shapes, parts)
        return jnp.where(there[..., None, None], curves, jnp.nan)

    return _map_over_catenaries(structure, solution, of_group)


def end_tensions(
    structure: Structure, solution: StateOrPhase
) -> PyTree[Float[Array, "n_elem 2"] | None]:
    """Return the tensions at both ends of catenaries.

    The ends come in the order of `links`. The `tension` of a solution is their mean, its
    `peak_tension` the larger one, at the end of each phase. The result ``end_pull`` has the forces
    on both end nodes as vectors, `results.horizontal_tensions` the horizontal part.

    Args:
        structure: the `Structure` that was analysed.
        solution: `Solution` (NaN if it has failed) or `State`, or one of
            ``solution.phases`` for the end of that phase; batches have leading axes.

    Returns:
        Tensions in the shape of `elements`, each [n_elem, 2], N, zero for elements that are not
        there; None for other groups. Of `SlidingCatenaries` they are those of each segment,
        [n_elem, n_segment, 2], zero for fillers, as the result ``end_tensions``.

    Raises:
        ValueError: not a state, or a structure without catenaries.

    Example:
        ``sqrt(H^2 + (w s)^2)`` at the support and H in the middle of a catenary (see `Catenaries`):

        >>> s, H, w, EA = 60.0, 6000.0, 30.0, 60e6  # m, N, N/m, N
        >>> x = H / w * np.arcsinh(w * s / H) + H * s / EA  # half of the span, m
        >>> nodes = [[-x, 0.0, 9.0], [0.0, 0.0, 0.0], [x, 0.0, 9.0]]
        >>> cables = jc.Catenaries([[0, 1], [1, 2]], axial_stiffness=EA, weight=w, rest_length=s)
        >>> structure = jc.Structure(nodes, cables, supports=jc.pinned([0, 2]))
        >>> solution = jc.solve(structure, jc.Phase(loads=jc.SelfWeight()))
        >>> print(solution.status, jnp.round(jc.forms.end_tensions(structure, solution)[0], 1))
        0 [6264.2 6000. ]
    """

    def of_group(shapes, there, tension):
        ends = map_shapes(_tensions_at_ends, shapes)
        straight = jnp.repeat(tension[..., None], 2, axis=-1)
        return jnp.where(there[..., None], jnp.where(shapes.hangs[..., None], ends, straight), 0.0)

    return _map_over_catenaries(structure, solution, of_group)


def _map_over_catenaries(structure, state, function):
    """Call a function for each group of catenaries; return its values in the shape of the elements.

    `function` takes the element shapes, which elements are active, and tensions, N; of cables that
    slide all are those of segments. Other groups have None; a structure without catenaries raises
    ValueError.
    """
    if not any(isinstance(group, CATENARIES) for group in structure.groups):
        raise ValueError(
            "structure: has no catenaries; this function is for elements of the kind Catenaries"
        )
    every = element_shapes(structure, state)
    tensions = tensions_of_shapes(structure, state)
    return structure.arrange(
        [
            function(shapes, there[..., None] if group.slides else there, tension)
            if isinstance(group, CATENARIES)
            else None
            for group, (shapes, there), tension in zip(
                structure.groups, every, tensions, strict=True
            )
        ]
    )


def _positions_at(shape, parts):
    """Return positions on one element, [n, 3], m, at fractions `parts` of its unstressed length.

    `shape` is its `ElementShapes`.
    """
    return jax.vmap(shape.point)(parts)


def _tensions_at_ends(shape):
    """Return the tensions at both ends of one catenary, [2], N, from its `ElementShapes`."""
    pulls = jax.vmap(shape.tangent)(jnp.arange(2, dtype=shape.pull.dtype))
    return jnp.sqrt(jnp.sum(pulls * pulls, axis=1))


def hanging_chain(
    first: Float[ArrayLike, " 3"],
    second: Float[ArrayLike, " 3"],
    n: int,
    sag: Float[ArrayLike, ""],
    weight: Float[ArrayLike, ""],
    axial_stiffness: Float[ArrayLike, ""],
) -> tuple[Float[Array, "n+1 3"], Float[Array, " n"]]:
    """Find the shape of a cable of given sag that consists of `n` equal straight elements.

    The chain is in equilibrium under its weight along -z; half of an element's weight acts at each
    of its ends. As n grows, the chain approaches the catenary with that sag.

    Args:
        first, second: positions of the ends, [3], m; they must not lie above each other.
        n: number of elements, at least 2.
        sag: vertical distance of the chain from its chord at midspan (half of the horizontal
            distance of the ends), m, positive. If a node is exactly there, derivatives with respect
            to the ends are one-sided.
        weight: weight per unstressed length, N/m.
        axial_stiffness: EA, N.

    Returns:
        Positions of the nodes, [n + 1, 3], m, and the unstressed length of every element, [n], m.
        NaN if there is no such chain; differentiable with respect to all arguments but `n`.

    Raises:
        ValueError: wrong shapes, values that are not positive, or ends above each other.

    Example:
        >>> nodes, rest_length = jc.forms.hanging_chain(
        ...     (0.0, 0.0, 0.0), (120.0, 0.0, 0.0), n=20, sag=9.0, weight=30.0, axial_stiffness=60e6
        ... )
        >>> print(nodes.shape, f"{nodes[10, 2]:.6f} m")
        (21, 3) -9.000000 m
        >>> print(f"{rest_length.sum():.2f} m")  # near L + 8 f^2 / 3 L = 121.8 m
        121.76 m
    """
    if n < 2:
        raise ValueError(f"n = {n}: a chain that sags has at least 2 elements")
    first, second = checks.as_floats(first, "first"), checks.as_floats(second, "second")
    for name, value in (("first", first), ("second", second)):
        if value.shape != (3,):
            raise ValueError(f"{name}: expected shape (3,), got {value.shape}")
    numbers = {"sag": sag, "weight": weight, "axial_stiffness": axial_stiffness}
    for name, value in numbers.items():
        if checks.as_floats(value, name).shape != ():
            raise ValueError(f"{name}: expected a number, got shape {jnp.shape(value)}")
        numbers[name] = nan_if_broken(positive(name, value))
    dtype = jnp.result_type(float, first, second)
    chord = jnp.asarray(second, dtype) - jnp.asarray(first, dtype)
    text = "first, second: the ends lie above each other; the chain has no midspan"
    refuse_if_broken([Rule("second", chord[:2], lambda v: (v == 0).all(), lambda *_: text)])
    sag, weight, stiffness = (jnp.asarray(v, dtype) for v in numbers.values())
    relative, rest_length = _solve_hanging_chain(chord, sag, weight, stiffness, n=n)
    return jnp.asarray(first)[None] + relative, jnp.full(n, rest_length / n)


@functools.partial(as_program, static=("n",))
def _solve_hanging_chain(chord, sag, weight, stiffness, n):
    """Solve for the nodes of a hanging chain relative to the first, [n + 1, 3], m, and its length.

    The unknowns are the horizontal and vertical force in the middle, and the unstressed length L of
    the whole chain. Under its force F an element is the vector ``(L/n) (F/|F| + F/EA)``. Newton's
    method starts from the catenary with the same sag. `chord` is the vector from the first to the
    last node, [3], m; `stiffness` is EA; the rest is as in `hanging_chain`.
    """
    level = jnp.sqrt(chord[0] ** 2 + chord[1] ** 2)
    offset = jnp.arange(n, dtype=chord.dtype) - (n - 1) / 2

    def profile(unknowns):  # of all nodes, horizontal and vertical, [n + 1, 2], m
        h, v, length = unknowns
        up = v + weight * length / n * offset
        force = jnp.stack([jnp.broadcast_to(h, (n,)), up], 1)
        size = jnp.sqrt(jnp.sum(force**2, axis=1, keepdims=True))
        elements = length / n * (force / size + force / stiffness)
        return jnp.concatenate([jnp.zeros((1, 2), chord.dtype), jnp.cumsum(elements, axis=0)])

    def relative_errors(scaled):
        wanted = jnp.stack([level, chord[2], sag])
        x, z = profile(scaled * scale).T
        found = jnp.stack([x[-1], z[-1], 0.5 * z[-1] - jnp.interp(0.5 * x[-1], x, z)])
        return (found - wanted) / jnp.stack([level, level, sag])

    down = weight * jnp.array([0.0, 0.0, -1.0], chord.dtype)
    strain = hanging_sag.chord_strain_at_sag(chord, down, stiffness, sag)
    length = jnp.sqrt(chord @ chord) / (1 + strain)
    excess = chord @ chord - length**2
    force, _, _ = hanging.solve_catenary(chord, excess, down, length, stiffness)
    start = jnp.stack([force[:2] @ chord[:2] / level, force[2], length])
    scale = lax.stop_gradient(jnp.stack([start[0], jnp.abs(start[2] * weight), start[2]]))

    def newton(f, u):
        # unknowns are scaled to about 1. Convergence is quadratic near the root: below 1e-6 a
        # change that is not half of the one before is rounding. Some ten steps are usual.
        def unfinished(s):
            _, moved, before, count = s
            rounding = (moved < 1e-6) & (moved > 0.5 * before)
            return (moved > 4 * jnp.finfo(u.dtype).eps) & ~rounding & (count < 50)

        def iterate(s):
            u, before, _, count = s
            change = linear.solve_general(jax.jacfwd(f)(u), f(u))[0]
            return u - change, jnp.max(jnp.abs(change)), before, count + 1

        far = jnp.full((), jnp.inf, u.dtype)
        end, moved, _, _ = lax.while_loop(unfinished, iterate, (u, far, far, 0))
        found = (moved < 1e-6) & (end[0] > 0) & (end[2] > 0)
        return jnp.where(found, end, jnp.nan)

    scaled = lax.custom_root(
        relative_errors,
        lax.stop_gradient(start / scale),
        newton,
        lambda g, y: linear.solve_general(jax.jacfwd(g)(jnp.zeros_like(y)), y)[0],
    )
    x, z = profile(scaled * scale).T
    nodes = jnp.column_stack([jnp.outer(x, chord[:2] / level), z])
    return nodes, (scaled * scale)[2]
