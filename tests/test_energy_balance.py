"""Energy balance: closed forms of each work, and all scenes at the order of the increments."""

import jax
import numpy as np
import pytest

import jaxcable as jc


def balance_of(structure, phases, method=None):
    solution = jc.solve(structure, phases, method)
    assert int(solution.status) == 0
    return jc.energy_balance(structure, phases, solution), solution


def line(group, *held_x):
    """Elements along x between nodes 2 m apart, which move along x unless held."""
    n = len(group.links) + 1
    nodes = np.column_stack([2.0 * np.arange(n), np.zeros((n, 2))])
    mask = np.ones((n, 3), bool)
    mask[[k for k in range(n) if k not in held_x], 0] = False
    return jc.Structure(nodes, group, jc.Supports(mask))


def test_works_in_a_line_of_bars():
    """Forces linear in displacements: the trapezoidal rule is exact, and all is by hand.

    1 mm is pulled out of one of two bars, 100 N act between them, a support is moved by 1 mm, and
    20 K cool it all.
    """
    bars = jc.Bars([[0, 1], [1, 2]], axial_stiffness=2e5, expansion=1e-5, rest_length=2.0)
    moved = jc.SupportMovement([2], (1e-3, 0, 0))
    phases = [
        jc.Phase(shortening=jc.only([0], 1e-3)),
        jc.Phase(loads=jc.NodalLoads([1], (100.0, 0, 0)), increments=2),
        jc.Phase(loads=moved),
        jc.Phase(temperature=-20.0),
    ]
    balance, _ = balance_of(line(bars, 0, 2), phases)
    first, second = 2e5 / 1.999, 2e5 / 2.0  # stiffnesses, N/m
    both, chain = first + second, first * second / (first + second)
    assert balance.level[0] == pytest.approx(0.5 * chain * 1e-6, rel=1e-9)
    # EA/L0 changes by 5e-4 in one step of the rule
    assert balance.prestress[0] == pytest.approx(0.5 * chain * 1e-6, rel=5e-4)
    assert balance.dead[1] == pytest.approx(100.0**2 / (2 * both), rel=1e-9)
    force = chain * 1e-3 - second * 100.0 / both  # in the second bar before the support moves
    assert balance.supports[2] == pytest.approx((force + 0.5 * chain * 1e-3) * 1e-3, rel=1e-6)
    assert balance.dead[2] == pytest.approx(100.0 * 1e-3 * second / both, rel=1e-6)
    assert balance.prestress[3] > 0 and (balance.prestress[1:3] == 0).all()
    assert balance.relative[1:3].max() < 1e-9 and balance.relative.max() < 5e-4


def test_dissipation_of_a_bar_that_yields():
    """To five times its yield strain and back to none: sigma_y e_p per volume, once and again."""
    area, modulus, yielded = 1e-4, 200e9, 1e-3
    law = jc.Polygonal(
        [-0.1, -yielded, 0, yielded, 0.1],
        np.array([-1, -1, 0, 1, 1]) * modulus * yielded,
        "elastic",
    )
    bar = jc.Bars([[0, 1]], area=area, law=law)
    structure = line(bar, 0, 1)
    move = [(5e-3 * 2.0, 0, 0), (-5e-3 * 2.0, 0, 0)]
    phases = [jc.Phase(loads=jc.SupportMovement([1], d), increments=5) for d in move]
    balance, _ = balance_of(structure, phases)
    volume, stress = area * 2.0, modulus * yielded
    # forward 4 strains of yielding; back 5, of which 2 are elastic
    expected = stress * yielded * volume * np.array([4.0, 3.0])
    assert balance.dissipated == pytest.approx(expected, rel=1e-9)
    assert balance.level == pytest.approx(0.5 * stress * yielded * volume, rel=1e-9)
    # increments end at the corners: the trapezoidal rule is exact
    assert balance.imbalance == pytest.approx(0, abs=1e-9 * expected.sum())


