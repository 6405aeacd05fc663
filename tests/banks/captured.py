"""Ways in which a function reads a number that is not among its arguments, and how it is set anew.

``WAYS[name]`` is a pair: a function that reads the number, and one that sets it.
"""

import collections
import contextvars
import dataclasses
import functools
import os
import sys
import threading
import types

import jax
import jax.numpy as jnp
import numpy as np

WAYS = {}


def way(write):
    """Register a way: `write` is its setter, and ``write.read`` what is read."""
    WAYS[write.__name__.strip("_")] = write.read, write
    return write


def reads(read):
    """Decorate a setter with the function that reads what it sets."""

    def decorate(write):
        write.read = read
        return way(write)

    return decorate


# --- names

here = globals()
number, rebound, frozen, array_name = 1.0, 1.0, 1.0, np.ones(2)
pair, jax_array, later = (1.0, 2.0), jnp.ones(2), lambda: 1.0
settings = types.ModuleType("settings_of_a_script")
sys.modules[settings.__name__] = settings
exec("value, inner = 1.0, 1.0\ndef get():\n    return inner", settings.__dict__)


@reads(lambda: number)
def a_global(v):
    here["number"] = v


@reads(lambda: settings.value)
def attribute_of_a_module(v):
    settings.value = v


@reads(settings.get)
def global_of_another_module(v):
    settings.inner = v


@reads(lambda: __import__("settings_of_a_script").late)
def attribute_of_a_module_imported_late(v):
    settings.late = v


def _outer():
    def inner():
        return rebound

    return inner()


@reads(lambda: _outer())
def global_of_a_nested_function(v):
    here["rebound"] = v


@reads(lambda: eval("frozen"))
def global_by_name(v):
    here["frozen"] = v


@reads(lambda: pair[1])
def entry_of_a_tuple(v):
    here["pair"] = (0.0, v)


@reads(lambda: array_name[1])
def numpy_array_rebound(v):
    here["array_name"] = np.array([0.0, v])


@reads(lambda: jax_array[1])
def jax_array_rebound(v):
    here["jax_array"] = jnp.array([0.0, v])


@reads(lambda: later())
def function_replaced(v):
    here["later"] = lambda: v


# --- what a function has of its own


def _closure(value):
    def read():
        return value

    def write(v):
        nonlocal value
        value = v

    return read, write


WAYS["closure_cell"] = _closure(1.0)
_read, _write = _closure(1.0)
WAYS["closure_of_a_closure"] = (lambda read: lambda: read())(_read), _write


def _default(value=1.0):
    return value


@reads(_default)
def default_argument(v):
    _default.__defaults__ = (v,)


def _keyword(*, value=1.0):
    return value


@reads(_keyword)
def keyword_default(v):
    _keyword.__kwdefaults__["value"] = v


def _attribute():
    return _attribute.value


@reads(_attribute)
def attribute_of_a_function(v):
    _attribute.value = v


_partial = functools.partial(lambda value: value, value=1.0)


@reads(_partial)
def argument_of_partial(v):
    _partial.keywords["value"] = v


def _decorated(function):
    @functools.wraps(function)
    def wrapper():
        return function()[0] * 1.0

    return wrapper


_cell = [1.0]


@reads(_decorated(lambda: _cell))
def decorated_function(v):
    _cell[0] = v


# --- objects


class _Base:
    inherited = 1.0
    shared = 1.0

    def __init__(self):
        self.value = self.called = self.hidden = self.looked_up = 1.0

    def method(self):
        return self.value

    def __call__(self):
        return self.called

    @property
    def half(self):
        return 0.5 * self.hidden

    @classmethod
    def of_class(cls):
        return cls.shared

    @staticmethod
    def static():
        return 1.0

    def __getattr__(self, name):
        return self.__dict__["looked_up"]


class _Own(_Base):
    __slots__ = ("slot",)


one = _Own()


@reads(one.method)
def attribute_of_self(v):
    one.value = v


@reads(one)
def callable_object(v):
    one.called = v


