"""Loads that follow: circular arcs, volumes, symmetric and unsymmetric tangents, Newton's rate."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles.taylor import TIGHT, slope

import jaxcable as jc
from jaxcable.analysis.preparation import prepare, ready
from jaxcable.common.tree import copy, fill
from jaxcable.mechanics.ramp import Ramp

AXIS = (0.0, -1.0, 0.0)  # a cable along x is pressed up, along axis x d


def arch(n=8, pressure=100.0, stiffness=1e5, slackness=1.2, per="current", free_end=False):
    """Cable of n elements along x between two points 4 m apart, longer than that, under pressure.

    It starts from a flat parabola. With `free_end` a stay that is not pressed holds the right end.
    """
    x = np.linspace(0, 4, n + 1)
    nodes = np.column_stack([x, 0 * x, 0.2 * x * (4 - x)])
    links = np.column_stack([np.arange(n), np.arange(1, n + 1)])
    elements = {"edge": jc.Cables(links, axial_stiffness=stiffness, rest_length=4 * slackness / n)}
    if free_end:
        nodes = np.concatenate([nodes, [[6.0, 0, -1.0]]])
        elements["stay"] = jc.Cables([[n, n + 1]], axial_stiffness=stiffness)
    mask = np.zeros((len(nodes), 3), bool)
    mask[:, 1] = mask[0] = mask[-1] = True
    structure = jc.Structure(nodes, elements, jc.Supports(mask))
    return structure, jc.Phase(loads=jc.CablePressure(pressure, AXIS, on="edge", per=per))


def test_a_pressed_cable_is_a_circular_arc():
    """n equal chords c of a circle of radius r, turning by phi: T = p r cos(phi/2).

    At a node 2 T sin(phi/2) balances half of the pressure on both chords, p c cos(phi/2), with
    c = 2 r sin(phi/2): the polygon is exact, not only its limit.
    """
    n = 8
    structure, phase = arch(n)
    solution = jc.solve(structure, [phase], TIGHT)
    assert int(solution.status) == 0
    places, tension = np.asarray(solution.positions), np.asarray(solution.tension["edge"])
    chord = 4.8 / n * (1 + tension[0] / 1e5)
    assert np.ptp(tension) < 1e-11 * tension.max()
    # the span of the arc, 2 r sin(n phi / 2) = 4, fixes phi
    low, high = 1e-6, 2 * np.pi / n
    for _ in range(100):
        phi = 0.5 * (low + high)
        radius = chord / (2 * np.sin(phi / 2))
        low, high = (phi, high) if 2 * radius * np.sin(n * phi / 2) > 4 else (low, phi)
    centre = np.array([2.0, 0, -radius * np.cos(n * phi / 2)])
    assert np.linalg.norm(places - centre, axis=1) == pytest.approx(radius, rel=1e-11)
    assert tension == pytest.approx(100 * radius * np.cos(phi / 2), rel=1e-11)


def test_pressure_is_in_balance_with_the_reactions():
    """On the whole cable it pushes like on its chord: p (axis x chord)."""
    structure, phase = arch()
    solution = jc.solve(structure, [phase], TIGHT)
    assert int(solution.status) == 0
    assert np.asarray(solution.load.sum(0)) == pytest.approx([0, 0, 400.0], abs=1e-10)
    assert np.asarray(solution.reactions.sum(0)) == pytest.approx([0, 0, -400.0], abs=1e-9)


def dense(matrix):
    return np.asarray(matrix.dense() if hasattr(matrix, "dense") else matrix)


def tangents(structure, phase):
    """At the end of a phase, a little out of place: as assembled, as Jacobian of the residual."""
    task = prepare(structure, phase, jc.Newton(linear_solver="dense"), None)

    @jax.jit
    def both(thawed):
        nodes, groups, carry, schedule = ready(fill(thawed, task.arrays), task.bundles)
        system = Ramp.build(nodes, groups, carry, schedule.phase(0)).at(1.0)
        step = 0.05 * np.random.default_rng(0).normal(size=len(system.freedoms.free))
        x = system.move(system.place(carry.motion), jnp.asarray(step))
        residual, zero, _ = system.chart(x)
        return system.tangent(x), jax.jacfwd(residual)(zero)

    return map(dense, both(task.thawed))


def asymmetry(structure, phase):
    """Of the assembled tangent, relative to what the load has in it."""
    tangent, jacobian = tangents(structure, phase)
    assert np.abs(tangent - jacobian).max() < 1e-13 * np.abs(jacobian).max()
    dead, _ = tangents(structure, jc.replace(phase, loads=phase.loads.scaled(0.0)))
    load = np.abs(tangent - dead).max()
    assert load > 0
    return np.abs(tangent - tangent.T).max() / load


def test_tangent_is_symmetric_with_fixed_ends():
    assert asymmetry(*arch()) < 1e-12  # eps EA/l over p


@pytest.mark.slow
def test_tangent_is_unsymmetric_with_a_free_end_or_per_unstressed_length():
    assert asymmetry(*arch(free_end=True)) > 0.1
    assert asymmetry(*arch(per="unstressed")) > 0.1


@pytest.mark.slow
@pytest.mark.parametrize("case", [{}, {"free_end": True}, {"per": "unstressed"}])
def test_newton_converges_quadratically(case):
    """The residual after k steps, from near the equilibrium: its digits double.

    The stiffness is low, so that the leading error term is not lost in rounding at once.
    """
    structure, phase = arch(stiffness=2e3, **case)
    near = jc.solve(
        structure,
        [
            jc.replace(
                phase, loads=jc.CablePressure(99.0, AXIS, on="edge", per=case.get("per", "current"))
            )
        ],
    )
    assert int(near.status) == 0
    more = jc.Phase(loads=jc.CablePressure(1.0, AXIS, on="edge", per=case.get("per", "current")))
    residuals = []
    for steps in (1, 2, 3):
        end = jc.solve(structure, [more], jc.Newton(tol=1e-13, max_steps=steps), start=near)
        residuals.append(float(end.phases[0].path.relative_residual[0]))
    assert int(jc.solve(structure, [more], TIGHT, start=near).status) == 0
    a, b, c = np.log(residuals)
    assert residuals[0] < 1e-2 and residuals[1] > 1e-11  # near it, and not yet rounding
    assert (c < np.log(1e-12)) or (c - b) / (b - a) > 1.7  # linear: 1, quadratic: 2
    assert b < 1.7 * a  # digits nearly double from the first step on, too


# --- faces


def pyramid(height=0.5, pressure=300.0, faces=None):
    """A node over a square of half-diagonal 1, four cables down its edges, four pressed faces."""
    nodes = [[1.0, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0], [0.1, 0.05, height]]
    cables = jc.Cables([[k, 4] for k in range(4)], axial_stiffness=1e4, rest_length=1.05)
    structure = jc.Structure(nodes, cables, jc.pinned([0, 1, 2, 3]))
    faces = [[k, (k + 1) % 4, 4] for k in range(4)] if faces is None else faces
    return structure, jc.Phase(loads=jc.FacePressure(faces, pressure))


def test_pressed_pyramid():
    """The top gets p/3 of the base area, whatever its height: 4 N h / l = p A / 3, A = 2."""
    structure, phase = pyramid()
    solution = jc.solve(structure, [phase], TIGHT)
    assert int(solution.status) == 0
    assert np.asarray(solution.load[4]) == pytest.approx([0, 0, 300 * 2 / 3], abs=1e-11)
    low, high = 0.0, 5.0
    for _ in range(100):
        h = 0.5 * (low + high)
        length = np.hypot(1, h)
        force = 1e4 * max(length / 1.05 - 1, 0)
        low, high = (h, high) if 4 * force * h / length < 200 else (low, h)
    assert np.asarray(solution.positions[4]) == pytest.approx([0, 0, h], abs=1e-10)


def volume(places, faces):
    """Volume between faces (quadrilaterals: the bilinear surface) and the plane z = 0."""
    total = 0.0
    for face in faces:
        x = places[list(face)]
        if len(face) == 3 or face[2] == face[3]:
            a, b, c = x[:3]
            total += np.cross(b - a, c - a)[2] / 2 * (a + b + c)[2] / 3
            continue
        t, w = np.polynomial.legendre.leggauss(3)
        t, w = 0.5 * (t + 1), 0.5 * w
        for s, ws in zip(t, w, strict=True):
            for r, wr in zip(t, w, strict=True):
                along = (1 - r) * (x[1] - x[0]) + r * (x[2] - x[3])
                across = (1 - s) * (x[3] - x[0]) + s * (x[2] - x[1])
                place = (1 - s) * ((1 - r) * x[0] + r * x[3]) + s * ((1 - r) * x[1] + r * x[2])
                total += ws * wr * np.cross(along, across)[2] * place[2]
    return total


def test_face_pressure_is_the_derivative_of_the_volume():
    """Inside a net of triangles and quadrilaterals: p dV/dx, V integrated by Gauss's rule."""
    rng = np.random.default_rng(3)
    structure, _ = jc.scenes.saddle(3, 3, spacing=1.0, rise=0.3)
    faces = jc.net_faces(structure.nodes, structure.elements.links, border="ends")
    places = np.asarray(structure.nodes) + 0.1 * rng.normal(size=structure.nodes.shape)
    load = jc.FacePressure(faces, 2.0)
    load = copy(load, faces=load.faces.array)
    force = np.asarray(load.following_forces([], [], None, jnp.asarray(places)))
    free = np.flatnonzero(~structure.supports.fixed(structure.n_node)[:, 0])
    h = 1e-5
    for node in free:
        for k in range(3):
            moved = [places.copy(), places.copy()]
            moved[0][node, k] -= h
            moved[1][node, k] += h
            rate = (volume(moved[1], faces) - volume(moved[0], faces)) / (2 * h)
            # V is cubic: h^2 and eps V / h
            assert force[node, k] == pytest.approx(2 * rate, abs=1e-9)


