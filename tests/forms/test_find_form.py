"""Forms of prescribed forces and lengths against closed forms, NumPy and their own analysis."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles.taylor import slope
from scipy.optimize import brentq

import jaxcable as jc
from jaxcable.common.selection import only
from jaxcable.forms import find_form, prescribed

EA = 2e6


def star(ends, top=(0.1, 0.2, 0.3), kind=jc.Cables, **options):
    """Elements from supports to one free node, which is the last."""
    ends = np.asarray(ends, float)
    n = len(ends)
    links = np.column_stack([np.arange(n), np.full(n, n)])
    nodes = np.vstack([ends, top])
    options = options or {"axial_stiffness": EA}
    return jc.Structure(nodes, kind(links, **options), jc.pinned(np.arange(n)))


def chain(n, spans=1.0):
    nodes = np.column_stack([np.linspace(0, spans, n + 1), np.zeros(n + 1), np.zeros(n + 1)])
    links = np.column_stack([np.arange(n), np.arange(1, n + 1)])
    return jc.Structure(nodes, jc.Cables(links, axial_stiffness=EA), jc.pinned([0, n]))


def unbalanced(structure, form, load=0.0):
    """Largest unbalanced force at a free freedom, from positions and tensions, in NumPy."""
    x, force = np.asarray(form.positions), np.zeros((structure.n_node, 3)) + load
    tensions = jax.tree.leaves(form.tension)
    for group, tension in zip(structure.groups, tensions, strict=True):
        for (i, j), T in zip(group.links.array, np.asarray(tension), strict=True):
            pull = T * (x[j] - x[i]) / np.linalg.norm(x[j] - x[i])
            force[i] += pull
            force[j] -= pull
    return np.abs(force[~np.asarray(structure.fixed(structure.supports))]).max()


def test_minimal_net_of_a_saddle_frame():
    """All tensions equal, also by the material law from lengths alone, and in equilibrium."""
    structure, _ = jc.scenes.saddle(6, 6, rise=0.3, axial_stiffness=EA)
    T = 2000.0
    form = find_form(structure, T)
    jc.raise_if_failed(form)
    x, links = np.asarray(form.positions), structure.elements.links.array
    length = np.linalg.norm(x[links[:, 1]] - x[links[:, 0]], axis=1)
    rest = np.asarray(form.rest_length)
    assert np.abs(EA * (length - rest) / rest / T - 1).max() < 1e-10
    # the default tolerance is 1e-10 of the end forces at a node, 4 T
    assert unbalanced(structure, form) < 4e-10 * T
    assert np.abs(form.length - length).max() < 1e-14
    assert np.abs(form.force_density * length / T - 1).max() < 1e-14
    # least total length: no small move makes it shorter
    free = ~np.asarray(structure.fixed(structure.supports))
    for seed in range(5):
        move = 1e-3 * np.random.default_rng(seed).normal(size=x.shape) * free
        moved = x + move
        assert np.linalg.norm(moved[links[:, 1]] - moved[links[:, 0]], axis=1).sum() > length.sum()


@pytest.mark.parametrize("how", ["pretension", "rest_length"])
def test_form_is_in_equilibrium_at_once(how):
    structure, _ = jc.scenes.saddle(4, 4, rise=0.3, axial_stiffness=EA)
    load = jc.NodalLoads(np.arange(structure.n_node), (5.0, 0.0, -40.0))
    T = np.random.default_rng(0).uniform(970, 1030, 40)
    form = find_form(structure, T, load)
    assert int(form.status) == 0
    formed = jc.replace(structure, nodes=form.positions)
    phase = jc.Phase(loads=load, **{how: form.tension if how == "pretension" else form.rest_length})
    solution = jc.solve(formed, phase)
    assert int(solution.status) == 0
    assert int(solution.phases[0].path.iterations[0]) == 0
    # a length has its digits only: eps EA/N is 1e-12
    assert np.abs(solution.tension / T - 1).max() < 1e-11


def test_two_cables_over_pulleys():
    """Equal forces T, half-span a, load P: ``2 T z / l = P``, z = a P / sqrt(4 T^2 - P^2)."""
    a, T, P = 3.0, 50.0, 60.0
    structure = star([[-a, 0, 0], [a, 0, 0]], top=(0.4, 0.0, 0.2))
    form = find_form(structure, T, jc.NodalLoads([2], (0, 0, -P)))
    assert int(form.status) == 0
    expected = [0.0, 0.0, -a * P / np.sqrt(4 * T**2 - P**2)]
    # the residual allows 1e-10 of 2 T + P over a stiffness of about 2 T/l
    assert np.abs(form.positions[2] - np.array(expected)).max() < 1e-8
    assert unbalanced(structure, form, np.array([[0, 0, 0], [0, 0, 0], [0, 0, -P]])) < 1e-7


def test_three_weights():
    """Weber's point by the triangle of forces: angles between the strings from the forces."""
    T = np.array([3.0, 4.0, 4.5])
    ends = np.array([[0.0, 0, 0], [4.0, 0, 0], [1.5, 3.0, 0]])
    form = find_form(star(ends, top=(1.0, 1.0, 0.7)), T)
    assert int(form.status) == 0
    d = ends - np.asarray(form.positions[3])
    d /= np.linalg.norm(d, axis=1)[:, None]
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        cosine = (T[k] ** 2 - T[i] ** 2 - T[j] ** 2) / (2 * T[i] * T[j])
        assert abs(d[i] @ d[j] - cosine) < 1e-9
    assert abs(float(form.positions[3, 2])) < 1e-9


