"""Laws given by points in whole structures: plastic strain, failure, fibres, their derivatives."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from banks import problems
from oracles.taylor import slope

import jaxcable as jc
from jaxcable.common import status

E, FY, HARD = 210e9, 235e6, 0.01
STEEL = jc.materials.steel(FY, E, HARD)
AREA = 1e-4


def one_bar(group=jc.Bars, law=STEEL, length=2.0, **options):
    """One element along x whose far end slides along x."""
    nodes = np.array([[0.0, 0, 0], [length, 0, 0]])
    mask = np.array([[1, 1, 1], [0, 1, 1]], bool)
    return jc.Structure(nodes, group([[0, 1]], area=AREA, law=law, **options), jc.Supports(mask))


def pulled(*forces, increments=4):
    """Phases that bring the force on node 1 to each of `forces` in turn."""
    steps = np.diff(np.concatenate([[0.0], forces]))
    return [
        jc.Phase(loads=jc.NodalLoads([1], (step, 0.0, 0.0)), increments=increments)
        for step in steps
    ]


def test_a_bar_pulled_past_yield_keeps_its_plastic_strain():
    force = 1.1 * FY * AREA
    solution = jc.solve(one_bar(), pulled(force, 0.0))
    assert int(solution.status) == 0
    first, second = solution.phases
    yielded = FY / E + 0.1 * FY / (HARD * E)
    residual = yielded - 1.1 * FY / E
    # strains of 1e-2 with a stress that is met to 1e-10
    assert float(first.displacement[1, 0]) / 2 == pytest.approx(yielded, rel=1e-9)
    assert float(solution.displacement[1, 0]) / 2 == pytest.approx(residual, rel=1e-9)
    assert abs(float(solution.tension[0])) < 1e-9 * force
    stress = np.asarray(jc.fibre_stress(one_bar(), second))[:, 0]
    assert np.abs(stress - 1.1 * FY * np.array([0.75, 0.5, 0.25, 0])).max() < 1e-8 * FY
    # backwards it yields when the stress has changed by twice the yield stress (Masing)
    reverse = jc.solve(one_bar(), pulled(force, -1.05 * FY * AREA))
    assert int(reverse.status) == 0
    back = yielded - 2 * FY / E - 0.15 * FY / (HARD * E)
    assert float(reverse.displacement[1, 0]) / 2 == pytest.approx(back, rel=1e-9)


def test_a_reversible_bar_comes_back():
    law = jc.materials.steel(FY, E, HARD, unloading="reversible")
    force = 1.1 * FY * AREA
    solution = jc.solve(one_bar(law=law), pulled(force, 0.01 * force))
    assert int(solution.status) == 0
    assert float(solution.displacement[1, 0]) / 2 == pytest.approx(0.011 * FY / E, rel=1e-9)


def vee(law):
    """Two links in a vee, symmetric: node 2 hangs from 0 and 1; loaded downwards."""
    nodes = np.array([[-3.0, 0, 0], [3.0, 0, 0], [0, 0, -4.0]])
    mask = np.ones((3, 3), bool)
    mask[2, 2] = False
    cables = jc.Cables([[0, 2], [1, 2]], area=AREA, law=law)
    return jc.Structure(nodes, cables, jc.Supports(mask))


def test_a_net_pulled_past_yield_and_released():
    """A vee of cables that slackens when it is released: longer by the plastic strain."""
    law = jc.materials.strand(1860e6, 195e9)
    down = jc.Phase(loads=jc.NodalLoads([2], (0, 0, -2 * 0.8 * 1700e6 * AREA)), increments=5)
    up = jc.Phase(loads=jc.NodalLoads([2], (0, 0, 1.95 * 0.8 * 1700e6 * AREA)), increments=3)
    solution = jc.solve(vee(law), [down, up])
    assert int(solution.status) == 0
    loaded = solution.phases[0]
    stress = float(loaded.tension[0]) / AREA
    proof, slope_after = 0.9 * 1860e6, 0.1 * 1860e6 / (0.02 / 0.9 - 0.9 * 1860e6 / 195e9)
    assert stress > proof
    strain = proof / 195e9 + (stress - proof) / slope_after
    # geometry and law agree, and so do they after release along the elastic slope
    assert np.hypot(3, 4 - float(loaded.displacement[2, 2])) / 5 - 1 == pytest.approx(
        strain, rel=1e-9
    )
    memory = strain - stress / 195e9
    rest = float(solution.tension[0]) / AREA
    now = np.hypot(3, 4 - float(solution.displacement[2, 2])) / 5 - 1
    assert 0 < rest < 0.2 * stress
    assert now == pytest.approx(memory + rest / 195e9, rel=1e-9)
    problems.assert_balanced(solution)


@pytest.mark.parametrize("method", [None, jc.Incremental(2)], ids=["newton", "incremental"])
def test_a_link_loaded_beyond_its_curve_fails(method):
    law = jc.Polygonal([0.0, 0.01, 0.03], [0.0, 2e9, 2.2e9])
    structure = one_bar(jc.Cables, law)
    solution = jc.solve(structure, pulled(2.2e9 * AREA / 0.845, increments=10), method)
    assert int(solution.status) == status.MATERIAL_FAILURE
    path = solution.phases[0].path
    assert (np.asarray(path.status) == [0] * 8 + [status.MATERIAL_FAILURE] * 2).all()
    # bracketed: 0.8 of the load is carried, 0.9 is not, the law says 0.845
    assert float(solution.last.load_factor) == pytest.approx(0.8)
    assert float(solution.last.tension[0]) == pytest.approx(2.2e9 * AREA * 0.8 / 0.845, rel=1e-9)
    assert np.isnan(np.asarray(solution.displacement)).all()
    assert np.isnan(np.asarray(path.strain)[8:]).all() and not np.isnan(path.strain[:8]).any()
    with pytest.raises(jc.AnalysisError, match=r"increment 9 of 10.*end of its stress-strain"):
        jc.raise_if_failed(solution)


def test_plastic_strains_freeze_at_a_failure():
    force = FY * AREA
    solution = jc.solve(one_bar(), [*pulled(1.1 * force), *pulled(9.0 * force, increments=3)])
    assert int(solution.status) == status.MATERIAL_FAILURE
    again = jc.solve(one_bar(), pulled(-1.1 * force), start=solution.last)
    assert int(again.status) == 0
    expected = 0.1 * FY * (1 / (HARD * E) - 1 / E)
    assert float(again.positions[1, 0]) / 2 - 1 == pytest.approx(expected, rel=1e-9)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:supports of phases:jaxcable.InputWarning")  # both are held
def test_a_section_collapses_to_one_area_and_law_in_a_cable():
    core = jc.materials.tension_only(50e9)
    wire = jc.Polygonal([-0.03, 0.0, 0.008, 0.03], [-6e9, 0.0, 1.6e9, 2e9])
    section = jc.Section.composite(
        [jc.Section.disc(0.004, core, (4, 4)), jc.Section.ring(0.012, 0.004, wire, (2, 16))]
    )
    nodes = np.array([[0.0, 0, 0], [2.0, 0, 0]])
    mask = np.array([[1, 1, 1], [0, 1, 1]], bool)
    structure = jc.Structure(nodes, jc.Cables([[0, 1]], section=section), jc.Supports(mask))
    strain = 0.015
    inner, outer = np.pi * 0.002**2, np.pi * (0.006**2 - 0.002**2)
    stress = np.interp(strain, wire.strain, wire.stress)
    force = inner * 50e9 * strain + outer * stress
    solution = jc.solve(structure, pulled(force))
    assert int(solution.status) == 0
    assert float(solution.displacement[1, 0]) / 2 == pytest.approx(strain, rel=1e-9)
    fibres = np.asarray(jc.fibre_stress(structure, solution.phases[0]))[-1, 0]
    assert fibres.shape == (16 + 32,)
    assert np.abs(fibres[:16] / (50e9 * strain) - 1).max() < 1e-9
    assert np.abs(fibres[16:] / stress - 1).max() < 1e-9
    # and it is prestressed through the same curve
    mask[1, 0] = True
    held = jc.Structure(nodes, structure.elements, jc.Supports(mask))
    tension = jc.solve(held, [jc.Phase(pretension=force)])
    assert int(tension.status) == 0
    assert float(tension.rest_length[0]) == pytest.approx(2 / (1 + strain), rel=1e-12)
    with pytest.raises(ValueError, match=r"pretension\[0\].*within the curve"):
        jc.solve(held, [jc.Phase(pretension=2 * force)])


# --- beams of fibres


def cantilever(section, n=4, length=2.0):
    nodes = np.zeros((n + 1, 3))
    nodes[:, 0] = np.linspace(0, length, n + 1)
    links = np.column_stack([np.arange(n), np.arange(1, n + 1)])
    return jc.Structure(nodes, jc.Beams(links, section=section), jc.clamped([0]))


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*unstable")  # one fibre wide: nothing keeps it in its plane
def test_an_elastic_plastic_cantilever_loaded_and_released():
    """Moment-curvature of the bilinear rectangle integrated along the undeformed axis."""
    b, h, length, n = 0.1, 0.2, 2.0, 6
    section = jc.Section.rectangle(b, h, STEEL, (1, 40))
    inertia = b * h**3 / 12
    moment_y = FY * b * h**2 / 6
    load = 1.3 * moment_y / length
    tip = jc.NodalLoads([n], (0, 0, -load))
    phases = [jc.Phase(loads=tip, increments=6), jc.Phase(loads=jc.NodalLoads([n], (0, 0, load)))]
    structure = cantilever(section, n, length)
    solution = jc.solve(structure, phases)
    assert int(solution.status) == 0

    def moment(k):  # bilinear rectangle, first loading
        ky = FY / E / (h / 2)
        plastic = moment_y * (1.5 - 0.5 * (ky / np.maximum(k, ky)) ** 2)
        return np.where(k <= ky, E * inertia * k, (1 - HARD) * plastic + HARD * E * inertia * k)

    k = np.linspace(0, 0.2, 400001)
    x = (np.arange(20000) + 0.5) / 20000 * length
    curvature = np.interp(load * (length - x), moment(k), k)
    deflection = np.sum(curvature * (length - x)) * length / 20000
    elastic = load * length**3 / 3 / (E * inertia)
    first = -float(solution.phases[0].displacement[n, 2])
    # 6 elements and 40 fibres, and large against small displacements
    assert first == pytest.approx(deflection, rel=5e-3)
    assert -float(solution.displacement[n, 2]) == pytest.approx(
        deflection - elastic, abs=5e-3 * deflection
    )
    # outermost fibres at the clamp, and the rest of the stress after release
    stress = np.asarray(jc.fibre_stress(structure, solution.phases[0]))[-1, 0, 0]
    assert np.abs(stress).max() > FY and np.abs(stress).max() < 1.05 * FY
    left = np.asarray(jc.fibre_stress(structure, solution.phases[1]))[-1]
    assert np.abs(left).max() > 0.05 * FY


# --- derivatives


def bar_net(law):
    """A node held by four bars, two in a vee, prestressed and pulled past yield."""
    nodes = [[-3.0, 0, 0], [3.0, 0.5, 0], [0.0, -2.0, 1.0], [0.0, 1.0, -8.0], [0.2, 0.1, -4.0]]
    bars = jc.Bars([[0, 4], [1, 4], [2, 4], [3, 4]], area=AREA, law=law)
    return jc.Structure(nodes, bars, jc.pinned([0, 1, 2, 3]))


PRETENSION = np.array([2e3, 2.2e3, 1e3, 4.5e3])
LOAD, BACK = np.array([3e3, -2e3, -4.6e4]), np.array([-1e3, 0.5e3, 2.5e4])


def past_yield(structure, tension=PRETENSION):
    return jc.solve(
        structure,
        [
            jc.Phase(pretension=tension),
            jc.Phase(loads=jc.NodalLoads([4], LOAD), increments=3),
            jc.Phase(loads=jc.NodalLoads([4], BACK), increments=2),
        ],
        jc.Newton(tol=1e-13),
    )


# of one half; the other is its mirror: elastic unloading needs equal slopes at the origin
HALF = tuple(np.asarray(v)[3:] for v in (STEEL.strain, STEEL.stress))


def bent(section, tension=2e3, nodes=None):
    """A fibre cantilever stayed by a cable, bent past yield and half released."""
    structure = jc.Structure(
        jnp.asarray([[0.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0], [0.0, 0.3, 1.5]])
        if nodes is None
        else nodes,
        {
            "beam": jc.Beams([[0, 1], [1, 2]], section=section, points=3),
            "stay": jc.Cables([[3, 2]], axial_stiffness=2e6),
        },
        jc.clamped([0]) + jc.pinned([3]),
    )
    down = jc.NodalLoads([2], (3e2, 2e2, -1.6e4), moments=(50.0, 0.0, 0.0))
    up = jc.NodalLoads([2], (0.0, 0.0, 7e3))
    return jc.solve(
        structure,
        [
            jc.Phase(pretension={"beam": None, "stay": tension}, loads=down, increments=2),
            jc.Phase(loads=up),
        ],
        jc.Newton(tol=1e-13),
    )


def steel(strain=HALF[0], stress=HALF[1]):
    """The law through its origin and two points on either side."""

    def whole(v):
        v = jnp.asarray(v)
        return jnp.concatenate([-v[::-1], jnp.zeros(1), v])

    strain, stress = whole(strain), whole(stress)
    return jc.Polygonal(strain, stress, "elastic")


def rectangle(width=0.05, height=0.08, law=STEEL):
    return jc.Section.rectangle(width, height, law, (2, 6))


NODES = np.array([[0.0, 0, 0], [1.0, 0.02, 0], [2.0, 0, 0.01], [0.0, 0.3, 1.5]])
# start of every parameter, and the analysis that takes them all (one compilation)
SCENES = {
    "bars": (
        {"strain": HALF[0], "stress": HALF[1], "pretension": PRETENSION},
        lambda p: past_yield(bar_net(steel(p["strain"], p["stress"])), p["pretension"]),
    ),
    "beam": (
        {
            "strain": HALF[0],
            "stress": HALF[1],
            "dimensions": np.array([0.05, 0.08]),
            "nodes": NODES,
            "pretension": np.array(2e3),
        },
        lambda p: bent(
            rectangle(*p["dimensions"], steel(p["strain"], p["stress"])),
            p["pretension"],
            p["nodes"],
        ),
    ),
}


@functools.cache
def differentiable(scene):
    """Parameters, value, status and gradient of a measure of displacements and tensions."""
    start, analyse = SCENES[scene]

    @jax.jit
    @functools.partial(jax.value_and_grad, has_aux=True)
    def f(p):
        solution = analyse(p)
        u, tension = solution.displacement[-2:], jax.tree.leaves(solution.tension)
        forces = sum(jnp.sum(jnp.sin(1.0 + jnp.arange(t.size)) * t) for t in tension)
        return jnp.sum(
            jnp.asarray([3.0, 1.0, 2.0]) * u.sum(0)
        ) * 1e2 + forces / 1e5, solution.status

    (_, code), gradient = f(start)
    return start, lambda p: f(p)[0][0], int(code), gradient


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scene", "name"),
    [  # the beam takes forty seconds to compile
        pytest.param(scene, name, marks=pytest.mark.slow if scene == "beam" else [])
        for scene, (start, _) in SCENES.items()
        for name in start
    ],
)
def test_taylor(scene, name):
    """Through two increments past yield and one back, for each parameter."""
    start, value, code, gradient = differentiable(scene)
    assert code == 0

    def along(p):
        return value({**start, name: p})

    # hardly anything is left of the pretension after yield: steps that stand out of rounding
    size = 50.0 if name == "pretension" else 1.0
    assert abs(slope(along, start[name], gradient[name], size) - 2) < 0.1
    k = np.unravel_index(np.abs(gradient[name]).argmax(), gradient[name].shape)
    wrong = gradient[name].at[k].multiply(1.05)
    assert slope(along, start[name], wrong, size) < 1.5
