"""Laws given by points in whole structures: plastic strain, failure, fibres, their derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from banks.shapes import beam
from oracles.convergence import converged
from oracles.taylor import TIGHT, assert_gradient

import jaxcable as jc
from jaxcable.common import status

E, FY, HARD = 210e9, 235e6, 0.01
STEEL = jc.materials.steel(FY, E, HARD)
AREA = 1e-4


def one_bar(group=jc.Bars, law=STEEL):
    """One element of 2 m along x whose far end slides along x."""
    held = jc.pinned([0]) + jc.restrained([1], "yz")
    return jc.Structure([[0.0, 0, 0], [2.0, 0, 0]], group([[0, 1]], area=AREA, law=law), held)


def phases_to_forces(*forces, increments=4):
    """Phases that bring the force on node 1 to each of `forces` in turn."""
    steps = np.diff(np.concatenate([[0.0], forces]))
    return [
        jc.Phase(loads=jc.NodalLoads([1], (step, 0.0, 0.0)), increments=increments)
        for step in steps
    ]


def test_a_bar_pulled_past_yield_keeps_its_plastic_strain():
    force = 1.1 * FY * AREA
    solution = converged(jc.solve(one_bar(), phases_to_forces(force, 0.0)))
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
    reverse = converged(jc.solve(one_bar(), phases_to_forces(force, -1.05 * FY * AREA)))
    back = yielded - 2 * FY / E - 0.15 * FY / (HARD * E)
    assert float(reverse.displacement[1, 0]) / 2 == pytest.approx(back, rel=1e-9)


def test_a_reversible_bar_comes_back():
    law = jc.materials.steel(FY, E, HARD, unloading="reversible")
    force = 1.1 * FY * AREA
    solution = converged(jc.solve(one_bar(law=law), phases_to_forces(force, 0.01 * force)))
    assert float(solution.displacement[1, 0]) / 2 == pytest.approx(0.011 * FY / E, rel=1e-9)


@pytest.mark.slow_cases("newton")
@pytest.mark.parametrize("method", [None, jc.Incremental(2)], ids=["newton", "incremental"])
def test_a_link_loaded_beyond_its_curve_fails(method):
    law = jc.Polygonal([0.0, 0.01, 0.03], [0.0, 2e9, 2.2e9])
    structure = one_bar(jc.Cables, law)
    solution = jc.solve(structure, phases_to_forces(2.2e9 * AREA / 0.845, increments=10), method)
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


def plastic_tip_deflection(P, L, b, h, E, strength):
    """Of an elastic-perfectly-plastic rectangular cantilever (h along P > 0), up to collapse.

    (Py/P)2 (5 - (3 + P/Py) sqrt(3 - 2 P/Py)) times that at first yield Py = strength b h2 / 6 / L,
    collapse at 3/2 Py: Prager & Hodge, Theory of Perfectly Plastic Solids, ch. 2.
    """
    first = strength * b * h**2 / 6 / L
    p = P / first
    assert 1 < p < 1.5
    return first * L**3 / (3 * E * b * h**3 / 12) * (5 - (3 + p) * np.sqrt(3 - 2 * p)) / p**2


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*unstable")  # one fibre wide: nothing keeps it in its plane
def test_an_elastic_plastic_cantilever_loaded_and_released():
    """Moments and curvatures along the undeformed axis of a material without hardening."""
    b, h, length, n = 0.1, 0.2, 2.0, 6
    section = jc.Section.rectangle(b, h, jc.materials.steel(FY, E, 1e-5), (1, 40))
    structure = beam(n, section, length)
    load = 1.3 * FY * b * h**2 / 6 / length
    down, up = (jc.NodalLoads([n], (0, 0, sign * load)) for sign in (-1, 1))
    solution = converged(
        jc.solve(structure, [jc.Phase(loads=down, increments=6), jc.Phase(loads=up)])
    )
    exact = plastic_tip_deflection(load, L=length, b=b, h=h, E=E, strength=FY)
    elastic = load * length**3 / 3 / (E * b * h**3 / 12)
    # 6 elements and 40 fibres, and large against small displacements
    deflection = -float(solution.phases[0].displacement[n, 2])
    assert deflection == pytest.approx(exact, rel=5e-3) and exact > 1.03 * elastic
    left = -float(solution.displacement[n, 2])
    assert left == pytest.approx(exact - elastic, abs=5e-3 * exact)
    # outermost fibres at the clamp, and the rest of the stress after release
    stress = [np.asarray(jc.fibre_stress(structure, phase))[-1] for phase in solution.phases]
    assert np.abs(stress[0][0, 0]).max() == pytest.approx(FY, rel=1e-2)
    assert np.abs(stress[1]).max() > 0.05 * FY


# --- derivatives, through increments past yield and back

PRETENSION = np.array([2e3, 2.2e3, 1e3, 4.5e3])
# of one half; the other is its mirror: elastic unloading needs equal slopes at the origin
HALF = {"strain": STEEL.strain[3:], "stress": STEEL.stress[3:]}


def steel(strain, stress):
    """The law through its origin and two points on either side."""
    points = (jnp.concatenate([-v[::-1], jnp.zeros(1), v]) for v in (strain, stress))
    return jc.Polygonal(*points, "elastic")


def bar_net(p):
    """A node held by four bars, two in a vee, prestressed and pulled past yield."""
    nodes = [[-3.0, 0, 0], [3.0, 0.5, 0], [0.0, -2.0, 1.0], [0.0, 1.0, -8.0], [0.2, 0.1, -4.0]]
    law = steel(p["strain"], p["stress"])
    bars = jc.Bars([[0, 4], [1, 4], [2, 4], [3, 4]], area=AREA, law=law)
    phases = [
        jc.Phase(pretension=p["pretension"]),
        jc.Phase(loads=jc.NodalLoads([4], (3e3, -2e3, -4.6e4)), increments=3),
        jc.Phase(loads=jc.NodalLoads([4], (-1e3, 0.5e3, 2.5e4)), increments=2),
    ]
    return jc.solve(jc.Structure(nodes, bars, jc.pinned([0, 1, 2, 3])), phases, TIGHT)


def bent_beam(p):
    """A fibre cantilever stayed by a cable, bent past yield and half released."""
    section = jc.Section.rectangle(*p["dimensions"], steel(p["strain"], p["stress"]), (2, 6))
    beam = jc.Beams([[0, 1], [1, 2]], section=section, points=3)
    groups = {"beam": beam, "stay": jc.Cables([[3, 2]], axial_stiffness=2e6)}
    structure = jc.Structure(p["nodes"], groups, jc.clamped([0]) + jc.pinned([3]))
    down = jc.NodalLoads([2], (3e2, 2e2, -1.6e4), moments=(50.0, 0.0, 0.0))
    prestress = {"beam": None, "stay": p["pretension"]}
    phases = [
        jc.Phase(pretension=prestress, loads=down, increments=2),
        jc.Phase(loads=jc.NodalLoads([2], (0.0, 0.0, 7e3))),
    ]
    return jc.solve(structure, phases, TIGHT)


NODES = np.array([[0.0, 0, 0], [1.0, 0.02, 0], [2.0, 0, 0.01], [0.0, 0.3, 1.5]])
# every parameter at its start, and the analysis that takes them all (one compilation)
SCENES = {
    "bars": (HALF | {"pretension": PRETENSION}, bar_net),
    "beam": (
        HALF | {"dimensions": np.array([0.05, 0.08]), "nodes": NODES, "pretension": np.array(2e3)},
        bent_beam,
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("scene", SCENES)
def test_taylor(scene):
    start, analyse = SCENES[scene]

    def number(p):
        solution = analyse(p)
        u, tension = solution.displacement[-2:], jax.tree.leaves(solution.tension)
        forces = sum(jnp.sum(jnp.sin(1.0 + jnp.arange(t.size)) * t) for t in tension)
        moved = jnp.sum(jnp.asarray([3.0, 1.0, 2.0]) * u.sum(0))
        return 1e2 * moved + forces / 1e5, solution.status

    # hardly anything is left of the pretension after yield: steps that stand out of rounding
    assert_gradient(number, start, {"pretension": 50.0}, corrupted=1.05)
