"""A whole job on a line: what stretches it, overloads it and is said of it. One span for all."""

import dataclasses

import numpy as np
import pytest

import jaxcable as jc

State = jc.lines.LineState
ICE = State(-5.0, ice=0.02)


def section_of(conductor="Drake", length=300.0, **given):
    """A span on two posts."""
    one = jc.catalogue.conductor(conductor)
    return jc.lines.LineSection(one, [0.0, length], [0.0, 0.0], [40.0, 40.0], "post", **given)


def study_of(states, stringing, length=300.0, loads=()):
    """The study of a span on two posts."""
    return jc.lines.study_line(
        jc.lines.Line(section_of(length=length), stringing, states, loads, temperatures=(15.0,))
    )


@pytest.mark.parametrize("length", [300.0, 1000.0])
def test_after_the_load_that_stretches_it_the_conductor_is_as_in_it(length):
    """At the corner of first loading and unloading the final state is the initial one.

    To 1e-5: the slope with which a catenary is elastic is not the same to second order.
    """
    states = {"ice": ICE, "again": jc.replace(ICE, condition="final")}
    stringing = {"parameter": 1400.0, "temperature": 10.0}
    study = study_of(states, stringing, length, loads=("ice",))
    found = study.results
    assert study.status == 0
    np.testing.assert_array_equal(found.status, 0)
    np.testing.assert_allclose(found.horizontal[1], found.horizontal[0], rtol=1e-5)
    np.testing.assert_allclose(found.sag[1], found.sag[0], rtol=1e-5)


def test_overloads_are_warned_of_and_a_report_says_what_is_not_known():
    with pytest.warns(jc.InputWarning, match=r"ice = 20: more than 0\.3 m"):
        State(-5.0, ice=20.0)
    states = {"calm": State(), "ice": State(-5.0, ice=0.12)}
    with pytest.warns(jc.InputWarning) as seen:
        study = study_of(states, {"parameter": 1400.0}, loads=("ice",))
    assert study.status == 0
    texts = sorted(str(one.message) for one in seen)
    assert len(texts) == 2 and "calm" not in "".join(texts)
    assert texts[0].startswith("strain beyond the curves of Drake in the states 'ice'")
    assert texts[1].startswith("tension above the rated strength in the states 'ice' (")
    # what is said follows from the line: that of another conductor, with these results
    hawk = section_of("Hawk", profile=[[0.0, 0.0], [250.0, 1.0]])
    final = {name: jc.replace(state, condition="final") for name, state in states.items()}
    line = study.line._replace(section=hawk, states=final)
    text = "\n".join(dataclasses.replace(study, line=line).report().summary)
    for part in (
        "strung with catenary parameter 1400 m at 15 degC",
        "weight 9.57 N/m, EA 21.64 MN, diameter 21.80 mm, rated strength 84.9 kN",
        "ground is known from 0 to 250 m only: clearances leave out all or part of spans 1-2",
        "is elastic, without permanent stretch: the final states calm, ice are as initial ones",
    ):
        assert part in text
    with pytest.raises(ValueError, match=r"states\['calm'\]: is final, but no state stretches"):
        jc.lines.study_line(line._replace(loads=()))


def test_a_tension_in_kilonewtons_is_warned_of():
    with pytest.warns(jc.InputWarning, match=r"24 N: below 0\.1 % of the rated .* in N\?"):
        study = study_of({"calm": State()}, {"horizontal_tension": 24.0})
    assert study.status != 0