def test_held_strut_under_guys():
    """A strut of given thrust, its top free to rise: ``N = 3 T z / l``."""
    angle = 2 * np.pi * np.arange(3) / 3
    ends = np.column_stack([2 * np.cos(angle), 2 * np.sin(angle), 0 * angle])
    nodes = np.vstack([ends, [0, 0, -1.0], [0, 0, 0.5]])
    mask = np.ones((5, 3), bool)
    mask[4, 2] = False
    elements = {
        "guys": jc.Cables([[0, 4], [1, 4], [2, 4]], axial_stiffness=EA),
        "strut": jc.Bars([[3, 4]], axial_stiffness=EA),
    }
    structure = jc.Structure(nodes, elements, jc.Supports(mask))
    T, N = 100.0, 200.0
    form = find_form(structure, {"guys": T, "strut": -N})
    assert int(form.status) == 0
    sine = N / (3 * T)
    assert abs(float(form.positions[4, 2]) - 2 * sine / np.sqrt(1 - sine**2)) < 1e-8
    assert float(form.rest_length["strut"][0]) > float(form.length["strut"][0])


def test_two_lengths_and_a_load_by_hand():
    """A node on two circles; forces by the law of sines (in a plane: y is held)."""
    nodes = np.array([[0.0, 0, 0], [5.0, 0, 0], [2.0, 0, -1.0]])
    mask = np.array([[1, 1, 1], [1, 1, 1], [0, 1, 0]], bool)
    structure = jc.Structure(
        nodes, jc.Cables([[0, 2], [1, 2]], axial_stiffness=EA), jc.Supports(mask)
    )
    L, P = np.array([3.0, 4.0]), 70.0
    load = jc.NodalLoads([2], (0, 0, -P))
    form = find_form(structure, None, load, length=L, method=jc.Newton(linear_solver="superlu"))
    assert int(form.status) == 0
    # 3, 4, 5: a right angle at the node, 1.8 from the left and 2.4 down
    assert np.abs(form.positions[2] - np.array([1.8, 0, -2.4])).max() < 1e-9
    assert np.abs(form.tension - P * np.array([4 / 5, 3 / 5])).max() < 1e-7
    assert np.abs(form.length - L).max() < 1e-9


def test_hanging_chain_of_equal_links():
    """Angles of the links from the horizontal force, which the span determines."""
    n, P, L, span = 10, 3.0, 0.13, 1.0
    form = find_form(chain(n), None, jc.NodalLoads(np.arange(1, n), (0, 0, -P)), length=L)
    assert int(form.status) == 0
    shear = P * (np.arange(n) - (n - 1) / 2)  # vertical force in each link

    def excess(H):
        return (L * H / np.hypot(H, shear)).sum() - span

    H = brentq(excess, 1e-3, 1e3, xtol=1e-14)
    assert np.abs(form.tension - np.hypot(H, shear)).max() < 1e-7
    z = np.append(0.0, np.cumsum(L * shear / np.hypot(H, shear)))
    assert np.abs(form.positions[:, 2] - z).max() < 1e-9


