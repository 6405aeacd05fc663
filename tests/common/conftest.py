"""For tests of kept programs: where they are kept, and jax's settings, are as before afterwards."""

import jax
import pytest

from jaxcable.common import jax_internals, keeping


@pytest.fixture
def nothing_kept():
    """At first neither this package nor jax keeps programs."""
    with keeping.restored():
        jax.config.update("jax_compilation_cache_dir", None)
        jax_internals.reset_cache()
        keeping._place.clear()
        keeping._before.clear()
        yield
