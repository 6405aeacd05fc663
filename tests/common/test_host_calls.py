"""NumPy functions called by name from compiled programs (`common.host_calls`).

That another process finds such programs on disk is in `test_keeping`.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcable.common import host_calls, xla_calls

SHAPES = jax.ShapeDtypeStruct((3,), jnp.float64), jax.ShapeDtypeStruct((), bool)
SEEN = []


def shifted(vector, number):
    SEEN.append((vector.shape, number.shape, vector.dtype, number.dtype))
    return vector + number[..., None], number > 0


@host_calls.register_host_function_family
def shifts():
    return shifted


def call(vector, number):
    return host_calls.call_on_host([shifts], SHAPES, vector, number)


def test_results_and_what_the_function_sees():
    SEEN.clear()
    vector, positive = jax.jit(call)(jnp.arange(3.0), jnp.int32(4))
    np.testing.assert_array_equal(vector, [4.0, 5.0, 6.0])
    assert bool(positive) and positive.dtype == bool
    assert SEEN == [((3,), (), np.float64, np.int32)]
    assert not bool(call(jnp.arange(3.0), jnp.int32(-1))[1])


def test_a_batch_is_one_call():
    SEEN.clear()
    numbers = jnp.arange(5, dtype=jnp.int32)
    vectors, positive = jax.jit(jax.vmap(call, (None, 0)))(jnp.arange(3.0), numbers)
    np.testing.assert_array_equal(vectors, np.arange(3.0) + np.arange(5)[:, None])
    np.testing.assert_array_equal(positive, np.arange(5) > 0)
    assert SEEN == [((1, 3), (5,), np.float64, np.int32)]


@pytest.mark.parametrize("dtype", [bool, np.int8, np.int64, np.uint8, np.uint32, np.float32])
def test_dtypes(dtype):
    given = jnp.array([[1, 0, 1], [0, 0, 1]], dtype)
    shape = jax.ShapeDtypeStruct(given.shape, given.dtype)
    (found,) = jax.jit(lambda x: host_calls.call_on_host([same, "array"], [shape], x))(given)
    np.testing.assert_array_equal(found, given)


@host_calls.register_host_function_family
def same(what):
    assert what == "array"
    return lambda x: (x,)


def test_empty_arrays():
    none = jax.ShapeDtypeStruct((0, 2), jnp.float64)
    (found,) = host_calls.call_on_host([same, "array"], [none], jnp.zeros((0, 2)))
    assert found.shape == (0, 2)


@host_calls.register_host_function_family
def fails():
    def function(_):
        raise ZeroDivisionError("of no matrix")

    return function


def test_an_error_of_the_function_ends_the_program_with_its_text():
    with pytest.raises(jax.errors.JaxRuntimeError, match="ZeroDivisionError: of no matrix"):
        jax.block_until_ready(host_calls.call_on_host([fails], SHAPES, jnp.zeros(3)))
    vector, _ = call(jnp.zeros(3), jnp.int32(1))  # and only that program
    np.testing.assert_array_equal(vector, np.ones(3))


@pytest.mark.parametrize("lacks", ["pycapsule", "register_ffi_target"])
def test_without_an_interface_of_xla_there_is_none(lacks, monkeypatch):
    monkeypatch.delattr(jax.ffi, lacks)
    assert not xla_calls.register_host_function(f"never {lacks}", len)


def test_other_platforms_get_a_callback(monkeypatch):
    monkeypatch.setattr(host_calls, "register_call", lambda _: False)
    vector, positive = jax.jit(jax.vmap(call))(jnp.zeros((2, 3)), jnp.array([1, -1], jnp.int32))
    np.testing.assert_array_equal(vector, [[1.0] * 3, [-1.0] * 3])
    np.testing.assert_array_equal(positive, [True, False])


def test_families_are_known_by_module_and_name():
    made = {}
    for module in ("one", "two"):
        space = {"__name__": module, "number": 1.0 if module == "one" else 2.0}
        exec("def family_of_a_name():\n    return lambda x: (x + number,)", space)
        made[module] = host_calls.register_host_function_family(space["family_of_a_name"])
    shape = [jax.ShapeDtypeStruct((), jnp.float64)]
    found = [
        float(host_calls.call_on_host([made[m]], shape, jnp.zeros(()))[0]) for m in ("one", "two")
    ]
    assert found == [1.0, 2.0]
    exec("def family_of_a_name():\n    return lambda x: (x + number,)", space)
    assert (
        host_calls.register_host_function_family(space["family_of_a_name"]) is made["two"]
    )  # its module is reloaded
    exec("def family_of_a_name():\n    return lambda x: (x - number,)", space)
    with pytest.raises(ValueError, match=r"family: two.family_of_a_name is registered already"):
        host_calls.register_host_function_family(space["family_of_a_name"])
    for name in ("shifts", len):
        with pytest.raises(ValueError, match="expected a host function family"):
            host_calls.call_on_host([name], shape, jnp.zeros(()))
    with pytest.raises(ValueError, match="a word must not contain a comma"):
        host_calls.call_on_host([same, "array, or not"], shape, jnp.zeros(()))


HEARD = []


@host_calls.register_host_function_family
def hears():
    def function(x):
        HEARD.append(x.item())
        return ()

    return function


def test_a_function_without_results_is_told_in_turn():
    HEARD.clear()

    def told(n):
        def turn(k):
            host_calls.call_without_results([hears], k)
            return k + 1

        return jax.lax.while_loop(lambda k: k < n, turn, jnp.int32(0))

    assert int(jax.block_until_ready(jax.jit(told)(3))) == 3
    assert HEARD == [0, 1, 2]
    HEARD.clear()
    jax.block_until_ready(
        jax.vmap(lambda x: (host_calls.call_without_results([hears], x), x)[1])(jnp.arange(4.0))
    )
    assert HEARD == [0.0, 1.0, 2.0, 3.0]
