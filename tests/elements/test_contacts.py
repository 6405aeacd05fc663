"""Contacts: bars that press only, with gaps; against statics and NumPy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from banks.shapes import in_line, pieces
from oracles.taylor import TIGHT, assert_gradient

import jaxcable as jc
from jaxcable.common import status

EA, STOP = 1e5, 3e5


def stopped(gap):
    """A bar of 1 m before a stop of 1 m behind a gap; the node between them moves along x only."""
    bar = jc.Bars([[0, 1]], axial_stiffness=EA)
    stop = jc.Contacts([[1, 2]], axial_stiffness=STOP, gap=gap)
    return in_line({"bar": bar, "stop": stop}, 0.0, 1.0, 2.0)


def pushed(gap, push):
    load = jc.NodalLoads([1], jnp.array([1.0, 0, 0]) * push)
    return jc.solve(stopped(gap), jc.Phase(loads=load), TIGHT)


@pytest.mark.slow_cases("100.0-0.0")
@pytest.mark.parametrize("gap", [0.0, 0.002, -0.001])
@pytest.mark.parametrize("push", [100.0, 600.0, -600.0])
def test_a_bar_on_a_gap(gap, push):
    """Before the gap closes the bar takes all; then both share, ``EA u + k (u - gap) = push``."""
    solution = pushed(gap, push)
    stiff = STOP / (1.0 - gap)
    moved = push / EA
    if moved > gap:
        moved = (push + stiff * gap) / (EA + stiff)
    pressed = -stiff * max(moved - gap, 0.0)
    assert int(solution.status) == 0
    # forces of 600 N, known to some roundings of an elongation over 1 m times EA
    assert abs(float(solution.displacement[1, 0]) - moved) < 1e-13
    assert abs(float(solution.tension["stop"][0]) - pressed) < 1e-9
    opening = solution.element_results["opening"]["stop"][0]
    assert abs(float(opening) - (gap - moved)) < 1e-13
    assert int(solution.phases[0].path.n_slack[-1]) == int(pressed == 0)


def test_gradients_beside_the_kink_and_at_it():
    """The displacement by gap and force on both sides; NaN where the contact just closes."""

    def moved(p):
        return pushed(p[0], p[1]).displacement[1, 0]

    stiff = STOP / 0.998
    # open: 1 / EA; closed: (push + s gap) / (EA + s) with s = STOP / (1 - gap)
    slope = STOP / 0.998**2
    by_gap = (stiff + slope * 0.002) / (EA + stiff) - (600 + stiff * 0.002) * slope / (
        EA + stiff
    ) ** 2
    for push, expected in ((100.0, [0.0, 1 / EA]), (600.0, [by_gap, 1 / (EA + stiff)])):
        p = jnp.array([0.002, push])
        gradient = np.asarray(jax.grad(moved)(p))
        assert np.abs(gradient / np.array([1.0, 1e-5]) - np.array(expected) * [1, 1e5]).max() < 1e-9
    # the displacement is linear in all but the gap, so that its remainder is that of the gap
    assert_gradient(lambda gap: moved(jnp.stack([gap, 1e5])), 0.5, 20)
    # 200 N close the gap of 2 mm exactly; the load of no force leaves a contact without gap so
    assert np.isnan(jax.grad(moved)(jnp.array([0.0, 0.0]))).all()


def stack(gaps, load):
    """Blocks above each other with gaps between them, pressed from above; the lowest on ground."""
    n = len(gaps)
    nodes, links = pieces(n, n, (0.0, 0.0, 1.0))
    contacts = jc.Contacts(links, axial_stiffness=1e5, gap=gaps)
    held = jc.pinned([0]) + jc.restrained(range(1, n + 1), "xy")
    structure = jc.Structure(nodes, contacts, held)
    return jc.solve(structure, jc.Phase(loads=jc.NodalLoads([n], (0.0, 0.0, -load))))


def test_loss_of_contact_is_a_mechanism_or_a_loose_node():
    up = stack(np.array([0.01, 0.0, 0.0, 0.0]), -50.0)
    assert int(up.status) == status.MECHANISM
    still = stack(np.array([0.01, 0.02, 0.03, 0.01]), 0.0)
    assert int(still.status) == 0 and int(still.phases[0].path.n_loose[-1]) == 4
    assert int(still.phases[0].path.n_slack[-1]) == 4


@pytest.mark.slow
def test_prestress_lock_off_and_heat():
    """Pretension is a compression; a jack holds it; heat closes a gap of 1 mm in part."""
    prop = jc.Contacts([[0, 1]], axial_stiffness=EA, expansion=1e-5, gap=0.001)
    elements = {"prop": prop, "tail": jc.Bars([[1, 2]], axial_stiffness=EA)}
    structure = jc.Structure(
        pieces(2, 2.0)[0], elements, jc.pinned([0, 1]) + jc.restrained([2], "yz")
    )
    stated = ("jacking", -300.0), ("temperature", 50.0), ("rest_length", 0.999)
    stated += (("temperature", 150.0),)
    phases = [jc.Phase(**{name: {"prop": value, "tail": None}}) for name, value in stated]
    solution = jc.solve(structure, phases)
    force = [float(phase.tension["prop"][0]) for phase in solution.phases]
    locked = 1 / (1 - 300 / EA) * (1 + 50e-5)
    heated = 0.999 * (1 + 150e-5 / (1 + 50e-5))
    expected = [-300.0, EA * (1 / locked - 1), 0.0, EA * (1 / heated - 1)]
    assert int(solution.status) == 0
    assert np.abs(np.array(force) - expected).max() < 1e-8


@pytest.mark.slow
def test_a_contact_that_a_phase_adds_has_its_gap_where_its_ends_are_then():
    push = jc.NodalLoads([1], (300.0, 0.0, 0.0))
    phases = [jc.Phase(loads=push), jc.Phase(adds="stop", loads=push)]
    solution = jc.solve(stopped(0.002), phases)
    # 300 N move the end by 3 mm; then 200 N close the gap, and the rest is shared
    stiff = STOP / (1 - 0.003 - 0.002)
    assert int(solution.status) == 0
    pressed = 100.0 * stiff / (EA + stiff)
    assert abs(float(solution.tension["stop"][0]) + pressed) < 1e-8


def test_slack_distance_of_contacts_is_their_compression():
    solution = pushed(0.002, 600.0)
    found = jc.design.slack_distance(stopped(0.002), solution)
    assert int(solution.status) == 0 and found["bar"] is None
    assert float(found["stop"][0]) == pytest.approx(-float(solution.tension["stop"][0]) / STOP)
