"""Influence lines and trains: closed forms of a two-span beam, unit loads, brute force."""

import functools
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles.convergence import converged
from oracles.taylor import TIGHT, assert_gradient

import jaxcable as jc
from jaxcable import design

SPAN = 10.0
SECTION = jc.Section.rectangle(0.4, 0.8, jc.Elastic(30e9))
PATH = [0, 1, 2, 3]
"""Over two spans, where element 1 points backwards, or along a deck with stays."""
AXLES = jc.loads.Train(PATH, 0.0, [[0.0, 0, -60e3], [0, 0, -100e3]], spacings=[3.0])


def structure(stretch=1.0, stayed=False):
    """A beam of two spans, or a deck with two stays; `stretch` scales their lengths."""
    nodes = stretch * jnp.outer(5.0 * jnp.arange(5), jnp.array([1.0, 0, 0]))
    links = [[0, 1], [1, 2], [2, 3], [3, 4]] if stayed else [[0, 1], [2, 1], [2, 3], [3, 4]]
    supports = jc.restrained([0], "xyz", "x") + jc.restrained([4] if stayed else [2, 4], "yz")
    elements = {"deck": jc.Beams(links, section=SECTION)}
    if stayed:
        nodes = jnp.concatenate([nodes, stretch * jnp.array([[10.0, 0.0, 8.0]])])
        elements["stays"] = jc.Bars([[5, 1], [5, 3]], axial_stiffness=200e6)
        supports += jc.pinned([5])
    return jc.Structure(nodes, elements, supports)


def moments_and_reaction(solution):
    """Moment over the middle support, its reaction, moment and shear force of the first span."""
    forces, reactions = solution.section_forces["deck"], solution.reactions
    parts = forces[2, 0, 4], reactions[2, 2], forces[0, 2, 4], forces[0, 0, 2]
    return jnp.stack(parts)


def of_stayed(solution):
    """Moment at a stay, tension of a stay, deflection and moment within an element."""
    forces = solution.section_forces["deck"]
    parts = forces[1, 0, 4], solution.tension["stays"][0], forces[2, 1, 4], forces[0, 0, 2]
    return jnp.stack(parts)


@functools.lru_cache
def begun(stayed):
    """The state before loads: prestressed stays, if any."""
    tension = {"deck": None, "stays": 50e3} if stayed else None
    return converged(jc.solve(structure(stayed=stayed), jc.Phase(pretension=tension), TIGHT))


@functools.lru_cache
def line(stayed, of):
    given = structure(stayed=stayed), begun(stayed), PATH, of
    return design.influence_line(*given, on="deck", method=TIGHT)


@pytest.mark.slow
def test_forces_are_taken_some_at_a_time(monkeypatch):
    """Sixteen places on each element, five at a time, of which the last ones fill up a rest."""
    whole = line(False, moments_and_reaction)
    monkeypatch.setattr(sys.modules[design.influence_line.__module__], "_MOST_LOADS", 5)
    given = structure(), begun(False), PATH, moments_and_reaction
    parts = design.influence_line(*given, on="deck", method=TIGHT)
    # the same derivatives in another program, of moments in m
    np.testing.assert_allclose(parts.coefficients, whole.coefficients, atol=1e-9)
    np.testing.assert_array_equal(parts.stations, whole.stations)


def closed_form(x):
    """The four lines of `moments_and_reaction` in the signs of `section_forces`: sagging is < 0."""
    ratio = np.where(x <= SPAN, x, 2 * SPAN - x) / SPAN
    support = -SPAN / 4 * ratio * (1 - ratio**2)
    simple = np.where(x <= SPAN, np.minimum(x, SPAN - x) / 2, 0.0)
    shear = np.where(x <= SPAN, 1 - ratio, 0.0) + support / SPAN
    reaction = ratio - 2 * support / SPAN
    return np.stack([-support, reaction, -(simple + support / 2), -shear])


