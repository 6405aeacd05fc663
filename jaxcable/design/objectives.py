"""Objectives: small pure functions of a `Solution`, smooth (but for `material_use`), with units.

They also take a batch of solutions (a leading axis for load cases): sums run over all cases, and
the largest and smallest values are those of the worst case. Add them up to a loss, with weights
that carry the units. Objectives of a failed analysis are NaN.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np

from ..analysis.solution import Solution, State
from ..common import checks
from ..common.rules import nan_if_broken, positive
from ..common.types import Array, ArrayLike, Float, Int, PyTree
from ..programs.program_calls import as_program
from .arguments import (
    broadcast_to_elements,
    checked_smoothing_width,
    require_result,
    result_of_phase,
)


def smooth_max(
    values: PyTree[Float[ArrayLike, " ..."]], width: Float[ArrayLike, ""]
) -> Float[Array, ""]:
    """Return a smooth upper bound of the largest of n values x: ``width log sum exp(x / width)``.

    The bound is at most ``width log(n)`` above the largest entry.

    Args:
        values: array, or a pytree of arrays, of n entries in all.
        width: width of the smoothing, in the unit of the values.

    Returns:
        Scalar, in the unit of the values.

    Source: Kreisselmeier and Steinhauser (1979).

    Example:
        >>> values = jnp.array([1.0, 2.0, 3.0])
        >>> print(f"{jc.design.smooth_max(values, width=0.1):.4f}")
        3.0000
        >>> print(f"{jc.design.smooth_max(jnp.ones(3), width=0.1):.4f}")  # 1 + 0.1 log(3)
        1.1099
    """
    values = jax.tree.map(lambda v: checks.as_floats(v, "values"), values)
    if not any(np.size(v) for v in jax.tree.leaves(values)):
        raise ValueError("values: are empty; expected at least one number")
    return _smooth_max_program(values, checked_smoothing_width(width))


@as_program
def _smooth_max_program(values, width):
    """Return `smooth_max` of values and a width that have been checked; a compiled program."""
    flat = jnp.concatenate([jnp.ravel(leaf) for leaf in jax.tree.leaves(values)])
    return width * jax.nn.logsumexp(flat / width)


def smooth_min(
    values: PyTree[Float[ArrayLike, " ..."]], width: Float[ArrayLike, ""]
) -> Float[Array, ""]:
    """Return a smooth lower bound of the smallest of n values: ``-smooth_max(-values, width)``.

    The bound is at most ``width log(n)`` below the smallest entry.

    Args:
        values: array, or a pytree of arrays, of n entries in all.
        width: width of the smoothing, in the unit of the values.

    Returns:
        Scalar, in the unit of the values.

    Example:
        >>> print(f"{jc.design.smooth_min(jnp.ones(3), width=0.1):.4f}")  # 1 - 0.1 log(3)
        0.8901
    """
    values = jax.tree.map(lambda v: -checks.as_floats(v, "values"), values)
    return -smooth_max(values, width)


def mean_over_cases(values: PyTree[Float[ArrayLike, "n_case ..."]]) -> PyTree[Float[Array, " ..."]]:
    """Return the mean of every result over load cases.

    Args:
        values: a pytree of arrays with the cases on their leading axis.

    Returns:
        Means, in the shape of one case.

    Example:
        >>> cases = {"net": jnp.array([[100.0, 200.0], [300.0, 400.0]])}  # two cases
        >>> print(jc.design.mean_over_cases(cases)["net"])
        [200. 300.]
    """
    if any(np.ndim(v) == 0 for v in jax.tree.leaves(values)):
        raise ValueError("values: expected arrays with the cases on their leading axis")
    return jax.tree.map(lambda v: jnp.mean(v, axis=0), values)


def shape_distance(
    solution: Solution | State,
    positions: Float[ArrayLike, "n 3"],
    nodes: Int[ArrayLike, " n"] | None = None,
) -> Float[Array, ""]:
    """Sum the squared distances of nodes from wanted positions, m2.

    Args:
        solution: `Solution`.
        positions: wanted positions, [n_node, 3], or [n, 3] of the chosen `nodes`, m.
        nodes: node numbers, [n]; default all.

    Returns:
        Scalar, m2; NaN for a failed analysis.

    Example:
        >>> structure, phases = jc.scenes.flat_net(load=15.0)
        >>> solution = jc.solve(structure, phases)
        >>> distance = jc.design.shape_distance(solution, structure.nodes[[3]], nodes=[3])
        >>> print(solution.status, f"{1e3 * jnp.sqrt(distance):.3f} mm")
        0 12.838 mm
    """
    require_result(solution, "positions")
    found = solution.positions
    if nodes is not None:
        nodes = checks.as_indices(nodes, "nodes")
        checks.require_known_nodes(nodes, found.shape[-2], "nodes")
        found = found[..., nodes, :]
    positions = checks.as_floats(positions, "positions")
    if positions.shape not in (found.shape[-2:], found.shape):
        raise ValueError(
            f"positions: expected shape {found.shape[-2:]}, one per node, got {positions.shape}"
        )
    return _sum_of_squared_differences(found, positions)


def tension_distance(
    solution: Solution | State, tension: PyTree[Float[ArrayLike, " ..."]]
) -> Float[Array, ""]:
    """Sum the squared differences of the tensions from wanted ones, N2.

    Args:
        solution: `Solution`.
        tension: wanted tensions, N, a scalar or a pytree of the shape of the elements (arrays
            [n_elem] or scalars).

    Returns:
        Scalar, N2; NaN for a failed analysis.

    Example:
        >>> prestressed = jc.solve(*jc.scenes.flat_net(load=0.0))  # 12 cables of 200 N
        >>> print(prestressed.status, f"{jc.design.tension_distance(prestressed, 210.0):.3f} N2")
        0 1200.000 N2
    """
    require_result(solution, "tension")
    target = broadcast_to_elements(tension, solution.tension, "tension")
    return _sum_of_leaves(jax.tree.map(_sum_of_squared_differences, solution.tension, target))


def tension_spread(solution: Solution | State) -> Float[Array, ""]:
    """Return how unequal the tensions are: their variance over the square of their mean, -.

    Args:
        solution: `Solution`.

    Returns:
        Scalar, -; NaN for a failed analysis.

    Example:
        >>> prestressed = jc.solve(*jc.scenes.flat_net(load=0.0))  # 12 cables of 200 N
        >>> print(prestressed.status, f"{jc.design.tension_spread(prestressed):.6f}")
        0 0.000000
    """
    require_result(solution, "tension")
    flat = jnp.concatenate([jnp.ravel(leaf) for leaf in jax.tree.leaves(solution.tension)])
    mean = jnp.mean(flat)
    return jnp.mean((flat - mean) ** 2) / mean**2


def largest_deflection(
    solution: Solution, width: Float[ArrayLike, ""], phase: int = -1
) -> Float[Array, ""]:
    """Return a smooth upper bound of the largest deflection of a node in a phase, m.

    The bound ``width sqrt(log sum exp(d^2 / width^2))`` is smooth at nodes that do not move. It is
    below ``sqrt(d_max^2 + width^2 log(n))``, hence close if deflections are several widths.

    Args:
        solution: `Solution`.
        width: width of the smoothing, m; a few per cent of the deflections of interest.
        phase: number of the phase, default the last; deflections are from the start of the phase.

    Returns:
        Scalar, m; NaN for a failed analysis.

    Example:
        >>> structure, phases = jc.scenes.flat_net(load=15.0)
        >>> solution = jc.solve(structure, phases)
        >>> bound = jc.design.largest_deflection(solution, width=1e-3)
        >>> largest = jnp.linalg.norm(solution.phases[1].displacement_in_phase, axis=1).max()
        >>> print(solution.status, f"{1e3 * largest:.2f} mm, at most {1e3 * bound:.2f} mm")
        0 12.84 mm, at most 12.89 mm
    """
    moved, width = (
        result_of_phase(solution, phase).displacement_in_phase,
        checked_smoothing_width(width),
    )
    return jnp.sqrt(smooth_max(jnp.sum(moved**2, axis=-1), width**2))


def total_prestress(solution: Solution, phase: int = 0) -> Float[Array, ""]:
    """Sum the tensions at the end of a phase, by default the first, N.

    The first phase of load cases from `solve_cases` is their loading: use the solution from which
    they start.

    Args:
        solution: `Solution`.
        phase: number of the phase, from 0.

    Returns:
        Scalar, N; NaN for a failed analysis.

    Example:
        >>> structure, phases = jc.scenes.flat_net(load=15.0)
        >>> solution = jc.solve(structure, phases)
        >>> print(solution.status, f"{jc.design.total_prestress(solution):.3f} N")  # 12 of 200 N
        0 2400.000 N
    """
    return _sum_of_leaves(jax.tree.map(jnp.sum, result_of_phase(solution, phase).tension))


def material_use(
    solution: Solution | State, stress: PyTree[Float[ArrayLike, " ..."]]
) -> Float[Array, ""]:
    """Return the volume of elements sized for their axial forces N: ``sum |N| L0 / stress``, m3.

    N is the largest axial force along an element (`peak_tension`), L0 its unstressed length. The
    volume is not smooth where another load case, or the other end of a catenary, becomes the
    governing one.

    Args:
        solution: `Solution`; with several load cases the largest force of every element counts.
        stress: allowed stress, Pa, a scalar or a pytree of the shape of the elements.

    Returns:
        Scalar, m3; NaN for a failed analysis.

    Example:
        >>> prestressed = jc.solve(*jc.scenes.flat_net(load=0.0))
        >>> volume = jc.design.material_use(prestressed, stress=100e6)  # 12 T L0 / stress
        >>> print(prestressed.status, f"{1e9 * volume:.1f} mm3")
        0 9580.4 mm3
    """
    require_result(solution, "peak_tension")
    stress = broadcast_to_elements(stress, solution.peak_tension, "stress")
    stress = jax.tree_util.tree_map_with_path(
        lambda path, value: nan_if_broken(positive("stress" + jax.tree_util.keystr(path), value)),
        stress,
    )

    def volume(force, length, stress):
        cases = (-1, length.shape[-1])
        force, length = jnp.abs(force).reshape(cases), length.reshape(cases)
        return jnp.sum(jnp.max(force, axis=0) * jnp.max(length, axis=0) / stress)

    parts = jax.tree.map(volume, solution.peak_tension, solution.rest_length, stress)
    return _sum_of_leaves(parts)


def _sum_of_leaves(parts):
    """Return the sum of the leaves (arrays or scalars) of a pytree."""
    return sum(jax.tree.leaves(parts))


def _sum_of_squared_differences(found, wanted):
    """Return the sum of ``(found - wanted)^2`` over all entries of two pytrees of one structure.

    `found` may have a leading axis of load cases; `wanted` then holds for each of them.
    """
    wanted = jnp.asarray(wanted)
    wanted = wanted.reshape((1,) * (found.ndim - wanted.ndim) + wanted.shape)
    return jnp.sum((found - wanted) ** 2)
