"""Random scenes of a few fixed shapes: numbers over many decades, few programs to compile.

`outcome` says how an analysis of one ended, and what is wrong with that.
"""

import dataclasses
import re

import jax
import numpy as np
from oracles.independent import verdict

import jaxcable as jc
from jaxcable.common import status

NAMED = r"^(nodes|links|elements\S*|axial_stiffness|area|rest_length|pretension|prestrain|strain)\b"
"""How a ValueError of a random scene may begin: rounded in float32, nodes and points can meet."""

GRID = [[3 * i + j, 3 * i + j + 1] for i in range(3) for j in range(2)]
GRID += [[3 * i + j, 3 * i + j + 3] for i in range(2) for j in range(3)]
CORNERS, FREE = [0, 2, 6, 8], [1, 3, 4, 5, 7]

RANGES = {
    "stiffness": (-2, 12),  # log10 EA, N
    "spread": (0, 4),  # decades by which the elements differ
    "strain": (-9, -1),  # log10 of the prestrain
    "load": (-4, 2),  # log10 of load over prestress
    "size": (-3, 4),  # log10 length, m
    "offset": (-1, 6),  # log10 distance from the origin, in lengths
    "slack": (0, 1),  # part of the elements that begins slack
    "rough": (-4, 0),  # log10 of how far nodes are off the plane grid, in lengths
}


@dataclasses.dataclass(frozen=True)
class Recipe:
    """What a scene is made from; `draw` picks the numbers of `RANGES`, each a float."""

    family: str
    dtype: str
    seed: int
    stiffness: float
    spread: float
    strain: float
    load: float
    size: float
    offset: float
    slack: float
    rough: float


def random_recipe(rng, families, dtypes):
    """A recipe by NumPy."""
    numbers = {name: rng.uniform(*ends) for name, ends in RANGES.items()}
    family, dtype = rng.choice(families), rng.choice(dtypes)
    return Recipe(str(family), str(dtype), int(rng.integers(2**31)), **numbers)


def build(recipe):
    """Structure and phases of a recipe."""
    return FAMILIES[recipe.family](recipe, np.random.default_rng(recipe.seed))


def outcome(recipe):
    """How it ended, in a word, and what is wrong with it, None if nothing."""
    try:
        structure, phases = build(recipe)
        solution = jc.solve(structure, phases)
    except ValueError as error:
        named = re.match(NAMED, str(error))
        return "ValueError", None if named else f"names no argument: {error}"
    code = int(solution.status)
    name = status.NAMES[code]
    if code != status.OK:
        return name, _failed_badly(solution)
    judged = verdict(structure, phases, solution)
    if not judged.passed:
        return name, f"silent: {judged.excess:.3g} times what is promised; {judged.wrong}"
    return name, None


def _failed_badly(solution):
    """What is wrong with a solution that has failed, or None."""
    numbers = np.concatenate([np.ravel(t) for t in jax.tree.leaves(solution.tension)])
    if not (np.isnan(numbers).all() and np.isnan(np.asarray(solution.displacement)).all()):
        return "numbers in a failed solution"
    if not np.isfinite(np.asarray(solution.last.displacement)).all():
        return "no last state"
    return None


# --- pieces


def _grid(recipe, rng):
    """Nodes of a 3 by 3 grid, off the plane, turned and moved away, [9, 3]."""
    nodes = np.array([[i, j, 0.0] for i in range(3) for j in range(3)])
    nodes += 10**recipe.rough * rng.uniform(-0.3, 0.3, nodes.shape)
    nodes = nodes @ np.linalg.qr(rng.normal(size=(3, 3)))[0]
    nodes += 10**recipe.offset * rng.normal(size=3)
    return (10**recipe.size * nodes).astype(recipe.dtype)


def _stiffness(recipe, rng, n):
    return 10 ** (recipe.stiffness + recipe.spread * rng.uniform(-0.5, 0.5, n))


def _strain(recipe, rng, n, both=False):
    """Prestrains; a part of them slack (or in compression)."""
    strain = 10**recipe.strain * rng.uniform(0.5, 1, n)
    return np.where(rng.random(n) < recipe.slack, -strain if not both else strain * -0.5, strain)


def _forces(recipe, rng, n):
    forces = rng.normal(size=(n, 3)) * (rng.random((n, 1)) < 0.7)
    return 10 ** (recipe.load + recipe.stiffness + recipe.strain) * forces


