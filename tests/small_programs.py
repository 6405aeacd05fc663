"""Operations of jax on known arrays by NumPy: XLA compiles a program for each, which takes 30 ms.

A test that adds two arrays of jax needs no compiler, and ten thousand such programs were a third of
the time of the suite. Here the rules of `jaxcable.programs` evaluate them, at the place where jax
compiles. The folder `tests/programs`, which compares these rules with XLA and counts what is
compiled, and tests with the mark `compiled` run without.

The place is a private name of jax. Where it is missing or has other results, XLA compiles as usual:
tests take longer, and nothing else changes.
"""

import contextlib
import functools
import weakref

import jax
import jax.numpy as jnp
import numpy as np

from jaxcable.common import jax_internals as internals
from jaxcable.programs.evaluator import count_equations, write_program
from jaxcable.programs.rules import RULES
from jaxcable.programs.writing import inner_jaxprs

try:
    from jax._src import config, pjit

    COMPILE = pjit._pjit_call_impl_python
except (ImportError, AttributeError):
    pjit = COMPILE = None

MOST_EQUATIONS = 40  # of a small program
MOST_CALLS = 500
"""Calls of a program by NumPy, each of which takes 0.1 ms; XLA compiles it then."""
LEFT_TO_XLA = {"while", "scan", "ffi_call", "pure_callback", "io_callback"}
"""Primitives of loops, and of calls on the host, which XLA makes."""


def primitives(jaxpr):
    """Return the names of the primitives of a jaxpr, and of those within it."""
    found = {equation.primitive.name for equation in jaxpr.eqns}
    inner = (own for equation in jaxpr.eqns for own in inner_jaxprs(equation))
    return found.union(*map(primitives, inner))


class SmallProgram:
    """A small program, evaluated by NumPy until it has been called often.

    Args:
        jaxpr: closed jaxpr.
    """

    def __init__(self, jaxpr):
        self.calls, self.run = 0, None
        others = jaxpr.effects or not primitives(jaxpr.jaxpr) <= RULES.keys() - LEFT_TO_XLA
        if others or count_equations(jaxpr) > MOST_EQUATIONS:
            return
        with contextlib.suppress(NotImplementedError):
            self.run = write_program(jaxpr)

    def results(self, arguments):
        """Return arrays of NumPy; None if XLA is to compute them."""
        self.calls += 1
        if self.run is None or self.calls > MOST_CALLS or not all(map(_is_plain, arguments)):
            return None
        try:
            return self.run(arguments, [0.0, np.inf])
        except NotImplementedError:
            self.run = None
            return None


def _is_plain(x):
    """Tell whether an argument is a number, or an array that is bound to no device."""
    return not getattr(x, "committed", False) and isinstance(x, NUMBERS)


NUMBERS = jax.Array | np.ndarray | np.generic | float | int | bool
_known = weakref.WeakKeyDictionary()


def _evaluate(*arguments, jaxpr, **options):
    """Return what jax's own function returns; no compiled program, if NumPy has computed."""
    if jaxpr not in _known:
        _known[jaxpr] = SmallProgram(jaxpr)
    found = None if config.debug_nans.value else _known[jaxpr].results(arguments)
    if found is None:
        return COMPILE(*arguments, jaxpr=jaxpr, **options)
    weak = [x.weak_type for x in jaxpr.out_avals]
    return internals.arrays_on_default_device(found, weak), None, None, []


def by_numpy(switch):
    """Have NumPy evaluate small programs, or not."""
    if pjit is not None:
        pjit._pjit_call_impl_python = _evaluate if switch else COMPILE


@functools.cache
def is_possible():
    """Tell whether this jax has the place: a sum and its dtype are right, and nothing compiles."""
    heard = []

    def hear(event, *_, **__):
        heard.append("backend_compile" in event)

    jax.monitoring.register_event_duration_secs_listener(hear)
    try:
        by_numpy(True)
        found = jnp.add(np.arange(3.0), 1.0)
        return found.tolist() == [1.0, 2.0, 3.0] and not any(heard)
    except (AttributeError, TypeError, ValueError):
        return False
    finally:
        by_numpy(False)
        jax.monitoring.unregister_event_duration_listener(hear)
