"""A command that another program runs leaves its settings: of jax, warnings, kept programs."""

import os
import subprocess
import sys
import textwrap

import pytest

IN_PROCESS = """
    import os, sys, warnings
    import jax, matplotlib
    import jaxcable as jc
    from jaxcable.cli import main
    from jaxcable.common import fusion, keeping

    if "kept" in sys.argv:
        jc.keep_programs("own")
    if "double" in sys.argv:
        jax.config.update("jax_enable_x64", True)

    def settings():
        backend = dict.__getitem__(matplotlib.rcParams, "backend")
        own = list(keeping._place), list(keeping._before)
        return dict(jax.config.values), list(warnings.filters), dict(os.environ), str(backend), own

    before = settings()
    assert main(["new", "net"]) == 0
    assert main(["solve", "net.json", "--quiet", "--plot", "net.png"]) == 0
    assert main(["solve", "none.json"]) == 2
    after = settings()
    changed = [(a, b) for a, b in zip(before, after) if a != b]
    assert not changed, changed
    assert not fusion.fuses()
    assert jax.numpy.ones(2).dtype == ("float64" if "double" in sys.argv else "float32")
"""


def run(folder, code, *words, **changes):
    environment = {**os.environ, "JAXCABLE_PROGRAMS": str(folder / "programs"), **changes}
    environment.pop("JAX_ENABLE_X64", None)
    command = [sys.executable, "-c", textwrap.dedent(code), *words]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize("words", [(), ("kept", "double")])
def test_a_program_that_runs_commands_keeps_its_settings(tmp_path, words):
    flags = os.environ.get("XLA_FLAGS", "").split()
    unfused = [flag for flag in flags if not flag.startswith("--xla_backend_extra_options")]
    run(tmp_path, IN_PROCESS, *words, XLA_FLAGS=" ".join(unfused))
    assert list((tmp_path / "programs" / "programs").glob("*.program"))  # kept meanwhile


WHOLE = """
    import sys
    from jaxcable.cli import main
    from jaxcable.common import fusion

    sys.argv = ["jaxcable", "schema", "--quiet"]
    assert main() == 0
    print(fusion.fuses() or fusion.fusion_flag(1) is None)
"""


def test_the_command_line_fuses_loops_of_its_own_process(tmp_path):
    assert run(tmp_path, WHOLE) == "True\n"
