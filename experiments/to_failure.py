"""Where do structures fail, and how exactly are limit and branch points located?

References, all independent of the package: closed forms of the truss of von Mises (limit points,
bifurcation points, snap-back with a soft hanger); plane extensible rods by the shooting method
(`rods.py`) and the published limit load of Lee's frame, 18.552 (Schweizerhof and Wriggers 1986; its
digits only, because the unit of load differs); Euler's column; the derivative of the limit load in
60 digits. Errors are those of load factors, relative to the limit load.

    python experiments/to_failure.py
"""

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # its threads fight with those of XLA

from functools import partial

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import mpmath
import numpy as np
import rods
import scenes
from benchmarks.measure import timed
from record import Record

import jaxcable as jc
from jaxcable.scenes.building_blocks import chain_links

LEE = 1.8552  # published, times ten


def traced(scene, **settings):
    """The path of a scene, and seconds that it takes once compiled."""
    path, _, (seconds,) = timed(partial(jc.trace_path, *scene, **settings), calls=1)
    return path, seconds


def truss_load(height, rise=0.1, ea=1e6):
    l0, l = np.hypot(1, rise), np.hypot(1, height)
    return 2 * ea * (l0 - l) / l0 * height / l


def truss_limit(rise, b=1.0, ea=1e6):
    l0 = mpmath.sqrt(b * b + rise * rise)
    l = (b * b * l0) ** (mpmath.mpf(1) / 3)
    return 2 * ea * (l0 - l) / l0 * mpmath.sqrt(l * l - b * b) / l


def shallow(say):
    """The truss of von Mises and its derivative."""
    mpmath.mp.dps = 60
    path, seconds = traced(jc.scenes.von_mises_truss())
    exact = float(truss_limit(mpmath.mpf("0.1")))
    height = 0.1 + np.asarray(path.displacement)[:, 1, 2]
    off = np.abs(500 * path.load_factor - truss_load(height)).max() / exact
    limits = 500 * np.asarray(path.events.load_factor)
    say("Truss of von Mises, rise 0.1, half-span 1 m, EA 1e6 N")
    say(f"  {len(height)} points in {1e3 * seconds:.1f} ms; largest error of the path {off:.1e}")
    say(f"  limit points {limits[0]:.10f} and {limits[1]:.10f} N, closed form +-{exact:.10f} N:")
    say(f"  errors {abs(limits[0] / exact - 1):.1e}, {abs(-limits[1] / exact - 1):.1e}")
    print_derivative(say)
    return path


def print_derivative(say):
    """Derivative of the limit load by rise, half-span and EA."""
    structure, phases = jc.scenes.von_mises_truss()

    @jax.jit
    def load(p):
        nodes = jnp.array([[-1.0, 0, 0], [0, 0, 0], [1.0, 0, 0]]) * p[1]
        own = jc.replace(
            structure,
            nodes=nodes.at[1, 2].set(p[0]),
            elements=jc.Bars([[0, 1], [1, 2]], axial_stiffness=p[2]),
        )
        return 500 * jc.trace_path(own, phases, through=False).failure_load

    point = jnp.array([0.1, 1.0, 1e6])
    formula = np.asarray(jax.jit(jax.grad(load))(point))
    exact = [
        float(mpmath.diff(truss_limit, (mpmath.mpf("0.1"), mpmath.mpf(1), mpmath.mpf(10) ** 6), n))
        for n in ((1, 0, 0), (0, 1, 0), (0, 0, 1))
    ]
    say("  derivative of the limit load by   rise           half-span      EA")
    say("    -phi.R_p / (phi.R_f)    " + "".join(f"{v:15.8g}" for v in formula))
    say("    closed form             " + "".join(f"{v:15.8g}" for v in exact))
    say(
        "    error                   "
        + "".join(f"{a / b - 1:15.1e}" for a, b in zip(formula, exact, strict=True))
    )
    for relative in (1e-2, 1e-3, 1e-4, 1e-5):
        central = []
        for k in range(3):
            step = relative * point[k]
            ahead, back = (load(point.at[k].add(s)) for s in (step, -step))
            central.append(float((ahead - back) / (2 * step)))
        off = "".join(f"{a / b - 1:15.1e}" for a, b in zip(central, exact, strict=True))
        say(f"    differences, step {relative:.0e}" + off)
    say()


