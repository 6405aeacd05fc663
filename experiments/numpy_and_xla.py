"""Do NumPy and XLA find the same results?

Question   Random scenes of ten families, in both precisions, solved by programs that NumPy
           evaluates and by compiled ones; ready scenes under transformations of jax: do status and
           iterations agree, and how far apart are the results?
Reference  The compiled programs, of the same equations: only rounding may differ.
Error      Largest difference of displacements and tensions (of values, derivatives or cases) over
           the largest of them. Random scenes have numbers over many orders of magnitude; beside it
           is how far results move when each coordinate is changed by a rounding.
Command    python experiments/numpy_and_xla.py [count] [scene ...]   (default 2600 and small ready
           scenes; writes experiments/results/numpy_and_xla.txt; half an hour)
"""

import collections
import os
import sys
import warnings
from pathlib import Path

os.environ["OPENBLAS_NUM_THREADS"] = "1"
sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))

import jax
import jax.numpy as jnp
import numpy as np
import scenes
from banks.fuzz_scenes import FAMILIES, build, random_recipe
from record import Record

import jaxcable as jc

jax.config.update("jax_disable_most_optimizations", True)  # each program runs a few times

SMALL = "flat_net", "isolated_cable", "suspended_cable", "geiger_dome", "strung_arch"


def by_both(function):
    """Return what a function returns by NumPy and by XLA."""
    found = []
    for way in ("numpy", "xla"):
        with jc.evaluation(way):
            found.append(jax.tree.map(np.asarray, function()))
    return found


def apart(ours, theirs):
    """Largest difference of arrays over the largest entry; infinite if NaN are elsewhere."""
    worst = 0.0
    for a, b in zip(jax.tree.leaves(ours), jax.tree.leaves(theirs), strict=True):
        if (np.isnan(a) != np.isnan(b)).any():
            return np.inf
        some = ~np.isnan(b)
        difference = np.abs(a - b)[some].max(initial=0.0)
        worst = max(worst, difference / max(np.abs(b[some]).max(initial=0.0), 1e-300))
    return worst


def rounded(scene, rng):
    """Return a scene whose coordinates are changed by a rounding each."""
    structure, phases = scene
    nodes = np.asarray(structure.nodes)
    change = rng.choice([-1, 0, 1], nodes.shape) * np.finfo(nodes.dtype).eps
    return jc.replace(structure, nodes=nodes * (1 + change).astype(nodes.dtype)), phases


def end(solution):
    """Return what is compared of a solution: at the last increment that has converged."""
    return jax.tree.map(np.asarray, (solution.last.displacement, solution.last.tension))


def steps(solution):
    """Return the iterations of every increment."""
    return [np.asarray(phase.path.iterations).tolist() for phase in solution.phases]


def of_random_scenes(record, count, seed=1):
    """Solve random scenes by both; record how many differ, and by how much."""
    rng = np.random.default_rng(seed)
    kinds = [(family, dtype) for family in FAMILIES for dtype in ("float64", "float32")]
    record("random scenes: solved, failed; other status, other iterations; apart, median, by both")
    record("and by a rounding of the coordinates; apart by more than 1e-12 and 100 such roundings")
    for family, dtype in kinds:
        counts, differences = collections.Counter(), []
        for _ in range(count // len(kinds)):
            try:
                scene = build(random_recipe(rng, [family], [dtype]))
                ours, theirs = by_both(lambda scene=scene: jc.solve(*scene))
            except ValueError:  # numbers that a scene must not have
                continue
            counts["solved" if ours.status == 0 else "failed"] += 1
            if ours.status != theirs.status:
                counts["status"] += 1
                continue
            counts["steps"] += steps(ours) != steps(theirs)
            if ours.status == 0:
                with jc.evaluation("xla"):
                    near = jc.solve(*rounded(scene, rng))
                pair = apart(end(ours), end(theirs)), apart(end(near), end(theirs))
                differences.append(pair)
                counts["beyond"] += pair[0] > max(1e-12, 100 * pair[1])
        jax.clear_caches()
        jc.forget_programs()
        record(
            f"{family:12s}{dtype:12s}{counts['solved']:6}{counts['failed']:6}{counts['status']:6}"
            f"{counts['steps']:6}   {np.median(differences, axis=0)}{counts['beyond']:6}"
        )


def transformed(scene):
    """Return functions of no arguments: a scene under each transformation of jax."""
    structure, phases = scene
    nodes = np.asarray(structure.nodes)
    way = np.random.default_rng(0).normal(size=nodes.shape)

    def displacement(factor):
        return jc.solve(jc.replace(structure, nodes=nodes * factor), phases).displacement

    def square(x):
        found = jc.solve(jc.replace(structure, nodes=x), phases)
        return jnp.sum(found.displacement**2)

    factors = np.array([0.99, 1.0, 1.01])
    return {
        "value": lambda: jc.solve(structure, phases).displacement,
        "grad": lambda: jax.grad(square)(nodes),
        "jvp": lambda: jax.jvp(square, (nodes,), (way,)),
        "hessian": lambda: jax.hessian(lambda f: jnp.sum(displacement(f) ** 2))(1.0),
        "vmap": lambda: jax.vmap(displacement)(factors),
        "vmap of grad": lambda: jax.vmap(jax.grad(lambda f: square(nodes * f)))(factors),
    }


def main(count=2600, *names):
    np.set_printoptions(formatter={"float": "{:.1e}".format})
    warnings.simplefilter("ignore", jc.InputWarning)  # numbers are of any size
    record = Record("numpy_and_xla")
    record("\nready scenes: results apart")
    for name in names or SMALL:
        for kind, function in transformed(scenes.EVERY[name]()).items():
            record(f"{name:20s}{kind:14s}{apart(*by_both(function)):.1e}")
        jax.clear_caches()
        jc.forget_programs()
    record()
    of_random_scenes(record, int(count))
    record.close()


if __name__ == "__main__":
    main(*sys.argv[1:])
