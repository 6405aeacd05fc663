"""Simplex, cable domes and cable trusses: prestress in closed form, stable, and under load."""

import functools

import jax
import numpy as np
import pytest
import scenes
from banks import problems
from oracles.convergence import converged

import jaxcable as jc
from jaxcable import forms

EPS = np.finfo(float).eps
SCENES = {
    "simplex": functools.partial(jc.scenes.simplex),
    "geiger": functools.partial(scenes.geiger_dome, sectors=6),
    "levy": functools.partial(scenes.levy_dome, sectors=6),
    "biconcave": functools.partial(scenes.cable_truss, panels=6),
}
COUNTS = {"simplex": (1, 1), "geiger": (1, 18), "levy": (7, 0), "biconcave": (1, 4)}
# one of each kind of scene; what else is new in the others is the geometry, which is tested
SOLVED = "simplex", "geiger"


@functools.cache
def scene(name):
    return SCENES[name]()


@functools.cache
def solved(name):
    """Solution of a scene; the state before loading comes from the same program, with no load."""
    structure, (prestress, loading) = scene(name)
    none = jc.replace(loading.loads, forces=0.0 * np.asarray(loading.loads.forces))
    found = []
    for loads in (loading.loads, none):
        found.append(jc.solve(structure, [prestress, jc.replace(loading, loads=loads)]))
        assert int(found[-1].status) == 0
    return found


def in_rows(structure, per_group):
    """Links and values of all elements, group after group, NumPy."""
    links = np.concatenate([group.links.array for group in structure.groups])
    parts = jax.tree.leaves(per_group)
    sizes = [len(group.links) for group in structure.groups]
    return links, np.concatenate([np.broadcast_to(p, n) for p, n in zip(parts, sizes, strict=True)])


def stiffnesses(structure):
    return in_rows(structure, [group.axial_stiffness for group in structure.groups])[1]


def stated_tension(structure, phase):
    """Links, and the tensions that a phase states, from lengths, [n_elem], N."""
    if phase.pretension is not None:
        return in_rows(structure, phase.pretension)
    links, density = in_rows(structure, phase.force_density)
    nodes = np.asarray(structure.nodes)
    return links, density * np.linalg.norm(nodes[links[:, 1]] - nodes[links[:, 0]], axis=1)


# --- the geometry that is given


@pytest.mark.parametrize("name", SCENES)
def test_counts_and_prestress(name):
    structure, phases = scene(name)
    found = forms.self_stress(structure)
    assert (found.s, found.m, len(found.rigid)) == (*COUNTS[name], 0)
    links, tension = stated_tension(structure, phases[0])
    free = ~structure.held_displacements()
    assert found.m - found.s == free.sum() - len(links)  # Maxwell's rule, after Calladine
    # a residual from lengths alone: some ten forces at a node, each with a rounding or two
    nodes = np.asarray(structure.nodes)
    length = np.linalg.norm(nodes[links[:, 1]] - nodes[links[:, 0]], axis=1)
    left, _ = problems.unbalanced(
        nodes, links, 1.0, length / (1 + tension), nodes, 0 * nodes, tension_only=False
    )
    assert np.abs(left[free]).max() < 1e-13 * np.abs(tension).max()
    cable = np.concatenate(jax.tree.leaves(found.tension_only))
    assert (tension[cable] > 0).all() and stiffnesses(structure).min() > np.abs(tension).max()
    assert found.stiffens(tension)
    if found.m:
        assert found.mechanism_stiffness(tension).min() > 0 > found.mechanism_stiffness(-tension)[0]


@pytest.mark.parametrize("sectors", [5, 8])
def test_counts_of_domes(sectors):
    for rings in (1, 2, 3):
        found = forms.self_stress(scenes.geiger_dome(sectors=sectors, rings=rings)[0])
        several = rings > 1
        assert found.s == (1 if several else sectors - 2)
        assert found.m == (6 + 2 * sectors * (rings - 1) if several else sectors + 3)
        found = forms.self_stress(scenes.levy_dome(sectors=sectors, rings=rings)[0])
        assert (found.s, found.m) == (2 * sectors - 5, 0)


