"""How long do seven jobs of an office take, each from an empty process to its last result?

Question   Seconds of whole processes: a footbridge built in stages and
           levelled, a guyed mast under eight winds and to failure, a spoked wheel with spokes cut
           inexactly, a net roof from its form to its report, a line of catenaries, a study of
           pretensions, and seven commands of the command line.
Reference  A bare analysis of a net of 48 unknowns in the same run (`benchmarks/bare.py`): its first
           call is the unit Y. An older checkout, by turns, if OTHER_CHECKOUT names its folder.
Error      None; each job prints a result, and the file says how far those of two checkouts differ.
Command    python experiments/office_jobs.py [JOB ...]   (five minutes, twenty with another
           checkout; writes results/office_jobs.txt)
"""

import ast
import inspect
import os
import statistics
import subprocess
import sys
import tempfile
import textwrap
import time
from pathlib import Path

from benchmarks.measure import bare
from record import ROOT, Record

START = """
import jax, numpy as np, jax.numpy as jnp
jax.config.update("jax_enable_x64", True)
import jaxcable as jc
"""


def bridge(jax, jnp, np, jc):
    """Analyse the stages of a footbridge, report them, level the deck by its hangers, its modes."""
    structure, phases = jc.scenes.suspension_footbridge(10)
    solution = jc.solve(structure, phases)
    Path("stages.txt").write_text(str(jc.report(structure, solution)), encoding="utf-8")
    turned = dict.fromkeys(structure.elements) | {"hangers": np.zeros(9)}
    phases[-1] = jc.replace(phases[-1], shortening=turned)
    level = jc.design.Target("positions", 0.0, at=(np.arange(16, 25), 2), within=1e-4)
    tuned = jc.design.tune(structure, phases, [(len(phases) - 1, "shortening")], level)
    modes = jc.dynamics.modes(structure, tuned.solution, masses=500.0)
    return *tuned.values[0]["hangers"], *modes.frequency[:3]


def mast(jax, jnp, np, jc):
    """Analyse a mast under eight winds, its buckling factor, its path to failure, a derivative."""
    structure, (prestress, wind) = jc.scenes.guyed_mast()
    standing = jc.solve(structure, prestress)
    force, nodes = np.linalg.norm(wind.loads.forces, axis=1), wind.loads.nodes

    def top(angle, stiffness=1.0):
        turned = jnp.stack([jnp.cos(angle), jnp.sin(angle), 0.0 * angle])
        loads = jc.NodalLoads(nodes, stiffness * force[:, None] * turned)
        return jc.solve(structure, jc.Phase(loads=loads, increments=10), start=standing)

    tops = [float(jnp.hypot(*top(a).displacement[12, :2])) for a in np.arange(8) * np.pi / 4]
    slope = jax.grad(lambda s: top(np.array(0.0), s).displacement[12, 0])(1.0)
    path = jc.trace_path(structure, [prestress, wind])
    return *tops, slope, path.load_factor[-1]


def wheel(jax, jnp, np, jc):
    """Erect a spoked wheel, optimize the pretension, try a hundred sets of inexact spokes."""
    import optax

    structure, phases = jc.scenes.roof_ring(24)
    erected = jc.solve(structure, phases)
    nothing, rng = dict.fromkeys(structure.elements), np.random.default_rng(1)

    def built(error):
        late = jc.Phase(shortening={**nothing, "upper": -error[0], "lower": -error[1]})
        solution = jc.solve(structure, [*phases[:-1], late, phases[-1]])
        return solution.tension["lower"]

    def loss(shortening):
        late = jc.Phase(shortening={**nothing, "lower": jnp.full(24, 0.01 * shortening)})
        solution = jc.solve(structure, [*phases[:-1], late, phases[-1]])
        return (solution.positions[-1, 2] - 0.1) ** 2 + (5e-8 * solution.tension["lower"][0]) ** 2

    forces = jc.batched(built)(rng.uniform(-0.01, 0.01, (100, 2, 24)))
    design = jc.minimize(loss, 0.0, optimizer=optax.adam(0.3), steps=15)
    return erected.positions[-1, 2], forces.max(), forces.min(), design.params


def roof(jax, jnp, np, jc):
    """Find the form of a net with edge cables, load it by snow and wind, report and draw it."""
    structure, _ = jc.scenes.saddle(8, 8, spacing=2.0)
    group = jc.Cables(structure.elements.links, axial_stiffness=2e7, strength=2e5)
    structure = jc.replace(structure, elements=group)
    form = jc.find_form(structure, 20e3)
    formed = jc.replace(structure, nodes=form.positions)
    prestress = jc.Phase(rest_length=form.rest_length)
    free = np.arange(structure.n_node)[np.abs(structure.nodes[:, :2] - 9.0).max(1) < 8.9]
    cases = [jc.NodalLoads(free, f) for f in ((0.0, 0.0, -3e3), (500.0, 0.0, 1.5e3))]

    def height(T):
        loaded = jc.Phase(loads=cases[0], increments=5)
        solution = jc.solve(formed, [jc.Phase(pretension=T), loaded])
        return solution.displacement[:, 2].min(), solution

    found = [jc.solve(formed, [prestress, jc.Phase(loads=c, increments=5)]) for c in cases]
    slope, _ = jax.grad(height, has_aux=True)(20e3)
    Path("roof.txt").write_text(str(jc.report(formed, found[0])), encoding="utf-8")
    jc.plots.net(found[0], structure=formed).savefig("roof.png")
    return form.positions[:, 2].sum(), *(s.tension.max() for s in found), slope


