"""Uniaxial laws: reversible curves, inverses, presets, parallel laws."""

import jax.numpy as jnp
import numpy as np
import pytest
from banks.laws import (
    CABLES,
    CURVES,
    ELASTIC,
    LAWS,
    E,
    apart,
    area_under,
    curve,
    evaluate,
    history,
    invert,
    points_of,
    random_path,
    rounding,
    samples,
    virgin,
)
from oracles.traced import traced

import jaxcable as jc
from jaxcable import materials

# --- reversible curves


@pytest.mark.slow_cases("origin inside a segment", "symmetric", "tension-only", "unsymmetric")
@pytest.mark.parametrize("name", CURVES)
def test_stress_and_energy_follow_the_curve(name):
    """And the distance from a corner; beyond its ends `extended` goes on with the initial slope."""
    law, (strain, stress), at = LAWS[name], CURVES[name], samples(LAWS[name])
    scale = np.abs(strain).max()  # the energy is at most this times a stress
    got, _, energy, gradient, distance, _ = evaluate(law, at)
    assert apart(got, curve(strain, stress, at)) <= rounding(law)
    assert apart(gradient, got) <= rounding(law)
    assert apart(energy, area_under(strain, stress, at)) <= rounding(law) * scale
    # one rounding of a difference
    assert apart(distance, np.abs(at[:, None] - points_of(law)[0]).min(1)) <= 1e-15 * scale
    inside = np.clip(at, strain[0], strain[-1])
    over = np.where((strain[0] == 0) & (at < 0), 0.0, at - inside)  # else slack, not failed
    rise, ends = float(law.modulus) * over, curve(strain, stress, inside)
    got, _, energy, gradient, *_ = evaluate(law.extrapolated(), at)
    assert apart(got, ends + rise) <= rounding(law)
    assert apart(gradient, got) <= rounding(law)
    expected = area_under(strain, stress, at) + (ends + 0.5 * rise) * over
    assert apart(energy, expected) <= rounding(law) * scale


@pytest.mark.parametrize("name", CURVES)
def test_ends_and_corners(name):
    """An end belongs to the curve, and the next number does not; slopes are those of loading."""
    law = LAWS[name]
    strain, stress = points_of(law)
    side = [0, -1] if strain[0] < 0 else [-1]
    at_end, *_, beyond = evaluate(law, strain[side])
    assert apart(at_end, stress[side]) <= rounding(law) and not beyond.any()
    outside, *_, beyond = evaluate(law, np.nextafter(strain[side], 2 * strain[side]))
    assert (outside == 0).all() and beyond.all()
    assert evaluate(law, [-1.0])[-1].all() == (strain[0] < 0)  # else slack, not failed
    slopes, corners = np.diff(stress) / np.diff(strain), strain[1:-1]
    loading = np.where(corners < 0, slopes[:-1], slopes[1:])
    expected = np.append(loading, slopes[np.searchsorted(strain, 0.0, side="right") - 1])
    # rounding of sums of slopes; at the origin that of tension
    got = evaluate(law, np.append(corners, 0.0))[1]
    assert apart(got, expected) <= 1e-14 * np.abs(slopes).max() * len(slopes)
    assert float(law.modulus) == expected[-1]
    assert (evaluate(law, strain)[4] == 0).all()


@pytest.mark.slow_cases("law0", "law1", "law10", "law11", "law12", "law4", "law5", "law6", "law9")
@pytest.mark.parametrize("law", [*LAWS.values(), *ELASTIC.values(), *CABLES.values()])
def test_nothing_cancels_near_the_origin(law):
    at = np.array([1e-14, -1e-14])
    strain, stress = points_of(law)
    zero = np.searchsorted(strain, 0.0)
    behind = 0.0
    if strain[0] < 0 and not law.one_sided:
        behind = stress[zero - 1] / strain[zero - 1]
    expected = np.array([float(law.modulus), behind]) * at
    got, _, energy, *_ = evaluate(law, at, virgin(law))
    # the curve at a strain of 1e-14 is no difference of numbers of the size of its corners
    assert apart(got, expected) <= 1e-12 * expected[0]
    assert apart(energy, 0.5 * expected * at) <= 1e-12 * 0.5 * expected[0] * at[0]
    if behind:  # strains of small stresses have their own digits, too
        back = invert(law, expected, virgin(law))[0]
        assert apart(back, at) <= 1e-12 * at[0]


