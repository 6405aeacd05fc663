"""Does the fibre beam agree with OpenSees on an elastic-plastic cantilever, and what does it cost?

Question   A cantilever of 2 m, rectangle 0.1 x 0.2 m in 40 rows of fibres, S235 with 1 % hardening,
           is loaded at its tip to 1.3 times the first yield moment (20 increments) and released
           (5). How far are the tip's displacements, loaded and released, from those of OpenSees'
           `dispBeamColumn` and `forceBeamColumn` (Corotational, Steel01, 5 Gauss-Lobatto points) at
           5 to 40 elements? What do analysis, derivatives and a batch of loads cost?
Reference  `forceBeamColumn` with 160 elements and the same fibres. Control: half the yield moment,
           where nothing yields; there the reference is extrapolated from 80 and 160 elements
           (second order). The derivatives are compared with central differences (relative step
           1e-6).
Error      Distance of the tip's displacement from the reference, mm; difference of jaxcable and
           `dispBeamColumn` at equal number of elements, as a part of the discretisation's: the
           smaller of `dispBeamColumn`'s change from n to 2 n elements, and of its distance from
           `forceBeamColumn` with n.
Command    OPENSEES_PYTHON=... python experiments/opensees_cantilever.py [--times]
           (an interpreter with openseespy, default this one; writes
           experiments/results/opensees_cantilever.txt and .png, and with --times
           opensees_cantilever_times.txt; 5 and 20 minutes, most of it compilation)

In its plane: one row of fibres along the width has no stiffness about the other axis, so that
jaxcable's nodes are held out of the plane (3 unknowns a node); OpenSees has a plane model for this
(2-D), or its model of space is held alike (3-D). In space: 4 rows, 6 unknowns a node.

Times are wall seconds: medians of 15 calls (the batch and steel() 5) and the least of them, each
blocked on completion, in turn with those that they are compared with; a ratio is the median of the
ratios of such pairs. Compile: the first call less the median warm one. Both programs have one core:
NPROC=1 for XLA, because with two threads a batch may wait for ever (jaxlib 0.10.2: its batched
factorisations wait for each other), and OPENBLAS_NUM_THREADS=1, because the threads of LAPACK wait
for each other too, for seconds if something else runs beside them.
"""

import json
import os
import sys
from functools import partial

os.environ |= {"NPROC": "1", "OPENBLAS_NUM_THREADS": "1"}  # before jax and LAPACK are loaded

import jax
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
from benchmarks.measure import Peer, clock
from record import Record

import jaxcable as jc
from jaxcable.scenes.building_blocks import chain_links

LENGTH, WIDTH, HEIGHT = 2.0, 0.1, 0.2
E, YIELD, HARDENING = 210e9, 235e6, 0.01
FIRST_YIELD = YIELD * WIDTH * HEIGHT**2 / 6 / LENGTH  # load, N
LOAD = 1.3 * FIRST_YIELD
POINTS, INCREMENTS = 5, (20, 5)
SIZES, FINEST = (5, 10, 20, 40), 160
CASES = (  # of the times: name, elements, fibres, held in its plane
    ("plane, n = 10, 1 x 40", 10, (1, 40), True),
    ("plane, n = 40, 1 x 40", 40, (1, 40), True),
    ("space, n = 40, 4 x 40", 40, (4, 40), False),
)
CALLS, BATCH = 15, 64

NOTES = """
ratio           jaxcable over OpenSees; batch: a load of it over one alone
and gradient    with respect to width, height, yield stress and load, in reverse mode
error           of the gradient, p du/dp, against central differences, relative to the largest
8 analyses      what the same central differences would take in OpenSees, models built anew (the
                faster of its models): it has no such gradient of the released state, with which
                this could be compared
value, steel()  the same with jc.materials.steel of a traced yield stress: the number of its plastic
                strains is then not known and taken as 3; the others state it as 1"""


