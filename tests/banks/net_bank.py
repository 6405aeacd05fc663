"""A bank of random nets of cables under dead load: stiff, slack, far from where they end.

Every kind has one shape for ever, so that its scenes share a program. Each is built twice from the
same numbers: as structure and phases, and as a `convex_oracle.Scene` of what the last phase ends
with, whose unstressed lengths come from what the phases state, in extended precision.

The force that sets the scale is 1 N (times `decade`): EA/N is 1e2 to 1e10, loads go to 10 N, and
lengths are about 1 m.
"""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from banks.fuzz_scenes import CORNERS, FREE, GRID
from oracles.convex_oracle import WIDE, Element, Scene, check, find

import jaxcable as jc
from jaxcable.common.checks import without_warnings

STIFFEST = {"float64": 10, "float32": 5}  # log10 of the largest EA/N
LIGHT = {"float64": (-6, 2), "float32": (0, 2)}  # log10 of weights per length of far catenaries
STEP = WIDE("1e-5")  # of the loads, for differences
NOISE = 8  # roundings of a displacement in a length, as the method promises


@dataclasses.dataclass(frozen=True)
class Drawn:
    """A scene of the bank.

    Attributes:
        structure, phases: for `jc.solve`.
        oracle: `Scene` of the end of the last phase.
        ratio: EA over the force that sets the scale.
        stated: whether unstressed lengths are stated, and not strains.
    """

    structure: jc.Structure
    phases: list
    oracle: Scene
    ratio: float
    stated: bool = False


class Numbers:
    """The random numbers that all kinds share."""

    def __init__(self, seed, kind, dtype):
        self.rng = rng = np.random.default_rng([seed, *kind.encode()])
        self.dtype = dtype
        self.ratio = 10 ** rng.uniform(2, STIFFEST[dtype])
        self.spread = rng.uniform(0, 2)
        self.slack = rng.uniform(0, 1)
        self.load = 0.0 if rng.random() < 0.1 else 10 ** rng.uniform(-4, 1)
        self.rough = 10 ** rng.uniform(-4, 0)

    def stiffness(self, n):
        """EA of n elements, N, over decades."""
        return self.ratio * 10 ** (self.spread * self.rng.uniform(-0.5, 0.5, n))

    def strain(self, n, slack=True):
        """Strains of about 1 N over EA; a part of them negative."""
        strain = self.rng.uniform(0.5, 1, n) / self.ratio
        return np.where(slack & (self.rng.random(n) < self.slack), -strain, strain)

    def grid(self):
        """Nodes of a grid of 3 by 3, off the plane, turned, [9, 3], m."""
        nodes = np.array([[i, j, 0.0] for i in range(3) for j in range(3)])
        nodes += self.rough * self.rng.uniform(-0.3, 0.3, nodes.shape)
        return (nodes @ np.linalg.qr(self.rng.normal(size=(3, 3)))[0]).astype(self.dtype)

    def forces(self, n):
        """Loads on n nodes, [n, 3], N; some nodes have none."""
        chosen = self.rng.random((n, 1)) < 0.7
        return (self.load * self.rng.normal(size=(n, 3)) * chosen).astype(self.dtype)

    def cut(self, nodes, links):
        """Unstressed lengths: shorter than the distances by strains, or much longer, m."""
        n = len(links)
        length = np.linalg.norm(np.diff(nodes[np.array(links)].astype(float), axis=1)[:, 0], axis=1)
        longer = self.rng.random(n) < self.slack
        change = np.where(longer, self.rng.uniform(1, 2, n), 1 - self.strain(n, False))
        return (length * change).astype(self.dtype)


def _oracle(nodes, elements, fixed, forces):
    """Scene of supported nodes `fixed` under `forces`, a dict of forces by node."""
    free, load = np.ones((len(nodes), 3), bool), np.zeros((len(nodes), 3))
    free[list(fixed)] = False
    for node, force in forces.items():
        load[node] = force if node not in fixed else 0
    return Scene(nodes.astype(float), free, load, elements)


