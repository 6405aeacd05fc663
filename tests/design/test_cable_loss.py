"""The sudden loss of cables: against the rule, a transient, closed forms and Taylor's test."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from banks.shapes import spokes
from oracles.convergence import converged
from oracles.taylor import TIGHT, assert_gradient
from oracles.traced import traced
from scipy.integrate import solve_ivp

import jaxcable as jc
from jaxcable.common.units import as_units
from jaxcable.design import Action, combinations, loss_of_cable
from jaxcable.reporting.load_descriptions import describe_actions

PYRAMID = spokes(4, height=1.0, group=jc.Bars)
"""Four bars down to a ring, of which three carry any load."""
NAMED = jc.replace(PYRAMID.structure, elements={"legs": PYRAMID.structure.elements})


def solved(structure, phase, **options):
    return converged(jc.solve(structure, phase, TIGHT, **options))


def effects(solution, lost=None):
    """Displacements, forces of elements that are not lost, and reactions, by name as vectors."""
    lost = jax.tree.map(np.zeros_like, solution.tension) if lost is None else lost
    tension = jax.tree.map(lambda force, gone: np.where(gone, 0.0, force), solution.tension, lost)
    names = "displacement", "reactions", "reaction_moments"
    found = {name: getattr(solution, name) for name in names} | {"tension": tension}
    if solution.rotation is not None:
        found["rotation"] = solution.rotation[:, 1:]  # half of small angles
    parts = {name: jax.tree.leaves(part) for name, part in found.items() if part is not None}
    return {name: np.concatenate(list(map(np.ravel, part))) for name, part in parts.items()}


def amplified(structure, phase, elements, removes, factor):
    """Effects of the action, and those by the rule from two static analyses without it, by name."""
    before = solved(structure, phase)
    after = solved(structure, jc.Phase(removes=removes), start=before)
    action = loss_of_cable(structure, before, elements, dynamic_factor=factor)
    case = jc.Phase(loads=action.loads, removes=action.removes)
    states = before, after, solved(structure, case, start=before)
    first, second, found = (effects(state, action.removes) for state in states)
    ruled = {name: own + factor * (second[name] - own) for name, own in first.items()}
    assert all(np.abs(second[name] - own).max() > 0 for name, own in first.items())
    return found, ruled


PLUMB = {"bars": (jc.Bars, [[1, 2], [0, 1], [2, 3]]), "ropes": (jc.SlidingCables, [[1, 2], [0, 1]])}
"""Groups of a structure on one line from top to bottom; both ends of the first ones are free."""


@pytest.fixture(scope="module")
def plumb_line():
    """A structure whose response is linear, its phase, and its state."""
    groups = {
        name: kind(links, axial_stiffness=1e6 * np.arange(1.0, 1 + len(links)), weight=40.0)
        for name, (kind, links) in PLUMB.items()
    }
    nodes = [[0.0, 0.0, z] for z in (6.0, 4.0, 2.0, 0.0)]
    structure = jc.Structure(nodes, groups, jc.pinned([0, 3]) + jc.restrained([1, 2], "xy"))
    loads = [jc.SelfWeight(), jc.LineLoads((0.0, 0.0, -25.0)), jc.NodalLoads([1], (0, 0, -500.0))]
    return structure, jc.Phase(pretension=dict.fromkeys(PLUMB, 3e3), loads=loads)


@pytest.mark.parametrize("name", PLUMB)
def test_a_linear_structure_obeys_the_rule_exactly(plumb_line, name):
    """Weight, a load along all elements and prestress: 1e-12 of the largest.

    The element that is lost is between free nodes, so that all shares of its load count.
    """
    found, ruled = amplified(*plumb_line, {name: [0]}, {name: jc.only([0])}, 1.7)
    for effect, values in ruled.items():
        np.testing.assert_allclose(found[effect], values, atol=1e-12 * np.abs(values).max())


def frame(hinged):
    """A beam of two spans, clamped at both ends, with a stay at its middle.

    The second span has a hinge there, or none.
    """
    section = jc.Section.rectangle(0.1, 0.2, jc.Elastic(2e11), (1, 2))
    hinges = np.array([[[False] * 3, [False] * 3], [[hinged] * 3, [False] * 3]])
    beams = jc.Beams([[0, 1], [1, 2]], section=section, weight=300.0, hinges=hinges)
    stay = jc.Bars([[1, 3]], axial_stiffness=1e6)
    nodes = [[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [5.0, 0.0, 0.0], [4.0, 0.0, 3.0]]
    return jc.Structure(nodes, {"beam": beams, "stay": stay}, jc.clamped([0, 2]) + jc.pinned([3]))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("structure", "elements", "removes", "load"),
    [
        (PYRAMID.structure, [1], jc.only([1]), jc.NodalLoads([0], (75.0, 50.0, -225.0))),
        (frame(False), {"beam": [1]}, {"beam": jc.only([1])}, jc.SelfWeight((0.01, 0.05, -0.05))),
        (frame(True), {"beam": [1]}, {"beam": jc.only([1])}, jc.SelfWeight((0.01, 0.05, -0.05))),
    ],
    ids=["bars", "beam", "hinged beam"],
)
def test_the_rule_holds_to_first_order(structure, elements, removes, load):
    """Half of the load leaves a quarter of the difference."""
    errors = []
    for share in (1.0, 0.5):
        phase = jc.Phase(loads=load.scaled(share))
        found, ruled = amplified(structure, phase, elements, removes, 2.0)
        errors.append({name: np.abs(found[name] - ruled[name]).max() for name in found})
    for name, error in errors[1].items():
        assert 0 < error < 0.05 * np.abs(ruled[name]).max()  # nearly linear, but not quite
        # terms of third order
        assert errors[0][name] / error == pytest.approx(4.0, rel=0.05), name


def test_a_mass_swings_as_far():
    """Two cables carry a mass; one breaks: SciPy integrates the swing of the mass, undamped."""
    nodes = [[-3.0, 0.0, 4.0], [3.0, 0.0, 4.0], [0.0, 0.0, 0.0]]
    stiffness, weight = 1e6, 2e3
    cables = jc.Cables([[0, 2], [1, 2]], axial_stiffness=stiffness)
    held = jc.pinned([0, 1]) + jc.restrained([2], "xy")
    structure = jc.Structure(nodes, {"stays": cables}, held)
    before = solved(structure, jc.Phase(loads=jc.NodalLoads([2], (0.0, 0.0, -weight))))
    action = loss_of_cable(structure, before, {"stays": [1]})
    case = jc.Phase(loads=action.loads, removes=action.removes)
    found = solved(structure, case, start=before)

    def pull(z, count):
        length = np.hypot(3.0, 4.0 - z)
        return count * stiffness * (length / 5.0 - 1.0) * (4.0 - z) / length

    mass, start = weight / 9.81, float(before.displacement[2, 2])
    assert pull(start, 2) == pytest.approx(weight, rel=1e-9)
    period = 2 * np.pi * np.sqrt(mass / (stiffness / 5.0 * 0.8**2))
    swing = solve_ivp(
        lambda t, y: [y[1], pull(y[0], 1) / mass - 9.81],
        (0.0, 1.2 * period), [start, 0.0], rtol=1e-10, atol=1e-12, max_step=period / 200,
    )  # fmt: skip
    lowest = swing.y[0].min()
    tension = stiffness * (np.hypot(3.0, 4.0 - lowest) / 5.0 - 1.0)
    # strains of 4e-3 and slopes that change by as much: a few of these
    np.testing.assert_allclose(float(found.displacement[2, 2]), lowest, rtol=0.01)
    np.testing.assert_allclose(float(found.tension["stays"][0]), tension, rtol=0.01)
    assert lowest / start == pytest.approx(3.0, rel=0.02)  # 1 + 2 (2 - 1)


def test_without_amplification_it_is_the_static_loss():
    """Factor 1: no loads, bit for bit the same; a factor a billionth above: nearly the same."""
    structure = PYRAMID.structure
    before = solved(structure, jc.Phase(loads=PYRAMID.load(900.0)))
    static = loss_of_cable(structure, before, [2], dynamic_factor=1)
    assert static.loads is None
    after = solved(structure, jc.Phase(removes=static.removes), start=before)
    alone = solved(structure, jc.Phase(removes=jc.only([2])), start=before)
    for name, values in effects(alone).items():
        assert np.array_equal(effects(after)[name], values)
    nearly = loss_of_cable(structure, before, [2], dynamic_factor=1.0 + 1e-9)
    case = jc.Phase(loads=nearly.loads, removes=nearly.removes)
    swung = solved(structure, case, start=before)
    np.testing.assert_allclose(swung.reactions, after.reactions, atol=1e-5)
    assert not np.array_equal(swung.reactions, after.reactions)


def test_forces_of_catenaries_are_those_at_their_ends():
    """The closed form of Irvine: the half of a cable that hangs level in its middle."""
    s, pull, weight, stiffness = 60.0, 6000.0, 30.0, 60e6
    x = pull / weight * np.arcsinh(weight * s / pull) + pull * s / stiffness
    catenaries = jc.Catenaries(
        [[0, 1], [1, 2]], axial_stiffness=stiffness, weight=weight, rest_length=s
    )
    nodes = [[-x, 0.0, 9.0], [0.0, 0.0, 0.0], [x, 0.0, 9.0]]
    structure = jc.Structure(nodes, catenaries, supports=jc.pinned([0, 2]))
    before = solved(structure, jc.Phase(loads=jc.SelfWeight()))
    (load,) = loss_of_cable(structure, before, [1], dynamic_factor=1.8).loads
    assert np.asarray(load.nodes).tolist() == [1, 2]
    expected = 0.8 * np.array([[-pull, 0.0, 0.0], [pull, 0.0, weight * s]])
    np.testing.assert_allclose(load.forces, expected, atol=1e-9 * pull)


def test_derivatives_through_the_intact_state():
    """A force after the loss by stiffnesses, load and dynamic factor."""
    structure = PYRAMID.structure

    def force(p):
        bars = jc.replace(structure.elements, axial_stiffness=p[:4])
        own = jc.replace(structure, elements=bars)
        load = jc.NodalLoads([0], jnp.stack([0.3 * p[4], 0.2 * p[4], -p[4]]) * 1e-2)
        before = jc.solve(own, jc.Phase(loads=load), TIGHT)
        action = loss_of_cable(own, before, [1], dynamic_factor=p[5] * 1e-5)
        case = jc.Phase(loads=action.loads, removes=action.removes)
        solution = jc.solve(own, case, TIGHT, start=before)
        return solution.tension[0], solution.status

    gradient = assert_gradient(force, [1e5, 1.2e5, 0.9e5, 1.1e5, 0.8e5, 1.9e5], 10.0)
    assert np.all(np.asarray(gradient) != 0)


def test_traced_numbers_that_break_a_rule_give_nan():
    """A failed solution and a factor below 1, traced; sound ones are the control."""
    structure = PYRAMID.structure
    before = solved(structure, jc.Phase(loads=PYRAMID.load(900.0)))

    @traced
    def forces(solution, factor):
        return loss_of_cable(structure, solution, [1], dynamic_factor=factor).loads[0].forces

    expected = loss_of_cable(structure, before, [1], dynamic_factor=1.5).loads[0].forces
    np.testing.assert_allclose(forces(before, 1.5), expected, rtol=1e-14)
    assert np.isnan(forces(before, 0.5)).all() and np.isnan(forces(before, np.inf)).all()
    failed = jc.replace(before, status=jnp.int32(1))
    assert np.isnan(forces(failed, 1.5)).all()
    slopes = jax.grad(lambda k: forces(failed, k).sum())(1.5)
    assert np.isnan(slopes)


def test_elements_are_named_in_several_ways():
    """Indices, booleans, `only`, True and names of groups remove the same elements."""
    structure = NAMED
    before = solved(structure, jc.Phase(loads=PYRAMID.load(900.0)))
    second = np.arange(4) == 1
    given = {"legs": [1]}, {"legs": second}, {"legs": jc.only([1])}, {"legs": jnp.array([1])}
    actions = [loss_of_cable(structure, before, one) for one in given]
    for action in actions:
        assert action.name == "loss of legs 1" and action.kind == "accidental"
        assert np.array_equal(action.removes["legs"], second)
        assert np.array_equal(action.loads[0].forces, actions[0].loads[0].forces)
    for one in ("legs", ["legs"], {"legs": True}):
        action = loss_of_cable(structure, before.last, one, name="all")
        assert action.name == "all" and action.removes["legs"].all()
    bare = PYRAMID.structure
    alone = solved(bare, jc.Phase(loads=PYRAMID.load(900.0)))
    assert loss_of_cable(bare, alone, [0, 3]).name == "loss of elements 0, 3"


def test_losses_are_combined_written_and_described(tmp_path):
    """Two losses in one batch equal each alone; a file keeps them; a report says what acts."""
    structure = NAMED
    dead = PYRAMID.load(900.0)
    phases = [jc.Phase(loads=dead)]
    before = solved(structure, phases)
    losses = [loss_of_cable(structure, before, {"legs": [k]}) for k in (1, 2)]
    snow = Action("snow", "snow", PYRAMID.load(500.0))
    actions = [Action("dead", "permanent", dead, in_phases=True), snow, *losses]
    found = combinations(actions, which=["ACC 6.11"])
    assert found.formula(0) == "1 dead + 1 loss of legs 1"
    batch = jc.design.solve_cases(structure, None, found, TIGHT, start=before)
    assert not np.asarray(batch.status).any()
    for k, factors in enumerate(found.factors):
        (loss,) = [one for one, factor in zip(losses, factors[2:], strict=True) if factor]
        extra = [dead.scaled(500.0 / 900.0 * factors[1])]
        case = jc.Phase(loads=[*loss.loads, *extra], removes=loss.removes)
        alone = solved(structure, case, start=before)
        np.testing.assert_allclose(batch.tension["legs"][k], alone.tension["legs"], atol=1e-8)
    assert {tuple(row[2:]) for row in found.factors} == {(1, 0), (0, 1)}
    path = tmp_path / "scene.json"
    jc.save_scene(path, (structure, phases), units="kN, mm", actions=actions)
    read = jc.load_scene(path).actions[2]
    assert read.name == losses[0].name and np.array_equal(read.removes["legs"], [0, 1, 0, 0])
    np.testing.assert_allclose(read.loads[0].forces, losses[0].loads[0].forces, rtol=4e-16)
    pull = np.linalg.norm(losses[0].loads[0].forces[0]) / 1e3
    (text,) = describe_actions(losses[:1], structure, as_units("kN, m"))
    assert text == (
        f"NodalLoads on 2 nodes, up to {pull:.6g} kN, sum (0, 0, 0) kN; 1 element lost: legs 1"
    )
