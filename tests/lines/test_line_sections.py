"""Sections of overhead lines: equilibrium apart, broken conductors, pulleys, derivatives."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import line_spans, taylor

import jaxcable as jc

State = jc.lines.LineState
STATES = {
    "everyday": State(15.0),
    "hot": State(75.0, condition="final"),
    "cold": State(-20.0, condition="final"),
    "ice": State(-5.0, ice=0.02),
    "uneven ice": State(-5.0, ice=[0.0, 0.02, 0.02, 0.0, 0.0, 0.02]),
    "oblique wind": State(5.0, wind=600.0, wind_direction=60.0),
    "ice and wind": State(-5.0, ice=0.01, wind=200.0, drag=1.1),
}


def six_spans(conductor="Drake", **numbers):
    """A section of six unequal spans with unequal levels, an angle and an arm."""
    given = {
        "station": [0.0, 300.0, 640.0, 900.0, 1250.0, 1500.0, 1800.0],
        "ground": [100.0, 112.0, 131.0, 108.0, 99.0, 121.0, 110.0],
        "height": [24.0, 27.0, 25.0, 30.0, 25.0, 25.0, 24.0],
        "offset": [4.0] * 7,
        "angle": [0.0, 0.0, 0.0, 0.0, 4.0, 0.0, 0.0],
        "string_length": 2.5,
        "string_weight": 900.0,
        "string_area": 0.4,
    }
    kinds = ["strain", *["suspension"] * 5, "strain"]
    return jc.lines.LineSection(jc.catalogue.conductor(conductor), kinds=kinds, **given | numbers)


@functools.cache
def analysed():
    """The section strung, its permanent strains, and its states."""
    section = six_spans()
    strung = jc.lines.string(section, parameter=1500.0, temperature=15.0)
    left = jc.lines.stretch(section, strung, {"ice": STATES["ice"]}, STATES["everyday"])
    found = jc.lines.analyse(section, strung, STATES, permanent=left)
    assert int(strung.status) == jc.status.OK and (found.status == jc.status.OK).all()
    return section, strung, left, found


def test_all_states_are_in_equilibrium():
    """Catenaries by quadrature from positions and lengths: forces on clamps to 1e-8 of the tension.

    The law of the conductor, evaluated apart, gives the mean tension to the same digits.
    """
    section, strung, left, found = analysed()
    for k, (name, state) in enumerate(STATES.items()):
        rest, places = np.asarray(found.rest_length[k]), np.asarray(found.positions[k])
        loads = line_spans.state_loads(section, state, strung.length, rest)
        stiffness = np.asarray(found.stiffness[k])
        pulls = [
            line_spans.end_pulls(places[a], places[b], loads[j], rest[j], stiffness[j])
            for j, (a, b) in enumerate(section.layout.spans)
        ]
        error = line_spans.node_forces(section, state, places, pulls)
        largest = np.max(np.linalg.norm(pulls, axis=2))
        assert np.abs(error).max() < 1e-8 * largest, name
        permanent = left if state.condition == "final" else np.full_like(left, -1.0)
        for j, pull in enumerate(pulls):
            along = np.linalg.norm(line_spans.tensions_along(pull[0], loads[j]), axis=1)
            mean = line_spans.WEIGHTS @ along
            law = line_spans.conductor_tension(
                section.conductor, float(found.strain[k, j]), float(state.temperature), permanent[j]
            )
            assert abs(law / mean - 1) < 1e-8, (name, j)


def test_loads_on_towers_are_those_of_the_line():
    """The sum over all towers is the whole load; free strings transfer no moment."""
    section, strung, _, found = analysed()
    along = np.asarray(section.bisectors())
    for k, (name, state) in enumerate(STATES.items()):
        total = np.zeros(3)
        for one, (forward, left, down) in zip(
            section.layout.attachments, np.asarray(found.attachment_forces[k]), strict=True
        ):
            x, y = along[one.tower]
            total += [forward * x - left * y, forward * y + left * x, -down]
        loads = line_spans.state_loads(section, state, strung.length, found.rest_length[k])
        whole = loads.sum(0) + line_spans.string_loads(section, state).sum(0)
        assert np.abs(total - whole).max() < 1e-6 * np.abs(loads).sum(), name


@pytest.mark.slow
def test_broken_conductor_is_that_of_a_chain_of_catenaries():
    """An elastic conductor: positions of all clamps by another solver to 1e-6 m."""
    section = six_spans("243-AL1/39-ST1A")
    strung = jc.lines.string(section, parameter=1500.0, temperature=15.0)
    found = jc.lines.analyse(section, strung, {"broken": State(15.0, broken=2)})
    assert int(found.status[0]) == jc.status.OK
    lengths = np.asarray(strung.length)
    law = section.conductor
    warmer = 15.0 - float(law.temperature)
    # an elastic layer: heat lengthens, EA holds per length at the temperature of the curves
    free = lengths * (1 + float(law.layers[0].expansion) * warmer)
    stiffness = float(law.area * law.layers[0].modulus) * free / lengths
    start = np.asarray(found.positions[0]).copy()
    start[[hung for _, hung in section.layout.strings]] += np.random.default_rng(0).normal(
        scale=0.02, size=(7, 3)
    )
    weights = float(law.weight) * lengths  # those of the mass
    places, residual = line_spans.broken_chain(
        section, State(15.0), free, stiffness, weights, start, broken=2
    )
    assert residual < 1e-3 and float(found.horizontal[0, 2]) == 0.0
    assert np.abs(places - np.asarray(found.positions[0])).max() < 1e-6
    swing = np.asarray(found.swing[0, :, 1])
    assert swing[2] < -60 and swing[3] > 60  # the strings beside the broken span


def test_strings_hang_plumb_as_strung():
    section, strung, _, found = analysed()
    assert (
        np.abs(np.asarray(strung.horizontal) / (1500.0 * section.conductor.weight) - 1).max() < 1e-9
    )
    np.testing.assert_allclose(found.horizontal[0], strung.horizontal, rtol=1e-8)
    swing = np.asarray(found.swing[0, 1:-1])
    # the string at the angle swings in, which turns the spans beside it a little
    assert np.abs(swing[:, 1]).max() < 0.05 and np.abs(swing[[0, 1], 0]).max() < 0.05
    assert 5 < swing[3, 0] < 45  # at the angle, towards the inside: to the left


@pytest.mark.slow
def test_sag_and_tension_state_the_same_stringing():
    section = six_spans()
    first = jc.lines.string(section, parameter=1500.0, temperature=15.0)
    level = float(1500.0 * section.conductor.weight)
    second = jc.lines.string(section, horizontal_tension=level, temperature=15.0)
    np.testing.assert_allclose(second.length, first.length, rtol=1e-12)
    post = jc.lines.LineSection(section.conductor, [0.0, 400.0], [0.0, 30.0], [20.0, 20.0], "post")
    strung = jc.lines.string(post, sag=12.0, temperature=0.0)
    found = jc.lines.analyse(post, strung, {"as strung": State(0.0)})
    assert abs(float(found.sag[0, 0]) - 12.0) < 1e-8


@pytest.mark.slow
def test_pulleys_share_the_conductor():
    """The tension is the same on both sides of a pulley, and rises with its level."""
    section, strung, _, _ = analysed()
    found = jc.lines.pulleys(section, strung, [15.0])
    assert int(found.status[0]) == jc.status.OK
    ends = np.asarray(found.tensions[0])
    np.testing.assert_allclose(ends[:-1, 1], ends[1:, 0], rtol=1e-9)
    # tension over weight is the height above the directrix: differences of levels of pulleys
    rest, load = np.asarray(found.clamped.rest_length[0]), np.asarray(found.clamped.span_load[0])
    weight = -load[:, 2].sum() / rest.sum()
    nodes = np.asarray(strung.clamps)[
        [section.layout.spans[0][0], *(b for _, b in section.layout.spans)]
    ]
    levels = np.array([ends[0, 0], *ends[:, 1]]) / weight
    elastic = np.array([ends[0, 0], *ends[:, 1]]) ** 2 / (
        2 * weight * np.mean(found.clamped.stiffness[0])
    )
    np.testing.assert_allclose(np.diff(levels + elastic), np.diff(nodes[:, 2]), atol=1e-3)
    assert np.abs(np.asarray(found.offsets[0])).max() < 0.1


@pytest.mark.slow
def test_ruling_span_is_exact_for_equal_level_spans():
    """And errs where spans are unequal: the strings swing, and the tensions differ."""
    equal = jc.lines.LineSection(
        jc.catalogue.conductor("Drake"),
        [0.0, 300.0, 600.0, 900.0],
        [0.0] * 4,
        [25.0, 27.5, 27.5, 25.0],
        ["post", "suspension", "suspension", "post"],
        string_length=2.5,
        string_weight=900.0,
    )
    states = {"hot": State(75.0), "ice": State(-5.0, ice=0.02)}
    strung = jc.lines.string(equal, parameter=1500.0, temperature=15.0)
    found = jc.lines.analyse(equal, strung, states)
    ruling = jc.lines.ruling_span(equal, strung, states, found)
    # one strain against the elastic catenary: some 1e-5; ice counts per unstressed length there,
    # and per stretched length here: strain of 4e-4
    relative = np.abs(np.asarray(ruling.sag_error / found.sag)).max(1)
    assert relative[0] < 1e-4 and relative[1] < 1e-3
    section, strung, left, found = analysed()
    ruling = jc.lines.ruling_span(section, strung, STATES, found, permanent=left)
    relative = np.abs(np.asarray(ruling.sag_error / found.sag))
    assert relative[0].max() < 1e-3 and 0.003 < relative[1].max() < 0.02
    assert np.isnan(relative[4]).all()  # uneven ice has no ruling span


@pytest.mark.slow
def test_clearance_has_derivatives_by_heights_and_arms():
    """Taylor's test of the least height above the ground when hot, over a slope across the line."""

    def least(numbers):
        section = jc.lines.LineSection(
            jc.catalogue.conductor("Drake"),
            [0.0, 300.0, 620.0],
            [0.0, 5.0, 2.0],
            kinds=["post", "suspension", "post"],
            angle=[0.0, 3.0, 0.0],
            string_length=2.5,
            string_weight=900.0,
            **numbers,
        )
        strung = jc.lines.string(section, parameter=1500.0, temperature=15.0)
        found = jc.lines.analyse(section, strung, {"hot": State(75.0)})
        return jnp.min(found.clearance[0]), found.status[0]

    heights, offsets = [24.0, 27.0, 25.0], [4.0, 3.0, 4.0]
    taylor.assert_gradient(least, {"height": heights, "offset": offsets})