def _laws(recipe, kind):
    """Points of a curve whose first corner is some times the prestrain."""
    e = 10.0 ** np.clip(recipe.strain + 0.5, -9, -1) * np.array([1.0, 2.0, 4.0, 9.0])
    s = {"softening": [1.0, 1.4, 1.5, 0.4], "hardening": [1.0, 1.4, 1.6, 2.0]}[kind]
    E = 10.0**9
    strain, stress = np.r_[0, e], np.r_[0, E * e[0] * np.array(s)]
    return strain, stress


# --- families: each has one shape for ever


def net(recipe, rng):
    """Cables with a prestrain each, then loads."""
    cables = jc.Cables(GRID, axial_stiffness=_stiffness(recipe, rng, 12))
    structure = jc.Structure(_grid(recipe, rng), cables, jc.pinned(CORNERS))
    loading = jc.Phase(loads=jc.NodalLoads(FREE, _forces(recipe, rng, 5)), increments=2)
    return structure, [jc.Phase(prestrain=_strain(recipe, rng, 12)), loading]


def cut_net(recipe, rng):
    """Cables of stated unstressed lengths, loaded and loaded back; some much too long."""
    nodes = _grid(recipe, rng)
    length = np.linalg.norm(np.diff(nodes[np.array(GRID)], axis=1)[:, 0].astype(float), axis=1)
    change = np.where(rng.random(12) < recipe.slack, rng.uniform(1, 2, 12), 1 - 10**recipe.strain)
    cables = jc.Cables(
        GRID, axial_stiffness=_stiffness(recipe, rng, 12), rest_length=length * change
    )
    forces = _forces(recipe, rng, 5)
    phases = [jc.Phase(loads=jc.NodalLoads(FREE, f)) for f in (forces, -2 * forces, forces)]
    return jc.Structure(nodes, cables, jc.pinned(CORNERS)), phases


def mixed(recipe, rng):
    """Cables and bars with pretensions, loads with a movement of a support, turnbuckles."""
    bars, cables = GRID[:3] + GRID[9:], [*GRID[3:9], [0, 4], [4, 8]]
    ea = {"bars": _stiffness(recipe, rng, 6), "cables": _stiffness(recipe, rng, 8)}
    nodes = _grid(recipe, rng)
    groups = {
        "bars": jc.Bars(bars, axial_stiffness=ea["bars"]),
        "cables": jc.Cables(cables, axial_stiffness=ea["cables"]),
    }
    pretension = {
        "bars": ea["bars"] * _strain(recipe, rng, 6, both=True),
        "cables": ea["cables"] * np.abs(_strain(recipe, rng, 8)),
    }
    length = 10**recipe.size
    step = 10**recipe.strain * length * rng.normal(size=3)
    turns = 10**recipe.strain * length * rng.uniform(-0.2, 0.2, 8)
    phases = [
        jc.Phase(pretension=pretension),
        jc.Phase(
            loads=[
                jc.NodalLoads(FREE, _forces(recipe, rng, 5)),
                jc.SupportMovement([2], step.astype(recipe.dtype)),
            ]
        ),
        jc.Phase(shortening={"bars": None, "cables": turns}),
    ]
    return jc.Structure(nodes, groups, jc.pinned(CORNERS)), phases


def _with_law(kind):
    def curved(recipe, rng):
        strain, stress = _laws(recipe, kind)
        area = 10 ** (recipe.stiffness - 9 + 0.2 * recipe.spread * rng.uniform(-0.5, 0.5, 12))
        cables = jc.Cables(GRID, area=area, law=jc.Polygonal(strain, stress))
        structure = jc.Structure(_grid(recipe, rng), cables, jc.pinned(CORNERS))
        forces = _forces(recipe, rng, 5)
        loading = jc.Phase(loads=jc.NodalLoads(FREE, forces), increments=3)
        return structure, [jc.Phase(prestrain=np.abs(_strain(recipe, rng, 12))), loading]

    return curved