def triplex(twist):
    """Three struts, three verticals, the upper triangle; the lower nodes held. R = 1, h = 1.5."""
    at = 2 * np.pi * np.arange(3) / 3
    low = np.column_stack([np.cos(at), np.sin(at), 0 * at])
    high = np.column_stack([np.cos(at + twist), np.sin(at + twist), 0 * at + 1.5])
    k = np.arange(3)
    elements = {
        "struts": jc.Bars(np.column_stack([k, 3 + (k + 1) % 3]), axial_stiffness=EA),
        "cables": jc.Cables(
            np.vstack([np.column_stack([k, 3 + k]), np.column_stack([3 + k, 3 + (k + 1) % 3])]),
            axial_stiffness=EA,
        ),
    }
    return jc.Structure(np.vstack([low, high]), elements, jc.pinned(k))


def test_triplex_finds_its_twist():
    """Struts of given length, cables of given force: the twist that one equation needs.

    Force densities upper triangle : vertical : strut = 1/sqrt(3) : 1 : -1 at equal radii.
    """
    twist = np.pi / 6
    exact = triplex(twist)
    x, T = np.asarray(exact.nodes), {}
    for name, q in (("struts", [-1.0] * 3), ("cables", [1.0] * 3 + [1 / np.sqrt(3)] * 3)):
        links = exact.elements[name].links.array
        length = np.linalg.norm(x[links[:, 1]] - x[links[:, 0]], axis=1)
        T[name] = 1e3 * np.array(q) * length
        if name == "struts":
            strut = length[0]
    # which twist it is depends on how the struts turn: checked, not assumed
    named = type("F", (), {"positions": x, "tension": T})
    if unbalanced(exact, named) > 1e-9:
        pytest.fail("the reference is not in equilibrium")
    start = triplex(twist + 0.2)
    form = find_form(
        start, {"cables": T["cables"], "struts": None}, length={"struts": strut, "cables": None}
    )
    assert int(form.status) == 0
    assert np.abs(form.positions - x).max() < 1e-7
    assert np.abs(form.tension["struts"] / T["struts"] - 1).max() < 1e-7
    assert unbalanced(start, form) < 1e-6


def test_stress_of_an_area():
    law = jc.Polygonal([0.0, 0.001, 0.02], [0.0, 200e6, 300e6])
    area = np.array([1e-5, 2e-5, 3e-5])
    ends = [[0.0, 0, 0], [4.0, 0, 0], [1.5, 3.0, 0]]
    structure = star(ends, kind=jc.Cables, area=area, law=law)
    form = find_form(structure, stress=np.array([250e6, 180e6, 90e6]))
    assert int(form.status) == 0
    assert np.abs(form.tension - np.array([2500, 3600, 2700])).max() < 1e-9
    # by the curve: 0.001 + 50/100 of 0.019; 0.9 and 0.45 of 0.001
    strain = np.array([0.0105, 0.0009, 0.00045])
    assert np.abs(form.length / form.rest_length - 1 - strain).max() < 1e-13
    torn = find_form(structure, only([0], 3001.0), stress=only([1, 2], 90e6))
    assert int(torn.status) == jc.status.MATERIAL_FAILURE or int(torn.status) != 0
    assert np.isnan(torn.rest_length).all()


@pytest.mark.parametrize("lengths", [False, True])
def test_sparse_against_dense(lengths):
    structure, _ = jc.scenes.saddle(8, 7, rise=0.3)
    n = len(structure.elements.links)
    tension, length = 1e3, None
    if lengths:
        tension, length = only(np.arange(5, n), 1e3), only(np.arange(5), 1.05)
    dense = find_form(structure, tension, length=length, method=jc.Newton(linear_solver="dense"))
    assert int(dense.status) == 0
    form = find_form(structure, tension, length=length)  # banded
    assert int(form.status) == 0
    assert np.abs(form.positions - dense.positions).max() < 1e-8
    assert unbalanced(structure, dense) < 1e-6


def test_any_sensible_start_leads_to_the_same_minimal_net():
    structure, _ = jc.scenes.saddle(5, 5, rise=0.3)
    form = find_form(structure, 1e3)
    free = ~np.asarray(structure.fixed(structure.supports))
    for seed in range(3):
        away = 3 * np.random.default_rng(seed).normal(size=free.shape) * free
        other = find_form(jc.replace(structure, nodes=structure.nodes + away), 1e3)
        assert int(form.status) == int(other.status) == 0
        assert np.abs(form.positions - other.positions).max() < 1e-8


