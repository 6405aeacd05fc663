"""How long does a result of a given error take, for every method and setting?

Question   Time against error of: increments and corrections (tangent form, the paper's secant
           form), full Newton by tolerance, solvers of linear systems, float32, OpenSees; straight
           elements against catenaries; number of fibres.
Reference  Net: a saddle of 10 x 10 free nodes, prestressed and loaded, solved here by NumPy with
           residuals in extended precision, independently of the package. Isolated cable:
           catenaries in 40 digits (`isolated_cable.py`). Fibres: the closed form of the section,
           with four fibres.
Error      Largest error of a displacement over all nodes, over the largest displacement of the
           loading phase; for OpenSees only of the z displacement of the middle node.
Results    work_precision.txt and .png; five minutes. Without OpenSees a line says that its rows
           are left out.

Loops are fused (`jaxcable.fuse_loops`). Times are wall milliseconds of both phases: medians of
alternating calls in one process, each with new numbers and blocked on completion; for OpenSees of
`analyze` alone, in a separate process.
"""

import isolated_cable
import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from record import Record
from scenes.frames import solid

import jaxcable as jc
from jaxcable.scenes.building_blocks import chain_links

from .measure import by_turns, clock
from .scaling import of_opensees

jc.fuse_loops()

SIDE, LOAD = 10, 5000.0 / 11  # free nodes a side; N on each
GOALS = (1e-3, 1e-6, 1e-9)


def reference(structure, phases):
    """Displacement of all nodes after each phase, m: Newton with residuals in extended precision.

    All cables stay taut, which is asserted.
    """
    nodes = np.asarray(structure.nodes).astype(np.longdouble)
    links = structure.elements.links.array
    free = ~structure.held_displacements()
    stiffness = np.asarray(structure.elements.axial_stiffness).astype(np.longdouble)
    chord = nodes[links[:, 1]] - nodes[links[:, 0]]
    rest = np.sqrt((chord**2).sum(1)) / (1 + np.longdouble(phases[0].pretension) / stiffness)
    loads = phases[1].loads
    force = np.zeros_like(nodes)
    force[loads.nodes.array] = np.asarray(loads.forces)
    place, ends = nodes.copy(), []
    for load in (0 * force, force):
        for _ in range(12):
            vector = place[links[:, 1]] - place[links[:, 0]]
            length = np.sqrt((vector**2).sum(1))
            tension = stiffness * (length - rest) / rest
            assert (tension > 0).all()
            density = tension / length
            left = load.copy()
            np.add.at(left, links[:, 0], density[:, None] * vector)
            np.add.at(left, links[:, 1], -density[:, None] * vector)
            along = (vector / length[:, None]).astype(float)
            own = (stiffness / rest - density).astype(float)
            block = own[:, None, None] * along[:, :, None] * along[:, None, :]
            block += density.astype(float)[:, None, None] * np.eye(3)
            matrix = np.zeros((nodes.size, nodes.size))
            for i, j, sign in ((0, 0, 1), (1, 1, 1), (0, 1, -1), (1, 0, -1)):
                rows = 3 * links[:, i, None, None] + np.arange(3)[None, :, None]
                columns = 3 * links[:, j, None, None] + np.arange(3)[None, None, :]
                np.add.at(matrix, (rows, columns), sign * block)
            keep = np.flatnonzero(free)
            step = np.linalg.solve(matrix[np.ix_(keep, keep)], left[free].astype(float))
            place[free] += step
        assert np.abs(left[free]).max() < 1e-17 * np.abs(tension).max() * 1e3
        ends.append(place - nodes)
    return ends


def net_settings(cases):
    """Name of the family, label (increments of each phase, or tolerance), method."""
    for corrections, counts in cases.corrections.items():
        for k in counts:
            yield f"tangent, {corrections} corrections", k, jc.Incremental(corrections, tol=np.inf)
    for k in cases.secant:
        yield "secant", k, jc.Incremental(stiffness="secant", tol=np.inf)
    for tol in cases.precision:
        yield "full Newton", tol, jc.Newton(tol=tol)
    for name in ("dense", "superlu", "pardiso"):
        try:
            yield f"Newton, {name}", 1e-10, jc.Newton(tol=1e-10, linear_solver=name)
        except ValueError as error:  # PARDISO is an extra
            print(error)
    for tol in (1e-2, 1e-4, 1e-5):
        yield "Newton, float32", tol, jc.Newton(tol=tol)