def memory(recipe, rng):
    """Elastic-plastic bars, loaded, unloaded and loaded back."""
    strain, stress = _laws(recipe, "hardening")
    law = jc.Polygonal(np.r_[-strain[:0:-1], strain], np.r_[-stress[:0:-1], stress], "elastic")
    diagonals = [[0, 4], [2, 4], [6, 4], [8, 4], [0, 5], [2, 3]]
    area = np.full(18, 10 ** (recipe.stiffness - 9))
    bars = jc.Bars(GRID + diagonals, area=area, law=law)
    structure = jc.Structure(_grid(recipe, rng), bars, jc.pinned(CORNERS))
    forces = _forces(recipe, rng, 5)
    phases = [
        jc.Phase(loads=jc.NodalLoads(FREE, f), increments=3) for f in (forces, -2 * forces, forces)
    ]
    return structure, phases


def hanging(recipe, rng):
    """Catenaries under their weight, then loads."""
    nodes = _grid(recipe, rng)
    length = np.linalg.norm(np.diff(nodes[np.array(GRID)], axis=1)[:, 0].astype(float), axis=1)
    change = np.where(rng.random(12) < recipe.slack, rng.uniform(1, 1.5, 12), 1 - 10**recipe.strain)
    stiffness = 10 ** (recipe.stiffness + 0.5 * recipe.spread * rng.uniform(-0.5, 0.5, 12))
    weight = 10 ** (recipe.stiffness + recipe.strain - 2 + 0.5 * recipe.load - recipe.size)
    cables = jc.Catenaries(
        GRID,
        axial_stiffness=stiffness,
        rest_length=length * change,
        weight=weight * rng.uniform(0.5, 2, 12),
    )
    loads = jc.NodalLoads(FREE, _forces(recipe, rng, 5))
    phases = [jc.Phase(loads=jc.SelfWeight()), jc.Phase(loads=loads)]
    return jc.Structure(nodes, cables, jc.pinned(CORNERS)), phases


def pushed(recipe, rng):
    """A tripod of bars whose top is pushed down through the plane of its feet, and back."""
    angle = 2 * np.pi * np.arange(3) / 3
    nodes = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    rise = 10 ** (0.5 * recipe.rough - 0.3)
    nodes = np.concatenate([nodes, [[0.0, 0, rise], [0.0, 0, 3 * rise]]])
    nodes += 0.1 * 10**recipe.rough * rng.normal(size=nodes.shape)
    nodes = (10**recipe.size * nodes).astype(recipe.dtype)
    bars = jc.Bars([[0, 3], [1, 3], [2, 3], [3, 4]], axial_stiffness=_stiffness(recipe, rng, 4))
    step = np.array([0, 0, -2 * rise * 10**recipe.size]).astype(recipe.dtype)
    phases = [jc.Phase(loads=jc.SupportMovement([4], d), increments=6) for d in (step, -step)]
    return jc.Structure(nodes, bars, jc.pinned([0, 1, 2, 4])), phases


def ropes(recipe, rng):
    """Frictionless ropes over nodes that cables hold."""
    ropes = jc.SlidingCables(
        [[0, 1, 4, 7, 8], [2, 5, 3, 6]], axial_stiffness=_stiffness(recipe, rng, 2)
    )
    cables = jc.Cables(GRID, axial_stiffness=_stiffness(recipe, rng, 12))
    structure = jc.Structure(
        _grid(recipe, rng), {"cables": cables, "ropes": ropes}, jc.pinned(CORNERS)
    )
    prestrain = {"cables": _strain(recipe, rng, 12), "ropes": np.abs(_strain(recipe, rng, 2))}
    loading = jc.Phase(loads=jc.NodalLoads(FREE, _forces(recipe, rng, 5)))
    return structure, [jc.Phase(prestrain=prestrain), loading]


def released(recipe, rng):
    """A net whose middle is let go and one corner too, after it was loaded."""
    cables = jc.Cables(GRID, axial_stiffness=_stiffness(recipe, rng, 12))
    structure = jc.Structure(_grid(recipe, rng), cables, jc.pinned([*CORNERS, 4]))
    loads = jc.NodalLoads(range(9), _forces(recipe, rng, 9))
    first = jc.Phase(force_density=10**recipe.stiffness * np.abs(_strain(recipe, rng, 12)))
    second = jc.Phase(loads=loads, supports=jc.pinned([0, 2, 6]))
    return structure, [first, second, jc.Phase(loads=loads, supports=jc.pinned(CORNERS))]


FAMILIES = {
    "net": net,
    "cut net": cut_net,
    "mixed": mixed,
    "softening": _with_law("softening"),
    "hardening": _with_law("hardening"),
    "memory": memory,
    "hanging": hanging,
    "pushed": pushed,
    "ropes": ropes,
    "released": released,
}
