"""Equilibrium of nets of cables, ropes, jacks and catenaries in extended precision (NumPy).

The potential energy is convex: its least value is a second-order cone program. With a segment's
length bounded by t, |d| <= t, and the bounds of an element adding up to L0 (1 + N / EA), the force
of the element is the multiplier N, and the pull q of a segment is a vector with |q| <= N:

    sum over the segments at a node of q = load,   sum of t = L0 + (L0 / EA) N,   N t = q . d

A primal-dual interior-point method with the scaling of Nesterov and Todd follows N t - q . d to
zero from any start; stiffness enters only as the flexibility L0 / EA. Newton's method with the
forces as unknowns beside the displacements then takes the last digits. A catenary is a chain of
cables in the first method, loaded at the knots so that Gauss's rule integrates it, and exact in
the second.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from oracles.convex_cones import EPS, WIDE, Interior, dot, factor, solve
from oracles.convex_net import Net

DOUBLE = np.finfo(float).eps
CLOSE = WIDE("1e-12")  # of the largest sum of forces at a node: residual of what is found
PIECES = 4  # cables in the chain for a catenary
LOOSE = WIDE("1e-3")  # of the largest sum: the least that is asked of a node
ROUNDS = 8  # corrections of the chains
DIGITS = 16  # roundings of an element's elongation that a residual may show


@dataclass
class Element:
    """An element of a net.

    Attributes:
        kind: "cable", "rope", "jack" or "catenary".
        links: nodes that it joins, two, or two and more for a rope.
        stiffness: axial stiffness EA, N; None for a jack.
        rest_length: unstressed length L0, m; None for a jack.
        force: constant tension of a jack, N.
        load: dead load of a catenary per unstressed length, [3], N/m.
    """

    kind: str
    links: tuple
    stiffness: float = None
    rest_length: np.longdouble = None
    force: float = None
    load: tuple = None


@dataclass
class Scene:
    """A net: nodes [n, 3] in m, free [n, 3], loads [n, 3] in N, prescribed movements [n, 3] in m.

    `prescribed` counts where a freedom is not free; None for supports that stay.
    """

    nodes: np.ndarray
    free: np.ndarray
    load: np.ndarray
    elements: list
    prescribed: np.ndarray = None


@dataclass
class Found:
    """An equilibrium, or the last state before the search ended.

    Attributes:
        displacement: of the nodes, [n, 3], m.
        tension: of the elements, N; of a catenary the mean of both ends.
        residual: load less pull of the elements at `displacement`, 0 where held, [n, 3], N.
        scale: largest sum over a node of the sizes of end forces and load, N.
        floor: force that rounding of displacements in double precision leaves at a node, [n], N.
        found: whether it is an equilibrium.
        why: in words.
        steps: factorisations of the interior-point method and of Newton's method.
    """

    displacement: np.ndarray
    tension: list
    residual: np.ndarray
    scale: np.longdouble
    floor: np.ndarray
    found: bool
    why: str
    steps: tuple = (0, 0)


def _at(net, moved, lower=None, tension=None, near=None):
    """Residual, sums of the sizes of forces and floor at each node, tensions N and F of a state.

    `near` are forces F of the catenaries nearby.
    """
    d, l, long = net.elongations(moved, lower)
    N = np.where(net.jack, net.force, np.maximum(long, 0) / np.where(net.jack, 1, net.flex))
    N = N if tension is None else np.asarray(tension, WIDE)[net.place]
    hung = net.hung
    F = hung.pull(*net.chords(moved, lower), near) if len(hung.i) else np.zeros((0, 3), WIDE)
    _, first, second = hung.tension(F)
    own = N[net.of]
    pull = own[:, None] * d / np.where(l > 0, l, 1)[:, None]
    residual, sums = net.dead.copy(), np.sqrt(dot(net.load, net.load))
    floor = np.zeros_like(sums)
    stiff = (net.EA / np.where(net.jack, 1, net.rest))[net.of]
    stiff, ends = np.r_[stiff, hung.EA / hung.rest], (np.r_[own, first], np.r_[own, second])
    i, j = np.r_[net.i, hung.i], np.r_[net.j, hung.j]
    pull = np.concatenate([pull, F])
    shift = moved[j] - moved[i]
    unsure = stiff * np.sqrt(dot(shift, shift)) * DOUBLE
    for nodes, sign, force in ((i, 1, ends[0]), (j, -1, ends[1])):
        np.add.at(residual, nodes, sign * pull)
        np.add.at(sums, nodes, force)
        np.add.at(floor, nodes, unsure)
    return np.where(net.free, residual, 0), sums, floor, N, F


def _excess(state, scale=None):
    """Largest residual as a multiple of what is allowed; scale per node or for all nodes, N."""
    residual, sums, floor, *_ = state
    scale = np.maximum(sums, LOOSE * sums.max()) if scale is None else scale
    room = np.maximum(CLOSE * scale, floor * (EPS / DOUBLE * DIGITS))
    size = np.sqrt(dot(residual, residual))
    return (size / np.where(size > 0, room, 1)).max()


def _inverse(A):
    """Inverses of symmetric matrices [n, 3, 3]."""
    a, b, c = (A[:, k] for k in range(3))
    rows = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], 1)
    return rows / dot(a, rows[:, 0])[:, None, None]


def _polish(net, moved, N, F, taut, most=40):
    """Newton's method with the displacements, N and F unknown, from cables that are taut.

    Returns displacements, N, F, the excess of the residual and the factorisations.
    """
    moved, hung = moved.copy(), net.hung
    ends = hung.i, hung.j
    flex = np.where(net.jack, 1, net.flex)
    best, since = (moved, N, F, np.inf), 0
    for steps in range(most):
        state = _at(net, moved, near=F)
        excess = _excess(state)
        settled = excess <= 0.1 and excess >= 0.1 * best[3]  # rounding is left
        since = 0 if excess < best[3] else since + 1
        if excess <= best[3]:
            best = moved.copy(), N, F, excess
        if steps and (settled or excess < 1e-5 or since > 4 or not excess < np.inf):
            break
        d, l, long = net.elongations(moved)
        t = d / np.where(l > 0, l, 1)[:, None]
        gap = np.where(net.jack, 0, long - net.flex * N)
        taut = (long > 0 if steps else taut) & ~net.jack
        N = np.where(taut | net.jack, N, 0)
        gap = np.where(taut, gap, 0) / flex
        k = np.where(taut, 1 / flex, 0)
        own = N[net.of]
        axial = t[:, :, None] * t[:, None, :]
        blocks = (np.maximum(own, 0) / np.where(l > 0, l, 1))[:, None, None] * (np.eye(3) - axial)
        blocks = blocks + np.where(net.single, k, 0)[net.of][:, None, None] * axial
        rows = net.rows(t)
        # of a catenary that is not taut the force follows its chord, else it is an unknown
        F = np.where((hung.tension(F)[0] < hung.w * hung.rest)[:, None], state[4], F)
        stiff = _inverse(hung.slopes(F))
        open_ = hung.miss(F, *net.chords(moved))
        more = (stiff @ open_[:, :, None])[:, :, 0]
        matrix = net.matrix(np.concatenate([blocks, stiff]), rows, k)
        matrix[np.diag_indices(net.count)] *= 1 + WIDE("1e-16")
        r = net.p - net.spread(own[:, None] * t) - net.spread(F, ends)
        dx = solve(factor(matrix), r - gap @ rows - net.spread(more, ends))
        N = N + np.where(taut, k * (rows @ dx) + gap, 0)
        F = F + more + (stiff @ net.across(dx, ends)[:, :, None])[:, :, 0]
        moved[net.free] += dx
    return *best, steps


def _chained(scene, start):
    """The scene with a chain of cables for each catenary, and its start.

    The cables' lengths and the loads of the knots between them are those of Gauss's rule.
    """
    elements = [e for e in scene.elements if e.kind != "catenary"]
    nodes, start = list(np.asarray(scene.nodes, WIDE)), list(np.asarray(start, WIDE))
    load = list(np.asarray(scene.load, WIDE))
    at, share = np.polynomial.legendre.leggauss(PIECES)
    at, share = at.astype(WIDE) / 2, share.astype(WIDE) / 2
    share /= share.sum()
    for e in scene.elements:
        if e.kind == "catenary":
            (i, j), L, q = e.links, WIDE(e.rest_length), np.asarray(e.load, WIDE)
            line = [i, *range(len(nodes), len(nodes) + PIECES - 1), j]
            load[i] = load[i] + q * L * (at[0] + WIDE(0.5))
            load[j] = load[j] + q * L * (WIDE(0.5) - at[-1])
            for k in range(PIECES - 1):
                way = share[: k + 1].sum()
                nodes.append(nodes[i] + way * (nodes[j] - nodes[i]))
                start.append(start[i] + way * (start[j] - start[i]))
                load.append(q * L * (at[k + 1] - at[k]))
            pieces = zip(pairwise(line), share, strict=True)
            elements += [Element("cable", pair, e.stiffness, L * part) for pair, part in pieces]
    more = len(nodes) - len(scene.nodes)
    free = np.concatenate([np.asarray(scene.free, bool), np.ones((more, 3), bool)])
    prescribed = scene.prescribed
    if prescribed is not None:
        prescribed = np.concatenate([prescribed, np.zeros((more, 3))])
    return Scene(np.array(nodes), free, np.array(load), elements, prescribed), np.array(start)


def _forces(net, walk):
    """Forces F of the catenaries, N, by those of the chains; what the chains' chords lack, m."""
    hung, first = net.hung, len(net.of)
    at = np.polynomial.legendre.leggauss(PIECES)[0].astype(WIDE) / 2
    q = walk.q[first:].reshape(-1, PIECES, 3)
    F = q + hung.q[:, None] * (at * hung.rest[:, None])[:, :, None]
    F = F[np.arange(len(F)), np.argmax(dot(q, q), 1)]
    d = walk.net.elongations(walk.moved)[0][first:].reshape(-1, PIECES, 3).sum(1)
    h, v, e = hung.parts(F)
    x, z, *_ = hung.chord(h, v)
    return F, x[:, None] * e + z[:, None] * hung.u - d