def test_a_beam_is_bent_within():
    """One element under a line load: q^2 L^5 / 40 EI, of which the nodes see less."""
    section = jc.Section.rectangle(0.04, 0.1, jc.Elastic(20e9))
    beam = jc.Beams([[0, 1]], section=section)
    structure = jc.Structure([[0.0, 0, 0], [2.0, 0, 0]], beam, jc.clamped([0]))
    phases = [jc.Phase(loads=jc.LineLoads((0, 0, -10.0)))]
    balance, _ = balance_of(structure, phases)
    stiffness = 20e9 * 0.04 * 0.1**3 / 12
    # deflections of 3e-4 of the length: quadratic terms of 1e-7
    assert balance.dead[0] == pytest.approx(10.0**2 * 2.0**5 / (40 * stiffness), rel=1e-5)
    assert balance.relative[0] < 1e-5


def area_under(places):
    """Between a polygon [n, 3] and z = 0, in its x-z plane, m2."""
    x, z = places[:, 0], places[:, 2]
    return 0.5 * float(((x[1:] - x[:-1]) * (z[1:] + z[:-1])).sum())


def test_pressure_does_the_work_of_the_area():
    """p times the area that a pressed cable takes in, held at its pressure: by the shoelace."""
    n, p = 4, 100.0
    x = np.linspace(0, 4, n + 1)
    nodes = np.column_stack([x, 0 * x, 0.2 * x * (4 - x)])
    links = np.column_stack([np.arange(n), np.arange(1, n + 1)])
    cables = jc.Cables(links, axial_stiffness=1e5, rest_length=4.8 / n)
    mask = np.zeros((n + 1, 3), bool)
    mask[:, 1] = mask[0] = mask[-1] = True
    structure = jc.Structure(nodes, cables, jc.Supports(mask))
    first = jc.Phase(loads=jc.CablePressure(p, (0, -1.0, 0)))
    pull = jc.Phase(loads=jc.NodalLoads([n // 2], (0, 0, 30.0)), increments=8)
    balance, solution = balance_of(structure, [first, pull])
    before, after = (np.asarray(phase.positions) for phase in solution.phases)
    grown = area_under(after) - area_under(before)
    assert abs(grown) > 1e-3
    # quadratic force over one increment: 1/8^2 of the curvature of the path
    assert balance.following[1] == pytest.approx(p * grown, rel=1e-2)
    assert balance.relative[1] < 1e-3


def rates(make, increments, keep=None):
    """Relative imbalance at some increments and twice as many, [2, n_phase], and its order."""
    found = []
    for n in (increments, 2 * increments):
        structure, phases = make()
        phases = [jc.replace(phase, increments=n) for phase in phases]
        found.append(balance_of(structure, phases)[0])
    apart = np.array([balance.relative for balance in found])
    return apart, found[-1]


def assert_of_second_order(apart, bound):
    """Below the bound, and a quarter at twice the increments unless it is rounding."""
    assert (apart[1] < bound).all(), apart
    counts = apart[0] > 1e-9
    order = np.log2(apart[0][counts] / apart[1][counts])
    assert (order > 1.7).all() and (order < 2.6).all(), (apart, order)


def test_imbalance_of_a_net_is_of_second_order():
    apart, balance = rates(jc.scenes.flat_net, 10)
    # loads of 150 N bend the path by its whole curvature: (1/20)^2 of the work
    assert_of_second_order(apart, 0.5 / 20**2 * 2)
    # the same from forces and places that results show: sum of N^2 L0 / 2 EA
    structure, phases = jc.scenes.flat_net()
    solution = jc.solve(structure, phases)
    stored = float((solution.tension**2 * solution.rest_length).sum()) / (2 * 97.97e3)
    assert balance.level[1] == pytest.approx(stored, rel=1e-9)


def test_forces_that_are_not_those_of_the_energy_are_seen(monkeypatch):
    """Half a percent more energy than the forces have is an imbalance that does not fall."""
    from jaxcable.elements import Bars

    right = Bars.energy_per_length
    monkeypatch.setattr(
        Bars, "energy_per_length", lambda self, e, plastic=None: 1.005 * right(self, e, plastic)
    )
    jax.clear_caches()
    try:
        apart, _ = rates(jc.scenes.flat_net, 20)
    finally:
        jax.clear_caches()
    assert apart[1, 1] > 0.003 and apart[1, 1] > 0.6 * apart[0, 1]


def test_refused():
    structure, phases = jc.scenes.flat_net(load=15.0)
    solution = jc.solve(structure, phases)
    with pytest.raises(ValueError, match="phases: 1 of them, the solution has 2"):
        jc.energy_balance(structure, phases[:1], solution)
