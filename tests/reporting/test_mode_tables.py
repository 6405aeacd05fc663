"""The table of natural modes in reports."""

import numpy as np
import pytest

import jaxcable as jc

STRUCTURE, PHASES = jc.scenes.flat_net()


def test_modes_have_frequencies_and_shares_of_mass():
    solution = jc.solve(STRUCTURE, PHASES)
    found = jc.dynamics.modes(STRUCTURE, solution, n=12, masses=2.0)
    assert int(solution.status) == int(found.status) == 0
    made = jc.report(STRUCTURE, solution, modes=found, units="kip, ft")
    table = made.tables["modes"]
    assert table.columns[:3] == ("mode", "frequency", "period") and len(table.rows) == 12
    rows = np.array(table.rows)
    np.testing.assert_allclose(rows[:, 1] * rows[:, 2], 1.0, rtol=1e-12)
    np.testing.assert_allclose(rows[:, 1], found.frequency, rtol=1e-12)
    np.testing.assert_allclose(rows[-1, 6:], 1.0, rtol=1e-9)  # of all twelve modes
    assert table.notes[0].endswith("8 kg along x, 8 kg along y, 8 kg along z")
    assert "Natural modes about the final state" in made.text()
    assert "equal frequencies" in table.notes[1] and found.repeated.any()
    with pytest.raises(ValueError, match="modes: expected NaturalModes, got "):
        jc.report(STRUCTURE, solution, modes=solution)
