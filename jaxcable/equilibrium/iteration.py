"""An iteration of Newton's method: evaluate, decide, aim; `newton` has the method as a whole."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jax import lax

from .. import linear
from ..common import status
from ..common.tree import copy, pytree, where
from ..common.types import Array, ArrayLike, Bool, Float, Int, PyTree
from ..linear.sparse import Factored
from ..mechanics.assembly import System
from ..mechanics.chords import Chords, have_chords, relative
from ..mechanics.pulls import Pulls, loaded
from ..numerics.search import Search
from .balance import Balance, Method, in_vain, limit
from .globalisation import ASTRAY, Shift, Sprint
from .newton_step import direction, largest, no_stiffness
from .predicted import Predicted, in_turn, part_of_turn
from .tensions import Tensions

_RELEASED = 2.0  # residual allowed without load, in roundings (eps) of the forces at the start
_FINE = 0.05  # rounding of plain displacements over the tolerance, from which they are fine
_KNOWN = 1e-2  # rounding over the force that residuals are judged by, up to which that is known
_RUNAWAY = 1e6  # displacement, in structure sizes, that no anchored structure reaches
_ADRIFT = 1e4  # the same for nets, whose mixed steps end at a part of it


@pytree
class Iterate:
    """Where the iteration stands.

    Attributes:
        x, residual, scale: last accepted point, R(x), and the force that R is judged by, N.
        rounding: error that rounding leaves in the residual, N; None if no element states any.
        elements: what elements give together with their forces at x: `Pulls` of a net, else
            tangents (`System.linearized`) and `Chords`.
        step, search: the step from x, and which part of it is tried next (`search.Search`).
        arrival: whether the next evaluation is at x itself: at the start, when the iteration
            begins again, and when no usable step was found.
        stepless: whether the reason for `arrival` is that no usable step was found.
        shift, sprint: policies of `globalisation`; None where one does not apply.
        tensions: policy of nets of cables, `tensions.Tensions`; None for other structures.
        predicted: policy of others, `predicted.Predicted`; None where all only pull.
        begun: largest residual at the start of the increment, N.
        vain: steps within the tolerance of forces that have not halved the residual (`balance`).
        steps: number of Newton steps so far.
        code: status so far; negative before the first evaluation.
        factored: the last matrix that a sparse solve has factorised, see `linear.solve_next`.
        released, came_from: residuals that rounding at the first point allows, N: a structure that
            is released ends with the rounding of the forces that it began with. One for all
            unknowns of a net, or one for each (`System.rounding`) of others; else None.
        stable: whether the tangent at the end is definite.
        done: whether the iteration has ended.
    """

    x: Float[Array, "n_row n_motion"]
    residual: Float[Array, " n_free"]
    scale: Float[Array, ""]
    rounding: Float[Array, " n_free"] | None
    elements: PyTree[Float[Array, "n_elem ..."]]
    step: Float[Array, " n_free"]
    search: Search
    arrival: Bool[Array, ""]
    stepless: Bool[Array, ""]
    shift: Shift
    sprint: Sprint | None
    tensions: Tensions | None
    predicted: Predicted | None
    begun: Float[Array, ""]
    vain: Int[Array, ""]
    steps: Int[Array, ""]
    code: Int[Array, ""]
    factored: Factored | None
    released: Float[Array, ""] | None
    came_from: Float[Array, " n_free"] | None
    stable: Bool[Array, ""]
    done: Bool[Array, ""]


class Task:
    """A search for equilibrium: its constants, its first `Iterate`, and one iteration.

    Args:
        system: `System` of one load factor.
        x: motion to start from.
        method: `Method`.
        judge: whether to find out if the equilibrium is stable.
        balance: `Balance` of the increment; None: only forces judge the residual, as in float32.
        only: whether to evaluate the start only.
    """

    def __init__(
        self,
        system: System,
        x: Float[Array, "n_row n_motion"],
        method: Method,
        judge: Bool[ArrayLike, ""],
        balance: Balance | None = None,
        only: Bool[ArrayLike, ""] = False,
    ):
        self.system, self.method, self.judge, self.only = system, method, judge, only
        self.balance = balance if jnp.finfo(x.dtype).eps < 1e-12 else None
        self.begin = system.place(system.refined(x))
        self.tol = limit(method, x.dtype)
        self.length, self.extent = system.length_scale(), system.extent()
        self.net = system.is_net
        self.judges = not system.always_convex
        self.loaded = loaded(system, self.begin) if self.net else None
        # a net beyond the peak of a law finds where its curve ends by the true forces
        falls = not self.net and system.risen().is_net
        self.predicts = not self.net and not falls and have_chords(system.groups)
        self.convex = system.convex
        tension_only = system.may_be_convex and not self.net
        self.sprints = tension_only or system.may_be_unsymmetric

    def start(self, factored: Factored | None) -> Iterate:
        """The `Iterate` before the first evaluation, which is at the start itself."""
        zero = jnp.zeros((), self.begin.dtype)
        still = jnp.zeros(self.system.freedoms.free.shape[0], zero.dtype)
        no = jnp.zeros((), bool)
        *_, rounding, elements = jax.tree.map(
            lambda a: jnp.zeros(a.shape, a.dtype),
            jax.eval_shape(lambda x: self._evaluated(x, jnp.int32(0)), self.begin),
        )
        return Iterate(
            x=self.begin,
            residual=still,
            scale=zero,
            rounding=rounding,
            elements=elements,
            step=still,
            search=Search.init(zero),
            arrival=~no,
            stepless=no,
            shift=Shift.init(zero.dtype),
            sprint=Sprint.init(self.system.may_be_unsymmetric) if self.sprints else None,
            tensions=Tensions.init(self.system, self.begin) if self.net else None,
            predicted=Predicted.init(self.system, zero.dtype) if self.predicts else None,
            begun=zero,
            vain=jnp.int32(0),
            steps=jnp.int32(0),
            code=jnp.int32(-1),  # nothing evaluated yet
            factored=factored,
            released=zero if self.net else None,
            came_from=None if self.net else rounding,
            stable=self.convex,
            done=no,
        )

    def iterate(self, it: Iterate) -> Iterate:
        """Evaluate the point that is tried, decide whether to accept it, and make the next step."""
        exact, before = self._to_be_exact(it), largest(it.residual)
        it, taken, found, over = self._tried(it, exact)
        it, converged = self._known(it, over, before)
        if self.net:  # a long step may lead to where the fine part matters after all
            converged = converged & (exact | ~self._to_be_exact(it))
        it, reevaluate = self._steered(it, taken, found, over, converged)
        return self._aimed(it, over & ~it.done & ~reevaluate, converged)

    def _tried(self, it, exact):
        """The evaluation of an iteration, at `search.length` of the step.

        Returns:
            it: with the point if it is accepted, and the next length of the search.
            taken: the part of the step that was tried.
            found: whether a step was taken.
            over: whether the search along the step has ended.
        """
        x = where(it.arrival, it.x, self.system.move(it.x, it.search.length * it.step))
        residual, scale, rounding, elements = self._evaluated(x, it.steps, exact)
        finite = jnp.isfinite(scale)
        slope = self._slope(it, x, residual, elements)
        search, fine, again = it.search.update(jnp.where(finite, slope, jnp.inf))
        if self.sprints:
            fine, again = it.sprint.accept((fine, again), finite, (it.residual, residual))
        if self.net:
            searching = it.tensions.searching
            fine, again = jnp.where(searching, fine, finite), again & searching
        fine, again = fine | it.arrival, again & ~it.arrival

        new = copy(
            it,
            x=where(fine, x, it.x),
            residual=where(fine, residual, it.residual),
            scale=where(fine, scale, it.scale),
            rounding=where(fine, rounding, it.rounding),
            elements=where(fine, elements, it.elements),
            search=search,
        )
        return new, it.search.length, fine & ~it.stepless, ~again

    def _evaluated(self, x, steps, exact=True):
        """Residual less the carried one, scale, rounding, and `Iterate.elements`."""
        if self.net:
            elements = Pulls.of(self.system, x, exact)
            residual, scale, rounding = elements.judged(self.system, x)
        else:
            end_forces, tangents = self.system.linearized(x)
            rounding = self.system.rounding(x) if self.system.rounds else None
            chords = Chords.of(self.system, x, end_forces) if self.predicts else None
            residual, scale = self.system.residual_and_scale(x, end_forces)
            elements = tangents, chords
        return residual - self.carried(scale, steps), scale, rounding, elements

    def carried(
        self, scale: Float[Array, ""], steps: Int[Array, ""]
    ) -> Float[ArrayLike, " n_free"]:
        """The residual that is carried along after so many steps, see `balance`, [n_free], N."""
        return 0.0 if self.balance is None else self.balance.carried(scale, self.tol, steps)

    def _slope(self, it, x, residual, elements):
        """Derivative of the energy along the step at x, under forces as the search sees them."""
        slope = residual @ it.step
        if it.predicted is None:
            return slope
        chords, spread = elements[1], self.system.space.spread(x, it.step)
        longer = chords.elongation(relative(self.system, spread))
        return slope - it.predicted.beyond_limit(chords.force) @ longer

    def _to_be_exact(self, it):
        """Whether the fine part of the next point will matter, judged by the present one."""
        if not self.net:
            return False
        # rounding is that of a fine part, of eps times the displacement and not eps^2
        eps, least = jnp.finfo(it.scale.dtype).eps, it.scale
        if self.balance is not None:
            least = jnp.minimum(least, self.balance.load)
        return (it.code < 0) | (largest(it.rounding) > _FINE * eps * self.tol * least)

    def _known(self, it, over, before):
        """Note what the evaluation says, and find out whether x is an equilibrium.

        `before` is the largest residual at the point before, N.
        """
        first = it.code < 0
        finite = jnp.all(jnp.isfinite(it.residual)) & jnp.isfinite(it.scale)
        code = jnp.where(first, jnp.where(finite, status.OK, status.NONFINITE), it.code)
        begun = jnp.where(first, largest(it.residual), it.begun)
        it = copy(it, code=code.astype(jnp.int32), begun=begun)
        if self.net:
            # forces that rounding hides are not found; without any load they may all be lost
            known = jnp.where(self.loaded, _KNOWN * it.scale, jnp.inf)
            # a net that is under load has others to be judged by
            released = _RELEASED * jnp.finfo(it.scale.dtype).eps * it.scale
            it = copy(it, released=jnp.where(first & ~self.loaded, released, it.released))
            granted = jnp.maximum(jnp.minimum(it.rounding, known), it.released)
        elif it.rounding is not None:
            it = copy(it, came_from=jnp.where(first, it.rounding, it.came_from))
            granted = jnp.maximum(it.rounding, it.came_from)
        else:
            granted = jnp.zeros_like(it.residual)
        balanced = it.residual + self.carried(it.scale, it.steps)
        converged = jnp.all(jnp.abs(balanced) <= jnp.maximum(self.tol * it.scale, granted))
        if self.balance is None:
            return it, converged
        halved = largest(it.residual) < 0.5 * before
        vain = it.vain + (converged & over & ~halved)
        met, lost = self.balance.judged(it.residual, granted, it.scale, it.begun, self.tol)
        ends = converged & (met | in_vain(vain) | (it.steps >= self.method.max_steps))
        code = jnp.where(ends & lost, status.AT_ROUNDING, it.code)
        return copy(it, vain=vain, code=code.astype(jnp.int32)), ends

    def _steered(self, it, taken, found, over, converged):
        """Update the policies and the status after an evaluation.

        Returns:
            The `Iterate`, and whether a policy asks for an evaluation before the next step: because
            the iteration begins again, or the softness has changed.
        """
        moved = over & (~it.arrival | it.stepless)
        spent = over & ~converged & (it.steps >= self.method.max_steps)
        again = jnp.zeros((), bool)
        shift = where(moved, it.shift.update(found, taken), it.shift)
        x, sprint = it.x, it.sprint
        reach = self.system.reach(x)
        if self.sprints:
            new, again = sprint.update(found, reach, it.steps, self.extent, converged)
            sprint, again = where(moved, new, sprint), moved & again
            x, shift = where(again, (self.begin, Shift.init(x.dtype)), (x, shift))
        tensions = it.tensions
        if self.net:
            shift = where(tensions.searching, shift, Shift.init(x.dtype))
            astray = reach > ASTRAY * self.extent
            size = largest(it.residual), it.scale
            new, point, elsewhere = tensions.steered(
                x, self.begin, found, *size, astray, self.length
            )
            steered = moved & ~converged & ~it.tensions.searching
            tensions, again = where(steered, new, tensions), steered & elsewhere
            x = where(steered, point, x)
        runaway = over & (reach > (_ADRIFT if self.net else _RUNAWAY) * self.extent) & ~again
        code = jnp.where((it.code == status.OK) & runaway, status.MECHANISM, it.code)
        stop = over & ((code != status.OK) | spent)
        reevaluate = again & ~stop
        stuck = stop & (code == status.OK)
        judging = converged & self.judge & ~self.convex
        after = copy(
            it,
            x=x,
            arrival=reevaluate,
            stepless=jnp.zeros((), bool),
            shift=shift,
            sprint=sprint,
            tensions=tensions,
            code=jnp.where(stuck, status.NOT_CONVERGED, code).astype(jnp.int32),
            done=stop | self.only | (over & converged & ~judging & ~reevaluate),
        )
        return after, reevaluate

    def _aimed(self, it, wanted, converged):
        """The next step, if `wanted`; at an equilibrium only judge the tangent there."""

        def aim(it):
            tensions, predicted, part = it.tensions, it.predicted, 1.0
            if self.net:
                known, size = (it.elements, it.residual, self.length), largest(it.residual)
                equations = tensions.equations(self.system, it.x, *known)
                it = copy(it, tensions=equations.policy)
                rhs, sprinting = equations.rhs, ~tensions.searching
                matrix = equations.matrix(self.system, it.x, size)
                shift = jnp.where(sprinting, 0.0, it.shift.on(size, self.length))
            else:
                rhs, sprinting = -it.residual, jnp.zeros((), bool)
                if self.sprints:
                    sprinting = it.sprint.on & ~converged
                matrix, shift, on, slopes = self._equations(it, sprinting, converged)
            matrix = linear.plus_diagonal(matrix, shift)
            step, definite, factored = direction(self.system, matrix, it, rhs, self.tol, wanted)
            again, stays = jnp.zeros((), bool), converged
            if self.net:
                taken, part, halfway = equations.taken(self.system, it.x, step, definite)
                if factored is not None:  # the second half of a step has the factor of the first
                    count = where(it.tensions.halfway, it.factored.count, factored.count)
                    factored = copy(factored, count=count)
                stays = converged | halfway
                tensions, again = it.tensions.repeated_if_indefinite(taken, definite)
                again = again | halfway
            slope = it.residual @ step
            if self.predicts:
                predicted, part, cut = self._predict(it, step, slopes, on)
                slope = slope - cut
            step, slope = part * step, part * slope
            usable, sprint = definite & ((slope < 0) | sprinting), it.sprint
            if self.system.may_be_unsymmetric:
                unsure = self.system.unsymmetric() & ~definite
                usable, sprint = usable | unsure, copy(sprint, unproven=unsure & ~sprinting)
            usable = usable & jnp.isfinite(slope) & ~stays
            return copy(
                it,
                step=jnp.where(usable, step, 0.0),
                search=Search.init(slope),
                arrival=~usable,
                stepless=~usable & ~again,
                sprint=sprint,
                tensions=tensions,
                predicted=where(usable, predicted, it.predicted),
                steps=it.steps + ~stays,
                factored=factored,
                stable=it.stable | (converged & definite),
                done=converged,
            )

        return lax.cond(wanted, aim, lambda it: it, it)

    def _equations(self, it, sprinting, converged):
        """The linear equations of a step of a structure that is no net of cables.

        Returns:
            Matrix, shift on its diagonal, whether it has predicted forces, and the derivatives of
            axial forces by lengths; the last two None where none are predicted.
        """
        tangents, chords = it.elements
        size, on, slopes = largest(it.residual), None, None
        if self.predicts:
            on = in_turn(it.steps) & ~sprinting & ~converged
            forces = it.predicted.forces_at(chords, on)
            tangents = self.system.tangents(it.x, tangents)
            slopes = chords.slopes(self.system, tangents)
            tangents = chords.stiffened(self.system, tangents, forces)
            # after a step sideways R is that of EA, and so would be the shift
            size = jnp.minimum(size, jnp.max(jnp.abs(forces)) + it.begun)
        shift = it.shift.on(size, self.length)
        matrix = self.system.tangent(it.x, tangents)
        if self.system.space.rotates:
            shift = jnp.where(sprinting, 0.0, shift)
        if self.judges:
            shift = jnp.where(converged, no_stiffness(matrix), shift)
        return matrix, shift, on, slopes

    def _predict(self, it, step, slopes, on):
        """`Predicted` for a step, the part that is taken, and the work of cut forces on it, J."""
        chords, system = it.elements[1], self.system
        apart = relative(system, system.space.spread(it.x, step))
        longer = chords.elongation(apart)
        predicted = it.predicted.stepped(system, chords.force + slopes * longer, on)
        part = jnp.where(on, part_of_turn(chords.turn(apart)), 1.0)
        return predicted, part, predicted.beyond_limit(chords.force) @ longer
