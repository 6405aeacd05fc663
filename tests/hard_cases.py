"""Hard cases: what is singular, extreme or at the edge, with what has to come out, and why.

Each case is built at a small size (for the tests) or at full size (`experiments/hard_cases.py`) in
either precision. Its outcome is a status, the check of `independent.verdict` where that is OK, and
a figure from elsewhere: a closed form, digits by mpmath, a symmetry. Cases of one shape share a
compiled program.
"""

import dataclasses

import mpmath as mp
import numpy as np
from independent import verdict
from problems import two_links_exact

import jaxcable as jc
from jaxcable import status

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


@dataclasses.dataclass(frozen=True)
class Case:
    """A hard case.

    Attributes:
        name: what it is.
        build: function of (full, dtype) to `Problem`.
        reason: why it is hard, and what is expected.
        single: statuses allowed in float32, with `double` those in float64.
        slow: precisions that are tested with the slow tests only: programs of their own.
    """

    name: str
    build: object
    reason: str
    double: tuple = (status.OK,)
    single: tuple = (status.OK,)
    slow: tuple = ()

    def allowed(self, dtype):
        return self.double if dtype == "float64" else self.single


# --- two links: mid node between two anchors, prestressed, pulled sideways (Kwan 1998)


def _two_links(strain, pull, angle=0.3, offset=0.0):
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


def _unequal_links(full, dtype):
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


def _grid(n):
    """Nodes of a flat grid of n by n free nodes, links, edge and free nodes."""
    m = n + 2
    nodes = np.array([[i, j, 0.0] for i in range(m) for j in range(m)])
    number = np.arange(m * m).reshape(m, m)
    rows = np.stack([number[1:-1, :-1].ravel(), number[1:-1, 1:].ravel()], axis=1)
    columns = np.stack([number[:-1, 1:-1].ravel(), number[1:, 1:-1].ravel()], axis=1)
    free = number[1:-1, 1:-1].ravel()
    edge = np.setdiff1d(number.ravel(), free)
    return nodes, np.concatenate([rows, columns]), edge, free


def _net(strain, pull, offset=0.0, stretch=1.0, figure=None):
    """A net of EA = 1e7; `pull` per node in parts of EA; columns `stretch` times wider apart."""

    def build(full, dtype):
        ea = 1e7
        nodes, links, edge, free = _grid(10 if full else 2)
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


def _reversed_net(full, dtype):
    """A slack net hangs down, is drawn up by the reversed load, and is let go."""
    nodes, links, edge, free = _grid(10 if full else 2)
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


def _loose_node(full, dtype):
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


def _rollers(full, dtype):
    """Two cables in line whose far end runs on a roller: nothing holds against a pull along."""
    nodes = np.array([[0.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0]], dtype)
    mask = np.zeros((3, 3), bool)
    mask[0, 1:] = mask[2, 1:] = True
    structure = jc.Structure(
        nodes, jc.Cables([[0, 1], [1, 2]], axial_stiffness=1e6), jc.Supports(mask)
    )
    return Problem(structure, [jc.Phase(loads=jc.NodalLoads([1], (10.0, 0, -5.0)))])


# --- snapping: the von Mises truss (half span 1, rise 0.1, EA 1e6), its apex moved or pulled

LIMIT = 381.0871904181  # N, closed form: limit at l = (b^2 l0)^(1/3)


def _von_mises(full, dtype):
    """Pushed through by displacement: the apex is moved by twice the rise."""
    nodes = np.array([[-1.0, 0, 0], [0, 0, 0.1], [1.0, 0, 0]], dtype)
    bars = jc.Bars([[0, 1], [1, 2]], axial_stiffness=1e6)
    structure = jc.Structure(nodes, bars, jc.pinned([0, 1, 2]))
    move = jc.SupportMovement([1], (0.0, 0.0, -0.2))
    increments = 500

    def figure(solution):
        path = solution.phases[0].path
        z = 0.1 + np.asarray(path.displacement, float)[:, 1, 2]
        carried = -2 * np.asarray(path.tension, float)[:, 0] * z / np.hypot(1, z)
        # a parabola through the largest of 500 places is off by its fourth derivative: 1e-7
        k = int(carried.argmax())
        low, top, high = carried[k - 1 : k + 2]
        peak = top + (high - low) ** 2 / (8 * (2 * top - low - high))
        # forces of bars have the rounding of their displacements, eps EA w/L
        return abs(peak - LIMIT) / LIMIT, 1e-6 + 8 * EPS[dtype] * 1e6 * 0.1 / LIMIT

    return Problem(structure, [jc.Phase(loads=move, increments=increments)], figure)


