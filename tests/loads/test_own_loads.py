"""A load of one's own (`own_loads`) goes where the package's own go, without a change in it.

Oracles: the closed integrals of the power law, equilibrium in NumPy, Taylor's theorem.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from banks.shapes import pieces
from extensions.own_loads import PowerLawWind
from oracles.convergence import converged
from oracles.taylor import TIGHT, assert_gradient, joined

import jaxcable as jc
from jaxcable.analysis.preparation import prepare
from jaxcable.extend import Indices, OnNodes, pytree

HEIGHT, EXPONENT, AT_TEN = 40.0, 0.32, 50.0  # m, -, N/m
WIND = PowerLawWind((AT_TEN, 0.0, 0.0), EXPONENT)


def mast_with_guys():
    """A mast of bars between four guys: nodes have displacements only."""
    around = [[15.0, 0, 0], [0, 15.0, 0], [-15.0, 0, 0], [0, -15.0, 0]]
    nodes = np.array([[0.0, 0, 0], [0, 0, 12.0], [0, 0, 24.0], *around])
    guys = [[top, foot] for top in (1, 2) for foot in (3, 4, 5, 6)]
    elements = {
        "mast": jc.Bars([[0, 1], [1, 2]], axial_stiffness=1e8),
        "guys": jc.Cables(guys, axial_stiffness=2e6),
    }
    return jc.Structure(nodes, elements, jc.pinned([0, 3, 4, 5, 6]))


PRESTRESS = jc.Phase(pretension={"mast": None, "guys": 8e3})


@pytest.mark.slow
def test_shear_and_moment_at_the_foot_are_the_integrals():
    """Of a cantilever of eight beams, 5 m each."""
    nodes, links = pieces(8, HEIGHT, (0.0, 0.0, 1.0))
    beams = jc.Beams(links, section=jc.Section.ring(0.5, 0.02, jc.Elastic(210e9)))
    mast = jc.Structure(nodes, beams, jc.clamped([0]))
    solution = converged(jc.solve(mast, jc.Phase(loads=WIND), jc.Newton(tol=1e-12)))
    shear = AT_TEN * 10 / (EXPONENT + 1) * (HEIGHT / 10) ** (EXPONENT + 1)
    moment = AT_TEN * 100 / (EXPONENT + 2) * (HEIGHT / 10) ** (EXPONENT + 2)
    # at the ground the power law has no derivative, which its quadrature over 5 m pays for
    assert float(-solution.reactions[0, 0]) == pytest.approx(shear, rel=2e-4)
    # the wind acts on the deflected mast, whose top sinks
    sunk = float(-solution.displacement[-1, 2])
    assert 0 < sunk < 0.02
    assert float(-solution.reaction_moments[0, 1]) == pytest.approx(moment, rel=2 * sunk / HEIGHT)


def test_gradients():
    def sway(p):
        structure = jc.replace(mast_with_guys(), nodes=p["nodes"])
        wind = jc.Phase(loads=PowerLawWind(p["reference"], p["exponent"]))
        solution = jc.solve(structure, [PRESTRESS, wind], TIGHT)
        return 1e3 * jnp.sum(solution.displacement[2]), solution.status

    nodes = mast_with_guys().nodes
    p = {"reference": [AT_TEN, 5.0, 0.0], "exponent": EXPONENT, "nodes": nodes}
    sizes = {"nodes": 0.05, "reference": 5.0, "exponent": 5.0}
    assert_gradient(*joined(sway, p, sizes))


def test_it_is_scaled_combined_and_mapped_over():
    loads = jc.combine({"wind": WIND, "weight": jc.NodalLoads([2], (0, 0, -1e3))}, [[1, 0], [2, 1]])
    both = jax.vmap(lambda one: jc.solve(mast_with_guys(), jc.replace(PRESTRESS, loads=one)))(loads)
    assert (np.asarray(both.status) == 0).all()
    np.testing.assert_allclose(both.load[1, :, 0], 2 * both.load[0, :, 0], rtol=1e-14)
    np.testing.assert_allclose(both.load[1, 2, 2] - both.load[0, 2, 2], -1e3, rtol=1e-14)


@pytest.mark.slow
def test_files_and_reports_take_it(tmp_path):
    structure, phases = mast_with_guys(), [PRESTRESS, jc.Phase(loads=WIND)]
    jc.save_scene(tmp_path / "mast.json", (structure, phases))
    again = jc.load_scene(tmp_path / "mast.json")
    assert isinstance(again.phases[1].loads, PowerLawWind)
    one, other = jc.solve(structure, phases), jc.solve(*again)
    assert int(one.status) == 0
    np.testing.assert_array_equal(one.displacement, other.displacement)
    text = jc.report(structure, one, phases).text()
    assert "Global equilibrium" in text
    assert float(jc.energy_balance(structure, phases, one).dead[1]) > 1.0  # J


def test_what_it_cannot_blow_at_is_refused():
    nodes = [[-4.0, 0.0, 3.0], [0.0, 0.0, 0.0], [4.0, 0.0, 3.0]]
    rope = jc.Structure(nodes, jc.SlidingCables([[0, 1, 2]], 1e5), jc.pinned([0, 2]))
    with pytest.raises(ValueError, match="elements of two ends only"):
        jc.solve(rope, jc.Phase(loads=WIND))


@pytree(indices=("nodes",))
class Push(OnNodes):
    """Forces on nodes, whose numbers its class does not check."""

    nodes: object
    force: object

    def nodal_forces(self, shape, dtype):
        forces = np.zeros(shape, dtype)
        forces[self.nodes[:], :3] += self.force
        return forces


@pytree(indices=("where",))
class PushElsewhere(OnNodes):
    """The same, in a field of another name."""

    where: object
    force: object

    def nodal_forces(self, shape, dtype):
        return Push(self.where, self.force).nodal_forces(shape, dtype)


@pytest.mark.parametrize("varies", [False, True])
def test_a_node_number_that_does_not_exist_is_refused(varies):
    """The message names load, node and rule, or at least the load and what cannot be found."""
    for load, message in (
        (
            Push(Indices([2, 7]), 1.0),
            r"phases\[1\].loads\[0\]: Push: nodes\[1\] = 7: the structure",
        ),
        (PushElsewhere(Indices([7]), 1.0), r"loads: PushElsewhere.nodal_forces: index 7 is"),
    ):
        load = jc.Varying(load, [0.0, 1.0], [0.0, 1.0]) if varies else load
        with pytest.raises(ValueError, match=message):
            prepare(mast_with_guys(), [PRESTRESS, jc.Phase(loads=load)], None, None)
    task = prepare(mast_with_guys(), [jc.Phase(loads=Push(Indices([2, 6]), 1.0))], None, None)
    assert task.n_unknown == 6
