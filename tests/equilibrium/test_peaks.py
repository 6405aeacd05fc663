"""Nets whose laws fall: the equilibrium below all peaks is found, or a status says why not."""

import jax.numpy as jnp
import numpy as np
import pytest
from oracles.convergence import converged

import jaxcable as jc
from jaxcable import status

STRAIN = np.array([0.0, 0.01, 0.02, 0.04, 0.09])
STRESS = 1e9 * 0.01 * np.array([0.0, 1.0, 1.4, 1.5, 0.4])
AREA = 1e-4
PEAK = AREA * STRESS.max()  # 1 500 N


def hanger(force):
    """A plumb cable of 2 m with a weight."""
    cable = jc.Cables([[0, 1]], area=AREA, law=jc.Polygonal(STRAIN, STRESS))
    structure = jc.Structure([[0.0, 0, 0], [0.0, 0, -2.0]], cable, jc.pinned([0]))
    return structure, jc.Phase(loads=jc.NodalLoads([1], jnp.array([0.0, 0.0, -1.0]) * force))


@pytest.mark.parametrize("part", [0.1, 0.6, 0.97, 0.999, 1.001, 20.0])
def test_a_weight_below_and_above_the_peak(part):
    """By the curve: the strain at which the rising branch has the force, or no equilibrium."""
    solution = jc.solve(*hanger(part * PEAK))
    if part > 1:  # above the peak, or beyond the end of the curve, which has failed
        assert int(solution.status) in (status.BEYOND_PEAK, status.MATERIAL_FAILURE)
        assert np.isnan(solution.tension).all()
        return
    assert int(solution.status) == status.OK
    strain = np.interp(part * STRESS.max(), STRESS[:4], STRAIN[:4])
    assert float(solution.displacement[1, 2]) == pytest.approx(-2.0 * strain, rel=1e-9)


def test_the_peak_is_the_reason_where_steps_end_beyond_it():
    """A few steps find the strain without a fall; none is left to look on the falling branch."""
    load = hanger(1.01 * PEAK)
    codes = [int(jc.solve(*load, jc.Newton(max_steps=k)).status) for k in range(1, 12)]
    assert status.BEYOND_PEAK in codes and status.OK not in codes
    assert "peak" in jc.describe(status.BEYOND_PEAK)
    assert int(jc.solve(*load).status) == status.MATERIAL_FAILURE  # the curve ends before it rises


def test_a_mechanism_is_not_said_to_be_beyond_the_peak():
    """Nothing holds the cable across: there is no equilibrium of the law that rises either."""
    structure, _ = hanger(100.0)
    loose = jc.replace(structure, supports=jc.restrained([0], "z"))
    solution = jc.solve(loose, jc.Phase(loads=jc.NodalLoads([1], (10.0, 0.0, -100.0))))
    assert int(solution.status) == status.MECHANISM


@pytest.mark.slow
def test_two_cables_share_what_one_cannot_carry():
    """Beyond the peak of one there is an equilibrium of both: by the sum of two curves."""
    weak = jc.Polygonal([0.0, 0.01, 0.5], [0.0, 1e7, 0.5e7])
    strong = jc.Polygonal([0.0, 0.5], [0.0, 5e9])
    nodes = [[0.0, 0, 0], [0.0, 0, -2.0]]
    groups = {
        "weak": jc.Cables([[0, 1]], area=AREA, law=weak),
        "strong": jc.Cables([[0, 1]], area=AREA / 100, law=strong),
    }
    structure = jc.Structure(nodes, groups, jc.pinned([0]))
    force = 3000.0
    # weak: 1000 - 500 (e - 0.01) / 0.49; strong: 1e4 e
    strain = (force - 1000.0 - 500 * 0.01 / 0.49) / (1e4 - 500 / 0.49)
    assert strain > 0.01
    load = jc.NodalLoads([1], (0.0, 0.0, -force))
    solution = converged(jc.solve(structure, jc.Phase(loads=load)))
    assert float(solution.displacement[1, 2]) == pytest.approx(-2.0 * strain, rel=1e-8)


def test_strain_at_a_stress_in_float32_and_beyond_the_end():
    """Small curves keep their digits, and an endless law that rises goes on beyond its end."""
    strain = (1e-8 * np.array([0.0, 1.0, 2.0, 4.0])).astype(np.float32)
    stress = np.array([0.0, 10.0, 14.0, 16.0], np.float32)
    law = jc.Polygonal(strain, stress).tension_only()
    for target in (2.0, 10.0, 13.0, 15.9):
        found = float(law.strain_at(np.float32(target)))
        assert found == pytest.approx(np.interp(target, stress, strain), rel=1e-5)
    assert np.isnan(law.strain_at(np.float32(17.0)))
    beyond = float(law.extrapolated().strain_at(np.float32(26.0)))
    assert beyond == pytest.approx(4e-8 + 10 / 1e9, rel=1e-5)


def test_the_law_without_softening_is_the_same_up_to_its_peak():
    law = jc.Polygonal(np.r_[-0.05, -0.02, STRAIN], np.r_[-0.1e7, -1e7, STRESS])
    risen = law.without_softening()
    inside = np.linspace(-0.02, 0.04, 50)
    np.testing.assert_allclose(
        risen.stress_at(inside), law.stress_at(inside), rtol=1e-12, atol=1e-3
    )
    outside = np.linspace(-0.05, 0.09, 200)
    assert (np.diff(risen.stress_at(outside)) > 0).all() and risen.monotone
    assert jc.Polygonal([0.0, 0.1], [0.0, 1.0]).without_softening().monotone
