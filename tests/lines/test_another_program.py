"""Sections and states of aluminum alloy conductors against mechaphlowers, the program of RTE.

Numbers of its tests: test_cable_state_integration.py and test_model_ducloux_integration.py (2025).
It has catenaries with one elongation, that of their mean tension, rigid strings, and loads per
stretched length.
"""

import numpy as np
import pytest

import jaxcable as jc

State = jc.lines.LineState
EXPANSION = 23e-6


def alloy(area, diameter, weight, modulus):
    """An elastic conductor whose length is measured at 15 degrees C."""
    layer = jc.catalogue.Layer([0.0, modulus], modulus, EXPANSION)
    return jc.catalogue.Conductor((layer,), area, diameter, weight, 1e5, temperature=15.0)


# temperature C, ice m, wind N/m2: horizontal tension N, of a span of 480 m whose ends differ by
# 10 m, strung at 15 C with a parameter of 2000 m; ice of 6000 N/m3
STATES = {
    "15 C": ((15.0, 0.0, 0.0), 19109.88),
    "ice": ((15.0, 0.02, 0.0), 42098.906999),
    "ice and wind": ((15.0, 0.01, 200.0), 31745.051094),
    "25 C": ((25.0, 0.0, 0.0), 18380.111575),
}


def test_states_of_a_span():
    """Within 1e-6; under wind, where the plane of the cable leans, within 1e-4.

    There the horizontal tension is that across the load, here that along the span.
    """
    conductor = alloy(345.55e-6, 22.4e-3, 0.974 * 9.81, 59e9)
    section = jc.lines.LineSection(conductor, [0.0, 480.0], [0.0, 0.0], [30.0, 40.0], "post")
    strung = jc.lines.string(section, parameter=2000.0, temperature=15.0, stretched=True)
    states = {
        name: State(t, ice=ice, wind=wind, ice_density=6000 / 9.80665)
        for name, ((t, ice, wind), _) in STATES.items()
    }
    found = jc.lines.analyse(section, strung, states, stretched=True)
    assert (found.status == jc.status.OK).all()
    published = [tension for _, tension in STATES.values()]
    error = np.abs(np.asarray(found.horizontal[:, 0]) / published - 1)
    assert error[[0, 1, 3]].max() < 1e-6 and error[2] < 1e-4


ANGLES = {"offset": [0.0, 10.0, -10.0, 0.0], "angle": [0.0, 9.0, 0.0, 0.0]}  # 10 gon
CASES = {
    # heights of attachments, arms and angles; lengths without stress at 0 C; strings along the
    # bisector, across it, and downwards, as strung
    "level": (
        ([30.0, 33.0, 33.0, 30.0], {}),
        [497.647471727149, 299.883603547399, 397.144221942162],
        [
            [2.97187340066645, 0.0, 0.0, -2.981118867567],
            [0.0, 0.0, 0.0, 0.0],
            [-0.4098395910734, -3.0, -3.0, -0.336051033975601],
        ],
    ),
    "angle": (
        ([30.0, 53.0, 63.0, 65.0], ANGLES),
        [497.329093771962, 299.849533788068, 397.243869443178],
        [
            [2.98519820570843, 0.0203329438008079, 0.0259050035856634, -2.97622800585608],
            [0.0651438662085866, 0.92496568246559, 1.18432536063032, -0.0655978926646298],
            [-0.290427184214129, -2.85377382734816, -2.75621159763852, -0.371165426239995],
        ],
    ),
}


def section_of(heights, **given):
    """Spans of 500, 300 and 400 m with strings of 3 m, conductor of 600 mm2."""
    return jc.lines.LineSection(
        alloy(600.4e-6, 31.86e-3, 17.658, 60e9),
        [0.0, 500.0, 800.0, 1200.0],
        [0.0] * 4,
        heights,
        ["strain", "suspension", "suspension", "strain"],
        string_length=3.0,
        string_weight=[1000.0, 500.0, 500.0, 1000.0],
        **given,
    )


def strings_of(section, positions):
    """Vectors of the strings in the axes of their towers, [3, n_string], m."""
    along, places = np.asarray(section.bisectors()), np.asarray(positions)
    found = []
    for held, hung in section.layout.strings:
        axis = along[section.layout.towers[held]]
        drop = places[hung] - places[held]
        found.append([drop[:2] @ axis, drop[1] * axis[0] - drop[0] * axis[1], drop[2]])
    return np.array(found).T


@pytest.mark.slow_cases("level")
@pytest.mark.parametrize("name", CASES)
def test_sections_as_strung(name):
    """Lengths to 1e-6, strings to 0.2 mm: ours lengthen by 0.1 mm under 35 kN."""
    (heights, given), lengths, strings = CASES[name]
    section = section_of(heights, **given)
    strung = jc.lines.string(section, parameter=2000.0, temperature=15.0, stretched=True)
    assert int(strung.status) == jc.status.OK
    at_zero = np.asarray(strung.length) * (1 - 15 * EXPANSION)  # of 15 C
    np.testing.assert_allclose(at_zero, lengths, rtol=1e-6)
    np.testing.assert_allclose(strings_of(section, strung.clamps), strings, atol=2e-4)


@pytest.mark.slow
def test_wind_on_a_section():
    """300 N/m2 across: strings to 0.2 mm, loads on towers to 2e-4 of the tension."""
    section = section_of(CASES["level"][0][0])
    strung = jc.lines.string(section, parameter=2000.0, temperature=15.0, stretched=True)
    found = jc.lines.analyse(section, strung, {"wind": State(15.0, wind=300.0)}, stretched=True)
    assert int(found.status[0]) == jc.status.OK
    strings = [
        [2.97140319423837, -0.0178208618340392, -0.00222111510271174, -2.98084374666492],
        [0.187877333786573, 1.35446839777292, 1.33685663266011, 0.153911806319682],
        [-0.368055926075446, -2.67677002678937, -2.68566740501507, -0.301465941432917],
    ]
    np.testing.assert_allclose(strings_of(section, found.positions[0]), strings, atol=2e-4)
    loads = [  # longitudinal, transverse, vertical, daN
        [3911.79542, -4.89819371, -0.535288081, -3906.33052],
        [247.336911, 372.285443, 322.182818, 201.698053],
        [534.538576, 760.729616, 672.246587, 445.064517],
    ]
    own = np.asarray(found.attachment_forces[0]).T / 10
    np.testing.assert_allclose(own, loads, atol=2e-4 * 3912)
