"""Programs kept on disk for the next process (`keep_programs`), and forgotten (`forget_programs`).

Whether a program came from disk is seen from outside: a process in which nothing can be traced
analyses all the same.
"""

import os
import shutil
import subprocess
import sys
import textwrap

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from extensions.own_laws import Prager
from extensions.own_solver import NUMPY

import jaxcable as jc
from jaxcable.analysis.preparation import prepare
from jaxcable.common import code_digest, compilation, jax_internals, keeping

HEAD = """
    import sys, resource, signal
    import jax
    jax.config.update("jax_enable_x64", True)
    import numpy as np
    import jaxcable as jc
    def no_tracing(*_, **__):
        raise AssertionError("traced")
    structure, phases = jc.scenes.saddle(3, 3)
    def analyse(linear_solver=None):
        solution = jc.solve(structure, phases, jc.Newton(linear_solver=linear_solver))
        jc.raise_if_failed(solution)
        print(np.asarray(solution.tension).tobytes().hex())
"""
TRACES = "jc.keep_programs(sys.argv[1]); analyse()"
FORBID = "jax.jit = no_tracing; "  # of jax: a program of changed code would not be found
CANNOT = FORBID + TRACES


def start(folder, code):
    clean = {k: v for k, v in os.environ.items() if k != "JAX_COMPILATION_CACHE_DIR"}
    command = [sys.executable, "-c", textwrap.dedent(HEAD) + code, str(folder)]
    pipe = subprocess.PIPE
    return subprocess.Popen(command, env=clean, stdout=pipe, stderr=pipe, text=True)


def end(process, warning=None):
    out, err = process.communicate(timeout=300)
    assert process.returncode == 0, err
    assert ("Warning" in err) == (warning is not None), err
    assert warning is None or warning in err
    return out


def programs(folder):
    return sorted((folder / "programs").glob("*.program"))


@pytest.fixture(scope="module")
def filled(tmp_path_factory):
    """A folder with the program of an analysis, and what that printed."""
    folder = tmp_path_factory.mktemp("kept") / "programs"
    said = end(start(folder, TRACES))
    assert len(programs(folder)) == 1
    return folder, said


@pytest.fixture
def copied(filled, tmp_path):
    return shutil.copytree(filled[0], tmp_path / "programs")


def test_another_process_neither_traces_nor_compiles(filled):
    folder, said = filled
    assert end(start(folder, CANNOT)) == said
    empty = start(folder.parent / "empty", CANNOT)  # the control
    assert "AssertionError: traced" in empty.communicate(timeout=300)[1]


@pytest.mark.parametrize("solver", ["superlu", "banded"])
def test_programs_that_call_the_host_are_kept(solver, tmp_path):
    if solver == "banded":  # is not offered by name: a net of that size gets it
        change = "structure, phases = jc.scenes.saddle(8, 8); analyse()"
    else:
        change = f"analyse({solver!r})"
    code = "jc.keep_programs(sys.argv[1]); " + change
    said = end(start(tmp_path, code))
    assert len(programs(tmp_path)) == 1
    assert end(start(tmp_path, FORBID + code)) == said


def test_programs_that_print_progress_are_kept_and_those_with_listeners_are_not(tmp_path):
    code = "jc.keep_programs(sys.argv[1]); jc.solve(structure, phases, progress=%s)"
    end(start(tmp_path, code % "print"))
    assert not programs(tmp_path)
    end(start(tmp_path, code % "True"))
    assert len(programs(tmp_path)) == 1
    hurry = "jc.progress.SHOW.pause = 0.0; "
    process = start(tmp_path, FORBID + hurry + code % "True")
    _, err = process.communicate(timeout=300)
    assert process.returncode == 0 and "phase 2 of 2" in err


