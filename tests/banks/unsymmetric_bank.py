"""A bank of random structures whose tangent is not symmetric: drag, friction, thrusts, moments.

EA/N is over four decades, all else as in `bar_bank`: the force that sets the scale is 1 N, lengths
are about 1 m, every kind has one shape. Parts that are not symmetric range from small to thirty
times the others. `judged` compares with forces in NumPy, written apart from the elements.
"""

import dataclasses

import jax.numpy as jnp
import numpy as np
from banks.bar_bank import ALL, Drawn, Judged, Numbers, _elastic, _row
from banks.fuzz_scenes import CORNERS, FREE, GRID
from banks.shapes import pieces
from extensions.own_flows import Drags, Floors
from extensions.own_links import Joined, Thrusters

import jaxcable as jc
from jaxcable.common.tree import pytree


@pytree(indices=("links",))
class Gyres(Joined):
    """Springs to the second end that also push across its displacement u: k u + c a x u + h u^2 u.

    With the axis a = (1, 0, 1/2).
    """

    links: object
    stiffness: object
    skew: object
    hardening: object
    weight: object = None

    per_element = ("stiffness", "skew", "hardening", "weight")
    symmetric = False

    def end_forces(self, state, ends, motion):
        u = motion[1]
        across = self.skew * jnp.cross(jnp.array([1.0, 0.0, 0.5]), u)
        force = (self.stiffness + self.hardening * (u @ u)) * u + across
        return jnp.stack([jnp.zeros(3), force])

    def energy(self, state, ends, motion):
        return jnp.zeros(())


def _line(n, crooked=0.0, rng=None):
    """Nodes along x from 0 to 1, those between the ends moved aside at random, [n + 1, 3], m."""
    nodes = pieces(n)[0]
    if crooked:
        nodes[1:-1] += crooked * rng.normal(size=(n - 1, 3))
    return nodes


def _slackened(numbers, nodes):
    """Cables along nodes, slack or taut."""
    length = np.linalg.norm(np.diff(nodes, axis=0), axis=1)
    rest, n = (1 + numbers.rng.uniform(-0.005, 0.1)) * length, len(length)
    return jc.Cables(_row(n), axial_stiffness=numbers.stiffness(n), rest_length=rest)


def towed(numbers):
    """A crooked string of bars with a weight at its end, in a current."""
    rng, n = numbers.rng, 8
    nodes = np.concatenate([np.zeros((1, 3)), numbers.strings(np.zeros(3), n, 0.15)])
    bars = jc.Bars(_row(n), axial_stiffness=numbers.stiffness(n))
    groups = {"string": bars, "drag": Drags(_row(n), 10 ** rng.uniform(-1, 1.5))}
    forces = np.array([[0.0, 0.0, -0.05]] * (n - 1) + [[0.0, 0.0, -1.0]])
    load = jc.NodalLoads(np.arange(1, n + 1), forces)
    return jc.Structure(nodes, groups, jc.pinned([0])), [jc.Phase(loads=load)]


def moored(numbers):
    """A crooked chain of cables between two supports, slack or taut, in a current."""
    rng, n = numbers.rng, 8
    nodes = _line(n, 0.03, rng)
    groups = {
        "rope": _slackened(numbers, nodes),
        "drag": Drags(_row(n), 10 ** rng.uniform(-1, 1.5)),
    }
    forces = np.outer(rng.uniform(0.02, 0.2, n - 1), numbers.direction())
    load = jc.NodalLoads(np.arange(1, n), forces)
    return jc.Structure(nodes, groups, jc.pinned([0, n])), [jc.Phase(loads=load)]


def dragged(numbers):
    """A chain of bars on a floor with friction, pulled at its end."""
    rng, n = numbers.rng, 6
    nodes, free = _line(n), np.arange(1, n + 1)
    nodes[1:, 1] += 0.02 * rng.normal(size=n)
    groups = {
        "chain": jc.Bars(_row(n), axial_stiffness=numbers.stiffness(n)),
        "floor": Floors(free[:, None], 10 ** rng.uniform(1, 4), rng.uniform(0.1, 1.5)),
    }
    forces = np.tile([0.0, 0.0, -0.3], (n, 1)) + 0.05 * rng.normal(size=(n, 3))
    angle = rng.uniform(-1.5, 1.5)
    forces[-1, :2] += rng.uniform(0.3, 2) * np.array([np.cos(angle), np.sin(angle)])
    load = jc.NodalLoads(free, forces)
    return jc.Structure(nodes, groups, jc.pinned([0])), [jc.Phase(loads=load)]


