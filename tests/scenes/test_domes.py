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
    "biconvex": functools.partial(scenes.cable_truss, "biconvex", panels=6),
    "three rings": functools.partial(
        scenes.geiger_dome, sectors=7, rings=3, struts=(5.0, 6.0, 6.5, 7.0), pretension=400e3
    ),
}
COUNTS = {"simplex": (1, 1), "geiger": (1, 18), "levy": (7, 0), "biconcave": (1, 4)}
COUNTS |= {"biconvex": (1, 4), "three rings": (1, 34)}
# one of each kind of scene; what else is new in the others is the geometry, which is tested
SOLVED = "simplex", "geiger", "biconcave"


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


def stiffness(structure, solution):
    """Tangent stiffness of all freedoms, [3 n, 3 n], element by element, NumPy.

    ``EA/L0 n n' + N/l (I - n n')``, of slack elements none.
    """
    positions = np.asarray(solution.positions)
    links, rest = in_rows(structure, solution.rest_length)
    numbers = stiffnesses(structure), rest, in_rows(structure, solution.tension)[1]
    matrix = np.zeros((3 * len(positions),) * 2)
    for (i, j), stiff, length, force in zip(links, *numbers, strict=True):
        chord = positions[j] - positions[i]
        now = np.linalg.norm(chord)
        along = np.outer(chord, chord) / now**2
        block = stiff / length * along + force / now * (np.eye(3) - along)
        at = np.r_[3 * i : 3 * i + 3, 3 * j : 3 * j + 3]
        matrix[np.ix_(at, at)] += np.block([[block, -block], [-block, block]])
    return matrix


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


def test_the_force_that_is_asked_for_and_the_load():
    """The outermost hoop; the horizontal force of the bearing cable; loads per area and length."""
    for name, hoop in (("geiger", 500e3), ("levy", 500e3), ("three rings", 400e3)):
        structure, (prestress, loading) = scene(name)
        sectors = 7 if hoop == 400e3 else 6
        outer = np.asarray(prestress.pretension["hoops"])[-sectors:]
        np.testing.assert_allclose(outer, hoop, rtol=1e-12)
        force = np.asarray(loading.loads.forces)[:, 2]
        # rings of roof between the middles of the rings of nodes, up to the last of these
        rings = 3 if hoop == 400e3 else 2
        radius = 30.0 * (rings + 0.5) / (rings + 1)
        assert force.sum() == pytest.approx(-300.0 * np.pi * radius**2, rel=1e-12)
        assert np.ptp(force[-sectors:]) < 1e-9 * -force.sum()
    for name in ("biconcave", "biconvex"):
        structure, (prestress, loading) = scene(name)
        density = prestress.force_density["bearing"]
        np.testing.assert_allclose(density, 300e3 / (40.0 / 6), rtol=1e-14)
        force = np.asarray(loading.loads.forces)[:, 2]
        np.testing.assert_allclose(force, -3e3 * 40.0 / 6, rtol=1e-14)
        # the upper cable bears the load
        assert (np.asarray(structure.nodes)[loading.loads.nodes.array, 2] > 0).all()


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


@pytest.mark.parametrize("name", SOLVED)
def test_tangent_and_its_lowest_eigenvalue(name):
    structure, _ = scene(name)
    free = ~structure.held_displacements().ravel()
    for solution in solved(name):
        own = stiffness(structure, solution)
        matrix = np.asarray(jc.stiffness.tangent_of(structure, solution))
        # the geometric part is an N / l beside EA / L0: relative to the largest entry, rounding
        assert np.abs(matrix - own[np.ix_(free, free)]).max() < 1e-12 * np.abs(own).max()
        lowest = np.linalg.eigvalsh(own[np.ix_(free, free)])[0]
        assert lowest > 0
        found = jc.stiffness.modes(structure, solution, n=1).stiffness[0]
        assert found == pytest.approx(lowest, abs=1e-11 * np.abs(own).max())


def test_free_standing_simplex():
    """Six rigid motions, then stiffness: with prestress everywhere, without it not in the screw."""
    structure, phases = scene("simplex")
    _, prestressed = solved("simplex")
    # the same program with no force densities and no load
    none = jax.tree.map(lambda q: 0.0 * q, phases[0].force_density)
    load = jc.replace(phases[1].loads, forces=np.zeros(3))
    bare_phases = [jc.replace(phases[0], force_density=none), jc.replace(phases[1], loads=load)]
    with pytest.warns(jc.UnstableWarning, match="of zero where a part turns or moves freely"):
        bare = jc.solve(structure, bare_phases)
    assert int(bare.status) == 0 and bool(prestressed.stable) and not bool(bare.stable)
    found = []
    for solution in (prestressed, bare):
        own = stiffness(structure, solution)
        matrix = np.asarray(
            jc.stiffness.tangent_of(structure, solution, fixed=np.zeros((6, 3)) > 0)
        )
        size = np.abs(matrix).max()
        assert matrix.shape == (18, 18) and np.abs(matrix - own).max() < 1e-13 * size
        for values in (np.linalg.eigvalsh(own), np.linalg.eigvalsh(matrix)):
            assert np.abs(values[:6]).max() < 1e-13 * size  # 18 roundings of the largest entry
            assert values[7] > 1e-3 * size
        found.append(values[6] / size)
    assert found[0] > 1e-5 and abs(found[1]) < 1e-13  # control: the seventh is prestress alone
    # and that is what the product forces say: the form of a mechanism without rigid motion is its
    # Rayleigh quotient, above the eigenvalue; q l / EA is 1e-3
    mechanism = forms.self_stress(structure).mechanisms[0].ravel()
    rigid = rigid_motions(np.asarray(structure.nodes))
    mechanism = mechanism - rigid.T @ (rigid @ mechanism)
    links, density = in_rows(structure, phases[0].force_density)
    apart = np.diff(mechanism.reshape(6, 3)[links], axis=1)[:, 0] / np.linalg.norm(mechanism)
    upper = (density * (apart**2).sum(1)).sum() / size
    assert 0.99 * upper < found[0] < (1 + 1e-9) * upper


def rigid_motions(nodes):
    """Orthonormal rigid motions of points, [6, 3 n_node]: moves, and turns about their middle."""
    arms = nodes - nodes.mean(0)
    spins = [np.cross(axis, arms).ravel() for axis in np.eye(3)]
    moves = [np.tile(axis, len(nodes)) for axis in np.eye(3)]
    return np.linalg.qr(np.array(moves + spins).T)[0].T


def test_half_and_full_load_of_a_cable_truss():
    """Half the load gives S-shapes: more deflection than all of it, one half up."""
    full, _ = solved("biconcave")
    half = converged(jc.solve(*scenes.cable_truss(panels=6, loaded="half")))
    assert float(half.load[:, 2].sum()) == pytest.approx(-3e3 * 20.0 * (1 - 1 / 6), rel=1e-13)
    assert float(full.load[:, 2].sum()) == pytest.approx(-3e3 * 40.0 * (1 - 1 / 6), rel=1e-13)
    down, sunk = (np.asarray(of.displacement)[:7] for of in (half, full))
    assert down[1:4, 2].max() < 0 < down[5, 2]
    assert np.abs(down[:, 2]).max() > np.abs(sunk).max()
    # under full load the truss stays symmetric: mirrored nodes sink alike
    assert np.abs(sunk[:, 2] - sunk[::-1, 2]).max() < 1e-9 * np.abs(sunk[:, 2]).max()


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