def _cables(links, stiffness, rest):
    return [
        Element("cable", tuple(link), float(ea), WIDE(l0))
        for link, ea, l0 in zip(links, stiffness, rest, strict=True)
    ]


def _chords(nodes, links):
    """Lengths over the nodes of chains, in extended precision, m."""
    nodes = nodes.astype(WIDE)
    pieces = [np.diff(nodes[list(link)], axis=0) for link in links]
    return np.array([np.sqrt((piece**2).sum(axis=1)).sum() for piece in pieces])


def _as_stored(values, dtype):
    return np.asarray(values, dtype).astype(WIDE)


# --- kinds


def net(one):
    """Prestrained cables, then loads in two increments."""
    nodes, ea, strain = one.grid(), one.stiffness(12), one.strain(12)
    forces = one.forces(5)
    structure = jc.Structure(nodes, jc.Cables(GRID, axial_stiffness=ea), jc.pinned(CORNERS))
    loading = jc.Phase(loads=jc.NodalLoads(FREE, forces), increments=2)
    rest = _chords(nodes, GRID) / (1 + _as_stored(strain, one.dtype))
    elements = _cables(GRID, _as_stored(ea, one.dtype), rest)
    scene = _oracle(nodes, elements, CORNERS, dict(zip(FREE, forces, strict=True)))
    return Drawn(structure, [jc.Phase(prestrain=strain), loading], scene, one.ratio)


def _cut(one, nodes, start):
    ea, rest, forces = one.stiffness(12), one.cut(nodes, GRID), one.forces(5)
    cables = jc.Cables(GRID, axial_stiffness=ea, rest_length=rest)
    structure = jc.Structure(start, cables, jc.pinned(CORNERS))
    phases = [jc.Phase(loads=jc.NodalLoads(FREE, f)) for f in (forces, -2 * forces, 2 * forces)]
    elements = _cables(GRID, _as_stored(ea, one.dtype), _as_stored(rest, one.dtype))
    scene = _oracle(start, elements, CORNERS, dict(zip(FREE, forces, strict=True)))
    return Drawn(structure, phases, scene, one.ratio, stated=True)


def cut_net(one):
    """Cables cut to length, some much too long, loaded, reversed and loaded again."""
    nodes = one.grid()
    return _cut(one, nodes, nodes)


def far(one):
    """As `cut_net`, from nodes that lie up to some lengths away from where they belong."""
    nodes = one.grid()
    away = 10 ** one.rng.uniform(-2, 0.5) * one.rng.normal(size=nodes.shape)
    away[CORNERS] = 0
    return _cut(one, nodes, (nodes + away).astype(one.dtype))


def rope(one):
    """A chain of ten cables between two supports, loaded at its nodes; one branch is loose."""
    links = [[k, k + 1] for k in range(10)] + [[5, 11]]
    nodes = np.array([[k, 0.0, 0.0] for k in range(11)] + [[5.0, 1.0, 0.0]])
    nodes += one.rough * one.rng.uniform(-0.3, 0.3, nodes.shape)
    nodes = nodes.astype(one.dtype)
    inner = [k for k in range(12) if k not in (0, 10)]
    ea, rest, forces = one.stiffness(11), one.cut(nodes, links), one.forces(len(inner))
    cables = jc.Cables(links, axial_stiffness=ea, rest_length=rest)
    structure = jc.Structure(nodes, cables, jc.pinned([0, 10]))
    phases = [jc.Phase(loads=jc.NodalLoads(inner, forces), increments=2)]
    elements = _cables(links, _as_stored(ea, one.dtype), _as_stored(rest, one.dtype))
    scene = _oracle(nodes, elements, [0, 10], dict(zip(inner, forces, strict=True)))
    return Drawn(structure, phases, scene, one.ratio, stated=True)