@pytest.mark.slow
def test_states_in_a_batch_are_those_one_by_one():
    section, strung, left, _ = analysed()
    states = {f"{t:.1f}": State(float(t)) for t in np.linspace(-20.0, 80.0, 70)}
    found = jc.lines.analyse(section, strung, states, permanent=left)
    some = {name: states[name] for name in list(states)[::23]}
    alone = jc.lines.analyse(section, strung, some, permanent=left)
    np.testing.assert_allclose(found.sag[::23], alone.sag, rtol=1e-8)
    assert (np.diff(np.asarray(found.sag).mean(1)) > 0).all()


@pytest.mark.slow
def test_strain_towers_in_the_middle_separate_tension_sections():
    section = jc.lines.LineSection(
        jc.catalogue.conductor("Drake"),
        [0.0, 250.0, 600.0, 900.0],
        [0.0] * 4,
        [25.0] * 4,
        ["strain", "suspension", "strain", "strain"],
        string_length=[2.5, 2.5, 0.0, 0.0],
        string_weight=900.0,
    )
    assert section.layout.tension_sections == [[0, 1], [2]]
    assert [one.side for one in section.layout.attachments] == [
        "ahead",
        "",
        "back",
        "ahead",
        "back",
    ]
    strung = jc.lines.string(section, parameter=1500.0, temperature=15.0)
    state = {"ice on the last span": State(-5.0, ice=[0.0, 0.0, 0.02])}
    found = jc.lines.analyse(section, strung, state)
    tree = jc.lines.load_trees(section, found)["ice on the last span"]["3"]
    assert tree["back"]["longitudinal"] < 0 < tree["ahead"]["longitudinal"]
    assert tree["ahead"]["longitudinal"] > 1.5 * -tree["back"]["longitudinal"]
    alone = {"calm": State(-5.0)}
    calm = jc.lines.analyse(section, strung, alone)
    np.testing.assert_allclose(calm.horizontal[0, :2], found.horizontal[0, :2], rtol=1e-9)


