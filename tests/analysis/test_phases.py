"""What a phase means: prestress inputs, jacking, supports, adding loads, continuing."""

import jax
import numpy as np
import pytest
from banks.problems import assert_balanced
from oracles.convergence import converged
from oracles.taylor import TIGHT

import jaxcable as jc

STRUCTURE, (PRESTRESS, LOADING) = jc.scenes.flat_net(load=75.0, increments=(2, 3))
EA = 97.97e3


def solved(structure, phases, **options):
    solution = converged(jc.solve(structure, phases, TIGHT, **options))
    assert_balanced(solution)
    return solution


def lengths(structure):
    nodes, links = np.asarray(structure.nodes), structure.elements.links.array
    return np.linalg.norm(nodes[links[:, 1]] - nodes[links[:, 0]], axis=1)


@pytest.fixture(scope="module")
def by_tension():
    return solved(STRUCTURE, [PRESTRESS, LOADING])


@pytest.mark.slow
def test_absolute_statement_in_a_later_phase_refers_to_the_initial_nodes(by_tension):
    """Prestress after loading ends where prestress before loading does."""
    late = solved(STRUCTURE, [LOADING, jc.Phase(pretension=200.0, increments=2)])
    assert np.abs(np.asarray(late.displacement - by_tension.displacement)).max() < 1e-13


@pytest.mark.slow_cases("<lambda>0")
@pytest.mark.parametrize(
    "tree", [lambda *parts: dict(zip("ab", parts, strict=True)), lambda *parts: [*parts]]
)
def test_a_statement_is_a_prefix_of_the_tree_of_groups(tree):
    """A number for all, one for a group or for each element, of a dictionary or of a list."""
    links, tension = STRUCTURE.elements.links, np.linspace(100, 200, 6)
    groups = jc.Cables(links[:6], axial_stiffness=EA), jc.Bars(links[6:], axial_stiffness=EA)
    structure = jc.Structure(STRUCTURE.nodes, tree(*groups), STRUCTURE.supports)
    for stated in (tension, [*tension], 120.0):
        solution = solved(structure, [jc.Phase(pretension=tree(stated, 150.0))])
        assert jax.tree.structure(solution.tension) == jax.tree.structure(tree(0, 0))
        found = jax.tree.leaves(solution.rest_length)
        for rest, force in zip(found, (np.array(stated), 150.0), strict=True):
            assert np.allclose(rest, 0.4 / (1 + force / EA), rtol=1e-14)
    some = solved(structure, [jc.Phase(pretension=tree(100.0, None))])
    assert np.allclose(jax.tree.leaves(some.rest_length)[1], 0.4, rtol=1e-14)
    assert jax.tree.leaves(some.phases[0].path.tension)[1].shape == (1, 6)


def test_one_number_for_each_element_of_the_only_group():
    tension = np.full(12, 200.0)
    assert np.allclose(solved(STRUCTURE, [jc.Phase(pretension=[*tension])]).tension, tension)


# --- jacking


@pytest.mark.parametrize("weight", [None, 50.0])
def test_anchoring_a_jacked_net_does_not_move_it(weight):
    """From then on the weight is that of the cut lengths."""
    nodes = np.asarray(STRUCTURE.nodes) + 0.05 * np.eye(12, 3, k=-3)
    structure = jc.replace(STRUCTURE, nodes=nodes)
    load = jc.NodalLoads([3], (0.0, 0.0, -100.0))
    if weight is not None:
        elements = jc.replace(STRUCTURE.elements, weight=weight)
        structure, load = jc.replace(structure, elements=elements), jc.SelfWeight()
    jacked = jc.Phase(jacking=200.0, loads=load, increments=2)
    solution = solved(structure, [jacked, jc.Phase(), jc.Phase()])
    first, second, third = solution.phases
    assert float(first.displacement[3, 2]) < -0.01
    assert np.abs(np.asarray(third.displacement_in_phase)).max() == 0.0
    moved = np.abs(np.asarray(second.displacement_in_phase)).max()
    if weight is None:
        assert moved == 0.0 and int(second.path.iterations[0]) == 0
        assert np.allclose(solution.tension, 200.0, rtol=1e-13)
        return
    np.testing.assert_allclose(first.load[:, 2].sum(), -weight * lengths(structure).sum())
    expected = -weight * np.asarray(second.rest_length).sum()
    np.testing.assert_allclose(second.load[:, 2].sum(), expected, rtol=1e-12)
    # each load changes as its cable's length, by 1 % at most; so does what it moves, or less
    change = np.abs(1 - np.asarray(second.rest_length) / lengths(structure)).max()
    assert 0 < moved < change * np.abs(np.asarray(first.displacement)).max()