def _snap_back(full, dtype):
    """Pushed through a soft spring: the displacement has a limit point too, and the truss jumps."""
    nodes = np.array([[-1.0, 0, 0], [0, 0, 0.1], [1.0, 0, 0], [0, 0, 1.1]], dtype)
    bars = jc.Bars([[0, 1], [1, 2], [1, 3]], axial_stiffness=np.array([1e6, 1e6, 2e3]))
    mask = np.ones((4, 3), bool)
    mask[1, 2] = False
    structure = jc.Structure(nodes, bars, jc.Supports(mask))
    move = jc.SupportMovement([3], (0.0, 0.0, -0.4))

    def figure(solution):
        """The spring, pushed beyond the truss, must have snapped it: one equilibrium is left."""
        z = 0.1 + float(solution.displacement[1, 2])
        with mp.workdps(30):
            l0 = mp.sqrt(mp.mpf("1.01"))

            def balance(z):
                l = mp.sqrt(1 + z * z)
                return 2e6 * (l - l0) / l0 * z / l - 2e3 * (mp.mpf("0.7") - z - 1)

            exact = float(mp.findroot(balance, (-0.15, -0.1), solver="anderson"))
        # residual 1e-10 of EA e, over the stiffness 2 EA z^2/l^3; coordinates are rounded
        return abs(z - exact), 1e2 * TOL[dtype] + 64 * EPS[dtype]

    return Problem(structure, [jc.Phase(loads=move, increments=20)], figure)


def _traced(soft):
    """The same two by arc length: load on the apex, or movement of the end of its spring."""

    def build(full, dtype):
        nodes = np.array([[-1.0, 0, 0], [0, 0, 0.1], [1.0, 0, 0], [0, 0, 1.1]], dtype)
        mask = np.ones((4, 3), bool)
        mask[1, 2] = False
        bars = jc.Bars([[0, 1], [1, 2], [1, 3]], axial_stiffness=np.array([1e6, 1e6, 2e3]))
        loads = jc.SupportMovement([3], (0.0, 0.0, -0.4))
        if not soft:
            nodes, mask = nodes[:3], mask[:3]
            bars = jc.Bars([[0, 1], [1, 2]], axial_stiffness=1e6)
            loads = jc.NodalLoads([1], (0.0, 0.0, -500.0))
        structure = jc.Structure(nodes, bars, jc.Supports(mask))
        phases = [jc.Phase(loads=loads)]

        def figure(path):
            with mp.workdps(30):
                l0 = mp.sqrt(mp.mpf("1.01"))

                def carried(z):
                    l = mp.sqrt(1 + z * z)
                    return 2e6 * (l0 - l) / l0 * z / l

                def movement(z):
                    return mp.mpf("0.1") - z + carried(z) / 2e3

                if soft:
                    exact = float(movement(mp.findroot(lambda z: mp.diff(movement, z), 0.06)) / 0.4)
                else:
                    exact = LIMIT / 500
            first = np.asarray(path.events.kind) == jc.paths.LIMIT_POINT
            if not first.any():
                return np.inf, 0.0
            found = float(np.asarray(path.events.load_factor)[first][0])
            # of second order in where the limit is caught; rounding of a rise of 0.1 in EA eps
            return abs(found - exact), 1e-10 if dtype == "float64" else 1e-3

        def answer():
            return jc.trace_path(structure, phases)

        return Problem(structure, phases, figure, judged=False, answer=answer)

    return build


# --- curves: a cable of 1 m and 1 m2, pulled by a load or by its anchor

CURVE = ((0.0, 1e-3, 3e-3, 5e-3), (0.0, 2e6, 3e6, 1e6))  # Pa; falls after 3e-3


def _pulled(force, increments, last, at=None):
    """Pulled by `force`, N, in increments; ends after the good part `last` of it."""

    def build(full, dtype):
        nodes = np.array([[0.0, 0, 0], [1.0, 0, 0]], dtype)
        mask = np.array([[1, 1, 1], [0, 1, 1]], bool)
        cable = jc.Cables([[0, 1]], area=1.0, law=jc.Polygonal(*CURVE))
        structure = jc.Structure(nodes, cable, jc.Supports(mask))
        loads = jc.NodalLoads([1], (force, 0.0, 0.0))

        def figure(solution):
            if last < 1:
                return abs(float(solution.last.load_factor) - last), 1e-6
            # tol of the force over the lower of the two slopes, 5e8 N/m
            return abs(float(solution.displacement[1, 0]) - at), 2 * TOL[dtype] * force / 5e8

        return Problem(structure, [jc.Phase(loads=loads, increments=increments)], figure)

    return build


