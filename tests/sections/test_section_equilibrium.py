"""Strains of a section from its forces: random forces, the capacity, derivatives."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles.fibres import LONG, REVERSIBLE, SECTIONS, STEEL_YIELD, law_sum, sizes
from oracles.taylor import assert_gradient
from oracles.traced import traced

import jaxcable as jc
from jaxcable import materials
from jaxcable.common import status
from jaxcable.sections import Section

# --- equilibrium of the section


@traced
def solve(section, target):
    return section.strains(*target.T)


@traced
def tangents(section, strains):
    return section.forces_and_tangent(*strains.T)[1]


def feasible(section, n=1000, seed=5):
    """Random strains up to just before the end of the first fibre, most of them small."""
    rng = np.random.default_rng(seed)
    y, z = np.asarray(section.y), np.asarray(section.z)
    size = max(np.abs(y).max(), np.abs(z).max())
    way = rng.normal(size=(n, 3))
    way = way / np.linalg.norm(way, axis=1, keepdims=True) / [1, size, size]
    rate = way[:, :1] + way[:, 1:2] * z - way[:, 2:] * y
    reach = np.inf
    parts = np.split(rate, np.cumsum(section.counts)[:-1], axis=1)
    for law, part in zip(section.laws, parts, strict=True):
        end = np.where(part > 0, float(law.strain[-1]), float(law.strain[0]))
        reach = np.minimum(reach, (end / part).min(1))
    return way * (0.999 * reach * 10 ** rng.uniform(-2.5, 0, n))[:, None]


@functools.cache
def solved(name):
    """All of one section: 1000 feasible forces, 100 infeasible, the surface twice."""
    section = SECTIONS[name]
    strains = feasible(section)
    inside = law_sum(section, strains)
    # beyond what all fibres together can carry, whatever the strains
    outside = 1.01 * inside[:100] / (np.abs(inside[:100]) / sizes(section)).max(1, keepdims=True)
    surface = traced(lambda s: s.interaction(n_angle=10, n_axial=11))(section)
    surface = np.stack([np.asarray(v).ravel() for v in surface], axis=1)
    target = np.concatenate([inside, outside, 0.999 * surface, 1.001 * surface])
    state = jax.tree.map(np.asarray, solve(section, target))
    return strains, target, surface, np.stack(state.strain, axis=1), state


@pytest.mark.slow_cases("concrete-filled tube", "steel rectangle")
@pytest.mark.parametrize("name", SECTIONS)
def test_equilibrium_of_random_forces(name):
    section = SECTIONS[name]
    strains, target, _, found, state = solved(name)
    target, found = target[:1000], found[:1000]
    assert (state.status[:1000] == status.OK).all() and (state.steps[:1000] <= 20).all()
    # 64 eps of the forces of all fibres is what the iteration ends at
    error = np.abs(law_sum(section, found) - target) / sizes(section)
    assert error.max() <= 1e-10
    # Strains are no better than the forces over the tangent. Without a stiff part, or with one on
    # a single line of fibres, a perfectly plastic section has no unique strains at all.
    y, z = np.asarray(section.y), np.asarray(section.z)
    e = strains[:, :1] + strains[:, 1:2] * z - strains[:, 2:] * y
    elastic = (np.abs(e) < STEEL_YIELD) @ np.asarray(section.area) / np.sum(section.area)
    unused = np.asarray(section.stiffness())
    radius = np.sqrt(np.diag(unused) / unused[0, 0])
    least = np.linalg.eigvalsh(
        [
            np.asarray(own) / np.outer(radius, radius)
            for own in (*tangents(section, strains), unused)
        ]
    )[:, 0]
    firm = (elastic >= 0.1) & (least[:-1] > 1e-6 * least[-1])
    assert firm.sum() > 600
    size = max(np.abs(y).max(), np.abs(z).max())
    error = np.abs(found - strains)[firm] * [1, size, size] / STEEL_YIELD
    assert error.max() <= 1e-10


@pytest.mark.slow_cases("concrete-filled tube")
@pytest.mark.parametrize("name", SECTIONS)
def test_interaction_surface_is_the_limit_of_equilibrium(name):
    """For laws that rise: a thousandth inside there is equilibrium, a thousandth outside none."""
    _, _, surface, found, state = solved(name)
    assert np.isfinite(surface).all() and len(surface) == 110
    assert (state.status[1100:1210] == status.OK).all()
    for outside in (slice(1000, 1100), slice(1210, None)):
        assert (state.status[outside] == status.BEYOND_CAPACITY).all()
        assert np.isnan(found[outside]).all()


def test_interaction_of_a_perfectly_plastic_rectangle():
    """(N / Np)^2 + |M| / Mp = 1, within the error of fibres that pass through yield."""
    b, h, n = 0.1, 0.2, 40
    section = Section.rectangle(b, h, LONG, (1, n))
    force, about_y, _ = traced(lambda s: s.interaction(n_angle=2, n_axial=41))(section)
    n_p, m_p = b * h * 235e6, b * h**2 / 4 * 235e6
    sum_ = (force[:, 0] / n_p) ** 2 + jnp.abs(about_y[:, 0]) / m_p
    # at the neutral axis one fibre of n is cut: an error of half its share in N, and of its
    # square in M; N / Np is at most 1
    assert np.abs(sum_ - 1).max() <= 2 / n
    assert np.ptp(force[:, 0]) > 1.99 * n_p  # from compression to tension


def test_law_without_compression_does_not_bound_compression():
    section = Section.rectangle(0.1, 0.1, materials.strand(), (2, 2))
    surface = np.stack(traced(lambda s: s.interaction(n_angle=4, n_axial=5))(section), axis=-1)
    assert np.isinf(surface[0]).all() and np.isfinite(surface[1:]).all()


def test_section_without_width_resists_what_it_can():
    """One column of fibres: no stiffness about z, so neither moment nor derivative there."""
    section = Section.rectangle(0.1, 0.2, REVERSIBLE, (1, 10))

    @traced
    def strains(target):
        state = section.strains(*target)
        return jnp.stack(state.strain)[:2], state.status

    target = np.array([1e6, 2e5, 0.0])
    found, code = strains(target)
    assert int(code) == status.OK
    got = law_sum(section, np.array([[*found, 0.0]]))[0]
    assert (np.abs(got - target)[:2] / sizes(section)[:2]).max() <= 1e-12  # 64 eps of the forces
    assert int(strains(np.array([1e6, 0.0, 1e3]))[1]) != status.OK


def test_zero_forces_and_too_few_iterations():
    section = SECTIONS["steel rectangle"]
    target = np.stack([np.zeros(3), 0.9 * FORCES * sizes(section)])
    state = traced(lambda t: section.strains(*t.T, max_steps=1))(target)
    assert state.status.tolist() == [status.OK, status.SECTION_UNBALANCED]
    assert state.steps.tolist() == [0, 1]
    strain = np.stack(state.strain, axis=1)
    assert (strain[0] == 0).all() and np.isnan(strain[1]).all()


# --- derivatives of the strains


FORCES = np.array([0.2, 0.55, 0.3])  # parts of the capacities; fibres yield at two corners


def strains_of_rectangle(factor):
    """Weighed sum of strains over yield; `factor` [15] of forces, sides and points of the law."""
    force = FORCES * sizes(Section.rectangle(0.1, 0.2, REVERSIBLE, (4, 5))) * factor[:3]
    width, height = 0.1 * factor[3], 0.2 * factor[4]
    law = jc.Polygonal(REVERSIBLE.strain * factor[5:10], REVERSIBLE.stress * factor[10:])
    state = Section.rectangle(width, height, law, (4, 5)).strains(*force)
    weights = jnp.array([1.0, 2 * 0.2, 3 * 0.1]) / STEEL_YIELD
    return weights @ jnp.stack(state.strain), state.status


def test_gradient_of_the_strains():
    """Everything moves them but the origin and the ends of the curve."""
    gradient = assert_gradient(strains_of_rectangle, np.ones(15), 0.25)
    assert (np.abs(gradient) > 1e-3).sum() >= 9


def test_forward_and_second_derivatives_of_the_strains():
    """Both modes agree; a Hessian times a direction is the change of the gradient."""
    p, way, h = np.ones(15), np.random.default_rng(7).normal(size=15), 1e-5

    def total(factor):
        return strains_of_rectangle(factor)[0]

    rate = traced(jax.grad(total))
    forward = traced(jax.jacfwd(total))(p)
    second = traced(lambda p: jax.jvp(jax.grad(total), (p,), (way,))[1])(p)
    # both modes are the same sums, through a matrix of condition 100
    assert np.abs(forward - rate(p)).max() <= 1e-10 * np.abs(forward).max()
    # truncation: h^2 = 1e-10 times a third derivative, and rounding 1e-13 / h
    expected = (rate(p + h * way) - rate(p - h * way)) / (2 * h)
    assert np.abs(second - expected).max() <= 1e-6 * np.abs(expected).max()


def test_failed_states_have_nan_derivatives_and_leave_others_alone():
    section = SECTIONS["steel rectangle"]
    good = FORCES * sizes(section)
    batch = np.stack([good, 5 * good, good])

    @traced
    @jax.grad
    def gradient(scale, weights):
        state = section.strains(*(scale * batch).T)
        return weights @ jnp.where(jnp.isnan(state.strain[1]) & (weights == 0), 0, state.strain[1])

    every, others = (gradient(1.0, np.array(w)) for w in ([1.0, 1.0, 1.0], [1.0, 0.0, 1.0]))
    assert np.isnan(every) and np.isfinite(others) and others > 0
