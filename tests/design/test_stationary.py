"""A start without slope is told as stationary: whether it is a minimum has not been shown."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcable as jc
from jaxcable import status
from jaxcable.cli import main

MAXIMUM = [0.0, 0.0]


def hill(x):
    """Its highest point is at zero, where the slope is zero: f(0) = 3, f(1, 0) < 3."""
    return 2.0 + jnp.cos(x[0]) - x[1] ** 2


def saddle(x):
    return 5.0 + x[0] ** 2 - x[1] ** 2


def flat(x):
    return 4.0 + 0.0 * x.sum()


@pytest.mark.parametrize("loss", [hill, saddle, flat])
def test_a_start_without_slope_is_not_called_converged(loss):
    start = jnp.array(MAXIMUM)
    assert loss(start + 0.1 * jnp.array([0.0, 1.0])) <= loss(start)  # no minimum, or none alone
    found = jc.minimize(loss, start)
    assert found.status == status.STATIONARY and found.steps == 0
    np.testing.assert_array_equal(found.params, start)
    text = jc.describe(found.status)
    assert text.startswith("the start is stationary") and "minimum" in text and "maximum" in text
    assert "converged" not in text
    with pytest.raises(jc.AnalysisError, match="the start is stationary"):
        jc.raise_if_failed(found)
    several = jax.vmap(lambda x: jc.minimize(loss, x).status)(jnp.array([MAXIMUM, [0.3, 0.2]]))
    assert several[0] == status.STATIONARY and (loss is flat) == (several[1] == several[0])


def test_other_optimizers_say_so_too():
    import optax

    found = jc.minimize(hill, jnp.array(MAXIMUM), optimizer=optax.adam(0.1))
    assert found.status == status.STATIONARY


def test_a_minimum_that_has_been_come_to_is_converged():
    for start in ([0.5, 0.3], [1e-3, -1e-3]):
        found = jc.minimize(lambda x: 1.0 + jnp.sum((x - 0.25) ** 2), jnp.array(start))
        assert found.status == status.OK and found.steps > 0
        np.testing.assert_allclose(found.params, 0.25, atol=1e-6)


def test_a_start_that_its_bounds_hold_is_a_minimum():
    """The slope is not zero there, and every way inside goes up."""
    found = jc.minimize(lambda x: 3.0 + x.sum(), jnp.zeros(2), bounds=(0.0, 1.0))
    assert found.status == status.OK and found.steps == 0
    one_free = jc.minimize(lambda x: 3.0 + x[0], jnp.array([0.0, 0.5]), bounds=(0.0, 1.0))
    assert one_free.status == status.STATIONARY  # the second number has no slope, and no influence


def test_the_top_of_a_misfit_is_not_called_converged():
    """x^2 + (3 - x^2)^2 has a maximum at zero, 9, and minima of 2.75 where x^2 = 2.5."""

    def residuals(x):
        return jnp.array([x[0], 3.0 - x[0] ** 2])

    assert (residuals(jnp.array([0.1])) ** 2).sum() < 9.0
    found = jc.fit(residuals, jnp.array([0.0]))
    assert found.status == status.STATIONARY
    found = jc.fit(residuals, jnp.array([0.5]), steps=200)
    assert found.status == status.OK
    np.testing.assert_allclose(found.params**2, 2.5, rtol=1e-4)
    exact = jc.fit(lambda x: x - 1.0, jnp.array([1.0]))
    assert exact.status == status.OK  # no misfit is less than none


def test_limits_with_a_start_without_slope():
    def problem(x):
        return hill(x), jnp.array([x[0] - 10.0])

    found = jc.design.minimize_subject_to(problem, jnp.array(MAXIMUM))
    assert found.status == status.STATIONARY and found.kkt_residual <= 1e-6
    found = jc.design.minimize_subject_to(
        lambda x: (1.0 + jnp.sum((x - 0.25) ** 2), jnp.array([x[0] - 10.0])), jnp.array(MAXIMUM)
    )
    assert found.status == status.OK
    np.testing.assert_allclose(found.params, 0.25, atol=1e-4)
    # a limit holds the start: its slope is not zero
    found = jc.design.minimize_subject_to(
        lambda x: (3.0 + x.sum(), -x - 1e-6), jnp.zeros(2), bounds=(-1.0, 1.0)
    )
    assert found.status == status.OK


def test_a_target_that_is_met_already_is_no_failure(tmp_path, monkeypatch, capsys):
    """But for rounding: of a sum of squares nothing is below zero."""
    monkeypatch.chdir(tmp_path)
    nodes = [[0.0, 0, 0], [1, 0, 0], [2, 0, 0]]
    structure = jc.Structure(nodes, jc.Cables([[0, 1], [1, 2]], 1e5), jc.pinned([0, 2]))
    jc.save_scene("met.json", (structure, [jc.Phase(pretension=128.0)]))
    assert main(["optimize", "met.json", "--target", "128", "--save", "t.json"]) == 0
    assert "status 0: converged" in capsys.readouterr().out
    np.testing.assert_allclose(jc.load_scene("t.json").phases[0].pretension, 128.0)