@reads(lambda: 2 * one.half)
def read_by_a_property(v):
    one.hidden = v


@reads(lambda: one.anything)
def read_by_getattr(v):
    one.looked_up = v


@reads(lambda: one.slot)
def slot_of_an_object(v):
    one.slot = v


@reads(_Own.of_class)
def attribute_of_a_class(v):
    _Own.shared = v


@reads(lambda: one.inherited)
def attribute_of_a_base_class(v):
    _Base.inherited = v


@reads(lambda: one.static())
def static_method_replaced(v):
    _Base.static = staticmethod(lambda: v)


@reads(lambda: one.bound())
def method_replaced(v):
    _Own.bound = lambda self: v


@reads(functools.partialmethod(lambda self: one.for_partial).__get__(one))
def partial_method(v):
    one.for_partial = v


@reads(lambda: here["instance"].value)
def object_replaced(v):
    here["instance"] = types.SimpleNamespace(value=v)


@dataclasses.dataclass
class _Data:
    value: float = 1.0
    inner: object = None


data = _Data(inner=_Data())


@reads(lambda: data.value)
def field_of_a_dataclass(v):
    data.value = v


@reads(lambda: data.inner.value)
def field_of_a_nested_dataclass(v):
    data.inner = dataclasses.replace(data.inner, value=v)


# --- containers and arrays that are changed in place

numbers, table, functions = [0.0, 1.0], {"a": {"b": 1.0}}, {}
array, arrays, scalar = np.ones(3), {"a": np.ones((2, 2))}, np.array(1.0)
large = np.ones(1000)
chain, queue = collections.ChainMap({}, {"v": 1.0}), collections.deque([1.0])


@reads(lambda: numbers[1])
def list_in_place(v):
    numbers[1] = v


@reads(lambda: table["a"]["b"])
def dict_in_a_dict(v):
    table["a"]["b"] = v


@reads(lambda: functions["f"]())
def lambda_in_a_dict(v):
    functions["f"] = lambda: v


@reads(lambda: jnp.asarray(array)[2])
def numpy_array_in_place(v):
    array[2] = v


@reads(lambda: arrays["a"][1, 1])
def numpy_array_in_a_global_dict(v):
    arrays["a"][1, 1] = v


@reads(lambda: jnp.asarray(scalar))
def numpy_number_in_place(v):
    scalar[()] = v


@reads(lambda: jnp.mean(large))
def large_numpy_array_in_place(v):
    large[:] = v


@reads(lambda: chain["v"])
def chain_of_dicts(v):
    chain.maps[0]["v"] = v


@reads(lambda: queue[-1])
def deque_in_place(v):
    queue.append(v)


# --- state of the process

local, variable = threading.local(), contextvars.ContextVar("variable")
local.value = 1.0


@reads(lambda: float(os.environ["JAXCABLE_TEST_NUMBER"]))
def environment_variable(v):
    os.environ["JAXCABLE_TEST_NUMBER"] = str(float(v))


@reads(lambda: local.value)
def thread_local(v):
    local.value = v


@reads(lambda: variable.get())
def context_variable(v):
    variable.set(v)


_generator = np.random.RandomState(0)


@reads(lambda: float(_generator.get_state()[1][0]))
def state_of_a_generator(v):
    _generator.set_state(("MT19937", np.full(624, int(v), np.uint32), 624))


# --- what jax itself traces once

jitted = looped = checked = 1.0


@jax.jit
def _jitted(x):
    return x * jitted


@reads(lambda: _jitted(1.0))
def read_within_jit(v):
    here["jitted"] = v


def _body(_, x):
    return x + looped


@reads(lambda: jax.lax.fori_loop(0, 4, _body, 0.0) / 4)
def read_in_the_body_of_a_loop(v):
    here["looped"] = v


@jax.checkpoint
def _checked(x):
    return x * checked


@reads(lambda: jax.lax.map(_checked, jnp.ones(2))[1])
def read_within_checkpoint(v):
    here["checked"] = v
