"""Registers the solvers of this package; the first in this order that suits is chosen."""

from . import solver
from .cholmod import Cholmod
from .dense import Dense
from .lapack import Banded
from .pardiso import Pardiso
from .rolling import Rolling
from .superlu import SuperLU

for _solver in (Rolling(), Dense(), Banded(), Pardiso(), Cholmod(), SuperLU()):
    solver.register(_solver)
