"""What do the scenes with fibre sections and beams do, and how long do they take?

Question   Outcome, iterations and time of the saddle net of 201 links with a 10 x 10 disc section
           (500 + 435 increments, the stress of every fibre at every increment), of the guyed mast
           and of the arch that a net of cables stiffens.
Reference  Global equilibrium of reactions and loads; fibre stresses summed to section forces.
Error      Sum of all forces relative to the largest, and largest difference of the sums relative to
           what the fibres carry, -.
Command    python experiments/beam_scenes.py   (writes experiments/results/beam_scenes.txt, .png)

Times are wall seconds of a call: the first one includes compilation, warm is the median of 5.
"""

import io
import os
import platform
import statistics
import time
from pathlib import Path

import jax
import matplotlib.pyplot as plt
import numpy as np
from record import write

import jaxcable as jc

RESULTS = Path(__file__).parent / "results"


def timed(function, calls=5):
    """Value, seconds of the first call, median of the warm ones."""
    runs = []
    for _ in range(1 + calls):
        begin = time.perf_counter()
        value = jax.block_until_ready(function())
        runs.append(time.perf_counter() - begin)
    return value, runs[0], statistics.median(runs[1:])


def unbalance(solution):
    """Sum of reactions and loads relative to the largest force."""
    forces = np.concatenate([np.asarray(solution.reactions), np.asarray(solution.load)])
    return np.abs(forces.sum(0)).max() / np.abs(forces).max()


def fibre_error(structure, solution, name=None):
    """Fibre stresses summed over the section, against section forces or tensions."""
    groups, stress = structure.elements, jc.fibre_stress(structure, solution.phases[-1])
    group = groups if name is None else groups[name]
    stress = np.asarray(stress if name is None else stress[name])[-1]
    y, z, area = (np.asarray(v) for v in (group.section.y, group.section.z, group.section.area))
    if name is None:
        forces, lever = np.asarray(solution.tension)[:, None], area[:, None]
    else:
        forces = np.asarray(solution.section_forces[name])[..., [0, 4, 5]]
        lever = np.stack([area, area * z, -area * y], axis=-1)
    return (np.abs(stress @ lever - forces) / (np.abs(stress).max() * np.abs(lever).sum(0))).max()


def main():
    jax.config.update("jax_enable_x64", True)
    out = io.StringIO()
    print(
        f"{platform.machine()}, {os.cpu_count()} cores; Python {platform.python_version()}, "
        f"jax {jax.__version__}, numpy {np.__version__}\n",
        file=out,
    )
    header = f"{'scene':14}{'unknowns':>9}{'increments':>12}{'iterations':>12}{'status':>8}"
    header += f"{'first (s)':>11}{'warm (s)':>10}{'forces':>10}{'fibres':>10}"
    print(header, file=out)
    scenes = {
        "saddle net": (jc.scenes.saddle_net(), None),
        "guyed mast": (jc.scenes.guyed_mast(), "mast"),
        "strung arch": (jc.scenes.strung_arch(), "arch"),
    }
    done = {}
    for title, ((structure, phases), name) in scenes.items():
        solution, first, warm = timed(lambda s=structure, p=phases: jc.solve(s, p))
        increments = "+".join(str(phase.increments) for phase in phases)
        iterations = "+".join(str(int(p.path.iterations.sum())) for p in solution.phases)
        unknowns = int((~solution.last.fixed[-1].array).sum())
        print(
            f"{title:14}{unknowns:9d}{increments:>12}{iterations:>12}{int(solution.status):8d}"
            f"{first:11.2f}{warm:10.3f}{unbalance(solution):10.1e}"
            f"{fibre_error(structure, solution, name):10.1e}",
            file=out,
        )
        jc.raise_if_failed(solution)
        done[title] = structure, solution
    structure, solution = done["saddle net"]
    stress, _, warm = timed(lambda: jc.fibre_stress(structure, solution.phases[1]))
    print(
        f"\nsaddle net: fibre stresses {stress.shape} in {warm:.2f} s; "
        f"{float(stress[-1].min()) / 1e6:.1f} to {float(stress[-1].max()) / 1e6:.1f} N/mm2 at the "
        f"end; slack cables: {int(solution.phases[1].path.n_slack[-1])}",
        file=out,
    )
    structure, solution = done["guyed mast"]
    drift = np.asarray(solution.displacement - solution.phases[0].displacement)[:, 0].max()
    stress = np.asarray(jc.fibre_stress(structure, solution.phases[1])["mast"])
    print(
        f"guyed mast: drift {1e3 * drift:.0f} mm; largest fibre stress "
        f"{np.abs(stress).max() / 1e6:.1f} N/mm2 of 355 N/mm2",
        file=out,
    )
    structure, solution = done["strung arch"]
    moved = np.asarray(solution.displacement - solution.phases[0].displacement)
    print(
        f"strung arch: largest deflection {1e3 * np.abs(moved[:, 2]).max():.0f} mm; slack cables "
        f"{int(solution.phases[1].path.n_slack[-1])}",
        file=out,
    )
    write(RESULTS / "beam_scenes.txt", out.getvalue())
    print(out.getvalue(), end="")
    draw(done)


def elevation(axes, structure, solution, beams, cables, magnify):
    """Elevation: after prestress in grey, after loading with magnified displacements."""
    before = np.asarray(solution.phases[0].positions)
    after = before + magnify * (np.asarray(solution.positions) - before)
    for name, width in ((beams, 2.5), (cables, 1.0)):
        for a, b in structure.elements[name].links.array:
            axes.plot(*before[[a, b]][:, [0, 2]].T, color="0.75", linewidth=width)
            axes.plot(
                *after[[a, b]][:, [0, 2]].T,
                color="C0" if name == beams else "C1",
                linewidth=width,
            )
    for label, colour, width in ((beams, "C0", 2.5), (cables, "C1", 1.0)):
        axes.plot([], [], color=colour, linewidth=width, label=label)
    axes.plot([], [], color="0.75", label="after prestress")
    axes.set_aspect("equal")
    axes.set(xlabel="x (m)", ylabel="z (m)", title=f"displacement x {magnify:g}")
    axes.legend(frameon=False, fontsize=8, loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=3)


def draw(done):
    figure, axes = plt.subplots(1, 3, figsize=(14.0, 5.2), layout="constrained")
    elevation(axes[0], *done["guyed mast"], "mast", "guys", 20.0)
    elevation(axes[1], *done["strung arch"], "arch", "net", 20.0)
    structure, solution = done["saddle net"]
    stress = np.asarray(jc.fibre_stress(structure, solution.phases[1]))[:, :, 0] / 1e6
    factor = np.asarray(solution.phases[1].path.load_factor)
    axes[2].plot(factor, stress[:, ::5], color="0.6", linewidth=0.6)
    axes[2].plot(factor, stress.max(1), color="C3", label="largest")
    axes[2].plot(factor, stress.min(1), color="C0", label="smallest")
    axes[2].set(
        xlabel="part of the load (-)",
        ylabel="stress of the fibres (N/mm2)",
        title="saddle net, every fifth cable",
    )
    axes[2].legend(frameon=False)
    write(RESULTS / "beam_scenes.png", figure, dpi=110)


if __name__ == "__main__":
    main()
