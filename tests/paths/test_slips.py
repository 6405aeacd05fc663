"""Where cables with friction begin to slip along a path, as events."""

import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose
from oracles.convergence import converged

import jaxcable as jc

MU, EVEN = 0.2, 1000.0  # N, before the load


def over_two_bars():
    """A rope from an anchor over two fixed bars to a weight; a plumb pulley without friction."""
    nodes = [[-2.0, 0, 0], [0.0, 0, 0], [0.0, 0, 1.5], [1.0, 0, 1.5], [1.0, 0, 0.5]]
    friction = [[MU, 0.0, 0.5 * MU]]
    rope = jc.FrictionCables(links=[range(5)], axial_stiffness=1e6, friction=friction)
    held = jc.pinned(range(4)) + jc.restrained([4], "xy")
    return jc.Structure(nodes, {"rope": rope}, held)


def weight(force):
    return jc.Phase(loads=jc.NodalLoads([4], (0.0, 0.0, -force)))


def test_two_deviators_slip_one_after_the_other():
    """The nearer bar slips at exp(b) of the even tension, the farther at exp(b1 + b2)."""
    structure = over_two_bars()
    even = jc.replace(weight(EVEN), pretension=EVEN)
    path = jc.trace_path(structure, [even, weight(EVEN)], step=0.1, largest=0.5, tol=1e-7)
    events = converged(path).events
    assert events.names == ["slip", "slip"]
    near, far = 0.25 * MU * np.pi, 0.75 * MU * np.pi
    expected = np.exp([near, far]) - 1  # each turn is a right angle
    assert_allclose(events.load_factor, expected, rtol=1e-7)  # `tol` of a step of 0.1
    assert (np.asarray(events.lower) < expected + 1e-8).all()
    assert np.asarray(events.elements["rope"]).all()
    used = np.asarray(path.element_results["friction_used"]["rope"])[np.asarray(events.row), 0]
    assert_allclose(used[0, 2], 1.0, rtol=1e-9)
    assert abs(used[0, 0]) < 0.99 and abs(used[1, 0] - 1) < 1e-9


@pytest.mark.slow
def test_slips_that_go_on_and_turn_back():
    """A rope that slips already has no event; turned back, it slips the other way at exp(-b)."""
    structure = over_two_bars()
    even = jc.replace(weight(EVEN), pretension=EVEN)
    more = jc.trace_path(structure, [even, weight(EVEN), weight(100.0)])
    assert len(converged(more).events) == 0
    back = converged(jc.trace_path(structure, [even, weight(EVEN), weight(-1600.0)]))
    assert back.events.names[0] == "slip"
    left = 2 * EVEN - 1600.0 * float(back.events.load_factor[0])
    # between the two bars the tension is 2 EVEN exp(-b), until the nearer one slips back
    assert abs(left - 2 * EVEN * np.exp(-0.5 * MU * np.pi)) < 1e-6
    axes = jc.plots.path(back, 4).axes[0]
    assert "slip" in axes.get_legend_handles_labels()[1]
    assert jnp.isfinite(back.events.displacement).all()
