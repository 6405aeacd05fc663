"""Energy balance of an analysis: work of what acts, against what is stored and dissipated.

Everything that the phases do to a structure does work on it,

    work of dead and following loads, of moved and released supports, of prestress and temperature
        = change of stored energy + dissipated energy + imbalance.

The left side comes from forces and displacements at the ends of the increments, by the trapezoidal
rule; the energies are those of the elements, written apart from their forces. In equilibrium all
along, the imbalance is the error of that rule, of second order in the increment. One that does not
fall so says that forces, loads and energies do not belong together, or that a state jumped.
"""

import warnings

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from . import status
from ._check import InputWarning
from ._tree import copy, fill, pytree
from .assembly import each
from .parts import one_case
from .preparation import prepare, ready
from .ramp import Ramp
from .rotations import angles, inverse, product, stereographic

WORKS = ("dead", "following", "supports", "prestress")
"""Names of what does work."""

_FIRST = 1e-6  # part of the first increment's load that stands for none: it has a direction


@pytree
class EnergyBalance:
    """Work and energy in each phase of an analysis, J; `energy_balance` makes it.

    Attributes:
        dead: work of dead loads, on nodes and on what they deflect within elements, [n_phase].
        following: work of loads that follow, [n_phase].
        supports: work of supports that are moved, and of reactions that are ramped out where
            freedoms are released, [n_phase].
        prestress: work of jacks and turnbuckles, of heat, and of whatever else changes unstressed
            lengths, [n_phase].
        stored: change of the stored energy, [n_phase].
        dissipated: by plastic strains, [n_phase].
        level: stored energy at the end of each phase, [n_phase].

    Example:
        600 N hung on a cable of 5 m and 100 kN, all at once and in ten steps: half of the work of
        one step would be wrong, were the force not linear in the displacement.

        >>> cable = jc.Cables([[0, 1]], axial_stiffness=1e5)
        >>> held = np.array([[True, True, True], [True, True, False]])
        >>> nodes = [[0.0, 0.0, 5.0], [0.0, 0.0, 0.0]]
        >>> structure = jc.Structure(nodes, cable, supports=jc.Supports(held))
        >>> phases = [jc.Phase(loads=jc.NodalLoads([1], (0.0, 0.0, -600.0)))]
        >>> balance = jc.energy_balance(structure, phases, jc.solve(structure, phases))
        >>> print(f"{balance.dead[0]:.3f} J, {balance.stored[0]:.3f} J")  # F^2 L0 / 2 EA
        9.000 J, 9.000 J
    """

    dead: object
    following: object
    supports: object
    prestress: object
    stored: object
    dissipated: object
    level: object

    @property
    def work(self):
        """Work of all that acts, [n_phase], J."""
        return sum(getattr(self, name) for name in WORKS)

    @property
    def imbalance(self):
        """Work less the energy that is stored and dissipated, [n_phase], J."""
        return self.work - self.stored - self.dissipated

    @property
    def relative(self):
        """The imbalance over the largest of all terms of its phase, [n_phase]; 0 if all are."""
        terms = [*(getattr(self, name) for name in WORKS), self.stored, self.dissipated]
        largest = np.max(np.abs(terms), axis=0)
        return np.abs(self.imbalance) / np.where(largest > 0, largest, 1.0)


def energy_balance(structure, phases, solution, start=None):
    """Work of loads, supports and prestress against stored and dissipated energy.

    It reads the increments of the solution and solves nothing. Where a phase failed, its increments
    up to there count, and later phases have none.

    Args:
        structure: `Structure` that was analysed.
        phases: its phases, as given to `solve`.
        solution: the `Solution`.
        start: what the analysis was started from, as given to `solve`.

    Returns:
        `EnergyBalance`, NumPy, outside of all transformations.

    Raises:
        ValueError: `solution` is a batch or being traced, or has another number of phases; those
            of `solve`.

    Example:
        Two hundred newtons of pretension in all cables of a net, and 15 N on its four nodes:

        >>> structure, phases = jc.scenes.flat_net(load=15.0)
        >>> balance = jc.energy_balance(structure, phases, jc.solve(structure, phases))
        >>> print(f"{balance.prestress[0]:.4f} J of prestress, {balance.dead[1]:.4f} J of load")
        0.9780 J of prestress, 0.3974 J of load
        >>> bool(balance.relative.max() < 0.01)
        True
    """
    one_case(solution)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", InputWarning)  # the analysis has said so
        thawed, arrays, *_ = prepare(structure, phases, None, start)
    if len(thawed[3]) != len(solution.phases):
        raise ValueError(
            f"phases: {len(thawed[3])} of them, the solution has {len(solution.phases)}"
        )
    paths = tuple(
        (
            phase.path.status,
            phase.path.displacement if phase.path.motion is None else phase.path.motion,
        )
        for phase in solution.phases
    )
    rows = jax.tree.map(np.asarray, _balance(thawed, arrays, paths))
    return EnergyBalance(*np.stack([np.stack(row) for row in rows], axis=1))


