"""Structures all of whose nodes are held: there is no equilibrium to find, and no tangent."""

import numpy as np
import pytest
from oracles.convergence import converged

import jaxcable as jc
from jaxcable.mechanics.assembly import System


@pytest.mark.filterwarnings("ignore:.*every node is held:jaxcable.InputWarning")
def test_held_structures_have_no_tangent(monkeypatch):
    """A conductor on a pulley; and with a pulley that yields, as a control.

    `hung_lines` compares results of held structures with cables that are integrated.
    """

    def no_tangents(*_):
        raise AssertionError("the tangents of elements are evaluated")

    monkeypatch.setattr(System, "tangents", no_tangents)
    nodes = [[0.0, 0.0, 0.0], [120.0, 0.0, 10.0], [260.0, 0.0, 4.0]]
    line = jc.SlidingCatenaries([[0, 1, 2]], axial_stiffness=3e7, weight=15.0, rest_length=262.0)
    held = jc.Structure(nodes, line, jc.pinned([0, 1, 2]))
    weight = jc.Phase(loads=jc.SelfWeight())
    solution = converged(jc.solve(held, weight))
    total = np.asarray(solution.reactions).sum(axis=0)
    # to the residual of 1e-10 of the tensions
    np.testing.assert_allclose(total, [0.0, 0.0, 15.0 * 262.0], atol=1e-6)
    assert bool(solution.stable)
    yields = jc.replace(held, supports=jc.pinned([0, 2]) + jc.restrained([1], "yz"))
    with pytest.raises(AssertionError, match="tangents of elements"):
        jc.solve(yields, weight)
