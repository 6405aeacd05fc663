"""A bank of random structures with contacts: EA over the force that sets the scale up to 1e8.

Numbers, scales and shapes are as in `bar_bank`. Loads close and open contacts, and many cables
start slack. `judged` compares with forces in NumPy, from positions alone.
"""

import numpy as np
from banks import slack_nets
from banks.bar_bank import Drawn, Judged, Numbers, _row
from banks.bar_bank import mast as mast_of_bars
from banks.bar_bank import prism as prism_of_bars
from oracles.contact_potential import ContactPotential

import jaxcable as jc

STIFFEST = 8  # log10 of the largest EA/N


def random_structure(seed):
    """Bars, cables, contacts, bearings and a spring between five anchors and five free nodes."""
    rng = np.random.default_rng(seed)
    anchors = np.array([[-2.0, -2, 0], [2, -2, 0], [2, 2, 0], [-2, 2, 0], [0, 0, 3]])
    free = rng.uniform(-1.5, 1.5, (5, 3))
    free[:, 2] += 1.5
    nodes = np.vstack([anchors, free])
    pairs = [(i, j) for i in range(10) for j in range(max(i + 1, 5), 10)]
    rng.shuffle(pairs)
    links = dict(bars=pairs[:7], cables=pairs[7:15], contacts=pairs[15:25])
    length = {
        name: np.linalg.norm(nodes[[i for i, _ in own]] - nodes[[j for _, j in own]], axis=1)
        for name, own in links.items()
    }
    stiffness = {name: 1e5 * 10 ** rng.uniform(-1, 1, len(own)) for name, own in links.items()}
    rest = {
        "bars": length["bars"],
        "cables": length["cables"] * rng.uniform(0.97, 1.05, 8),
        "contacts": length["contacts"] * rng.uniform(0.97, 1.01, 10),
    }
    kinds = {"bars": jc.Bars, "cables": jc.Cables, "contacts": jc.Contacts}
    groups = {
        name: kind(links[name], axial_stiffness=stiffness[name], rest_length=rest[name])
        for name, kind in kinds.items()
    }
    firm, gap = 1e5 * 10 ** rng.uniform(-1, 1, 3), rng.uniform(-0.01, 0.03, 3)
    groups["ground"] = jc.GroundContacts([5, 6, 7], firm, rng.normal(size=(3, 3)), gap)
    groups["springs"] = jc.Springs([8], rng.uniform(0, 100, 3))
    load = rng.normal(size=(5, 3)) * 10 ** rng.uniform(0, 4)
    phase = jc.Phase(loads=jc.NodalLoads(range(5, 10), load), increments=2)
    return jc.Structure(nodes, groups, jc.pinned(range(5))), [phase]


def _as_contacts(group):
    """The bars of a group as contacts."""
    return jc.Contacts(group.links.array, axial_stiffness=group.axial_stiffness)


def stopped(numbers):
    """A crooked chain of bars between supports, and a stop behind a gap for every inner node."""
    rng = numbers.rng
    inner = numbers.strings(np.zeros(3), 5)
    last, sides = inner[-1] + 0.2 * numbers.direction(), rng.normal(size=(5, 3))
    stops = inner + 0.3 * sides / np.linalg.norm(sides, axis=1)[:, None]
    nodes = np.concatenate([np.zeros((1, 3)), inner, [last], stops])
    groups = {
        "chain": jc.Bars(_row(6), axial_stiffness=numbers.stiffness(6)),
        "stops": jc.Contacts(
            [[k + 1, k + 7] for k in range(5)], numbers.stiffness(5), gap=rng.uniform(0, 0.05, 5)
        ),
    }
    load = jc.NodalLoads(np.arange(1, 6), np.outer(rng.uniform(0.1, 1, 5), numbers.direction()))
    phases = [jc.Phase(loads=load), jc.Phase(loads=jc.NodalLoads([3], 2 * numbers.direction()))]
    return jc.Structure(nodes, groups, jc.pinned([0, *range(6, 12)])), phases


