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


def choose(n, banded):
    """The solver for `n` unknowns if none is named, for a matrix of small bandwidth or not.

    Dense for small systems, a banded one for some hundred unknowns, else PARDISO where it is
    installed, else SuperLU.
    """
    if n <= _DENSE:
        return "dense"
    if banded:
        return "banded"
    return "pardiso" if host.available("pardiso") else "superlu"


def is_dense(name, n):
    """Whether `n` unknowns get a dense matrix, with a solver of that name or None."""
    return name == "dense" or (name is None and n <= _DENSE)
