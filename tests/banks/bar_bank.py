"""A bank of random structures with bars: EA/N over ten decades, far from where they end.

Every kind has one shape for ever, so that its scenes share a program. The force that sets the scale
is 1 N, lengths are about 1 m. Loads that turn a structure point away from its supports in the mean,
so that its members end in tension and an equilibrium exists.

`judged` compares with statics: those of every node (`independent.verdict`) where there are only
bars and cables, else those of the whole structure in its deflected shape, in extended precision.
"""

import dataclasses

import jax
import numpy as np
from banks.fuzz_scenes import CORNERS, FREE, GRID
from banks.shapes import pieces
from oracles.independent import WIDE, verdict

import jaxcable as jc

STIFFEST = 10  # log10 of the largest EA/N
ALL = 1e-8  # of the moments and forces that balance each other: tol is 1e-10 of the largest node's


@dataclasses.dataclass(frozen=True)
class Drawn:
    """A scene of the bank: what `jc.solve` takes, and EA over the force that sets the scale."""

    structure: jc.Structure
    phases: list
    ratio: float


class Numbers:
    """The random numbers that all kinds share."""

    def __init__(self, seed, kind, decades):
        self.rng = np.random.default_rng([seed, *kind.encode()])
        self.ratio = 10 ** self.rng.uniform(*decades)
        self.spread = self.rng.uniform(0, 1)

    def stiffness(self, n):
        """EA of n elements, N, over a decade."""
        return self.ratio * 10 ** (self.spread * self.rng.uniform(-0.5, 0.5, n))

    def direction(self):
        """A unit vector."""
        vector = self.rng.normal(size=3)
        return vector / np.linalg.norm(vector)

    def strings(self, start, count, length=0.2):
        """Nodes of a crooked string of bars from a point, [count, 3], m."""
        turns = np.array([self.direction() for _ in range(count)]) + self.direction()
        steps = length * turns / np.linalg.norm(turns, axis=1)[:, None]
        return start + np.cumsum(steps, axis=0)

    def pulls(self, n):
        """A weight on every node of a string, and ten times as much at its end, [n, 3], N."""
        forces = np.outer(self.rng.uniform(0.02, 0.1, n), self.direction())
        forces[-1] += self.direction()
        return forces


def _row(n, start=0):
    """Links of n elements in a row."""
    return pieces(n)[1] + start


def _ring(radians=0.0, height=0.0):
    """Three nodes on a circle of radius 1 m."""
    angle = radians + 2 * np.pi * np.arange(3) / 3
    return np.stack([np.cos(angle), np.sin(angle), np.full(3, height)], axis=1)


def turning(numbers):
    """A bar that turns about its support, to the direction of its load."""
    nodes = np.stack([np.zeros(3), numbers.direction()])
    bar = jc.Bars([[0, 1]], axial_stiffness=numbers.stiffness(1))
    load = jc.NodalLoads([1], numbers.direction())
    return jc.Structure(nodes, bar, jc.pinned([0])), [jc.Phase(loads=load)]


def string(numbers):
    """A string of insulators, drawn crooked, that hangs under weights and a pull at its end."""
    nodes = np.concatenate([np.zeros((1, 3)), numbers.strings(np.zeros(3), 6)])
    bars = jc.Bars(_row(6), axial_stiffness=numbers.stiffness(6))
    load = jc.NodalLoads(np.arange(1, 7), numbers.pulls(6))
    return jc.Structure(nodes, bars, jc.pinned([0])), [jc.Phase(loads=load)]


def chain(numbers):
    """A crooked chain of bars between two supports, under loads in one direction."""
    inner = numbers.strings(np.zeros(3), 5)
    last = inner[-1] + 0.2 * numbers.direction()
    nodes = np.concatenate([np.zeros((1, 3)), inner, [last]])
    bars = jc.Bars(_row(6), axial_stiffness=numbers.stiffness(6))
    forces = np.outer(numbers.rng.uniform(0.1, 1, 5), numbers.direction())
    load = jc.NodalLoads(np.arange(1, 6), forces)
    return jc.Structure(nodes, bars, jc.pinned([0, 6])), [jc.Phase(loads=load)]


def mixed(numbers):
    """Prestressed cables to the corners of a grid; from every free node a string of bars hangs."""
    rng = numbers.rng
    grid = np.array([[i, j, 0.0] for i in range(3) for j in range(3)])
    grid += 10 ** rng.uniform(-3, -0.5) * rng.uniform(-0.3, 0.3, grid.shape)
    hung = np.concatenate([numbers.strings(grid[k], 2) for k in FREE])
    bars = [[top, 9 + 2 * k] for k, top in enumerate(FREE)]
    bars += [[9 + 2 * k, 10 + 2 * k] for k in range(5)]
    groups = {
        "cables": jc.Cables(GRID, axial_stiffness=numbers.stiffness(12)),
        "bars": jc.Bars(bars, axial_stiffness=numbers.stiffness(10)),
    }
    forces = np.tile([0.0, 0.0, -0.2], (10, 1)) + 0.05 * rng.normal(size=(10, 3))
    phases = [
        jc.Phase(pretension={"cables": rng.uniform(0.5, 1, 12), "bars": None}),
        jc.Phase(loads=jc.NodalLoads(np.arange(9, 19), forces)),
    ]
    return jc.Structure(np.concatenate([grid, hung]), groups, jc.pinned(CORNERS)), phases


