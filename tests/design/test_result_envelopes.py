"""Envelopes over all results of load cases against analyses one by one, and NumPy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles.taylor import TIGHT, assert_gradient
from oracles.traced import traced

import jaxcable as jc
from jaxcable.common import status

TUBE = jc.Section.ring(0.2, 0.01, jc.Elastic(210e9))
AROUND = np.radians([0.0, 120.0, 240.0])
NODES = [[0.0, 0, 0], [0, 0, 8.0], [0, 0, 16.0]]
NODES += [[10 * np.cos(a), 10 * np.sin(a), 0.0] for a in AROUND]
CALM = jc.Phase(sag={"guys": 0.1}, loads=jc.SelfWeight())


def mast():
    """Two beams on a hinge, held by three guys."""
    elements = {
        "mast": jc.Beams([[0, 1], [1, 2]], TUBE, weight=400.0),
        "guys": jc.Catenaries([[k, 2] for k in (3, 4, 5)], axial_stiffness=10e6, weight=8.0),
    }
    return jc.Structure(NODES, elements, jc.restrained([0], "xyz", "z") + jc.pinned([3, 4, 5]))


def blow(direction, wind):
    along = wind * jnp.array([jnp.cos(direction), jnp.sin(direction), 0.0])
    return jc.Phase(loads=[jc.LineLoads(along, on="mast"), jc.NodalLoads([2], 3.0 * along)])


DIRECTIONS = 0.1 + 0.9 * np.arange(6)  # no symmetry: one case governs
NAMES = [f"wind {k}" for k in range(6)]


@pytest.fixture(scope="module")
def found():
    """Six directions, of which the wind of the fourth is unknown."""
    wind = jnp.where(jnp.arange(6) == 3, jnp.nan, 200.0)
    cases = jax.vmap(blow)(DIRECTIONS, wind)
    solutions = jc.design.solve_cases(mast(), CALM, cases)
    height = {"height": lambda solution: solution.positions[2, 2]}
    return jc.design.envelope(mast(), solutions, NAMES, also=height, places=5), solutions


@pytest.fixture(scope="module")
def alone():
    """The other five, one by one."""
    structure, each = mast(), {}
    calm = jc.solve(structure, CALM)
    for k in (0, 1, 2, 4, 5):
        each[k] = jc.solve(structure, [blow(DIRECTIONS[k], 200.0)], start=calm)
        assert int(each[k].status) == 0
    return each


def results(solution):
    """What the envelope should know of one case, by the public calls."""
    structure = mast()
    forces = jc.section_forces(structure, solution, places=5)["mast"]
    return {
        "tension": solution.peak_tension["guys"],
        "displacement": solution.displacement,
        "rotation": jc.results.rotation_vectors(structure, solution),
        "reactions": solution.reactions,
        "reaction_moments": solution.reaction_moments,
        **dict(zip(("N", "Vy", "Vz", "T", "My", "Mz"), np.moveaxis(forces, 2, 0), strict=True)),
        "sag": jc.results.sags(structure, solution)["guys"].midspan,
        "stress": jc.fibre_stress(structure, solution.phases[-1])["mast"][-1],
        "height": solution.positions[2, 2],
    }


def test_extremes_of_all_results_against_analyses_one_by_one(found, alone):
    """Rounding only: 1e-8 of the largest value of a result, the tolerance of two iterations.

    The case that has failed is named, and is in no extreme.
    """
    envelope, solutions = found
    assert np.asarray(solutions.status).tolist() == [0, 0, 0, status.NONFINITE, 0, 0]
    assert envelope.failed == {"wind 3": status.NONFINITE}
    each = {k: results(solution) for k, solution in alone.items()}
    assert set(envelope.high) == set(each[0])
    group = {"tension": "guys", "sag": "guys", "stress": "mast"}
    group |= dict.fromkeys(("N", "Vy", "Vz", "T", "My", "Mz"), "mast")
    for name in each[0]:
        values = np.array([np.asarray(one[name]) for one in each.values()])
        scale = 1e-8 * np.abs(values).max() + 1e-12
        for side, extreme in (("low", values.min(axis=0)), ("high", values.max(axis=0))):
            own = getattr(envelope, side)[name]
            own = own[group[name]] if name in group else own
            np.testing.assert_allclose(own, extreme, atol=scale, err_msg=f"{name} {side}")
        which = envelope.governing(name)
        which = np.array(which[group[name]] if name in group else which, object)
        clear = np.ptp(np.sort(values, axis=0)[-2:], axis=0) > 10 * scale  # one case governs
        expected = np.array([f"wind {k}" for k in each], object)[values.argmax(axis=0)]
        assert ((which == expected) | ~clear).all(), name
        assert clear.any() == (name not in ("T", "reaction_moments")), name  # zero: by symmetry


def test_concomitant_values_are_those_of_the_governing_case(found, alone):
    envelope, _ = found
    beside = envelope.concomitant("My", "N", "low")["mast"]
    forces = {k: jc.section_forces(mast(), one, places=5)["mast"] for k, one in alone.items()}
    for at in np.ndindex(beside.shape):
        moments = {k: float(own[*at, 4]) for k, own in forces.items()}
        if np.ptp(sorted(moments.values())[:2]) > 1e-3:  # N m: one case governs
            k = min(moments, key=moments.get)
            assert float(beside[at]) == pytest.approx(float(forces[k][*at, 0]), rel=1e-7)
    with pytest.raises(ValueError, match="other = 'reactions': has another shape than 'My'"):
        envelope.concomitant("My", "reactions")
    with pytest.raises(ValueError, match="result = 'Mx': is no result"):
        envelope.governing("Mx")


@pytest.mark.slow
def test_derivative_of_an_extreme_is_that_of_its_case():
    """By the forces; a case that has failed has no part in it."""
    nodes = [[0.0, 0, 0], [4, 0, 0], [1, 3, 0], [1.5, 1, -2]]
    ropes = jc.Cables([[0, 3], [1, 3], [2, 3]], axial_stiffness=1e5, weight=5.0)
    structure = jc.Structure(nodes, ropes, jc.pinned([0, 1, 2]))

    def largest(force):
        push = force[:, None] * jnp.array([[0.0, 0, -1], [0.3, 0, -1], [0, 0.3, -0.9]])
        cases = jax.vmap(lambda f: jc.Phase(loads=jc.NodalLoads([3], f)))(push)
        solutions = jc.design.solve_cases(structure, jc.Phase(loads=jc.SelfWeight()), cases, TIGHT)
        return jc.design.envelope(structure, solutions).high["tension"].max()

    largest, force = traced(largest), np.array([300.0, 310.0, 320.0])
    gradient = assert_gradient(largest, force, 100.0, corrupted=1.05)
    assert np.count_nonzero(gradient) == 1
    governing = int(np.flatnonzero(gradient)[0])
    broken = jnp.array(force).at[governing - 1].set(jnp.nan)
    assert float(largest(broken)) == pytest.approx(float(largest(force)), rel=1e-12)
    np.testing.assert_allclose(jax.grad(largest)(broken), gradient, rtol=1e-9)
    every = jnp.full(3, jnp.nan)
    assert np.isnan(largest(every)) and np.isnan(jax.grad(largest)(every)).any()