@pytest.mark.parametrize("damage", ["cut", "changed", "empty"])
def test_a_damaged_file_is_made_again(damage, filled, copied):
    (path,) = programs(copied)
    text = bytearray(path.read_bytes())
    text[len(text) // 2] ^= 1
    path.write_bytes({"cut": text[: len(text) // 2], "changed": text, "empty": b""}[damage])
    assert end(start(copied, TRACES), "is damaged; the program is compiled anew") == filled[1]
    assert end(start(copied, CANNOT)) == filled[1]


def test_a_folder_that_cannot_be(filled, tmp_path):
    """A disk on which no folder can be made, here that of Linux for its processes."""
    if sys.platform.startswith("linux"):
        assert end(start("/proc/jaxcable", TRACES)) == filled[1]
    (tmp_path / "programs").write_text("a file")
    with pytest.raises(ValueError, match="is a file, and no folder"):
        jc.keep_programs(tmp_path / "programs")
    assert (tmp_path / "programs").read_text() == "a file"


def test_a_full_disk(filled, tmp_path):
    limit = "signal.signal(signal.SIGXFSZ, signal.SIG_IGN); "
    limit += "resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, 10_000)); "
    assert end(start(tmp_path, limit + TRACES)) == filled[1]
    assert not [f for f in (tmp_path / "programs").iterdir() if f.suffix in (".new", ".program")]


def test_two_processes_at_once(filled, tmp_path):
    both = [start(tmp_path, TRACES) for _ in range(2)]
    assert [end(process) for process in both] == [filled[1]] * 2
    assert len(programs(tmp_path)) == 1 and not list(tmp_path.glob("**/*.new"))
    assert end(start(tmp_path, CANNOT)) == filled[1]


WORDS = "jaxcable.analysis.solver", "_analyse"


def key(structure, phases, method=None):
    task = prepare(structure, phases, method, None)
    core = task.thawed, task.arrays, task.method, task.code
    return keeping._key(WORDS, core, {"bundles": task.bundles})


def test_what_a_program_depends_on(monkeypatch):
    structure, phases = jc.scenes.flat_net()
    same = key(structure, phases)
    moved = jc.replace(structure, nodes=np.asarray(structure.nodes) * 1.1)
    order = np.roll(np.arange(12), 1)
    renumbered = jc.replace(structure.elements, links=order[structure.elements.links.array])
    renumbered = jc.Structure(
        np.asarray(structure.nodes)[np.argsort(order)],
        renumbered,
        jc.pinned(np.sort(order[structure.supports.nodes.array])),
    )
    assert key(moved, phases) == same  # a number
    assert key(renumbered, phases) == same  # a topology of equal shape
    others = [
        key(*jc.scenes.saddle(3, 3)),
        key(structure, phases[:1]),
        key(structure, [phases[0], jc.replace(phases[1], increments=3)]),
        key(structure, phases, jc.Newton(linear_solver="superlu")),
        key(structure, phases, jc.Newton(tol=1e-9)),
        key(structure, phases, jc.Incremental(1)),
    ]
    with jax.enable_x64(False), pytest.warns(jc.InputWarning, match="float32"):
        others.append(key(structure, phases))
    with jax.numpy_rank_promotion("allow"):
        others.append(key(structure, phases))
    with monkeypatch.context() as patch:
        patch.setenv("XLA_FLAGS", os.environ.get("XLA_FLAGS", "") + " --xla_any=1")
        assert key(structure, phases) == same  # XLA has read its flags
        patch.setattr(jax_internals, "_flags", ["--xla_any=1"])
        others.append(key(structure, phases))
    with monkeypatch.context() as patch:
        patch.setattr(sys, "version", "another version")
        keeping._machine.cache_clear()
        others.append(key(structure, phases))
    keeping._machine.cache_clear()
    assert len({same, *others}) == 1 + len(others)


def test_what_is_defined_elsewhere_is_not_kept():
    nodes, links = [[0.0, 0, 0], [1.0, 0, 0.1], [2.0, 0, 0]], [[0, 1], [1, 2]]

    def of_law(law):
        cables = jc.Bars(links, area=1e-4, law=law)
        return key(jc.Structure(nodes, cables, jc.pinned([0, 2])), jc.Phase(pretension=1e3))

    assert of_law(jc.Polygonal([0.0, 0.01], [0.0, 2e9]))
    with pytest.raises(code_digest.ForeignError):
        of_law(Prager(2e11, 4e8, 1e10))
    with pytest.raises(code_digest.ForeignError):  # a solver of the tests
        structure, phases = jc.scenes.saddle(8, 8)
        key(structure, phases, jc.Newton(linear_solver=NUMPY))


@pytest.mark.parametrize("folder", ["", "named"])
def test_the_environment_names_the_folder(folder, tmp_path, monkeypatch):
    monkeypatch.setattr(keeping, "_place", [])
    monkeypatch.setenv("JAXCABLE_PROGRAMS", str(tmp_path / folder) if folder else "")
    found = jc.keep_programs()
    assert [place.folder for place in keeping._place] == ([tmp_path / "named"] if folder else [])
    assert not folder or found == tmp_path / "named"


def test_the_folder_for_caches(tmp_path, monkeypatch):
    monkeypatch.setattr(keeping, "_place", [])
    monkeypatch.delenv("JAXCABLE_PROGRAMS")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    if sys.platform.startswith("linux"):
        assert jc.keep_programs() == tmp_path / "jaxcable"
        assert (tmp_path / "jaxcable").stat().st_mode & 0o777 == 0o700


def test_wrong_limits():
    for limit in (-1, 2.5):
        with pytest.raises(ValueError, match="limit"):
            jc.keep_programs("never", limit=limit)


def test_as_many_programs_as_are_allowed(monkeypatch):
    monkeypatch.setattr(compilation, "MOST", 3)
    run = compilation.program(lambda x: 2 * x)
    for n in (1, 2, 3, 4, 2, 5):
        np.testing.assert_array_equal(run(np.ones(n), size=9), 2 * np.ones(n))
    lengths = [program[1][0][0][0] for program in run.known]
    assert lengths == [4, 2, 5]  # those of the last calls
    compilation._PROGRAMS.remove(run)


def test_where_an_argument_lives_and_its_type_matter():
    run = compilation.program(lambda x, y: x + y)
    given = [np.float64(2.0), jnp.float64(2.0), 2.0, 2, np.float32(2.0), jnp.float32(2.0)]
    for x in given:
        assert float(run(x, np.float64(1.0), size=9)) == 3.0
    assert len(run.known) == len(given)
    assert run(jnp.float32(2.0), np.float32(1.0), size=9).dtype == np.float32
    compilation._PROGRAMS.remove(run)


def test_forgotten_programs_are_compiled_again():
    structure, phases = jc.scenes.flat_net()
    before = jc.solve(structure, phases)
    jc.forget_programs()
    assert all(not run.known for run in compilation._PROGRAMS)
    after = jc.solve(structure, phases)
    assert int(before.status) == int(after.status) == 0
    np.testing.assert_array_equal(before.tension, after.tension)
