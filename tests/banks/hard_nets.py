"""Hard cases of nets and links: builders of problems with a figure to judge them by.

`Problem` is a case that is built; every builder is a function of (full size or not, dtype).
"""

import dataclasses

import mpmath as mp
import numpy as np
from banks.problems import two_links_exact
from oracles.independent import verdict

import jaxcable as jc

EPS = {"float64": 2.0**-52, "float32": 2.0**-23}
TOL = {"float64": 1e-10, "float32": 1e-5}  # defaults of `Newton`


@dataclasses.dataclass
class Problem:
    """One case, built.

    Attributes:
        structure, phases: as given to `solve`.
        figure: function of the solution: (error, limit) in any unit; None if the verdict is enough.
        cycles: how often the phases are repeated, each time from where the last ended.
        judged: whether `verdict` can judge it.
        answer: function without arguments instead of `solve` through the phases.
    """

    structure: object
    phases: list
    figure: object = None
    cycles: int = 1
    judged: bool = True
    answer: object = None

    def solve(self):
        if self.answer is not None:
            return self.answer()
        solution = jc.solve(self.structure, self.phases)
        for _ in range(self.cycles - 1):
            solution = jc.solve(self.structure, self.phases, start=solution)
        return solution

    def verdict(self, solution):
        """Independent judgement of a solution of status OK, or None."""
        if not self.judged or self.cycles > 1:
            return None
        return verdict(self.structure, self.phases, solution)


# --- two links: mid node between two anchors, prestressed, pulled sideways (Kwan 1998)


def two_links(strain, pull, angle=0.3, offset=0.0):
    """Load `pull` in parts of EA; the closed form in 50 digits."""

    def build(full, dtype):
        ea = 2e7
        along = np.array([np.cos(angle), 0, np.sin(angle)])
        normal = np.array([np.sin(angle), 0, -np.cos(angle)])
        nodes = (np.stack([-along, 0 * along, along]) + offset).astype(dtype)
        links = [[0, 1], [1, 2]]
        structure = jc.Structure(nodes, jc.Cables(links, axial_stiffness=ea), jc.pinned([0, 2]))
        loads = jc.NodalLoads([1], pull * ea * normal)
        phases = [jc.Phase(prestrain=strain), jc.Phase(loads=loads)]

        def figure(solution):
            w, force = two_links_exact(ea, strain * ea, pull * ea)
            found = np.asarray(solution.displacement[1], float) @ normal
            tension = np.asarray(solution.tension, float)
            # coordinates have rounded the lengths, which are the half span of the closed form
            spans = np.linalg.norm(np.diff(np.asarray(nodes, float), axis=0), axis=1)
            rounded = 2 * np.abs(spans - 1).max() + 64 * EPS[dtype]
            # what the tolerance of the load leaves of w, by dP/dw; and what that does to N
            length = np.hypot(1, w)
            rate = 2 * (force / length**3 + ea * (w / length) ** 2 / length)
            room = TOL[dtype] * (2 * force + pull * ea) / rate + rounded * w
            slack = ea * (w / length) * room + rounded * force
            return max(abs(found - w) / room, np.abs(tension - force).max() / slack), 1.0

        return Problem(structure, phases, figure)

    return build


def unequal_links(full, dtype):
    """Lengths of 1 m and 1e5 m in line, prestressed, pulled sideways at the node between."""
    ea, strain, pull = 1e7, 1e-3, 1e3
    nodes = np.array([[0.0, 0, 0], [1.0, 0, 0], [100001.0, 0, 0]], dtype)
    cables = jc.Cables([[0, 1], [1, 2]], axial_stiffness=ea)
    structure = jc.Structure(nodes, cables, jc.pinned([0, 2]))
    loads = jc.NodalLoads([1], (0.0, 0.0, -pull))

    def exact():
        rest = [1 / (1 + mp.mpf(strain)), 100000 / (1 + mp.mpf(strain))]

        def force(u, w):
            a, b = mp.hypot(1 + u, w), mp.hypot(100000 - u, w)
            n, m = (ea * (a - rest[0]) / rest[0], ea * (b - rest[1]) / rest[1])
            return m * (100000 - u) / b - n * (1 + u) / a, n * w / a + m * w / b - pull

        with mp.workdps(40):
            return [float(v) for v in mp.findroot(force, (1e-3, 0.1))]

    def figure(solution):
        u, w = exact()
        found = np.asarray(solution.displacement[1], float)
        # tol times EA e, over the stiffness N/l of the first link
        return np.hypot(found[0] - u, found[2] + w), 10 * TOL[dtype] + 64 * EPS[dtype]

    return Problem(structure, [jc.Phase(prestrain=strain), jc.Phase(loads=loads)], figure)


# --- nets: a square grid, its edge held; prestrain per cable, then loads


def grid(n):
    """Nodes of a flat grid of n by n free nodes, links, edge and free nodes."""
    m = n + 2
    nodes = np.array([[i, j, 0.0] for i in range(m) for j in range(m)])
    number = np.arange(m * m).reshape(m, m)
    rows = np.stack([number[1:-1, :-1].ravel(), number[1:-1, 1:].ravel()], axis=1)
    columns = np.stack([number[:-1, 1:-1].ravel(), number[1:, 1:-1].ravel()], axis=1)
    free = number[1:-1, 1:-1].ravel()
    edge = np.setdiff1d(number.ravel(), free)
    return nodes, np.concatenate([rows, columns]), edge, free