def thrown(numbers):
    """A row of bars on springs, with thrusts across them that follow."""
    rng, n = numbers.rng, 4
    thrust = 0.3 * rng.uniform(-1, 1, n) * 10 ** rng.uniform(-1, 1)
    groups = {
        "bars": jc.Bars(_row(n), axial_stiffness=numbers.stiffness(n)),
        "push": Thrusters(_row(n), 10 ** rng.uniform(-0.5, 1, n), thrust),
    }
    load = jc.NodalLoads(np.arange(1, n + 1), 0.1 * rng.normal(size=(n, 3)))
    return jc.Structure(_line(n), groups, jc.pinned([0])), [jc.Phase(loads=load)]


def stirred(numbers):
    """A net on springs whose force is turned against their displacement."""
    rng = numbers.rng
    grid = np.array([[i, j, 0.0] for i in range(3) for j in range(3)])
    grid += 0.05 * rng.uniform(-1, 1, grid.shape)
    springs = 10 ** rng.uniform(0, 1, 5), 10 ** rng.uniform(-1, 1.3), 10 ** rng.uniform(-1, 2)
    length = np.linalg.norm(np.diff(grid[np.array(GRID)], axis=1)[:, 0], axis=1)
    stiffness = numbers.stiffness(12)
    rest = length / (1 + rng.uniform(0.2, 1, 12) / stiffness)
    groups = {
        "net": jc.Cables(GRID, axial_stiffness=stiffness, rest_length=rest),
        "gyres": Gyres([[0, k] for k in FREE], *springs),
    }
    load = jc.NodalLoads(FREE, rng.normal(size=(5, 3)))
    return jc.Structure(grid, groups, jc.pinned(CORNERS)), [jc.Phase(loads=load)]


def pressed(numbers):
    """A crooked chain of cables under pressure that keeps its size: it has no potential."""
    n = 12
    nodes = _line(n, 0.03, numbers.rng)
    supports = jc.pinned([0, n]) + jc.restrained(np.arange(1, n), "y")
    pressure = jc.CablePressure(1.0, (0.0, 1.0, 0.0), per="unstressed")
    structure = jc.Structure(nodes, _slackened(numbers, nodes), supports)
    return structure, [jc.Phase(loads=pressure)]


def _cantilever(numbers, n=6):
    """Beams along x, clamped at the first node; and forces on the others, times EI / L^2."""
    stiffness = max(numbers.ratio, 3e4) * 0.05**2 / 12
    forces = 0.3 * numbers.rng.uniform(0, 1) * numbers.rng.normal(size=(n, 3))
    return jc.Beams(_row(n), section=_elastic(numbers, 0.05)), forces * stiffness, stiffness


def coiled(numbers):
    """A cantilever under forces, and moments at its nodes that keep their axes."""
    n, rng = 6, numbers.rng
    beams, forces, stiffness = _cantilever(numbers)
    moments = 0.1 * rng.normal(size=(n, 3))
    moments[-1] += rng.uniform(0.2, 5) * numbers.direction()
    load = jc.NodalLoads(np.arange(1, n + 1), forces, stiffness * moments)
    structure = jc.Structure(_line(n), beams, jc.clamped([0]))
    return structure, [jc.Phase(loads=load, increments=10)]


def driven(numbers):
    """A cantilever whose end is pushed across by a thrust that follows."""
    n = 6
    beams, forces, stiffness = _cantilever(numbers)
    thrust = numbers.rng.uniform(0.2, 12) * stiffness
    groups = {"beams": beams, "push": Thrusters([[n - 1, n]], 1e-6, thrust)}
    load = jc.NodalLoads(np.arange(1, n + 1), forces)
    structure = jc.Structure(_line(n), groups, jc.clamped([0]))
    return structure, [jc.Phase(loads=load, increments=5)]


KINDS = {
    kind.__name__: kind
    for kind in (towed, moored, dragged, thrown, stirred, pressed, coiled, driven)
}


def drawn(kind, seed):
    """A scene: `Drawn` of a kind."""
    numbers = Numbers(seed, kind, (2, 6))
    return Drawn(*KINDS[kind](numbers), numbers.ratio)


# --- forces in NumPy


def _axial(group, place, moved):
    first, last = group.links.array.T
    ends = np.linalg.norm(place[last] - place[first], axis=1)
    rest = ends if group.rest_length is None else np.asarray(group.rest_length)
    chord = moved[last] - moved[first]
    length = np.linalg.norm(chord, axis=1)
    force = np.asarray(group.axial_stiffness) * (length / rest - 1)
    if isinstance(group, jc.Cables):
        force = np.maximum(force, 0)
    pull = (force / length)[:, None] * chord
    return np.stack([-pull, pull], axis=1)


