"""A function is looked at in every call: nothing that it reads from outside is out of date."""

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest
from oracles.convergence import converged

import jaxcable as jc
from jaxcable.common import status
from jaxcable.extend import DeadLoad, pytree
from jaxcable.programs.traced_function import evaluate_traced, trace_function
from tests.banks.captured import WAYS

COUNT = len(WAYS)
X = {"x": jc.reliability.Normal(0.0, 1.0)}


def set_all(value):
    """Set what is read in all ways to three different values around `value`; return them."""
    values = [value + k % 3 for k in range(COUNT)]
    for (_, write), own in zip(WAYS.values(), values, strict=True):
        write(own)
    return values


def read_all():
    return jnp.stack([jnp.asarray(read(), float) for read, _ in WAYS.values()])


def one_case(x):
    return x * read_all()


def one_named_case(case):
    return {"r": case["x"] * read_all()}


def loss(x):
    return 1.0 + jnp.sum((x - read_all()) ** 2)


def misfit(x):
    return x - read_all()


def least(x):
    """The smallest x that are no smaller than what is read."""
    return jnp.sum(x), 1.0 - x / read_all()


def margins(values):
    return read_all() + values["x"]


def signs(values):
    return read_all() - 3.5 + 0.0 * values["x"]


def by_batched(_):
    return jc.batched(one_case)(jnp.ones(2))[1]


def by_study(folder):
    """Results of a study in a new store."""
    return jc.study(one_named_case, {"x": np.ones(1)}, folder / "new.zarr").load()["r"][0]


def by_minimize(_):
    found = jc.minimize(loss, jnp.ones(COUNT))
    assert found.status == status.OK
    return found.params


def by_minimize_subject_to(_):
    found = jc.design.minimize_subject_to(least, jnp.full(COUNT, 8.0), (0.5, 10.0))
    assert found.status == status.OK
    return found.params


def by_fit(_):
    found = jc.fit(misfit, jnp.ones(COUNT))
    assert found.status == status.OK
    return found.params


def by_first_order(_):
    """The reliability index of x + number is the number."""
    found = jc.reliability.first_order(margins, X)
    assert (np.asarray(found.status) == status.OK).all()
    return found.beta


def by_importance_sampling(_):
    """A margin of number - 3.5 is violated always or never; the numbers are rounded with it."""
    found = jc.reliability.importance_sampling(signs, X, samples=2)
    return np.where(found.of_each > 0.5, 3.0, 4.0)


@pytest.mark.parametrize(
    "ask",
    [
        *(by_batched, by_study, by_minimize, by_minimize_subject_to, by_fit, by_first_order),
        by_importance_sampling,
    ],
)
def test_numbers_that_a_function_reads_are_those_of_now(ask, tmp_path):
    """The function objects are the same. Searches end within their tolerance of 1e-6."""
    for k, value in enumerate((2.0, 5.0, 2.0)):
        folder = tmp_path / str(k)
        expected = np.array(set_all(value))
        if ask is by_importance_sampling:
            expected = np.where(expected < 3.5, 3.0, 4.0)
        np.testing.assert_allclose(ask(folder), expected, rtol=3e-6, err_msg=f"{list(WAYS)}")


def test_each_number_counts(tmp_path):
    """One after the other: a batch has the new one, and the store of a study refuses it."""
    values, folder = set_all(2.0), tmp_path / "old.zarr"
    jc.study(one_named_case, {"x": np.ones(1)}, folder)
    for value, (name, (read, write)) in zip(values, WAYS.items(), strict=True):

        def function(x, read=read):
            return x * read()

        for own in (value, value + 3.0):
            write(own)
            np.testing.assert_array_equal(jc.batched(function)(jnp.ones(2)), own, err_msg=name)
        with pytest.raises(ValueError, match="holds a study with function"):
            jc.study(one_named_case, {"x": np.ones(1)}, folder)
        write(value)
    assert jc.study(one_named_case, {"x": np.ones(1)}, folder).missing == []


slope, rate, strength = 2.0, 0.1, 1.0


@jax.custom_jvp
def with_own_slope(x):
    return x - 4.0


@with_own_slope.defjvp
def _with_own_slope_jvp(primals, tangents):
    return with_own_slope(*primals), slope * tangents[0]


def test_rules_of_derivatives_are_those_of_now():
    """The equations are the same; only the rule, which jax calls later, reads another number."""
    global slope
    for slope in (2.0, 3.0, 2.0):
        found = jc.fit(lambda x: with_own_slope(x), jnp.array(1.0), steps=1)
        assert found.status in (status.OK, status.OUT_OF_STEPS)
        assert found.jacobian.item() == slope


def test_optimizers_are_those_of_now():
    """The first step of a gradient descent: the rate times the slope -2."""
    global rate
    descent = optax.sgd(lambda _: rate)
    for rate in (0.1, 0.2):
        found = jc.minimize(lambda x: 1.0 + (x - 1.0) ** 2, 0.0, optimizer=descent, steps=1)
        assert found.status == status.OUT_OF_STEPS
        assert found.params == pytest.approx(2 * rate, rel=1e-12)  # rounding


def test_numbers_are_those_of_now_within_other_programs():
    """A derivative and a batch outside of `jit` call programs that are known, too."""
    global rate

    def total(x):
        return jc.batched(lambda x: rate * x)(x).sum()

    for rate in (0.1, 0.2):
        np.testing.assert_array_equal(jax.grad(total)(jnp.ones(2)), rate)
        np.testing.assert_array_equal(jax.vmap(total)(jnp.ones((2, 1))), rate)


@pytree
class OwnLoad(DeadLoad):
    """A force on a node along z, `strength` times the field."""

    force: object
    scales = ("force",)

    def element_forces(self, groups, states, nodes, shape, dtype):
        return jnp.zeros(shape, dtype).at[2, 2].set(strength * self.force)


def test_classes_of_users_are_those_of_now():
    """The sag of two bars under a force is that under a nodal load of this size."""
    global strength
    bars = jc.Bars([[0, 2], [1, 2]], axial_stiffness=1e5)
    held = jc.pinned([0, 1]) + jc.restrained([2], "y")
    structure = jc.Structure([[-1.0, 0, 0], [1.0, 0, 0], [0, 0, -1.0]], bars, supports=held)
    own = [jc.Phase(loads=OwnLoad(-100.0))]

    def sag(phases):
        solution = converged(jc.solve(structure, phases))
        return float(solution.displacement[2, 2])

    for strength in (1.0, 2.0, 1.0):
        known = [jc.Phase(loads=jc.NodalLoads([2], (0.0, 0.0, -100.0 * strength)))]
        assert sag(own) == pytest.approx(sag(known), rel=1e-9)  # the tolerance of the analysis


def test_a_traced_function_refuses_other_arguments():
    traced = trace_function(lambda x: 2.0 * x["a"], {"a": 1.0})
    assert evaluate_traced(traced, {"a": 3.0}) == 6.0
    with pytest.raises(ValueError, match=r"arguments: expected .*'a'.*, got .*'b'"):
        evaluate_traced(traced, {"b": 3.0})
