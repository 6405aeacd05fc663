"""What is refused when it is known fails when it is traced: numbers of masts, case by case."""

import numpy as np
import pytest

import jaxcable as jc

SECTION = {"EA": 2e9, "EI": 1e8, "GJ": 4e7, "weight": 900.0, "drag_area": 0.4, "ice_width": 4.0}
GUYS = {"radius": 15.0, "EA": 2e7, "weight": 12.0, "diameter": 0.016, "tension": 20e3, "drag": 1.2}
DISH = {"drag_area": 1.0, "weight": 500.0}
STATE = {"wind_factor": 1.4, "ice": 0.01, "most_ice": 1.4, "weight_factor": 1.1}
GOOD = {
    f"{part} {name}": value
    for part, own in (("section", SECTION), ("guys", GUYS), ("dish", DISH), ("state", STATE))
    for name, value in own.items()
}


def loaded(v):
    """Status and largest tension of a mast with one level of guys in wind from two sides."""

    def own(part):
        return {k.partition(" ")[2]: x for k, x in v.items() if k.startswith(part)}

    guys = {"height": 20.0, "azimuths": [0.0, 120.0, 240.0], "strength": 2e5}
    dish = jc.masts.Ancillary(18.0, **own("dish"))
    level = jc.masts.GuyLevel(**guys, **own("guys"))
    mast = jc.masts.GuyedMast([jc.masts.MastSection(20.0, **own("section"))], [level], [dish])
    wind = jc.masts.MastState(jc.WindTable(pressures=500.0), **own("state"))
    found = jc.masts.analyse(jc.masts.erect(mast), {"wind": wind}, [0.0, 90.0])
    return found.status.max(), found.forces.tensions.max()


@pytest.mark.parametrize("name", GOOD)
def test_known_numbers_are_refused(name):
    with pytest.raises(ValueError, match=r"must not be negative|must be positive"):
        loaded(GOOD | {name: -GOOD[name]})


@pytest.mark.slow
def test_traced_numbers_fail_in_their_own_cases():
    cases = {name: np.full(1 + len(GOOD), value) for name, value in GOOD.items()}
    for k, name in enumerate(GOOD):
        cases[name][1 + k] *= -1
    codes, tensions = (np.asarray(x) for x in jc.batched(loaded)(cases))
    assert codes[0] == jc.status.OK and np.isfinite(tensions[0])
    failed = {name: codes[1 + k] != jc.status.OK for k, name in enumerate(GOOD)}
    assert [name for name, found in failed.items() if not found] == []
    assert np.isnan(tensions[1:]).all()
