"""Loads that follow an amplitude within their phase."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from banks import shapes
from banks.problems import two_links
from oracles.convergence import converged
from oracles.taylor import TIGHT
from oracles.traced import traced

import jaxcable as jc
from jaxcable.common.tree import pytree
from jaxcable.common.types import ArrayLike, Float
from jaxcable.loads.load import OnNodes

FACE, DOWN = [[0, 1, 4], [2, 3, 4]], (0.0, 0.0, -50.0)
LIFT = jc.SupportMovement([0], (0.0, 0.0, 0.02))
HALF = [0.0, 0.5, 1.0]
POINTS, FACTORS = [0.0, 0.25, 0.5, 1.0], [0.0, 1.0, -0.5, 0.3]


def hub():
    return shapes.hub(names=None, weight=20.0)


def frame():
    """A cantilever of two beams, whose tip a cable holds."""
    law = jc.Elastic(2.1e11)
    section = jc.Section.rectangle(0.05, 0.05, law, shape=(4, 4))
    elements = {
        "beams": jc.Beams([[0, 1], [1, 2]], section=section, up=(0.0, 1.0, 0.0), weight=150.0),
        "cable": jc.Cables([[2, 3]], axial_stiffness=1e6),
    }
    nodes = [[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 0, 2.0]]
    return jc.Structure(nodes, elements, jc.clamped([0]) + jc.pinned([3]))


def levels(parameters, factors, count):
    """Factors at the ends of increments, by NumPy, and from each to the next."""
    level = np.interp(np.arange(1, count + 1) / count, parameters, factors)
    return level, np.diff(level, prepend=0.0)


@pytest.mark.slow_cases("frame")
@pytest.mark.parametrize(
    "make, pull, loads",
    [
        (hub, 0.02, [jc.NodalLoads([4], (30.0, 10.0, -40.0)), jc.LineLoads(DOWN), LIFT]),
        (hub, 0.02, [jc.FacePressure(FACE, 200.0), jc.AreaLoads(FACE, DOWN), jc.SelfWeight()]),
        (
            frame,
            None,
            [
                jc.NodalLoads([2], (0.0, 20.0, -100.0), (0.0, 30.0, 0.0)),
                jc.LineLoads((0.0, 0.0, -200.0), on="beams"),
                jc.CablePressure(150.0, (0.0, 1.0, 0.0), on="beams"),
                jc.SupportMovement([0], (0.0, 0.0, 0.01), (0.0, 0.02, 0.0)),
            ],
        ),
    ],
    ids=["dead and moved", "on areas and following", "frame"],
)
def test_a_phase_equals_a_chain_of_phases_with_the_same_levels(make, pull, loads):
    """Every kind of load, beside one that grows with the load factor."""
    structure, count = make(), 4
    first = [jc.Phase(prestrain=pull, loads=jc.SelfWeight())]
    steady = jc.NodalLoads([2 if pull is None else 4], (5.0, 0.0, -20.0))
    late = [0.0, 0.5, 1.0], [0.0, 0.0, 2.0]
    amplitudes = [(POINTS, FACTORS), late, ([0.0, 1.0], [0.0, -1.0]), (POINTS, FACTORS)]
    varying = [jc.Varying(load, *own) for load, own in zip(loads, amplitudes, strict=False)]
    phases = [*first, jc.Phase(loads=[steady, *varying], increments=count)]
    one = converged(jc.solve(structure, phases, TIGHT))
    steps = [levels(*own, count)[1] for own in amplitudes]
    chain = list(first)
    for k in range(count):
        added = [load.scaled(step[k]) for load, step in zip(loads, steps, strict=False)]
        chain.append(jc.Phase(loads=[steady.scaled(1 / count), *added]))
    many = converged(jc.solve(structure, chain, TIGHT))
    path = np.asarray(one.phases[1].path.displacement_in_phase)
    begin = np.asarray(one.phases[0].displacement)
    for k, phase in enumerate(many.phases[1:]):
        at = np.asarray(phase.positions) - structure.nodes
        # rotations of a support by steps and in one turn differ by rounding: about one axis
        assert np.abs(path[k] + begin - at).max() < 1e-9 * np.abs(path).max() + 1e-12
    assert np.abs(np.diff(path, axis=0)).max() > 1e-3  # loads rise and fall
    np.testing.assert_allclose(one.load, many.load, atol=1e-7 * np.abs(one.load).max())
    np.testing.assert_allclose(one.reactions, many.reactions, atol=1e-6 * 1e3)


def bar(**numbers):
    """A bar of 1 m along x, whose end moves along x only."""
    guide = jc.pinned([0]) + jc.restrained([1], "yz")
    return jc.Structure([[0.0, 0, 0], [1.0, 0, 0]], jc.Bars([[0, 1]], **numbers), guide)


PULL = jc.NodalLoads([1], (1.0, 0.0, 0.0))
AREA, E, YIELD, HARD = 1e-4, 200e9, 200e6, 0.1
CYCLE = [0.0, 0.2, 0.6, 1.0], [0.0, 30e3, -28e3, 33e3]  # N


def plastic():
    end = YIELD * (1 + HARD * 99)
    law = jc.Polygonal([-0.1, -1e-3, 0, 1e-3, 0.1], [-end, -YIELD, 0, YIELD, end], "elastic")
    return bar(area=AREA, law=law)


def return_mapping(forces):
    """Strains of a bar with kinematic hardening under forces one after the other, NumPy."""
    plastic_modulus = E * HARD / (1 - HARD)
    back = strain = 0.0
    strains = []
    for stress in np.asarray(forces) / AREA:
        beyond = abs(stress - back) - YIELD
        if beyond > 0:
            way = np.sign(stress - back)
            back += way * beyond
            strain += way * beyond / plastic_modulus
        strains.append(stress / E + strain)
    return np.array(strains)


def test_hysteresis_in_one_phase():
    """Loaded, unloaded into compression and loaded again, against a return mapping."""
    load = jc.Varying(PULL, *CYCLE)
    solution = converged(jc.solve(plastic(), jc.Phase(loads=load, increments=20), TIGHT))
    expected = return_mapping(levels(*CYCLE, 20)[0])
    moved = np.asarray(solution.phases[0].path.displacement)[:, 1, 0]
    assert np.abs(expected).max() > 4e-3 and np.diff(np.sign(np.diff(expected))).any()
    np.testing.assert_allclose(moved, expected, rtol=1e-9)


def test_gradient_by_factors_of_a_loop():
    """Pulled, pushed until it yields, left at 10 kN: the push decides on the plastic strain."""

    def end(factors):
        load = jc.Varying(PULL, CYCLE[0], factors)
        solution = jc.solve(plastic(), jc.Phase(loads=load, increments=10), TIGHT)
        return solution.displacement[1, 0], solution.status

    factors = jnp.array([0.0, 30e3, -15e3, 10e3])
    gradient, code = traced(jax.grad(end, has_aux=True))(factors)
    assert int(code) == jc.status.OK
    # kinematic hardening: the stress at which it yields last says what the plastic strain is
    expected = np.array([0.0, 0.0, (1 - HARD) / (E * HARD), 1 / E]) / AREA
    np.testing.assert_allclose(gradient, expected, rtol=1e-9, atol=1e-20)


def on_the_way(numbers):
    """Deflection of a net in the middle of a phase: `numbers` are a parameter and factors."""
    parameters = jnp.array([0.0, 0.0, 1.0]).at[1].set(numbers[0])
    load = jc.Varying(jc.LineLoads(DOWN), parameters, 1e2 * numbers[1:])
    tight = jc.Phase(prestrain=0.02, loads=jc.SelfWeight())
    phases = [tight, jc.Phase(loads=load, increments=5)]
    solution = jc.solve(hub(), phases, TIGHT, differentiate_path=True)
    return jnp.sum(solution.phases[1].path.displacement_in_phase[:, 4, 2] ** 2), solution.status


NUMBERS = np.array([0.5, 0.02, 0.15, 0.06])


def test_amplitudes_are_mapped_over_and_combined():
    """Mapped over, and one by one; load cases are scaled by their factors."""
    cases = NUMBERS * np.array([[1.0], [0.9], [1.1]])
    values, codes = traced(jax.vmap(on_the_way))(cases)
    assert (np.asarray(codes) == jc.status.OK).all()
    alone = [traced(on_the_way)(case)[0] for case in cases]
    np.testing.assert_allclose(values, np.array(alone), rtol=1e-9)  # tolerance of equilibrium
    wind = jc.Varying(PULL, [0.0, 0.5, 1.0], [0.0, 1.0, 0.5])
    np.testing.assert_allclose(jc.combine([wind], [1.5])[0].factors, [0.0, 1.5, 0.75])
    batch = jc.combine([wind, PULL], [[1.0, 2.0], [3.0, 4.0]])
    analyse = jax.vmap(lambda loads: jc.solve(bar(axial_stiffness=1e6), jc.Phase(loads=loads)))
    np.testing.assert_allclose(analyse(batch).tension[:, 0], [2.5, 5.5])


def test_a_load_step_and_what_goes_on_acting():
    """A first factor acts in the first increment; the last one stays in later phases."""
    stiff = bar(axial_stiffness=1e6)
    step = jc.Varying(PULL.scaled(1e3), [0.0, 1.0], [1.0, 0.4])
    more = jc.Phase(loads=PULL.scaled(50.0))
    phases = [jc.Phase(loads=step, increments=2), more]
    solution = converged(jc.solve(stiff, phases))
    first, second = (np.asarray(phase.path.tension)[:, 0] for phase in solution.phases)
    assert first == pytest.approx([700.0, 400.0]) and second == pytest.approx([450.0])
    later = jc.solve(stiff, more, start=solution)
    assert float(later.tension[0]) == pytest.approx(500.0) and int(later.status) == jc.status.OK


def test_where_a_phase_fails():
    """The last state has the load of its load factor, not that of the end."""
    load = jc.Varying(PULL, [0.0, 0.5, 1.0], [0.0, 15e3, 4e4])
    law = jc.Polygonal([0.0, 1e-3], [0.0, 200e6])  # breaks at 20 kN
    solution = jc.solve(bar(area=AREA, law=law), jc.Phase(loads=load, increments=10))
    assert int(solution.status) == jc.status.MATERIAL_FAILURE
    assert float(solution.last.load_factor) == pytest.approx(0.6)
    assert float(solution.last.load[1, 0]) == pytest.approx(20e3)
    assert float(solution.last.tension[0]) == pytest.approx(20e3)


def test_a_small_load_that_comes_and_goes():
    """Beside forces of 1e6 N and where it is all but zero it is judged by its largest value."""
    structure, _ = two_links(1e9, 1e6, 0.1)
    points = [0.0, 0.25, 0.5, 0.75, 1.0]
    load = jc.Varying(jc.NodalLoads([1], (0.0, 0.0, 0.1)), points, [0.0, 1e-9, 1.0, 1e-9, 0.0])
    phases = [jc.Phase(pretension=1e6), jc.Phase(loads=load, increments=4)]
    solution = converged(jc.solve(structure, phases))
    moved = np.asarray(solution.phases[1].path.displacement_in_phase)[:, 1, 2]
    # stiffness 2 N / l; a residual of 50 tol of the largest load is allowed
    assert moved == pytest.approx(0.1 * np.array([1e-9, 1.0, 1e-9, 0.0]) / 2e6, abs=5e-9 * 5e-8)


@pytest.mark.slow
def test_other_methods_and_analyses():
    """The paper's scheme, influence, a path that begins after a load with an amplitude."""
    stiff, points = bar(axial_stiffness=1e6), ([0.0, 0.5, 1.0], [0.2, 1.0, 0.5])
    varying = jc.Phase(loads=jc.Varying(PULL.scaled(1e3), *points), increments=4)
    solution = converged(jc.solve(stiff, varying, jc.Incremental(corrections=1)))
    tension = np.asarray(solution.phases[0].path.tension)[:, 0]
    assert tension == pytest.approx([600.0, 1000.0, 750.0, 500.0], rel=1e-6)
    rate = jc.influence(stiff, [varying], of="displacement", wrt="load")
    assert float(rate[1, 0, 1, 0]) == pytest.approx(1e-6)  # m/N: L / EA
    path = converged(jc.trace_path(stiff, [varying, jc.Phase(loads=PULL.scaled(100.0))]))
    assert float(path.tension[-1, 0]) == pytest.approx(600.0)


def test_what_is_said_of_it():
    load = jc.Varying(jc.SelfWeight(), [0, 0.4, 1], [0, 1, 0.2])
    assert str(load) == "SelfWeight; amplitude: 0 at 0, 1 at 0.4, 0.2 at 1"
    many = np.linspace(0, 1, 20)
    assert str(jc.Varying(jc.SelfWeight(), many, many)) == "SelfWeight; amplitude: 20 points"


@pytree
class Bare(OnNodes):
    """A load of a user that says nothing of factors: the amplitude has them."""

    force: Float[ArrayLike, " 3"]

    def nodal_forces(self, shape, dtype):
        return jnp.zeros(shape, dtype).at[1].set(jnp.asarray(self.force, dtype))


def test_of_a_users_load_and_a_number_that_is_none():
    structure, own = bar(axial_stiffness=1e6), Bare((100.0, 0.0, 0.0))
    found, unknown = (
        jc.solve(structure, jc.Phase(loads=jc.Varying(own, HALF, [0.0, x, 2.0]), increments=2))
        for x in (3.0, np.nan)
    )
    assert float(converged(found).tension[0]) == pytest.approx(200.0)
    assert int(unknown.status) == jc.status.NONFINITE
