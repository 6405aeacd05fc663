"""Scenes of cables with friction against numbers by hand: capstan, draw-in, tackle, clamps."""

import numpy as np
import pytest
import scenes
from numpy.testing import assert_allclose
from oracles.convergence import converged
from oracles.coulomb import angles, draw_in
from oracles.hanging_cable import HangingCable

import jaxcable as jc


def of_segments(phase, group, name="segment_tension"):
    return np.asarray(phase.element_results[name][group][0])


def segment_lengths(structure, phase, group):
    chain = np.asarray(phase.positions)[structure.elements[group].links.array[0]]
    return chain, np.linalg.norm(np.diff(chain, axis=0), axis=1)


def test_tendon_in_a_beam():
    """Losses from the jack on, and the draw-in; the beam has the thrust of the tendon."""
    n = 8
    structure, phases = scenes.post_tensioned_beam(n=n)
    solution = converged(jc.solve(structure, phases))
    jacked, locked, drawn = solution.phases
    chain, length = segment_lengths(structure, jacked, "tendon")
    bound = 0.19 * angles(chain) + 0.001 * 0.5 * (length[1:] + length[:-1])
    losses = 3e6 * np.exp(-np.append(0.0, np.cumsum(bound)))
    assert_allclose(of_segments(jacked, "tendon"), losses, rtol=1e-12)
    assert_allclose(of_segments(locked, "tendon"), losses, rtol=1e-9)  # tol 1e-10 of the residual
    # by hand with EN 1992-1-1: angle of a parabola, as the polygon turns between its end segments
    by_hand = np.exp(-(0.19 * 8 * 0.8 / 30 * (1 - 1 / n) + 0.001 * 30 * (1 - 1 / n)))
    # slopes of 0.1 for angles, and the beam bends: 1e-3 of the angles, twice
    assert losses[-1] / 3e6 == pytest.approx(by_hand, abs=2e-3 * (1 - by_hand) + 1e-4)
    # the beam gives way by 1e-4 of its length, and so the tension changes by a hundredth of 0.006 m
    after = draw_in(3e6, bound, length, 3e8, 0.006)
    assert_allclose(of_segments(drawn, "tendon"), after, rtol=1e-3)
    assert of_segments(drawn, "tendon")[0] < 0.95 * losses[0]
    thrust = of_segments(drawn, "tendon")[n // 2 - 1] * np.diff(chain[n // 2 - 1 :, 0])[0]
    thrust /= length[n // 2 - 1]
    normal = np.asarray(solution.section_forces["beam"])[n // 2 - 1, :, 0]
    assert_allclose(-normal, thrust, rtol=1e-3)  # its shear, 1e5 N, has a part of 1e-2 there


@pytest.mark.parametrize("clamped", [False, True])
def test_stay_over_a_saddle(clamped):
    """It slips towards the load and back again, or is held by its clamp."""
    structure, phases = scenes.saddle_stay(clamped=clamped, increments=2)
    solution = converged(jc.solve(structure, phases))
    for phase, sign in zip(solution.phases[1:], (1, -1), strict=True):
        turn = angles(segment_lengths(structure, phase, "stay")[0])[0]
        left, right, _ = of_segments(phase, "stay")
        if clamped:
            assert of_segments(phase, "stay", "clamp_force")[0] == pytest.approx(right - left)
        else:
            assert right / left == pytest.approx(np.exp(sign * 0.15 * turn), rel=1e-12)
        # the clip holds the stay in any case
        assert of_segments(phase, "stay", "slip")[1] == pytest.approx(0.0, abs=1e-15)
    assert (abs(of_segments(solution.phases[1], "stay", "slip")[0]) > 0.01) != clamped


def test_block_and_tackle():
    """Forces of the hand that lifts, and that lowers; the length of the rope is kept."""
    structure, phases = scenes.block_and_tackle(3e3, 0.05, increments=2)
    solution = converged(jc.solve(structure, phases))
    r = (1 + 0.05) / (1 - 0.05)
    for phase, ratio in zip(solution.phases, (1 / r, r, 1 / r), strict=True):
        hand = 3e3 * ratio**3 / (1 + ratio + ratio**2)
        tension = of_segments(phase, "rope")
        assert tension[0] == pytest.approx(hand, rel=1e-9)  # tol 1e-10 of the residual
        length = segment_lengths(structure, phase, "rope")[1]
        rest = np.sum(length / (1 + tension / 2e5))
        assert rest == pytest.approx(float(phase.rest_length["rope"][0]), rel=1e-12)
    lifted = np.asarray(solution.phases[1].displacement - solution.phases[0].displacement)[2, 2]
    # the rope stretches more when it lifts, by no more than the largest change of its tension
    assert 0.6 - 16 / 3 * 500 / 2e5 < lifted < 0.6


def test_hoop_of_a_dome():
    """Clamped segments have lengths of their own; without clamps the dome moves more."""
    structure, phases = scenes.dome_hoop(increments=2)
    solution = converged(jc.solve(structure, phases))
    first, last = solution.phases
    stiffness, start = 300e6, segment_lengths(structure, first, "hoop")[1]
    assert_allclose(of_segments(first, "hoop"), 500e3, rtol=1e-9)  # tol 1e-10 of the residual
    rest = start / (1 + 500e3 / stiffness)
    length = segment_lengths(structure, last, "hoop")[1]
    assert_allclose(of_segments(last, "hoop"), stiffness * (length / rest - 1), rtol=1e-9)
    assert np.abs(of_segments(last, "hoop", "friction_used")).max() > 2  # what the clamps are for
    open_clamps = jc.replace(phases[1], clamped={"hoop": 0.0})  # by the same program
    slips = converged(jc.solve(structure, [phases[0], open_clamps]))
    ratio = np.log(of_segments(slips, "hoop")[1:] / of_segments(slips, "hoop")[:-1])
    turn = angles(segment_lengths(structure, slips, "hoop")[0])
    assert (np.abs(ratio) <= 0.1 * turn * (1 + 1e-12)).all()
    moved = [np.abs(np.asarray(one.displacement)).max() for one in (solution, slips)]
    assert moved[1] > 1.5 * moved[0]


def test_ropeway():
    """Each segment integrated apart: the cabin's weight, and capstan ratios at both towers."""
    structure, phases = scenes.ropeway(rides=1)
    solution = converged(jc.solve(structure, phases))
    for phase, x in zip(solution.phases[1:], (80.0, 410.0), strict=True):
        place = np.asarray(phase.positions)
        assert place[2, 0] == x and place[2, 1] == 0.0
        lengths, tensions, pulls = (
            of_segments(phase, "rope", name)
            for name in ("segment_length", "end_tensions", "segment_pull")
        )
        down = [0.0, 0.0, -60.0]
        spans = [
            HangingCable(place[k], place[k + 1], lengths[k], 80e6, down, 1.001 * pulls[k, :3])
            for k in range(4)
        ]
        # a change of length by rounding of 4e2 m changes tensions by EA eps, 2e-8 N, over strains
        assert_allclose(tensions, [span.ends for span in spans], rtol=1e-9)
        # what the segments beside a node pull at it
        first, last = (
            np.array([sign * (span.pull - part * span.length * span.load) for span in spans])
            for sign, part in ((1.0, 0.0), (-1.0, 1.0))
        )
        at_cabin = last[1] + first[2]
        # tol 1e-10 of the residual, over forces of 6e5 N at the cabin
        assert at_cabin[2] == pytest.approx(25e3, abs=1e-3)
        assert_allclose(tensions[1, 1], tensions[2, 0], rtol=1e-12)  # no friction at the cabin
        used = of_segments(phase, "rope", "friction_used")
        assert_allclose(used, [1.0, 0.0, -1.0], atol=1e-12)  # from both towers towards the cabin
        for tower, k in ((1, 0), (3, 2)):
            before, after = -last[tower - 1], first[tower]
            turn = np.arccos(before @ after / np.linalg.norm(before) / np.linalg.norm(after))
            ratio = spans[tower].ends[0] / spans[tower - 1].ends[1]
            assert ratio == pytest.approx(np.exp(used[k] * 0.08 * turn), rel=1e-9)
    assert (np.abs(of_segments(solution, "rope", "slip")) > 0.01).all()