def steep(say):
    """Limit and branch points of a steep truss that may sway."""
    path, seconds = traced(jc.scenes.von_mises_truss(rise=3.0, load=1e6, sway=True))
    l0 = np.sqrt(10.0)
    roots = sorted(np.real(np.roots([1, -l0, 0, l0])))[:0:-1]
    first, second = (truss_load(np.sqrt(l * l - 1), rise=3.0) for l in roots)
    half = [first, float(truss_limit(3.0)), second]
    exact = np.array([*half, *(-v for v in half[::-1])])
    say(f"Steep truss, rise 3 m, may sway: {len(path.load_factor)} points, {1e3 * seconds:.1f} ms")
    say("  event          load (N)           error     phi.F/(|phi||F|)")
    for event, load in zip(path.events, exact, strict=True):
        found = 1e6 * float(event.load_factor)
        say(
            f"  {event.names[0]:14}{found:16.4f}{abs(found / load - 1):13.1e}"
            f"{float(event.alignment):13.1e}"
        )
    say()
    return path


def hanger(say):
    """Snap-back behind a soft hanger."""
    path, seconds = traced(jc.scenes.von_mises_truss(hanger=2e3))
    apex, end = np.asarray(path.displacement)[:, [1, 3], 2].T
    force = 500 * np.asarray(path.load_factor)
    off = max(np.abs(truss_load(0.1 + apex) - force).max(), np.abs(apex - end - force / 2e3).max())
    turns = np.flatnonzero(np.diff(np.sign(np.diff(-end)))) + 1
    say(f"Truss behind a hanger of 2 kN/m: {len(force)} points in {1e3 * seconds:.1f} ms;")
    say(
        f"  its end turns back at {-1e3 * end[turns[0]]:.1f} mm and on again at "
        f"{-1e3 * end[turns[-1]]:.1f} mm; error of the path {off / 381.0871904181:.1e}\n"
    )
    return path


def frames(say):
    """Williams' toggle and Lee's frame against rods by shooting."""
    exact = [load for load, _ in rods.toggle_limits()]
    say(f"Williams' toggle: limit points of the rod {exact[0]:.6f} and {exact[1]:.6f} lb")
    say("  elements a side     maximum (lb)     error   minimum (lb)     error   time (ms)")
    for n in (4, 8):
        toggle, seconds = traced(scenes.toggle_frame(n))
        own = 80 * np.asarray(toggle.events.load_factor)
        off = own / exact - 1
        say(f"{n:17d}{own[0]:17.6f}{off[0]:10.1e}{own[1]:15.6f}{off[1]:10.1e}{1e3 * seconds:12.0f}")
    guess = np.array([np.pi / 2, 0, -0.1, 0.1])
    for w in np.arange(1, 49.0):
        guess = rods.lee_frame(w, guess)
    limit, at = rods.lee_limit(48.7, guess)
    say(f"\nLee's frame: limit point of the rod {limit:.7f} at a deflection of {at:.4f};")
    say(
        f"  published {LEE}, {LEE / limit - 1:.1e} from it (plane elements of that time with shear)"
    )
    say("  elements in all    first limit     to the rod   to the published   second   time (ms)")
    for n in (2, 4):
        lee, seconds = traced(scenes.lee_frame(n))
        own = 30 * np.asarray(lee.events.load_factor)
        say(
            f"{10 * n:15d}{own[0]:18.7f}{own[0] / limit - 1:12.1e}{own[0] / LEE - 1:16.1e}"
            f"{own[1]:14.5f}{1e3 * seconds:11.0f}"
        )
    say()
    return toggle, lee


def column(say):
    """Euler's column: the branch point of a perfect column, by number of elements."""
    say("Column, both ends hinged, 4 m, EA/P_cr 2e4: branch point over pi^2 EI / L^2, less one;")
    say("the shortening of the column before it buckles raises the load by P/EA = 5e-5")
    length, ei = 4.0, 1e5
    euler = np.pi**2 * ei / length**2
    for n in (4, 8):
        z = np.linspace(0, length, n + 1)
        section = scenes.frames.solid(1.0, 1.0 / (2e4 * euler / ei), 2e4 * euler)
        beams = jc.Beams(chain_links(range(n + 1)), section=section, torsional_stiffness=ei)
        held = scenes.frames.in_plane(n + 1).mask.array.copy()
        held[0, :3] = held[n, :2] = True
        structure = jc.Structure(np.column_stack([0 * z, 0 * z, z]), beams, jc.Supports(held))
        load = jc.Phase(loads=jc.NodalLoads([n], (0, 0, -1.5 * euler)))
        path, seconds = traced((structure, [load]), through=False)
        say(
            f"  {n} elements: {path.events.names[0]}, {1.5 * float(path.failure_load) - 1:9.2e}; "
            f"phi.F {float(path.events.alignment[0]):.0e}, {1e3 * seconds:.0f} ms"
        )
    say()


