"""A bank of random ropes with Coulomb friction over pulleys and saddles that are fixed or can move.

EA/N is over four decades, all else as in `bar_bank`: the pretension that sets the scale is 1 N,
lengths are about 1 m, every kind has one shape. Loads grow, reverse, and grow again; deviators are
clamped at random. `judged` compares with NumPy, written apart from the elements: tensions by a
solver of the complementarity conditions at the positions reported, and forces at all nodes.
"""

import dataclasses

import numpy as np
from banks.bar_bank import Drawn, Judged, Numbers
from oracles.coulomb import angles, axle_bounds, relaxed

import jaxcable as jc

EXACT = 1e-8  # of the largest tension; the package has 1e-10 of the forces at a node


def _over(numbers, count):
    """Nodes of a rope of `count` segments that goes up and down, [count + 1, 3], m."""
    rng = numbers.rng
    nodes = rng.uniform(-0.1, 0.1, (count + 1, 3))
    nodes[:, 0] += np.cumsum(rng.uniform(0.6, 1.4, count + 1))
    nodes[:, 2] += (np.arange(count + 1) % 2) * rng.uniform(0.2, 1.5, count + 1)
    return nodes


def _springs(numbers, nodes):
    """Springs at `nodes` with stiffnesses over two decades, another one in each direction."""
    return jc.Springs(nodes, 10 ** numbers.rng.uniform(0.8, 2.3, (len(nodes), 3)))


def _scene(numbers, nodes, links, free, others):
    """A structure of ropes and other groups; and its phases."""
    rng, n = numbers.rng, len(links)
    width = max(map(len, links)) - 2
    mu = 10 ** rng.uniform(-3, 0, (n, width)) * (rng.uniform(size=(n, width)) > 0.1)
    on_axle = rng.uniform(size=(n, width)) < 0.3
    ropes = jc.FrictionCables(
        links=links,
        axial_stiffness=numbers.stiffness(n),
        friction=np.where(on_axle, 0.0, mu),
        axle_friction=np.where(on_axle, rng.uniform(0.0, 0.3, (n, width)), 0.0),
        wobble=rng.uniform(0, 0.02, n),
    )
    held = jc.pinned(np.setdiff1d(np.arange(len(nodes)), free))
    structure = jc.Structure(nodes, {"ropes": ropes, **others}, held)
    force = rng.normal(size=(len(free), 3)) * 10 ** rng.uniform(-1.3, -0.3)
    phases = [jc.Phase(pretension={"ropes": 1.0} | dict.fromkeys(set(others) & {"stays"}, 0.5))]
    for factor in (1.0, -1.7, 1.0):
        clamped = (rng.uniform(size=(n, width)) < 0.2).astype(float)
        load = jc.NodalLoads(free, factor * force)
        phases.append(jc.Phase(loads=load, clamped={"ropes": clamped}, increments=2))
    return structure, phases


def saddle(numbers):
    """A rope over one saddle on springs."""
    return _scene(numbers, _over(numbers, 2), [range(3)], [1], {"springs": _springs(numbers, [1])})


def pulleys(numbers):
    """A rope over two fixed pulleys with a third one between them, which hangs in springs."""
    others = {"springs": _springs(numbers, [2])}
    return _scene(numbers, _over(numbers, 4), [range(5)], [2], others)


def stayed(numbers):
    """A rope over three nodes; stays hold two of them, springs the third one."""
    nodes = _over(numbers, 4)
    far = [nodes[k] + 1.5 * numbers.direction() for k in (1, 1, 1, 2, 2, 2)]
    links = [[k, 5 + j] for j, k in enumerate((1, 1, 1, 2, 2, 2))]
    others = {
        "stays": jc.Cables(links, axial_stiffness=numbers.stiffness(6)),
        "springs": _springs(numbers, [1, 2, 3]),
    }
    return _scene(numbers, np.vstack([nodes, far]), [range(5)], [1, 2, 3], others)


def masts(numbers):
    """A rope over the tops of two masts, which are bars, and over a fixed pulley between them."""
    nodes = _over(numbers, 4)
    feet = nodes[[1, 3]] - np.array([0.0, 0.0, 2.0])
    bars = jc.Bars([[5, 1], [6, 3]], axial_stiffness=numbers.stiffness(2))
    others = {"masts": bars, "springs": _springs(numbers, [1, 3])}
    return _scene(numbers, np.vstack([nodes, feet]), [range(5)], [1, 3], others)


def long(numbers):
    """A rope of six segments, whose nodes are fixed and on springs by turns."""
    others = {"springs": _springs(numbers, [1, 3, 5])}
    return _scene(numbers, _over(numbers, 6), [range(7)], [1, 3, 5], others)


def pair(numbers):
    """Ropes of five and of two segments that share a node on springs."""
    nodes = np.vstack([_over(numbers, 5), [[2.0, 1.0, -0.5], [2.5, -1.2, -0.3]]])
    others = {"springs": _springs(numbers, [1, 2, 4])}
    return _scene(numbers, nodes, [range(6), [6, 2, 7]], [1, 2, 4], others)