@jax.jit
def _balance(thawed, arrays, paths):
    """Rows of `EnergyBalance`, a list with an item per phase."""
    nodes, groups, carry, data = ready(fill(thawed, arrays))
    rows = []
    for phase, (codes, path) in zip(data, paths, strict=True):
        ramp = Ramp.build(nodes, groups, carry, phase)
        row, carry = _phase(ramp, codes, path)
        rows.append(row)
    return rows


def _phase(ramp, codes, path):
    """Row of `EnergyBalance` for a phase, and the `Carry` that it leaves."""
    begin, n_inc = ramp.begin.motion, len(codes)
    good = codes == status.OK
    motions = path if begin.shape[1] > 3 else begin[None] + path
    motions = jnp.where(good[:, None, None], motions, begin[None])
    factors = jnp.arange(1, n_inc + 1, dtype=begin.dtype) / n_inc

    def step(before, increment):
        factor, motion, now = increment
        terms, plastic = _increment(ramp, before, (factor, motion))
        plastic = jax.tree.map(lambda a, b: jnp.where(now, a, b), plastic, before[2])
        after = factor, motion, plastic
        after = jax.tree.map(lambda a, b: jnp.where(now, a, b), after, before)
        return after, jnp.where(now, terms, 0.0)

    zero = jnp.zeros((), begin.dtype)
    first = zero, begin, ramp.plastic
    (factor, motion, plastic), terms = lax.scan(step, first, (factors, motions, good))
    level = _At(ramp, factor, motion, plastic).level
    return jnp.append(jnp.sum(terms, axis=0), level), ramp.leave(factor, motion, plastic)


def _increment(ramp, before, after):
    """Terms of one increment: works by name, stored, dissipated, [6]; plastic strains after it."""
    plastic = before[2]
    old, new = _At(ramp, *before), _At(ramp, *after, plastic)
    moved = _moved(before[1], after[1])

    def work(of):
        return 0.5 * jnp.sum((of(old) + of(new)) * moved)

    zero = jnp.zeros((), moved.dtype)
    dead = work(lambda at: at.load)
    following = zero
    if new.system.followers is not None:
        following = work(lambda at: at.following)
    supports = zero
    if ramp.moved is not None:
        supports = work(lambda at: at.reactions)
    if ramp.released is not None:
        supports = supports + work(lambda at: at.released)
    within = old.deflection_work(new)
    prestress = 0.5 * (old.energy_with(new) - old.energy + new.energy - new.energy_with(old))
    stored, dissipated = new.level - old.level, zero
    if plastic is not None:
        plastic = new.system.settle(after[1])
        settled = _At(ramp, *after, plastic)
        dissipated = new.energy - settled.energy
        stored = settled.level - old.level
    terms = dead + within[0], following + within[1], supports, prestress, stored, dissipated
    return jnp.stack(terms), plastic


def _moved(before, after):
    """Displacement, and the rotation vector where nodes turn, between motions, [n_row, 3 or 6]."""
    shift = (after - before)[:, :3]
    if before.shape[1] == 3:
        return shift

    def turn(old, new):
        return angles(stereographic(product(new, inverse(old))))

    return jnp.concatenate([shift, jax.vmap(turn)(before[:, 3:], after[:, 3:])], axis=1)