def released(one):
    """A net whose middle is let go and one corner too while the loads come, and come again."""
    nodes, ea, strain = one.grid(), one.stiffness(12), np.abs(one.strain(12))
    forces = one.forces(9)
    structure = jc.Structure(nodes, jc.Cables(GRID, axial_stiffness=ea), jc.pinned([*CORNERS, 4]))
    loads = jc.NodalLoads(range(9), forces)
    phases = [
        jc.Phase(prestrain=strain),
        jc.Phase(loads=loads, supports=jc.pinned([0, 2, 6])),
        jc.Phase(loads=loads, supports=jc.pinned([0, 2, 6])),
    ]
    rest = _chords(nodes, GRID) / (1 + _as_stored(strain, one.dtype))
    elements = _cables(GRID, _as_stored(ea, one.dtype), rest)
    twice = dict(enumerate(2 * forces))
    return Drawn(structure, phases, _oracle(nodes, elements, [0, 2, 6], twice), one.ratio)


def sliding(one):
    """Frictionless ropes over nodes that cables hold."""
    chains = [[0, 1, 4, 7, 8], [2, 5, 3, 6]]
    nodes, ea, strain = one.grid(), one.stiffness(12), one.strain(12)
    more, tight, forces = one.stiffness(2), np.abs(one.strain(2)), one.forces(5)
    groups = {
        "cables": jc.Cables(GRID, axial_stiffness=ea),
        "ropes": jc.SlidingCables(chains, axial_stiffness=more),
    }
    structure = jc.Structure(nodes, groups, jc.pinned(CORNERS))
    phases = [
        jc.Phase(prestrain={"cables": strain, "ropes": tight}),
        jc.Phase(loads=jc.NodalLoads(FREE, forces)),
    ]
    rest = _chords(nodes, GRID) / (1 + _as_stored(strain, one.dtype))
    elements = _cables(GRID, _as_stored(ea, one.dtype), rest)
    rest = _chords(nodes, chains) / (1 + _as_stored(tight, one.dtype))
    for chain, stiffness, length in zip(chains, _as_stored(more, one.dtype), rest, strict=True):
        elements.append(Element("rope", tuple(chain), float(stiffness), length))
    scene = _oracle(nodes, elements, CORNERS, dict(zip(FREE, forces, strict=True)))
    return Drawn(structure, phases, scene, one.ratio)


def jacks(one):
    """A net in which three jacks keep their forces while the loads come."""
    held = [0, 5, 10]
    nodes, ea, strain = one.grid(), one.stiffness(12), one.strain(12)
    pull, forces = one.rng.uniform(0.3, 3, 12), one.forces(5)
    others = [k for k in range(12) if k not in held]
    groups = {
        "cables": jc.Cables([GRID[k] for k in others], axial_stiffness=ea[others]),
        "jacked": jc.Cables([GRID[k] for k in held], axial_stiffness=ea[held]),
    }
    structure = jc.Structure(nodes, groups, jc.pinned(CORNERS))
    loads = jc.NodalLoads(FREE, forces)
    phases = [
        jc.Phase(
            prestrain={"cables": strain[others], "jacked": None},
            jacking={"cables": None, "jacked": pull[held]},
            loads=loads,
        )
    ]
    rest = _chords(nodes, GRID) / (1 + _as_stored(strain, one.dtype))
    cables = _cables(GRID, _as_stored(ea, one.dtype), rest)
    elements = [cables[k] for k in others]
    for k in held:
        force = float(np.asarray(pull[k], one.dtype))
        elements.append(Element("jack", tuple(GRID[k]), force=force))
    scene = _oracle(nodes, elements, CORNERS, dict(zip(FREE, forces, strict=True)))
    return Drawn(structure, phases, scene, one.ratio)