def dome(say):
    """The Geiger dome: where its rings begin to twist."""
    scene = scenes.geiger_dome(load=500.0)
    path, seconds = traced(scene)
    say(f"Geiger dome to 500 N/m2: {len(path.load_factor)} points in {1e3 * seconds:.0f} ms")
    for event in path.events:
        say(f"  {event.names[0]} at {500 * float(event.load_factor):.3f} N/m2")
    first = path.events[0]
    mode = np.asarray(first.mode)
    plan = np.asarray(scene[0].nodes)[:, :2]
    radius = np.linalg.norm(plan, axis=1)
    ring = radius > 1e-9
    around = np.column_stack([-plan[:, 1], plan[:, 0]])[ring] / radius[ring, None]
    turned = np.sum(mode[ring, :2] * around, axis=1)
    share = np.sum(turned**2) / np.sum(mode[ring] ** 2)
    say(f"  its mode turns nodes around the axis: {100 * share:.0f} % of the squared displacement")
    state = jc.solve(*scene)
    slow = jc.dynamics.modes(scene[0], state, n=1, masses=100.0)
    say(
        f"  at 500 N/m2 the perfect dome is in equilibrium (status {int(state.status)}) and "
        f"unstable: squared circular frequency {float(slow.squared[0]):.3g} 1/s2\n"
    )
    return path


def picture(shallow, hung, toggle, lee):
    figure, axes = plt.subplots(2, 2, figsize=(11.5, 8.6), layout="constrained")
    parts = (
        (shallow, 1, -1e3, 500, "truss of von Mises", "apex down (mm)", "load (N)"),
        (hung, 3, -1e3, 500, "the same behind a soft hanger", "end down (mm)", "load (N)"),
        (toggle, 8, -1, 80, "Williams' toggle, 8 elements a side", "apex down (in)", "load (lb)"),
        (lee, 24, -1, 30, "Lee's frame, 40 elements", "loaded point down", "load"),
    )
    for place, (path, node, factor, load, title, across, up) in zip(axes.flat, parts, strict=True):
        moved = factor * np.asarray(path.displacement)[:, node, 2]
        force = load * np.asarray(path.load_factor)
        unstable = np.asarray(path.n_negative) > 0
        for kind, style, name in ((False, "-", "stable"), (True, "--", "unstable")):
            own = unstable == kind
            own[:-1] |= own[1:]
            line = np.where(own, moved, np.nan), np.where(own, force, np.nan)
            place.plot(*line, style, color="C0", label=name)
        at = factor * np.asarray(path.events.displacement)[:, node, 2]
        place.plot(at, load * path.events.load_factor, "o", color="C3", label="limit point")
        place.axhline(0, color="0.6", linewidth=0.7)
        place.grid(color="0.92")
        place.set(title=title, xlabel=across, ylabel=up)
    pushes, p, force = np.linspace(0.01, 0.68, 68), np.zeros(3), []
    for push in pushes:
        p = rods.toggle(push, p)
        force.append(-2 * p[1])
    axes[1, 0].plot(pushes[::4], force[::4], "k+", label="rod by shooting")
    axes[1, 1].plot([], [], "k+", label="rod by shooting")
    guess, points = np.array([np.pi / 2, 0, -0.1, 0.1]), []
    for w in np.arange(1.0, 61.0):
        guess = rods.lee_frame(w, guess)
        points.append((w, guess[3]))
    axes[1, 1].plot(*np.array(points)[::4].T, "k+")
    axes[1, 1].set(xlim=(0, 100), ylim=(-1.2, 3.5))
    for place in axes.flat:
        place.legend(frameon=False)
    return figure


def main():
    say = Record("to_failure")
    one = shallow(say)
    steep(say)
    hung = hanger(say)
    toggle, lee = frames(say)
    column(say)
    dome(say)
    say.close(picture(one, hung, toggle, lee))


if __name__ == "__main__":
    main()