def net(strain, pull, offset=0.0, stretch=1.0):
    """A net of EA = 1e7; `pull` per node in parts of EA; columns `stretch` times wider apart."""

    def build(full, dtype):
        ea = 1e7
        nodes, links, edge, free = grid(10 if full else 2)
        m = round(np.sqrt(len(nodes)))
        nodes[:, 0] = np.r_[0, np.cumsum(np.geomspace(1, stretch, m - 1))][nodes[:, 0].astype(int)]
        nodes = (nodes + offset).astype(dtype)
        structure = jc.Structure(nodes, jc.Cables(links, axial_stiffness=ea), jc.pinned(edge))
        # unequal and inclined: no symmetry to lean on
        forces = pull * ea * np.array([[0.1, 0.2, -1.0]]) * (1 + 0.3 * np.sin(free))[:, None]
        strains = np.full(len(links), strain)
        loading = jc.Phase(loads=jc.NodalLoads(free, forces), increments=2)
        return Problem(structure, [jc.Phase(prestrain=strains), loading])

    return build


def reversed_net(full, dtype):
    """A slack net hangs down, is drawn up by the reversed load, and is let go."""
    nodes, links, edge, free = grid(10 if full else 2)
    structure = jc.Structure(
        nodes.astype(dtype), jc.Cables(links, axial_stiffness=1e7), jc.pinned(edge)
    )
    down = np.array([0.0, 0, -1e3]) * (1 + 0.3 * np.sin(free))[:, None]
    phases = [
        jc.Phase(prestrain=-0.01, loads=jc.NodalLoads(free, down)),
        jc.Phase(loads=jc.NodalLoads(free, -2 * down)),
    ]

    def figure(solution):
        below, above = (np.asarray(p.positions, float) for p in solution.phases)
        mirrored = np.abs(above - below * [1, 1, -1]).max()
        # tol of the forces over the softest way to move, N/l: 1/100 of the load over the sag
        return mirrored, 100 * TOL[dtype]

    return Problem(structure, phases, figure)


def loose_node(full, dtype):
    """A node that hangs on nothing but slack cables, beside a taut pair."""
    nodes = np.array([[-1.0, 0, 0], [0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 2, 0]], dtype)
    links = [[0, 1], [1, 2], [1, 3], [3, 4]]
    cables = jc.Cables(links, axial_stiffness=1e6)
    structure = jc.Structure(nodes, cables, jc.pinned([0, 2, 4]))
    strain = np.array([1e-3, 1e-3, -0.5, -0.5])
    loads = jc.NodalLoads([1], (0.0, 0.0, -100.0))

    def figure(solution):
        path = solution.phases[-1].path
        w = two_links_exact(1e6, 1e3, 100.0)[0]
        found = -float(solution.displacement[1, 2])
        wrong = int(path.n_loose[-1]) != 1 or int(path.n_slack[-1]) != 2
        return np.inf if wrong else abs(found - w), 10 * TOL[dtype]

    return Problem(structure, [jc.Phase(prestrain=strain), jc.Phase(loads=loads)], figure)


def rollers(full, dtype):
    """Two cables in line whose far end runs on a roller: nothing holds against a pull along."""
    nodes = np.array([[0.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0]], dtype)
    mask = np.zeros((3, 3), bool)
    mask[0, 1:] = mask[2, 1:] = True
    structure = jc.Structure(
        nodes, jc.Cables([[0, 1], [1, 2]], axial_stiffness=1e6), jc.Supports(mask)
    )
    return Problem(structure, [jc.Phase(loads=jc.NodalLoads([1], (10.0, 0, -5.0)))])


# --- again and again


def elastic_cycles(full, dtype):
    """A prestressed net loaded and unloaded a hundred times: where it was, and nothing lost."""
    nodes, links, edge, free = grid(10 if full else 2)
    structure = jc.Structure(
        nodes.astype(dtype), jc.Cables(links, axial_stiffness=1e7), jc.pinned(edge)
    )
    down = np.array([0.0, 0, -1e3]) * (1 + 0.3 * np.sin(free))[:, None]
    prestress = jc.solve(structure, [jc.Phase(prestrain=1e-3)])
    phases = [jc.Phase(loads=jc.NodalLoads(free, f)) for f in (down, -down)]

    def answer():
        solution = prestress
        for _ in range(100):
            solution = jc.solve(structure, phases, start=solution)
        return solution

    def figure(solution):
        # flat and equally strained again; loads of 1e3 N have left their rounding, 100 times
        moved = np.abs(np.asarray(solution.displacement, float)).max()
        off = np.abs(np.asarray(solution.tension, float) / 1e4 - 1).max()
        return max(moved, off), max(1e-9, 100 * EPS[dtype] + 10 * TOL[dtype])

    return Problem(structure, phases, figure, judged=False, answer=answer)


def many_increments(full, dtype):
    """A cable net has one equilibrium: 435 increments end where one does."""
    build = net(1e-4, 3e-4)
    many, one = build(full, dtype), build(full, dtype)
    many.phases[1] = jc.replace(many.phases[1], increments=435)

    def figure(solution):
        direct = one.solve()
        apart = np.asarray(solution.displacement, float) - np.asarray(direct.displacement, float)
        # both within tol of the forces, over a stiffness of N/l: 1e-4 EA
        return np.abs(apart).max(), 1e2 * TOL[dtype]

    many.figure = figure
    return many
