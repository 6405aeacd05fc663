"""Ways in which a function reads a number that is not among its arguments, and how it is set anew.

``WAYS[name]`` is a pair: a function that reads the number, and one that sets it. A function is
traced in every call, so that a way of each kind is enough; what jax itself traces once is `TRACED`.
"""

import functools
import os
import sys
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


number, array_name, later = 1.0, np.ones(2), lambda: 1.0
settings = types.ModuleType("settings_of_a_script")
sys.modules[settings.__name__] = settings
exec("inner = 1.0\ndef get():\n    return inner", settings.__dict__)


def _closure(value):
    def read():
        return value

    def write(v):
        nonlocal value
        value = v

    return read, write


def _default(value=1.0):
    return value


class _Own:
    def __init__(self):
        self.value = self.hidden = 1.0

    def method(self):
        return self.value

    @property
    def half(self):
        return 0.5 * self.hidden


_partial = functools.partial(lambda value: value, value=1.0)
one, numbers, array = _Own(), [0.0, 1.0], np.ones(3)

READ = {
    "global": (lambda: number, entry(here, "number")),
    "global of another module": (settings.get, attribute(settings, "inner")),
    "array": (lambda: array_name[1], lambda v: entry(here, "array_name")(np.array([0.0, v]))),
    "function replaced": (lambda: later(), lambda v: entry(here, "later")(lambda: v)),
    "closure": _closure(1.0),
    "default argument": (_default, lambda v: setattr(_default, "__defaults__", (v,))),
    "argument of partial": (_partial, entry(_partial.keywords, "value")),
    "attribute of self": (one.method, attribute(one, "value")),
    "property": (lambda: 2 * one.half, attribute(one, "hidden")),
    "list": (lambda: numbers[1], entry(numbers, 1)),
    "array in place": (lambda: jnp.asarray(array)[2], entry(array, 2)),
    "environment": (
        lambda: float(os.environ["JAXCABLE_TEST_NUMBER"]),
        lambda v: entry(os.environ, "JAXCABLE_TEST_NUMBER")(str(float(v))),
    ),
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
WAYS = READ | TRACED
