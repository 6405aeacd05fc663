"""Tendons that jacks stress at the last end, at both ends at once, and at one after the other."""

import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose
from oracles.convergence import converged
from oracles.coulomb import angles, draw_in
from oracles.taylor import TIGHT, assert_gradient

import jaxcable as jc

FORCE, EA = 3e6, 2e8


def tendon(n=21, friction=0.19):
    """A tendon in ducts, not symmetric, beside a longer one, so that it has fillers."""
    x = np.linspace(0.0, 30.0, n)
    nodes = np.stack([x, 0 * x, -4.8 * (x / 30) * (1 - 0.6 * x / 30)], axis=1)
    more = nodes + np.array([0.0, 1.0, 0.0])
    links = [list(range(n)), [*range(n, 2 * n), 2 * n]]
    every = np.vstack([nodes, more, more[-1:] + np.array([3.0, 0.0, 0.0])])
    group = jc.FrictionCables(
        links=links, axial_stiffness=EA, friction=friction, wobble=friction * 0.005
    )
    structure = jc.Structure(every, {"tendon": group}, jc.pinned(range(2 * n + 1)))
    length = np.linalg.norm(np.diff(nodes, axis=0), axis=1)
    bound = 0.19 * angles(nodes) + 0.19 * 0.005 * 0.5 * (length[1:] + length[:-1])
    return structure, length, bound


def of_segments(phase, n=20):
    return np.asarray(phase.element_results["segment_tension"]["tendon"][0, :n])


def closed_forms(bound, length):
    """Tensions that jacks leave from the first and the last end, and those after the draw-in."""
    lost = np.append(0.0, np.cumsum(bound))
    first, last = FORCE * np.exp(-lost), FORCE * np.exp(lost - lost[-1])
    anchors = draw_in(FORCE, bound, length, EA, 0.006)
    other = draw_in(FORCE, bound[::-1], length[::-1], EA, 0.006)[::-1]
    return first, last, anchors, other


def test_both_ends_at_once():
    """The tension falls from both ends to where both meet; then both anchors draw in by 6 mm."""
    structure, length, bound = tendon()
    jacked = jc.Phase(jacking=FORCE, stressed_ends=1)
    solution = converged(jc.solve(structure, [jacked, jc.Phase(), jc.Phase(shortening=-0.012)]))
    first, last, anchor, other = closed_forms(bound, length)
    expected = np.maximum(first, last)
    for phase in solution.phases[:2]:
        assert_allclose(of_segments(phase), expected, rtol=1e-13)
    assert 0 < expected.argmin() < 19 and expected.min() < 0.98 * FORCE
    rest = np.sum(length / (1 + expected / EA))
    assert float(solution.phases[1].rest_length["tendon"][0]) == pytest.approx(rest, rel=1e-14)
    drawn = np.where(first > last, anchor, other)
    assert_allclose(of_segments(solution), drawn, rtol=1e-12)
    # beyond the fillers: the longer tendon has its last jack at its own last node
    longer = np.asarray(solution.phases[0].element_results["segment_tension"]["tendon"][1])
    assert_allclose(longer[[0, -1]], FORCE, rtol=1e-13)


@pytest.mark.slow
def test_one_end_after_the_other():
    """The first anchor has drawn in when the other end is stressed; then that one draws in, too."""
    structure, length, bound = tendon()
    slips = jc.Phase(shortening=-0.006)
    other_end = jc.Phase(jacking=FORCE, stressed_ends={"tendon": [[0, 1], [0, 1]]})
    stages = [jc.Phase(jacking=FORCE), slips, other_end, slips]
    solution = converged(jc.solve(structure, stages))
    first, last, anchor, other = closed_forms(bound, length)
    together = np.maximum(anchor, last)
    expected = first, anchor, together, np.where(last > anchor, other, anchor)
    for phase, own in zip(solution.phases, expected, strict=True):
        assert_allclose(of_segments(phase), own, rtol=1e-12)
    # slips are towards the first end at first, and then back where the other jack pulls
    slip = [np.asarray(p.element_results["slip"]["tendon"][0, :19]) for p in solution.phases]
    assert (slip[0] < 0).all() and (np.diff(slip[2] - slip[1]) > -1e-15).all()
    assert (slip[2] - slip[1])[-1] > 1e-3 and abs((slip[2] - slip[1])[0]) < 1e-15


@pytest.mark.slow
def test_hanging_cable_mirrored():
    """A jack at the last end of a hanging cable is one at the first end of its mirror image."""
    nodes = np.array([[0.0, 0, 0], [90.0, 0, 12], [210.0, 0, 5], [300.0, 0, 0]])
    found = []
    for chain, ends in ((range(4), [0, 1]), (range(3, -1, -1), [1, 0])):
        rope = jc.SlidingCatenaries(
            links=[chain], axial_stiffness=2e7, weight=15.0, friction=0.1, rest_length=305.0
        )
        structure = jc.Structure(nodes, {"rope": rope}, jc.pinned(range(4)))
        jacked = jc.Phase(jacking=3e4, stressed_ends={"rope": [ends]}, loads=jc.SelfWeight())
        stages = [jc.Phase(loads=jc.SelfWeight()), jc.replace(jacked, loads=None)]
        solution = converged(jc.solve(structure, [*stages, jc.Phase(shortening=-0.1)]))
        results = [phase.element_results["end_tensions"]["rope"][0] for phase in solution.phases]
        found.append(np.asarray(results) if ends[1] else np.asarray(results)[:, ::-1, ::-1])
    assert_allclose(*found, rtol=1e-11)
    assert found[0][1, -1, 1] == pytest.approx(3e4, rel=1e-12)


@pytest.mark.slow
def test_derivatives():
    """By friction and force, after the draw-in of both anchors, through fillers."""

    def mean(p):
        structure, _, _ = tendon(7, p["mu"])
        stages = [jc.Phase(jacking=p["force"], stressed_ends=1), jc.Phase(shortening=-0.012)]
        solution = jc.solve(structure, stages, TIGHT)
        tension = solution.element_results["segment_tension"]["tendon"]
        return 1e-6 * jnp.sum(tension[0, :6] * jnp.arange(1, 7)), solution.status

    assert_gradient(mean, {"mu": jnp.array(0.19), "force": jnp.array(FORCE)})


def test_messages():
    structure, _, _ = tendon()
    with pytest.raises(ValueError, match=r"stressed_ends.*: an end is stressed, 1, or not, 0"):
        jc.solve(structure, jc.Phase(jacking=FORCE, stressed_ends={"tendon": [[0, 0], [0, 1]]}))
