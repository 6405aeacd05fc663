"""Settings of the whole suite: double precision, strict shapes, one compile cache per run."""

import tempfile

import jax
import pytest

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")
# the suite compiles hundreds of small programs and runs each a few times
jax.config.update("jax_disable_most_optimizations", True)

_cache = tempfile.TemporaryDirectory(prefix="jaxcable-tests-")
jax.config.update("jax_compilation_cache_dir", _cache.name)
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.2)


@pytest.fixture(scope="session", autouse=True)
def _close_cache():
    yield
    _cache.cleanup()