SMALL, _ = jc.scenes.saddle(2, 2, rise=0.3, axial_stiffness=EA)
TENSION = jnp.asarray(np.random.default_rng(0).uniform(800, 1200, 12))
TIGHT = jc.Newton(tol=1e-14)
LOAD = jnp.asarray(np.random.default_rng(1).normal(size=(SMALL.n_node, 3)) * 20)
GIVEN = np.array([0, 7])
OTHERS = np.setdiff1d(np.arange(12), GIVEN)


def mixed(p):
    """A form with two given lengths; p has tensions [10], lengths [2], a factor on the load."""
    return find_form(
        SMALL,
        only(OTHERS, p[:10]),
        jc.NodalLoads(np.arange(SMALL.n_node), p[12] * LOAD / 100),
        length=only(GIVEN, p[10:12]),
        method=TIGHT,
    )


PARAMETERS = {
    "tension": (TENSION, lambda p: find_form(SMALL, p, method=TIGHT)),
    "supports": (
        jnp.asarray(SMALL.nodes),
        lambda p: find_form(jc.replace(SMALL, nodes=p), TENSION, method=TIGHT),
    ),
    "loads": (
        LOAD,
        lambda p: find_form(
            SMALL, TENSION, jc.NodalLoads(np.arange(SMALL.n_node), p), method=TIGHT
        ),
    ),
    "lengths": (jnp.concatenate([TENSION[OTHERS] / 1e3, jnp.array([1.1, 1.2, 1.0])]), mixed),
}


# all kinds at once in "lengths"; one by one in `make test-all`
ALONE = ("lengths",)
NAMES = [pytest.param(n, marks=[] if n in ALONE else pytest.mark.slow) for n in PARAMETERS]


@pytest.mark.parametrize("name", NAMES)
def test_taylor(name):
    p, find = PARAMETERS[name]

    def number(p):
        form = find(p)
        weights = jnp.asarray(np.random.default_rng(5).normal(size=form.positions.shape))
        waves = jnp.cos(jnp.arange(12.0))
        total = 100 * jnp.sum(weights * jnp.sin(form.positions))
        total += jnp.sum(waves * (form.length + jnp.log(1 + form.tension**2) + form.rest_length))
        return total, form.status

    f = jax.jit(jax.value_and_grad(number, has_aux=True))
    (_, status), gradient = f(p)
    assert int(status) == 0

    def value(p):
        return f(p)[0][0]

    assert abs(slope(value, p, gradient, 4.0) - 2) < 0.1
    wrong = gradient.at[(-1,) * gradient.ndim].add(1e-2 * jnp.abs(gradient).max())
    assert slope(value, p, wrong, 4.0) < 1.5


@pytest.mark.slow
@pytest.mark.parametrize("name", ["tension", "lengths"])
def test_transformations(name):
    """jit, vmap, jvp, jacfwd, jacrev and hessian agree with each other and with differences."""
    p, find = PARAMETERS[name]

    def end(p):
        form = find(p)
        return jnp.append(form.positions[3], form.force_density[0])

    jacobian = jax.jit(jax.jacfwd(end))(p)
    size = np.abs(jacobian).max()
    assert np.abs(jax.jit(jax.jacrev(end))(p) - jacobian).max() < 1e-10 * size
    direction = jnp.asarray(np.random.default_rng(2).normal(size=p.shape)) * jnp.abs(p)
    tangent = jax.jit(lambda p: jax.jvp(end, (p,), (direction,))[1])(p)
    assert np.abs(tangent - jacobian @ direction).max() < 1e-10 * np.abs(tangent).max()
    h = 1e-4
    batch = jnp.stack([p + h * direction, p - h * direction])
    ends, gradients = jax.jit(
        jax.vmap(lambda p: (end(p), jax.grad(lambda p: jnp.sum(end(p) ** 2))(p)))
    )(batch)
    # truncation h^2
    assert np.abs((ends[0] - ends[1]) / (2 * h) - tangent).max() < 1e-6 * np.abs(tangent).max()
    second = jax.jit(jax.hessian(lambda p: jnp.sum(end(p) ** 2)))(p)
    assert np.abs(second - second.T).max() < 1e-9 * np.abs(second).max()
    product = second @ direction
    differences = (gradients[0] - gradients[1]) / (2 * h)
    assert np.abs(product - differences).max() < 1e-6 * np.abs(product).max()


