"""Settings of the whole suite: double precision, strict shapes, one compile cache per run."""

import os
import tempfile

import jaxlib.version

# The programs of beams compile a quarter faster without fusion emitters. An unknown flag ends the
# process, hence only where it is known to exist.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # two processes share the cores
if jaxlib.version.__version_info__[:2] == (0, 10):
    FASTER = "--xla_cpu_use_fusion_emitters=false"
    os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} {FASTER}".strip()

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


@pytest.fixture(scope="module", autouse=True)
def _forget_programs():
    """Programs of one file are not kept for the next: thousands of them exhaust memory maps."""
    yield
    jax.clear_caches()
