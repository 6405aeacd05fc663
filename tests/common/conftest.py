"""For tests of kept programs: jax's settings are as before afterwards."""

import jax
import pytest

import jaxcable as jc
from jaxcable.common import jax_internals


@pytest.fixture
def nothing_kept():
    """At first neither this package nor jax keeps programs."""
    before = jax.config.jax_compilation_cache_dir
    jax.config.update("jax_compilation_cache_dir", None)
    jax_internals.reset_jax_cache()
    yield
    jc.keep_programs(limit=0)
    jax.config.update("jax_compilation_cache_dir", before)
    jax_internals.reset_jax_cache()