@pytest.mark.slow_cases("tension-only")
@pytest.mark.parametrize("name", CURVES)
def test_strain_at_is_the_inverse(name):
    law = LAWS[name]
    strain, stress = points_of(law)
    low, high = strain[np.argmin(stress)], strain[np.argmax(stress)]  # the rising branch
    at = np.random.default_rng(1).uniform(low, high, 300)
    got, slope = invert(law, curve(strain, stress, at))
    rising = np.diff(stress) / np.diff(strain)
    flattest = rising[rising > 0].min()
    # rounding of the stress over the smallest slope
    assert apart(got, at) <= rounding(law) / flattest
    expected = 1 / evaluate(law, at)[1]
    assert apart(slope, expected) <= 1e-10 * expected.max()
    outside = np.array([stress.min(), stress.max()]) * (1 + 1e-9)
    outside = outside if strain[0] < 0 else np.array([-1.0, outside[1]])
    assert np.isnan(invert(law, outside)[0]).all()


STEELS = [materials.steel(unloading=way) for way in ("reversible", "elastic")]


@pytest.mark.slow_cases("law7", "law8", "law9")
@pytest.mark.parametrize("law", [*LAWS.values(), *STEELS, *CABLES.values()])
def test_the_inverse_at_zero_and_at_the_peak(law):
    """Zero has strain zero and the slope of loading; the peak a strain, however it is rounded."""
    strain, stress = points_of(law)
    capacity = [float(v) for v in law.capacity]
    (zero, *peak), (slope, *_) = invert(law, [0.0, *capacity], virgin(law))
    assert zero == 0
    # one division; a law of two branches may give either side
    slopes = evaluate(law, [1e-9, -1e-9], virgin(law))[1]
    assert min(abs(slope * k - 1) for k in slopes) <= 1e-14
    low = strain[np.argmin(stress)] if strain[0] < 0 and not law.one_sided else 0.0
    # rounding of the stress over a slope of a thousandth of the first
    assert apart(peak, np.array([low, strain[np.argmax(stress)]])) <= 1e-11


def test_plateau_is_inverted_to_its_beginning():
    law = materials.tension_only(E, 400e6, 2e-2)
    (strain,), _ = invert(law, np.array([400e6]))
    assert strain == pytest.approx(2e-3, rel=1e-14)


@pytest.mark.parametrize("name", ["symmetric", "unsymmetric", "tension-only"])
def test_softened_law_is_in_series_with_a_spring(name):
    law, compliance = LAWS[name], 3e-12
    strain, stress = points_of(law)
    at = np.random.default_rng(2).uniform(strain[0], strain[-1], 100)
    pull = curve(strain, stress, at)
    soft = law.in_series_with_spring(compliance)
    got = evaluate(soft, at + compliance * pull)[0]
    assert apart(got, pull) <= 4 * rounding(soft)


def test_rising_is_known_from_the_points():
    assert [law.monotone for law in LAWS.values()] == [True, True, True, False, True]
    assert all(law.monotone for law in [*ELASTIC.values(), *CABLES.values(), jc.Elastic(E)])


# --- presets and parallel laws


def test_preset_steel():
    law = materials.steel(355e6, 205e9, 0.02, ultimate_strain=0.04)
    top = 355e6 + 0.02 * 205e9 * (0.04 - 355e6 / 205e9)
    # quotients of the stated numbers
    assert float(law.modulus) == pytest.approx(205e9, rel=1e-14)
    assert np.allclose(law.capacity, [-top, top], rtol=1e-15)
    assert np.allclose(law.strain_limits, [-0.04, 0.04], rtol=0)
    assert (law.n_memory, materials.steel(unloading="reversible").n_memory) == (1, 0)
    got = evaluate(law, [-0.03, 1e-3, 0.03])[0]
    at = 355e6 + 0.02 * 205e9 * (0.03 - 355e6 / 205e9)
    assert np.allclose(got, [-at, 205e6, at], rtol=1e-13)


def test_preset_strand():
    law = materials.strand()
    assert float(law.modulus) == pytest.approx(195e9, rel=1e-14)
    assert np.allclose(law.capacity, [0.0, 1860e6], rtol=1e-15)
    assert law.strain_limits[0] == -np.inf and law.strain_limits[1] == 0.02 / 0.9
    # EN 1992-1-1, figure 3.10: f_pk / gamma at the ultimate strain, 0.9 of it at the corner
    corner, end = 0.9 * 1860e6 / 195e9, 0.02 / 0.9
    got = evaluate(law, [-0.01, corner, 0.5 * (corner + end), end])[0]
    assert np.allclose(got, 1860e6 * np.array([0.0, 0.9, 0.95, 1.0]), rtol=1e-14)


