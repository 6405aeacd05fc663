"""For tests of kept programs: where they are kept, and jax's settings, are as before afterwards."""

import jax
import pytest

from jaxcable.common import jax_internals, program_store


@pytest.fixture
def nothing_kept():
    """At first neither this package nor jax keeps programs."""
    with program_store.preserve_program_settings():
        jax.config.update("jax_compilation_cache_dir", None)
        jax_internals.reset_jax_cache()
        program_store._open_place.clear()
        program_store._jax_settings_before.clear()
        yield