def _drawn(to, increments, last):
    """Its far end moved by `to`, m: softens, and fails at 5e-3 m."""

    def build(full, dtype):
        nodes = np.array([[0.0, 0, 0], [1.0, 0, 0]], dtype)
        cable = jc.Cables([[0, 1]], area=1.0, law=jc.Polygonal(*CURVE))
        structure = jc.Structure(nodes, cable, jc.pinned([0, 1]))
        move = jc.SupportMovement([1], (to, 0.0, 0.0))

        def figure(solution):
            if last < 1:
                return abs(float(solution.last.load_factor) - last), 1e-6
            exact = np.interp(to, *CURVE)
            return abs(float(solution.tension[0]) - exact) / exact, 64 * EPS[dtype]

        return Problem(structure, [jc.Phase(loads=move, increments=increments)], figure)

    return build


# --- cycles


def _elastic_cycles(full, dtype):
    """A prestressed net loaded and unloaded a hundred times: where it was, and nothing lost."""
    nodes, links, edge, free = _grid(10 if full else 2)
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


def _shakedown(full, dtype):
    """Two elastic-plastic bars of lengths 1 and 2 side by side, pulled and let go 100 times."""
    nodes = np.array([[0.0, 0, 0], [1.0, 0, 0], [-1.0, 0, 0]], dtype)
    mask = np.array([[1, 1, 1], [0, 1, 1], [1, 1, 1]], bool)
    strain = np.array([-0.1, -1e-3, 0, 1e-3, 0.1])
    stress = np.array([-200e6, -200e6, 0, 200e6, 200e6])
    law = jc.Polygonal(strain, stress + 1e9 * (strain - np.clip(strain, -1e-3, 1e-3)), "elastic")
    bars = jc.Bars([[0, 1], [2, 1]], area=1e-4, law=law)
    structure = jc.Structure(nodes, bars, jc.Supports(mask))
    pull = 35e3  # N: yields the short bar, not both
    phases = [jc.Phase(loads=jc.NodalLoads([1], (f, 0.0, 0.0))) for f in (pull, -pull)]

    def figure(solution):
        plastic, lengths = np.zeros(2), np.array([1.0, 2.0])

        def forces(u):
            e = u / lengths
            kept = np.clip(e - plastic, -1e-3, 1e-3)
            return 1e-4 * (1e9 * e + 199e9 * kept), e - kept

        for _ in range(100):
            for load in (pull, 0.0):
                low, high = -0.1, 0.1
                for _ in range(80):
                    u = 0.5 * (low + high)
                    low, high = (u, high) if forces(u)[0].sum() < load else (low, u)
                plastic = forces(u)[1]
        exact = forces(u)[0]
        error = np.abs(np.asarray(solution.tension, float) - exact).max() / pull
        return error, 1e-9 + 10 * TOL[dtype] + 1e3 * EPS[dtype]

    return Problem(structure, phases, figure, cycles=100)


def _many_increments(full, dtype):
    """A cable net has one equilibrium: 435 increments end where one does."""
    build = _net(1e-4, 3e-4)
    many, one = build(full, dtype), build(full, dtype)
    many.phases[1] = jc.replace(many.phases[1], increments=435)

    def figure(solution):
        direct = one.solve()
        apart = np.asarray(solution.displacement, float) - np.asarray(direct.displacement, float)
        # both within tol of the forces, over a stiffness of N/l: 1e-4 EA
        return np.abs(apart).max(), 1e2 * TOL[dtype]

    many.figure = figure
    return many


# --- catenaries


def _steep(slack):
    """Nearly plumb, 1e-6 of its length off; `slack` is its unstressed length less its chord."""

    def build(full, dtype):
        nodes = np.array([[0.0, 0, 0], [1e-4, 0, -100.0]], dtype)
        ea, weight = 1e7, 50.0
        cable = jc.Catenaries([[0, 1]], axial_stiffness=ea, rest_length=100 + slack, weight=weight)
        structure = jc.Structure(nodes, cable, jc.pinned([0, 1]))

        def figure(solution):
            """Chord by Irvine's integrals from the reaction at the top, in 40 digits."""
            with mp.workdps(40):
                top = [mp.mpf(float(v)) for v in np.asarray(solution.reactions[0])]
                h, up = -top[0], top[2]  # pulls the anchor along x, and down
                rest, w, stiff = mp.mpf(float(np.asarray(100 + slack, dtype))), mp.mpf(50), ea
                end = up - w * rest
                x = h * rest / stiff + h / w * (mp.asinh(up / h) - mp.asinh(end / h))
                z = (up**2 - end**2) / (2 * w * stiff) + (mp.hypot(h, up) - mp.hypot(h, end)) / w
                chord = np.asarray(nodes[1], float)
                off = float(max(abs(x - chord[0]), abs(z + chord[2])))
            # digits of the reaction, over the stiffness of what it holds: a length of rounding
            return off, 1e3 * EPS[dtype] * 100

        return Problem(structure, [jc.Phase(loads=jc.SelfWeight())], figure, judged=False)

    return build