@pytest.mark.slow
def test_uplift_at_a_low_tower():
    """A cold conductor lifts a post in a dip: twice the level tension times the slopes at it."""
    drake = jc.catalogue.conductor("Drake")
    section = jc.lines.LineSection(
        drake, [0.0, 250.0, 500.0], [0.0] * 3, [45.0, 20.0, 45.0], "post"
    )
    strung = jc.lines.string(section, parameter=1500.0, temperature=15.0)
    found = jc.lines.analyse(section, strung, {"cold": State(-20.0)})
    table = jc.lines.section_tables(section, {"cold": State(-20.0)}, found)["tower_loads"]
    assert [row[-1] for row in table.rows] == ["", "uplift", ""]
    level, weight = float(found.horizontal[0, 0]), float(-found.span_load[0, 0, 2])
    # from each side: level tension times the slope of the chord, less half of the load; to 1 %,
    # because the lower end of an inclined catenary carries a little less than half
    up = 2 * (level * 25.0 / 250.0 - 0.5 * weight)
    assert abs(-table.rows[1][5] / up - 1) < 0.01


WRONG = {
    "kinds": ({"kinds": "hanging"}, "kinds"),
    "stations": ({"station": [0.0, 0.0]}, "station"),
    "heights": ({"height": [1.0]}, "height"),
    "strings": ({"kinds": "suspension", "string_length": 0.0}, "string_length"),
    "names": ({"names": ["a", "a"]}, "names"),
    "profile": ({"profile": [1.0, 2.0]}, "profile"),
    "crossings": ({"crossings": {"road": [[0.0, 1.0]]}}, "road"),
}


