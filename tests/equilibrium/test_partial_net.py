"""Slack cables beside beams and bars: equilibrium where steps with predicted forces cycle."""

import dataclasses
from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from banks.bar_bank import Drawn
from banks.slack_nets import beside_beams, beside_struts
from banks.unsymmetric_bank import unbalanced
from oracles.convergence import converged
from oracles.taylor import TIGHT, assert_gradient

import jaxcable as jc
from jaxcable.common.tree import pytree
from jaxcable.equilibrium.partial_net import PartialNet
from jaxcable.equilibrium.structure_steps import StructureSteps

# Nodes that only slack cables hold have no stiffness. Where steps with predicted forces leave them,
# rounding can make the tangent indefinite.
pytestmark = pytest.mark.filterwarnings("ignore::jaxcable.UnstableWarning")
MANY = jc.Newton(max_steps=2000)


@pytree(indices=("links",))
class PlainCables(jc.Cables):
    """Cables whose tensions are never unknowns: all steps are those with predicted forces."""

    def has_tension_unknown(self, state):
        return False


def largest_unbalanced(structure, phase, displacement):
    """Largest force that is unbalanced where no beam meets, over the largest sum of forces."""
    left, size = unbalanced(Drawn(structure, [phase], 1.0), np.asarray(displacement))
    free = ~structure.supports.fixed(len(left))[:, :3]
    for group in structure.groups:
        if group.rotates:
            free[group.links.array.ravel()] = False
    return np.abs(np.where(free, left, 0.0)).max() / size.max()


def steps(solution):
    return int(solution.phases[0].path.iterations[-1])


HARD = "half", 14, 1e5


@pytest.mark.slow
def test_the_hard_case_is_hard():
    """`PlainCables` need 200 steps."""
    before = jc.solve(*beside_beams(*HARD, PlainCables), jc.Newton(max_steps=100))
    assert int(before.status) == jc.status.NOT_CONVERGED


def test_slack_cables_beside_beams_take_few_steps():
    scene = beside_beams(*HARD)
    solution = converged(jc.solve(*scene))
    assert steps(solution) <= 40  # 21 when it was written
    # tol of the forces, and the rounding of lengths, eps EA over the load
    assert largest_unbalanced(*scene, solution.displacement) < 1e-9
    moved = np.array(solution.displacement) * 1.001
    assert largest_unbalanced(*scene, moved) > 1e-5


@pytest.mark.slow_cases("third")
@pytest.mark.parametrize("kind", ["third", "patches"])
def test_the_equilibrium_is_that_of_predicted_forces(kind):
    case = kind, 14, 1e5
    plain = jc.solve(*beside_beams(*case, PlainCables), MANY)
    solution = jc.solve(*beside_beams(*case), MANY)
    assert int(plain.status) == int(solution.status) == jc.status.OK
    assert steps(solution) < 0.5 * steps(plain)
    tension, expected = solution.tension["cables"], plain.tension["cables"]
    # 1e-9: both residuals are within 1e-10 of the forces
    np.testing.assert_allclose(tension, expected, rtol=0, atol=1e-9 * expected.max())
    moment, bent = (s.section_forces["beams"] for s in (solution, plain))
    np.testing.assert_allclose(moment, bent, rtol=0, atol=1e-9 * np.abs(bent).max())


@pytest.mark.slow
def test_struts_beside_slack_cables():
    total = np.zeros(2)
    for seed in range(10):
        ratio = 10 ** np.random.default_rng(seed).uniform(2, 8)
        scene = beside_struts(seed, ratio)
        solution = jc.solve(*scene)
        plain = jc.solve(*beside_struts(seed, ratio, PlainCables), MANY)
        assert int(solution.status) == jc.status.OK, (seed, ratio)
        rounding = 64 * np.finfo(float).eps * ratio  # of lengths, over forces of about 1 N
        assert largest_unbalanced(*scene, solution.displacement) < 1e-9 + rounding
        total += steps(solution), steps(plain)
    assert total[0] < 0.8 * total[1]


@pytest.mark.slow
def test_gradients():
    structure, phase = beside_beams("half", 14, 1e3)
    cables, forces = structure.elements["cables"], np.asarray(phase.loads.forces)

    def squares(scale):
        loads = dataclasses.replace(phase.loads, forces=scale[0] * forces)
        group = jc.replace(cables, axial_stiffness=scale[1] * cables.axial_stiffness)
        made = jc.replace(structure, elements={**structure.elements, "cables": group})
        solution = jc.solve(made, jc.replace(phase, loads=loads), TIGHT)
        return jnp.sum(solution.tension["cables"] ** 2), solution.status

    assert_gradient(squares, [1.0, 1.0])


@pytest.fixture
def interior_steps(monkeypatch):
    """Interior steps but the first, as they are made: is definite, is usable, changes tensions."""
    noted, make_step = [], StructureSteps.make_step

    def noting(self, state, converged, wanted):
        made = make_step(self, state, converged, wanted)
        before, after = (of.strategy.unknowns for of in (state, made))
        tensions = before.interior_point.tension, after.interior_point.tension
        changes = jnp.any(tensions[0] != tensions[1])
        given = made.definite, made.usable, changes
        counts = before.uses_interior_point & ~before.is_new_mode & ~converged
        jax.debug.callback(lambda counts, *given: counts and noted.append(given), counts, *given)
        return made

    monkeypatch.setattr(StructureSteps, "make_step", noting)
    jc.forget_programs()  # they would not note
    yield noted
    monkeypatch.undo()
    jc.forget_programs()


@pytest.mark.slow
@pytest.mark.parametrize("seed, ratio, follows", [(1, 1.18e5, False), (2, 3674.0, True)])
def test_indefinite_interior_steps_are_taken_if_the_tangent_is_unsymmetric(
    seed, ratio, follows, interior_steps
):
    """If symmetric they are repeated. A load that follows counts as unsymmetric, also if it is 0.

    The second scene failed as long as nodes took such steps, but tensions did not.
    """
    structure, phase = beside_struts(seed, ratio)
    if follows:
        none = jc.CablePressure(1e-9, (1.0, 0.3, 0.5), on="cables")
        phase = jc.replace(phase, loads=[phase.loads, none])
    solution = jc.solve(structure, phase)
    jax.effects_barrier()
    assert int(solution.status) == jc.status.OK
    indefinite = [taken for definite, *taken in interior_steps if not definite]
    assert indefinite and all(taken == [follows, follows] for taken in indefinite)


@pytest.mark.parametrize("kinds", [[jc.Cables], [jc.Bars], [jc.Cables, jc.SlidingCables]])
def test_nets_and_structures_without_cables_have_none(kinds):
    groups = [kind([[0, 1]], axial_stiffness=1.0) for kind in kinds]
    system = SimpleNamespace(groups=groups, states=[SimpleNamespace(line_load=None)] * len(groups))
    assert PartialNet.from_system(system) is None
