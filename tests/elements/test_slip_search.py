"""The search for slips fulfils Coulomb's conditions, for random cables and jacks."""

import itertools

import jax.numpy as jnp
import numpy as np
import pytest

import jaxcable as jc
from jaxcable.common.tree import copy_with
from jaxcable.elements import friction
from jaxcable.elements.friction_cables import FrictionCables
from jaxcable.elements.slip_search import Jack


def draw(random, count, n):
    """Stiffnesses from 1e2 to 1e11 N, strains of either sign from 1e-8, bounds from 1e-7 to 3."""
    stiffness = 10 ** random.uniform(2, 11, count)
    length = random.uniform(0.1, 30.0, (count, n))
    spread = 10 ** random.uniform(-8, -1.5, (count, 1))
    strain = random.normal(0.0, 1.0, (count, n)) * spread
    strain += 10 ** random.uniform(-8, -2, (count, 1)) * (random.random((count, 1)) < 0.7)
    bound = random.uniform(0.0, 3.0, (count, n - 1)) * 10 ** random.uniform(-6, 0, (count, 1))
    bound[random.random(bound.shape) < 0.1] = 0.0
    clamped = (random.random(bound.shape) < 0.1) & (random.random((count, 1)) < 0.3)
    force = stiffness * 10 ** random.uniform(-8, -2, count)
    return stiffness, length, length * strain / (1 + strain), bound, clamped, force


def violation(cable, tension, has_jack):
    """The largest violation of the conditions of one cable, over length, tension or ratio.

    Written apart from the package: slips are what the segments behind a deviator have gained.
    """
    stiffness, length, stuck, bound, clamped, force = cable
    strain = tension / stiffness
    gained = stuck - length * strain / (1 + strain)
    at_clamps = np.flatnonzero(clamped) + 1
    worst = 0.0
    for part in np.split(np.arange(len(tension)), at_clamps):
        pulled = has_jack and part[0] == 0
        if pulled:
            worst = max(worst, abs(tension[0] / force - 1))
        elif (tension[part] == 0).all():  # slack: too long, even without any tension
            worst = max(worst, gained[part].sum() / length.sum())
            continue
        else:
            worst = max(worst, abs(gained[part].sum()) / length.sum())
        assert (tension[part] > 0).all()
        for before, after in itertools.pairwise(part):
            slip = gained[part[part >= after]].sum()
            used, allowed = np.log(tension[after] / tension[before]), bound[before]
            worst = max(worst, abs(used) - allowed)
            if abs(slip) > 1e-11 * length.sum():
                worst = max(worst, abs(used - np.sign(slip) * allowed))
    return worst


@pytest.mark.slow_cases("12-anchored", "5-jacked", "12-jacked")
@pytest.mark.parametrize("has_jack", [False, True], ids=["anchored", "jacked"])
@pytest.mark.parametrize("n", [2, 5, 12])
def test_tensions_and_slips_fulfil_coulombs_conditions(n, has_jack):
    """Lengths and ratios of tensions are right to 1e-11: rounding of sums of a dozen numbers.

    Of 1 000 cables one to three were wrong before brackets shrank, and near the reach of a jack.
    """
    group = FrictionCables([list(range(n + 1))], axial_stiffness=1.0, friction=0.1)

    def tensions(stiffness, length, stuck, bound, clamped, force):
        cable = copy_with(group, axial_stiffness=stiffness)
        jack = Jack(force, jnp.ones((), bool), jnp.zeros((), bool)) if has_jack else None
        segments = friction.StraightSegments(cable, length, stuck, bound, clamped, jack)
        return friction.segment_tensions(segments).tension

    drawn = draw(np.random.default_rng(n), 1000, n)
    found = np.asarray(jc.batched(lambda case: tensions(*case), chunk=1000)(drawn))
    assert np.isfinite(found).all()
    cables = zip(*drawn, strict=True)
    worst = [violation(*pair, has_jack) for pair in zip(cables, found, strict=True)]
    assert max(worst) < 1e-11


def test_tensions_that_are_not_in_balance_are_told():
    length = jnp.array([2.0, 3.0])
    right = jnp.array([100.0, 100.0 * np.exp(0.1)])
    gained = jnp.array([1e-3, -1e-3])
    for tension, moved, expected in [
        (right, gained, True),
        (right * jnp.array([1.0, 1 + 1e-8]), gained, False),
        (right, gained + 1e-8, False),
    ]:
        ends = friction.SegmentTensions(tension, None, jnp.ones(1), jnp.array([0.1]), moved)
        vanish = friction.residuals_vanish(ends, jnp.full(2, 1e-5), length, None, False)
        assert bool(vanish) == expected