@pytest.mark.slow
def test_faces_of_an_even_pressure_have_a_symmetric_tangent():
    structure, _ = jc.scenes.saddle(3, 3, spacing=1.0, rise=0.3)
    faces = jc.net_faces(structure.nodes, structure.elements.links, border="ends")
    even = jc.Phase(loads=jc.FacePressure(faces, 100.0), pretension=1e3)
    assert asymmetry(structure, even) < 1e-9  # eps EA/l over p l
    uneven = jc.FacePressure(faces, np.linspace(50, 150, len(faces)))
    assert asymmetry(structure, jc.replace(even, loads=uneven)) > 0.01


# --- in an analysis


@pytest.mark.slow
def test_pressure_goes_on_following_in_later_phases():
    """A second phase of dead load, from a start too, is the same as both at once."""
    structure, phase = pyramid()
    dead = jc.NodalLoads([4], (20.0, 10.0, -30.0))
    together = jc.solve(structure, [jc.Phase(loads=[phase.loads, dead])], TIGHT)
    later = jc.solve(structure, [phase, jc.Phase(loads=dead)], TIGHT)
    again = jc.solve(structure, [jc.Phase(loads=dead)], TIGHT, start=jc.solve(structure, [phase]))
    for solution in (together, later, again):
        assert int(solution.status) == 0
        assert jnp.abs(solution.positions - together.positions).max() < 1e-11
    batch = jax.vmap(
        lambda f: (
            jc.solve(
                structure, [jc.Phase(loads=jc.NodalLoads([4], f))], TIGHT, start=later
            ).positions
        )
    )(jnp.zeros((3, 3)))
    assert jnp.abs(batch - together.positions[None]).max() < 1e-11