def _unbounded(net, elements):
    """Whether loads move nodes away without end, by pulls that jacks and cables cannot hold.

    Such movements lengthen no cable: the nodes that cables join move as one. With them as the nodes
    of a net of the jacks, each within reach of a soft cable's unstressed length, the soft cables
    are stressed if and only if there is no end.
    """
    group = np.arange(len(net.free))
    for e in elements:
        for a, b in pairwise(e.links):
            if e.kind != "jack":
                group[group == group[a]] = group[b]
    names, group = np.unique(group, return_inverse=True)
    n = len(names)
    free, total = np.ones((n + 1, 3), bool), np.zeros((n + 1, 3), WIDE)
    np.logical_and.at(free, group, net.free)
    free[n] = False
    np.add.at(total, group, net.dead)
    total[~free] = 0
    jacks = [replace(e, links=tuple(group[list(e.links)])) for e in elements if e.kind == "jack"]
    jacks = [e for e in jacks if e.links[0] != e.links[1]]
    size = max([np.abs(net.p).max(initial=0), *(e.force for e in jacks)])
    if np.abs(total).max() <= CLOSE * size:
        return False
    soft = [Element("cable", (k, n), size, WIDE(1)) for k in range(n)]
    walk = Interior(
        Net(Scene(np.zeros((n + 1, 3)), free, total, jacks + soft)), np.zeros((n + 1, 3))
    )
    *_, _ = walk.walk()
    return bool(walk.N[len(jacks) :].max() > 1e-9 * size)