PAIR, FALLEN = ("float64", "float32"), ("float32",)

CASES = [
    Case("two links without prestress", _two_links(0.0, 1e-6), "tangent singular at the start"),
    Case("two links, prestress 1e-12 EA", _two_links(1e-12, 1e-6), "nearly singular tangent"),
    Case("two links, EA/N = 1e8", _two_links(1e-8, 3e-12), "N is the small difference of lengths"),
    Case("two links, EA/N = 1e12", _two_links(1e-12, 1e-18), "beyond the digits of a length"),
    Case("two links 1e6 m away", _two_links(1e-4, 1e-6, offset=1e6), "positions lose digits"),
    Case("links of 1 m and 1e5 m", _unequal_links, "stiffnesses 1e5 apart"),
    Case("flat net without prestress", _net(0.0, 1e-5), "tangent singular at the start"),
    Case("net, prestress 1e-12 EA", _net(1e-12, 1e-5), "nearly singular tangent"),
    Case("net, EA/N = 1e8", _net(1e-8, 1e-12), "small difference of lengths"),
    Case("net, EA/N = 1e12", _net(1e-12, 1e-18), "small difference of lengths"),
    Case("net, lengths 1e5 apart", _net(1e-3, 1e-5, stretch=1e5), "stiffnesses 1e5 apart"),
    Case("net 1e6 m away", _net(1e-3, 1e-5, offset=1e6), "positions lose digits"),
    Case(
        "net with every cable slack",
        _net(-0.2, 1e-5),
        "no stiffness at the start; in float32 EA eps of displacements of 0.5 m is 0.6 N, of 100 N",
        single=(status.NOT_CONVERGED,),
    ),
    Case("slack net drawn down, then up", _reversed_net, "slack on the way", slow=FALLEN),
    Case("node with only slack cables", _loose_node, "no equation for it", slow=PAIR),
    Case(
        "cables on rollers",
        _rollers,
        "no equilibrium",
        (status.MECHANISM,),
        (status.MECHANISM,),
        slow=PAIR,
    ),
    Case("truss pushed through", _von_mises, "negative stiffness, held", slow=FALLEN),
    Case("truss pushed by a spring", _snap_back, "jumps to the only equilibrium left", slow=PAIR),
    Case("limit load by arc length", _traced(False), "limit point", slow=PAIR),
    Case("snap-back by arc length", _traced(True), "displacement turns back", slow=PAIR),
    Case("cable at the corner of its curve", _pulled(2e6, 1, 1, 1e-3), "two tangents", slow=FALLEN),
    Case(
        "cable pulled beyond its peak",
        _pulled(4e6, 16, 12 / 16),
        "3e6 N is the peak: carried at 12/16 of the load, not at 13/16",
        (status.MATERIAL_FAILURE,),
        (status.MATERIAL_FAILURE,),
        slow=FALLEN,
    ),
    Case("cable drawn down its falling branch", _drawn(4e-3, 16, 1), "negative tangent", slow=PAIR),
    Case(
        "cable drawn beyond its end",
        _drawn(8.1e-3, 16, 9 / 16),
        "5e-3 is the end: 9/16 of the movement, not 10/16",
        (status.MATERIAL_FAILURE,),
        (status.MATERIAL_FAILURE,),
        slow=PAIR,
    ),
    Case("100 elastic cycles", _elastic_cycles, "nothing may add up", slow=PAIR),
    Case("100 elastic-plastic cycles", _shakedown, "shakes down", slow=PAIR),
    Case("435 increments against one", _many_increments, "one equilibrium", slow=PAIR),
    Case("plumb catenary, taut", _steep(-0.5), "no span", slow=PAIR),
    Case("plumb catenary in a loop", _steep(5.0), "horizontal force near zero", slow=PAIR),
]
