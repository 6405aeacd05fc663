"""Sag-tension tables against published ones, another program, and the law of conductors apart."""

import functools

import jax.numpy as jnp
import numpy as np
import pytest
from oracles import line_spans

import jaxcable as jc
from jaxcable.lines.conductor_law import NO_SET, ConductorLaw
from jaxcable.lines.span_tables import _level_tension

FEET, POUNDS = 0.3048, 4.4482216152605
FALL_IN_SAG = 0.006  # ft, of a published sag: rounded to 0.01 ft

# State: temperature F, ice in, wind lbf/ft2, K lbf/ft; sag ft and tension lbf, final and initial.
# Drake, 700 ft, creep is a factor, 6300 lbf at 60 F initial: Grigsby (ed.), Electric Power
# Generation, Transmission, and Distribution (2007), table 14.5 (D. A. Douglass and R. Thrash)
SPAN_700 = {
    "heavy": (0, 0.5, 4.0, 0.3, 13.61, 11318, 13.55, 11361),
    "ice": (32, 0.5, 0.0, 0.0, 13.93, 9224, 13.33, 9643),
    "-20": (-20, 0, 0, 0, 8.22, 8161, 7.60, 8824),
    "0": (0, 0, 0, 0, 9.19, 7301, 8.26, 8115),
    "30": (30, 0, 0, 0, 10.75, 6242, 9.39, 7142),
    "60": (60, 0, 0, 0, 12.36, 5429, 10.65, 6300),
    "90": (90, 0, 0, 0, 13.96, 4809, 11.99, 5596),
    "120": (120, 0, 0, 0, 15.52, 4330, 13.37, 5020),
    "167": (167, 0, 0, 0, 16.97, 3960, 15.53, 4326),
    "212": (212, 0, 0, 0, 18.04, 3728, 17.52, 3837),
}
# Drake, 1000 ft, creep is no factor, 10000 lbf under heavy load, extra heavy ice stretches:
# Aluminum Company of America, Sag and Tension Data, "Heavy Loading for Comparison with Extra Heavy"
SPAN_1000 = {
    "extra": (0, 1.5, 0.0, 0.0, 41.11, 18287, 41.11, 18287),
    "heavy": (0, 0.5, 4.0, 0.3, 34.86, 9054, 31.53, 10000),
    "ice": (32, 0.5, 0.0, 0.0, 35.47, 7429, 31.49, 8358),
    "-20": (-20, 0, 0, 0, 30.11, 4564, 24.72, 5549),
    "0": (0, 0, 0, 0, 31.25, 4399, 25.84, 5311),
    "30": (30, 0, 0, 0, 32.77, 4197, 27.48, 4996),
    "60": (60, 0, 0, 0, 33.63, 4091, 29.09, 4721),
    "90": (90, 0, 0, 0, 34.49, 3990, 30.67, 4482),
    "120": (120, 0, 0, 0, 35.33, 3896, 32.20, 4271),
    "167": (167, 0, 0, 0, 36.64, 3759, 34.51, 3988),
    "212": (212, 0, 0, 0, 37.87, 3638, 36.64, 3759),
}
TABLES = {
    "700 ft": (700, SPAN_700, {"60": 6300.0}, ["heavy"], "60"),
    "1000 ft": (1000, SPAN_1000, {"heavy": 10000.0}, ["extra"], None),
}


def celsius(fahrenheit):
    """A temperature in degrees C."""
    return (fahrenheit - 32) / 1.8


def state_of(temperature, ice=0.0, wind=0.0, extra=0.0, **given):
    """A state by temperature, F, ice, in, wind, lbf/ft2, and K, lbf/ft; ice of 57 lb/ft3."""
    return jc.lines.LineState(
        celsius(temperature),
        ice=0.0254 * ice,
        wind=47.880259 * wind,
        extra=extra * POUNDS / FEET,
        ice_density=913.05,
        **given,
    )


@functools.cache
def computed(name):
    """The `SagTension` of a published table, and the table."""
    span, rows, limits, stretches, creep = TABLES[name]
    found = jc.lines.sag_tension(
        jc.catalogue.conductor("Drake"),
        span * FEET,
        {key: state_of(*row[:4]) for key, row in rows.items()},
        {key: value * POUNDS for key, value in limits.items()},
        stretched_by=stretches,
        creep=creep,
        tension="mean",
    )
    assert (found.initial.status == jc.status.OK).all()
    assert (found.final.status == jc.status.OK).all()
    return found, rows


@pytest.mark.slow_cases("1000 ft")
@pytest.mark.parametrize("name", TABLES)
def test_published_tables(name):
    """Every tension within 0.1 %, every sag within 0.1 % and its rounding.

    But for two: in the table of 700 ft the final tensions at 167 and 212 F are 0.13 and 0.11 %
    lower. There aluminum is slack and steel alone carries; the core of the table is 8e-6 shorter
    after its creep than by the polynomials of the catalogue.
    """
    found, rows = computed(name)
    for k, (key, row) in enumerate(rows.items()):
        for j, (sag, tension) in enumerate((row[6:], row[4:6])):
            slack = name == "700 ft" and key in ("167", "212") and j == 1
            allowed = 1.5e-3 if slack else 1e-3
            assert abs(float(found.tension[k, j]) / POUNDS / tension - 1) < allowed, (key, j)
            error = abs(float(found.sag[k, j]) / FEET - sag)
            assert error < allowed * sag + FALL_IN_SAG + (0.01 if slack else 0.0), (key, j)


