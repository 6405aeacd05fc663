"""Straight two-node bar: tension and compression, any displacement and rotation."""

from __future__ import annotations

import jax
import jax.numpy as jnp

from ..common.tree import pytree
from ..common.types import Array, Float
from .abilities import Jackable, RoundingEstimate, SecantStiffness
from .element import Ends, Forces, Motion
from .prestress import AxialState, jack_value_or, measure_chord
from .straight import Straight


class TwoNodeStraight(Straight, Jackable, SecantStiffness, RoundingEstimate):
    """Straight elements of two nodes; the force of each depends on its own strain only.

    The class adds jacks, the secant stiffness and the estimate of rounding errors to `Straight`.
    """

    def lock_off(self, state: AxialState, ends: Ends, motion: Motion) -> AxialState:
        """Return the state after lock-off: its new unstressed length gives the jack force here."""
        _, length, change, _ = measure_chord(ends, motion)
        return self.locked_off_state(state, length, change)

    def rounding_error(self, state: AxialState, ends: Ends, motion: Motion) -> Forces:
        """Return an estimate of the absolute error of the end forces, [2, 3], N, from rounding.

        It is 8 eps of the largest displacement, times the axial stiffness over the length.
        """
        vector, length, _, _ = measure_chord(ends, motion)
        _, stiffness = self.tension_and_stiffness(state, ends, motion)
        moved = jnp.max(jnp.abs(motion)) / length
        force = 8 * jnp.finfo(length.dtype).eps * moved * stiffness * jnp.abs(vector)
        return jnp.stack([force, force])

    def secant(
        self, state: AxialState, ends: Ends, before: Motion, motion: Motion
    ) -> Float[Array, "2 3 2 3"]:
        """Return the symmetric secant stiffness K of one element, [2, 3, 2, 3], N/m.

        ``K (u - u0) = f(u) - f(u0)`` holds exactly for the displacements u0 of `before` and u of
        `motion`, and the end forces f.

        Between the chord ``d`` at u0 (length l_0, force density q_0) and ``d + w`` at u (l, q),
        with m = 2 d + w and m.w = l^2 - l_0^2, the difference q (d + w) - q_0 d equals
        [(q + q_0)/2 I + c/2 m m^T] w. The factor c = (q - q_0)/(m.w) is expanded so that nothing
        cancels: c = (E_sec / L0 - q_0) / (l (l + l_0)) with E_sec the secant of the force-strain
        curve between the two states.
        """
        start, length = measure_chord(ends, before)[1], measure_chord(ends, motion)[1]
        then, now = self.strain(state, ends, before), self.strain(state, ends, motion)

        def force(strain):
            return self.force(strain, state.memory)

        def following():
            force_then, tangent = jax.jvp(force, (then,), (jnp.ones_like(then),))
            force_now = force(now)
            apart = jnp.abs(now - then) > jnp.sqrt(jnp.finfo(now.dtype).eps) * jnp.abs(then)
            secant = (force_now - force_then) / jnp.where(apart, now - then, 1.0)
            return jnp.stack([force_then, force_now, jnp.where(apart, secant, tangent)])

        prescribed = None
        if state.jack_force is not None:
            prescribed = jnp.stack([state.jack_force, state.jack_force, jnp.zeros_like(now)])
        force_then, force_now, modulus = jack_value_or(state, prescribed, following)
        q_then, q_now = force_then / start, force_now / length
        c = (modulus / state.rest_length - q_then) / (length * (length + start))
        m = 2 * (ends[1] - ends[0]) + (before[1] - before[0]) + (motion[1] - motion[0])
        block = 0.5 * (q_then + q_now) * jnp.eye(3, dtype=m.dtype) + 0.5 * c * jnp.outer(m, m)
        return jnp.stack([jnp.stack([block, -block], 1), jnp.stack([-block, block], 1)])


@pytree(indices=("links",))
class Bars(TwoNodeStraight):
    """A group of straight two-node bars (struts, ties): tension and compression.

    ``N = EA e`` or ``N = A s(e)`` with ``e = (l - L0) / L0``, exact for any displacement and
    rotation. Give `axial_stiffness`, or `area` and `law`, or `section`.

    Args:
        links: node numbers, [n_elem, 2].
        axial_stiffness: EA, scalar or [n_elem], N.
        area: cross-section, scalar or [n_elem], m2; together with `law`.
        law: uniaxial law of all elements of the group, such as `Elastic` (see `materials`);
            together with `area`.
        section: fibre section shared by the group. Only its axial force is used: its fibres are
            reduced to one area and one law.
        rest_length: unstressed length before any phase, scalar or [n_elem], m; default the
            initial chord.
        weight: self-weight per unstressed length, scalar or [n_elem], N/m; it acts where a phase
            has `SelfWeight`.
        expansion: thermal expansion coefficient, scalar or [n_elem], 1/K.
        strength: breaking force, scalar or [n_elem], N; for utilization in reports and design.
        compliance: strain per force of a spring in series with every element, scalar or [n_elem],
            1/N (soft end fittings).

    Raises:
        ValueError: wrong shapes, equal ends, repeated links, non-positive stiffness or length,
            both or neither of `axial_stiffness` and `area`; `compliance` with a `Polygonal` law in
            a group of several elements, or with a section of several laws, one of which softens.

    Example:
        600 N on two struts that stand in a 3-4-5 triangle, held in their plane:

        >>> nodes = [[-4.0, 0.0, 0.0], [0.0, 0.0, 3.0], [4.0, 0.0, 0.0]]
        >>> struts = jc.Bars([[0, 1], [1, 2]], axial_stiffness=1e5)
        >>> held = np.array([[True, True, True], [False, True, False], [True, True, True]])
        >>> structure = jc.Structure(nodes, struts, supports=jc.Supports(held))
        >>> weight = jc.NodalLoads([1], (0.0, 0.0, -600.0))
        >>> solution = jc.solve(structure, jc.Phase(pretension=-500.0, loads=weight))
        >>> print(solution.status, jnp.round(solution.tension, 6))
        0 [-500. -500.]
    """
