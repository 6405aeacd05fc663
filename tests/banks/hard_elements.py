"""Hard cases of single elements: snapping, curves that fall and end, cycles, plumb catenaries."""

import mpmath as mp
import numpy as np
from banks.hard_nets import EPS, TOL, Problem

import jaxcable as jc

# --- snapping: the von Mises truss (half span 1, rise 0.1, EA 1e6), its apex moved or pulled

LIMIT = 381.0871904181  # N, closed form: limit at l = (b^2 l0)^(1/3)


def von_mises(full, dtype):
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


def snap_back(full, dtype):
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


def traced(soft):
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


def pulled(force, increments, last, at=None):
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


def drawn(to, increments, last):
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


def shakedown(full, dtype):
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
        memory, lengths = np.zeros(2), np.array([1.0, 2.0])

        def forces(u):
            e = u / lengths
            kept = np.clip(e - memory, -1e-3, 1e-3)
            return 1e-4 * (1e9 * e + 199e9 * kept), e - kept

        for _ in range(100):
            for load in (pull, 0.0):
                low, high = -0.1, 0.1
                for _ in range(80):
                    u = 0.5 * (low + high)
                    low, high = (u, high) if forces(u)[0].sum() < load else (low, u)
                memory = forces(u)[1]
        exact = forces(u)[0]
        error = np.abs(np.asarray(solution.tension, float) - exact).max() / pull
        return error, 1e-9 + 10 * TOL[dtype] + 1e3 * EPS[dtype]

    return Problem(structure, phases, figure, cycles=100)


# --- catenaries


def steep(slack):
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
