"""Functions as they are within `jax.jit`, for tests that call them once or a few times."""

from jaxcable.programs.program_calls import as_program


def traced(function):
    """Return a function that jax traces as with `jax.jit`, and NumPy evaluates until XLA pays.

    To compile an analysis takes XLA longer than NumPy needs for some dozen calls. That compiled
    programs give the same is shown by the tests of `tests/programs`, and of those that call
    `jax.jit`.
    """
    return as_program(function)
