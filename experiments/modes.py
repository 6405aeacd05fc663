"""Which kinds of steps lead to equilibrium, and for which scenes is each of them needed?

Question   Newton's method has several kinds of steps: full ones, with predicted forces, with
           tensions as unknowns, of two interior-point methods, with a line search, and uphill. For
           how many increments of every bank and scene did each of them run, and with which one did
           an increment end in equilibrium?
Reference  None: what the iteration does.
Error      None.
Command    python experiments/modes.py [scenes of a kind]   (default 40; writes
           experiments/results/modes.txt; ten minutes)

An increment is counted once for every kind of step that it has taken, and once for the last one. An
increment without any step was in equilibrium at its start.
"""

import collections
import functools
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
from banks import (
    bar_bank,
    contact_bank,
    fuzz_scenes,
    hard_cases,
    net_bank,
    slack_nets,
    unsymmetric_bank,
)
from record import Record

import jaxcable as jc
from jaxcable.equilibrium import iteration
from jaxcable.equilibrium.predicted_forces import is_prediction_step

STEPS = "mixed", "cones", "cones' finish", "bounds", "bounds' finish", "search"
STEPS += "full", "uphill", "predicted", "Newton"
NONE = -1


class Listener:
    """Counts of increments by kinds of steps."""

    def __init__(self):
        self.taken = []
        self.forget()

    def forget(self):
        """Count anew."""
        self.ran, self.ended, self.failed = (collections.Counter() for _ in range(3))
        self.none = 0

    def hear(self, begins, kind, done, code):
        """Note an iteration: whether it is the first one, its kind of step, end and status."""
        if begins:
            self.taken = []
        if not done and kind != NONE:
            self.taken.append(STEPS[int(kind)])
        if not done:
            return
        if not self.taken:
            self.none += 1
            return
        self.ran.update(set(self.taken))
        (self.ended if code == jc.status.OK else self.failed)[self.taken[-1]] += 1


LISTENER = Listener()


def kind_of_step(newton, state):
    """Number of the kind of the step that a state is about to try."""
    strategy, names = state.strategy, {name: k for k, name in enumerate(STEPS)}
    unknowns = strategy.unknowns
    if newton.system.is_net:
        of = "cones" if unknowns.has_cones else "bounds"
        modes = [names["mixed"], names[of], names[f"{of}' finish"], names["search"]]
        return jnp.array(modes)[unknowns.mode]
    kind, full_steps = jnp.int32(names["Newton"]), strategy.full_steps
    if strategy.predicted is not None:
        kind = jnp.where(is_prediction_step(state.steps - 1), names["predicted"], kind)
    if full_steps is not None:
        kind = jnp.where(full_steps.may_go_uphill, names["uphill"], kind)
    if unknowns is not None:
        kind = jnp.where(unknowns.uses_interior_point, names["bounds"], kind)
        kind = jnp.where(unknowns.takes_finishing_steps, names["bounds' finish"], kind)
        kind = jnp.where(unknowns.uses_line_search, names["search"], kind)
    if full_steps is not None:
        kind = jnp.where(full_steps.is_on, names["full"], kind)
    return kind


def listen():
    """Have every iteration tell `LISTENER`."""
    iterate = iteration.NewtonIteration.iterate

    @functools.wraps(iterate)
    def told(self, state):
        after = iterate(self, state)
        kind = jnp.where(after.stays_at_point, NONE, kind_of_step(self, after))
        given = ~state.progress.has_begun, kind, after.done, after.code
        jax.debug.callback(LISTENER.hear, *given)
        return after

    iteration.NewtonIteration.iterate = told


def banks(count):
    """Pairs of a name and functions that solve one scene each."""

    def solved(one):
        return jc.solve(one.structure, one.phases)

    for kind in net_bank.KINDS:
        yield (
            f"net bank, float32: {kind}",
            [
                lambda k=kind, s=seed: solved(net_bank.drawn(k, s, "float32"))
                for seed in range(count)
            ],
        )
    for module in (net_bank, bar_bank, unsymmetric_bank, contact_bank):
        name = module.__name__.removeprefix("banks.").replace("_", " ")
        for kind in module.KINDS:
            yield (
                f"{name}: {kind}",
                [lambda k=kind, s=seed, m=module: solved(m.drawn(k, s)) for seed in range(count)],
            )
    for kind in slack_nets.KINDS:
        yield (
            f"slack nets: {kind}",
            [
                lambda k=kind, r=ratio: jc.solve(*slack_nets.scene(k, 12, r))
                for ratio in (None, 1e2, 1e4, 1e6)
            ],
        )
    for family in fuzz_scenes.FAMILIES:
        rng = np.random.default_rng(1)
        recipes = [fuzz_scenes.random_recipe(rng, [family], ["float64"]) for _ in range(count)]
        yield (
            f"fuzz: {family}",
            [lambda recipe=recipe: fuzz_scenes.outcome(recipe) for recipe in recipes],
        )
    for dtype in "float64", "float32":
        yield (
            f"hard cases, {dtype}",
            [lambda c=case, d=dtype: c.build(True, d).solve() for case in hard_cases.CASES],
        )
    yield "ready scenes", [lambda k=kind: jc.solve(*made(k)) for kind in scenes.EVERY]


def made(kind):
    """The ready scene of a name."""
    return scenes.EVERY[kind](*((6, 8) if kind == "saddle" else ()))


def main():
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 40
    say = Record("modes")
    jc.evaluation("numpy")  # each step as it is taken
    warnings.simplefilter("ignore")  # of scenes that are doubtful on purpose
    listen()
    width = 30
    say(f"{count} scenes of a kind. For each kind of step: increments that took some / ended OK")
    say("with one; failed: increments that did not end OK; none: in equilibrium at the start\n")
    say(f"{'':{width}}" + "".join(f"{name:>15}" for name in STEPS) + f"{'none':>7}{'failed':>7}")
    total = Listener()
    for name, solves in banks(count):
        LISTENER.forget()
        for solve in solves:
            solve()
        jc.forget_programs()
        row = "".join(
            f"{LISTENER.ran[step]:9d} /{LISTENER.ended[step]:4d}"
            if LISTENER.ran[step]
            else " " * 15
            for step in STEPS
        )
        say(f"{name:{width}}{row}{LISTENER.none:7d}{sum(LISTENER.failed.values()):7d}")
        total.ran.update(LISTENER.ran)
        total.ended.update(LISTENER.ended)
    say(f"\n{'all':{width}}" + "".join(f"{total.ran[s]:9d} /{total.ended[s]:4d}" for s in STEPS))
    say.close()


if __name__ == "__main__":
    main()
