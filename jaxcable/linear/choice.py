"""The solvers that are known, in the order in which the first that suits is chosen."""

from . import solver
from .dense import Dense
from .lapack import Banded
from .pardiso import Pardiso
from .superlu import SuperLU

for _own in (Dense(), Banded(), Pardiso(), SuperLU()):
    solver.register(_own)