def _hung(one, nodes, start, weights, bare, signs):
    """Catenaries cut to length, with decades of `weights`; up to a share `bare` has none."""
    ea, forces, rest = one.stiffness(12), one.forces(5), one.cut(nodes, GRID)
    weight = 10 ** one.rng.uniform(*weights) * one.rng.uniform(0.5, 2, 12)
    weight = (weight * (one.rng.random(12) >= one.rng.uniform(0, bare))).astype(one.dtype)
    with without_warnings():  # some are lighter than any cable
        cables = jc.Catenaries(GRID, axial_stiffness=ea, rest_length=rest, weight=weight)
        structure = jc.Structure(start, cables, jc.pinned(CORNERS))
    phases = [jc.Phase(loads=jc.SelfWeight())]
    phases += [jc.Phase(loads=jc.NodalLoads(FREE, sign * forces)) for sign in signs]
    elements = _cables(GRID, _as_stored(ea, one.dtype), _as_stored(rest, one.dtype))
    for k in np.flatnonzero(weight):
        load = (0.0, 0.0, -float(weight[k]))
        elements[k] = dataclasses.replace(elements[k], kind="catenary", load=load)
    scene = _oracle(start, elements, CORNERS, dict(zip(FREE, forces, strict=True)))
    return Drawn(structure, phases, scene, one.ratio, stated=True)


def catenaries(one):
    """Catenaries under their weight, then loads."""
    nodes = one.grid()
    return _hung(one, nodes, nodes, (-4, 1), 0, [1])


def far_catenaries(one):
    """As `catenaries`, far from where they belong, some without weight; loads reverse, too."""
    nodes = one.grid()
    away = 10 ** one.rng.uniform(-2, 0.5) * one.rng.normal(size=nodes.shape)
    away[CORNERS] = 0
    start = (nodes + away).astype(one.dtype)
    return _hung(one, nodes, start, LIGHT[one.dtype], 0.5, [1, -2, 2])


KINDS = {
    "net": net,
    "cut net": cut_net,
    "far": far,
    "rope": rope,
    "released": released,
    "sliding": sliding,
    "jacks": jacks,
    "catenaries": catenaries,
    "far hung": far_catenaries,
}


def drawn(kind, seed, dtype="float64"):
    """The scene of a kind with a seed."""
    return KINDS[kind](Numbers(seed, kind, dtype))


def together(scenes, results):
    """Results of the analyses of all scenes in one batch, and of each one alone."""
    flat = [jax.tree.flatten((one.structure, one.phases)) for one in scenes]
    tree = flat[0][1]
    assert all(other == tree for _, other in flat)
    stacked = [np.stack(arrays) for arrays in zip(*(leaves for leaves, _ in flat), strict=True)]
    batch = jax.vmap(lambda leaves: results(jc.solve(*jax.tree.unflatten(tree, leaves))))(stacked)
    return batch, [results(jc.solve(one.structure, one.phases)) for one in scenes]


# --- derivatives


def scaled(one, factor):
    """Phases of a scene with all its nodal loads times a factor, which can be traced."""
    return [
        jc.replace(phase, loads=jc.replace(phase.loads, forces=factor * phase.loads.forces))
        if isinstance(phase.loads, jc.NodalLoads)
        else phase
        for phase in one.phases
    ]


def weights(one):
    """A weight for every element, [n], so that a sum of tensions has no symmetry."""
    return np.random.default_rng(1).uniform(0.5, 2, len(one.oracle.elements))


def slope(one, step=STEP):
    """Derivative of the weighted sum of tensions by a factor of the loads, by the oracle, N.

    Returns:
        The central difference over half a `step`, and how far that of a whole step is from it; None
        where a cable slackens within the step, so that there is no derivative.
    """
    found = []
    for shift in (step, -step, step / 2, -step / 2):
        scene = dataclasses.replace(one.oracle, load=one.oracle.load * (1 + shift))
        found.append(find(scene))
    taut = [np.array(each.tension) > 1e-9 * float(each.scale) for each in found]
    if not all(each.found for each in found) or any((t != taut[0]).any() for t in taut):
        return None
    sums = [np.array(each.tension) @ weights(one) for each in found]
    wide, narrow = (sums[0] - sums[1]) / (2 * step), (sums[2] - sums[3]) / step
    return float(narrow), float(abs(wide - narrow))


