"""Dead loads per length and per area, faces of nets, load combinations."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles.taylor import TIGHT, slope

import jaxcable as jc

SLOPED = np.array([[0.0, 0, 0], [3.0, 0, 4.0], [6.0, 2, 4.0], [9.0, 0, 0]])


def sloped(**group):
    """Three cables of which the first rises 4 m in 5 m; the middle nodes are free."""
    cables = jc.Cables([[0, 1], [1, 2], [2, 3]], axial_stiffness=1e5, **group)
    return jc.Structure(SLOPED, cables, jc.pinned([0, 3]))


def nodal(load, **phase):
    solution = jc.solve(sloped(), [jc.Phase(loads=load, **phase)])
    assert int(solution.status) == 0
    return np.asarray(solution.load)


def in_halves(lengths):
    total = np.zeros(4)
    for k, length in enumerate(lengths):
        total[k] += length / 2
        total[k + 1] += length / 2
    return total


@pytest.mark.parametrize("per", ["unstressed", "initial", "projected"])
def test_line_loads_per_length(per):
    """Of the unstressed length of the moment, the initial chord, or that seen along the force."""
    initial = np.linalg.norm(np.diff(SLOPED, axis=0), axis=1)
    plan = np.linalg.norm(np.diff(SLOPED[:, :2], axis=0), axis=1)
    lengths = {"unstressed": initial / 1.02, "initial": initial, "projected": plan}[per]
    load = nodal(jc.LineLoads((0, 0, -50.0), per=per), prestrain=0.02)
    expected = -50.0 * in_halves(lengths)
    # eps of the sums
    assert load[:, 2] == pytest.approx(expected, rel=1e-14)
    assert (load[:, :2] == 0).all()


def test_a_line_load_along_an_element_has_no_projected_length_and_no_bad_derivative():
    def total(z):
        nodes = jnp.asarray(SLOPED).at[1].set(jnp.array([0.0, 0.0, 1.0]) * z)
        structure = jc.replace(sloped(), nodes=nodes)
        load = jc.LineLoads((0, 0, -50.0), per="projected")
        solution = jc.solve(structure, [jc.Phase(prestrain=0.01), jc.Phase(loads=load)])
        return solution.load[0, 2]

    value, rate = jax.jit(jax.value_and_grad(total))(4.0)
    assert float(value) == 0.0 and float(rate) == 0.0


@pytest.mark.parametrize("per", ["projected", "initial"])
def test_area_loads(per):
    """Snow on a sloping square: plan area; cladding: the surface. A quarter to each corner."""
    nodes = np.array([[0.0, 0, 0], [3, 0, 0], [3, 4, 3.0], [0, 4, 3.0], [1.5, 2, 1.5]])
    cables = jc.Cables([[k, 4] for k in range(4)], axial_stiffness=1e5)
    structure = jc.Structure(nodes, cables, jc.pinned([0, 1, 2, 3]))
    load = jc.AreaLoads([[0, 1, 2, 3]], (0, 0, -500.0), per=per)
    solution = jc.solve(structure, [jc.Phase(prestrain=0.01), jc.Phase(loads=load)])
    assert int(solution.status) == 0
    area = {"projected": 12.0, "initial": 15.0}[per]
    expected = [-500 * area / 4] * 4 + [0.0]
    assert np.asarray(solution.load[:, 2]) == pytest.approx(expected, rel=1e-14)


def test_snow_on_a_saddle_net():
    """All plan area is loaded once; an inner node has a square of the spacing."""
    structure, phases = jc.scenes.saddle(4, 3, spacing=2.0, rise=0.2)
    faces = jc.net_faces(structure.nodes, structure.elements.links, border="ends")
    snow = jc.AreaLoads(faces, (0, 0, -700.0))
    solution = jc.solve(structure, [phases[0], jc.Phase(loads=snow)])
    assert int(solution.status) == 0
    # the rectangle of 10 x 8 m without its corners (a triangle of half a mesh each)
    assert float(solution.load[:, 2].sum()) == pytest.approx(-700 * (80 - 4 * 2), rel=1e-12)
    inner = np.argmin(np.linalg.norm(np.asarray(structure.nodes)[:, :2] - [4.0, 4.0], axis=1))
    assert float(solution.load[inner, 2]) == pytest.approx(-700 * 4.0, rel=1e-12)


def test_faces_of_a_net():
    """Meshes of a hexagonal star: six triangles inside, all anticlockwise, none outside."""
    angle = np.arange(6) * np.pi / 3
    rim = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    nodes = np.concatenate([rim, [[0.0, 0.0, 0.5]]])
    faces = jc.net_faces(nodes, [[k, 6] for k in range(6)], border="ends")
    assert faces.shape == (6, 4) and (faces[:, 2] == faces[:, 3]).all()
    assert {frozenset(face) for face in faces.tolist()} == {
        frozenset({k, (k + 1) % 6, 6}) for k in range(6)
    }
    corners = nodes[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (normals[:, 2] > 0).all()
    hexagon = jc.net_faces(rim, [[k, (k + 1) % 6] for k in range(6)])
    assert hexagon.shape == (4, 4)  # a mesh of six corners in four triangles
    same = jc.net_faces(nodes, [[k, (k + 1) % 6] for k in range(6)])  # no link touches node 6
    assert same.tolist() == hexagon.tolist()
    with pytest.raises(ValueError, match="the same place in plan"):
        jc.net_faces(np.concatenate([nodes, [[0.0, 0, 3]]]), [*([k, 6] for k in range(6)), [6, 7]])


CASES = {
    "dead": [jc.SelfWeight(), jc.LineLoads((0, 0, -5.0))],
    "snow": jc.LineLoads((0, 0, -40.0), per="projected"),
    "wind": jc.NodalLoads([1, 2], [[30.0, 0, 0], [20.0, 5.0, 0]]),
}
FACTORS = np.array([[1.35, 1.5, 0.9], [1.0, 0.0, 1.5]])


@pytest.mark.slow
def test_combinations_are_a_batch():
    """Mapped over, they are the analyses of the factored loads one by one."""
    structure = sloped(weight=3.0)
    first = jc.solve(structure, [jc.Phase(prestrain=0.02)])
    loads = jc.combine(CASES, FACTORS)

    def analyse(one):
        return jc.solve(structure, [jc.Phase(loads=one)], start=first, method=TIGHT)

    batch = jax.vmap(analyse)(loads)
    assert (np.asarray(batch.status) == 0).all()
    for row, tension in zip(FACTORS, batch.tension, strict=True):
        dead, snow, wind = row
        by_hand = [
            jc.SelfWeight((0, 0, -dead)),
            jc.LineLoads((0, 0, -5.0 * dead)),
            jc.LineLoads((0, 0, -40.0 * snow), per="projected"),
            jc.NodalLoads([1, 2], wind * np.array([[30.0, 0, 0], [20.0, 5.0, 0]])),
        ]
        single = analyse(by_hand)
        assert int(single.status) == 0
        assert jnp.abs(single.tension - tension).max() < 1e-9
    assert not np.allclose(batch.tension[0], batch.tension[1])
    (alone,) = jc.combine([jc.NodalLoads([1], (1.0, 2.0, 3.0))], [2.0])
    assert alone.forces.tolist() == [2.0, 4.0, 6.0]


def test_every_load_can_be_scaled():
    loads = [
        jc.SelfWeight(),
        jc.LineLoads((1.0, 2.0, 3.0)),
        jc.NodalLoads([1], (1.0, 2.0, 3.0), moments=(1.0, 1.0, 1.0)),
        jc.AreaLoads([[0, 1, 2]], (0, 0, -1.0)),
        jc.CablePressure(2.0, (0, 1, 0)),
        jc.FacePressure([[0, 1, 2]], 2.0),
        jc.SupportMovement([0], (0, 0, 1.0), (0.1, 0, 0)),
    ]
    for load in loads:
        (tripled,) = jc.combine([load], [3.0])
        before, after = jax.tree.leaves(load), jax.tree.leaves(tripled)
        # an axis, and forces that keep their direction beside their factor
        kept = isinstance(load, jc.CablePressure | jc.LineLoads | jc.AreaLoads)
        changed = [not np.allclose(a, b) for a, b in zip(before, after, strict=True)]
        assert sum(changed) == len(changed) - kept
    nothing, double = (jc.combine([loads[0]], [f])[0] for f in (0.0, 2.0))
    assert nothing.direction.tolist() == [0, 0, 0] and double.direction[2] == -2.0


@pytest.mark.slow
def test_a_factor_of_zero_has_the_derivative_of_the_load():
    """Loads are linear in their factor; the direction to look along does not vanish with it."""
    structure = sloped()

    def loads(factor):
        cases = [
            jc.LineLoads((0, 10.0, -50.0), per="projected"),
            jc.AreaLoads([[0, 1, 2]], (0, 5.0, -500.0)),
        ]
        solution = jc.solve(
            structure, [jc.Phase(prestrain=0.02), jc.Phase(loads=jc.combine(cases, factor))]
        )
        return solution.load

    zero, one = jnp.zeros(2), jnp.ones(2)
    rate = jax.jvp(loads, (zero,), (one,))[1]
    assert np.asarray(rate) == pytest.approx(np.asarray(loads(one)), rel=1e-12)
    assert float(jnp.abs(loads(zero)).max()) == 0.0


def test_projected_loads_on_a_running_rope_go_to_the_pieces_that_have_a_projection():
    nodes = [[0.0, 0, 0], [0.0, 0, 3.0], [4.0, 0, 3.0]]
    rope = jc.SlidingCables([[0, 1, 2]], axial_stiffness=1e5)
    structure = jc.Structure(nodes, rope, jc.pinned([0, 1, 2]))
    load = jc.LineLoads((0, 0, -10.0), per="projected")
    solution = jc.solve(structure, [jc.Phase(loads=load)])
    assert np.asarray(solution.load[:, 2]) == pytest.approx([0, -20, -20], abs=1e-14)


REFUSED = {
    "per": (lambda: jc.LineLoads((0, 0, 1.0), per="current"), "per = 'current': expected one of"),
    "area per": (lambda: jc.AreaLoads([[0, 1, 2]], (0, 0, 1.0), per="x"), "per = 'x'"),
    "area forces": (lambda: jc.AreaLoads([[0, 1, 2]], 1.0), r"forces: expected shape \(3,\)"),
    "factors": (lambda: jc.combine(CASES, [[1.0, 2.0]]), r"shape \[n_combination, 3\]"),
    "cases": (lambda: jc.combine([], [[]]), "at least one load case"),
    "no load": (lambda: jc.combine([3.0], [1.0]), r"cases\[0\]: float is not a load"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_refused(name):
    make, message = REFUSED[name]
    with pytest.raises(ValueError, match=message):
        make()


FACES = jc.net_faces(
    jc.scenes.saddle(2, 2).structure.nodes,
    jc.scenes.saddle(2, 2)[0].elements.links,
    border="ends",
)
NODES = jnp.asarray(jc.scenes.saddle(2, 2, rise=0.3).structure.nodes)


def on_saddle(load, nodes=NODES):
    structure, phases = jc.scenes.saddle(2, 2, rise=0.3)
    structure = jc.replace(structure, nodes=nodes)
    return jc.solve(structure, [phases[0], jc.Phase(loads=load)], TIGHT)


PARAMETERS = {
    "per initial length": (
        jnp.array([50.0, 10.0, -400.0]),
        lambda p: on_saddle(jc.LineLoads(p, per="initial")),
    ),
    "per projected length": (
        jnp.array([50.0, 10.0, -400.0]),
        lambda p: on_saddle(jc.LineLoads(p, per="projected")),
    ),
    "per area": (
        jnp.array([50.0, 10.0, -400.0]),
        lambda p: on_saddle(jc.AreaLoads(FACES, p)),
    ),
    "nodes under cladding": (
        NODES,
        lambda p: on_saddle(jc.AreaLoads(FACES, (0, 0, -400.0), per="initial"), p),
    ),
    "factors": (
        jnp.array([1.0, 2.0]),
        lambda p: on_saddle(
            jc.combine(
                [jc.LineLoads((0, 9.0, -99.0), per="projected"), jc.FacePressure(FACES, 100.0)], p
            )
        ),
    ),
}


# the rest, alike, in `make test-all`
QUICK = ("factors",)
NAMES = [pytest.param(n, marks=[] if n in QUICK else pytest.mark.slow) for n in PARAMETERS]


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_taylor(name):
    p, solve = PARAMETERS[name]

    @jax.jit
    def value(p):
        solution = solve(p)
        places = solution.displacement.ravel()
        return 1e3 * jnp.sum(jnp.sin(jnp.arange(len(places))) * places) + jnp.sum(
            jnp.log(solution.tension)
        )

    assert int(solve(p).status) == 0
    gradient = jax.jit(jax.grad(value))(p)
    size = 0.05 if name.startswith("nodes") else 50.0  # a load of 2 %, a place of millimetres
    assert slope(value, p, gradient, size) == pytest.approx(2, abs=0.1)
    assert slope(value, p, 1.1 * gradient, size) < 1.5
