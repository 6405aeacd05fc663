"""Which length has weight and takes loads: under heat, jacks and statements one after the other."""

import jax.numpy as jnp
import numpy as np
import pytest
from oracles.convergence import converged
from oracles.taylor import assert_gradient

import jaxcable as jc

NODES = np.array([[-4.0, 0.0, 3.0], [0.0, 0.0, 0.0], [5.0, 0.0, 3.5]])
LENGTH = np.linalg.norm(np.diff(NODES, axis=0), axis=1)


def two_cables(kind=jc.Cables, nodes=NODES, **more):
    values = {"axial_stiffness": 1e6, "weight": 20.0, "expansion": 1.2e-5, **more}
    return jc.Structure(nodes, kind([[0, 1], [1, 2]], **values), jc.pinned([0, 2]))


@pytest.mark.slow
@pytest.mark.parametrize("kind", [jc.Cables, jc.Catenaries])
def test_heat_keeps_weight_and_mass(kind):
    """200 K are 2.4e-3 of the length: far above the rounding that is granted."""
    structure = two_cables(kind, rest_length=1.01 * LENGTH)
    phases = [jc.Phase(loads=jc.SelfWeight()), jc.Phase(temperature=200.0)]
    solution = converged(jc.solve(structure, phases))
    np.testing.assert_allclose(solution.rest_length, 1.01 * LENGTH * (1 + 2.4e-3), rtol=1e-14)
    weight = 20.0 * 1.01 * LENGTH.sum()
    for phase in solution.phases:  # cold, warm
        np.testing.assert_allclose(-phase.load[:, 2].sum(), weight, rtol=1e-14)
        np.testing.assert_allclose(phase.reactions[:, 2].sum(), weight, rtol=1e-9)


@pytest.mark.slow
def test_heat_keeps_mass():
    structure = two_cables(nodes=NODES * [1.0, 1.0, 0.0])
    for change in (0.0, -200.0):
        phase = jc.Phase(pretension=900.0, temperature=change)
        solution = converged(jc.solve(structure, phase))
        found = jc.stiffness.natural_frequencies(structure, solution, distribution="lumped")
        stiffness = np.trace(jc.stiffness.tangent_of(structure, solution))
        # half of each cable swings with the node, by the length that 900 N left of its chord
        mass = 20.0 * 9.0 / (1 + 900.0 / 1e6) / 2 / 9.80665
        np.testing.assert_allclose(stiffness / np.sum(found.squared), mass, rtol=1e-12)


@pytest.mark.slow
def test_anchoring_a_jack_leaves_line_loads():
    """An empty phase after the jack moves nothing: the load is that of before."""
    structure = two_cables(weight=None)
    loads = jc.LineLoads((0.0, 0.0, -50.0))
    jack = jc.Phase(jacking=jc.only([1], 3e4))
    solution = jc.solve(structure, [jc.Phase(pretension=300.0, loads=loads), jack, jc.Phase()])
    assert solution.status == 0
    _, jacked, anchored = solution.phases
    assert np.abs(np.asarray(jacked.displacement)[1]).max() > 1e-2  # it pulls something in
    assert np.abs(np.asarray(anchored.displacement)).max() < 1e-9
    length = LENGTH / (1 + 300.0 / 1e6)  # that with which the jack began
    for phase in (jacked, anchored):
        np.testing.assert_allclose(-phase.load[:, 2].sum(), 50.0 * length.sum(), rtol=1e-13)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:phases.*supports")  # all nodes are held on purpose
def test_a_statement_counts_at_the_temperature_of_its_time():
    """Cooled, shortened, stated anew, warmed: forces between fixed ends in closed form."""
    EA, alpha = 1e6, 1.2e-5
    structure = jc.Structure(
        NODES[:2],
        jc.Cables([[0, 1]], axial_stiffness=EA, expansion=alpha, weight=20.0),
        jc.pinned([0, 1]),
    )
    phases = [
        jc.Phase(pretension=500.0, loads=jc.SelfWeight()),
        jc.Phase(temperature=-30.0),
        jc.Phase(shortening=2e-3),
        jc.Phase(pretension=800.0),  # takes the place of all that was before
        jc.Phase(temperature=50.0),
    ]
    solution = converged(jc.solve(structure, phases))
    forces = [float(phase.tension[0]) for phase in solution.phases]
    length = LENGTH[0]
    rest = [length / (1 + 500.0 / EA)]
    rest.append(rest[0] * (1 - 30.0 * alpha))
    rest.append(rest[1] - 2e-3)
    rest.append(length / (1 + 800.0 / EA))
    # as warm as it was when stated, by -30 K: 50 K more lengthen what it would be at 0 K
    rest.append(rest[3] * (1 + 20.0 * alpha) / (1 - 30.0 * alpha))
    # EA eps of lengths that are subtracted here
    np.testing.assert_allclose(forces, EA * (length / np.array(rest) - 1), atol=1e-9)
    warm = 1 + 20.0 * alpha
    cut = jc.report(structure, solution).tables["cutting_list"].rows[0][4]
    np.testing.assert_allclose(cut, rest[4] / warm, rtol=1e-14)
    weight = -float(solution.load[:, 2].sum())
    np.testing.assert_allclose(weight, 20.0 * rest[4] / warm, rtol=1e-14)


