"""Elastic unloading: against three plasticity algorithms and closed forms; inverse after yield."""

import numpy as np
import pytest
from banks.laws import (
    CABLES,
    ELASTIC,
    N_PATH,
    apart,
    evaluate,
    history,
    invert,
    kinematic,
    points_of,
    random_path,
    rounding,
    samples,
)

# --- three independent algorithms


def return_mapping(E, tangent, yield_stress, strains):
    """Bilinear kinematic hardening."""
    update, memory, out = kinematic(E, tangent, yield_stress), 0.0, []
    for strain in strains:
        stress, memory = update(strain, memory)
        out.append(stress)
    return np.array(out)


def masing(points, strains):
    """Masing's rule with memory: a reversal starts the curve at twice its size, loops close."""
    turning, stress, before, direction, out = [], 0.0, 0.0, 0, []
    for strain in strains:
        now = np.sign(strain - before)
        if direction and now != direction:
            turning.append((before, stress))
        while turning:  # a loop that closes is forgotten; the first one closes at its mirror image
            closes = turning[-2][0] if len(turning) > 1 else -turning[-1][0]
            if (strain - closes) * now <= 0:
                break
            del turning[-2:]
        if turning:
            e, s = turning[-1]
            stress = s + 2 * np.interp((strain - e) / 2, *points)
        else:
            stress = np.interp(strain, *points)
        out.append(stress)
        before, direction = strain, now
    return np.array(out)


def in_rate_form(points, strains, substeps=50):
    """Parts that stop at their limits, integrated over small steps of strain."""
    strain, stress = points
    zero = int(np.searchsorted(strain, 0.0))
    slopes = np.diff(stress) / np.diff(strain)
    sides = [(strain[zero + 1 : -1], slopes[zero:]), (-strain[1:zero][::-1], slopes[:zero][::-1])]
    n = max(len(corners) for corners, _ in sides)
    longer = max(sides, key=lambda side: len(side[0]))[1]
    stiffness, last = -np.diff(longer), longer[-1]
    top, bottom = (
        stiffness * np.append(corners, [np.inf] * (n - len(corners))) for corners, _ in sides
    )
    part, before, out = np.zeros(n), 0.0, []
    for strain in strains:
        for _ in range(substeps):
            part = np.clip(part + stiffness * (strain - before) / substeps, -bottom, top)
        before = strain
        out.append(last * strain + part.sum())
    return np.array(out)


def from_the_largest(points, strains):
    """Tension only: the curve at a new largest strain, below it a line down to zero."""
    largest = np.maximum.accumulate(np.maximum(strains, 0.0))
    slope = points[1][1] / points[0][1]
    return np.maximum(np.interp(largest, *points) - slope * (largest - strains), 0.0)


def cable_path(law, points, seed):
    """Strains that grow, and go back between by up to twice what it takes to be slack."""
    rng = np.random.default_rng(seed)
    grow = 0.98 * points[0][-1] * np.linspace(0.02, 1, N_PATH)
    back = np.interp(grow, *points) / float(law.modulus) * rng.uniform(0, 2, N_PATH)
    return np.where(rng.random(N_PATH) < 0.3, grow, grow - back)


ORACLES = {
    "return mapping": (
        ["steel", "perfectly plastic"],
        lambda law, path: return_mapping(
            210e9, 2.1e9 if law is ELASTIC["steel"] else 0.0, 235e6, path
        ),
    ),
    "masing": (
        ["steel", "four points", "perfectly plastic"],
        lambda law, path: masing(points_of(law), path),
    ),
    "rate form": (list(ELASTIC), lambda law, path: in_rate_form(points_of(law), path)),
}


@pytest.mark.slow_cases(
    "masing-four points", "rate form-one corner against two", "return mapping-steel"
)
@pytest.mark.parametrize(
    ("oracle", "name"), [(o, name) for o, (names, _) in ORACLES.items() for name in names]
)
def test_elastic_unloading_over_a_random_path(oracle, name):
    law = ELASTIC[name]
    path = random_path(law, seed=4)
    stress = history(law, path)[0]
    expected = ORACLES[oracle][1](law, path)
    assert np.count_nonzero(np.abs(expected - np.interp(path, *points_of(law))) > 1e6) > 50
    # rounding of stresses E e, added up in 120 increments (of 50 steps in the rate form)
    steps = 6000 if oracle == "rate form" else 120
    assert apart(stress, expected) <= steps * rounding(law) / 10