def prism(numbers):
    """The prism of `bar_bank` with struts that only press."""
    structure, phases = prism_of_bars(numbers)
    struts = _as_contacts(structure.elements["struts"])
    return jc.replace(structure, elements=structure.elements | {"struts": struts}), phases


def mast(numbers):
    """The guyed mast of `bar_bank`, of two props that only press."""
    structure, phases = mast_of_bars(numbers)
    props = _as_contacts(structure.elements["mast"])
    return jc.replace(structure, elements=structure.elements | {"mast": props}), phases


def dome(numbers):
    """A cable dome of which a third of the cables is too long, with struts that only press."""
    structure, phase = slack_nets.beside_struts(numbers.rng.integers(1 << 30), numbers.ratio)
    struts = _as_contacts(structure.elements["struts"])
    return jc.replace(structure, elements=structure.elements | {"struts": struts}), [phase]


def _grid(numbers):
    """A grid of cables, many of them too long: structure, phase, their EA."""
    kind = slack_nets.KINDS[numbers.rng.integers(4)]
    structure, phase = slack_nets.scene(kind, 6, numbers.ratio)
    group, rest = structure.elements, np.asarray(phase.rest_length)
    cables = jc.Cables(group.links.array, group.axial_stiffness, rest_length=rest)
    return structure, cables, jc.Phase(loads=phase.loads)


def propped(numbers):
    """A grid of cables, many of them too long, with props behind gaps across some fields."""
    structure, cables, phase = _grid(numbers)
    place = np.arange(36).reshape(6, 6)
    across = np.stack([place[:-1, :-1].ravel(), place[1:, 1:].ravel()], axis=1)
    across = across[numbers.rng.permutation(25)[:8]]
    props = jc.Contacts(across, numbers.stiffness(8), gap=numbers.rng.uniform(0, 0.3, 8))
    groups = {"cables": cables, "props": props}
    return jc.Structure(structure.nodes, groups, structure.supports), [phase]


def grounded(numbers):
    """A grid of cables, many of them too long, some way above uneven ground."""
    structure, cables, phase = _grid(numbers)
    free = np.setdiff1d(np.arange(36), slack_nets.grid(6)[2])
    ground = jc.GroundContacts(free, numbers.stiffness(32), gap=numbers.rng.uniform(0, 1, 32))
    groups = {"cables": cables, "ground": ground}
    return jc.Structure(structure.nodes, groups, structure.supports), [phase]


KINDS = {kind.__name__: kind for kind in (stopped, prism, mast, dome, propped, grounded)}
KINDS = {"mixed": None} | KINDS


def drawn(kind, seed, decades=(2, STIFFEST)):
    """A scene: `Drawn` of a kind; `decades` are the ends of log10 EA/N, but of "mixed"."""
    if kind == "mixed":
        return Drawn(*random_structure(seed), 1e5)
    numbers = Numbers(seed, kind, decades)
    return Drawn(*KINDS[kind](numbers), numbers.ratio)


def judged(one, solution):
    """`bar_bank.Judged` of a solution: wrong without balance, or with forces that others deny."""
    code, wrong = int(solution.status), False
    paths = [phase.path for phase in solution.phases]
    steps = np.concatenate([np.asarray(path.iterations) for path in paths])
    if code == jc.status.OK:
        potential = ContactPotential(one.structure, one.phases)
        left, size = potential.gradient(np.asarray(solution.displacement))
        # the tolerance of Newton's method is 1e-10 of the forces at a node, and what the rounding
        # of displacements leaves; lengths from positions add some roundings of EA
        rounding = 64 * np.finfo(float).eps * potential.stiffness.max()
        wrong = bool(np.abs(left).max() > 1e-8 * size + rounding)
    return Judged(code, wrong, steps, sum(int(np.sum(path.factorizations)) for path in paths))
