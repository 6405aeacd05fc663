"""Command line: ``python -m jaxcable demo``."""

import argparse
import sys
import time

import jax
import numpy as np


def main(arguments=None):
    """Run the command line; returns the exit status."""
    parser = argparse.ArgumentParser(prog="jaxcable", description="Prestressed cable structures.")
    commands = parser.add_subparsers(dest="command", required=True)
    demo_parser = commands.add_parser(
        "demo", help="the hyperbolic paraboloid net beside the published deflections"
    )
    demo_parser.add_argument("--plot", default="hypar_net.png", help="picture to write (PNG)")
    options = parser.parse_args(arguments)
    return demo(options.plot)


def demo(plot):
    """Prestress and load the hyperbolic paraboloid net, print its table, write its picture."""
    jax.config.update("jax_enable_x64", True)
    import jaxcable as jc
    from jaxcable.scenes import hypar

    structure, phases = jc.scenes.hypar_net()
    free = hypar.plan()[2]
    off = np.linalg.norm(np.asarray(structure.nodes)[free] - hypar.plan()[0][free], axis=1)
    print("Hyperbolic paraboloid net: 31 links, 26 nodes, 12 of them free, EA 100.72 kN")
    print(
        f"  start    the plan with every free node moved (by {1e3 * off.min():.0f} to "
        f"{1e3 * off.max():.0f} mm): see scenes.hypar.disturbance"
    )
    print("  phase 1  200 N held in every link while the net finds its form, 100 increments")
    print("  phase 2  links anchored at the length reached, 15.7 N on 9 nodes, 10 increments")
    seconds = []
    for _ in range(2):
        begin = time.perf_counter()
        solution = jax.block_until_ready(jc.solve(structure, phases))
        seconds.append(time.perf_counter() - begin)
    print(f"\nstatus    {int(solution.status)}: {jc.describe(solution.status)}")
    for number, phase in enumerate(solution.phases, 1):
        path = phase.path
        print(
            f"phase {number}   {int(path.iterations.sum())} Newton iterations in "
            f"{len(path.load_factor)} increments, largest residual {float(path.residual.max()):.1e}"
            f" N ({float(path.relative_residual.max()):.1e} of the largest nodal force)"
        )
    print(f"time      {seconds[1]:.4f} s (first call, with compilation: {seconds[0]:.2f} s)")
    if int(solution.status) != 0:
        jc.raise_if_failed(solution)

    columns = {name: np.array(values) for name, values in hypar.PUBLISHED.items()}
    computed = -1e3 * np.asarray(solution.phases[1].displacement)[free, 2]
    names = list(columns)
    print("\nDeflection in phase 2 (mm)")
    print("  " + "  ".join(f"[{k}] {name}" for k, name in enumerate(names[:4], 1)))
    print("  " + "  ".join(f"[{k}] {name}" for k, name in enumerate(names[4:], 5)))
    print("  node  jaxcable" + "".join(f"{f'[{k}]':>8}" for k in range(1, 8)))
    for row, node in enumerate(hypar.NODE_NAMES):
        published = "".join(f"{columns[name][row]:8.2f}" for name in names)
        print(f"  {node:4d}  {computed[row]:8.3f}{published}")
    largest = "".join(f"{np.abs(columns[name] - computed).max():8.2f}" for name in names)
    print(f"  largest difference{largest[2:]}")
    print(
        "The plan of this net is not published; it was identified from these deflections, so the "
        "agreement is no validation."
    )
    import matplotlib

    matplotlib.use("Agg")
    jc.plots.net(solution, plot, magnify=5.0)
    print(f"\npicture   {plot}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