def net(say, cases):
    """Rows (family, setting, error, ms, compile s) of the saddle net."""
    structure, phases = jc.scenes.saddle(SIDE, SIDE, load=LOAD)
    first, last = reference(structure, phases)
    size = np.abs(last - first).max()
    say(
        f"Saddle of {SIDE} x {SIDE} free nodes, load {LOAD:.1f} N a node; largest displacement of "
        f"the loading {1e3 * float(size):.3f} mm, in all {1e3 * float(np.abs(last).max()):.3f} mm"
    )
    runs, rows = [], []
    for family, setting, method in net_settings(cases):
        count = setting if isinstance(method, jc.Incremental) else 1
        dtype = jnp.float32 if "float32" in family else jnp.float64
        own = jc.replace(structure, nodes=jnp.asarray(structure.nodes, dtype))

        @jax.jit
        def analysed(load, method, own=own, count=count):
            forces = load.astype(own.nodes.dtype) * jnp.array([0.0, 0.0, -1.0], own.nodes.dtype)
            loading = jc.replace(
                phases[1], loads=jc.replace(phases[1].loads, forces=forces), increments=count
            )
            solution = jc.solve(own, [jc.replace(phases[0], increments=count), loading], method)
            return solution.last.displacement, solution.status

        runs.append(lambda load, run=analysed, method=method: run(load, method))
        first, (moved, status) = clock(runs[-1], jnp.asarray(LOAD))
        off = np.abs(np.asarray(moved, np.longdouble) - last).max() / size
        rows.append([family, setting, float(off), np.nan, first, int(status)])
    for row, own in zip(rows, warm(runs, cases, LOAD).T, strict=True):
        row[3] = np.median(own)
    middle = SIDE // 2 * SIDE + SIDE // 2
    node = phases[1].loads.nodes.array[middle]
    for tol in (1e-2, 1e-4, 1e-6, 1e-8, 1e-10):
        found = of_opensees(SIDE, LOAD, "BandSPD", "RCM", "Newton", cases.repeats, tol)
        if not found.get("ok"):
            say(f"OpenSees, tol {tol:.0e}: {found.get('error')}")
            continue
        off = abs(found["z_middle"] - float(last[node, 2])) / float(size)
        rows.append(["OpenSees", tol, off, 1e3 * found["analyze_s"], np.nan, 0])
    say(f"{'':24}{'setting':>10}{'error':>11}{'time (ms)':>11}{'compile (s)':>13}  status")
    for family, setting, off, ms, compiled, status in rows:
        shown = f"{setting:.0e}" if isinstance(setting, float) else f"{setting}"
        say(f"{family:24}{shown:>10}{off:11.1e}{ms:11.3f}{compiled:13.1f}  {status}")
    say()
    return rows


def warm(runs, cases, load):
    """Milliseconds of functions of a load, by turns with loads near `load`."""
    rng = np.random.default_rng(0)
    return by_turns(runs, cases.repeats, lambda _: jnp.asarray(load * (1 + 1e-3 * rng.random())))


def cable(say, cases):
    """Rows of the isolated cable, straight elements and catenaries."""
    exact, rows = isolated_cable.reference(), []
    size = np.linalg.norm(exact)
    settings = [("catenaries", 0, tol) for tol in (1e-4, 1e-10)]
    settings += [("straight elements", n, 1e-10) for n in cases.straight]
    say(f"Isolated cable under a point load, displacement {size:.3f} m")
    for family, n, tol in settings:
        run = isolated_cable.analysis(n, tol)
        first, (moved, status) = clock(run, jnp.asarray(isolated_cable.LOAD))
        assert int(status) == 0, jc.describe(status)
        off = np.linalg.norm(np.asarray(moved)[[0, 2]] - exact) / size
        took, compiled = warm([run], cases, isolated_cable.LOAD), first
        setting = tol if n == 0 else n
        rows.append([family, setting, float(off), np.median(took), compiled, 0])
        what = f"tol {tol:.0e}" if n == 0 else f"{n} a span"
        say(f"{family:24}{what:>12}{off:11.1e}{rows[-1][3]:11.3f}{compiled:13.1f}")
    say()
    return rows