def _search(net, scene, start):
    """Least energy from displacements `start`, m: state as of `_polish`, elements met, steps.

    What the chords of the chains lack of those of the catenaries is added to them, in rounds.
    """
    chained, far = _chained(scene, start)
    chains, count = Net(chained), len(net.jack)
    best, steps, newton = (start, None, None, np.inf), 0, 0
    for _ in range(ROUNDS if len(net.hung.i) else 1):
        walk, tried = Interior(chains, far), False
        for taut, more, last in walk.walk():
            if tried and len(net.hung.i) and not last:
                continue
            tried = True
            F, lack = _forces(net, walk)
            *state, some = _polish(net, walk.moved[: len(start)], walk.N[:count], F, taut[:count])
            newton += some
            best = min(best, state, key=lambda b: b[3])
            if best[3] <= 1:
                return best, (), (steps + more, newton)
        steps += more
        if len(walk.met):
            break
        far, chains.shift[len(net.of) :: PIECES] = walk.moved, -lack
    return best, walk.met, (steps, newton)


def find(scene, start=None):
    """Equilibrium of a scene, searched from displacements `start` [n, 3], m."""
    net = Net(scene)
    start = net.still if start is None else np.where(net.free, start, net.still)
    if _unbounded(net, scene.elements):
        (moved, N, F, _), steps = (start, None, None, np.inf), (0, 0)
        why = "no equilibrium: loads move nodes away without end"
    else:
        (moved, N, F, _), met, steps = _search(net, scene, start)
        why = "the search did not converge"
        if len(met):
            why = f"no equilibrium: element {net.place[met[0]]} draws two nodes together"
    residual, sums, floor, *own = _at(net, moved, near=F)
    N, F = own if N is None else (N, F)
    found, scale = bool(_excess((residual, sums, floor), sums.max()) <= 1), sums.max()
    if scale <= 64 * EPS * max(net.EA.max(initial=0), net.hung.EA.max(initial=0)):
        found, why = True, "all forces are lost"
    elif found:
        why = "equilibrium"
    tension = np.zeros(len(scene.elements), WIDE)
    tension[net.place], tension[net.hung_place] = N, net.hung.tension(F)[0]
    return Found(moved, list(tension), residual, scale, floor, found, why, steps)


def check(scene, displacement_hi, displacement_lo=None, tension=None):
    """Residual [n, 3] and largest sum of forces at a node, N, of a state's displacements, m.

    The displacement, of held nodes too, is the sum of two arrays. With `tension`, N, of each
    element, the residual of these at the state's directions; those of catenaries are not used.
    """
    high = np.asarray(displacement_hi, WIDE)
    low = None if displacement_lo is None else np.asarray(displacement_lo, WIDE)
    residual, sums, *_ = _at(Net(scene), high, low, tension)
    return residual, sums.max()
