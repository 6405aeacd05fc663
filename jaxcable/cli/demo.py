"""``demo``: analyse a published hyperbolic paraboloid net and compare its deflections."""

from __future__ import annotations

import time
from argparse import Namespace

import jax
import numpy as np

from .. import scenes
from ..analysis import solver
from ..common import status
from ..scenes import hypar
from . import outputs

_PICTURE = "hypar_net.png"


def run(options: Namespace) -> None:
    """Analyse the published hypar net, print its deflections beside published ones, plot it."""
    picture = outputs.check_output_file(options.plot, outputs.PICTURES, "--plot", usual=_PICTURE)
    structure, phases = scenes.hypar_net()
    free = hypar.hypar_plan()[2]
    offsets = np.linalg.norm(
        np.asarray(structure.nodes)[free] - hypar.hypar_plan()[0][free], axis=1
    )
    print("Hyperbolic paraboloid net: 31 links, 26 nodes, 12 of them free, EA 100.72 kN")
    print(
        f"  start    the plan with every free node moved (by {1e3 * offsets.min():.0f} to "
        f"{1e3 * offsets.max():.0f} mm): see scenes.hypar.disturbance"
    )
    print("  phase 1  200 N held in every link while the net finds its form, 100 increments")
    print("  phase 2  links anchored at the length reached, 15.7 N on 9 nodes, 10 increments")
    seconds = []
    for _ in range(2):
        begin = time.perf_counter()
        solution = jax.block_until_ready(solver.solve(structure, phases))
        seconds.append(time.perf_counter() - begin)
    print(f"\nstatus    {int(solution.status)}: {status.describe(solution.status)}")
    for number, phase in enumerate(solution.phases, 1):
        path = phase.path
        print(
            f"phase {number}   {int(path.iterations.sum())} Newton iterations in "
            f"{len(path.load_factor)} increments, largest relative residual "
            f"{float(path.relative_residual.max()):.1e}"
        )
    print(f"time      {seconds[1]:.4f} s (first call, with compilation: {seconds[0]:.2f} s)")
    status.raise_if_failed(solution)

    columns = {name: np.array(values) for name, values in hypar.PUBLISHED.items()}
    computed = -1e3 * np.asarray(solution.phases[1].displacement_in_phase)[free, 2]
    names = list(columns)
    print("\nDeflection in phase 2 (mm)")
    print("  " + "  ".join(f"[{k}] {name}" for k, name in enumerate(names[:4], 1)))
    print("  " + "  ".join(f"[{k}] {name}" for k, name in enumerate(names[4:], 5)))
    print("  node  jaxcable" + "".join(f"{f'[{k}]':>8}" for k in range(1, 8)))
    for index, node in enumerate(hypar.NODE_NAMES):
        published = "".join(f"{columns[name][index]:8.2f}" for name in names)
        print(f"  {node:4d}  {computed[index]:8.3f}{published}")
    largest = "".join(f"{np.abs(columns[name] - computed).max():8.2f}" for name in names)
    print(f"  largest difference{largest[2:]}")
    print(
        "The plan of this net is not published; it was identified from these deflections, so the "
        "agreement is no validation."
    )
    from .. import plots  # slow to import: matplotlib

    outputs.save_picture(plots.net(solution, magnify=5.0), picture)
    print(f"\npicture   {picture}")
