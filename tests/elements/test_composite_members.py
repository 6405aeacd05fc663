"""Bars and cables of several laws: one spring in series with all of them, slack as a whole."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from banks.shapes import in_line
from oracles.convergence import converged
from oracles.traced import traced

import jaxcable as jc
from jaxcable import materials
from jaxcable.common.tree import copy_with
from jaxcable.elements import AxialState

E, FY, HARD = 210e9, 235e6, 0.01
STEEL = materials.steel(FY, E, HARD)
SOFT = jc.Elastic(50e9)

# --- by NumPy, written apart: two laws at one strain, one of which yields with kinematic hardening


def yielding(strain, memory):
    """Stress and plastic strain of bilinear steel after a step, by return mapping."""
    slope = HARD * E
    kinematic = E * slope / (E - slope)
    over = E * (strain - memory) - kinematic * memory
    flow = np.sign(over) * max(0.0, abs(over) - FY) / (E + kinematic)
    return E * (strain - memory - flow), memory + flow


def bisect(function, low, high):
    """Zero of a function that rises."""
    for _ in range(200):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if function(middle) < 0 else (low, middle)
    return 0.5 * (low + high)


class Cable:
    """Areas of steel and of an elastic core; slack where both together would be pushed."""

    def __init__(self, steel, core):
        self.steel, self.core, self.memory = steel, core, 0.0

    def sum(self, strain):
        return self.steel * yielding(strain, self.memory)[0] + self.core * 50e9 * strain

    def force(self, strain):
        return max(0.0, self.sum(strain))

    def kept(self, strain):
        """The strain of the fibres: in a slack cable that at which it went slack."""
        return strain if self.sum(strain) >= 0 else bisect(self.sum, strain, 1.0)

    def commit_memory(self, strain):
        self.memory = yielding(self.kept(strain), self.memory)[1]


# --- the law


SHARES = np.array([0.3, 0.7])
LAW = materials.Parallel((STEEL, SOFT), SHARES).tension_only()


@traced
def history(law, strains):
    """Stress, slope of the energy, slack, kept fibre stresses, inverse, and after settling."""

    def step(memory, e):
        stress, gradient = law.stress_at(e, memory), jax.grad(law.energy_at)(e, memory)
        settled = law.commit_memory(e, memory)
        again = law.stress_at(e, settled), law.commit_memory(e, settled) - settled
        fibres = law.stress_of_each_law(e, memory)
        found = law.strain_at(stress, memory)
        slack = law.is_slack(e, memory)
        return settled, (stress, gradient, slack, fibres, found, settled, again)

    return jax.lax.scan(step, np.zeros(law.n_memory), strains)[1]


def paths():
    rng = np.random.default_rng(3)
    out_and_back = np.concatenate(
        [np.linspace(0, 0.02, 9), np.linspace(0.02, -0.01, 15), np.linspace(-0.01, 0.03, 15)]
    )
    yield np.concatenate([out_and_back, rng.uniform(-0.01, 0.045, 81)])
    yield rng.uniform(-0.002, 0.004, 120)


@pytest.mark.parametrize("number", [0, 1])  # the program of the first is that of the second
def test_a_cable_of_two_laws_along_a_path(number):
    strains = list(paths())[number]
    got = jax.tree.map(np.asarray, history(LAW, strains))
    stress, gradient, slack, fibres, found, settled, (again, more) = got
    cable, expected, kept, memory = Cable(*SHARES), [], [], []
    for e in strains:
        expected.append(cable.force(e))
        kept.append(cable.kept(e))
        cable.commit_memory(e)
        memory.append(cable.memory)
    expected, kept = np.array(expected), np.array(kept)
    size = 1e-13 * E * 0.05  # rounding of stresses E e, over 120 increments
    assert np.abs(stress - expected).max() <= size
    assert np.abs(gradient - expected).max() <= size
    assert np.abs(again - expected).max() <= size
    # of the parallel part, which yields alone: E ep = (E - Et) p
    assert np.abs((1 - HARD) * settled[:, 0] - memory).max() <= 1e-13 * 0.05 / HARD
    assert np.abs(more).max() <= 1e-17  # what has settled stays
    # slack exactly where nothing is carried, and often enough
    assert (slack == (expected == 0))[np.array(strains) != 0].all()  # at rest it is taut
    assert 10 < slack.sum() < 110
    assert (stress[slack] == 0).all()
    # the fibres balance; in a slack cable they keep what they had when it went slack
    assert np.abs(SHARES @ np.array(fibres) - expected).max() <= 10 * size
    assert np.abs(fibres[1] - 50e9 * kept).max() <= 10 * size
    # rounding of a stress over the smallest slope: the core's
    assert np.abs(found - kept).max() <= 10 * size / 35e9


@pytest.mark.parametrize("held", [None, 3e3])
@pytest.mark.parametrize("kind", ["bar", "cable", "cable of two laws"])
def test_secant(kind, held):
    """K (u - u0) = f(u) - f(u0), from taut to slack and to longer, or under a jack."""
    rng = np.random.default_rng(2)
    make = jc.Bars if kind == "bar" else jc.Cables
    given = {"section": two_parts()} if "laws" in kind else {"axial_stiffness": 11e6}
    own = {} if "laws" in kind else given
    group = copy_with(make([[0, 1]], **given), links=None, **own)
    ends = np.array([[0.0, 0, 0], [1.0, 0.5, 0.2]])
    chord, memory = np.linalg.norm(ends[1]), np.array([2e-3]) if "laws" in kind else None
    state = AxialState(0.999 * chord, 0.001 * chord, held, memory=memory)

    @traced
    def secant(before, after):
        """Forces by the secant, their change, and tension and slackness before and after."""
        change = group.end_forces(state, ends, after) - group.end_forces(state, ends, before)
        matrix = group.secant(state, ends, before, after)
        by_secant = jnp.tensordot(matrix, after - before, 2)
        lopsided = jnp.abs(matrix - matrix.transpose(2, 3, 0, 1)).max()
        both = [
            (group.tension(state, ends, u), group.is_slack(state, ends, u)) for u in (before, after)
        ]
        return by_secant, change, both, lopsided

    slack = []
    for _ in range(10):
        found, change, both, lopsided = secant(*0.01 * rng.normal(size=(2, 2, 3)))
        # rounding of EA = 11 MN and of force over change of length
        assert np.abs(found - change).max() < 1e-7 and lopsided < 1e-7
        for tension, loose in both:
            assert bool(loose) == (float(tension) == 0)
            slack.append(bool(loose))
    assert any(slack) == (kind != "bar" and held is None) and not all(slack)


# --- cables in a structure


def two_parts(steel=STEEL):
    """Elastic core of 10 mm in a wall of 1 mm."""
    return jc.Section.composite(
        [jc.Section.disc(0.01, SOFT, (2, 2)), jc.Section.ring(0.012, 0.001, steel, (1, 6))]
    )


CORE, WALL = np.pi / 4 * 0.01**2, np.pi / 4 * (0.012**2 - 0.01**2)


@pytest.mark.slow
def test_pulled_past_yield_let_go_pushed_and_again():
    """Every increment against NumPy: displacement, tension, slackness and the sum of the fibres."""
    section = two_parts()
    cable = jc.Cables([[0, 1]], section=section)
    bar = jc.Bars([[1, 2]], axial_stiffness=1e6)
    structure = in_line({"cable": cable, "bar": bar}, 0.0, 5.0, 10.0)
    steps = {1.2e5: 5, -1.6e5: 8, 2.0e5: 6, -2.1e5: 4}  # loads of phases, N, and their increments
    ends = np.cumsum(list(steps))
    pulls = ((jc.NodalLoads([1], (force, 0.0, 0.0)), n) for force, n in steps.items())
    solution = converged(
        jc.solve(structure, [jc.Phase(loads=load, increments=n) for load, n in pulls])
    )
    cable, before, seen, most = Cable(WALL, CORE), 0.0, 0, 0.0
    for phase, end, n in zip(solution.phases, ends, steps.values(), strict=True):
        stress = np.asarray(jc.fibre_stress(structure, phase)["cable"])[:, 0]
        for k in range(n):
            load = before + (end - before) * (k + 1) / n

            def unbalanced(e, cable=cable, load=load):
                return cable.force(e) + 1e6 * e - load

            e = bisect(unbalanced, -0.5, 0.5)
            force, path = cable.force(e), phase.path
            # Newton stops at 1e-10 of forces of 1e5 N; the bar has 1 MN, over its 5 m
            assert -float(path.tension["bar"][k, 0]) == pytest.approx(1e6 * e, abs=1e-4)
            assert float(path.displacement[k, 1, 0]) == pytest.approx(5 * e, abs=1e-9)
            assert float(path.tension["cable"][k, 0]) == pytest.approx(force, abs=1e-3)
            assert int(path.n_slack[k]) == (force == 0)
            assert stress[k] @ np.asarray(section.area) == pytest.approx(force, abs=1e-3)
            cable.commit_memory(e)
            seen, most = seen + (force == 0), max(most, cable.memory)
        before = end
    assert 0 < seen < 15 and most > 0.01
    # at the end it is slack
    assert float(solution.tension["cable"][0]) == 0.0
    table = jc.report(structure, solution).tables["slack"]
    assert [row[:2] for row in table.rows] == [["cable", 0]]
    distance = float(jc.design.slack_distance(structure, solution)["cable"][0])
    assert distance == pytest.approx(e - cable.kept(e), rel=1e-7) and distance < -1e-3


# --- a spring in series


def pulled(section, compliance, forces):
    """Bars of 2 m side by side, each pulled by its own force."""
    n = len(forces)
    nodes = [[x, float(k), 0.0] for k in range(n) for x in (0.0, 2.0)]
    links = np.arange(2 * n).reshape(n, 2)
    held = jc.pinned(links[:, 0]) + jc.restrained(links[:, 1], "yz")
    group = jc.Bars(links, section=section, compliance=compliance)
    structure = jc.Structure(nodes, group, held)
    loads = jc.NodalLoads(links[:, 1], np.outer(forces, [1.0, 0.0, 0.0]))
    return structure, jc.solve(structure, jc.Phase(loads=loads))


def test_compliance_is_one_spring_beside_two_linear_laws():
    """Strain N (1 / EA + c); the fibres have that of N / EA alone."""
    one, two = jc.Elastic(210e9), jc.Elastic(70e9)
    section = jc.Section.composite(
        [jc.Section.disc(0.01, one, (2, 2)), jc.Section.ring(0.03, 0.01, two, (1, 6))]
    )
    ea = np.pi / 4 * (210e9 * 0.01**2 + 70e9 * (0.03**2 - 0.01**2))
    forces, springs = np.array([1e4, 3e4]), np.array([5e-8, 1e-8])
    structure, solution = pulled(section, springs, forces)
    assert int(solution.status) == 0
    strain = np.asarray(solution.displacement)[1::2, 0] / 2
    assert np.allclose(strain, forces * (1 / ea + springs), rtol=1e-9)  # Newton's 1e-10
    stress = np.asarray(jc.fibre_stress(structure, solution.phases[0]))[-1]
    assert np.allclose(stress[:, :4], (210e9 * forces / ea)[:, None], rtol=1e-9)
    assert np.allclose(stress[:, 4:], (70e9 * forces / ea)[:, None], rtol=1e-9)


def test_a_law_that_yields_in_series_with_a_spring():
    """Law level: past yield and back, virgin and yielded; the end of the curve moves with it."""
    spring, law = 2e-12, materials.Parallel((STEEL, SOFT), SHARES)
    soft = law.in_series_with_spring(0.5 * spring).in_series_with_spring(0.5 * spring)
    own = np.random.default_rng(1).uniform(-0.04, 0.04, 120)
    cable, memory = Cable(*SHARES), 0.0
    strains, expected = [], []
    for e in own:
        stress = cable.sum(e)
        memory = yielding(e, memory)[1]
        cable.memory = memory
        strains.append(e + spring * stress)
        expected.append(stress)
    stress, gradient, slack, _, found, _, (again, _) = history(soft, np.array(strains))
    size = 1e-13 * E * 0.05  # rounding of stresses E e, over 120 increments
    assert np.abs(stress - np.array(expected)).max() <= 10 * size
    assert np.abs(gradient - np.array(expected)).max() <= 10 * size
    assert np.abs(again - np.array(expected)).max() <= 10 * size
    assert np.abs(found - np.array(strains)).max() <= 100 * size / 35e9  # the smallest slope
    assert not np.asarray(slack).any()
    top = 0.3 * float(STEEL.stress[-1]) + 0.7 * 50e9 * 0.05
    assert np.allclose(soft.strain_limits, [-0.05 - spring * top, 0.05 + spring * top], rtol=1e-14)
    modulus = 0.3 * E + 0.7 * 50e9
    assert float(soft.modulus) == pytest.approx(modulus / (1 + spring * modulus), rel=1e-14)
    beyond = soft.is_ruptured(0.05 + spring * top * np.array([0.99, 1.01]))
    assert beyond.tolist() == [False, True]


def test_a_spring_in_series_counts_in_the_stiffness_along():
    """1 / (l / EA + c l) l: the spring has the strain c per force."""
    for stated in {"axial_stiffness": 2e5}, {"area": 1e-3, "law": jc.Elastic(2e8)}:
        plain = jc.Bars([[0, 1]], **stated).linear_axial_stiffness()
        soft = jc.Bars([[0, 1]], compliance=5e-6, **stated)
        np.testing.assert_allclose(plain, [2e5], rtol=1e-15)
        np.testing.assert_allclose(soft.linear_axial_stiffness(), [1e5], rtol=1e-15)
        one = jc.elements.prestress.single_element(
            soft, {k: v[0] for k, v in soft.properties().items()}
        )
        np.testing.assert_allclose(one.force(1e-3), 1e5 * 1e-3, rtol=1e-14)