class OpenSees(Peer):
    """The peer process; its first answer is its version, or why there is none."""

    def __init__(self):
        super().__init__("OPENSEES_PYTHON", "opensees_cantilever.py")
        hello = json.loads(self.process.stdout.readline() or '{"error": "it does not start"}')
        if "error" in hello:
            sys.exit(
                "The interpreter that OPENSEES_PYTHON names (default: this one) cannot import "
                f"openseespy: {hello['error']}\nNothing was written."
            )
        self.version = hello["version"]

    def __call__(
        self, n, element="dispBeamColumn", load=LOAD, fibres=(1, 40), dimensions=2, stepwise=False
    ):
        """The answer to one case."""
        case = {"length": LENGTH, "width": WIDTH, "height": HEIGHT, "E": E, "yield_stress": YIELD}
        case |= {"hardening": HARDENING, "load": load, "element": element, "n": n}
        case |= {"points": POINTS, "fibres": fibres, "dimensions": dimensions}
        case |= {"increments": INCREMENTS, "stepwise": stepwise}
        answer = self.ask(**case)
        if not answer["ok"]:
            raise RuntimeError(f"OpenSees did not converge: {case}")
        return answer


def steel(yield_stress):
    """`jc.materials.steel` with its one plastic strain stated, so that the stress may be traced."""
    known = jc.materials.steel(YIELD, E, HARDENING)
    end = float(known.strain[-1])
    e = yield_stress / E
    top = yield_stress + HARDENING * E * (end - e)
    stress = [-top, -yield_stress, 0.0, yield_stress, top]
    return jc.Polygonal([-end, -e, 0.0, e, end], stress, "elastic", n_memory=known.n_memory)


def analyse(parameters, n, fibres=(1, 40), plane=True, law=steel):
    """Solution for width, height, yield stress and load; `plane`: held in its plane."""
    width, height, yield_stress, load = parameters
    nodes = np.zeros((n + 1, 3))
    nodes[:, 0] = np.linspace(0, LENGTH, n + 1)
    section = jc.Section.rectangle(width, height, law(yield_stress), fibres)
    held = np.zeros((n + 1, 6), bool)
    held[0] = True
    if plane:
        held[:, [1, 3, 5]] = True
    beams = jc.Beams(chain_links(range(n + 1)), section=section, points=POINTS)
    force = load * jnp.array([0.0, 0.0, -1.0])
    return jc.solve(
        jc.Structure(nodes, beams, jc.Supports(held)),
        [
            jc.Phase(loads=jc.NodalLoads([n], force), increments=INCREMENTS[0]),
            jc.Phase(loads=jc.NodalLoads([n], -force), increments=INCREMENTS[1]),
        ],
    )


def tip_path(n, fibres=(1, 40), plane=True):
    """Function of the load: status, the tip's way, m, after every increment, and iterations."""

    def run(load):
        solution = analyse((WIDTH, HEIGHT, YIELD, load), n, fibres, plane)
        down, up = solution.phases
        path = jnp.concatenate([p.path.displacement[:, n, 2] for p in (down, up)])
        return solution.status, path, [jnp.sum(p.path.iterations) for p in (down, up)]

    return run


def checked(result):
    """The tip's way and the iterations of a `tip_path`; an error if it failed."""
    status, path, iterations = result
    if np.any(status):
        raise RuntimeError(f"jaxcable failed: status {np.max(status)}")
    return np.asarray(path), [int(np.sum(i)) for i in iterations]


# --- accuracy


