"""A linear solver written outside of the package, against its contract: NumPy's, on the host."""

import numpy as np

from jaxcable.extend import Analysis, NumericFactor, Solver, register_solver


class ByNumpy(Solver):
    """The whole matrix as an array: what a solver needs, and nothing more."""

    name = "numpy"

    def analyze(self, n, indptr, indices):
        rows = np.repeat(np.arange(n), np.diff(indptr))
        return Places(n, rows, indices)


class Places(Analysis):
    def __init__(self, n, rows, columns):
        self.n, self.places = n, (rows, columns)

    def factorize(self, values, definite):
        matrix = np.zeros((self.n, self.n))
        matrix[self.places] = values
        if definite and not (np.linalg.eigvalsh(matrix) > 0).all():
            return None
        singular = np.linalg.svd(matrix, compute_uv=False)
        if not singular[-1] > self.n * np.finfo(float).eps * singular[0]:
            return None
        return Inverse(np.linalg.inv(matrix))


class Inverse(NumericFactor):
    def __init__(self, inverse):
        self.inverse, self.n_bytes = inverse, inverse.nbytes

    def solve(self, b, transposed=False):
        return (self.inverse.T if transposed else self.inverse) @ b


NUMPY = register_solver(ByNumpy()).name
