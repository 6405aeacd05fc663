"""Uniaxial laws: against NumPy interpolation, three plasticity algorithms, closed forms, Taylor."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcable as jc
from jaxcable import materials

E = 200e9

# (strain, stress) of curves; the origin is among the points of all but one
SYMMETRIC = (
    [-2e-2, -4e-3, -1e-3, 0, 1e-3, 4e-3, 2e-2],
    [-380e6, -320e6, -200e6, 0, 200e6, 320e6, 380e6],
)
CURVES = {
    "symmetric": SYMMETRIC,
    "unsymmetric": ([-3.5e-3, -2e-3, -7e-4, 0, 1e-4, 9e-4], [-38e6, -36e6, -20e6, 0, 3e6, 4e6]),
    "tension-only": ([0, 2e-3, 7e-3, 2.5e-2], [0, 400e6, 700e6, 760e6]),
    "softening": ([-6e-3, -2e-3, 0, 1e-3, 2e-3, 8e-3], [-9e6, -30e6, 0, 20e6, 24e6, 3e6]),
    "origin inside a segment": ([-2e-3, -1e-3, 1e-3, 5e-3], [-1.5e8, -1e8, 1e8, 2e8]),
}
LAWS = {name: jc.Polygonal(*points) for name, points in CURVES.items()}

# concave curves of elastic unloading; slopes from the origin are equal on both sides
ELASTIC = {
    "steel": materials.steel(),
    "four points": jc.Polygonal(*SYMMETRIC, "elastic"),
    "perfectly plastic": materials.steel(hardening=0.0),
    "unsymmetric yield": jc.Polygonal(
        [-2e-2, -5e-3, -2e-3, 0, 1e-3, 3e-3, 2e-2],
        [-1.15e9, -7e8, -4e8, 0, 2e8, 4e8, 9.1e8],
        "elastic",
    ),
    "one corner against two": jc.Polygonal(
        [-2e-2, -5e-3, -2e-3, 0, 1e-3, 2e-2],
        [-1.15e9, -7e8, -4e8, 0, 2e8, 2.1e9],
        "elastic",
    ),
}
CABLES = {
    "strand": materials.strand(),
    "four points": jc.Polygonal(*CURVES["tension-only"], "elastic"),
    "steel without compression": materials.steel().tension_only(),
}


def points_of(law):
    return np.asarray(law.strain), np.asarray(law.stress)


def virgin(law):
    return np.zeros(law.n_plastic) if law.n_plastic else None


def curve(strain, stress, at):
    """The curve by NumPy: zero beyond the ends and, without compression branch, below zero."""
    inside = (at >= strain[0]) & (at <= strain[-1])
    return np.where(inside, np.interp(at, strain, stress), 0.0)


def area_under(strain, stress, at):
    """Integral of the curve from zero to every `at`, by trapezia between all its corners."""
    out = []
    for e in np.clip(at, strain[0], strain[-1]):
        between = [x for x in strain if min(e, 0) < x < max(e, 0)]
        grid = np.sort([0.0, e, *between])
        out.append(np.sign(e) * np.trapezoid(np.interp(grid, strain, stress), grid))
    return np.array(out)


SIZE = 400  # all batches are filled up to this size: one compilation for each kind of law


def batched(function):
    """`function(law, number, plastic)` of single numbers, for arrays of up to `SIZE` of them."""

    @jax.jit
    def run(law, number, plastic):
        each = functools.partial(function, law)
        return jax.vmap(each, (0, None if plastic is None else 0))(number, plastic)

    def filled(law, number, plastic=None):
        n = len(number)
        rows = np.minimum(np.arange(SIZE), n - 1)
        number = np.asarray(number, float)[rows]
        if plastic is not None:
            plastic = np.broadcast_to(plastic, (n, law.n_plastic))[rows]
        return tuple(np.asarray(out)[:n] for out in run(law, number, plastic))

    return filled


@batched
def evaluate(law, strain, plastic):
    """Stress, its slope, energy, its slope, distance from a corner, whether beyond."""
    stress, slope = jax.value_and_grad(law.stress_at)(strain, plastic)
    energy, gradient = jax.value_and_grad(law.energy_at)(strain, plastic)
    distance = law.corner_distance(strain, plastic)
    return stress, slope, energy, gradient, distance, law.beyond(strain)


@batched
def invert(law, stress, plastic):
    """Strain at every stress and its slope."""
    return jax.value_and_grad(law.strain_at)(stress, plastic)


def samples(law, n=SIZE, seed=0):
    """Strains from before the first to beyond the last point; none on a corner."""
    strain, _ = points_of(law)
    return np.random.default_rng(seed).uniform(1.2 * min(strain[0], -1e-3), 1.2 * strain[-1], n)


def rounding(law):
    """Rounding of ramps, which go on with the initial slope to the largest strain, Pa."""
    return 1e-14 * float(law.modulus) * np.abs(law.strain).max()


# --- reversible curves


@pytest.mark.parametrize("name", CURVES)
def test_stress_and_energy_follow_the_curve(name):
    law, (strain, stress) = LAWS[name], CURVES[name]
    at = samples(law)
    got, _, energy, gradient, *_ = evaluate(law, at)
    assert np.abs(got - curve(strain, stress, at)).max() <= rounding(law)
    assert np.abs(gradient - got).max() <= rounding(law)
    scale = np.abs(strain).max()  # the energy is at most this times a stress
    assert np.abs(energy - area_under(strain, stress, at)).max() <= rounding(law) * scale


@pytest.mark.parametrize("name", CURVES)
def test_continued_law_goes_on_with_the_initial_slope(name):
    law, (strain, stress) = LAWS[name], CURVES[name]
    at = samples(law)
    inside = np.clip(at, strain[0], strain[-1])
    expected = np.interp(at, strain, stress) + float(law.modulus) * (at - inside)
    if strain[0] == 0:  # slack, not failed
        expected = np.where(at < 0, 0.0, expected)
    got, _, energy, gradient, *_ = evaluate(law.continued(), at)
    assert np.abs(got - expected).max() <= rounding(law)
    assert np.abs(gradient - got).max() <= rounding(law)
    beyond = np.where((strain[0] == 0) & (at < 0), 0.0, at - inside)
    more = (curve(strain, stress, inside) + 0.5 * float(law.modulus) * beyond) * beyond
    expected = area_under(strain, stress, at) + more
    assert np.abs(energy - expected).max() <= rounding(law) * np.abs(strain).max()


@pytest.mark.parametrize("name", CURVES)
def test_an_end_belongs_to_the_curve_and_the_next_number_does_not(name):
    law = LAWS[name]
    strain, stress = points_of(law)
    side = [0, -1] if strain[0] < 0 else [-1]
    at_end, *_, beyond = evaluate(law, strain[side])
    assert np.abs(at_end - stress[side]).max() <= rounding(law)
    assert not beyond.any()
    outside, *_, beyond = evaluate(law, np.nextafter(strain[side], 2 * strain[side]))
    assert (outside == 0).all() and beyond.all()
    assert evaluate(law, [-1.0])[-1].all() == (strain[0] < 0)  # else slack, not failed


@pytest.mark.parametrize("name", CURVES)
def test_slope_at_a_corner_is_that_of_loading(name):
    """Away from the origin; at the origin that of tension."""
    law = LAWS[name]
    strain, stress = points_of(law)
    slopes = np.diff(stress) / np.diff(strain)
    corners = strain[1:-1]
    beyond = np.where(corners < 0, slopes[:-1], slopes[1:])
    got = evaluate(law, np.append(corners, 0.0))[1]
    expected = np.append(beyond, slopes[np.searchsorted(strain, 0.0, side="right") - 1])
    # rounding of sums of slopes
    assert np.abs(got - expected).max() <= 1e-14 * np.abs(slopes).max() * len(slopes)
    assert float(law.modulus) == expected[-1]


@pytest.mark.parametrize("name", CURVES)
def test_distance_from_a_corner(name):
    law = LAWS[name]
    strain, _ = points_of(law)
    at = samples(law)
    expected = np.abs(at[:, None] - strain).min(1)
    # one rounding of a difference
    assert np.abs(evaluate(law, at)[4] - expected).max() <= 1e-15 * np.abs(strain).max()
    assert (evaluate(law, strain)[4] == 0).all()


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
    assert np.abs(got - expected).max() <= 1e-12 * expected[0]
    assert np.abs(energy - 0.5 * expected * at).max() <= 1e-12 * 0.5 * expected[0] * at[0]


@pytest.mark.parametrize("law", [LAWS["symmetric"], ELASTIC["steel"]])
def test_nothing_cancels_in_the_inverse_near_the_origin(law):
    """Strains of small stresses have their own digits, not those of the corners."""
    stress = np.array([1e-3, -1e-3])
    expected = stress / float(law.modulus)
    assert np.abs(invert(law, stress, virgin(law))[0] - expected).max() <= 1e-12 * expected[0]


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
    assert np.abs(got - at).max() <= rounding(law) / flattest
    expected = 1 / evaluate(law, at)[1]
    assert np.abs(slope - expected).max() <= 1e-10 * expected.max()
    outside = np.array([stress.min(), stress.max()]) * (1 + 1e-9)
    outside = outside if strain[0] < 0 else np.array([-1.0, outside[1]])
    assert np.isnan(invert(law, outside)[0]).all()


STEELS = [materials.steel(unloading=way) for way in ("reversible", "elastic")]


@pytest.mark.parametrize("law", [*LAWS.values(), *STEELS, materials.strand()])
def test_a_law_reaches_its_own_capacity(law):
    """The peak has a strain, whatever way rounding goes."""
    strain, stress = points_of(law)
    got, _ = invert(law, [float(v) for v in law.capacity], virgin(law))
    low = strain[np.argmin(stress)] if strain[0] < 0 else 0.0
    # rounding of the stress over a slope of a thousandth of the first
    assert np.abs(got - np.array([low, strain[np.argmax(stress)]])).max() <= 1e-11


@pytest.mark.parametrize("law", [*LAWS.values(), *CABLES.values()])
def test_inverse_at_zero_stress(law):
    """Strain zero; its slope is that of tension (loading), also of a law that goes slack."""
    (strain,), (slope,) = invert(law, [0.0], virgin(law))
    assert strain == 0
    # one division; a law of two branches may give either side
    slopes = evaluate(law, [1e-9, -1e-9], virgin(law))[1]
    assert min(abs(slope * k - 1) for k in slopes) <= 1e-14


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
    soft = law.softened(compliance)
    got = evaluate(soft, at + compliance * pull)[0]
    assert np.abs(got - pull).max() <= 4 * rounding(soft)


def test_rising_is_known_from_the_points():
    assert [law.rising for law in LAWS.values()] == [True, True, True, False, True]
    assert all(law.rising for law in [*ELASTIC.values(), *CABLES.values(), jc.Elastic(E)])


# --- elastic unloading: three independent algorithms


def return_mapping(E, tangent, yield_stress, strains):
    """Bilinear kinematic hardening: elastic trial and return in closed form (1D)."""
    H = E * tangent / (E - tangent)
    plastic, out = 0.0, []
    for strain in strains:
        trial = E * (strain - plastic)
        over = trial - H * plastic  # back stress H times plastic strain
        flow = max(0.0, abs(over) - yield_stress) / (E + H)
        plastic += np.sign(over) * flow
        out.append(E * (strain - plastic))
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


N_PATH = 120


@jax.jit
def _along(law, strains):
    def increment(plastic, strain):
        stress = law.stress_at(strain, plastic)
        gradient = jax.grad(law.energy_at)(strain, plastic)
        settled = law.settle(strain, plastic)
        again = law.stress_at(strain, settled)
        back = law.strain_at(stress, plastic)
        slack = law.is_slack(strain, plastic)
        return settled, (stress, gradient, again, back, settled, slack)

    return jax.lax.scan(increment, jnp.zeros(law.n_plastic), strains)[1]


def history(law, strains):
    """Along a path: stress, slope of the energy, stress after settling, inverse, plastic, slack."""
    filled = np.append(strains, np.full(N_PATH - len(strains), strains[-1]))
    return tuple(np.asarray(out)[: len(strains)] for out in _along(law, filled))


def random_path(law, seed, n=N_PATH):
    """Strains that wander over the whole curve, with reversals of all sizes."""
    strain, _ = points_of(law)
    rng = np.random.default_rng(seed)
    reach = 0.98 * 10 ** rng.uniform(-1.5, 0, n)
    return reach * rng.uniform(max(strain[0], -0.3 * strain[-1]), strain[-1], n)


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
    assert np.abs(stress - expected).max() <= steps * rounding(law) / 10


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
    assert np.abs(got - expected).max() <= 12 * rounding(law)  # 120 increments
    assert (got >= 0).all()
    assert np.array_equal(slack, expected == 0)
    assert np.abs(gradient - got).max() <= 12 * rounding(law)
    assert np.abs(again - got).max() <= 12 * rounding(law)


@pytest.mark.parametrize("name", ELASTIC)
def test_consistency_along_a_path(name):
    """Energy against stress, a settled state against the one it came from, and the inverse."""
    law = ELASTIC[name]
    path = random_path(law, seed=6)
    stress, gradient, again, back, plastic, _ = history(law, path)
    # a part's stress is a difference of strain and plastic strain
    assert np.abs(gradient - stress).max() <= 10 * rounding(law)
    assert np.abs(again - stress).max() <= 10 * rounding(law)
    assert np.count_nonzero(np.any(np.diff(plastic, axis=0) != 0, axis=1)) > 20
    if name != "perfectly plastic":  # on a plateau many strains have one stress
        slopes = np.diff(law.stress) / np.diff(law.strain)
        assert np.abs(back - path).max() <= 10 * rounding(law) / slopes.min()


@pytest.mark.parametrize("law", [ELASTIC["steel"], ELASTIC["unsymmetric yield"], *CABLES.values()])
def test_energy_at_given_plastic_strains_starts_from_zero_and_is_convex(law):
    strain, _ = points_of(law)
    at = np.linspace(max(strain[0], -0.5 * strain[-1]), strain[-1], 301)
    plastic = history(law, [0.6 * strain[-1]])[4]
    stress, _, energy, gradient, *_ = evaluate(law, at, plastic)
    assert np.abs(gradient - stress).max() <= 10 * rounding(law)
    assert (np.diff(stress) >= -10 * rounding(law)).all()
    # trapezia of a piecewise linear stress err only where a corner lies inside a cell
    step = at[1] - at[0]
    trapezia = np.cumsum(0.5 * (stress[1:] + stress[:-1]) * step)
    missed = 0.25 * float(law.modulus) * step**2 * (2 * law.n_plastic + 1)
    assert np.abs(energy[1:] - energy[0] - trapezia).max() <= missed


def test_closed_form_path_of_steel():
    """Load, unload, yield backwards after twice the yield strain."""
    law = materials.steel()
    fy, tangent, e1, e2 = 235e6, 2.1e9, 0.010, 0.002
    ey = fy / 210e9
    s1 = fy + tangent * (e1 - ey)
    reverse = s1 - 210e9 * 2 * ey - tangent * (e1 - 2 * ey - e2)
    stress, _, _, _, plastic, _ = history(law, [e1, e1 - s1 / 210e9, e2])
    # a few roundings of the stress E e = 2.1 GPa
    assert np.abs(stress - np.array([s1, 0.0, reverse])).max() <= 1e-5
    expected = np.array([[e1 - ey], [e1 - ey], [e2 + ey]])
    assert np.abs(plastic - expected).max() <= 1e-16  # one rounding of a strain of 0.01
    distance = evaluate(law, [e1, e1 - 2 * ey], plastic[0])[4]
    assert distance.max() <= 4e-18  # both are corners, to a rounding of a strain of 0.01
    beside = [e1 + 1e-9, e1 - 1e-9, e1 - 2 * ey + 1e-9, e1 - 2 * ey - 1e-9]
    slopes = evaluate(law, beside, plastic[0])[1]
    assert np.allclose(slopes, [tangent, 210e9, 210e9, tangent], rtol=1e-14)


def test_closed_form_path_of_a_strand():
    """Load beyond yield, go slack, reload from the slack strain, go on along the curve."""
    law = materials.strand()
    fp, e1 = 0.9 * 1860e6, 0.015
    ey, end = fp / 195e9, 0.02 / 0.9
    tangent = (1860e6 - fp) / (end - ey)
    s1 = fp + tangent * (e1 - ey)
    slack = e1 - s1 / 195e9
    path = np.array([e1, slack - 1e-3, slack + 1e-3, -0.01, 0.5 * (e1 + slack), 0.02])
    expected = np.array([s1, 0, 195e6, 0, 0.5 * s1, fp + tangent * (0.02 - ey)])
    stress, _, _, _, plastic, slack = history(law, path)
    # a few roundings of the stress E e = 3.9 GPa
    assert np.abs(stress - expected).max() <= 1e-5
    # first loading moves it, going slack and back does not; a rounding of a strain of 0.01
    assert np.abs(plastic[:5, 0] - (e1 - ey)).max() <= 1e-16
    assert plastic[5, 0] == pytest.approx(0.02 - ey, rel=1e-14)
    assert slack.tolist() == [False, True, False, True, False, False]


@pytest.mark.parametrize("name", CABLES)
def test_inverse_of_a_strand_that_has_yielded(name):
    """From the strain at which it goes slack; zero stress is reached there."""
    law = CABLES[name]
    strain, stress = points_of(law)
    e1 = 0.6 * strain[-1]
    plastic = history(law, [e1])[4][0]
    slack = e1 - float(np.interp(e1, strain, stress)) / float(law.modulus)
    at = np.append(slack, np.random.default_rng(8).uniform(slack, strain[-1], 100))
    pull = evaluate(law, at, plastic)[0]
    got, _ = invert(law, np.append(0.0, pull[1:]), plastic)  # the first is zero but for rounding
    slopes = np.diff(stress) / np.diff(strain)
    assert np.abs(got - at).max() <= 10 * rounding(law) / slopes.min()
    assert np.isnan(invert(law, [-1e6], plastic)[0]).all()


@pytest.mark.parametrize("name", ELASTIC)
def test_inverse_at_given_plastic_strains_is_nan_beyond_the_ends(name):
    law = ELASTIC[name]
    plastic = history(law, random_path(law, seed=7, n=10))[4][-1]
    ends = evaluate(law, points_of(law)[0][[0, -1]], plastic)[0]
    size = np.abs(ends).max()
    assert np.isnan(invert(law, ends + 1e-9 * size * np.array([-1, 1]), plastic)[0]).all()
    inside, _ = invert(law, ends - 1e-9 * size * np.array([-1, 1]), plastic)
    assert np.isfinite(inside).all()


@pytest.mark.parametrize("name", ["steel", "strand"])
def test_distance_from_a_corner_after_yield(name):
    """Corners: yield again, yield backwards or go slack, and the ends of the curve."""
    law = {**ELASTIC, **CABLES}[name]
    strain, stress = points_of(law)
    modulus = float(law.modulus)
    e1 = 0.6 * strain[-1]
    s1 = np.interp(e1, strain, stress)
    plastic = history(law, [e1])[4][0]
    if name == "steel":
        corners = np.array([strain[0], e1 - 2 * 235e6 / modulus, e1, strain[-1]])
    else:
        corners = np.array([e1 - s1 / modulus, e1, strain[-1]])
    at = np.concatenate([samples(law, 300), corners])
    expected = np.abs(at[:, None] - corners).min(1)
    got = evaluate(law, at, plastic)[4]
    # a few roundings of a strain
    assert np.abs(got - expected).max() <= 1e-16


# --- derivatives with respect to the points


def taylor_slope(values, f0, rate, steps):
    remainder = np.abs(np.asarray(values) - f0 - steps * rate)
    return np.polyfit(np.log(steps), np.log(remainder), 1)[0]


TAYLOR = {
    "reversible": (CURVES["softening"], "reversible", [-3e-3, -8e-4, 5e-4, 1.6e-3, 4e-3]),
    "elastic": (SYMMETRIC, "elastic", [-9e-3, 2e-3, 6e-3, 1.1e-2, 1.6e-2]),
    "strand": (CURVES["tension-only"], "elastic", [8e-3, 1e-2, 1.2e-2, 1.6e-2, 2.1e-2]),
}
TARGETS = np.array([0.15, 0.75, 0.97])


@pytest.mark.parametrize("name", TAYLOR)
def test_taylor_of_the_points(name):
    """Stress, energy and inverse; with elastic unloading after loading to 0.6 of the curve."""
    (strain, stress), unloading, at = TAYLOR[name]
    strain, stress, at = np.array(strain), np.array(stress), np.array(at)
    n, top, end = len(strain), stress.max(), strain[-1]

    def measures(change):
        e, s = strain * (1 + change[:n]), stress * (1 + change[n:])
        law = jc.Polygonal(e, s, unloading)
        plastic = unloaded = None
        if law.n_plastic:  # the path is part of what is differentiated
            unused = jnp.zeros((len(at), law.n_plastic))
            plastic = law.settle(jnp.full(len(at), 0.6 * end), unused)
            unloaded = plastic[: len(TARGETS)]
        weights = jnp.arange(1.0, 1.0 + len(at))
        return jnp.stack(
            [
                weights @ law.stress_at(at, plastic) / top,
                weights @ law.energy_at(at, plastic) / (top * end),
                weights[:3] @ law.strain_at(TARGETS * top, unloaded) / end,
            ]
        )

    # steps: small against the distance of a corner (2 % of a strain), large against rounding
    steps = 2e-3 * 0.5 ** np.arange(4)
    direction = np.random.default_rng(3).normal(size=2 * n)
    direction[-1] = 1.0  # the entry that is corrupted below
    changes = np.append(0.0, steps)[:, None] * direction
    # a row for each of the three: their gradients, as by jax.grad
    gradients = np.asarray(jax.jit(jax.jacrev(measures))(changes[0]))
    f0, *values = np.asarray(jax.jit(jax.vmap(measures))(changes))
    values = np.array(values)
    for k, quantity in enumerate(["stress", "energy", "inverse"]):
        slope = taylor_slope(values[:, k], f0[k], gradients[k] @ direction, steps)
        assert abs(slope - 2) < 0.1, (quantity, slope)
        # negative control: one entry off by a tenth of the largest
        wrong = gradients[k].copy()
        wrong[-1] += 0.1 * np.abs(wrong).max()
        assert taylor_slope(values[:, k], f0[k], wrong @ direction, steps) < 1.5, quantity


# --- presets and parallel laws


def test_preset_steel():
    law = materials.steel(355e6, 205e9, 0.02, 0.04)
    top = 355e6 + 0.02 * 205e9 * (0.04 - 355e6 / 205e9)
    # quotients of the stated numbers
    assert float(law.modulus) == pytest.approx(205e9, rel=1e-14)
    assert np.allclose(law.capacity, [-top, top], rtol=1e-15)
    assert np.allclose(law.limits, [-0.04, 0.04], rtol=0)
    assert (law.n_plastic, materials.steel(unloading="reversible").n_plastic) == (1, 0)
    got = evaluate(law, [-0.03, 1e-3, 0.03])[0]
    at = 355e6 + 0.02 * 205e9 * (0.03 - 355e6 / 205e9)
    assert np.allclose(got, [-at, 205e6, at], rtol=1e-13)


def test_preset_strand():
    law = materials.strand()
    assert float(law.modulus) == pytest.approx(195e9, rel=1e-14)
    assert np.allclose(law.capacity, [0.0, 1860e6], rtol=1e-15)
    assert law.limits[0] == -np.inf and law.limits[1] == 0.02 / 0.9
    # EN 1992-1-1, figure 3.10: f_pk / gamma at the ultimate strain, 0.9 of it at the corner
    got = evaluate(law, [-0.01, 0.9 * 1860e6 / 195e9, 0.02 / 0.9])[0]
    assert np.allclose(got, [0.0, 0.9 * 1860e6, 1860e6], rtol=1e-14)


def test_preset_tension_only():
    brittle = materials.tension_only(E, 400e6)
    assert np.allclose(brittle.capacity, [0.0, 400e6]) and brittle.limits[1] == 2e-3
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
    assert float(law.softened(1e-12).stress_at(1.0)) == pytest.approx(1 / (1 / E + 1e-12))


SHARES = np.array([0.2, 0.5, 0.3])
TRIO = materials.Parallel((jc.Elastic(10e9), materials.steel(), materials.strand()), SHARES)


def test_parallel_law_is_the_weighted_sum():
    law = TRIO
    path = random_path(materials.strand(), seed=9)
    steel, strand = (history(one, path) for one in law.laws[1:])
    stress, gradient, again, _, plastic, _ = history(law, path)
    expected = 0.2 * 10e9 * path + 0.5 * steel[0] + 0.3 * strand[0]
    size = rounding(materials.steel())  # the largest of the three
    assert np.abs(stress - expected).max() <= size
    assert np.abs(gradient - stress).max() <= size
    assert np.abs(again - stress).max() <= size
    assert np.array_equal(plastic, np.column_stack([steel[4], strand[4]]))
    # quotients of the points
    modulus = 0.2 * 10e9 + 0.5 * 210e9 + 0.3 * 195e9
    assert float(law.modulus) == pytest.approx(modulus, rel=1e-14)
    assert law.breaks and law.rising and law.n_plastic == 2


def test_limits_and_capacity_of_a_parallel_law():
    """The first end: steel in compression, the strand in tension."""
    steel, end = materials.steel(), 0.02 / 0.9
    limits, capacity = jax.jit(lambda law: (law.limits, law.capacity))(TRIO)
    assert np.allclose(limits, [-0.05, end], rtol=0)
    beyond = evaluate(TRIO, [-0.051, -0.05, end, 0.023], np.zeros(2))[-1]
    assert beyond.tolist() == [True, False, False, True]
    low = -0.2 * 10e9 * 0.05 + 0.5 * steel.stress[0]
    high = 0.2 * 10e9 * end + 0.5 * np.interp(end, steel.strain, steel.stress) + 0.3 * 1860e6
    assert np.allclose(capacity, [low, high], rtol=1e-13)
    endless = materials.Parallel((jc.Elastic(E), jc.Elastic(2 * E)), np.array([0.5, 0.5]))
    assert not endless.breaks and np.isinf(np.array(endless.capacity)).all()


@pytest.mark.parametrize("state", ["virgin", "yielded"])
def test_inverse_of_a_parallel_law(state):
    at = np.random.default_rng(10).uniform(-0.04, 0.02, 200)
    plastic = np.zeros(2) if state == "virgin" else history(TRIO, [-0.01])[4][0]
    stress, *_ = evaluate(TRIO, at, plastic)
    got, _ = invert(TRIO, stress, plastic)
    # rounding of the stress over the smallest slope, 2 GPa
    assert np.abs(got - at).max() <= 10 * rounding(materials.steel()) / 2e9
    assert np.isnan(invert(TRIO, [2e9], plastic)[0]).all()


def test_parallel_law_without_plastic_strains_is_the_first_loading():
    """As of its parts: `plastic=None`."""
    at = samples(TRIO.laws[2], 100)
    stress, _, _, gradient, distance, _ = evaluate(TRIO, at)
    each = [evaluate(law, at) for law in TRIO.laws]
    size = rounding(materials.steel())
    assert np.abs(stress - sum(a * v[0] for a, v in zip(SHARES, each, strict=True))).max() <= size
    assert np.abs(gradient - stress).max() <= size
    assert np.abs(distance - np.min([v[4] for v in each], axis=0)).max() <= 1e-17  # the same


def test_slack_of_a_parallel_law_is_told_strain_by_strain():
    law = materials.Parallel((materials.strand(), materials.tension_only(E)), np.array([0.5, 0.5]))
    at = jnp.array([-0.01, 0.01, 0.02])
    assert law.is_slack(at, jnp.zeros((3, 1))).tolist() == [True, False, False]


# --- what is refused


BAD = {
    "one point": (([0.0], [0.0]), r"strain: expected shape \[n\] with n >= 2, got \(1,\)"),
    "rank": (([[0.0, 1.0]], [[0.0, 1.0]]), r"strain: expected shape \[n\] with n >= 2"),
    "lengths": (([0, 1e-3], [0, 1e8, 2e8]), r"stress: expected shape \(2,\) as strain, got \(3,\)"),
    "words": (([0, 1e-3], ["a", "b"]), "stress: expected numbers"),
    "complex": (([0, 1e-3j], [0, 1e8]), "strain: expected real numbers"),
    "ragged": (([[0], [1, 2]], [0, 1e8]), "strain: not a rectangular array"),
    "unloading": (([0, 1e-3], [0, 1e8], "plastic"), "unloading = 'plastic': expected"),
    "order": (
        ([0, 2e-3, 1e-3], [0, 1e8, 2e8]),
        r"strain\[2\] = 0.001: must be above strain\[1\] = 0.002",
    ),
    "twice": (([0, 1e-3, 1e-3], [0, 1e8, 2e8]), r"strain\[2\] = 0.001: must be above strain\[1\]"),
    "all tension": (([1e-3, 2e-3], [1e8, 2e8]), "strain: goes from 0.001 to 0.002"),
    "all compression": (([-2e-3, -1e-3], [-2e8, -1e8]), "strain: goes from -0.002 to -0.001"),
    "no tension": (([-2e-3, 0], [-2e8, 0]), "strain: goes from -0.002 to 0.0; .* pass the origin"),
    "origin": (([-1e-3, 0, 1e-3], [-1e8, 5.0, 1e8]), r"stress\[1\] = 5.0: at zero strain"),
    "misses": (([-1e-3, 1e-3], [-1e8, 2e8]), "the curve has 5e.07 Pa at zero strain"),
    "slope": (([0, 1e-3, 2e-3], [0, -1e8, 1e8]), "slope at the origin, -1e.11 Pa, must be positiv"),
    "slope behind": (([-1e-3, 0, 1e-3], [1e8, 0, 1e8]), "slope at the origin, -1e.11 Pa"),
    "convex": (
        ([0, 1e-3, 2e-3, 3e-3], [0, 1e8, 1.5e8, 3e8], "elastic"),
        r"stress\[2\]: elastic unloading needs a concave curve",
    ),
    "convex behind": (
        ([-3e-3, -2e-3, -1e-3, 0, 1e-3], [-3e8, -1.5e8, -1e8, 0, 1e8], "elastic"),
        r"stress\[1\]: elastic unloading needs a concave curve",
    ),
    "falling": (
        ([0, 1e-3, 2e-3], [0, 1e8, 0.5e8], "elastic"),
        r'stress\[1\]: elastic unloading needs .* use unloading="reversible"',
    ),
    "unequal": (
        ([-2e-3, 0, 1e-3], [-1e8, 0, 1e8], "elastic"),
        "segment 0 from the origin has 1e.11 and 5e.10 Pa",
    ),
    "unequal later": (
        ([-2e-3, -1e-3, 0, 1e-3, 2e-3], [-1.5e8, -1e8, 0, 1e8, 1.2e8], "elastic"),
        "segment 1 from the origin has 2e.10 and 5e.10 Pa",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_points_are_refused(name):
    arguments, message = BAD[name]
    with pytest.raises(ValueError, match=message):
        jc.Polygonal(*arguments)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: jc.Elastic(-1.0), "E = -1.0: Young's modulus must be positive"),
        (lambda: jc.Elastic(0), "E = 0.0: Young's modulus must be positive"),
        (lambda: jc.Elastic([1.0, 2.0]), r"E: expected a scalar .* got shape \(2,\)"),
        (lambda: jc.Elastic("soft"), "E: expected numbers"),
        (
            lambda: materials.steel(ultimate_strain=1e-3),
            r"strain\[1\] .* must be above strain\[0\]",
        ),
        (lambda: materials.steel(hardening=-0.1), r"stress\[0\]: elastic unloading needs"),
        (lambda: materials.strand(ultimate_strain=5e-3), r"strain\[2\] = 0.005: must be above"),
    ],
)
def test_bad_numbers_are_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_nan_in_the_points_is_no_error_but_gives_nan():
    """A batch survives it; an analysis turns it into a status."""
    law = jc.Polygonal([0, 1e-3, 2e-3], [0, np.nan, 2e8])
    assert np.isnan(law.stress_at(5e-4))


def test_laws_work_under_jit_with_traced_points():
    at = samples(LAWS["unsymmetric"], 50)

    @functools.partial(jax.jit, static_argnums=0)
    def through(unloading, strain, stress):
        made = jc.Polygonal(strain, stress, unloading)
        plastic = jnp.zeros((50, made.n_plastic)) if made.n_plastic else None
        return made.stress_at(at, plastic)

    for unloading, law in (
        ("reversible", LAWS["unsymmetric"]),
        ("elastic", ELASTIC["one corner against two"]),
    ):
        got = through(unloading, *points_of(law))
        inside = (at >= law.strain[0]) & (at <= law.strain[-1])
        expected = curve(*points_of(law), at)
        assert np.abs(np.where(inside, got, 0.0) - expected).max() <= 4 * rounding(law)
