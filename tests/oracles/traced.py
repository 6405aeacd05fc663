"""Functions as they are within `jax.jit`, for tests that call them once or some dozen times."""

import functools

import jaxcable as jc
from jaxcable.programs.program_calls import as_program


def traced(function):
    """Return a function that jax traces as with `jax.jit`, and that NumPy evaluates.

    XLA needs longer to compile an analysis than NumPy for some dozen calls. That compiled programs
    give the same is shown by the tests of `tests/programs`, and by those that call `jax.jit`.
    """
    program = as_program(function)

    @functools.wraps(function)
    def run(*arguments):
        with jc.evaluation("numpy"):
            return program(*arguments)

    return run