@pytest.mark.slow
def test_parabola_catenary_and_elastic_catenary_beside_each_other():
    """The parabola errs by the square of the slope, one strain in a catenary by hardly anything."""
    found, rows = computed("1000 ft")
    exact = np.stack([found.sag, found.tension], axis=-1)
    catenary = np.abs(np.asarray(found.catenary) / exact - 1)
    parabola = np.abs(np.asarray(found.parabola)[..., 0] / exact[..., 0] - 1)
    assert catenary.max() < 1.2e-3 and parabola.max() < 6e-3
    assert parabola.mean() > catenary[..., 0].mean()
    table = jc.lines.sag_tension_table(found)
    assert len(table.rows) == len(rows) and table.columns[0] == "state"


@pytest.mark.slow
def test_horizontal_tensions_of_another_program():
    """SpanAnalyzer (its test of CatenaryCableReloader): Drake, 1200 ft, 6000 lbf at 60 F.

    Before and after stretch by the last load; it prints 0.1 lbf, 1.5e-5 of the least one, and
    counts the weight per stretched length of the whole span. Loads are across and downwards.
    """
    drake = jc.catalogue.conductor("Drake")
    section = jc.lines.LineSection(drake, [0.0, 1200 * FEET], [0.0, 0.0], [0.0, 0.0], "post")
    level = 6000 * POUNDS
    given = {"horizontal_tension": level, "temperature": celsius(60), "stretched": True}
    strung = jc.lines.string(section, **given)

    def loaded(temperature, across=0.0, down=1.094, condition="initial"):
        """A state by the whole loads per length, lbf/ft."""
        thick, diameter = 0.0127, float(drake.diameter)
        more = (down - 1.094) * POUNDS / FEET
        return jc.lines.LineState(
            celsius(temperature),
            ice=thick,
            ice_density=more / (9.80665 * np.pi * thick * (diameter + thick)),
            wind=across * POUNDS / FEET / (diameter + 2 * thick),
            condition=condition,
        )

    cases = [(60,), (0,), (212,), (0, 2.072, 3.729), (0, 1.405, 2.099)]
    initial = {str(case): loaded(*case) for case in cases}
    found = jc.lines.analyse(section, strung, initial, stretched=True)
    left = jc.lines.stretch(section, strung, {"last": initial[str(cases[-1])]}, stretched=True)
    after = {str(case): loaded(*case, condition="final") for case in cases}
    final = jc.lines.analyse(section, strung, after, permanent=left, stretched=True)
    for results, published in (
        (found, [6000.0, 6787.6, 4702.2, 17125.9, 12146.8]),
        (final, [5561.5, 6320.1, 4537.2, 17126.0, 12147.0]),
    ):
        assert (results.status == jc.status.OK).all()
        np.testing.assert_allclose(_level_tension(results) / POUNDS, published, rtol=3e-5)


def test_law_of_a_conductor_is_that_of_its_layers():
    drake, none = jc.catalogue.conductor("Drake"), jnp.full(2, NO_SET)
    permanent = jnp.array([8e-4, 1e-4])
    for temperature in (-20.0, 21.0, 100.0):
        for left in (none, permanent):
            for strain in (5e-4, 1e-3, 3e-3, 6e-3):
                own = line_spans.conductor_tension(drake, strain, temperature, np.asarray(left))
                of = ConductorLaw(drake, temperature, left)
                law = of.tension(jnp.asarray(strain))
                assert abs(float(law) - own) < 1e-9 * abs(own)
                assert abs(float(of.strain(law)) - strain) < 1e-12


def test_aluminum_goes_slack_at_heat():
    """Above it, steel alone: the tension falls with its own expansion and modulus."""
    drake, none = jc.catalogue.conductor("Drake"), jnp.full(2, NO_SET)
    stresses, own = ConductorLaw(drake, 120.0, none).layer_stresses(jnp.asarray(1.5e-3))
    assert float(stresses[0]) == 0.0 and float(stresses[1]) > 0 and float(own[0]) < 0
    left = ConductorLaw(drake, 0.0, none).permanent_after(jnp.asarray(3e-3))
    assert (np.asarray(left) > 0).all() and float(left[0]) > 5 * float(left[1])
    again = ConductorLaw(drake, 0.0, left).permanent_after(jnp.asarray(1e-3))
    np.testing.assert_array_equal(again, left)


