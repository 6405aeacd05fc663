"""What does a step of a motion cost when 100 wind histories are one batch?

Question   A prestressed net of cables with 300 unknowns in 100 turbulent winds, from as many random
           keys: how long do a step and a case take in a batch (`jax.vmap`), and one history alone?
           Are the displacements the same?
Reference  The same histories one by one.
Error      Largest difference of a displacement in any step, m.
Command    python experiments/gust_batch.py [cases] [steps]
           (default 100 and 20; writes experiments/results/gust_batch.txt; a minute)

Times are wall seconds of calls after the first one, compiled; one core.
"""

import os
import sys

os.environ |= {"NPROC": "1", "OPENBLAS_NUM_THREADS": "1"}

import jax
import numpy as np
from benchmarks.measure import timed
from opensees_motion import problem
from record import Record

import jaxcable as jc

DT = 0.02  # s
WIND = jc.dynamics.Turbulence(jc.WindTable(velocities=25.0), 4.0, 120.0)


def main():
    words = sys.argv[1:]
    cases, steps = (int(word) for word in (words + ["100", "20"][len(words) :]))
    data = problem(10, steps)
    cables = jc.Cables(
        data["links"], axial_stiffness=data["stiffness"], rest_length=data["rest_length"]
    )
    structure = jc.Structure(data["nodes"], cables, supports=jc.pinned(data["fixed"]))
    still = jc.solve(structure, jc.Phase())
    jc.raise_if_failed(still)
    mean = np.where(data["masses"][:, None] > 0, [20.0, 0.0, 5.0], 0.0)  # N
    damping = jc.dynamics.Rayleigh(0.5, 0.0)

    def histories(key):
        options = {"dt": DT, "steps": steps, "key": key}
        return jc.dynamics.wind_forces(WIND, data["nodes"], mean, **options)

    def motion(forces):
        moved = jc.dynamics.transient(
            *(structure, forces),
            start=still,
            dt=DT,
            steps=steps,
            masses=data["masses"],
            damping=damping,
            histories=["displacement"],
        )
        return moved.displacement, moved.status

    record = Record("gust_batch")
    with jc.evaluation("xla"):
        keys = jax.random.split(jax.random.key(0), cases)
        forces = jax.jit(jax.vmap(histories))(keys)
        alone, batch = jax.jit(motion), jax.jit(jax.vmap(motion))
        (_, code), _, single = timed(alone, forces[0], calls=3)
        (every, codes), first, whole = timed(batch, forces, calls=1)
    assert int(code) == 0 and (np.asarray(codes) == 0).all()
    apart = max(
        np.abs(np.asarray(alone(forces[k])[0]) - every[k]).max() for k in (0, cases // 2, cases - 1)
    )
    each = 1e6 / steps
    record(f"{cases} histories of {steps} steps of {DT} s, 300 unknowns")
    record("         us a step and case   first call")
    record(f"batch    {each * whole[0] / cases:12.0f} {first:17.1f} s")
    record(f"alone    {each * single[0]:12.0f}")
    record(f"ratio    {whole[0] / cases / single[0]:12.2f}")
    peak = np.abs(np.asarray(every)).max(axis=(1, 2, 3))
    record(f"largest  {peak.mean():.3f} m, from {peak.min():.3f} to {peak.max():.3f} m")
    record(f"apart    {apart:.1e} m")
    record(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")
    assert apart < 1e-9
    record.close()


if __name__ == "__main__":
    main()