@pytest.mark.parametrize("name", ["geiger", "levy"])
def test_symmetry_finds_the_groups_of_a_dome(name):
    structure, phases = scene(name)
    groups = forms.symmetric_groups(structure, 6, mirror=0.0)
    assert len(np.unique(np.concatenate(list(groups.values())))) == 4 * 2 + 3
    found = forms.feasible_prestress(structure, groups)
    assert found.n_mode == 1
    given = phases[0].pretension
    factor = np.asarray(found.tension["struts"])[0] / np.asarray(given["struts"])[0]
    for kind, tension in given.items():
        # two orders of unknowns, condition near 100
        ratio = np.asarray(found.tension[kind]) / np.asarray(tension)
        assert np.abs(ratio / factor - 1).max() < 1e-12


def test_the_force_densities_do_not_balance_a_wrong_twist():
    """Control: the check of `test_counts_and_prestress` sees one degree."""
    structure, phases = jc.scenes.simplex(twist=np.radians(29))
    tension = stated_tension(structure, phases[0])[1]
    assert forms.self_stress(structure).unbalanced(tension) > 1e-3


# --- analyses


@pytest.mark.parametrize("name", SOLVED)
def test_prestressed_and_loaded(name):
    structure, phases = scene(name)
    loaded, prestressed = solved(name)
    problems.assert_balanced(loaded)
    # the given geometry is the prestressed one, the stated tensions are the tensions
    size = np.ptp(np.asarray(structure.nodes), axis=0).max()
    assert np.abs(np.asarray(prestressed.displacement)).max() < 1e-12 * size
    links, tension = stated_tension(structure, phases[0])
    now = in_rows(structure, prestressed.tension)[1]
    assert np.abs(now - tension).max() < 1e-11 * np.abs(tension).max()
    # under load: equilibrium from unstressed lengths alone; no cable is slack
    ea, rest = stiffnesses(structure), in_rows(structure, loaded.rest_length)[1]
    left, force = problems.unbalanced(
        None, links, ea, rest, np.asarray(loaded.positions), np.asarray(loaded.load), False
    )
    # lengths subtracted: eps EA; the tolerance of Newton's method is 1e-10 of the forces
    least = 20 * EPS * ea.max() + 1e-9 * np.abs(force).max()
    assert np.abs(left[~structure.held_displacements()]).max() < least
    assert int(loaded.phases[1].path.n_slack[-1]) == 0
    assert float(np.asarray(loaded.displacement)[:, 2].min()) < -1e-3
    if name == "geiger":
        for kind, tension in loaded.tension.items():
            rows = np.asarray(tension)[1:] if kind == "struts" else np.asarray(tension)
            # equal in all sectors as far as Newton's method goes
            assert np.ptp(rows.reshape(-1, 6), axis=1).max() < 1e-7 * np.abs(rows).max(), kind


@pytest.mark.filterwarnings("ignore::jaxcable.UnstableWarning")  # it is what is tested
def test_a_geiger_dome_twists_under_too_much_load():
    """Stable below; beyond, the perfect dome is in unstable equilibrium, status OK notwithstanding.

    The lowest eigenvalue falls through zero between the loads, its mode is a turn of nodes about
    the axis alone, and a dome with a thousandth of its load around the axis leaves the symmetric
    shape for a stable one.
    """
    structure, (prestress, loading) = scene("geiger")
    plan = np.asarray(structure.nodes) * [1, 1, 0]
    around = np.cross([0, 0, 1], plan)
    radius = np.linalg.norm(around, axis=1, keepdims=True)
    force = np.asarray(loading.loads.forces)
    tops = loading.loads.nodes.array
    aside = 1e-3 * np.abs(force).max() * (around / np.maximum(radius, 1))[tops]
    found = {}
    for factor, wrong in ((1.0, 0.0), (2.0, 0.0), (2.0, 1.0)):
        load = jc.replace(loading.loads, forces=factor * force + wrong * aside)
        solution = converged(jc.solve(structure, [prestress, jc.replace(loading, loads=load)]))
        mode = jc.stiffness.modes(structure, solution, n=1)
        turn = np.abs((np.asarray(solution.displacement) * around).sum(1)).max()
        found[factor, wrong] = mode.stiffness[0], turn
        if not wrong:
            assert np.abs(mode.shapes[0][:, 2]).max() < 1e-6
            assert np.abs((mode.shapes[0] * plan).sum(1)).max() < 1e-6 * radius.max()
    assert found[1.0, 0.0][0] > 0 > found[2.0, 0.0][0]
    assert found[2.0, 1.0][0] > 0  # where it comes to rest it is stable
    assert found[2.0, 0.0][1] < 1e-3 < 1.0 < found[2.0, 1.0][1]
