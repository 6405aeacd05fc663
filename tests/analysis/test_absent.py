"""Inputs and loads for elements that are not there: refused, a warning, or held until they act.

Loads belong to nodes and elements: they act whenever these are there.
"""

import warnings

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles.convergence import converged
from oracles.traced import traced

import jaxcable as jc
from jaxcable.analysis.preparation import prepare
from jaxcable.common import status

GUIDE = jc.pinned([0]) + jc.restrained([1], "xy")
PULL = jc.NodalLoads([1], (0.0, 0.0, -1e3))
AWAY = jc.Phase(removes="b", loads=PULL)
PHASE_INPUTS = {
    "pretension": 500.0,
    "force_density": 250.0,
    "prestrain": 5e-4,
    "rest_length": 1.99,
    "jacking": 500.0,
    "end_tension": 500.0,
    "shortening": 1e-3,
    "temperature": -30.0,
}


def hangers():
    """Two groups of bars of 2 m from node 0 to node 1."""
    bars = {name: jc.Bars([[0, 1]], axial_stiffness=1e6, expansion=1e-5) for name in "ab"}
    return jc.Structure([[0, 0, 0], [0, 0, -2.0]], bars, supports=GUIDE)


def chain():
    """Two bars, one below the other."""
    bars = jc.Bars([[0, 1], [1, 2]], axial_stiffness=1e6)
    held = jc.pinned([0]) + jc.restrained([1, 2], "xy")
    return jc.Structure([[0, 0, 0], [0, 0, -2.0], [0, 0, -4.0]], bars, supports=held)


def said(structure, phases):
    """The warnings of an analysis, which is prepared and not carried out."""
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always")
        prepare(structure, phases, None, None)
    return [str(one.message) for one in found]


@pytest.mark.parametrize("name", PHASE_INPUTS)
def test_a_statement_that_names_what_is_not_there_is_refused(name):
    value = PHASE_INPUTS[name]
    structure, back = hangers(), jc.Phase(adds="b")
    for stated in (value, np.array([value])):
        with pytest.raises(ValueError, match=rf"^phases\[1\].{name}\['b'\]: no element of the gr"):
            said(structure, [AWAY, jc.Phase(**{name: {"b": stated}}), back])
    with pytest.raises(ValueError, match=rf"^phases\[0\].{name}: element 1 is not there"):
        bars = jc.replace(chain().elements, expansion=1e-5)
        bars = jc.replace(chain(), elements=bars)
        said(bars, [jc.Phase(removes=jc.only([1]), **{name: jc.only([0, 1], value)})])
    # where it is there again, and for the other group, all is well
    good = [AWAY, jc.Phase(**{name: {"a": value}}), jc.Phase(adds="b", **{name: {"b": value}})]
    assert said(structure, good) == []


def test_increments_of_zero_state_nothing():
    for name in ("shortening", "temperature"):
        for stated in (0.0, np.zeros(1), jc.only([0], 0.0)):
            assert said(hangers(), [AWAY, jc.Phase(**{name: {"b": stated}})]) == []


def test_one_number_is_for_what_is_there():
    """By hand: 500 N in `a` as stated, then 1 kN more shared by both; `b` had found its end."""
    phases = [AWAY, jc.Phase(pretension=500.0), jc.Phase(adds="b", loads=PULL)]
    solution = converged(jc.solve(hangers(), phases))
    rest = 2.0 / (1 + 500.0 / 1e6)
    found = rest * (1 + 1e3 / 1e6)  # where `b` finds the end under the first kN
    at = (2e3 / 1e6 + 2) / (1 / rest + 1 / found)
    expected = [1e6 * (at / rest - 1), 1e6 * (at / found - 1)]
    np.testing.assert_allclose([solution.tension[k][0] for k in "ab"], expected, atol=1e-6)
    for name in ("pretension", "end_tension"):  # that of bars is carried by jacks
        gone = [jc.Phase(removes=["a", "b"], **{name: 500.0})]
        some = [jc.Phase(removes="b", **{name: 500.0})]
        text = f"phases[0].{name}: has no effect: none of the elements that take it is there"
        assert any(text in t for t in said(hangers(), gone))
        assert not any(text in t for t in said(hangers(), some))


def test_numbers_of_arrays_are_for_what_is_there():
    """A warning only where the number was to stay: a phase adds the element and states nothing."""
    forces, away = np.array([500.0, 700.0]), jc.only([1])
    first = jc.Phase(pretension=forces, removes=away)
    lost = said(chain(), [first, jc.Phase(adds=away)])
    assert len(lost) == 1 and lost[0].startswith("phases[0].pretension[1] = 700: has no effect")
    assert said(chain(), [first, jc.Phase(adds=away, pretension=forces)]) == []
    assert said(chain(), [first, jc.Phase(adds=away, rest_length=jc.only([1], 1.9))]) == []
    assert said(chain(), [first]) == []
    turned = jc.Phase(shortening=np.array([0.1, 0.0]), removes=away)
    assert said(chain(), [turned, jc.Phase(adds=away)]) == []


