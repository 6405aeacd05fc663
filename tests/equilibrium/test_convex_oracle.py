"""The independent equilibrium of `convex_oracle` against closed forms."""

import numpy as np
import pytest
from oracles.convex_oracle import WIDE, Element, Scene, check, find


def scene(nodes, free, elements, load=None, **more):
    nodes = np.asarray(nodes, float)
    mask = np.zeros(nodes.shape, bool)
    mask[list(free)] = True
    load = np.zeros(nodes.shape) if load is None else np.asarray(load, float)
    return Scene(nodes, mask, load, elements, **more)


LINKS = (0, 1), (1, 2)


@pytest.mark.parametrize(("load", "EA"), [(1e-3, 1e12), (1.0, 1e8), (1e3, 1e3)])
def test_two_cables_carry_a_load_in_their_middle(EA, load):
    # symmetric: half the load over the sine, with the length that Hooke's law gives
    two = [Element("cable", pair, EA, WIDE(1.25)) for pair in LINKS]
    loads = [(0, 0, 0), (0, 0, -load), (0, 0, 0)]
    found = find(scene([(-1, 0, 0), (0, 0, 0), (1, 0, 0)], [1], two, loads))
    assert found.found
    sag = -found.displacement[1, 2]
    length = np.sqrt(1 + sag**2)
    N = WIDE(load) / 2 * length / sag
    assert np.abs(length - WIDE(1.25) * (1 + N / EA)) < 1e-17
    assert np.abs(np.array(found.tension) / N - 1).max() < 1e-12
    assert np.abs(found.displacement[1, :2]).max() < 1e-17


def test_a_scene_without_equilibrium_is_not_found():
    free = [(0, 0, 0), (1, 0, 0)]
    loose = find(scene(free, [1], [], [(0, 0, 0), (0, 0, 1)]))
    assert not loose.found and "without end" in loose.why
    weak = find(scene(free, [1], [Element("jack", (0, 1), force=0.9)], [(0, 0, 0), (0, 0, 1)]))
    assert not weak.found and "without end" in weak.why
    met = find(scene(free, [1], [Element("jack", (0, 1), force=0.9)], [(0, 0, 0), (0, 0, 0.5)]))
    assert not met.found and "together" in met.why


def test_check_agrees_with_a_state_in_two_parts():
    two = [Element("cable", pair, 1e9, WIDE(1.25)) for pair in LINKS]
    net = scene([(-1, 0, 0), (0, 0, 0), (1, 0, 0)], [1], two, [(0, 0, 0), (0, 0, -1), (0, 0, 0)])
    found = find(net)
    high = found.displacement.astype(float)
    residual, scale = check(net, high, (found.displacement - high).astype(float))
    assert np.abs(residual).max() < 1e-10 * scale
    rounded, _ = check(net, high)
    assert np.abs(residual).max() < np.abs(rounded).max() < 2 * found.floor.max()
    stated, _ = check(net, high, tension=found.tension)
    assert np.abs(stated).max() < 1e-15


def irvine(F, q, length, EA):
    """Chord of an elastic catenary in the plane of x and z under q along -z, m."""
    h, v = F
    top, low = v + q * length / 2, v - q * length / 2
    x = h * length / EA + h / q * (np.arcsinh(top / h) - np.arcsinh(low / h))
    z = v * length / EA + (np.hypot(h, top) - np.hypot(h, low)) / q
    return np.array([x, 0, z])


@pytest.mark.parametrize("EA", [1e2, 1e8])
def test_catenaries_meet_where_irvine_says(EA):
    # chords by chosen forces; the load at their common node is what balances these
    left, right = (WIDE(7), WIDE(2)), (WIDE(3), WIDE(-5))
    q, length = WIDE(4), WIDE(2)
    a = irvine((left[0], -left[1]), q, length, EA) * [1, 1, -1]
    b = irvine((right[0], -right[1]), q, length, EA) * [1, 1, -1]
    spans = [Element("catenary", pair, EA, length, load=(0, 0, -float(q))) for pair in LINKS]
    load = np.array([left[0] - right[0], 0, left[1] - right[1] + q * length])
    net = scene([(0, 0, 0), (0.1, 0.2, 0.3), (0, 0, 0)], [1], spans)
    net.nodes = np.array([-a, [0, 0, 0], b], WIDE)
    net.load = np.array([np.zeros(3), load, np.zeros(3)], WIDE)
    far = np.zeros((3, 3))
    far[1] = -2, 3, 1
    found = find(net, far)
    assert found.found
    assert np.abs(found.displacement).max() < 1e-15
    ends = [np.hypot(left[0], left[1] + k * q * length / 2) for k in (-1, 1)]
    assert found.tension[0] == pytest.approx(np.mean(ends), rel=1e-15)
