"""Natural modes: small free vibrations about a loaded state."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any, Literal

import jax
import jax.numpy as jnp
import numpy as np

from ..analysis.solution import Solution, State
from ..common import checks, status
from ..common.rules import nan_if_broken, positive
from ..common.tree import copy_with, pytree
from ..common.types import Array, ArrayLike, Bool, Float, Int
from ..elements.abilities import Hanging
from ..linear import check_solver_name, diagonal
from ..loads.masses import STANDARD_GRAVITY, PointMasses
from ..model.structure import Structure
from ..numerics.scaled import mode_shape_scales
from ..programs.program_calls import as_program
from ..stiffness.tangent import require_dense_memory, require_symmetric_elements
from .inertia import (
    make_system_with_nodal_masses,
    mass_times_ground_motion,
    nodal_masses,
    split_state_for_modes,
    total_effective_mass,
)
from .masses import DISTRIBUTIONS
from .mode_derivatives import find_modes
from .mode_warnings import (
    warn_of_freed_supports,
    warn_of_modes_within_spans,
    warn_of_nodes_without_stiffness,
    warn_of_weights_without_mass,
)

_DENSE_MATRICES = 15  # dense matrices in memory at once, measured


@pytree
class NaturalModes:
    """Natural frequencies and modes, slowest first: the result of `modes`.

    Attributes:
        frequency: natural frequencies, [n], Hz; NaN for a mode without positive stiffness (the
            state is unstable or a mechanism: see `squared`).
        squared: squared circular frequencies, [n], 1/s2; negative where the state is unstable.
        shape: displacements, scaled to 1 at the node that moves most, [n, n_node, 3].
        unknowns: the same modes by the unknowns of `stiffness.tangent_stiffness`, with rotations of
            nodes, [n, n_free].
        modal_mass: mass of each mode in this scale, [n], kg: twice its kinetic energy where the
            node that moves most has 1 m/s.
        participation: factors by which modes answer an acceleration of the ground along x, y, z,
            [n, 3]; the mass that couples what is free to supports counts.
        effective_mass: mass that each mode moves with along x, y, z, [n, 3], kg, whatever its
            scale; the sum over all modes is `total_mass`.
        total_mass: mass that can move against the ground along x, y, z, without that of `loose`
            nodes, [3], kg: all but the part of elements at supports that moves with these. A beam
            between held nodes that rotate counts with what its bending moves, 5/6 of its mass.
        repeated: whether another mode has the same frequency (to 1e-6 of its square), [n] bool:
            such modes are one basis of many, and derivatives of frequency and shape are NaN.
        loose: nodes that slack cables alone hold, left out of the modes, [n_node] bool.
        status: OK, or MODES_NOT_FOUND, with NaN in all modes; see `describe`.

    Example:
        12 kg on a tripod of 108, 108 and 384 kN/m, see `flexibility`:

        >>> around = 2 * np.pi * np.arange(3) / 3
        >>> feet = np.column_stack([3 * np.cos(around), 3 * np.sin(around), 0 * around])
        >>> legs = jc.Bars([[0, 3], [1, 3], [2, 3]], axial_stiffness=1e6)
        >>> structure = jc.Structure([*feet, [0.0, 0.0, 4.0]], legs, supports=jc.pinned([0, 1, 2]))
        >>> solution = jc.solve(structure, jc.Phase())
        >>> found = jc.dynamics.modes(structure, solution, masses=12.0)
        >>> print(found.status, jnp.round(found.squared, 6), found.repeated)  # K / m
        0 [ 9000.  9000. 32000.] [ True  True False]
        >>> print(jnp.round(found.effective_mass.sum(axis=0), 6), found.total_mass)  # kg
        [12. 12. 12.] [12. 12. 12.]
    """

    frequency: Float[Array, " n"]
    squared: Float[Array, " n"]
    shape: Float[Array, "n n_node 3"]
    unknowns: Float[Array, "n n_free"]
    modal_mass: Float[Array, " n"]
    participation: Float[Array, "n 3"]
    effective_mass: Float[Array, "n 3"]
    total_mass: Float[Array, " 3"]
    repeated: Bool[Array, " n"]
    loose: Bool[Array, " n_node"]
    status: Int[Array, ""]


def modes(
    structure: Structure,
    state: Solution | State,
    n: int = 10,
    *,
    masses: Float[ArrayLike, " n_node"]
    | Float[ArrayLike, ""]
    | PointMasses
    | Sequence[PointMasses]
    | None = None,
    fixed: Bool[ArrayLike, "n_row n_freedom"] | None = None,
    gravity: Float[ArrayLike, ""] = STANDARD_GRAVITY,
    distribution: Literal["lumped", "consistent", "mean"] | None = None,
    linear_solver: str | None = None,
) -> NaturalModes:
    """Find natural frequencies and modes about the state of a solution: ``(K - w^2 M) phi = 0``.

    K is the tangent stiffness of the state, which includes prestress and loads. M has the masses of
    the element groups, from their weights and `gravity`, and `masses`. Rotations of nodes and of
    sections of beams have no inertia of their own.

    A state has forces, and does not know which of them are weights: masses of which only the weight
    was a load, `PointMasses` included, count here if they are given as `masses`. Without `masses`
    an `InputWarning` is issued (outside of transformations) where downward nodal loads are larger
    than the weights of what can move vertically.

    A catenary is one element for a whole span: half of its mass moves with each end, and modes
    within the span are not found. An `InputWarning` is issued (outside of transformations) if the
    first of them is slower than a mode that is returned; a chain of `Cables` has all modes.

    Slack cables have no stiffness, and their mass. Nodes that they alone hold are left out of all
    modes (`NaturalModes.loose`), which an `InputWarning` says.

    Small structures are solved by dense matrices; beyond some hundred unknowns Lanczos's method
    takes one sparse factorisation. A pure function. Frequencies and shapes have derivatives of any
    order; where two frequencies are equal these are NaN (`NaturalModes.repeated`). Hold one of two
    planes of symmetry by `fixed` to differentiate the modes in the other one.

    Args:
        structure: the `Structure` that was analysed.
        state: `Solution` (NaN if it has failed), which stands for its last state, or `State`; for
            that after an earlier phase ``solve(structure, phases[:k])``.
        n: number of modes; fewer if fewer have mass (if traced, the remaining frequencies are inf).

    Options:
        masses: added masses at the nodes, [n_node] or scalar, kg; or `PointMasses`, one or several
            in a list, such as those that were loads of the analysis; default none. Give 0.0 where
            nodal loads are no weights.
        fixed: all degrees of freedom that are held, in place of those that supports hold, as in
            `stiffness.tangent_stiffness`: give those of the supports, too. An `InputWarning` is
            issued where one that a support holds becomes free.
        gravity: acceleration that weights are divided by, m/s2; default 9.80665.
        distribution: of an element's mass m. "lumped": half at each end. "consistent" with the
            displacements between the ends: m/3 and m/6 for straight cables and bars, cubic
            deflections for beams. "mean" of both, whose errors cancel in cables and bars. None
            (default): the choice with an error of order 4 in the length of elements, which is the
            mean for cables, bars and along beams, and consistent across beams. Cables over several
            nodes are always lumped.
        linear_solver: that factorises, as in `Newton`; None chooses by size.

    Returns:
        `NaturalModes`.

    Raises:
        ValueError: wrong arguments; no mass at all, or none that can move; a tangent that is not
            symmetric (follower loads without a potential, nodal moments, elements that are not
            `symmetric`), whose frequencies may be complex (if traced, they are NaN); too many
            unknowns for dense matrices in the memory there is.

    Sources: Goudreau and Taylor, Comp. Meth. Appl. Mech. Eng. 2 (1973), for the mean; Clough and
    Penzien, Dynamics of Structures, for participation and effective mass.

    Example:
        A seconds pendulum, ``sqrt(g / l) / 2 pi`` = 1/2 Hz, stiff by its weight:

        >>> gravity, mass = 9.80665, 2.0
        >>> length = gravity / np.pi**2  # 0.9936 m
        >>> rope = jc.Cables([[0, 1]], axial_stiffness=1e6)
        >>> structure = jc.Structure([[0.0, 0, 0], [0, 0, -length]], rope, supports=jc.pinned([0]))
        >>> weight = jc.NodalLoads([1], (0.0, 0.0, -mass * gravity))
        >>> solution = jc.solve(structure, jc.Phase(pretension=mass * gravity, loads=weight))
        >>> found = jc.dynamics.modes(structure, solution, n=2, masses=mass)
        >>> print(found.status, jnp.round(found.frequency, 6))  # Hz, in x and in y
        0 [0.5 0.5]
    """
    checks.require_whole_number(n, "n")
    check_solver_name(linear_solver)
    if distribution is not None:
        checks.require_one_of(distribution, "distribution", DISTRIBUTIONS)
    gravity = nan_if_broken(positive("gravity", gravity))
    added = nodal_masses(structure, masses)
    require_symmetric_elements(structure, "modes")
    split = split_state_for_modes(structure, state, fixed, linear_solver)
    if fixed is not None:
        warn_of_freed_supports(state, fixed)
    if masses is None:
        warn_of_weights_without_mass(structure, state, split[2])
    if split[2].pattern is None:
        require_dense_memory(split[2], _DENSE_MATRICES, "modes")
    amounts = [group.weight for group in structure.groups if group.weight is not None]
    known = [checks.array_if_known(amount) for amount in (*amounts, added)]
    if not any(amount is None or (amount > 0).any() for amount in known):
        raise ValueError(
            "masses: no element group has a weight; give weight=... in N/m, or masses=... in kg"
        )
    n = min(n, len(split[2].free))
    if n == 0:
        raise ValueError(_no_moving_mass_message(structure))
    static = {"distribution": distribution, "n": n}
    found, symmetric, has_mass = _natural_modes(split, gravity, added, **static)
    if checks.array_if_known(symmetric) is not None and not symmetric:
        raise ValueError(
            "state: follower loads or nodal moments make its tangent stiffness unsymmetric; "
            "frequencies may be complex, and only symmetric problems are solved"
        )
    if checks.array_if_known(has_mass) is not None and not has_mass:
        raise ValueError(_no_moving_mass_message(structure))
    found = _without_massless_modes(found)
    warn_of_nodes_without_stiffness(found.loose)
    warn_of_modes_within_spans(structure, split, gravity, found.frequency)
    return found


def _no_moving_mass_message(structure):
    """Return the error message for a structure none of whose free unknowns has mass."""
    hint = ""
    if any(isinstance(group, Hanging) for group in structure.groups):
        hint = "; catenaries have no modes within their span: use a chain of Cables"
    return f"masses: no node that is free to move has mass{hint}"


@functools.partial(as_program, static=("distribution", "n"))
def _natural_modes(split, gravity, masses, distribution, n):
    """Return the `NaturalModes` of a state, whether K is symmetric, and whether M is not zero.

    Args:
        split: as from `split_state_for_modes`.
        gravity, distribution, n: as for `modes`.
        masses: added masses of the nodes, [n_node], kg.
    """
    system, x = make_system_with_nodal_masses(split, masses)
    dof_map = system.dof_map
    gravity = jnp.asarray(gravity, system.nodes.dtype)
    stiffness, mass = system.tangent(x), system.mass_matrix(x, gravity, distribution)
    loose_rows = system.nodes_without_stiffness(x)
    # (a node that carries others on rigid links may have no element of its own)
    loose = loose_rows[dof_map.row_of_unknown] & (diagonal(stiffness) == 0)
    found = find_modes(stiffness, mass, loose, n)
    moved = jax.vmap(lambda step: system.displacements_of_step(x, step))(found.vectors)
    shape = moved[:, : len(system.nodal_mass)]
    scale = mode_shape_scales(shape, found.vectors)
    massive = jnp.isfinite(found.squared)
    unscaled = jnp.where((scale == 0) & massive, 1.0, scale)  # rotations alone: no displacements
    pulled = mass_times_ground_motion(system, x, gravity, distribution)
    shares = found.vectors @ pulled
    modal_mass = jnp.where(massive, unscaled**2, 0.0)
    positive_mode = found.squared > 0
    frequency = jnp.sqrt(jnp.where(positive_mode, found.squared, 1.0)) / (2 * jnp.pi)
    ok = found.symmetric & ~jnp.any(jnp.isnan(found.squared))
    found_modes = NaturalModes(
        frequency=jnp.where(positive_mode, frequency, jnp.nan),
        squared=found.squared,
        shape=shape * scale[:, None, None],
        unknowns=found.vectors * unscaled[:, None],
        modal_mass=modal_mass,
        participation=shares / jnp.where(massive, unscaled, 1.0)[:, None],
        effective_mass=shares**2,
        total_mass=total_effective_mass(mass, pulled, loose),
        repeated=found.repeated,
        loose=_has_chosen_unknown(loose, dof_map, len(system.nodal_mass)),
        status=jnp.where(ok, status.OK, status.MODES_NOT_FOUND).astype(jnp.int32),
    )
    return found_modes, found.symmetric, jnp.any(diagonal(mass) > 0)


def _has_chosen_unknown(chosen, dof_map, n_node):
    """Return which nodes have at least one of the unknowns `chosen`, [n_free] bool: [n_node]."""
    count = jnp.zeros(dof_map.unknown_of_dof.shape[0], jnp.int32)
    return count.at[dof_map.row_of_unknown].max(chosen.astype(jnp.int32))[:n_node] > 0


def _without_massless_modes(found: NaturalModes) -> NaturalModes:
    """Return modes without those that have no mass (infinite frequency); traced ones unchanged."""
    known = checks.array_if_known(found.squared)
    if known is None or not np.isposinf(known).any():
        return found
    count = int(np.sum(~np.isposinf(known)))
    names = ("frequency", "squared", "shape", "unknowns", "modal_mass", "participation")
    fields: dict[str, Any] = {
        name: jnp.asarray(np.asarray(getattr(found, name))[:count])
        for name in (*names, "effective_mass", "repeated")
    }
    return copy_with(found, **fields)
