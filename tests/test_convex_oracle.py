"""The independent equilibrium of `convex_oracle` against closed forms."""

import numpy as np
import pytest
from convex_oracle import WIDE, Element, Scene, check, find


def scene(nodes, free, elements, load=None, **more):
    nodes = np.asarray(nodes, float)
    mask = np.zeros(nodes.shape, bool)
    mask[list(free)] = True
    load = np.zeros(nodes.shape) if load is None else np.asarray(load, float)
    return Scene(nodes, mask, load, elements, **more)


@pytest.mark.parametrize("load", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize("EA", [1e3, 1e8, 1e12])
def test_two_cables_carry_a_load_in_their_middle(EA, load):
    # symmetric: half the load over the sine, with the length that Hooke's law gives
    two = [Element("cable", (0, 1), EA, WIDE(1.25)), Element("cable", (1, 2), EA, WIDE(1.25))]
    found = find(
        scene([(-1, 0, 0), (0, 0, 0), (1, 0, 0)], [1], two, [(0, 0, 0), (0, 0, -load), (0,) * 3])
    )
    assert found.found
    sag = -found.displacement[1, 2]
    length = np.sqrt(1 + sag**2)
    N = WIDE(load) / 2 * length / sag
    assert np.abs(length - WIDE(1.25) * (1 + N / EA)) < 1e-17
    assert np.abs(np.array(found.tension) / N - 1).max() < 1e-12
    assert np.abs(found.displacement[1, :2]).max() < 1e-17


def test_sliding_rope_hangs_on_an_ellipse():
    # a stiff rope of length 3 between supports 2 apart: the load slides to the middle
    rope = [Element("rope", (0, 1, 2), 1e12, WIDE(3))]
    net = scene([(-1, 0, 0), (0.6, 0, 0), (1, 0, 0)], [1], rope, [(0, 0, 0), (0, 0, -8), (0, 0, 0)])
    found = find(net)
    assert found.found
    assert np.abs(net.nodes[1] + found.displacement[1] - [0, 0, -np.sqrt(1.25)]).max() < 1e-10
    assert found.tension[0] == pytest.approx(4 * 1.5 / np.sqrt(1.25), rel=1e-10)


def test_jack_stresses_a_cable():
    parts = [Element("cable", (0, 1), 1e6, WIDE(1)), Element("jack", (1, 2), force=5e3)]
    found = find(scene([(0, 0, 0), (0.5, 0.5, 0), (2, 0, 0)], [1], parts))
    assert found.found
    assert found.tension[0] == pytest.approx(5e3, rel=1e-12)
    assert 0.5 + found.displacement[1, 0] == pytest.approx(1.005, rel=1e-15)


def test_what_has_no_equilibrium_is_said():
    free = [(0, 0, 0), (1, 0, 0)]
    loose = find(scene(free, [1], [], [(0, 0, 0), (0, 0, 1)]))
    assert not loose.found and "without end" in loose.why
    weak = find(scene(free, [1], [Element("jack", (0, 1), force=0.9)], [(0, 0, 0), (0, 0, 1)]))
    assert not weak.found and "without end" in weak.why
    met = find(scene(free, [1], [Element("jack", (0, 1), force=0.9)], [(0, 0, 0), (0, 0, 0.5)]))
    assert not met.found and "together" in met.why


def test_lost_forces_and_loose_nodes():
    slack = [Element("cable", (0, 1), 1e6, WIDE(1)), Element("cable", (1, 2), 1e6, WIDE(1.1))]
    far = np.zeros((3, 3))
    far[1] = 3, -4, 5
    found = find(scene([(0, 0, 0), (1, 0, 0), (2, 0, 0)], [1], slack), far)
    assert found.found and max(found.tension) < 1e-12


def test_check_agrees_with_a_state_in_two_parts():
    two = [Element("cable", (0, 1), 1e9, WIDE(1.25)), Element("cable", (1, 2), 1e9, WIDE(1.25))]
    net = scene([(-1, 0, 0), (0, 0, 0), (1, 0, 0)], [1], two, [(0, 0, 0), (0, 0, -1), (0, 0, 0)])
    found = find(net)
    high = found.displacement.astype(float)
    residual, scale = check(net, high, (found.displacement - high).astype(float))
    assert np.abs(residual).max() < 1e-10 * scale
    rounded, _ = check(net, high)
    assert np.abs(residual).max() < np.abs(rounded).max() < 2 * found.floor.max()
    stated, _ = check(net, high, tension=found.tension)
    assert np.abs(stated).max() < 1e-15
