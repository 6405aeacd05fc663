"""Self-stress and mechanisms: closed forms, counts, and a simplex with the wrong twist."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles.taylor import assert_gradient
from oracles.traced import traced
from scipy.optimize import brentq

import jaxcable as jc
from jaxcable import forms
from jaxcable.scenes import simplex

EPS = np.finfo(float).eps


def force_at_nodes(nodes, links, density):
    """Sum of what members pull, from positions and force densities alone, [n_node, 3], N."""
    out = np.zeros_like(nodes)
    for (i, j), q in zip(links, density, strict=True):
        out[i] += q * (nodes[j] - nodes[i])
        out[j] += q * (nodes[i] - nodes[j])
    return out


def all_links(structure):
    return np.concatenate([group.links.array for group in structure.groups])


def star(directions, group=jc.Bars):
    """One free node, in the middle of members to the given points."""
    points = np.asarray(directions, float)
    links = [(0, k) for k in range(1, len(points) + 1)]
    nodes = np.vstack([np.zeros((1, 3)), points])
    return jc.Structure(nodes, group(links, axial_stiffness=1e6), jc.pinned(range(1, len(nodes))))


# --- ranks and kinds


@pytest.mark.parametrize(
    ("directions", "kind", "s", "m"),
    [
        ([(1, 0, -1), (-1, 1, -1), (-1, -1, -1)], "I", 0, 0),
        ([(1, 0, -1), (-1, 1, -1), (-1, -1, -1), (0, 0, 1)], "III", 1, 0),
        ([(1, 0, 0), (-2, 0, 0)], "IV", 1, 2),
    ],
)
def test_kinds_of_one_node(directions, kind, s, m):
    found = forms.self_stress(star(directions))
    assert (found.kind, found.s, found.m) == (kind, s, m)
    assert found.describe().startswith(f"kind {kind}: ")
    assert found.m - found.s == 3 - len(directions)  # Maxwell's rule, after Calladine
    # rounding below, O(1) above: the decision is clear
    above, below = found.rank_gap
    assert above > 0.1 and below < 10 * EPS


def test_a_hanging_chain_is_of_kind_two():
    nodes = [(0, 0, 0), (1, 0, -1), (2, 0, -1), (3, 0, 0)]
    mask = np.zeros((4, 3), bool)
    mask[[0, 3]] = mask[:, 1] = True
    links = [(0, 1), (1, 2), (2, 3)]
    chain = jc.Structure(
        np.array(nodes, float), jc.Cables(links, axial_stiffness=1.0), jc.Supports(mask)
    )
    found = forms.self_stress(chain)
    assert (found.kind, found.s, found.m, len(found.rigid)) == ("II", 0, 1, 0)
    # free across its plane, it swings about the line through its supports, and wriggles
    found = forms.self_stress(jc.replace(chain, supports=jc.pinned([0, 3])))
    assert (found.kind, found.s, found.m, len(found.rigid)) == ("II", 0, 2, 1)


def test_two_links_in_line():
    """Mechanisms of a stretched string: 2 T / a a unit displacement; compression undoes them."""
    a, tension = 2.0, 300.0
    found = forms.self_stress(star([(a, 0, 0), (-a, 0, 0)]))
    stiffness = found.mechanism_stiffness([tension, tension])
    assert np.abs(stiffness - 2 * tension / a).max() < 10 * EPS * tension
    assert found.stiffens([tension, tension]) and not found.stiffens([-tension, -tension])
    assert not found.stiffens([0.0, 0.0])
    assert found.unbalanced([tension, tension]) == 0.0
    # 300 N against 100 N, over the larger one
    assert found.unbalanced([300.0, 100.0]) == pytest.approx(2 / 3, rel=1e-14)
    nodes = [[x, y, 0.0] for y in (0.0, 1.0) for x in (-a, 0.0, a)]
    strings = jc.Cables([[0, 1], [1, 2], [3, 4], [4, 5]], axial_stiffness=1e6)
    pair = forms.self_stress(jc.Structure(nodes, strings, jc.pinned([0, 2, 3, 5])))
    assert pair.stiffens([tension] * 4) and not pair.stiffens([tension, tension, 0.0, 0.0])


@pytest.mark.parametrize("seed", [0, 2, 4])
def test_random_structures(seed):
    """Every state balances, no mechanism elongates, and the counts follow Maxwell's rule."""
    rng = np.random.default_rng(seed)
    nodes = rng.normal(size=(9, 3))
    pairs = np.array([(i, j) for i in range(9) for j in range(i + 1, 9)])
    chain = (pairs[:, 1] - pairs[:, 0]) == 1  # that every node is touched
    more = ~chain & (rng.random(len(pairs)) < 0.15 + 0.1 * seed)
    links = pairs[chain | more]
    mask = np.zeros((9, 3), bool)
    mask[0], mask[1, :2], mask[8, 2] = True, True, True
    structure = jc.Structure(nodes, jc.Bars(links, axial_stiffness=1.0), jc.Supports(mask))
    found = forms.self_stress(structure)
    assert found.m + len(found.rigid) - found.s == (~mask).sum() - len(links)
    for density in found.force_densities:
        left = force_at_nodes(nodes, links, density)[~mask]
        assert np.abs(left).max() < 100 * EPS * np.abs(density).max() * 4
    along = nodes[links[:, 1]] - nodes[links[:, 0]]
    for shape in found.mechanisms:
        apart = np.sum(along * (shape[links[:, 1]] - shape[links[:, 0]]), axis=1)
        assert np.abs(apart).max() < 100 * EPS and (shape[mask] == 0).all()
    flat = found.mechanisms.reshape(found.m, 27)
    # an SVD's vectors are orthonormal to rounding
    assert np.abs(flat @ flat.T - np.eye(found.m)).max(initial=0.0) < 100 * EPS