def _drag(group, place, moved):
    first, last = group.links.array.T
    chord = moved[last] - moved[first]
    length = np.linalg.norm(chord, axis=1)[:, None]
    across = [1.0, 0.0, 0.0] - chord[:, :1] * chord / length**2
    size = np.asarray(group.drag)[:, None] * length
    push = size * np.sqrt((across**2).sum(axis=1, keepdims=True) + 1e-12) * across
    return np.stack([-push / 2, -push / 2], axis=1)


def _floor(group, place, moved):
    node = group.links.array[:, 0]
    height, slip = moved[node, 2], (moved - place)[node, :2]
    normal = np.asarray(group.stiffness) * (np.sqrt(height**2 + 1e-4) - height) / 2
    size = np.asarray(group.mu) * normal / np.sqrt((slip**2).sum(axis=1) + 1e-6)
    return np.concatenate([size[:, None] * slip, -normal[:, None]], axis=1)[:, None]


def _thrust(group, place, moved):
    first, last = group.links.array.T
    chord = moved[last] - moved[first]
    chord = chord / np.linalg.norm(chord, axis=1)[:, None]
    push = np.stack([-chord[:, 1], chord[:, 0], 0 * chord[:, 0]], axis=1)
    force = np.asarray(group.stiffness)[:, None] * (moved - place)[last]
    force = force - np.asarray(group.thrust)[:, None] * push
    return np.stack([-force, force], axis=1)


def _gyre(group, place, moved):
    u = (moved - place)[group.links.array[:, 1]]
    size = np.asarray(group.stiffness) + np.asarray(group.hardening) * (u**2).sum(axis=1)
    turned = np.asarray(group.skew)[:, None] * np.cross([1.0, 0.0, 0.5], u)
    return np.stack([0 * u, size[:, None] * u + turned], axis=1)


FORCES = {
    jc.Bars: _axial,
    jc.Cables: _axial,
    Drags: _drag,
    Floors: _floor,
    Thrusters: _thrust,
    Gyres: _gyre,
}


def unbalanced(one, displacement):
    """Forces of loads minus those of elements but beams, and the sizes of both, [n_node, 3], N."""
    structure, load = one.structure, one.phases[-1].loads
    place = np.asarray(structure.nodes)
    moved, left, size = place + displacement, np.zeros(place.shape), np.zeros(place.shape)
    for group in structure.groups:
        if not group.rotates:
            forces = FORCES[type(group)](group, place, moved)
            np.add.at(left, group.links.array, -forces)
            np.add.at(size, group.links.array, np.abs(forces))
    if isinstance(load, jc.CablePressure):
        across = np.cross([0.0, 1.0, 0.0], np.diff(moved, axis=0))
        rest = np.asarray(structure.elements.rest_length)[:, None]
        half = 0.5 * rest * across / np.linalg.norm(across, axis=1)[:, None]
        left += np.pad(half, ((0, 1), (0, 0))) + np.pad(half, ((1, 0), (0, 0)))
    else:
        np.add.at(left, load.nodes.array, np.asarray(load.forces))
    return left, size + np.abs(left)


def judged(one, solution):
    """`bar_bank.Judged` of a solution."""
    code = int(solution.status)
    paths = [phase.path for phase in solution.phases]
    steps = np.concatenate([np.asarray(path.iterations) for path in paths])
    wrong = code == jc.status.OK and not _balanced(one, solution)
    return Judged(code, wrong, steps, sum(int(np.sum(path.factorizations)) for path in paths))


def _balanced(one, solution):
    """Whether a solution is in equilibrium by `unbalanced`; beams as a whole, with moments."""
    displacement = np.asarray(solution.displacement)
    left, size = unbalanced(one, displacement)
    left = left + np.asarray(solution.reactions)
    if solution.rotation is None:
        stiffness = max(np.max(g.axial_stiffness) for g in one.structure.groups if _elastic_(g))
        rounding = 32 * np.finfo(float).eps * stiffness  # of displacements, as `path.rounding`
        return bool(np.abs(left).max() <= 1e-9 * size.max() + rounding)
    moments = np.array(solution.reaction_moments)
    if (load := one.phases[-1].loads).moments is not None:
        moments[load.nodes.array] += np.asarray(load.moments)
    place = np.asarray(one.structure.nodes) + displacement
    arms = np.cross(place, left) + moments
    whole = np.concatenate([left.sum(axis=0), arms.sum(axis=0)])
    return bool(np.abs(whole).max() <= ALL * max(size.sum(), np.abs(moments).sum()))


def _elastic_(group):
    return isinstance(group, jc.Bars | jc.Cables)


def moved_apart(one, solution):
    """The solution with another displacement: a judgement has to refuse it."""
    displacement = np.array(solution.displacement)
    displacement[1:] *= 1.001
    return dataclasses.replace(solution, displacement=jnp.asarray(displacement))