def test_lines_of_two_spans_are_closed_forms():
    found = line(False, moments_and_reaction)
    x = np.linspace(0.0, 2 * SPAN, 161)
    wanted = closed_form(x)
    wanted[3, 0] = -1.0  # the load at the first node is beyond the section there
    # residuals of 1e-13 of the forces
    assert np.abs(np.asarray(found.at(x)) - wanted)[:3].max() < 1e-10 * SPAN
    assert np.abs(np.asarray(found.at(x[1:])) - wanted[:, 1:])[3].max() < 1e-10
    # q L^2/8 over the support, 5/4 q L, q L^2/16 in the span (both loaded), 3/8 q L
    both = np.array([12.5, 12.5, -6.25, -3.75])
    assert np.abs(np.asarray(found.area()) - both).max() < 1e-10 * 12.5
    (parts, area), (other, rest) = found.adverse_parts(-1)[2], found.adverse_parts(1)[2]
    assert np.abs(parts - [[0.0, SPAN]]).max() < 1e-9 and area == pytest.approx(-9.375, rel=1e-10)
    assert np.abs(other - [[SPAN, 2 * SPAN]]).max() < 1e-9
    assert rest == pytest.approx(3.125, rel=1e-10)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("stayed", "of", "tol"), [(False, moments_and_reaction, 1e-10), (True, of_stayed, 1e-7)]
)
def test_lines_are_unit_loads_one_by_one(stayed, of, tol):
    """Of a beam that responds linearly, and of a stayed deck, whose response to 1 N is linear.

    The stays pull with 5e4 N: rounding of results of 4e4 in the change by 1 N.
    """
    x = np.array([0.7, 3.3, 7.5, 9.9, 12.5, 16.6, 19.0])
    found, change = np.asarray(line(stayed, of).at(x)), []
    for force in (1.0, -1.0):  # what is of second order cancels
        unit = jc.loads.Train(PATH, 0.0, (0.0, 0.0, -force), on="deck")
        every = design.moving_load(structure(stayed=stayed), begun(stayed), unit, x, TIGHT)
        assert (np.asarray(every.status) == 0).all()
        change.append(np.asarray(jax.vmap(of)(every)).T)
    size = np.abs(found).max(axis=1, keepdims=True)
    assert (np.abs(0.5 * (change[0] - change[1]) - found) / size).max() < tol


def test_worst_positions_are_those_of_brute_force():
    found = line(False, moments_and_reaction)
    for largest in (True, False):
        worst = design.worst_position(found, AXLES, largest=largest)
        x = np.concatenate([np.linspace(0.0, 23.0, 23001), np.asarray(worst.position)])
        every = 60e3 * np.asarray(found.at(x)) + 100e3 * np.asarray(found.at(x - 3.0))
        sign = 1 if largest else -1
        best = (sign * every[:, :-4]).max(axis=1)
        # the grid of 1 mm misses a smooth peak by 1e-8, and nothing is above the exact one
        assert (sign * worst.value >= best - 1e-9 * 1e6).all()
        assert (np.abs(sign * worst.value - best) < 1e-6 * np.abs(every).max()).all()
        # at the position, beside a jump on its better side
        at = every[np.arange(4), -4 + np.arange(4)]
        assert np.abs(at - worst.value).max() < 1e-6 * np.abs(every).max()


@pytest.mark.slow
def test_the_worst_position_holds_for_the_analysis_and_its_gradient():
    """The moment in the span: smallest by the line, analysed, and its derivative by the size."""
    worst = design.worst_position(line(False, moments_and_reaction), AXLES, largest=False)

    def moment(p, position):
        train = jc.replace(AXLES, position=position, forces=p[1] * AXLES.forces, on="deck")
        solution = jc.solve(structure(p[0]), [jc.Phase(), jc.Phase(loads=train)], TIGHT)
        return moments_and_reaction(solution)[2] / 1e5, solution.status

    p, position = np.array([1.0, 1.0]), float(worst.position[2])
    value, code = moment(p, position)
    # the beam responds linearly but for its deflection of millimeters
    assert int(code) == 0 and float(value) == pytest.approx(worst.value[2] / 1e5, rel=1e-4)
    # there an axle is at the node of the section, and the moment has a kink: a derivative beside it
    assert abs(position - 5.0) < 1e-12 or abs(position - 8.0) < 1e-12
    assert_gradient(lambda p: moment(p, position + 0.3), p, corrupted=1.1)


def test_line_at_one_distance():
    """A scalar gives the shape of the result: the triangle of the moment in the middle of 8 m."""
    triangle = np.array([[0.0, 2.0, 0, 0], [2.0, -2.0, 0, 0]])
    line = jc.design.InfluenceLine(
        np.array([0.0, 4.0, 8.0]), np.stack([triangle, 2 * triangle]), np.array([0.0, 0, -1]), None
    )
    found = line.at(3.0)
    assert found.shape == (2,)
    np.testing.assert_allclose(found, [1.5, 3.0], rtol=1e-14)
    assert jc.design.InfluenceLine(line.stations, triangle, line.direction, None).at(7).shape == ()
    with pytest.raises(ValueError, match=r"distances: expected a number or shape \[n\]"):
        line.at(np.zeros((2, 2)))
