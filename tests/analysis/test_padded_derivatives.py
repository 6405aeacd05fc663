"""Derivatives outside of `jit` by programs of common sizes, equal to those of exact sizes."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from test_common_sizes import SCENES, free_nodes, is_padded, nets, not_fused

import jaxcable as jc
from jaxcable.analysis import derivative_programs, phase_loop
from jaxcable.common import compilation
from jaxcable.design import Target, tune

pytestmark = not_fused

CHANGES = derivative_programs.change_of_solution
ADJOINTS = derivative_programs.adjoint_of_solution


def results(solution):
    """All results with a derivative: of the solution, of its phases, and what it ends with."""
    names = ("displacement", "positions", "tension", "reactions", "load", "rest_length")
    names += ("rotation", "reaction_moments", "section_forces", "peak_tension")
    parts = [[getattr(own, name) for name in names] for own in (solution, *solution.phases)]
    restart = solution.last.restart
    loads = [stack.load for stack in restart.loads]
    return [
        x
        for x in jax.tree.leaves((parts, restart.motion, restart.states, loads))
        if jnp.issubdtype(x.dtype, jnp.floating)
    ]


def differentiable(scene, then=None):
    """Return a function of all floats of a scene, and these floats.

    The function takes also whether sizes are exact, and returns a sum of all results, each with
    random factors of its size. `then` continues the analysis.
    """
    leaves, tree = jax.tree.flatten(scene)
    places = [k for k, x in enumerate(leaves) if np.issubdtype(np.asarray(x).dtype, np.floating)]

    def solved(values, exact):
        at = list(leaves)
        for k, x in zip(places, values, strict=True):
            at[k] = x
        structure, phases = tree.unflatten(at)
        solution = jc.solve(structure, phases, exact_sizes=exact)
        if then is None:
            return [solution]
        return [solution, jc.solve(structure, then, start=solution, exact_sizes=exact)]

    start = [np.asarray(leaves[k], float) for k in places]
    rng = np.random.default_rng(3)
    found = [x for solution in solved(start, False) for x in results(solution)]
    assert all(np.isfinite(x).all() for x in found)
    factors = [rng.normal(size=x.shape) / max(np.abs(x).max(initial=0), 1e-3) for x in found]

    def total(values, exact):
        some = [x for solution in solved(values, exact) for x in results(solution)]
        return sum(jnp.sum(a * x) for a, x in zip(factors, some, strict=True))

    return total, start


def check_equal(padded, exact, start, rounding=1e-9):
    """Check gradients, each multiplied by its argument: equal but for rounding.

    Sums and factors of matrices are in another order: they differ by `rounding` of the largest of
    an argument, or 1e-12 of the largest of all.
    """
    most = max(np.abs(b * x).max(initial=0) for b, x in zip(exact, start, strict=True))
    assert most > 0
    for a, b, x in zip(padded, exact, start, strict=True):
        a, b = np.asarray(a), np.asarray(b)
        assert (a.shape, a.dtype) == (b.shape, b.dtype) and np.isfinite(b).all()
        tolerance = max(rounding * np.abs(b * x).max(initial=0), 1e-12 * most)
        np.testing.assert_allclose(a * x, b * x, rtol=0, atol=tolerance)


QUICK = "flat_net", "simplex"
SLOW = [pytest.param(name, marks=pytest.mark.slow) for name in SCENES if name not in QUICK]


# axial forces of the girder, 100 N, are EA / L of 6e8 N/m times differences of displacements: what
# rounding leaves of their derivatives is 1e-7 of them
ROUNDING = {"suspension_footbridge": 1e-5}


@pytest.mark.parametrize("name", [*QUICK, *SLOW])
def test_derivatives_are_those_of_exact_sizes(name):
    """By all numbers of structure and phases, in reverse and in forward mode."""
    scene = tuple(SCENES[name][:2])
    assert is_padded(*scene)
    total, start = differentiable(scene)
    padded, exact = (jax.grad(total)(start, exact) for exact in (False, True))
    rounding = ROUNDING.get(name, 1e-9)
    check_equal(padded, exact, start, rounding)
    rng = np.random.default_rng(4)
    direction = [rng.normal(size=x.shape) * np.abs(x) for x in start]
    rate = jax.jvp(lambda values: total(values, False), (start,), (direction,))[1]
    # sums of all results and arguments cancel by some digits
    parts = [np.sum(np.abs(b * d)) for b, d in zip(exact, direction, strict=True)]
    whole = sum(np.sum(b * d) for b, d in zip(exact, direction, strict=True))
    assert abs(rate - whole) < rounding * sum(parts)


def stages(names):
    """Cables of a net, in groups of these names, come and go, with loads in later phases."""
    structure, _ = jc.scenes.saddle(2, 3)[:2]
    parts = np.array_split(structure.elements.links.array, len(names))
    cables = {
        name: jc.Cables(own, axial_stiffness=1e5 * (1 + k), weight=2.0 + k)
        for k, (name, own) in enumerate(zip(names, parts, strict=True))
    }
    some, wind = {names[0]: jc.only([0])}, jc.LineLoads((0.0, 0.5, -2.0), on=names[0])
    return jc.replace(structure, elements=cables), [
        jc.Phase(pretension=dict.fromkeys(names, 1e3), loads=jc.SelfWeight()),
        jc.Phase(removes=some, increments=2),
        jc.Phase(adds=some, loads=wind),
    ]


@pytest.mark.parametrize("names", ["a", pytest.param("ab", marks=pytest.mark.slow)])
def test_stages_that_are_continued(names):
    """Elements come and go; loads of earlier analyses are results that begin the next one."""
    scene = stages(names)
    assert is_padded(*scene)
    load = jc.NodalLoads(free_nodes(scene[0])[:1], (0.0, 0.0, -5.0))
    total, start = differentiable(scene, jc.Phase(loads=load))
    padded, exact = (jax.grad(total)(start, exact) for exact in (False, True))
    check_equal(padded, exact, start)


def test_gradients_by_areas_of_fibres():
    """The last fibre is split to a common number; the slope by its area is not."""
    nodes = np.linspace([0.0, 0, 0], [2.0, 0, 0], 3)
    fibres = [0.02, -0.02, 0.0], [0.01, 0.01, -0.02], [4e-4, 4e-4, 5e-4]

    def tip(area, y, exact):
        section = jc.Section(y=y, z=fibres[1], area=area, laws=[jc.Elastic(200e9)])
        beams = jc.Beams([[0, 1], [1, 2]], section, torsional_stiffness=1e4)
        structure = jc.Structure(nodes, beams, jc.clamped([0]))
        load = jc.Phase(loads=jc.NodalLoads([2], (30.0, 40.0, -50.0)))
        return jc.solve(structure, load, exact_sizes=exact).displacement[2] @ np.arange(1.0, 4.0)

    y, area = map(np.array, (fibres[0], fibres[2]))
    padded, exact = (jax.grad(tip, (0, 1))(area, y, exact) for exact in (False, True))
    check_equal(padded, exact, (area, y))
    for k, (x, h) in enumerate(((area, 1e-7), (y, 1e-5))):
        for j in range(3):  # central differences: error of third order, 1e-5 of the slope
            at = [[area, y], [area, y]]
            for sign, own in zip((1, -1), at, strict=True):
                own[k] = x + sign * h * np.eye(3)[j]
            slope = (tip(*at[0], False) - tip(*at[1], False)) / (2 * h)
            np.testing.assert_allclose(padded[k][j], slope, rtol=1e-4)


NET, (PRESTRESS, LOADING) = jc.scenes.saddle(2, 3, load=200.0)[:2]


def scaled_net(scale, exact=False, method=None):
    """Displacement of a net whose nodes and pretension are scaled."""
    moved = jc.replace(NET, nodes=NET.nodes * (1 + scale[0] * np.array([[0.0, 0.0, 1.0]])))
    phases = [jc.replace(PRESTRESS, pretension=1e3 * (1 + scale[1])), LOADING]
    return jc.solve(moved, phases, method, exact_sizes=exact).displacement[free_nodes(NET)]


@pytest.mark.parametrize("exact", [False, True])
def test_a_failed_analysis_has_no_derivative(exact):
    def total(scale):
        return jnp.sum(scaled_net(scale, exact, jc.Newton(max_steps=1)))

    assert np.isnan(jax.grad(total)(np.ones(2))).all()
    assert np.isnan(jax.jvp(total, (np.ones(2),), (np.ones(2),))[1])


@pytest.mark.parametrize("mode", [jax.jacfwd, jax.jacrev])
def test_batches_of_directions(mode):
    """Jacobians, of which numbers of directions are padded as well, and programs kept."""
    scale = np.array([0.1, 0.2])
    padded = mode(lambda x: scaled_net(x))(scale)
    exact = mode(lambda x: scaled_net(x, True))(scale)
    assert padded.shape == exact.shape and type(padded) is type(exact)
    np.testing.assert_allclose(padded, exact, rtol=0, atol=1e-9 * np.abs(exact).max())
    program = CHANGES if mode is jax.jacfwd else ADJOINTS
    known = set(program.known)
    fewer = mode(lambda x: scaled_net(x)[:, 1:])(scale)
    close = {"rtol": 0, "atol": 1e-12 * np.abs(exact).max()}  # sums in another order
    np.testing.assert_allclose(fewer, padded[:, 1:], **close)
    # 18 results and 12: each number has its program
    assert len(set(program.known) - known) == (0 if mode is jax.jacfwd else 1)


def test_nodes_without_stiffness_have_no_derivative():
    """The net of `nets` with 60 cables has two that hang on slack cables only."""
    structure, phases = next(nets(np.random.default_rng(1), [60]))
    nodes, found = np.asarray(structure.nodes), []
    for exact in (False, True):

        def solved(nodes, exact=exact):
            moved = jc.replace(structure, nodes=nodes)
            return jc.solve(moved, phases, exact_sizes=exact).displacement

        change = jax.jvp(solved, (nodes,), (np.ones_like(nodes),))[1]
        found.append([np.isnan(x) for x in (change, jax.grad(lambda x: solved(x).sum())(nodes))])
    for padded, exact in zip(*found, strict=True):
        np.testing.assert_array_equal(padded, exact)
    assert found[0][0].any() and not found[0][0].all() and found[0][1].any()


def test_second_derivatives():
    def total(scale, exact):
        return jnp.sum(scaled_net(scale, exact) ** 2)

    scale = np.array([0.1, 0.2])
    for second in (jax.hessian, lambda f: jax.jacrev(jax.grad(f))):
        padded = second(lambda x: total(x, False))(scale)
        exact = second(lambda x: total(x, True))(scale)
        assert np.abs(exact).min() > 0
        np.testing.assert_allclose(padded, exact, rtol=1e-8)


def test_transformations_of_linear_maps():
    """What `jax.linearize` and `jax.vjp` return, compiled, batched twice, transposed, later."""
    scale, change = np.array([0.1, 0.2]), np.array([1.0, 0.5])
    exact = jax.jacfwd(lambda x: scaled_net(x, True))(scale)
    found, push = jax.linearize(scaled_net, scale)
    ones, total = np.ones(found.shape), exact.sum((0, 1))
    pull = jax.vjp(scaled_net, scale)[1]
    several = jax.vmap(jax.vmap(push))(np.eye(2)[None])[0]
    jc.forget_programs()  # what is known of sizes is found again
    pairs = [
        (push(change), exact @ change),
        (jax.jit(push)(change), exact @ change),
        (several, np.moveaxis(exact, -1, 0)),
        (pull(ones)[0], total),
        (jax.jit(pull)(ones)[0], total),
        (jax.linear_transpose(push, scale)(ones)[0], total),
        (jax.grad(lambda x: pull(x)[0] @ change)(ones), exact @ change),
    ]
    for own, other in pairs:
        np.testing.assert_allclose(own, other, rtol=0, atol=1e-9 * np.abs(other).max())


def test_exact_sizes_have_exact_derivatives():
    jc.forget_programs()
    jax.grad(lambda x: jnp.sum(scaled_net(x, True)))(np.ones(2))
    ((_, shapes, *_),) = ADJOINTS.known
    assert (NET.nodes.shape, NET.nodes.dtype) in shapes


def test_ten_nets_share_programs_of_gradients(monkeypatch):
    """By nodes and by pretension, of tensions: one program, for ten nets."""
    jc.forget_programs()
    compile_or_load, begun = compilation._compile_or_load, []

    def compiled(function, *given):
        begun.append(function.__name__)
        return compile_or_load(function, *given)

    monkeypatch.setattr(compilation, "_compile_or_load", compiled)
    for structure, (prestress, loading) in nets(np.random.default_rng(1), range(60, 70)):

        def total(nodes, tension, structure=structure, prestress=prestress, loading=loading):
            moved = jc.replace(structure, nodes=nodes)
            phases = [jc.replace(prestress, pretension=tension), loading]
            return jnp.sum(jc.solve(moved, phases).tension)

        nodes = np.asarray(structure.nodes)
        value, slope = jax.value_and_grad(total)(nodes, 1e3)
        rate = jax.grad(total, 1)(nodes, 1e3)
        assert np.isfinite(value) and np.isfinite(slope).all() and np.isfinite(rate)
        jax.jvp(lambda x, total=total, nodes=nodes: total(nodes, x), (1e3,), (1.0,))
    assert len(ADJOINTS.known) == 1 and len(CHANGES.known) == 1
    assert len(phase_loop.analyse.known) <= 2  # without fallbacks and with
    assert len(begun) <= 4


def test_gradients_of_another_mesh_compile_nothing():
    """Neither programs nor the small ones that jax has for arrays of every new shape."""
    jc.forget_programs()
    compiles = []

    def heard(event, *_, **__):
        if "backend_compile" in event:
            compiles.append(event)

    jax.monitoring.register_event_duration_secs_listener(heard)
    for k, (structure, phases) in enumerate(nets(np.random.default_rng(1), range(60, 63))):

        def pull(nodes, structure=structure, phases=phases):
            moved = jc.replace(structure, nodes=nodes)
            return jc.solve(moved, phases).tension

        nodes = np.asarray(structure.nodes)
        found, back = jax.vjp(pull, nodes)
        (slope,) = back(np.ones(found.shape))
        assert slope.shape == nodes.shape and np.isfinite(slope).all()
        if k == 0:
            assert compiles
            compiles.clear()
    jax.monitoring.unregister_event_duration_listener(heard)
    assert compiles == []


def test_tune_of_structures_of_similar_size_shares_its_program():
    """With all pretensions as unknowns: 17 and 22 directions, in a program for 24."""
    jc.forget_programs()
    for n in (3, 4):
        structure, (prestress, loading) = jc.scenes.saddle(2, n, load=100.0)[:2]
        stated = jc.replace(prestress, pretension=np.full(len(structure.elements.links), 1e3))
        middle = free_nodes(structure)[0]
        height = jc.solve(structure, [stated, loading]).positions[middle, 2]
        target = Target("positions", height + 1e-4, at=(middle, 2), phase=1, within=1e-5)
        found = tune(structure, [stated, loading], [(0, "pretension")], [target])
        assert int(found.status) == 0 and bool(found.met[0])
    assert len(CHANGES.known) == 1
