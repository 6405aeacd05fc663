"""Results that have to have converged before a test says anything about them."""

import jaxcable as jc


def converged(result):
    """Return what an analysis, a path, a form or a search has found; its status has to be OK."""
    assert int(result.status) == jc.status.OK, jc.describe(result.status)
    return result