class _At:
    """Forces and energies at a load factor and motion of a phase, at given plastic strains.

    The energy E of an element has the potential of the loads q along it in it, as far as these act
    beyond its ends. Its own is ``U = E - q dE/dq``, and ``dU = dE/dm dm + dE/ds ds - q d(dE/dq)``
    the work of its ends, of what changes its unstressed length s, and of these loads.
    """

    def __init__(self, ramp, factor, motion, plastic):
        system = ramp.at(factor, plastic)
        self.system, self.motion = system, motion
        self.released = None if ramp.released is None else (1 - factor) * ramp.released
        self.load = system.load if ramp.released is None else system.load - self.released
        # a jack reels unstressed length in and out: that which would hold its force here
        self.states = [
            each("lock", group, state, system.nodes, motion) if state.held is not None else state
            for group, state in zip(system.groups, system.states, strict=True)
        ]
        self.alongs = [_along(state) for state in self.states]

    @property
    def following(self):
        force = self.system.following(self.system.nodes + self.motion[:, :3])
        return jnp.pad(force, ((0, 0), (0, self.load.shape[1] - 3)))

    @property
    def reactions(self):
        return self.system.reactions(self.motion)

    def _energy(self, k, state, along=None):
        """Energy of a group in a state under loads along it, J."""
        group = self.system.groups[k]
        if along is not None:
            state = _under(state, along)
        return jnp.sum(each("energy", group, state, self.system.nodes, self.motion))

    @property
    def energy(self):
        """E of all elements, J."""
        return sum(self._energy(k, state) for k, state in enumerate(self.states))

    def energy_with(self, other):
        """E with the unstressed lengths of another point of the phase, J."""
        pairs = zip(self.states, other.states, strict=True)
        mixed = [
            copy(own, rest_length=their.rest_length, elongation=their.elongation)
            for own, their in pairs
        ]
        return sum(self._energy(k, state) for k, state in enumerate(mixed))

    def _slopes(self, k, along):
        """dE/dq of a group under loads along it, as these; zero without load."""
        slopes = jax.grad(lambda q: self._energy(k, self.states[k], q))(along)
        return jax.tree.map(lambda q, slope: jnp.where(_none(q), 0.0, slope), along, slopes)

    @property
    def level(self):
        """Stored energy U of all elements, J."""
        total = self.energy
        for k, along in enumerate(self.alongs):
            if along is not None:
                total = total - sum(jax.tree.leaves(_product(along, self._slopes(k, along))))
        return total

    def deflection_work(self, new):
        """Work of dead loads, and of pressures, on what they deflect up to `new`, J."""
        works = [jnp.zeros((), self.motion.dtype)] * 2
        for k, (old_load, new_load) in enumerate(zip(self.alongs, new.alongs, strict=True)):
            if new_load is None:
                continue
            first = jax.tree.map(
                lambda a, b: jnp.where(_none(a), _FIRST * b, a), old_load, new_load
            )
            change = jax.tree.map(jnp.subtract, new._slopes(k, new_load), self._slopes(k, first))
            mean = jax.tree.map(lambda a, b: 0.5 * (a + b), old_load, new_load)
            done = _product(mean, change)
            works = [w - sum(jax.tree.leaves(own)) for w, own in zip(works, done, strict=True)]
        return works


def _along(state):
    """Loads along the elements of a group, (dead or None, pressures or None); None without any."""
    line, pressed = state.line_load, state.pressed
    if line is None and pressed is None:
        return None
    if pressed is not None:
        pressed = {per: [pressure for pressure, _ in own] for per, own in pressed.items()}
    return line, pressed


def _under(state, along):
    """The state with other loads along the elements."""
    line, pressed = along
    if pressed is not None:
        pressed = {
            per: [(new, axis) for new, (_, axis) in zip(own, state.pressed[per], strict=True)]
            for per, own in pressed.items()
        }
    return copy(state, line_load=line, pressed=pressed)


def _none(load):
    """Whether an element has no load, in a shape that broadcasts against it."""
    return load == 0 if load.ndim == 1 else jnp.all(load == 0, axis=-1, keepdims=True)


def _product(loads, slopes):
    """Sums of the products, with the two kinds of load apart."""
    return tuple(
        jax.tree.map(lambda a, b: jnp.sum(a * b), own, theirs)
        for own, theirs in zip(loads, slopes, strict=True)
    )