def test_jack_as_a_load_is_anchored_where_it_is():
    """A released end pulled by a force; anchored, it stays and its reaction is the jack's force."""
    nodes = np.array([[0.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0], [1.0, 1, 0], [1.0, -1, 0]])
    cable = jc.Cables([[0, 1], [1, 2], [1, 3], [1, 4]], axial_stiffness=1e4)
    sliding = np.ones((5, 3), bool)
    sliding[1] = False
    sliding[2, 0] = False  # the jack's end, guided along the cable
    structure = jc.Structure(nodes, cable, jc.Supports(sliding))
    prestress = jc.Phase(pretension=np.array([0.0, 0.0, 50.0, 50.0]))
    jack = jc.Phase(loads=jc.NodalLoads([2], (30.0, 0, 0)), increments=4)
    anchored = jc.Phase(supports=jc.pinned([0, 2, 3, 4]))
    solution = solved(structure, [prestress, jack, anchored])
    assert np.abs(np.asarray(solution.phases[2].displacement_in_phase)).max() == 0.0
    assert float(solution.phases[1].displacement_in_phase[2, 0]) > 1e-3
    assert float(solution.reactions[2, 0]) == pytest.approx(30.0, rel=1e-12)
    assert float(np.abs(np.asarray(solution.load)).max()) == 0.0  # the jack does not also pull


def test_held_force_ramps_from_what_was_there():
    solution = solved(STRUCTURE, [PRESTRESS, jc.Phase(jacking=400.0, increments=4)])
    path = solution.phases[1].path.tension
    assert np.allclose(path[:, 0], [250, 300, 350, 400], rtol=1e-12)


# --- supports


def test_released_freedoms_start_with_their_reaction_and_end_free(by_tension):
    """Held up by a temporary prop, then released in increments: as if never propped."""
    mask = np.asarray(STRUCTURE.fixed(STRUCTURE.supports)).copy()
    mask[3, 2] = True
    propped = jc.replace(STRUCTURE, supports=jc.Supports(mask))
    release = jc.Phase(supports=STRUCTURE.supports, increments=4)
    solution = solved(propped, [PRESTRESS, LOADING, release])
    assert float(np.abs(np.asarray(solution.phases[1].displacement_in_phase[3, 2]))) == 0.0
    assert np.abs(np.asarray(solution.displacement - by_tension.displacement)).max() < 1e-12
    # ramped: the first quarter of the release moves the prop by less than the whole
    down = np.asarray(solution.phases[2].path.displacement_in_phase[:, 3, 2])
    assert (np.diff(down) < 0).all() and 0.1 < down[0] / down[-1] < 0.5


def test_fixed_freedoms_are_held_where_they_are():
    mask = np.asarray(STRUCTURE.fixed(STRUCTURE.supports)).copy()
    mask[3] = True
    solution = solved(
        STRUCTURE, [PRESTRESS, LOADING, jc.Phase(supports=jc.Supports(mask)), LOADING]
    )
    before = solution.phases[1].positions[3]
    assert np.array_equal(solution.positions[3], before)
    # the first load on node 3 left the load vector, that of the last phase goes into the support
    assert float(solution.load[3, 2]) == -75.0 and float(solution.load[4, 2]) == -150.0


def test_path_reports_each_increment(by_tension):
    """Each row of the path is the solution of the analysis that ends there."""
    path = by_tension.phases[1].path
    assert np.allclose(path.load_factor, [1 / 3, 2 / 3, 1])
    assert path.displacement.shape == (3, 12, 3) and path.tension.shape == (3, 12)
    assert np.array_equal(path.displacement[-1], by_tension.displacement)
    assert np.allclose(path.tension[-1], by_tension.tension, rtol=1e-14)  # other fusion
    assert (path.relative_residual <= 1e-13).all() and (path.status == 0).all()
    assert path.equilibrated.all()
    third = jc.Phase(loads=jc.NodalLoads([3, 4, 7, 8], (0, 0, -25.0)), increments=3)
    part = solved(STRUCTURE, [PRESTRESS, third])
    assert np.abs(np.asarray(path.displacement[0] - part.displacement)).max() < 1e-13


def test_incremental_needs_no_more_than_its_corrections(by_tension):
    """A phase of 2 increments, and one of 20."""
    solution = converged(
        jc.solve(*jc.scenes.flat_net(load=75.0, increments=(2, 20)), jc.Incremental(2))
    )
    path = solution.phases[1].path
    assert (path.iterations == 3).all() and not path.equilibrated.any()
    assert all(bool(phase.stable) for phase in solution.phases)
    assert np.abs(np.asarray(solution.displacement - by_tension.displacement)).max() < 1e-9


def test_a_phase_shorter_than_others_is_judged_where_it_ends():
    """A strut of h = 1 m that a bar of k = 1 kN/m holds: unstable above k h = 1 kN."""
    groups = {
        "strut": jc.Bars([[0, 1]], axial_stiffness=1e8),
        "side": jc.Bars([[1, 2]], axial_stiffness=1e3),
    }
    supports = jc.pinned([0, 2]) + jc.restrained([1], "y")
    structure = jc.Structure([[0, 0, 0], [0, 0, 1.0], [1.0, 0, 1.0]], groups, supports)
    loads = [jc.NodalLoads([1], (0.0, 0.0, force)) for force in (-500.0, -700.0, 700.0)]
    stages = [jc.Phase(loads=load, increments=n) for load, n in zip(loads, (1, 1, 3), strict=True)]
    with pytest.warns(jc.UnstableWarning, match=r"phases\[1\]\) ends in an unstable equilibrium"):
        solution = jc.solve(structure, stages, jc.Incremental(2))
    assert int(solution.status) == 0
    assert [bool(phase.stable) for phase in solution.phases] == [True, False, True]
