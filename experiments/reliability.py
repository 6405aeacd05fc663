"""Do first order, importance sampling and crude samples agree on a cable truss?

Question   A cable truss of 24 m with 12 cables, whose cutting lengths, modulus, snow and suction
           scatter: the probability that its carrying cable exceeds its strength under snow, or that
           it has less than 2 kN under suction. `reliability.first_order`, sampling around its
           design points, and crude Monte Carlo samples.
Reference  The crude samples: each is an analysis of its own, and no limit state is linearized.
Error      Difference of the probabilities over their standard error: within 3 they agree.
Command    python experiments/reliability.py [SAMPLES]
           (1 000 000 crude samples by default; writes experiments/results/reliability.txt)
"""

import sys
import time

import jax
import jax.numpy as jnp
import numpy as np
from record import Record

import jaxcable as jc
from jaxcable.reliability import (
    Gumbel,
    Lognormal,
    Normal,
    Quantities,
    first_order,
    importance_sampling,
    series_system,
)

BAYS, LENGTH, AREA = 6, 24.0, 24.0  # -, m, m2 of roof at each node
PRETENSION, STRENGTH, LEAST = 150e3, 330e3, 2e3  # N
PLACE = np.linspace(0.0, LENGTH, BAYS + 1)
RISE = 2.0 * (1 - (2 * PLACE / LENGTH - 1) ** 2)
NODES = np.array(
    [
        (x, 0.0, z)
        for x, z in [*zip(PLACE, 1.2 - RISE, strict=True), *zip(PLACE, RISE - 1.2, strict=True)]
    ]
)
ROWS = np.array([[k, k + 1] for k in range(BAYS)])
INNER = [*range(1, BAYS), *range(BAYS + 2, 2 * BAYS + 1)]
SUPPORTS = jc.pinned([0, BAYS, BAYS + 1, 2 * BAYS + 1]) + jc.restrained(INNER, "y")
TIES = [[k, k + BAYS + 1] for k in range(1, BAYS)]
QUANTITIES = Quantities(
    {
        "error": Normal(np.zeros(2 * BAYS), 3e-3),  # m
        "modulus": Lognormal(160e9, variation=0.05),  # Pa
        "snow": Gumbel(500.0, variation=0.30),  # Pa
        "suction": Gumbel(450.0, variation=0.25),
    }
)


def analyse(values, load):
    """The truss under a load on its roof, Pa, and its solution."""
    modulus, error = values["modulus"], values["error"]
    elements = {
        "carrying": jc.Cables(ROWS, axial_stiffness=500e-6 * modulus),
        "stabilizing": jc.Cables(ROWS + BAYS + 1, axial_stiffness=300e-6 * modulus),
        "ties": jc.Bars(TIES, axial_stiffness=100e6),
    }
    structure = jc.Structure(NODES, elements, supports=SUPPORTS)
    prestress = {"carrying": PRETENSION, "stabilizing": PRETENSION, "ties": None}
    shortening = {"carrying": -error[:BAYS], "stabilizing": -error[BAYS:], "ties": None}
    down = load * AREA * jnp.array([0.0, 0.0, -1.0])
    loading = jc.Phase(shortening=shortening, loads=jc.NodalLoads(range(1, BAYS), down))
    return structure, jc.solve(structure, [jc.Phase(pretension=prestress), loading])


def margins(values):
    """Limit states: strength under snow, and what is left of the prestress under suction."""
    _, pressed = analyse(values, values["snow"])
    structure, lifted = analyse(values, -values["suction"])
    strain = jc.design.slack_distance(structure, lifted)["carrying"][BAYS // 2 - 1]
    return {
        "rupture": 1.0 - pressed.tension["carrying"][0] / STRENGTH,
        "slack": strain - LEAST / (500e-6 * values["modulus"]),
    }


def seconds(function):
    """Seconds of a call, and what it returns, computed."""
    begin = time.perf_counter()
    found = jax.block_until_ready(function())
    return time.perf_counter() - begin, found


def sampled(record, name, count, center, first):
    """A line of the table for samples."""
    wall, found = seconds(
        lambda: importance_sampling(margins, QUANTITIES, center, samples=count, key=1)
    )
    record(
        f"{name:<22}{count:>9}{found.probability:>12.4e}{found.standard_error:>11.1e}"
        f"{found.n_violated:>9}{found.n_unknown:>9}{wall:>9.1f}"
        f"{(first - found.probability) / found.standard_error:>10.2f}"
    )
    return found


def main(count):
    jc.fuse_loops()
    record = Record("reliability")
    compiled, _ = seconds(lambda: first_order(margins, QUANTITIES))
    wall, found = seconds(lambda: first_order(margins, QUANTITIES))
    record(f"\nFirst order: {wall:.2f} s, the first call {compiled:.1f} s, with compilation\n")
    record(
        "limit state      beta  probability  evaluations  part of lengths, modulus, snow, suction"
    )
    for name in found.limit_states:
        one = found.select_limit_state(name)
        assert one.status == 0, jc.describe(one.status)
        parts = [float(jnp.sum(one.alpha_squared[key])) for key, _ in QUANTITIES.layout]
        record(
            f"{name:<12}{one.beta:>9.4f}{one.probability:>13.4e}{one.evaluations:>13}  "
            + " ".join(f"{part:.4f}" for part in parts)
        )
    system = series_system(found)
    record(f"either: {system.low:.4e} to {system.high:.4e} (first order)\n")
    record(
        "method                  samples  probability   std. error  violated  unknown  seconds  "
        "FORM off by, std. errors"
    )
    importance_sampling(margins, QUANTITIES, found, samples=2048)  # compiles
    near = sampled(record, "around design points", min(20_000, count), found, system.high)
    crude = sampled(record, "crude", count, None, system.high)
    error = np.hypot(near.standard_error, crude.standard_error)
    apart = abs(near.probability - crude.probability) / error
    needed = crude.samples * (crude.variation / near.variation) ** 2
    record(f"\nThe two differ by {apart:.2f} standard errors; for the error of the first one the")
    record(f"crude method needs {needed:.1e} samples")
    if "--try" not in sys.argv:
        record.close()


if __name__ == "__main__":
    numbers = [word for word in sys.argv[1:] if word.isdigit()]
    main(int(numbers[0]) if numbers else 1_000_000)
