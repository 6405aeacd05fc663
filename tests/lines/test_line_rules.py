"""What is refused when it is known fails when it is traced: numbers of lines, case by case."""

import numpy as np
import pytest

import jaxcable as jc

BAD = {
    "area": -1.0,
    "modulus": -1.0,
    "weight": -1.0,
    "diameter": -1.0,
    "station": -1.0,
    "string_weight": -1.0,
    "parameter": -1.0,
    "ice": -0.01,
    "wind": -100.0,
    "drag": -1.0,
    "extra": -1.0,
    "ice_density": -900.0,
}
GOOD = {
    **{"area": 4e-4, "modulus": 7e10, "weight": 15.0, "diameter": 0.028, "station": 300.0},
    **{"string_weight": 900.0, "parameter": 1500.0, "ice": 0.01, "wind": 100.0, "drag": 1.0},
    **{"extra": 1.0, "ice_density": 900.0},
}


def loaded(v):
    """Sags of two spans in one state, with all numbers from `v`, and the status."""
    layer = jc.catalogue.Layer([0.0, v["modulus"]], v["modulus"], 2e-5)
    conductor = jc.catalogue.Conductor((layer,), v["area"], v["diameter"], v["weight"], 1e5)
    station = np.array([0.0, 1.0, 2.0]) * v["station"]
    section = jc.lines.LineSection(
        *(conductor, station, np.zeros(3), np.full(3, 25.0), ["post", "suspension", "post"]),
        string_length=2.5,
        string_weight=v["string_weight"],
    )
    names = ("ice", "wind", "drag", "extra", "ice_density")
    state = jc.lines.LineState(5.0, **{name: v[name] for name in names})
    strung = jc.lines.string(section, parameter=v["parameter"])
    found = jc.lines.analyse(section, strung, {"state": state})
    return found.status[0], found.sag[0]


@pytest.mark.parametrize("name", BAD)
def test_known_numbers_are_refused(name):
    with pytest.raises(ValueError, match=r"must not be negative|must be positive"):
        loaded(GOOD | {name: BAD[name]})


@pytest.mark.slow
def test_traced_numbers_fail_in_their_own_cases():
    cases = {name: np.full(1 + len(BAD), value) for name, value in GOOD.items()}
    for k, (name, value) in enumerate(BAD.items()):
        cases[name][1 + k] = value
    codes, sags = (np.asarray(x) for x in jc.batched(loaded)(cases))
    assert codes[0] == jc.status.OK and np.isfinite(sags[0]).all()
    failed = {name: codes[1 + k] != jc.status.OK for k, name in enumerate(BAD)}
    assert all(failed.values()), failed
    assert np.isnan(sags[1:]).all()


def test_points_of_the_ground_must_go_on():
    drake = jc.catalogue.conductor("Drake")
    table = drake, [0.0, 300.0], [0.0, 0.0], [20.0, 20.0], "post"
    for again in (100.0, 50.0):
        profile = [[0.0, 0.0], [100.0, 1.0], [again, 4.0], [300.0, 0.0]]
        with pytest.raises(ValueError, match=r"profile\[2\]: its station, .* must be more"):
            jc.lines.LineSection(*table, profile=profile)


@pytest.mark.parametrize("broken", [2.5, -1, True, "1", float("nan")])
def test_a_broken_span_is_a_whole_number(broken):
    with pytest.raises(ValueError, match=r"broken = .*: expected a whole number"):
        jc.lines.LineState(broken=broken)
    assert jc.lines.LineState(broken=np.int64(1)).broken == 1