def fibres(say, cases):
    """Rows of a cantilever whose round section has k x k fibres."""
    n, diameter, modulus = 8, 0.1, 210e9
    x = np.linspace(0, 2.0, n + 1)
    nodes = np.column_stack([x, 0 * x, 0 * x])
    law, area = jc.Elastic(modulus), np.pi * diameter**2 / 4
    sections = {0: solid(area, np.pi * diameter**4 / 64, modulus)}
    sections |= {k: jc.Section.disc(diameter, law, (k, k)) for k in cases.fibres}
    tips, rows = {}, []
    say("Cantilever of 2 m, 8 beams, round section of 100 mm, deflected by a quarter of its length")
    for k, section in sections.items():
        beams = jc.Beams(chain_links(range(n + 1)), section=section, torsional_stiffness=1e5)
        structure = jc.Structure(nodes, beams, supports=jc.clamped([0]))

        @jax.jit
        def run(load, structure=structure):
            down = jc.NodalLoads([n], load * jnp.array([0.0, 0.0, -1.0]))
            solution = jc.solve(structure, [jc.Phase(loads=down, increments=4)])
            return solution.displacement[n], solution.status

        first, (tip, status) = clock(run, jnp.asarray(2e5))
        assert int(status) == 0, jc.describe(status)
        took, compiled = warm([run], cases, 2e5), first
        tips[k] = np.asarray(tip)
        if k:
            off = np.linalg.norm(tips[k] - tips[0]) / np.linalg.norm(tips[0])
            rows.append(["fibres", k * k, float(off), np.median(took), compiled, 0])
            say(f"{k:3d} x {k:<3d} fibres{off:11.1e}{np.median(took):11.3f}{compiled:13.1f}")
        else:
            say(f"four fibres (exact)     {np.median(took):12.3f}{compiled:13.1f}")
    say()
    return rows


def summary(say, net_rows, cable_rows, fibre_rows):
    """The cheapest setting of every family that reaches each goal."""
    say("Cheapest setting with an error below the goal; time in ms, and over the cheapest of all")
    say(f"{'':24}" + "".join(f"{f'{goal:.0e}':>24}" for goal in GOALS))
    for rows in (net_rows, cable_rows, fibre_rows):
        families = list(dict.fromkeys(row[0] for row in rows))
        good = {goal: [row for row in rows if row[2] <= goal and row[5] == 0] for goal in GOALS}
        for family in families:
            line = f"{family:24}"
            for goal in GOALS:
                own = [row for row in good[goal] if row[0] == family]
                if not own:
                    line += f"{'not reached':>24}"
                    continue
                best = min(own, key=lambda row: row[3])
                least = min(row[3] for row in good[goal])
                setting = f"{best[1]:.0e}" if isinstance(best[1], float) else f"{best[1]}"
                line += f"{f'{setting}: {best[3]:.2f} ({best[3] / least:.1f})':>24}"
            say(line)
        say()


def draw(net_rows, cable_rows, fibre_rows):
    figure, axes = plt.subplots(
        1, 3, figsize=(15, 5.2), layout="constrained", width_ratios=(2, 1, 1)
    )
    titles = (
        f"Net of {3 * SIDE**2} unknowns, two phases",
        "Isolated cable, two phases",
        "Fibres of a section, cantilever",
    )
    markers = "osDv^<>PX*hp"
    for place, rows, title in zip(axes, (net_rows, cable_rows, fibre_rows), titles, strict=True):
        for number, family in enumerate(dict.fromkeys(row[0] for row in rows)):
            own = np.array([row[2:4] for row in rows if row[0] == family])
            style = "--" if family == "OpenSees" else "-"
            place.loglog(
                np.maximum(own[:, 0], 1e-16), own[:, 1], markers[number] + style, label=family
            )
        if rows is fibre_rows:  # all nearly alike
            place.set_yscale("linear")
            place.set_ylim(0, 1.5 * max(row[3] for row in rows))
            for row in rows:
                side = round(row[1] ** 0.5)
                place.annotate(
                    f"{side} x {side}", row[2:4], (0, 8), textcoords="offset points", ha="center"
                )
            place.margins(x=0.2)
        place.set(title=title, xlabel="relative error of displacements", ylabel="time (ms)")
        place.grid(alpha=0.3)
        place.legend(fontsize=8)
    return figure


def run(cases, _):
    say = Record("work_precision")
    parts = net(say, cases), cable(say, cases), fibres(say, cases)
    summary(say, *parts)
    say.close(draw(*parts))