# --- the simplex


@pytest.mark.parametrize(("radius", "height"), [(0.7, 3.0), (5.0, 2.0)])
def test_simplex(radius, height):
    structure, phases = simplex(radius, height)
    nodes, links = np.asarray(structure.nodes), all_links(structure)
    found = forms.self_stress(structure)
    assert (found.s, found.m, len(found.rigid), found.kind) == (1, 1, 0, "IV")
    density = {kind: own[0] for kind, own in found.force_densities.items()}
    unit = density["verticals"][0]
    # an SVD of a matrix of condition 10 gives 1e-15; 1e-12 leaves room for other LAPACKs
    for name, expected in (("triangles", 1 / np.sqrt(3)), ("verticals", 1.0), ("struts", -1.0)):
        assert np.abs(density[name] / unit - expected).max() < 1e-12, name
    # what the scene states is that, and balances every node, with no help from the supports
    stated = phases[0].force_density
    order = [k for k in ("struts", "triangles", "verticals") for _ in structure.elements[k].links]
    row = np.array([stated[k] for k in order])
    assert np.abs(force_at_nodes(nodes, links, row)).max() < 50 * EPS * np.abs(row).max() * height
    # the mechanism is a screw: the lower triangle stays, the upper one turns and moves up or down
    shape, third = found.mechanisms[0], 2 * np.pi / 3
    turn = np.array(
        [[np.cos(third), -np.sin(third), 0], [np.sin(third), np.cos(third), 0], [0, 0, 1]]
    )
    assert np.abs(shape[:3]).max() < 1e-12 < 0.1 < np.abs(shape[3:]).max()
    assert np.abs(shape[[4, 5, 3]] - shape[3:] @ turn.T).max() < 1e-12
    tension = {
        k: stated[k] * np.linalg.norm(nodes[g.links.array[0, 1]] - nodes[g.links.array[0, 0]])
        for k, g in structure.elements.items()
    }
    assert found.stiffens(tension)
    assert not found.stiffens(jax.tree.map(lambda t: -t, tension))


def test_only_a_twist_of_30_degrees_has_a_self_stress():
    def determinant(twist):
        return np.linalg.det(forms.self_stress(simplex(twist=twist)[0]).matrix)

    root = brentq(determinant, np.radians(20), np.radians(45), xtol=1e-14)
    assert abs(root - np.pi / 6) < 1e-12  # a simple root of a function with rounding 1e-16
    wrong, _ = simplex(twist=np.radians(29))
    found = forms.self_stress(wrong)
    assert (found.s, found.m, found.kind) == (0, 0, "I")
    with pytest.raises(ValueError, match="groups: no state of self-stress has equal tensions"):
        forms.feasible_prestress(wrong, forms.symmetric_groups(wrong, 3))
    # coordinates known to a tenth of a millimetre need a tolerance, and get one
    noise = 1e-4 * np.random.default_rng(0).normal(size=(6, 3))
    rough = jc.replace(wrong, nodes=simplex()[0].nodes + noise)
    assert forms.self_stress(rough).s == 0 and forms.self_stress(rough, tol=1e-3).s == 1


