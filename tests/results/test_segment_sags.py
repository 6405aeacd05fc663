"""Sags, curves and end tensions of segments of hanging cables that slide, integrated apart."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from banks import hung_lines

import jaxcable as jc
from jaxcable import results
from jaxcable.common.tree import copy_with

NEAR = 1e-8  # m, of lengths of 360 m: tensions are found to 1e-10 of the largest


@pytest.fixture(scope="module")
def lines():
    structure, solution = hung_lines.solved()
    return structure, solution, hung_lines.integrated(solution)


def test_sags_of_segments(lines):
    structure, solution, cables = lines
    found = results.sags(structure, solution)
    assert found["a mast"] is None
    sag, force = found["lines"], results.horizontal_tensions(structure, solution)["lines"]
    for at, cable in cables.items():
        low, below = cable.least(lambda p: p[2])[0], cable.least(cable.below_chord)[0]
        told = [sag.midspan[at], sag.largest[at], sag.lowest[at][2]]
        np.testing.assert_allclose(told, [cable.sag_at_midspan(), -below, low], atol=NEAR)
        assert float(sag.span[at]) == pytest.approx(cable.last[0] - cable.first[0], rel=1e-12)
        assert float(force[at]) == pytest.approx(cable.pull[0], rel=1e-8)  # as of lengths
    assert np.isnan(sag.midspan[hung_lines.FILLER])
    assert float(sag.midspan[0, 1]) > 1.0  # m: they do hang


def test_chains_go_along_segments(lines):
    """Over two segments of a cable, and backwards over all."""
    structure, solution, cables = lines
    found = results.sags(structure, solution, {"back": [3, 2, 1, 0], "part": [1, 2], "end": [6, 5]})
    low = {at: cable.least(lambda p: p[2])[0] for at, cable in cables.items()}
    assert float(found["back"].lowest[2]) == pytest.approx(
        min(low[0, k] for k in range(3)), abs=NEAR
    )
    assert float(found["part"].lowest[2]) == pytest.approx(low[0, 1], abs=NEAR)
    assert float(found["end"].midspan) == pytest.approx(cables[1, 1].sag_at_midspan(), abs=NEAR)


def test_curves_and_end_tensions_of_segments(lines):
    structure, solution, cables = lines
    curves = np.asarray(jc.forms.catenary_curves(structure, solution, 5)["lines"])
    ends = np.asarray(jc.forms.end_tensions(structure, solution)["lines"])
    for at, cable in cables.items():
        points = [cable.at(part * cable.length) for part in np.linspace(0.0, 1.0, 5)]
        np.testing.assert_allclose(curves[at], points, atol=NEAR)
        np.testing.assert_allclose(ends[at], cable.ends, rtol=1e-8)
    assert (ends[hung_lines.FILLER] == 0).all()
    np.testing.assert_array_equal(curves[hung_lines.FILLER], np.tile(hung_lines.NODES[6], (5, 1)))
    own = solution.element_results["end_tensions"]["lines"]
    np.testing.assert_allclose(ends, own, rtol=1e-12)


def test_batches_have_axes_in_front(lines):
    structure, solution, cables = lines
    batch = jax.tree.map(lambda x: np.stack([x, x]), solution)
    sag = results.sags(structure, batch, {"part": [2, 1]})["part"]
    np.testing.assert_allclose(sag.midspan, np.full(2, cables[0, 1].sag_at_midspan()), atol=NEAR)
    assert results.sags(structure, batch)["lines"].midspan.shape == (2, 2, 3)
    assert results.horizontal_tensions(structure, batch)["lines"].shape == (2, 2, 3)


def test_derivatives_pass_by_fillers(lines):
    """By a factor on the forces of all segments, beside a difference quotient."""
    structure, solution, _ = lines

    def numbers(factor):
        own = dict(solution.last.results)
        pull = own["segment_pull"]
        own["segment_pull"] = {**pull, "lines": factor * pull["lines"]}
        state = copy_with(solution.last, results=own)
        parts = [
            results.sags(structure, state)["lines"].midspan[1, 0],
            results.horizontal_tensions(structure, state)["lines"][1, 1],
            jc.forms.catenary_curves(structure, state, 5)["lines"][1, 0, 2, 2],
            jc.forms.end_tensions(structure, state)["lines"][1, 0, 1],
        ]
        return jnp.stack(parts)

    exact, step = np.asarray(jax.jacfwd(numbers)(1.0)), 1e-4
    quotient = (numbers(1.0 + step) - numbers(1.0 - step)) / (2 * step)
    # the third derivative is some ten times the value, an error of 1e-7; rounding is 1e-12 / step
    np.testing.assert_allclose(exact, quotient, rtol=1e-6)
    assert np.abs(jax.jacrev(numbers)(1.0) - exact).max() < 1e-9 * np.abs(exact).max()