def prism(numbers):
    """A tensegrity prism of three struts, prestressed, whose upper nodes are loaded."""
    rng = numbers.rng
    # the twist of equilibrium (`scenes.simplex`)
    nodes = np.concatenate([_ring(), _ring(np.radians(30), rng.uniform(0.8, 2))])
    cables = [[0, 1], [1, 2], [2, 0], [3, 4], [4, 5], [5, 3], [0, 3], [1, 4], [2, 5]]
    struts = [[0, 4], [1, 5], [2, 3]]
    length = [np.linalg.norm(nodes[b] - nodes[a]) for a, b in cables + struts]
    force = np.array([3**-0.5] * 6 + [1.0] * 3 + [-1.0] * 3) * length
    groups = {
        "cables": jc.Cables(cables, axial_stiffness=numbers.stiffness(9)),
        "struts": jc.Bars(struts, axial_stiffness=numbers.stiffness(3)),
    }
    held = jc.pinned([0]) + jc.restrained([1], "yz") + jc.restrained([2], "z")
    forces = 10 ** rng.uniform(-3, -1) * rng.normal(size=(3, 3))
    phases = [
        jc.Phase(pretension={"cables": force[:9], "struts": force[9:]}),
        jc.Phase(loads=jc.NodalLoads([3, 4, 5], forces)),
    ]
    return jc.Structure(nodes, groups, held), phases


def mast(numbers):
    """A mast of two bars on a pin, held by six prestressed guys, under wind."""
    rng = numbers.rng
    nodes = np.concatenate([[[0.0, 0, 0], [0, 0, 1], [0, 0, 2]], _ring()])
    guys = [[k, 3 + j] for k in (1, 2) for j in range(3)]
    groups = {
        "mast": jc.Bars([[0, 1], [1, 2]], axial_stiffness=10 * numbers.stiffness(2)),
        "guys": jc.Cables(guys, axial_stiffness=numbers.stiffness(6)),
    }
    wind = rng.uniform(0, 1) * np.append(rng.normal(size=2), 0.0)
    phases = [
        jc.Phase(pretension={"guys": np.repeat(rng.uniform(0.5, 1, 2), 3), "mast": None}),
        jc.Phase(loads=jc.NodalLoads([1, 2], wind)),
    ]
    return jc.Structure(nodes, groups, jc.pinned([0, 3, 4, 5])), phases


def truss(numbers):
    """A tower of bars in three panels, loaded in all directions."""
    rng = numbers.rng
    nodes = np.concatenate([_ring(height=k) for k in range(4)])
    nodes = nodes + 0.1 * rng.normal(size=nodes.shape)
    bars = []
    for k in range(3):
        for j in range(3):
            low, high, other = 3 * k + j, 3 * k + 3 + j, 3 * k + 3 + (j + 1) % 3
            bars += [[low, high], [low, other], [high, other]]
    group = jc.Bars(bars, axial_stiffness=numbers.stiffness(27))
    load = jc.NodalLoads(np.arange(3, 12), rng.normal(size=(9, 3)))
    return jc.Structure(nodes, group, jc.pinned([0, 1, 2])), [jc.Phase(loads=load)]


def _elastic(numbers, depth):
    """A rectangular section of the bank's EA, whose bending carries a few newtons in any case."""
    modulus = max(numbers.ratio, 3e4) / depth**2
    return jc.Section.rectangle(depth, depth, jc.Elastic(modulus))


def arm(numbers, kind=jc.Bars):
    """A string of bars, drawn crooked, that hangs from the tip of a cantilever of two beams."""
    beams = np.array([[0.0, 0, 0], [0.5, 0, 0], [1, 0, 0]])
    nodes = np.concatenate([beams, numbers.strings(beams[-1], 4)])
    groups = {
        "beams": jc.Beams([[0, 1], [1, 2]], section=_elastic(numbers, 0.1)),
        "string": kind(_row(4, 2), axial_stiffness=numbers.stiffness(4)),
    }
    load = jc.NodalLoads(np.arange(3, 7), numbers.pulls(4))
    return jc.Structure(nodes, groups, jc.clamped([0])), [jc.Phase(loads=load)]


def rope(numbers):
    """The same with a string of cables: no net, because of the beams, and no bars."""
    return arm(numbers, jc.Cables)


