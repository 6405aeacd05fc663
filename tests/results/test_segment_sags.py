"""Sags, curves and end tensions of segments of hanging cables that slide, integrated apart."""

import jax
import numpy as np
import pytest
from banks import hung_lines

import jaxcable as jc
from jaxcable import results

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
    structure, solution, _ = lines
    batch = jax.tree.map(lambda x: np.stack([x, x]), solution)
    sag = results.sags(structure, batch, {"part": [2, 1]})["part"]
    np.testing.assert_allclose(sag.midspan, np.full(2, hung_lines_sag(lines)), rtol=1e-9)
    assert results.sags(structure, batch)["lines"].midspan.shape == (2, 2, 3)
    assert results.horizontal_tensions(structure, batch)["lines"].shape == (2, 2, 3)


def hung_lines_sag(lines):
    """Sag of the segment between the nodes 1 and 2, m."""
    return lines[2][0, 1].sag_at_midspan()