def test_large_nets_solve_sparse_unsymmetric_systems():
    """The same through SuperLU, with a pattern that the faces have their share in."""
    structure, _ = jc.scenes.saddle(4, 4, spacing=1.0, rise=0.1)
    faces = jc.net_faces(structure.nodes, structure.elements.links, border="ends")
    phases = [
        jc.Phase(pretension=2e4),
        jc.Phase(loads=jc.FacePressure(faces, np.linspace(1e3, 5e3, len(faces))), increments=2),
    ]
    dense, sparse = (
        jc.solve(structure, phases, jc.Newton(tol=1e-12, linear_solver=name))
        for name in ("dense", "superlu")
    )
    assert int(dense.status) == int(sparse.status) == 0
    assert jnp.abs(dense.displacement).max() > 5e-3
    assert jnp.abs(dense.displacement - sparse.displacement).max() < 1e-12


@pytest.mark.slow
def test_beside_beams():
    """A pressed cable from a clamped mast to the ground: all forces balance."""
    n = 6
    top = np.array([0.0, 0, 3.0])
    chain = top + np.linspace(0, 1, n + 1)[:, None] * (np.array([3.0, 0, 0]) - top)
    nodes = np.concatenate([[[0.0, 0, 0], [0, 0, 1.5]], chain])
    cable = np.column_stack([np.arange(2, n + 2), np.arange(3, n + 3)])
    section = jc.Section.disc(0.1, jc.Elastic(2e11), (4, 4))
    structure = jc.Structure(
        nodes,
        {
            "mast": jc.Beams([[0, 1], [1, 2]], section=section),
            "edge": jc.Cables(cable, axial_stiffness=1e6),
        },
        jc.clamped([0])
        + jc.pinned([n + 2])
        + jc.Supports(np.repeat(np.array([[False, True, False]]), n + 3, axis=0)),
    )
    pressure = jc.CablePressure(200.0, (0, 1, 0), on="edge")
    solution = jc.solve(
        structure,
        [jc.Phase(pretension={"edge": 2e3, "mast": None}), jc.Phase(loads=pressure)],
        TIGHT,
    )
    assert int(solution.status) == 0
    total = np.asarray(solution.load.sum(0))
    chord = np.asarray(solution.positions[n + 2] - solution.positions[2])
    assert total == pytest.approx(200 * np.cross([0, 1, 0], chord), rel=1e-12)
    assert np.asarray(solution.reactions.sum(0)) == pytest.approx(-total, rel=1e-9)


