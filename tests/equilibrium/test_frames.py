"""Frames as a whole: batches, single precision, hinges in the results, starts, rounding."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcable as jc

NODES = np.array([[0.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0]])
SECTION = jc.Section.rectangle(0.02, 0.05, jc.Elastic(210e9))
EI = float(SECTION.stiffness()[1, 1])


def cantilever(nodes=NODES, section=SECTION, **options):
    group = jc.Beams([[0, 1], [1, 2]], section=section, **options)
    return jc.Structure(nodes, group, jc.clamped([0]))


def tip(force, structure=None):
    load = jc.NodalLoads([2], jnp.stack([0 * force, 0 * force, -force]))
    solution = jc.solve(cantilever() if structure is None else structure, [jc.Phase(loads=load)])
    return solution.displacement[2, 2], solution


@pytest.mark.slow
def test_gradient_through_a_batch():
    """A shared parameter of a batch: the sum of the cases' gradients."""
    forces = jnp.array([500.0, 1000.0])

    @jax.jit
    def both(w):
        def total(w):
            return jnp.sum(jax.vmap(lambda p: tip(p * w)[0])(forces))

        return jax.grad(total)(w), jax.vmap(jax.grad(lambda p: tip(p)[0]))(forces)

    shared, single = both(1.0)
    # the same sums, in another order
    assert float(shared) == pytest.approx(float(single @ forces), rel=1e-12)
    # and close to the linear deflection, P L^3 / 3 EI
    assert float(shared) == pytest.approx(-1500 * 8 / 3 / EI, rel=1e-2)


@pytest.mark.slow
def test_a_small_load_in_single_precision_moves_the_beam():
    """Not taken for rounding: that goes with the displacements, and these are zero at first."""
    as_single = jax.tree.map(lambda v: jnp.asarray(v, jnp.float32), SECTION)
    structure = cantilever(jnp.asarray(NODES, jnp.float32), as_single)
    for force in (10.0, 100.0):
        deflection, solution = tip(jnp.float32(force), structure)
        assert int(solution.status) == 0
        assert solution.displacement.dtype == jnp.float32
        # eps 1e-7 times the condition of two elements, some 100
        assert float(deflection) == pytest.approx(-force * 8 / 3 / EI, rel=1e-4)


def test_a_released_beam_comes_to_rest():
    """At exactly no load: forces and displacements are all rounding of where it came from."""
    structure = cantilever()
    down = jc.NodalLoads([2], (0, 0, -500.0))
    up = jc.NodalLoads([2], (0, 0, 500.0))
    phases = [jc.Phase(loads=down), jc.Phase(loads=up, increments=2), jc.Phase()]
    solution = jc.solve(structure, phases)
    assert int(solution.status) == 0
    loaded = float(solution.phases[0].displacement[2, 2])
    # rounding of the displacement times the condition of the frame
    assert np.abs(np.asarray(solution.displacement)).max() < 1e-11 * abs(loaded)


def test_a_stiff_beam_does_not_hide_a_small_load():
    rigid = jc.Section.rectangle(0.02, 0.05, jc.Elastic(1e18))
    structure = jc.Structure(
        NODES,
        [jc.Beams([[0, 1]], section=SECTION), jc.Beams([[1, 2]], section=rigid)],
        jc.clamped([0]),
    )
    deflection, solution = tip(jnp.float64(1.0), structure)
    assert int(solution.status) == 0
    # bending of the first metre, by force and moment, and its slope carried on; stiffnesses
    # apart by 5e6 leave eps times that
    expected = -(1 / 3 + 1 / 2 + 1 / 2 + 1) / EI
    assert float(deflection) == pytest.approx(expected, rel=1e-6)


@pytest.mark.slow
def test_loads_of_hinged_ends_are_those_of_their_node():
    nodes = np.column_stack([np.linspace(0, 4, 5), np.zeros((5, 2))])
    hinges = np.zeros((4, 2), bool)
    hinges[1, 1] = True
    links = np.column_stack([np.arange(4), np.arange(1, 5)])
    group = jc.Beams(links, section=SECTION, hinges=hinges, weight=100.0)
    structure = jc.Structure(nodes, group, jc.clamped([0, 4]))
    loads = [jc.SelfWeight(), jc.LineLoads((0, 0, -50.0))]
    solution = jc.solve(structure, [jc.Phase(loads=loads)])
    assert int(solution.status) == 0
    expected = -150.0 * np.array([0.5, 1, 1, 1, 0.5])
    assert np.abs(np.asarray(solution.load)[:, 2] - expected).max() < 1e-12 * 150
    # equilibrium to 1e-10 of the forces
    assert np.abs(np.asarray(solution.reactions + solution.load).sum(0)).max() < 1e-7


@pytest.mark.slow
def test_strains_that_nobody_asked_for_have_no_derivative():
    law = jc.Polygonal([-0.01, 0.0, 0.01], [-1e9, 0.0, 1e9])
    bars = jc.Bars([[0, 1], [1, 2]], area=1e-4, law=law)
    structure = jc.Structure(NODES, bars, jc.pinned([0, 2]))

    def stress(force, asked):
        load = jc.NodalLoads([1], jnp.stack([force, 0 * force, 0 * force]))
        phase = jc.Phase(prestrain=1e-3, loads=load)
        solution = jc.solve(structure, [phase], differentiate_path=asked)
        return jc.fibre_stress(structure, solution.phases[0])[-1, 0]

    slopes = {asked: float(jax.grad(stress)(100.0, asked)) for asked in (False, True)}
    assert np.isnan(slopes[False])
    assert slopes[True] == pytest.approx(0.5 / 1e-4, rel=1e-2)  # half of the load to each bar


@pytest.mark.parametrize("change", ["beams", "hinges", "memory"])
@pytest.mark.filterwarnings("ignore:supports. nodes:jaxcable.InputWarning")  # behind a ball, it can
def test_start_of_another_frame(change):
    done = tip(jnp.float64(1.0))[1]
    if change == "beams":
        other = jc.Structure(
            NODES, jc.Cables([[0, 1], [1, 2]], axial_stiffness=1.0), jc.pinned([0])
        )
        message = "start: elements: is made of Cables here and of Beams there"
    elif change == "hinges":
        other = cantilever(hinges=[[False, True], [False, False]])
        message = "start: elements: hinges: other ends turn here than there"
    else:
        other = cantilever(section=jc.Section.rectangle(0.02, 0.05, jc.materials.steel()))
        message = "start: elements: its beams have other inner numbers"
    with pytest.raises(ValueError, match=message):
        jc.solve(other, [jc.Phase()], start=done)


def test_fibre_stress_wants_a_phase():
    with pytest.raises(ValueError, match=r"phase: expected one of solution\.phases, got Solution"):
        jc.fibre_stress(cantilever(), tip(jnp.float64(1.0))[1])