def blown(numbers):
    """A crooked chain of cables, slack or taut, under pressure that follows: hence no net."""
    rng, n = numbers.rng, 12
    nodes = pieces(n)[0]
    nodes[1:-1] += 0.03 * rng.normal(size=(n - 1, 3))
    rest = (1 + rng.uniform(-0.005, 0.1)) * np.linalg.norm(np.diff(nodes, axis=0), axis=1)
    cables = jc.Cables(_row(n), axial_stiffness=numbers.stiffness(n), rest_length=rest)
    supports = jc.pinned([0, n]) + jc.restrained(np.arange(1, n), "y")
    pressure = jc.CablePressure(1.0, (0.0, 1.0, 0.0))
    return jc.Structure(nodes, cables, supports), [jc.Phase(loads=pressure)]


def stayed(numbers):
    """Half a stayed bridge: a deck of beams held by a pylon of beams with stays and back stay."""
    rng = numbers.rng
    deck = np.array([[0.5 * k, 0, 0] for k in range(5)])
    nodes = np.concatenate([deck, [[0, 0, 1.0], [-1.0, 0, 0]]])
    groups = {
        "deck": jc.Beams(_row(4), section=_elastic(numbers, 0.05), up=(0.0, 0.0, 1.0)),
        "pylon": jc.Beams([[0, 5]], section=_elastic(numbers, 0.1), up=(1.0, 0.0, 0.0)),
        "stays": jc.Cables([[2, 5], [3, 5], [4, 5], [6, 5]], numbers.stiffness(4)),
    }
    supports = jc.clamped([0]) + jc.pinned([6])
    phases = [
        jc.Phase(pretension={"stays": rng.uniform(0.1, 0.3, 4)}),
        jc.Phase(loads=jc.NodalLoads([1, 2, 3, 4], (0.0, 0.0, -rng.uniform(0.05, 0.3)))),
    ]
    return jc.Structure(nodes, groups, supports), phases


KINDS = {
    kind.__name__: kind
    for kind in (turning, string, chain, mixed, prism, mast, truss, arm, rope, stayed, blown)
}


def drawn(kind, seed, decades=(2, STIFFEST)):
    """A scene: `Drawn` of a kind; `decades` are the ends of log10 EA/N."""
    numbers = Numbers(seed, kind, decades)
    return Drawn(*KINDS[kind](numbers), numbers.ratio)


@dataclasses.dataclass(frozen=True)
class Judged:
    """How an analysis of a scene ended.

    Attributes:
        code: its status.
        wrong: whether a status OK is not deserved.
        steps: Newton steps of every increment.
        factorizations: of all increments.
    """

    code: int
    wrong: bool
    steps: np.ndarray
    factorizations: int


def judged(one, solution):
    """`Judged` of a solution."""
    code = int(solution.status)
    paths = [phase.path for phase in solution.phases]
    steps = np.concatenate([np.asarray(path.iterations) for path in paths])
    wrong = code == jc.status.OK and not _balanced(one, solution)
    return Judged(code, wrong, steps, sum(int(np.sum(path.factorizations)) for path in paths))


def _balanced(one, solution):
    """Whether the results of a scene are in equilibrium."""
    if isinstance(one.phases[-1].loads, jc.CablePressure):
        return _balanced_under_pressure(one, solution)
    if not any(group.rotates for group in one.structure.groups):
        return verdict(one.structure, one.phases, solution).passed
    place = WIDE(one.structure.nodes) + WIDE(solution.displacement)
    force = np.concatenate([solution.reactions, solution.reaction_moments], axis=1).astype(WIDE)
    load = one.phases[-1].loads
    np.add.at(force[:, :3], load.nodes.array, np.asarray(load.forces))
    moment = np.cross(place, force[:, :3]) + force[:, 3:]
    sizes = np.abs(np.concatenate([force[:, :3], moment], axis=1)).sum(axis=0).max()
    left = np.concatenate([force[:, :3].sum(axis=0), moment.sum(axis=0)])
    pulls = [np.abs(np.asarray(t)) for t in jax.tree.leaves(solution.tension)]
    scale = max(sizes, *(pull.max() for pull in pulls))
    return bool(np.abs(left).max() <= ALL * scale)


def _balanced_under_pressure(one, solution):
    """Whether tensions balance half of the pressure on each piece, normal to it and to y, 1 N/m."""
    piece = np.diff(WIDE(one.structure.nodes) + WIDE(solution.displacement), axis=0)
    tension = np.asarray(solution.tension)
    pull = tension[:, None] * piece / np.linalg.norm(piece, axis=1)[:, None]
    push = 0.5 * np.cross([0.0, 1.0, 0.0], piece)
    left = (np.diff(pull, axis=0) + push[1:] + push[:-1])[:, ::2]
    stiffness = np.max(one.structure.elements.axial_stiffness)
    rounding = 32 * np.finfo(float).eps * stiffness  # of displacements, as `path.rounding`
    return bool(np.abs(left).max() <= 1e-9 * np.abs(pull).max() + rounding)