def test_rigid_motions_are_told_from_mechanisms():
    structure, _ = simplex()
    for held, left in (([(0, 0)], 5), ([(0, 0), (0, 1), (0, 2)], 3), ([(0, 2), (1, 2), (2, 2)], 3)):
        mask = np.zeros((6, 3), bool)
        mask[tuple(np.transpose(held))] = True
        found = forms.self_stress(jc.replace(structure, supports=jc.Supports(mask)))
        assert (found.s, found.m, len(found.rigid)) == (1, 1, left)
        overlap = found.rigid.reshape(left, -1) @ found.mechanisms[0].ravel()
        assert np.abs(overlap).max() < 100 * EPS
        assert found.stiffens(forms.feasible_prestress(structure, group=0, tension=-1.0).tension)


# --- feasible prestress


def test_prestress_of_a_simplex():
    structure, _ = simplex()
    groups = forms.symmetric_groups(structure, 3)
    found = forms.feasible_prestress(structure, groups, tension=500.0)
    assert found.n_mode == 1 and float(found.unbalanced) < 20 * EPS
    assert float(found.tension["struts"][0]) == pytest.approx(-500.0, rel=1e-14)
    # the same from a given group, from groups in a row, and without any groups
    vertical, strut = int(groups["verticals"][0]), int(groups["struts"][0])
    given = float(found.tension["verticals"][0])
    row = np.concatenate([groups[k] for k in ("struts", "triangles", "verticals")])
    for other in (
        forms.feasible_prestress(structure, groups, group=vertical, tension=given),
        forms.feasible_prestress(structure, row, group=strut, tension=-500.0),
        forms.feasible_prestress(structure, tension=500.0),
    ):
        for a, b in zip(
            jax.tree.leaves(other.tension), jax.tree.leaves(found.tension), strict=True
        ):
            assert np.abs(np.asarray(a) - np.asarray(b)).max() < 1e-12 * 500


def test_the_best_of_several_states():
    """Four straight cables, each with a tension of its own: the evenest is all alike."""
    structure, _ = jc.scenes.flat_net()
    assert forms.self_stress(structure).s == 4
    found = forms.feasible_prestress(structure, tension=200.0)
    assert found.n_mode == 4
    assert np.abs(np.asarray(found.tension) - 200.0).max() < 1e-9 * 200  # the LP's own tolerance
    assert float(found.unbalanced) < 1e-9
    part = forms.feasible_prestress(structure, group=3, tension=50.0)
    assert np.abs(np.asarray(part.tension) - 50.0).max() < 1e-9 * 50


ASIDE = [(1, 0, 1), (-1, 1, 1), (-1, -1, 1), (0.3, 0.2, 1), (0.5, -1, 2)]


@pytest.mark.parametrize("n", [4, 5])
def test_cables_on_one_side_cannot_be_prestressed(n):
    match = "not in tension in the only state" if n == 4 else "no combination of the 2 states"
    with pytest.raises(ValueError, match=match):
        forms.feasible_prestress(star(ASIDE[:n], jc.Cables))
    # bars can, one of them in compression
    found = forms.feasible_prestress(star(ASIDE[:n]))
    assert np.asarray(found.tension).min() < 0 and float(found.unbalanced) < 1e-9


SIMPLEX, _ = simplex()
GROUPS = forms.symmetric_groups(SIMPLEX, 3)
VERTICAL = int(GROUPS["verticals"][0])


def group_tensions(nodes, tension=1.0):
    structure = jc.replace(SIMPLEX, nodes=nodes)
    return forms.feasible_prestress(structure, GROUPS, group=VERTICAL, tension=tension)