def deflections(opensees, solvers, load):
    """Loaded and released tip, mm, [2], by program and number of elements."""
    ends = [INCREMENTS[0] - 1, -1]
    found = {"jaxcable": {n: 1e3 * checked(f(load))[0][ends] for n, f in solvers.items()}}
    for name in ("disp", "force"):
        found[name] = {
            n: 1e3 * np.array(opensees(n, name + "BeamColumn", load)["tip"])
            for n in (*SIZES, FINEST // 2, FINEST)
        }
    return found


def print_accuracy(found, reference, which, say):
    """A table: displacements, distances from the reference; returns these by program."""
    names = ("jaxcable", "disp", "force")
    say(f"{'':3}{'tip, mm':>28}{'distance from the reference, mm':>47}{'jaxcable':>15}", end="")
    say(f"{'disp':>10}{'disp':>9}{'part of':>11}")
    say("  n" + "".join(f"{name:>14}" for name in names), end="")
    say("".join(f"{name:>11}" for name in names), end="")
    say(f"{'- disp':>13}{'n to 2n':>11}{'- force':>10}{'smaller':>10}")
    errors, parts = {name: [] for name in (*names, "jaxcable - disp")}, []
    for n in SIZES:
        value = {name: found[name][n][which] for name in names}
        apart = abs(value["jaxcable"] - value["disp"])
        change = abs(found["disp"][2 * n][which] - value["disp"])
        methods = abs(value["force"] - value["disp"])
        # while nothing yields, both of OpenSees' elements are the same
        parts.append(apart / (min(change, methods) if methods > 1e-6 * change else change))
        for name in names:
            errors[name].append(abs(value[name] - reference[which]))
        errors["jaxcable - disp"].append(apart)
        say(f"{n:3}" + "".join(f"{value[name]:14.8f}" for name in names), end="")
        say("".join(f"{errors[name][-1]:11.1e}" for name in names), end="")
        say(f"{apart:13.1e}{change:11.1e}{methods:10.1e}{parts[-1]:10.1e}")
    orders = {name: np.log2(np.array(e[:-1]) / e[1:]) for name, e in errors.items()}
    for name in orders:
        say(f"order of {name:16}" + ", ".join(f"{order:5.2f}" for order in orders[name]))
    within = "within" if max(parts) <= 1 else "beyond"
    say(f"jaxcable - disp is {within} the difference of the discretisations at every n: ", end="")
    say(f"{min(parts):.2g} to {max(parts):.2g} of it")
    return errors


# --- times


def timed(functions, calls=CALLS):
    """Call some functions in turn: their values, and wall seconds [1 + calls, n].

    The first row is that of the first calls, which compile.
    """
    turns = [[clock(function) for function in functions] for _ in range(1 + calls)]
    wall = [[seconds for seconds, _ in turn] for turn in turns]
    return [result for _, result in turns[-1]], np.array(wall)


def print_times(opensees, say):
    """Analysis: jaxcable and OpenSees in turn."""
    say(f"{'':24}{'jaxcable, ms':>16}{'compile':>10}", end="")
    say("".join(f"{f'OpenSees {d}-D, ms':>26}{'ratio':>10}" for d in (2, 3)))
    say(f"{'loaded and released':24}{'median':>8}{'least':>8}{'s':>10}", end="")
    say(2 * f"{'median':>10}{'least':>8}{'+ model':>8}{'':>10}")
    analysis = {}
    for name, n, fibres, plane in CASES:
        kinds = (2, 3) if plane else (3,)
        run = jax.jit(tip_path(n, fibres, plane))
        answers = {k: [] for k in kinds}

        def ask(k, n=n, fibres=fibres, answers=answers):
            answers[k].append(opensees(n, fibres=fibres, dimensions=k))

        values, wall = timed([partial(run, LOAD), *(partial(ask, k) for k in kinds)])
        checked(values[0])
        own = wall[1:, 0]
        say(f"{name:24}{1e3 * np.median(own):8.1f}{1e3 * own.min():8.1f}", end="")
        say(f"{wall[0, 0] - np.median(own):10.1f}", end="" if plane else " " * 36)
        for k in kinds:
            alone = np.array([a["analyze_s"] for a in answers[k][1:]])
            model = np.median(alone + [a["build_s"] for a in answers[k][1:]])
            say(f"{1e3 * np.median(alone):10.1f}{1e3 * alone.min():8.1f}{1e3 * model:8.1f}", end="")
            say(f"{np.median(own / alone):10.2f}", end="")
            analysis[name] = min(model, analysis.get(name, np.inf))
        say("")
    return analysis


def print_derivatives(analysis, say):
    """Value and gradient of the released tip, and a batch of loads."""
    p = jnp.array([WIDTH, HEIGHT, YIELD, LOAD])
    loads = jnp.linspace(1.0, 1.3, BATCH) * FIRST_YIELD
    say(f"{'':24}{'value':>9}{'and gradient':>19}{'error':>10}{'8 analyses':>14}", end="")
    say(f"{'value, steel()':>17}{'batch of ' + str(BATCH) + ' loads':>24}")
    say(f"{'released tip':24}{'ms':>9}{'ms':>11}{'ratio':>8}{'-':>10}{'OpenSees, ms':>14}", end="")
    say(f"{'ms':>9}{'ratio':>8}{'ms per load':>16}{'to one':>8}")
    notes = []
    for name, n, fibres, plane in CASES:

        def tip(p, law=steel, n=n, fibres=fibres, plane=plane):
            return analyse(p, n, fibres, plane, law).displacement[n, 2]

        def plain(p, tip=tip):
            return tip(p, lambda stress: jc.materials.steel(stress, E, HARDENING))

        one = tip_path(n, fibres, plane)
        value, both = jax.jit(tip), jax.jit(jax.value_and_grad(tip))
        single, batch = jax.jit(one), jax.jit(jax.vmap(lambda load, one=one: one(load)))
        (_, (_, gradient)), wall = timed([partial(value, p), partial(both, p)])
        scaled, step = np.asarray(gradient * p), 1e-6
        difference = [
            float(value(p.at[k].multiply(1 + step)) - value(p.at[k].multiply(1 - step))) / 2 / step
            for k in range(4)
        ]
        error = np.abs(scaled - difference).max() / np.abs(scaled).max()
        _, slow = timed([partial(value, p), partial(jax.jit(plain), p)], 5)
        (last, every), many = timed([partial(single, loads[-1]), partial(batch, loads)], 5)
        same = np.abs(checked(every)[0][-1] - checked(last)[0]).max() / np.abs(last[1]).max()
        warm, each = np.median(wall[1:], axis=0), np.median(many[1:, 1])
        say(f"{name:24}{1e3 * warm[0]:9.1f}{1e3 * warm[1]:11.1f}", end="")
        say(f"{np.median(wall[1:, 1] / wall[1:, 0]):8.2f}", end="")
        say(f"{error:10.1e}{8e3 * analysis[name]:14.1f}", end="")
        say(f"{1e3 * np.median(slow[1:, 1]):9.1f}", end="")
        say(f"{np.median(slow[1:, 1] / slow[1:, 0]):8.2f}", end="")
        say(f"{1e3 * each / BATCH:16.2f}", end="")
        say(f"{np.median(many[1:, 1] / many[1:, 0]) / BATCH:8.2f}")
        text = ", ".join(f"{c:.1f}" for c in (*(wall[0] - warm), many[0, 1] - each))
        notes.append(f"{name}: compile {text} s (value, and gradient, batch);")
        slopes = ", ".join(f"{v:+.5f}" for v in 1e3 * scaled)
        notes.append(f"    p du/dp for p = width, height, yield stress, load: {slopes} mm;")
        notes.append(f"    the batch's last load against that load alone: {same:.1e}")
    say("")
    say("\n".join(notes))


# --- picture


def draw(solver, opensees, errors, control):
    """Load against displacement, and distance from the reference against number of elements."""
    down, up = INCREMENTS
    load = LOAD / 1e3 * np.concatenate([np.arange(down + 1) / down, 1 - np.arange(1, up + 1) / up])
    own = checked(solver(LOAD))[0]
    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4.6), layout="constrained")
    left.plot(-1e3 * np.append(0, own), load, color="C0", label="jaxcable, 10 elements")
    for k, name in enumerate(("dispBeamColumn", "forceBeamColumn")):
        tip = opensees(10, name, stepwise=True)["tip"]
        left.plot(
            -1e3 * np.append(0, tip),
            load,
            "ox"[k],
            color=f"C{k + 1}",
            markersize=(7, 5)[k],
            fillstyle="none",
            label=f"OpenSees {name}, 10 elements",
        )
    left.axhline(FIRST_YIELD / 1e3, color="0.7", linewidth=0.8, zorder=0)
    left.text(0.2, FIRST_YIELD / 1e3, "first yield", color="0.4", va="top", fontsize=9)
    left.set(xlabel="tip displacement downwards (mm)", ylabel="tip load (kN)")
    left.legend(loc="upper left", fontsize=9)
    left.set_ylim(top=120)
    marks = {"jaxcable": "o", "disp": "s", "force": "^", "jaxcable - disp": "d"}
    for k, (name, mark) in enumerate(marks.items()):
        long = {"disp": "dispBeamColumn", "force": "forceBeamColumn"}.get(name, name)
        long = long.replace("- disp", "from dispBeamColumn")
        color = "C3" if "- disp" in name else f"C{k}"
        size = (8, 5, 6, 6)[k]
        for values, line, fill in ((errors, "-", "full"), (control, ":", "none")):
            right.loglog(
                SIZES,
                values[name],
                line + mark,
                color=color,
                fillstyle=fill,
                markersize=size,
                label=long if values is errors else None,
            )
    right.plot([], [], "k-", label="1.3 of the first yield load")
    right.plot([], [], "k:", label="0.5: elastic")
    right.set_xticks(SIZES, [str(n) for n in SIZES])
    right.minorticks_off()
    right.set(xlabel="number of elements", ylabel="distance of the loaded tip (mm)")
    right.set_title(
        f"reference: forceBeamColumn, {FINEST} elements (elastic: extrapolated)", fontsize=10
    )
    right.legend(fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def main():
    opensees = OpenSees()
    say = Record("opensees_cantilever")
    say(f"OpenSees {opensees.version}")
    solvers = {n: jax.jit(tip_path(n)) for n in SIZES}
    found = deflections(opensees, solvers, LOAD)
    control = deflections(opensees, solvers, 0.5 * FIRST_YIELD)
    say(f"\nLoaded to {LOAD / 1e3:.3f} kN, 1.3 of the load of first yield")
    reference = found["force"][FINEST]
    errors = print_accuracy(found, reference, 0, say)
    say("\nReleased")
    print_accuracy(found, reference, 1, say)
    share = {name: errors[name][0] / errors["force"][0] for name in ("jaxcable", "disp")}
    say(
        "The orders scatter in all programs: where the yield front lies among the integration "
        "points changes\nwith n. With "
        f"{SIZES[0]} elements jaxcable is {share['jaxcable']:.1f} times as far as forceBeamColumn, "
        f"dispBeamColumn {share['disp']:.1f} times."
    )
    say(f"\nControl: loaded to {FIRST_YIELD / 2e3:.3f} kN, 0.5 of the load of first yield")
    limit = (4 * control["force"][FINEST] - control["force"][FINEST // 2]) / 3
    elastic = print_accuracy(control, limit, 0, say)
    say(
        "There the difference is OpenSees' own: of second order, its distance from the limit is "
        "4/3 of its\nchange from n to 2 n. jaxcable's element has the shortening of its bent axis, "
        f"OpenSees' have not:\n{elastic['disp'][0] / elastic['jaxcable'][0]:.0f} times nearer at "
        f"n = {SIZES[0]}."
    )
    left = max(abs(control[name][n][1]) for name in control for n in SIZES)
    say(f"Left after release, in all programs, at most {left:.0e} mm.")
    finest = [found["disp"][FINEST] - found["force"][FINEST] for found in (found, control)]
    say(
        f"\nThe reference, forceBeamColumn with {FINEST} elements, is from dispBeamColumn with as "
        f"many:\n{abs(finest[0][0]):.0e} mm loaded, {abs(finest[0][1]):.0e} mm released, "
        f"{abs(finest[1][0]):.0e} mm in the control."
    )
    space = 1e3 * np.array(opensees(SIZES[-1], dimensions=3)["tip"])
    apart = np.abs(space - found["disp"][SIZES[-1]]).max()
    say(f"OpenSees 2-D and 3-D, dispBeamColumn n = {SIZES[-1]}: {apart:.0e} mm apart.")
    own = checked(solvers[10](LOAD))[1]
    peer = opensees(10, stepwise=True)["iterations"]
    say(
        f"Newton iterations at n = 10, loading + release: jaxcable {own[0]} + {own[1]}, "
        f"OpenSees {peer[0]} + {peer[1]}.\n"
    )
    say.close(draw(solvers[10], opensees, errors, elastic))
    if "--times" in sys.argv:
        say = Record("opensees_cantilever_times")
        say(f"OpenSees {opensees.version}")
        analysis = print_times(opensees, say)
        say()
        print_derivatives(analysis, say)
        say(NOTES)
        load = os.getloadavg()[2]
        say(f"\nload average of the machine meanwhile: {load:.1f} (one process is ours)")
        say.close()
    opensees.close()


if __name__ == "__main__":
    main()