def line(jax, jnp, np, jc):
    """String a line of three spans, its states from cold to hot, derivatives of sags, failure."""
    nodes = [[0.0, 0.0, 20.0], [300.0, 0.0, 32.0], [650.0, 0.0, 25.0], [950.0, 0.0, 20.0]]
    conductor = {"axial_stiffness": 33e6, "weight": 16.0, "expansion": 19e-6, "strength": 140e3}
    spans = jc.Catenaries([[0, 1], [1, 2], [2, 3]], **conductor)
    structure = jc.Structure(nodes, spans, supports=jc.pinned([0, 1, 2, 3]))
    strung = jc.solve(structure, jc.Phase(sag=np.array([8.0, 11.0, 8.0]), loads=jc.SelfWeight()))

    def state(temperature, ice):
        loads = jc.LineLoads(ice * jnp.array([0.0, 0.3, -1.0]))
        later = jc.Phase(temperature=temperature, loads=loads)
        return jc.solve(structure, later, start=strung).tension

    warm = np.linspace(-20.0, 60.0, 9)
    tensions = jax.vmap(state)(warm, np.linspace(10.0, 0.0, 9))
    return *tensions[:, 1], *jax.jacfwd(state)(20.0, 0.0)


def study(jax, jnp, np, jc):
    """Solve a net for 64 pretensions with gradients, its influence matrix, and fit pretensions."""
    structure, (prestress, loading) = jc.scenes.saddle(4, 4, spacing=2.0)

    def solve(T):
        phases = [jc.replace(prestress, pretension=T), loading]
        return jc.solve(structure, phases)

    def lowest(T):
        return solve(T).displacement[:, 2].min()

    values, slopes = jax.vmap(jax.value_and_grad(lowest))(np.linspace(5e3, 40e3, 64))
    matrix = jc.influence(structure, [prestress, loading], wrt="pretension")
    wanted = np.asarray(solve(21e3).tension)
    given = np.full(len(structure.elements.links), 20e3)
    fitted = jc.fit(lambda T: 1e-3 * (solve(T).tension - wanted), given)
    return values[0], values[-1], slopes[0], np.abs(matrix).max(), fitted.params.mean()


def command_line(jax, jnp, np, jc):
    """Write two scenes, and inspect, solve, report, draw, form and optimize them by commands."""
    for words in (
        "new bridge",
        "info bridge.json",
        "solve bridge.json --report bridge.txt --save bridge.vtk",
        "plot bridge.json --save bridge.png",
        "new net",
        "form net.json --force-density 500 --save formed.json",
        "optimize net.json --deflection 0.05 --save tuned.json",
    ):
        command = [sys.executable, "-m", "jaxcable", *words.split()]
        subprocess.run(command, check=True, capture_output=True)
    return (float(Path("tuned.json").stat().st_size > 0),)


JOBS = {job.__name__: job for job in (bridge, mast, wheel, roof, line, study, command_line)}


def seconds_and_results(job, checkout):
    """Run a job in a new process with the package of a checkout; its seconds and its numbers."""
    body = textwrap.dedent("".join(inspect.getsourcelines(job)[0][1:]))
    source = "import subprocess, sys\nfrom pathlib import Path\n" + START
    source += f"def job():\n{textwrap.indent(body, '    ')}\nprint([float(x) for x in job()])\n"
    environment = os.environ | {"PYTHONPATH": str(checkout), "OPENBLAS_NUM_THREADS": "1"}
    environment.pop("JAX_COMPILATION_CACHE_DIR", None)
    with tempfile.TemporaryDirectory() as folder:
        environment["XDG_CACHE_HOME"] = folder
        begin = time.perf_counter()
        run = subprocess.run(
            [sys.executable, "-W", "ignore", "-c", source],
            cwd=folder,
            env=environment,
            capture_output=True,
            text=True,
        )
        seconds = time.perf_counter() - begin
    if run.returncode:
        raise SystemExit(f"{job.__name__}: {run.stderr[-2000:]}")
    return seconds, ast.literal_eval(run.stdout.strip().splitlines()[-1])


def main(names):
    say, other = Record("office_jobs"), os.environ.get("OTHER_CHECKOUT")
    checkouts = [ROOT, other] if other else [ROOT]
    say("\nSeconds of whole processes (in Y), the largest relative difference of results\n")
    totals, units = [0.0] * len(checkouts), []
    for name in names or JOBS:
        units.append(bare())
        found = [seconds_and_results(JOBS[name], checkout) for checkout in checkouts]
        cells = [f"{seconds:8.1f} ({seconds / units[-1]:6.1f})" for seconds, _ in found]
        totals = [a + b for a, (b, _) in zip(totals, found, strict=True)]
        if other:
            pairs = zip(*(numbers for _, numbers in found), strict=True)
            cells.append(f"{max(abs(a - b) / (abs(b) + 1e-12) for a, b in pairs):10.0e}")
        say(f"{name:14}" + "".join(cells))
    unit = statistics.mean(units)
    say(f"{'all':14}" + "".join(f"{total:8.1f} ({total / unit:6.1f})" for total in totals))
    say(
        f"\nY {unit:.2f} s; the second column is the checkout that OTHER_CHECKOUT names"
        * bool(other)
    )
    say.close()


if __name__ == "__main__":
    main(sys.argv[1:])