@pytest.mark.slow
def test_hessians_of_a_batch_against_the_closed_form():
    """Two cables over pulleys, depth a P / sqrt(4 T^2 - P^2): jit, vmap, jacfwd of grad."""
    structure = star([[-3.0, 0, 0], [3.0, 0, 0]], top=(0.4, 0.0, 0.2))

    def depth(p):
        load = jc.NodalLoads([2], jnp.array([0.0, 0, -1]) * p[1])
        return find_form(structure, p[0], load, method=TIGHT).positions[2, 2]

    def exact(p):
        return -3 * p[1] / jnp.sqrt(4 * p[0] ** 2 - p[1] ** 2)

    batch = jnp.array([[5.0, 6.0], [4.0, 1.0], [6.0, 7.0]])
    found, expected = (jax.jit(jax.vmap(jax.hessian(f)))(batch) for f in (depth, exact))
    assert np.abs(found - expected).max() < 1e-10 * np.abs(expected).max()


TRIANGLE = [[0.0, 0, 0], [4.0, 0, 0], [1.5, 3.0, 0]]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("tension", "load", "codes"),
    [
        # the first force is more than both others: it draws the node to its support
        ([30.0, 4.0, 4.5], 0.0, (jc.status.COLLAPSED,)),
        # more load than all forces together: the node goes away
        ([3.0, 4.0, 4.5], -20.0, (jc.status.MECHANISM, jc.status.NOT_CONVERGED)),
        ([np.nan, 4.0, 4.5], 0.0, (jc.status.NONFINITE,)),
    ],
)
def test_no_form_is_a_status(tension, load, codes):
    structure = star(TRIANGLE, top=(1.0, 1.0, 0.7))

    def find(T):
        return find_form(structure, T, jc.NodalLoads([3], (0.0, 0.0, load)))

    form = find(np.array(tension))
    assert int(form.status) in codes
    assert np.isnan(form.positions).all() and np.isnan(form.rest_length).all()
    with pytest.raises(jc.AnalysisError):
        jc.raise_if_failed(form)
    good = jnp.array([3.0, 4.0, 4.5])

    def shared(stiffness, T):  # of both cases of a batch, asked about the second
        elements = jc.replace(structure.elements, axial_stiffness=stiffness)
        made = jc.replace(structure, elements=elements)
        forms = jax.vmap(
            lambda T, P: find_form(made, T, jc.NodalLoads([3], jnp.array([0, 0, 1.0]) * P))
        )(T, jnp.array([load, 0.0]))
        return forms.rest_length[1, 0], forms.status

    T = jnp.stack([jnp.array(tension), good])
    rate, status = jax.jit(jax.grad(shared, has_aux=True))(EA, T)
    assert int(status[0]) in codes and int(status[1]) == 0
    length = float(find_form(structure, good).length[0])
    # d/dEA of l / (1 + T/EA)
    assert float(rate) == pytest.approx(length * 3.0 / EA**2 / (1 + 3.0 / EA) ** 2, rel=1e-8)
    assert np.isnan(jax.jit(jax.grad(lambda T: find(T).length[0]))(jnp.array(tension))).all()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "code"),
    [
        pytest.param(jc.Bars, jc.status.OK, marks=pytest.mark.slow),
        (jc.Cables, jc.status.PUSHING_CABLE),
    ],
)
def test_a_cable_of_given_length_cannot_push(kind, code):
    """The length of a prop: as a bar it is found, as a cable it is refused."""
    nodes = np.array([[-1.0, 0, 0], [1.0, 0, 0], [0.0, 0, -1.0], [0.0, 0, 0.5]])
    mask = np.ones((4, 3), bool)
    mask[3, 2] = False
    elements = [
        jc.Cables([[0, 3], [1, 3]], axial_stiffness=EA),
        kind([[2, 3]], axial_stiffness=EA),
    ]
    structure = jc.Structure(nodes, elements, jc.Supports(mask))
    form = find_form(structure, [10.0, None], length=[None, 2.0])
    assert int(form.status) == code
    thrust = np.asarray(form.tension[1])  # 2 T z / l with z = 1
    assert np.isnan(thrust).all() if code else np.abs(thrust + 20 / np.sqrt(2)).max() < 1e-8


