"""Frames as a whole: batches, single precision, hinges in the results, starts, rounding."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from banks.shapes import beam, pieces
from oracles.convergence import converged

import jaxcable as jc

NODES = pieces(2, 2.0)[0]
SECTION = jc.Section.rectangle(0.02, 0.05, jc.Elastic(210e9))
EI = float(SECTION.stiffness()[1, 1])


def cantilever(section=SECTION, **options):
    return beam(2, section, 2.0, **options)


def tip(force, structure=None):
    load = jc.NodalLoads([2], jnp.stack([0 * force, 0 * force, -force]))
    solution = jc.solve(cantilever() if structure is None else structure, [jc.Phase(loads=load)])
    return solution.displacement[2, 2], solution


@pytest.mark.slow
def test_a_small_load_in_single_precision_moves_the_beam():
    """Not taken for rounding: that goes with the displacements, and these are zero at first."""
    as_single = jax.tree.map(lambda v: jnp.asarray(v, jnp.float32), SECTION)
    structure = cantilever(as_single)
    structure = jc.replace(structure, nodes=jnp.asarray(NODES, jnp.float32))
    for force in (10.0, 100.0):
        deflection, solution = tip(jnp.float32(force), structure)
        assert int(solution.status) == 0
        assert solution.displacement.dtype == jnp.float32
        # eps 1e-7 times the condition of two elements, some 100
        assert float(deflection) == pytest.approx(-force * 8 / 3 / EI, rel=1e-4)


@pytest.mark.slow
def test_loads_of_hinged_ends_are_those_of_their_node():
    hinges = np.zeros((4, 2), bool)
    hinges[1, 1] = True
    structure = beam(4, SECTION, 4.0, jc.clamped([0, 4]), hinges=hinges, weight=100.0)
    loads = [jc.SelfWeight(), jc.LineLoads((0, 0, -50.0))]
    solution = converged(jc.solve(structure, [jc.Phase(loads=loads)]))
    expected = -150.0 * np.array([0.5, 1, 1, 1, 0.5])
    assert np.abs(np.asarray(solution.load)[:, 2] - expected).max() < 1e-12 * 150
    # equilibrium to 1e-10 of the forces
    assert np.abs(np.asarray(solution.reactions + solution.load).sum(0)).max() < 1e-7


@pytest.mark.filterwarnings("ignore:supports. nodes:jaxcable.InputWarning")  # behind a ball, it can
def test_start_of_another_frame():
    done = tip(jnp.float64(1.0))[1]
    assert int(done.status) == 0
    cables = jc.Cables([[0, 1], [1, 2]], axial_stiffness=1.0)
    plastic = jc.Section.rectangle(0.02, 0.05, jc.materials.steel())
    others = {
        "is made of Cables in this structure, and of Beams there": jc.Structure(
            NODES, cables, jc.pinned([0])
        ),
        "hinges: other ends are hinged": cantilever(hinges=[[False, True], [False] * 2]),
        "its beams have other inner unknowns": cantilever(section=plastic),
    }
    for message, other in others.items():
        with pytest.raises(ValueError, match=f"start: elements: {message}"):
            jc.solve(other, [jc.Phase()], start=done)
    with pytest.raises(ValueError, match=r"phase: expected one of solution\.phases, got Solution"):
        jc.fibre_stress(cantilever(), done)