def weighed(nodes):
    """Weighed group tensions of any nodes: the least squares state beside the given tension."""
    return jnp.array([0.3, -1.0, 0.5, 0.7]) @ group_tensions(nodes).group_tension


@pytest.mark.slow
def test_derivative_by_the_nodes():
    nodes = jnp.asarray(SIMPLEX.nodes)
    assert_gradient(weighed, nodes)
    # linear in the tension that is given
    by_tension = traced(jax.jacfwd(lambda t: group_tensions(nodes, t).group_tension))(2.0)
    assert jnp.abs(by_tension - group_tensions(nodes).group_tension).max() < 1e-13

    def ratio(height):
        scaled = nodes * jnp.stack([1.0, 1.0, height / 1.5])[None]
        return group_tensions(scaled).group_tension[int(GROUPS["triangles"][0])]

    # triangle over vertical with l_t = sqrt(3): 1 / l_v
    upright = np.hypot(2 * np.sin(np.pi / 12), 1.5)
    assert float(ratio(1.5)) == pytest.approx(1 / upright, rel=1e-13)
    assert float(traced(jax.grad(ratio))(1.5)) == pytest.approx(-1.5 / upright**3, rel=1e-12)


def test_traced_nodes_with_several_modes_give_no_numbers():
    structure, _ = jc.scenes.flat_net()

    def moved(nodes):
        return jc.replace(structure, nodes=nodes)

    def first(nodes):
        return forms.feasible_prestress(moved(nodes), group=0).tension[5]

    assert np.isnan(traced(first)(structure.nodes))
    assert np.isnan(traced(jax.grad(first))(jnp.asarray(structure.nodes))).any()
    pushing = traced(lambda nodes: group_tensions(nodes, -1.0).group_tension)
    assert np.isnan(pushing(SIMPLEX.nodes)).all()  # cables would be in compression
    with pytest.raises(ValueError, match="group: the nodes are traced by jax"):
        traced(lambda n: forms.feasible_prestress(moved(n)).tension)(structure.nodes)


# --- symmetry


def test_symmetric_groups():
    # upper and lower triangle are images by a turn about a level axis only, which is not asked for
    assert [len(np.unique(GROUPS[k])) for k in ("triangles", "verticals", "struts")] == [2, 1, 1]
    assert np.unique(np.concatenate(list(GROUPS.values()))).tolist() == [0, 1, 2, 3]
    assert len(np.unique(forms.symmetric_groups(SIMPLEX, 1)["struts"])) == 3
    net, _ = jc.scenes.flat_net()
    centre = np.asarray(net.nodes)[:, :2].mean(0)
    # 12 links in whirls of 4; a mirror makes both ends of a cable alike
    assert len(np.unique(forms.symmetric_groups(net, 4, centre=centre))) == 3
    assert len(np.unique(forms.symmetric_groups(net, 4, mirror=0.0, centre=centre))) == 2
    # the mirror alone: two rows are one (3 links), each column's ends alike (2 and 2)
    assert len(np.unique(forms.symmetric_groups(net, 1, mirror=0.0, centre=centre))) == 7


def replaced(**changes):
    return jc.replace(SIMPLEX, **changes)


def prestress(*groups, **options):
    return lambda: forms.feasible_prestress(SIMPLEX, *groups, **options)


def test_results_are_in_the_shape_of_the_elements():
    """A list of three groups, not in the order of the kinds: node by node from each group's own."""
    kinds = ("verticals", "struts", "triangles")
    groups = [SIMPLEX.elements[kind] for kind in kinds]
    structure = replaced(elements=[groups[:2], groups[2]])
    found = forms.self_stress(structure)
    shape = jax.tree.structure([[0, 0], 0])
    fields = (found.tensions, found.force_densities, found.length, found.tension_only, found.links)
    assert all(jax.tree.structure(own) == shape for own in fields)
    densities = jax.tree.leaves(found.force_densities)
    unit = densities[0][0, 0]
    # the closed form, as in `test_simplex`
    for group, own, expected in zip(groups, densities, (1.0, -1.0, 1 / np.sqrt(3)), strict=True):
        assert own.shape == (1, len(group.links))
        assert np.abs(own[0] / unit - expected).max() < 1e-12
    assert [own.all() for own in jax.tree.leaves(found.tension_only)] == [True, False, True]
