"""Distance of cables to slackening, where the derivative of a state jumps.

The response of a cable net is smooth except where a cable becomes slack or taut, or where a contact
opens or closes. A gradient is
exact on its own side of such a kink and says nothing about the other side; these functions say how
far away the kink is. (Laws given by points have corners, too: see `corner_distance` of the law.)
"""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp

from ..analysis.solution import Solution, State
from ..common import status
from ..common.types import Array, ArrayLike, Float, PyTree
from ..elements.abilities import Uniaxial, is_one_sided
from ..mechanics.elementwise import evaluate_elements
from ..mechanics.restart_state import make_system
from ..model.structure import Structure
from ..numerics import implicit
from ..programs.program_calls import as_program
from ..stiffness.tangent import merge_solution_state, split_solution_state
from .arguments import require_result, require_structure
from .bounds import broadcast_to_params, check_params
from .objectives import smooth_min


def slack_distance(
    structure: Structure, solution: Solution | State
) -> PyTree[Float[Array, "... n_elem"] | None]:
    """Return how far every cable is from going slack: its strain minus its strain at zero force.

    The distance is positive in a taut cable, negative in a slack one, and zero where it goes slack.
    Of a contact it is the strain by which it is compressed, negative where it is open.
    It is smooth through zero, so that a constraint on it can make a slack cable taut; the tension,
    which is zero in every slack cable, has no gradient for that.

    Args:
        structure: the `Structure` that was analysed.
        solution: its `Solution` or a `State`; may be a batch.

    Returns:
        Strains in the shape of the elements, [n_elem] each, with the leading axes of a batch; None
        for groups that carry tension and compression, and for `GroundContacts`, whose result
        `opening` says it in m. NaN for a `Solution` that failed.

    Example:
        >>> structure, phases = jc.scenes.flat_net(load=15.0)
        >>> solution = jc.solve(structure, phases)
        >>> distance = jc.design.slack_distance(structure, solution)
        >>> strain = solution.tension / 97.97e3
        >>> print(solution.status, f"{distance.min():.6f}, {strain.min():.6f}")
        0 0.002384, 0.002384
    """
    require_structure(structure)
    require_result(solution, "displacement")
    if not isinstance(solution, Solution) and not hasattr(solution, "restart"):
        raise ValueError(f"solution: expected a Solution or State, got {type(solution).__name__}")
    if jnp.ndim(solution.displacement) > 2:
        return jax.vmap(lambda case: slack_distance(structure, case))(solution)
    if isinstance(solution, Solution):
        found = slack_distance(structure, solution.last)
        return implicit.nan_unless(solution.status == status.OK, found, found)
    for where, group in structure.named_groups():
        if group.tension_only and not isinstance(group, Uniaxial):
            raise ValueError(
                f"slack_distance: elements{where} ({type(group).__name__}) has no strain along an "
                "axis (ability `Uniaxial`)"
            )
    split = split_solution_state(structure, solution, unknowns=False)
    return structure.arrange(_strains_above_slackening(*split))


@as_program
def _strains_above_slackening(without_indices, index_arrays, dof_map):
    """Return strains minus the strain at which an element goes slack, [n_elem] by group, -.

    Of contacts the sign is reversed; None for groups that bear tension and compression. The
    first two arguments are those of `merge_solution_state`; `dof_map` numbers the unknowns.
    """
    nodes, groups, restart = merge_solution_state(without_indices, index_arrays)
    motion = restart.motion
    system = make_system(nodes, groups, restart, motion, dof_map)  # with the loads along elements
    found = []
    for group, state in zip(groups, system.states, strict=True):
        if not is_one_sided(group) or not isinstance(group, Uniaxial):
            found.append(None)
            continue
        strain = evaluate_elements("section_strain", group, state, nodes, motion)
        distance = strain - group.strain_at(jnp.zeros_like(strain), state.memory)
        found.append(-distance if group.compression_only else distance)
    return found


def slack_margin(
    structure: Structure, solution: Solution | State, width: Float[ArrayLike, ""]
) -> Float[Array, ""]:
    """Return a smooth lower bound of the smallest `slack_distance` of all cables and cases, -.

    Where it is positive no cable is slack.

    Args:
        structure, solution: as for `slack_distance`.
        width: width of the smoothing, a strain; the bound is at most ``width log(n)`` below the
            smallest distance.

    Returns:
        Scalar, -.

    Example:
        >>> structure, phases = jc.scenes.flat_net(load=15.0)
        >>> solution = jc.solve(structure, phases)
        >>> smallest = jc.design.slack_distance(structure, solution).min()
        >>> margin = jc.design.slack_margin(structure, solution, width=1e-5)
        >>> print(solution.status, bool(smallest - 1e-5 * np.log(12) <= margin <= smallest))
        0 True
    """
    distance = slack_distance(structure, solution)
    if not jax.tree.leaves(distance):
        raise ValueError(
            "structure: no group is tension-only; there are no cables that could go slack, and no "
            "contacts"
        )
    return smooth_min(distance, width)


def nearest_kink(
    distance: Callable[[PyTree[Float[Array, " ..."]]], PyTree[Float[Array, " ..."]]],
    params: PyTree[Float[ArrayLike, " ..."]],
    direction: PyTree[Float[ArrayLike, " ..."]],
) -> PyTree[Float[Array, " ..."]]:
    """Estimate for each cable the factor t at which it goes slack or taut.

    The parameters change as ``params + t direction``, t >= 0. Such changes are kinks of the
    response: a gradient describes it for t below the smallest of them only. They are estimates to
    first order: check them with an analysis.

    Args:
        distance: function of the parameters, for example
            ``lambda p: slack_distance(structure, jc.solve(structure, phases(p)))``.
        params, direction: parameters and the direction of their change, pytrees of one shape.

    Returns:
        t >= 0 in the shape of the result of `distance`; infinite for cables that move away from
        their kink, NaN if the analysis failed.

    Example:
        A cable of strain ``e = T / EA``, loosened by 50 N a step from 200 N:

        >>> distance = lambda tension: tension / 97.97e3
        >>> steps = jc.design.nearest_kink(distance, jnp.array([200.0]), jnp.array([-50.0]))
        >>> print(jnp.round(steps, 6))
        [4.]
    """
    if not callable(distance):
        raise ValueError(f"distance: expected a function, got {type(distance).__name__}")
    params, direction = check_params(params), check_params(direction, "direction")
    broadcast_to_params(direction, params, "direction")
    values, rates = jax.jvp(distance, (params,), (direction,))

    def to_kink(value, rate):
        meets = (value * rate < 0) | ((value == 0) & (rate < 0))
        step = jnp.where(meets, -value / jnp.where(meets, rate, 1.0), jnp.inf)
        return jnp.where(jnp.isnan(value * rate), jnp.nan, step)

    return jax.tree.map(to_kink, values, rates)
