"""Which solver a matrix gets."""

from . import host

SOLVERS = ("dense", "superlu", "pardiso")
_DENSE = 150  # unknowns up to which dense is faster, see experiments/scaling.py


def check(name):
    """Raise ValueError unless `name` is one of `SOLVERS`, installed, or None."""
    if name is None:
        return
    if name not in SOLVERS:
        raise ValueError(f"linear_solver = {name!r}: expected None or one of {', '.join(SOLVERS)}")
    if name == "pardiso" and not host.available(name):
        raise ValueError(
            "linear_solver = 'pardiso': pypardiso is not installed; "
            'use "superlu", or install the extra jaxcable[pardiso]'
        )


def choose(name, n):
    """The solver for `n` unknowns, one of `SOLVERS`.

    `name` is one of them, or None: then dense for small systems, else PARDISO where it is
    installed, else SuperLU.
    """
    if name is not None:
        return name
    if n <= _DENSE:
        return "dense"
    return "pardiso" if host.available("pardiso") else "superlu"
