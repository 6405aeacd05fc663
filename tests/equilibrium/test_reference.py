"""Published and independently computed nets; see tests/reference for source and status."""

import numpy as np
import pytest
from banks.problems import assert_balanced, reference, unbalanced
from oracles.convergence import converged

import jaxcable as jc

FLAT = reference("flat_net")


@pytest.mark.slow_cases("15.0N")
@pytest.mark.parametrize("case", FLAT["cases"], ids=lambda c: f"{c['load_per_free_node_N']}N")
def test_flat_net_matches_the_reference_whatever_the_increments(case):
    load, free = case["load_per_free_node_N"], FLAT["free_nodes"]
    expected = np.array([case["displacement_m"][str(n)] for n in free])
    ends = []
    for increments in (1, 10, 100):
        scene = jc.scenes.flat_net(load=load, increments=(increments, increments))
        solution = converged(jc.solve(*scene, jc.Newton(tol=1e-13)))
        assert_balanced(solution)
        ends.append(np.asarray(solution.displacement))
        # 1e-9 m and 1e-6 N: the accuracy that the issue of these numbers promises
        assert np.abs(ends[-1][free] - expected).max() < 1e-9
        assert np.abs(np.asarray(solution.tension) - case["tension_N"]).max() < 1e-6
    # tol 1e-13 of 1 kN against a stiffness of 2 kN/m at least: 1e-13 m, with room for 100 steps
    assert np.ptp(ends, axis=0).max() < 1e-12


def test_flat_net_scene_is_that_of_the_reference():
    structure, _ = jc.scenes.flat_net()
    assert np.allclose(structure.nodes, FLAT["nodes_m"], atol=1e-15)
    assert structure.elements.links.array.tolist() == FLAT["links"]


def test_hypar_net_finds_its_form_and_deflects_as_computed():
    ref = reference("hypar_net")
    structure, phases = jc.scenes.hypar_net()
    start = np.abs(np.asarray(structure.nodes) - ref["nodes_m"]).max()
    solution = converged(jc.solve(structure, phases))
    assert_balanced(solution)
    free = np.array(ref["free_nodes"])
    first, second = solution.phases
    assert start > 0.03  # the plan really was disturbed
    assert np.abs(np.asarray(first.positions) - ref["nodes_m"]).max() < 1e-10
    assert np.allclose(first.tension, 200.0, rtol=1e-12)  # held while jacked, kept when anchored
    deflection = -1e3 * np.asarray(second.displacement_in_phase)[free, 2]
    assert np.abs(deflection - ref["computed_deflection_mm"]).max() < 1e-3  # 1e-6 m
    assert np.abs(np.asarray(solution.tension) - ref["computed_tension_N"]).max() < 1e-6
    assert np.array_equal(second.path.displacement[-1], second.displacement)
    np.testing.assert_array_equal(
        second.path.displacement_in_phase[-1], second.displacement_in_phase
    )
    # checked once more by lengths alone, apart from the package
    out, _ = unbalanced(
        np.asarray(structure.nodes),
        structure.elements.links.array,
        100.72e3,
        np.asarray(solution.rest_length),
        np.asarray(solution.positions),
        solution.load,
    )
    # lengths of 1 m known to 2e-16 give forces known to EA eps = 2e-11 N; default tol 1e-7 N
    assert np.abs(out[free]).max() < 1e-7


def test_hypar_plan_is_already_in_equilibrium():
    solution = converged(jc.solve(*jc.scenes.hypar_net(disturbed=False)))
    assert np.abs(np.asarray(solution.phases[0].displacement)).max() < 1e-12


def test_published_columns_are_those_of_the_reference():
    from jaxcable.scenes.hypar import NODE_NAMES, PUBLISHED

    ref = reference("hypar_net")
    assert list(NODE_NAMES) == ref["paper_node_names"]
    assert {k: list(v) for k, v in PUBLISHED.items()} == ref["published_deflection_mm"]


@pytest.mark.slow_cases("5")
@pytest.mark.parametrize("n_elements", [5, 10])
def test_accuracy_cable_matches_the_closed_form(n_elements):
    exact = reference("accuracy_cable")["exact_at_14_90_m_mm"]
    solution = converged(jc.solve(*jc.scenes.accuracy_cable(n_elements)))
    assert_balanced(solution)
    moved = 1e3 * np.asarray(solution.phases[1].displacement_in_phase)[:: n_elements // 5]
    for node in (2, 3):
        # 1e-9 m; the reference has 8 decimals of a millimetre
        assert abs(moved[node - 1, 2] - exact[f"vertical_node_{node}"]) < 1e-6
        assert abs(moved[node - 1, 0] - exact[f"horizontal_node_{node}"]) < 1e-6
    assert np.abs(moved[:, 1]).max() == 0.0  # held out of plane