PARAMETERS = {
    "pressure": (jnp.full(8, 100.0), lambda p: jc.solve(
        arch()[0], [jc.Phase(loads=jc.CablePressure(p, AXIS, on='edge'))], TIGHT)),
    "axis": (jnp.array([0.1, -1.0, 0.05]), lambda p: jc.solve(
        arch(free_end=True)[0], [jc.Phase(loads=jc.CablePressure(100.0, p, on='edge'))], TIGHT)),
    "per unstressed length": (jnp.array([100.0, 0.6]), lambda p: jc.solve(
        arch(slackness=2 * p[1])[0],
        [jc.Phase(loads=jc.CablePressure(p[0], AXIS, on="edge", per="unstressed"))], TIGHT)),
    "nodes under face pressure": (jnp.asarray(pyramid()[0].nodes), lambda p: jc.solve(
        jc.replace(pyramid()[0], nodes=p), [pyramid()[1]], TIGHT)),
    "face pressure": (jnp.array([100.0, 200.0, 300.0, 250.0]), lambda p: jc.solve(
        pyramid()[0], [pyramid(pressure=p)[1], jc.Phase(loads=jc.NodalLoads([4], (9.0, 0, 0)))],
        TIGHT)),
}  # fmt: skip


# the rest, alike, in `make test-all`
QUICK = ("per unstressed length", "face pressure")
NAMES = [pytest.param(n, marks=[] if n in QUICK else pytest.mark.slow) for n in PARAMETERS]


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_taylor(name):
    """Unsymmetric tangents too: the adjoint solves with the transposed matrix."""
    p, solve = PARAMETERS[name]

    @jax.jit
    def value(p):
        solution = solve(p)
        places = solution.positions.ravel()
        return jnp.sum(jnp.sin(jnp.arange(len(places))) * places) + jnp.sum(
            jnp.log(jnp.concatenate(jax.tree.leaves(solution.tension)))
        )

    assert int(solve(p).status) == 0
    gradient = jax.jit(jax.grad(value))(p)
    assert slope(value, p, gradient) == pytest.approx(2, abs=0.1)
    assert slope(value, p, 1.1 * gradient) < 1.5


REFUSED = {
    "axis": (lambda: jc.CablePressure(1.0, (0, 0, 0)), "axis: is zero"),
    "axis shape": (lambda: jc.CablePressure(1.0, (0, 0)), r"axis: expected shape \(3,\)"),
    "per": (lambda: jc.CablePressure(1.0, AXIS, per="initial"), "per = 'initial': expected one of"),
    "key": (
        lambda: jc.solve(arch()[0], [jc.Phase(loads=jc.CablePressure(1.0, AXIS, on="x"))]),
        "on = 'x': no such key",
    ),
    "pressure shape": (
        lambda: jc.solve(
            arch()[0], [jc.Phase(loads=jc.CablePressure([1.0, 2.0], AXIS, on="edge"))]
        ),
        r"pressure: expected a scalar or shape \(8,\)",
    ),
    "faces": (lambda: jc.FacePressure([[0, 1]], 1.0), r"faces: expected node numbers \[n, 3\]"),
    "thin face": (
        lambda: jc.FacePressure([[0, 1, 2], [0, 1, 0]], 1.0),
        r"faces\[1\] = \[0, 1, 0\]: a face has at least 3",
    ),
    "unknown": (
        lambda: jc.solve(*pyramid(faces=[[0, 1, 9]])[:1], [pyramid(faces=[[0, 1, 9]])[1]]),
        r"faces\[0\] = \[0, 1, 9\]: the structure has nodes 0 to 4",
    ),
    "secant": (
        lambda: jc.solve(*arch()[:1], [arch()[1]], jc.Incremental(stiffness="secant")),
        "not with loads that follow",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_refused(name):
    make, message = REFUSED[name]
    with pytest.raises(ValueError, match=message):
        make()
