"""A command that another program runs leaves its settings: of jax and of warnings."""

import os
import subprocess
import sys
import textwrap

from test_cli import environment

INSIDE = """
    import os, sys, warnings
    import jax, matplotlib
    import jaxcable as jc
    from jaxcable.cli import main

    def settings():
        backend = dict.__getitem__(matplotlib.rcParams, "backend")
        return dict(jax.config.values), list(warnings.filters), dict(os.environ), str(backend)

    def run(dtype):
        before = settings()
        assert main(["new", "net", "--force"]) == 0
        assert main(["solve", "net.json", "--quiet", "--plot", "net.png"]) == 0
        assert main(["solve", "none.json"]) == 2
        changed = [(a, b) for a, b in zip(before, settings()) if a != b]
        assert not changed, changed
        assert jax.numpy.ones(2).dtype == dtype

    run("float32")
    jax.config.update("jax_enable_x64", True)
    run("float64")
"""


def test_a_program_that_runs_commands_keeps_its_settings(tmp_path):
    """Of jax and of warnings, whatever they are."""
    flags = os.environ.get("XLA_FLAGS", "").split()
    flags = [flag for flag in flags if not flag.startswith("--xla_backend_extra_options")]
    around = environment(XLA_FLAGS=" ".join(flags))
    for name in ("JAX_ENABLE_X64", "JAX_COMPILATION_CACHE_DIR"):
        around.pop(name, None)
    run = [sys.executable, "-c", textwrap.dedent(INSIDE)]
    run = subprocess.run(run, cwd=tmp_path, env=around, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
