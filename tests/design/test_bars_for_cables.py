"""`tune` with bars in place of cables: the solution of taut cables without their program."""

import jax
import numpy as np
import pytest

import jaxcable as jc
from jaxcable.analysis import phase_loop
from jaxcable.design import Target, tune
from jaxcable.design.bars_for_cables import replace_cables_by_bars, solve_with_bars_if_taut

MAST = jc.Structure(
    [[0.0, 0.0, 0.0], [0.0, 0.0, 20.0], [-15.0, 0.0, 0.0], [15.0, 0.0, 0.0]],
    {
        "mast": jc.Bars([[0, 1]], axial_stiffness=1e9),
        "stays": jc.Cables([[2, 1], [3, 1]], axial_stiffness=5e7),
    },
    supports=jc.pinned([0, 2, 3]) + jc.restrained([1], "y"),
)
PULL = jc.NodalLoads([1], (10e3, 0.0, 0.0))


def pulled(force, increments=4, **changes):
    """Both stays stressed to a force, N, then the pull at the top, which relieves one of them."""
    stressed = jc.Phase(pretension={"mast": None, "stays": np.array([force, force])}, **changes)
    return [stressed, jc.Phase(loads=PULL, increments=increments)]


def leaves(solution):
    """Arrays of a solution by path, but for the counts of steps, which another way may change."""
    found = jax.tree_util.tree_leaves_with_path(solution)
    names = {jax.tree_util.keystr(path): np.asarray(x) for path, x in found}
    counts = "iterations", "factorizations", "residual", "rounding"
    return {name: x for name, x in names.items() if not any(word in name for word in counts)}


def require_same(found, wanted):
    """The same numbers within the tolerance of analyses, 1e-8 of the forces."""
    found, wanted = leaves(found), leaves(wanted)
    assert found.keys() == wanted.keys()
    for name, value in wanted.items():
        scale = np.nanmax(np.abs(value), initial=0.0) if value.dtype.kind == "f" else 0.0
        np.testing.assert_allclose(
            found[name], value, rtol=1e-6, atol=1e-9 + 1e-7 * scale, err_msg=name
        )


def test_a_solution_with_bars_is_that_of_taut_cables():
    phases = pulled(40e3)
    found = solve_with_bars_if_taut(MAST, replace_cables_by_bars(MAST), phases, None)
    assert found.status == 0
    require_same(found, jc.solve(MAST, phases))
    more = jc.Phase(loads=PULL)  # which relieves a stay until it is slack: a cable, no bar
    gone, wanted = (
        jc.solve(MAST, [more] * 7, start=start) for start in (found, jc.solve(MAST, phases))
    )
    assert gone.status == wanted.status == 0 and gone.tension["stays"].min() == 0.0
    require_same(gone, wanted)


def test_a_cable_that_goes_slack_on_the_way_is_a_cable():
    """Of four increments the last one slackens a stay; a bar would press."""
    phases = pulled(8e3)
    pressing = replace_cables_by_bars(MAST)
    assert jc.solve(pressing, phases).tension["stays"].min() < -100.0
    found = solve_with_bars_if_taut(MAST, pressing, phases, None)
    assert found.status == 0 and found.tension["stays"].min() == 0.0
    require_same(found, jc.solve(MAST, phases))
    back = jc.Phase(loads=jc.NodalLoads([1], (-10e3, 0.0, 0.0)))  # taut again in the end
    found = solve_with_bars_if_taut(MAST, pressing, [*phases, back], None)
    slack = [np.asarray(phase.path.n_slack) for phase in found.phases]
    assert found.status == 0 and slack[1].max() == 1 and slack[2][-1] == 0


def test_absent_cables_do_not_count():
    """A second pair of stays is added in the next phase: their force is zero before."""
    stays = {**MAST.elements, "added": jc.Cables([[2, 1], [3, 1]], axial_stiffness=5e7)}
    structure = jc.replace(MAST, elements=stays)
    forces = {"mast": None, "stays": np.array([40e3, 40e3]), "added": None}
    later = {"mast": None, "stays": None, "added": jc.only([0, 1])}
    pair = {**later, "added": np.array([5e3, 5e3])}
    phases = [jc.Phase(pretension=forces, loads=PULL), jc.Phase(adds=later, pretension=pair)]
    found = solve_with_bars_if_taut(structure, replace_cables_by_bars(structure), phases, None)
    assert found.status == 0 and not np.any(found.phases[0].tension["added"])
    jc.forget_programs()
    require_same(found, jc.solve(structure, phases))


def test_what_cables_refuse_is_refused():
    """Bars would take a force below zero."""
    with pytest.raises(ValueError, match="pretension"):
        solve_with_bars_if_taut(MAST, replace_cables_by_bars(MAST), pulled(-1e3), None)


def test_the_program_of_cables_is_not_compiled():
    upright = Target("positions", 0.0, at=(1, 0), phase=1, within=1e-4)
    jc.forget_programs()
    found = tune(MAST, pulled(40e3), [(0, "pretension")], [upright])
    assert found.status == 0 and len(phase_loop.analyse.known) == 1
    again = jc.solve(MAST, found.phases)  # with cables, compiled now
    assert len(phase_loop.analyse.known) == 2
    require_same(found.solution, again)