@pytest.mark.slow
def test_preset_tension_only():
    brittle = materials.tension_only(E, 400e6)
    assert np.allclose(brittle.capacity, [0.0, 400e6]) and brittle.strain_limits[1] == 2e-3
    ductile = materials.tension_only(E, 400e6, 0.02)
    assert np.allclose(evaluate(ductile, [-1.0, 1e-3, 0.02])[0], [0, 200e6, 400e6], rtol=1e-14)
    endless = materials.tension_only(E)
    assert float(endless.modulus) == E and evaluate(endless, [0.5])[0] == 0.5 * E
    assert endless.is_slack(jnp.array([-1e-3, 1e-3])).tolist() == [True, False]


def test_linear_law():
    law = jc.Elastic(E)
    at = np.array([-1e-3, 0.0, 2e-3])
    stress, slope, energy, gradient, distance, beyond = evaluate(law, at)
    assert np.allclose(stress, E * at) and np.allclose(slope, E)
    assert np.allclose(energy, 0.5 * E * at**2) and np.allclose(gradient, stress)
    assert np.isinf(distance).all() and not beyond.any()
    assert np.allclose(invert(law, stress)[0], at, rtol=1e-15)
    assert float(law.in_series_with_spring(1e-12).stress_at(1.0)) == pytest.approx(
        1 / (1 / E + 1e-12)
    )


SHARES = np.array([0.2, 0.5, 0.3])

TRIO = materials.Parallel((jc.Elastic(10e9), materials.steel(), materials.strand()), SHARES)


def test_parallel_law_is_the_weighted_sum():
    law = TRIO
    path = random_path(materials.strand(), seed=9)
    steel, strand = (history(one, path) for one in law.laws[1:])
    stress, gradient, again, _, memory, _ = history(law, path)
    expected = 0.2 * 10e9 * path + 0.5 * steel[0] + 0.3 * strand[0]
    size = rounding(materials.steel())  # the largest of the three
    assert apart(stress, expected) <= size
    assert apart(gradient, stress) <= size
    assert apart(again, stress) <= size
    assert np.array_equal(memory, np.column_stack([steel[4], strand[4]]))
    # quotients of the points
    modulus = 0.2 * 10e9 + 0.5 * 210e9 + 0.3 * 195e9
    assert float(law.modulus) == pytest.approx(modulus, rel=1e-14)
    assert law.has_rupture and law.monotone and law.n_memory == 2


def test_limits_and_capacity_of_a_parallel_law():
    """The first end: steel in compression, the strand in tension."""
    steel, end = materials.steel(), 0.02 / 0.9
    limits, capacity = traced(lambda law: (law.strain_limits, law.capacity))(TRIO)
    assert np.allclose(limits, [-0.05, end], rtol=0)
    beyond = evaluate(TRIO, [-0.051, -0.05, end, 0.023], np.zeros(2))[-1]
    assert beyond.tolist() == [True, False, False, True]
    low = -0.2 * 10e9 * 0.05 + 0.5 * steel.stress[0]
    high = 0.2 * 10e9 * end + 0.5 * np.interp(end, steel.strain, steel.stress) + 0.3 * 1860e6
    assert np.allclose(capacity, [low, high], rtol=1e-13)
    endless = materials.Parallel((jc.Elastic(E), jc.Elastic(2 * E)), np.array([0.5, 0.5]))
    assert not endless.has_rupture and np.isinf(np.array(endless.capacity)).all()


@pytest.mark.slow_cases("virgin")
@pytest.mark.parametrize("state", ["virgin", "yielded"])
def test_inverse_of_a_parallel_law(state):
    at = np.random.default_rng(10).uniform(-0.04, 0.02, 200)
    memory = np.zeros(2) if state == "virgin" else history(TRIO, [-0.01])[4][0]
    stress, *_ = evaluate(TRIO, at, memory)
    got, _ = invert(TRIO, stress, memory)
    # rounding of the stress over the smallest slope, 2 GPa
    assert apart(got, at) <= 10 * rounding(materials.steel()) / 2e9
    assert np.isnan(invert(TRIO, [2e9], memory)[0]).all()


def test_slack_of_a_parallel_law_is_told_strain_by_strain():
    law = materials.Parallel((materials.strand(), materials.tension_only(E)), np.array([0.5, 0.5]))
    at = jnp.array([-0.01, 0.01, 0.02])
    assert law.is_slack(at, jnp.zeros((3, 1))).tolist() == [True, False, False]