def test_traced_masks_end_in_a_status():
    """The same rule as for masks that are known, in every phase, in one batch."""

    def codes(adds):
        stated = {"pretension": jc.only([1], 500.0)}
        phases = [jc.Phase(adds=adds, **stated), jc.Phase(adds=~adds)]
        return jnp.stack([phase.path.status[-1] for phase in jc.solve(chain(), phases).phases])

    found = traced(jax.vmap(codes))(np.array([[True, False], [False, True], [True, True]]))
    assert (found[0] == status.INVALID_INPUT).all()
    assert not found[1:].any()


def test_an_empty_list_adds_nothing():
    for empty in ([], (), {}):
        phase = jc.Phase(adds=empty, removes=empty)
        assert phase.adds is None and phase.removes is None
    # so that groups which cannot be added have no objection
    assert prepare(hangers(), [jc.Phase(adds=[], loads=PULL)], None, None).arrays is not None


# the cable hardly stretches, on purpose
@pytest.mark.slow
@pytest.mark.filterwarnings(r"ignore:elements\['cable'\].weight:jaxcable.InputWarning")
def test_loads_act_whenever_their_element_is_there():
    """A cantilever of two beams and a cable: removed, and added again, by statics.

    Line loads, self-weight and a load on a tip that nothing touches meanwhile: this one is held.
    """
    q, P, Q, w, length = 100.0, 300.0, 500.0, 20.0, 2.0  # N/m, N, N, N/m, m
    nodes = [[0.0, 0, 0], [length, 0, 0], [2 * length, 0, 0], [0, 5, 0], [0, 5, -3.0]]
    steel = jc.Section.rectangle(0.2, 0.4, jc.Elastic(2e14))  # hardly bends
    beams = jc.Beams([[0, 1], [1, 2]], section=steel)
    cable = jc.Cables([[3, 4]], axial_stiffness=1e12, weight=w)
    supports = jc.clamped([0]) + jc.pinned([3]) + jc.restrained([4], "xy")
    structure = jc.Structure(nodes, {"beam": beams, "cable": cable}, supports=supports)
    loads = [
        jc.LineLoads((0, 0, -q), on="beam"),
        jc.LineLoads((0, 0, -2 * w), on="cable", per="initial"),
        jc.SelfWeight(on="cable"),
        jc.NodalLoads([2, 4], [[0, 0, -P], [0, 0, -Q]]),
    ]
    gone = {"beam": jc.only([1]), "cable": jc.only([0])}
    phases = [jc.Phase(loads=loads), jc.Phase(removes=gone), jc.Phase(adds=gone), jc.Phase()]
    solution = converged(jc.solve(structure, phases))
    whole = [2 * q * length + P, 2 * q * length**2 + 2 * P * length, Q + 3 * 3 * w]
    part = [q * length, q * length**2 / 2, 0.0]
    for phase, expected in zip(solution.phases, (whole, part, whole, whole), strict=True):
        up = np.asarray(phase.reactions)[:, 2]
        moment = abs(float(phase.section_forces["beam"][0, 0, 4]))
        np.testing.assert_allclose([up[0], moment, up[3]], expected, rtol=1e-9, atol=1e-9)
        top = phase.tension["cable"][0]
        assert float(top) == pytest.approx(expected[2] - 1.5 * 3 * w if expected[2] else 0.0)
        away = expected is part
        # held where nothing touches them
        np.testing.assert_allclose(up[[2, 4]], [P, Q] if away else [0.0, 0.0], atol=1e-9)
        load = np.asarray(phase.load)[[2, 4], 2]
        there = [-P - q * length / 2, -Q - 1.5 * 3 * w]
        np.testing.assert_allclose(load, [-P, -Q] if away else there, rtol=1e-9)


def test_loads_and_weights_that_never_act():
    away = jc.Phase(loads=PULL, removes="b")
    line = jc.Phase(loads=jc.LineLoads((0, 0, -1.0), on="b"))
    words = said(hangers(), [away, line])
    assert len(words) == 1 and "phases[1].loads: LineLoads acts on nothing" in words[0]
    assert said(hangers(), [away, line, jc.Phase(adds="b")]) == []  # it waits for them
    tip = jc.Phase(loads=jc.NodalLoads([2], (0.0, 0.0, -1.0)))
    waits = said(chain(), [jc.Phase(removes=jc.only([1])), tip])
    assert len(waits) == 1 and "no element touches in this phase (node 2)" in waits[0]
    heavy = jc.replace(chain(), elements=jc.Bars([[0, 1], [1, 2]], 1e6, weight=5.0))
    pushed = jc.Phase(loads=PULL)
    assert "elements.weight: no phase has SelfWeight" in said(heavy, [pushed])[0]
    assert said(heavy, [pushed, jc.Phase(loads=jc.SelfWeight())]) == []
    assert said(heavy, [jc.Phase(pretension=5.0)]) == []  # another analysis may go on from there