def test_changing_numbers_does_not_recompile():
    find_form(SMALL, TENSION)
    before = prescribed._find._cache_size()
    find_form(jc.replace(SMALL, nodes=np.asarray(SMALL.nodes) * 1.1), 2 * TENSION)
    order = np.random.default_rng(0).permutation(SMALL.n_node)
    back = np.argsort(order)
    renumbered = jc.Structure(
        np.asarray(SMALL.nodes)[order],
        jc.Cables(back[SMALL.elements.links.array], axial_stiffness=EA),
        jc.pinned(back[SMALL.supports.nodes.array]),
    )
    form = find_form(renumbered, TENSION)
    assert int(form.status) == 0
    assert prescribed._find._cache_size() == before
    assert np.abs(form.positions[back] - find_form(SMALL, TENSION).positions).max() < 1e-8


def test_refused():
    structure = star(TRIANGLE)
    with pytest.raises(
        ValueError, match="tension, length: element 1 of elements has more than one"
    ):
        find_form(structure, 1.0, length=only([1], 2.0))
    with pytest.raises(ValueError, match="tension: element 2 of elements has neither"):
        find_form(structure, only([0, 1], 1.0))
    with pytest.raises(ValueError, match=r"tension\[1\] = -1.0: a cable carries tension only"):
        find_form(structure, np.array([1.0, -1.0, 1.0]))
    with pytest.raises(ValueError, match=r"length\[2\] = -2.0: must be positive"):
        find_form(structure, only([0, 1], 1.0), length=only([2], -2.0))
    with pytest.raises(ValueError, match="stress: elements has no area; give tension"):
        find_form(structure, stress=1.0)
    with pytest.raises(ValueError, match="method: expected Newton, got Incremental"):
        find_form(structure, 1.0, method=jc.Incremental())
    with pytest.raises(ValueError, match=r"loads\[0\]: CablePressure is not known"):
        find_form(structure, 1.0, jc.CablePressure(1.0, (0.0, 1.0, 0.0)))
    with pytest.raises(ValueError, match=r"elements\[0\] = 7: the group has elements 0 to 2"):
        find_form(structure, only([7], 1.0))


GUYED = [[-4.0, 0, 0], [4, 0, 0], [0, 0, 3], [0, 2, 2.0], [0, -3, 0]]


def guyed():
    """A mast with guys on both sides, whose head holds a cable; groups by name."""
    elements = {
        "GUY": jc.Cables([[0, 2], [1, 2]], 1e7),
        "MAST": jc.Bars([[4, 2]], 1e8),
        "NET": jc.Cables([[2, 3], [3, 0], [3, 1]], 1e6),
    }
    return jc.Structure(GUYED, elements, jc.pinned([0, 1, 4]))


def test_messages_name_groups():
    structure = guyed()
    q = {"GUY": 1.0, "MAST": None, "NET": 1.0}
    with pytest.raises(
        ValueError, match=r"q: element 0 of elements\['MAST'\] has no force density"
    ):
        jc.force_density(structure, q)
    with pytest.raises(ValueError, match=r"q\['NET'\]\[0\] = -2.0: a cable carries tension only"):
        jc.force_density(structure, {**q, "MAST": 1.0, "NET": -2.0})
    with pytest.raises(ValueError, match=r"tension: element 0 of elements\['MAST'\] has neither"):
        jc.find_form(structure, q)
    with pytest.raises(ValueError, match=r"tension\['GUY'\]\[1\] = -1.0: a cable carries"):
        jc.find_form(structure, {**q, "MAST": -1.0, "GUY": np.array([1.0, -1.0])})
    lengths = {"GUY": None, "MAST": 0.0, "NET": None}
    with pytest.raises(ValueError, match=r"length\['MAST'\]\[0\] = 0.0: must be positive"):
        jc.find_form(structure, q, length=lengths)


def test_nodes_that_have_met_are_named():
    """Of three cables from one node the third pulls more than both others, to its support."""
    nodes = [[0.0, 0, 0], [4, 0, 0], [2, 3, 0], [2, 1, 0]]
    cables = jc.Cables([[0, 3], [1, 3], [2, 3]], 1e5)
    structure = jc.Structure(nodes, cables, jc.pinned([0, 1, 2]))
    form = jc.find_form(structure, tension=np.array([10.0, 10.0, 50.0]))
    assert int(form.status) == jc.status.COLLAPSED and np.isnan(form.positions).any()
    assert form.nearest.tolist() == [2, 3]
    with pytest.raises(jc.AnalysisError, match=r"have met \(here nodes 2 and 3\): a rope"):
        jc.raise_if_failed(form)