@pytest.mark.parametrize("name", WRONG)
def test_wrong_sections_are_refused(name):
    given, text = WRONG[name]
    usual = {"station": [0.0, 300.0], "ground": [0.0, 0.0], "height": [20.0, 20.0], "kinds": "post"}
    with pytest.raises(ValueError, match=text):
        jc.lines.LineSection(jc.catalogue.conductor("Drake"), **usual | given)


def test_wrong_states_and_stringings_are_refused():
    section, strung, *_ = analysed()
    for states, text in (
        ({}, "states"),
        ({"x": State(ice=[0.1, 0.2])}, "ice"),
        ({"x": State(condition="final")}, "permanent"),
        ({"x": State(broken=9)}, "broken"),
    ):
        with pytest.raises(ValueError, match=text):
            jc.lines.analyse(section, strung, states)
    for given in ({}, {"sag": 1.0, "parameter": 2.0}, {"sag": -1.0}, {"sag": 1.0, "span": 9}):
        with pytest.raises(ValueError):
            jc.lines.string(section, **given)
    with pytest.raises(ValueError, match="condition"):
        State(condition="old")
    assert isinstance(jax.tree.leaves(section)[0], np.ndarray)


@pytest.mark.slow
@pytest.mark.parametrize("stretched", [False, True])
def test_a_span_beside_an_angle_tower_has_the_sag_that_is_stated(stretched):
    """To 1e-7 where loads count per stretched length, which lags behind by one round."""
    section = jc.lines.LineSection(
        *(jc.catalogue.conductor("Drake"), [0.0, 280.0, 450.0], [0.0, 15.0, 5.0], [25.0] * 3),
        ["post", "suspension", "post"],
        angle=[0.0, 12.0, 0.0],
        string_length=3.0,
        string_weight=900.0,
    )
    given = {"sag": 3.2, "span": 1, "temperature": 40.0, "stretched": stretched}
    strung = jc.lines.string(section, **given)
    states = {"as strung": jc.lines.LineState(40.0)}
    found = jc.lines.analyse(section, strung, states, stretched=stretched)
    assert strung.status == 0 and found.status[0] == 0
    assert abs(found.swing[0, 1, 0]) > 1.0  # degrees
    assert abs(float(found.sag[0, 1]) / 3.2 - 1) < 1e-7