@pytest.mark.slow
def test_a_warm_catenary_takes_the_sag_that_is_stated():
    nodes = [[0.0, 0.0, 0.0], [60.0, 0.0, 10.0]]
    cable = jc.Catenaries([[0, 1]], axial_stiffness=1e7, weight=30.0, expansion=1.2e-5)
    structure = jc.Structure(nodes, cable, jc.pinned([0, 1]))
    phases = [jc.Phase(temperature=500.0), jc.Phase(sag=3.0, loads=jc.SelfWeight())]
    solution = converged(jc.solve(structure, phases))
    found = jc.forms.equivalent_prestress(structure, solution).sag
    np.testing.assert_allclose(found, 3.0, rtol=1e-12)  # 6e-3 of it if heat made weight


def plan_lengths(positions):
    """Lengths of the two cables in plan."""
    return np.linalg.norm(np.diff(np.asarray(positions)[:, :2], axis=0), axis=1)


def loaded(structure, pretension, geometry):
    loads = jc.LineLoads((0.0, 0.0, -40.0), per="projected", geometry=geometry)
    snow = jc.Phase(loads=loads, increments=2)
    return jc.solve(structure, [jc.Phase(pretension=pretension), snow, jc.Phase()])


@pytest.mark.slow
def test_loads_on_the_form_after_prestress():
    """Uneven prestress draws the node aside; snow lies on where it is then, and stays.

    The cables lie in one line: hung up, the prestress would lift them until both are unstressed.
    """
    line = NODES * [1.0, 1.0, 0.0]
    structure = two_cables(nodes=line, axial_stiffness=1e4, weight=None)
    pretension = np.array([900.0, 100.0])
    solution = converged(loaded(structure, pretension, "begun"))
    form = solution.phases[0].positions
    assert np.abs(plan_lengths(form) - plan_lengths(line)).max() > 0.1
    pieces = 40.0 * plan_lengths(form)
    expected = [pieces[0] / 2, pieces.sum() / 2, pieces[1] / 2]
    np.testing.assert_allclose(-solution.load[:, 2], expected, rtol=1e-13)
    alone = converged(jc.solve(structure, [jc.Phase()], start=solution))
    np.testing.assert_array_equal(alone.load, solution.load)
    drawn = loaded(structure, pretension, "input")
    np.testing.assert_allclose(-drawn.load[1, 2], 40.0 * plan_lengths(line).sum() / 2, rtol=1e-13)

    def sag(p):
        solution = loaded(structure, p, "begun")
        return solution.displacement[1, 2], solution.status

    assert_gradient(sag, pretension, 50.0)


def test_snow_on_the_area_after_prestress():
    """The plan area of the moved mesh, by the shoelace formula."""
    structure, _ = jc.scenes.flat_net()
    faces = [[3, 4, 8, 7]]  # the mesh between the free nodes
    uneven = jnp.linspace(100.0, 3000.0, len(structure.elements.links))
    snow = jc.AreaLoads(faces, (0.0, 0.0, -500.0), geometry="begun")
    phases = [jc.Phase(pretension=uneven), jc.Phase(loads=snow), jc.Phase()]
    solution = converged(jc.solve(structure, phases))
    areas = []
    for places in (structure.nodes, *(phase.positions for phase in solution.phases[:2])):
        x, y = np.asarray(places)[faces[0], :2].T
        areas.append(0.5 * abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)))
    assert abs(areas[2] / areas[1] - 1) > 1e-7  # which is not measured again
    assert abs(areas[1] / areas[0] - 1) > 1e-5  # ten million roundings
    np.testing.assert_allclose(-solution.load[:, 2].sum(), 500.0 * areas[1], rtol=1e-12)


@pytest.mark.parametrize(
    "make, message",
    [
        (lambda: jc.LineLoads((0, 0, -1.0), geometry="begun"), "unstressed lengths have no"),
        (lambda: jc.LineLoads((0, 0, -1.0), per="initial", geometry="now"), "geometry = 'now'"),
        (lambda: jc.AreaLoads([[0, 1, 2]], (0, 0, -1.0), geometry="now"), "geometry = 'now'"),
    ],
)
def test_refused_geometries(make, message):
    with pytest.raises(ValueError, match=message):
        make()
