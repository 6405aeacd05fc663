"""Settings of the whole suite: double precision, strict shapes, one compile cache for all runs."""

import gc
import os
import pathlib
import signal
import zlib

import jaxlib.version

# A shell has its background jobs ignore interrupts; tests send some, to themselves and to others.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# The programs of beams compile a quarter faster without fusion emitters. An unknown flag ends the
# process, hence only where it is known to exist.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # two processes share the cores
if jaxlib.version.__version_info__[:2] == (0, 10):
    # (and as many processes as cores compile at once: none of them gains by several threads)
    FASTER = "--xla_cpu_use_fusion_emitters=false --xla_cpu_parallel_codegen_split_count=1"
    os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} {FASTER}".strip()

FUSED = "FUSED_LOOPS" in os.environ
"""Whether to run with `jaxcable.fuse_loops`, as the last part of `make test-all` does."""
if FUSED:
    from jaxcable.common import fusion

    assert fusion.request_fused_loops()

PART = os.environ.get("TEST_PART")
"""Which part of the slow tests to run, such as "1/8": part 1 of the parts 0 to 7; None for all.

Of all tests with fused loops it is the same part, or one of `FUSED_PARTS` if there are more."""
FUSED_PARTS = 8

import budget
import jax
import pytest
import small_programs

import jaxcable

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")
# the suite compiles hundreds of small programs and runs each a few times
jax.config.update("jax_disable_most_optimizations", True)
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.1)
# tracing makes millions of objects and no garbage: looking for it took a third of the time
gc.set_threshold(100_000, 20, 20)


def pytest_configure(config):
    """Compiled programs outlive the run, and the workers share them: `.pytest_cache/d/programs`.

    JAX keys an entry by program, jaxlib and flags. `pytest --cache-clear` empties it. Where
    JAX_COMPILATION_CACHE_DIR names a folder, it is that one.
    """
    if jax.config.jax_compilation_cache_dir is None and hasattr(config, "cache"):
        jax.config.update("jax_compilation_cache_dir", str(config.cache.mkdir("programs")))
    config.pluginmanager.register(budget.Budget(budget.budget_of(config)))
    small_programs.by_numpy(not FUSED and small_programs.is_possible())


def pytest_collection_finish():
    """Modules are no garbage: a full collection takes a second where it looks at all of them."""
    gc.freeze()


@pytest.fixture
def collect_young():
    """A function that collects the garbage of this test, and does not look at older objects."""
    gc.disable()
    yield lambda: gc.collect(0)
    gc.enable()


COMPILED = pathlib.Path(__file__).parent / "programs"


@pytest.hookimpl(tryfirst=True)  # before fixtures of modules
def pytest_runtest_setup(item):
    """Operations on known arrays compile nothing, except in tests of programs."""
    own = COMPILED in item.path.parents or item.get_closest_marker("compiled")
    small_programs.by_numpy(not (FUSED or own) and small_programs.is_possible())


@pytest.hookimpl(tryfirst=True)  # before marks are selected
def pytest_collection_modifyitems(config, items):
    """Mark cases as `slow`: those of `slow_cases`, all but those of `quick_cases`; take `PART`."""
    named, seen = {}, {}
    for item in items:
        for mark in item.iter_markers():
            if mark.name not in ("slow_cases", "quick_cases"):
                continue
            case, function = item.callspec.id, item.nodeid.partition("[")[0]
            named[function] = mark.args
            seen.setdefault(function, set()).add(case)
            if (case in mark.args) == (mark.name == "slow_cases"):
                item.add_marker(pytest.mark.slow)
    if not any("::" in argument for argument in config.args):  # else some cases are not collected
        unknown = [f"{k}: {name}" for k in named for name in set(named[k]) - seen[k]]
        if unknown:
            raise pytest.UsageError(f"slow_cases, quick_cases: no case of {'; '.join(unknown)}")
    if PART is not None:
        parted = (lambda item: True) if FUSED else (lambda item: item.get_closest_marker("slow"))
        items[:] = [item for item in items if not parted(item) or in_part(item)]


FAMILY = "together"
"""Group of the files that analyse the same structures: one process runs them."""
TOGETHER = (
    # lines of `banks/hung_lines.py`, scenes of cables with friction
    *("scenes/test_friction_scenes.py", "plots/test_friction_pictures.py"),
    *("plots/test_view_browser.py", "reporting/test_friction_tables.py"),
    "results/test_segment_sags.py",
)


@pytest.hookimpl(optionalhook=True)  # of pytest-xdist
def pytest_xdist_make_scheduler(config, log):
    """With `--dist loadfile`, give a process whole files, and one process those of `TOGETHER`."""
    if config.getvalue("dist") != "loadfile":
        return None
    from xdist.scheduler import LoadFileScheduling

    class ByFamily(LoadFileScheduling):
        def _split_scope(self, nodeid):
            file = super()._split_scope(nodeid)
            return FAMILY if file.endswith(TOGETHER) else file

    return ByFamily(config, log)


def in_part(item):
    """Return whether a test is in `PART`; all cases of a function are in the same one."""
    number, count = map(int, PART.split("/"))
    if FUSED:
        count = min(count, FUSED_PARTS)
        number %= count
    return zlib.crc32(item.nodeid.partition("[")[0].encode()) % count == number


MEMORY = 1_500
"""Resident memory, MB, from which compiled programs are forgotten: each takes some MB, and eight of
the 65 530 memory maps that Linux gives a process."""


@pytest.fixture(autouse=True)
def _forget_programs():
    """Programs are kept from test to test while there is room for them."""
    yield
    statm = pathlib.Path("/proc/self/statm")  # of Linux: elsewhere programs are kept
    if statm.exists():
        pages = int(statm.read_text(encoding="utf-8").split()[1])
        if pages * os.sysconf("SC_PAGE_SIZE") > MEMORY * 1e6:
            jaxcable.forget_programs()
