"""The shapes of `banks.shapes` have the solutions that they say."""

import numpy as np
import pytest
from banks import shapes

import jaxcable as jc
from jaxcable.common import status

CASES = {
    "cross": (shapes.cross(pretension=200.0), 150.0, 1e-10),
    "cross without tension": (shapes.cross(), 150.0, 1e-10),
    "six cables": (shapes.spokes(6, pretension=50.0), 1500.0, 1e-10),
    "tripod": (shapes.tripod(height=0.5), 2000.0, 1e-10),
    "chain": (shapes.chain(), 40.0, 1e-9),
    "chain of bars": (shapes.chain(group=jc.Bars), 40.0, 1e-9),
    "cantilever": (shapes.cantilever(), 0.01, 1e-4),  # the fibres are points
}


@pytest.mark.parametrize("name", CASES)
def test_a_shape_has_its_known_solution(name):
    shape, force, error = CASES[name]
    solution = jc.solve(shape.structure, jc.Phase(loads=shape.load(force)))
    assert solution.status == status.OK
    drop, forces = shape.known(force)
    assert -solution.displacement[shape.node, 2] == pytest.approx(drop, rel=error)
    found = solution.tension if name != "cantilever" else np.zeros(4)
    np.testing.assert_allclose(found, forces, rtol=error, atol=1e-9)
    if name != "cantilever":
        assert np.all(np.abs(forces) > 10.0)
