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

here = globals()


def entry(container, key):
    """Setter of an entry."""
    return functools.partial(container.__setitem__, key)


def attribute(owner, name):
    """Setter of an attribute."""
    return functools.partial(setattr, owner, name)


# --- names

number, rebound, frozen, array_name = 1.0, 1.0, 1.0, np.ones(2)
pair, jax_array, later = (1.0, 2.0), jnp.ones(2), lambda: 1.0
settings = types.ModuleType("settings_of_a_script")
sys.modules[settings.__name__] = settings
exec("value, inner = 1.0, 1.0\ndef get():\n    return inner", settings.__dict__)


def _outer():
    def inner():
        return rebound

    return inner()


NAMES = {
    "global": (lambda: number, entry(here, "number")),
    "attribute of a module": (lambda: settings.value, attribute(settings, "value")),
    "global of another module": (settings.get, attribute(settings, "inner")),
    "attribute of a module imported late": (
        lambda: __import__("settings_of_a_script").late,
        attribute(settings, "late"),
    ),
    "global of a nested function": (lambda: _outer(), entry(here, "rebound")),
    "global by name": (lambda: eval("frozen"), entry(here, "frozen")),
    "entry of a tuple": (lambda: pair[1], lambda v: entry(here, "pair")((0.0, v))),
    "NumPy array": (
        lambda: array_name[1],
        lambda v: entry(here, "array_name")(np.array([0.0, v])),
    ),
    "array of jax": (lambda: jax_array[1], lambda v: entry(here, "jax_array")(jnp.array([0.0, v]))),
    "function replaced": (lambda: later(), lambda v: entry(here, "later")(lambda: v)),
}

# --- what a function has of its own


def _closure(value):
    def read():
        return value

    def write(v):
        nonlocal value
        value = v

    return read, write


def _default(value=1.0):
    return value


def _keyword(*, value=1.0):
    return value


def _attribute():
    return _attribute.value


def _decorated(function):
    @functools.wraps(function)
    def wrapper():
        return function()[0] * 1.0

    return wrapper


_partial = functools.partial(lambda value: value, value=1.0)
_cell = [1.0]
_read, _write = _closure(1.0)

OWN = {
    "closure": _closure(1.0),
    "closure of a closure": ((lambda read: lambda: read())(_read), _write),
    "default argument": (_default, lambda v: setattr(_default, "__defaults__", (v,))),
    "keyword default": (_keyword, entry(_keyword.__kwdefaults__, "value")),
    "attribute of a function": (_attribute, attribute(_attribute, "value")),
    "argument of partial": (_partial, entry(_partial.keywords, "value")),
    "decorated function": (_decorated(lambda: _cell), entry(_cell, 0)),
}

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


@dataclasses.dataclass
class _Data:
    value: float = 1.0
    inner: object = None


one, data = _Own(), _Data(inner=_Data())

OBJECTS = {
    "attribute of self": (one.method, attribute(one, "value")),
    "callable object": (one, attribute(one, "called")),
    "property": (lambda: 2 * one.half, attribute(one, "hidden")),
    "getattr": (lambda: one.anything, attribute(one, "looked_up")),
    "slot": (lambda: one.slot, attribute(one, "slot")),
    "attribute of a class": (_Own.of_class, attribute(_Own, "shared")),
    "attribute of a base class": (lambda: one.inherited, attribute(_Base, "inherited")),
    "static method": (
        lambda: one.static(),
        lambda v: setattr(_Base, "static", staticmethod(lambda: v)),
    ),
    "method": (lambda: one.bound(), lambda v: setattr(_Own, "bound", lambda self: v)),
    "partial method": (
        functools.partialmethod(lambda self: one.for_partial).__get__(one),
        attribute(one, "for_partial"),
    ),
    "object replaced": (
        lambda: here["instance"].value,
        lambda v: entry(here, "instance")(types.SimpleNamespace(value=v)),
    ),
    "field of a dataclass": (lambda: data.value, attribute(data, "value")),
    "field of a nested dataclass": (
        lambda: data.inner.value,
        lambda v: setattr(data, "inner", dataclasses.replace(data.inner, value=v)),
    ),
}

# --- containers and arrays that are changed in place

numbers, table, functions = [0.0, 1.0], {"a": {"b": 1.0}}, {}
array, arrays, scalar = np.ones(3), {"a": np.ones((2, 2))}, np.array(1.0)
large = np.ones(1000)
chain, queue = collections.ChainMap({}, {"v": 1.0}), collections.deque([1.0])

IN_PLACE = {
    "list": (lambda: numbers[1], entry(numbers, 1)),
    "dict in a dict": (lambda: table["a"]["b"], entry(table["a"], "b")),
    "lambda in a dict": (lambda: functions["f"](), lambda v: entry(functions, "f")(lambda: v)),
    "NumPy array in place": (lambda: jnp.asarray(array)[2], entry(array, 2)),
    "array in a dict": (lambda: arrays["a"][1, 1], entry(arrays["a"], (1, 1))),
    "NumPy number": (lambda: jnp.asarray(scalar), entry(scalar, ())),
    "large array": (lambda: jnp.mean(large), entry(large, slice(None))),
    "chain of dicts": (lambda: chain["v"], entry(chain.maps[0], "v")),
    "deque": (lambda: queue[-1], queue.append),
}

# --- state of the process

local, variable = threading.local(), contextvars.ContextVar("variable")
_generator = np.random.RandomState(0)


def _set_generator(v):
    _generator.set_state(("MT19937", np.full(624, int(v), np.uint32), 624))


PROCESS = {
    "environment": (
        lambda: float(os.environ["JAXCABLE_TEST_NUMBER"]),
        lambda v: entry(os.environ, "JAXCABLE_TEST_NUMBER")(str(float(v))),
    ),
    "thread": (lambda: local.value, attribute(local, "value")),
    "context": (lambda: variable.get(), variable.set),
    "generator": (lambda: float(_generator.get_state()[1][0]), _set_generator),
}

# --- what jax itself traces once

jitted = looped = checked = on_host = 1.0


@jax.jit
def _jitted(x):
    return x * jitted


def _body(_, x):
    return x + looped


@jax.checkpoint
def _checked(x):
    return x * checked


def _ask_host():
    """The function on the host is another object in every trace, and closes over the number."""
    factor, shape = on_host, jax.ShapeDtypeStruct((), float)
    times = functools.partial(_times, lambda x: np.asarray(x) * factor)
    return jax.pure_callback(times, shape, jnp.ones(()), vmap_method="sequential")


def _times(function, x):
    return function(x)


TRACED = {
    "function on the host": (_ask_host, entry(here, "on_host")),
    "jit": (lambda: _jitted(1.0), entry(here, "jitted")),
    "body of a loop": (
        lambda: jax.lax.fori_loop(0, 4, _body, 0.0) / 4,
        entry(here, "looped"),
    ),
    "checkpoint": (lambda: jax.lax.map(_checked, jnp.ones(2))[1], entry(here, "checked")),
}
WAYS = NAMES | OWN | OBJECTS | IN_PLACE | PROCESS | TRACED