def derivative(one):
    """As `slope`, by the package, and the sum itself, N."""

    def total(factor):
        solution = jc.solve(one.structure, scaled(one, factor))
        tension = jnp.concatenate(jax.tree.leaves(solution.tension))
        # slack cables at a loose node have no derivative, by convention
        return weights(one) @ jnp.where(tension > 0, tension, 0.0)

    value, found = jax.jvp(total, (1.0,), (1.0,))
    return float(found), float(value)


# --- judgement


@dataclasses.dataclass(frozen=True)
class Judged:
    """How an analysis of a scene ended.

    Attributes:
        exists: whether the oracle finds an equilibrium.
        ok: whether the analysis says so.
        hidden: whether it says that rounding hides the forces.
        excess: residual of its displacements and tensions, by the oracle, over what is promised.
        steps: Newton steps of every increment.
        factorizations: of all increments.
        why: of the oracle.
    """

    exists: bool
    ok: bool
    hidden: bool
    excess: float
    steps: np.ndarray
    factorizations: int
    why: str

    @property
    def wrong(self):
        """Whether a status OK is not deserved."""
        return self.ok and not self.excess <= 1

    @property
    def missed(self):
        """Whether there is an equilibrium that the analysis has not found, nor says why not."""
        return self.exists and not self.ok and not self.hidden


def judged(one, solution, ask=True):
    """`Judged` of a solution; `ask` the oracle also where the analysis has found an equilibrium."""
    ok = int(solution.status) == jc.status.OK
    hidden = int(solution.status) == jc.status.AT_ROUNDING
    paths = [phase.path for phase in solution.phases]
    steps = np.concatenate([np.asarray(path.iterations) for path in paths])
    found = find(one.oracle) if ask or not ok else None
    excess = _excess(one, solution) if ok else np.nan
    count = sum(int(np.sum(path.factorizations)) for path in paths)
    exists, why = (True, "") if found is None else (found.found, found.why)
    return Judged(exists, ok, hidden, excess, steps, count, why)


def _excess(one, solution):
    """Largest residual of displacements, and of tensions at them, over what is promised."""
    scene, moved = one.oracle, np.asarray(solution.displacement)
    eps = np.finfo(moved.dtype).eps
    tol = max(1e-10 if moved.dtype == np.float64 else 1e-5, 64 * eps)
    groups = solution.tension
    groups = groups.values() if isinstance(groups, dict) else [groups]
    tension = np.concatenate([np.asarray(values, WIDE) for values in groups])
    worst = 0.0
    # what the rounding of the displacements leaves in forces that come from them, and the rounding
    # of the forces themselves
    unsure, forces = np.zeros(len(moved)), np.zeros(len(moved))
    for element, n in zip(scene.elements, tension, strict=True):
        nodes = list(element.links)
        shift = np.abs(moved[nodes]).max() * eps
        if element.stiffness is not None:
            # a stated length and the chord are rounded before they are subtracted
            blur = float(element.rest_length) * (eps if one.stated else np.finfo(WIDE).eps)
            unsure[nodes] += element.stiffness / float(element.rest_length) * (shift + blur)
        forces[nodes] += float(n) * eps
    hung = any(element.kind == "catenary" for element in scene.elements)
    for stated in (None,) if hung else (None, tension):
        residual, scale = check(scene, moved, None, stated)
        allowed = tol * float(scale) + NOISE * (unsure + forces)
        size = np.abs(residual).max(axis=1).astype(float)
        worst = max(worst, np.max(size / np.where(allowed > 0, allowed, np.inf)))
        if np.any(size[allowed == 0] > 0):
            return np.inf
    return worst