# Arbutus, 795 kcmil AAC of 37 strands. No published table was found beside the curves of such a
# conductor, so these curves are made up, in Pa: first loading, and ten years of creep
FIRST, CREEP, FINAL = [0.0, 56e9, -6.5e12, 4e14], [0.0, 34e9, -3.0e12, 1e14], 59e9
AREA, DIAMETER, WEIGHT, WARMS = 402.8e-6, 26.06e-3, 10.88, 23e-6
AAC = {  # temperature C, ice m, wind N/m2, extra N/m
    "heavy": (-18.0, 0.0127, 190.0, 4.4),
    "-20": (-20.0, 0.0, 0.0, 0.0),
    "15": (15.0, 0.0, 0.0, 0.0),
    "75": (75.0, 0.0, 0.0, 0.0),
    "100": (100.0, 0.0, 0.0, 0.0),
}


def aac_strain(tension, temperature, curve=FIRST, permanent=None):
    """Strain of the conductor of one layer under a tension, N, over its length at 20 C."""
    stress = tension / AREA
    low, high = np.zeros_like(stress), np.full_like(stress, 5e-3)
    for _ in range(60):  # bisection on the curve, which rises
        middle = 0.5 * (low + high)
        below = np.polynomial.polynomial.polyval(middle, curve) < stress
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    if permanent is not None:
        low = np.maximum(low, permanent + stress / FINAL)
    return low + WARMS * (temperature - 20.0)


def aac_span(span, state, rest=None, tension=None, **law):
    """Unstressed length, sag, tension at the supports and in the mean of a level span.

    The length or the tension at the supports is given. Loads count per stretched length, so that
    the shape is a catenary; lengths by quadrature.
    """
    temperature, ice, wind, extra = state
    down = WEIGHT + 9.80665 * 913.05 * np.pi * ice * (DIAMETER + ice)
    load = np.hypot(down, wind * (DIAMETER + 2 * ice)) + extra
    places, weights = np.polynomial.legendre.leggauss(20)

    def found(level):
        c, half = level / load, span / 2
        x = half * places
        rate = np.cosh(x / c)  # of the length of the curve
        length = half * weights @ (rate / (1 + aac_strain(level * rate, temperature, **law)))
        mean = level * (weights @ rate**2) / (weights @ rate)
        return length, c * (np.cosh(half / c) - 1), level * np.cosh(half / c), mean

    low, high = 500.0, 60e3
    for _ in range(60):
        level = 0.5 * (low + high)
        length, _, top, _ = found(level)
        more = top < tension if rest is None else length > rest
        low, high = (level, high) if more else (low, level)
    return found(level)


@pytest.mark.slow
def test_table_of_an_aluminum_conductor_against_quadrature():
    """One layer, strung to 20 % of its strength at 15 C: before and after stretch, to 2e-6.

    The permanent strain is that by the mean tension, one for the whole span.
    """
    span, limit = 200.0, 12.4e3
    layer = jc.catalogue.Layer(FIRST, FINAL, WARMS, creep=CREEP)
    conductor = jc.catalogue.Conductor(
        (layer,), AREA, DIAMETER, WEIGHT, 61.8e3, temperature=20.0, name="Arbutus"
    )
    states = {
        name: jc.lines.LineState(t, ice=ice, wind=wind, extra=extra, ice_density=913.05)
        for name, (t, ice, wind, extra) in AAC.items()
    }
    found = jc.lines.sag_tension(
        conductor, span, states, {"15": limit}, stretched_by=["heavy"], creep="15"
    )
    assert (found.initial.status == jc.status.OK).all()
    assert (found.final.status == jc.status.OK).all()
    rest, *_ = aac_span(span, AAC["15"], tension=limit)
    sets = []
    for name, curve in (("heavy", FIRST), ("15", CREEP)):
        mean = aac_span(span, AAC[name], rest, curve=curve)[-1]
        sets.append(aac_strain(np.array([mean]), 20.0, curve)[0] - mean / AREA / FINAL)
    assert sets[1] > sets[0] > 0  # creep governs
    for k, state in enumerate(AAC.values()):
        for j, law in enumerate(({}, {"permanent": max(sets)})):
            _, sag, top, _ = aac_span(span, state, rest, **law)
            assert abs(float(found.tension[k, j]) / top - 1) < 2e-6, (k, j)
            assert abs(float(found.sag[k, j]) / sag - 1) < 2e-6, (k, j)


@pytest.mark.slow
def test_limits_after_stretch_and_the_governing_one():
    drake = jc.catalogue.conductor("Drake")
    states = {"15": jc.lines.LineState(15.0), "ice": jc.lines.LineState(-5.0, ice=0.01)}
    limits = {"15": (0.15 * float(drake.strength), "final"), "ice": 0.9 * float(drake.strength)}
    found = jc.lines.sag_tension(
        drake, 100.0, states, limits, stretched_by=["ice"], creep="15", rise=10.0
    )
    assert found.governing == "15" and (found.final.status == jc.status.OK).all()
    assert abs(float(found.tension[0, 1] / drake.strength) - 0.15) < 1e-8
    assert (found.tension[:, 0] >= found.tension[:, 1] * (1 - 1e-9)).all()
    assert (found.sag[0, 1] > found.sag[0, 0]) and (found.tension[1, 0] < limits["ice"])
    for wrong in ({"20": 1e4}, {}, {"15": 1e9}):
        with pytest.raises(ValueError):
            jc.lines.sag_tension(drake, 100.0, states, wrong)
