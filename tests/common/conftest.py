"""For tests of kept programs: where they are kept, and jax's settings, are as before afterwards."""

import jax
import pytest

from jaxcable.common import jax_internals, keeping


@pytest.fixture
def nothing_kept():
    """At first neither this package nor jax keeps programs."""
    with keeping.restored():
        jax.config.update("jax_compilation_cache_dir", None)
        jax_internals.reset_jax_cache()
        keeping._open_place.clear()
        keeping._jax_settings_before.clear()
        yield