@pytest.mark.slow_cases("steel without compression", "strand")
@pytest.mark.parametrize("name", CABLES)
def test_tension_only_unloading_over_a_random_path(name):
    law = CABLES[name]
    strain, stress = points_of(law)
    points = strain[strain >= 0], stress[strain >= 0]
    path = cable_path(law, points, seed=5)
    got, gradient, again, _, _, slack = history(law, path)
    expected = from_the_largest(points, path)
    assert np.count_nonzero(expected == 0) > 10
    assert np.count_nonzero((expected > 0) & (expected < np.interp(path, *points) - 1e6)) > 10
    assert apart(got, expected) <= 12 * rounding(law)  # 120 increments
    assert (got >= 0).all()
    assert np.array_equal(slack, expected == 0)
    assert apart(gradient, got) <= 12 * rounding(law)
    assert apart(again, got) <= 12 * rounding(law)


# --- along a path, and at the plastic strains it has left


@pytest.mark.slow_cases("four points", "one corner against two", "steel")
@pytest.mark.parametrize("name", ELASTIC)
def test_consistency_along_a_path(name):
    """Energy against stress, a settled state against its origin, the inverse and its ends."""
    law = ELASTIC[name]
    path = random_path(law, seed=6)
    stress, gradient, again, back, memory, _ = history(law, path)
    # a part's stress is a difference of strain and plastic strain
    assert apart(gradient, stress) <= 10 * rounding(law)
    assert apart(again, stress) <= 10 * rounding(law)
    assert np.count_nonzero(np.any(np.diff(memory, axis=0) != 0, axis=1)) > 20
    settled = memory[-1]
    ends = evaluate(law, points_of(law)[0][[0, -1]], settled)[0]
    outward = 1e-9 * np.abs(ends).max() * np.array([-1, 1])
    assert np.isnan(invert(law, ends + outward, settled)[0]).all()
    assert np.isfinite(invert(law, ends - outward, settled)[0]).all()
    if name != "perfectly plastic":  # on a plateau many strains have one stress
        slopes = np.diff(law.stress) / np.diff(law.strain)
        assert apart(back, path) <= 10 * rounding(law) / slopes.min()


@pytest.mark.slow_cases("law2", "law3")
@pytest.mark.parametrize("law", [ELASTIC["steel"], ELASTIC["unsymmetric yield"], *CABLES.values()])
def test_energy_at_given_plastic_strains_starts_from_zero_and_is_convex(law):
    strain, _ = points_of(law)
    at = np.linspace(max(strain[0], -0.5 * strain[-1]), strain[-1], 301)
    memory = history(law, [0.6 * strain[-1]])[4]
    stress, _, energy, gradient, *_ = evaluate(law, at, memory)
    assert apart(gradient, stress) <= 10 * rounding(law)
    assert (np.diff(stress) >= -10 * rounding(law)).all()
    # trapezia of a piecewise linear stress err only where a corner lies inside a cell
    step = at[1] - at[0]
    trapezia = np.cumsum(0.5 * (stress[1:] + stress[:-1]) * step)
    missed = 0.25 * float(law.modulus) * step**2 * (2 * law.n_memory + 1)
    assert apart(energy[1:] - energy[0], trapezia) <= missed


@pytest.mark.slow_cases("four points", "strand")
@pytest.mark.parametrize("name", CABLES)
def test_inverse_of_a_strand_that_has_yielded(name):
    """From the strain at which it goes slack; zero stress is reached there."""
    law = CABLES[name]
    strain, stress = points_of(law)
    e1 = 0.6 * strain[-1]
    memory = history(law, [e1])[4][0]
    slack = e1 - float(np.interp(e1, strain, stress)) / float(law.modulus)
    at = np.append(slack, np.random.default_rng(8).uniform(slack, strain[-1], 100))
    pull = evaluate(law, at, memory)[0]
    got, _ = invert(law, np.append(0.0, pull[1:]), memory)  # the first is zero but for rounding
    slopes = np.diff(stress) / np.diff(strain)
    assert apart(got, at) <= 10 * rounding(law) / slopes.min()
    assert np.isnan(invert(law, [-1e6], memory)[0]).all()


@pytest.mark.parametrize("name", ["steel", "strand"])
def test_distance_from_a_corner_after_yield(name):
    """Corners: yield again, yield backwards or go slack, and the ends of the curve."""
    law = {**ELASTIC, **CABLES}[name]
    strain, stress = points_of(law)
    modulus = float(law.modulus)
    e1 = 0.6 * strain[-1]
    s1 = np.interp(e1, strain, stress)
    memory = history(law, [e1])[4][0]
    if name == "steel":
        corners = np.array([strain[0], e1 - 2 * 235e6 / modulus, e1, strain[-1]])
    else:
        corners = np.array([e1 - s1 / modulus, e1, strain[-1]])
    at = np.concatenate([samples(law, 300), corners])
    expected = np.abs(at[:, None] - corners).min(1)
    got = evaluate(law, at, memory)[4]
    # a few roundings of a strain
    assert apart(got, expected) <= 1e-16
