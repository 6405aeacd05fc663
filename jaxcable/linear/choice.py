"""Registers the solvers of this package; the first in this order that suits is chosen."""

from . import solver
from .cholmod import Cholmod
from .dense import Dense
from .lapack import LapackBanded
from .pardiso import Pardiso
from .rolling import RollingCholesky
from .superlu import SuperLU

for _solver in (RollingCholesky(), Dense(), LapackBanded(), Pardiso(), Cholmod(), SuperLU()):
    solver.register(_solver)
