"""Frames in batches end as alone: results, statuses, iterations, derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles.traced import traced

import jaxcable as jc
from jaxcable import linear
from jaxcable.common import status
from jaxcable.common.batch_conditions import cond_in_batch

# two columns of two elements and a beam of two, clamped at the feet
NODES = np.array([[0, 0, 0], [0, 0, 2], [0, 0, 4], [2, 0, 4], [4, 0, 4], [4, 0, 2], [4, 0, 0.0]])
SECTION = jc.Section.rectangle(0.05, 0.1, jc.Elastic(210e9))
STRUCTURE = jc.Structure(
    NODES,
    jc.Beams([[k, k + 1] for k in range(6)], section=SECTION, up=(0.0, 1.0, 0.0)),
    supports=jc.clamped([0, 6]),
)
TOP = [2, 3, 4]
# EI (pi / h)^2, N, the load on each column at which the frame buckles sideways if its beam is rigid
BUCKLING = 210e9 * 0.1 * 0.05**3 / 12 * (np.pi / 4) ** 2


@traced
def analyse(force, moment):
    """Displacements, status, steps and stability of the frame under loads on its top."""
    loads = jc.NodalLoads(TOP, force, moments=moment)
    solution = jc.solve(STRUCTURE, jc.Phase(loads=loads), jc.Newton(max_steps=10))
    path = solution.phases[0].path
    return solution.displacement, solution.status, path.iterations[-1], solution.stable


def mixed_cases():
    """Seven cases: three plain, an unstable one, moments, NaN, and one with too many steps."""
    force = np.random.default_rng(0).normal(size=(7, 3, 3)) * 300.0
    moment = np.zeros((7, 3, 3))
    force[3] = [[0, 0, -BUCKLING], [0, 0, 0], [0, 0, -BUCKLING]]
    moment[4] = [[0, 400.0, 300.0], [500.0, 0, 0], [0, 0, -600.0]]
    force[5, 1, 2] = np.nan
    force[6] *= 1e9
    return jnp.asarray(force), jnp.asarray(moment)


@pytest.mark.slow_cases("True")
@pytest.mark.parametrize("nested", [False, True])
def test_a_frame_ends_in_a_batch_as_alone(nested):
    force, moment = mixed_cases()
    if nested:  # a batch of batches: the last case twice
        two = [jnp.concatenate([a, a[-1:]]).reshape(2, 4, 3, 3) for a in (force, moment)]
        found = traced(jax.vmap(jax.vmap(analyse)))(*two)
        found = [np.asarray(a).reshape(8, *a.shape[2:])[:7] for a in found]
    else:
        found = [np.asarray(a) for a in jc.batched(analyse, 4)(force, moment)]
    alone = [analyse(*case) for case in zip(force, moment, strict=True)]
    for k, single in enumerate(alone):
        moved, code, steps, stable = (a[k] for a in found)
        assert code == single[1] and stable == single[3]
        if code == status.OK:  # rounding of other orders of elimination
            assert steps == single[2]
            np.testing.assert_allclose(moved, single[0], rtol=0, atol=1e-12 * np.abs(moved).max())
        else:
            assert np.isnan(moved).all() == np.isnan(single[0]).all()
    codes = found[1]
    assert codes.tolist() == [status.OK] * 5 + [status.NONFINITE, status.NOT_CONVERGED]
    assert found[3].tolist()[:5] == [True, True, True, False, True]


def factors_outside_of_conditions(jaxpr):
    """Numbers of LU factors in a jaxpr: outside of conditions, and in all."""
    outside = total = 0
    for equation in jaxpr.eqns:
        own = [int(equation.primitive.name == "lu")] * 2
        for inner in jax.tree.leaves(list(equation.params.values())):
            inner = getattr(inner, "jaxpr", inner)
            if not hasattr(inner, "eqns"):
                continue
            found = factors_outside_of_conditions(inner)
            own = [count + more for count, more in zip(own, found, strict=True)]
        outside += 0 if equation.primitive.name == "cond" else own[0]
        total += own[1]
    return outside, total


def test_a_batch_takes_general_factors_only_if_a_case_needs_them():
    """The condition is one for all cases, so that it is not a select of what both branches give."""
    force, moment = (a[:3] for a in mixed_cases())
    jaxpr = jax.make_jaxpr(jax.vmap(analyse))(force, moment)
    outside, total = factors_outside_of_conditions(jaxpr.jaxpr)
    assert total > 0 and outside == 0


@pytest.mark.parametrize("symmetric", [True, False])
def test_bands_are_those_of_the_symmetric_part(symmetric):
    numbers = np.array([[0, 3, 5], [3, 1, 4], [4, 2, 6], [6, 0, 7]])  # 7 is left out
    pattern = linear.make_pattern([numbers], 7, symmetric)
    blocks = np.random.default_rng(0).normal(size=(4, 3, 3))
    if symmetric:
        blocks = blocks + blocks.swapaxes(1, 2)
    matrix = linear.assemble_matrix([(jnp.asarray(blocks), numbers)], 7, pattern)
    full, order = np.asarray(matrix.dense()), np.asarray(pattern.order)
    part = (0.5 * (full + full.T))[order][:, order]
    band = np.asarray(matrix.banded())
    for k in range(7):
        rows = part[k : k + band.shape[1], k]
        np.testing.assert_allclose(band[k, : len(rows)], rows, rtol=1e-15)
    outside = np.tril(part, -band.shape[1])
    assert not outside.any() and band.shape[1] < 7


def test_a_condition_of_a_batch_is_one_for_all_cases():
    def double_if(wanted, x):
        return cond_in_batch(wanted, lambda x: (2 * x[0], x[1]), x)

    x = (jnp.arange(3.0), jnp.arange(6.0).reshape(3, 2))
    wanted = jnp.array([True, False, True])
    found = jax.vmap(double_if)(wanted, x)
    assert found[0].tolist() == [0.0, 1.0, 4.0] and (found[1] == x[1]).all()
    nested = jax.vmap(jax.vmap(double_if))(wanted[None], jax.tree.map(lambda a: a[None], x))
    assert nested[0].tolist() == [found[0].tolist()]
    assert double_if(True, (3.0, 1.0))[0] == 6.0 and double_if(False, (3.0, 1.0))[0] == 3.0
    text = jax.jit(jax.vmap(double_if)).lower(wanted, x).as_text()
    assert "stablehlo.case" in text