KINDS = {kind.__name__: kind for kind in (saddle, pulleys, stayed, masts, long, pair)}


def drawn(kind, seed):
    """A scene: `Drawn` of a kind."""
    numbers = Numbers(seed, kind, (2, 6))
    return Drawn(*KINDS[kind](numbers), numbers.ratio)


def judged(one, solution):
    """`bar_bank.Judged` of a solution."""
    code = int(solution.status)
    paths = [phase.path for phase in solution.phases]
    steps = np.concatenate([np.asarray(path.iterations) for path in paths])
    wrong = code == jc.status.OK and largest_error(one, solution) > EXACT
    return Judged(code, wrong, steps, sum(int(np.sum(path.factorizations)) for path in paths))


def largest_error(one, solution):
    """Largest error of tensions and of the balance of nodes, over the largest force of a phase.

    Errors are those beyond the rounding of positions. Tensions are those at the end of each phase.
    """
    load, worst = np.zeros(one.structure.nodes.shape), 0.0
    for k, phase in enumerate(solution.phases):
        if one.phases[k].loads is not None:
            np.add.at(load, one.phases[k].loads.nodes.array, np.asarray(one.phases[k].loads.forces))
        places = np.asarray(phase.positions)
        tensions = np.asarray(phase.element_results["segment_tension"]["ropes"])
        scale = max(tensions.max(), np.abs(load).max(), 1.0)
        rounding = 64 * np.finfo(float).eps * np.abs(places).max() * 10**0.5 * one.ratio
        off = _errors_of_tensions(one, solution, k, places, tensions)
        left = load + np.asarray(phase.reactions) + _forces(one, phase, places, tensions)
        off = max(off, np.abs(left).max())
        worst = max(worst, (off - rounding) / scale)
    return worst


def _errors_of_tensions(one, solution, k, places, tensions):
    """Largest difference of the tensions from those of `relaxed`, N."""
    ropes, phase, worst = one.structure.elements["ropes"], solution.phases[k], 0.0
    before = _slips_before(solution, k)
    clamped = 0.0 if k == 0 else np.asarray(one.phases[k].clamped["ropes"])
    start = np.asarray(one.structure.nodes)
    for r, chain in enumerate(ropes.links.array):
        n = len(np.unique(chain)) - 1
        chain, own = chain[: n + 1], tensions[r, :n]
        length = np.linalg.norm(np.diff(start[chain], axis=0), axis=1)
        rest = length / length.sum() * float(phase.rest_length["ropes"][r])
        rest = rest - np.diff(before[r, : n - 1], prepend=0, append=0)
        now, turn = np.linalg.norm(np.diff(places[chain], axis=0), axis=1), angles(places[chain])
        bound = np.asarray(ropes.friction)[r, : n - 1] * turn
        bound = bound + axle_bounds(turn, np.asarray(ropes.axle_friction)[r, : n - 1])
        bound = bound + np.asarray(ropes.wobble)[r] * 0.5 * (now[1:] + now[:-1])
        closed = np.broadcast_to(clamped, before.shape)[r, : n - 1] > 0
        found = relaxed(now, rest, np.where(closed, np.inf, bound), float(ropes.axial_stiffness[r]))
        worst = max(worst, np.abs(found - own).max())
    return worst


def _slips_before(solution, k):
    """Slips at the start of the last increment of phase k, [n_rope, n_deviator], m."""
    slips = np.asarray(solution.phases[k].path.element_results["slip"]["ropes"])
    if len(slips) > 1:
        return slips[-2]
    if k == 0:
        return np.zeros_like(slips[0])
    return np.asarray(solution.phases[k - 1].element_results["slip"]["ropes"])


def _forces(one, phase, places, tensions):
    """Forces of all elements on their nodes, [n_node, 3], N."""
    structure, forces = one.structure, np.zeros(places.shape)
    for name, group in structure.elements.items():
        links = group.links.array
        if name == "springs":
            node = links[:, -1]
            moved = (places - np.asarray(structure.nodes))[node]
            np.add.at(forces, node, -np.asarray(group.stiffness) * moved)
            continue
        way = np.diff(places[links], axis=1)
        length = np.linalg.norm(way, axis=2)
        if name == "ropes":
            tension = tensions
        else:
            rest = np.asarray(phase.rest_length[name])
            tension = np.asarray(group.axial_stiffness) * (length[:, 0] - rest) / rest
            tension = (np.maximum(tension, 0.0) if name == "stays" else tension)[:, None]
        pull = (tension / np.where(length > 0, length, 1.0))[:, :, None] * way
        np.add.at(forces, links[:, :-1], pull)
        np.add.at(forces, links[:, 1:], -pull)
    return forces


def with_other_ropes(one, **factors):
    """The scene with numbers of its ropes changed by factors: a judgement has to refuse it."""
    ropes = one.structure.elements["ropes"]
    changed = {name: factor * np.asarray(getattr(ropes, name)) for name, factor in factors.items()}
    elements = one.structure.elements | {"ropes": jc.replace(ropes, **changed)}
    return dataclasses.replace(one, structure=jc.replace(one.structure, elements=elements))
