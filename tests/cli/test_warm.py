"""`jaxcable warm`: programs compiled in advance are found by analyses that were never made."""

import time

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcable as jc
from jaxcable.analysis import phase_loop
from jaxcable.analysis.common_sizes import pad_analysis
from jaxcable.analysis.preparation import prepare
from jaxcable.cli import main, warm
from jaxcable.common import jax_internals, program_store
from jaxcable.common.fusion import are_loops_fused
from jaxcable.scenes import usual

pytestmark = pytest.mark.skipif(are_loops_fused(), reason="sizes are exact then")


@pytest.fixture
def kept(tmp_path, monkeypatch):
    """A folder for kept programs, and a single usual net."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("JAXCABLE_PROGRAMS", str(tmp_path / "kept"))
    monkeypatch.delenv("JAX_COMPILATION_CACHE_DIR", raising=False)  # of other processes
    monkeypatch.setitem(usual.KINDS, "nets", lambda most: iter([jc.scenes.saddle(1, 2, load=9.0)]))
    jc.forget_programs()
    with program_store.preserve_program_settings():
        # jax's own cache of the suite: what comes from there cannot be written once more
        jax.config.update("jax_compilation_cache_dir", None)
        jax_internals.reset_jax_cache()
        yield tmp_path / "kept"


def files(folder):
    return sorted(path.name for path in (folder / "programs").glob("*.program"))


def test_an_analysis_never_made_finds_its_program(kept, capsys):
    assert main(["warm", "nets", "--size", "small"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("nets: up to 12 elements, 12 unknowns, 2 phases, 12 increments: ")
    assert "with fallbacks" in lines[1] and lines[2].startswith("2 programs in ")
    before = files(kept)
    assert len(before) == 2
    jc.forget_programs()
    structure, (prestress, loading) = jc.scenes.saddle(1, 1, load=30.0)
    with program_store.preserve_program_settings():
        jc.keep_programs(kept)
        solution = jc.solve(structure, [prestress, jc.replace(loading, increments=7)])
    assert int(solution.status) == 0 and len(phase_loop.analyse.known) == 1
    assert files(kept) == before  # nothing was compiled


def test_a_gradient_never_taken_finds_its_program(kept, capsys):
    """By nodes and by pretension, of another net: one program serves for both."""
    assert main(["warm", "nets", "--size", "small", "--gradients"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.rpartition(", ")[2].partition(":")[0] for line in lines[2:5]] == [
        "gradient of displacement",
        "gradient of tension",
        "gradient of displacement and tension",
    ]
    assert lines[5].startswith("5 programs in ")
    before = files(kept)
    assert len(before) == 5
    jc.forget_programs()
    structure, (prestress, loading) = jc.scenes.saddle(1, 1, load=30.0)

    def results(nodes, pretension):
        moved = jc.replace(structure, nodes=nodes)
        phases = [jc.replace(prestress, pretension=pretension), loading]
        return jc.solve(moved, phases)

    def sag(*given):
        return jnp.sum(results(*given).displacement[:, 2])

    def both(*given):
        solution = results(*given)
        return jnp.sum(solution.displacement[:, 2]) * jnp.sum(solution.tension)

    with program_store.preserve_program_settings():
        jc.keep_programs(kept)
        for function in (sag, both):
            slopes = jax.grad(function, (0, 1))(np.asarray(structure.nodes), 1e3)
            assert all(np.isfinite(x).all() for x in slopes)
        tension = jax.grad(lambda force: jnp.sum(results(structure.nodes, force).tension))(1e3)
        assert float(tension) > 0
    assert files(kept) == before  # nothing was compiled


@pytest.mark.slow
def test_a_gradient_by_areas_finds_its_program(kept, capsys):
    """A cantilever with other fibres, by nodes and by areas: two programs."""

    def cantilever(count):
        angles = 2 * np.pi / count * np.arange(count)
        y, z, area = 0.02 * np.cos(angles), 0.02 * np.sin(angles), np.full(count, 1e-3 / count)
        section = jc.Section(y=y, z=z, area=area, laws=[jc.Elastic(200e9)])
        beams = jc.Beams([[0, 1], [1, 2]], section, torsional_stiffness=1e4, up=(0.0, 0.0, 1.0))
        nodes = np.linspace([0.0, 0, 0], [2.0, 0, 0], 3)
        load = jc.Phase(loads=jc.NodalLoads([2], (30.0, 40.0, -50.0)))
        return jc.Structure(nodes, beams, jc.clamped([0])), [load]

    jc.save_scene("beam.json", cantilever(5))
    assert main(["warm", "beam.json", "--gradients"]) == 0
    assert "gradient of displacement by sections, too: " in capsys.readouterr().out
    before = files(kept)
    jc.forget_programs()
    structure, phases = cantilever(7)
    section = structure.elements.section

    def tip(nodes, area):
        beams = jc.replace(structure.elements, section=jc.replace(section, area=area))
        moved = jc.replace(structure, nodes=nodes, elements=beams)
        return jc.solve(moved, phases).displacement[2, 2]

    with program_store.preserve_program_settings():
        jc.keep_programs(kept)
        nodes, area = np.asarray(structure.nodes), np.asarray(section.area)
        for by in (0, 1):
            assert np.abs(jax.grad(tip, by)(nodes, area)).max() > 0
    assert files(kept) == before  # nothing was compiled


def test_a_scene_of_the_user(kept, capsys):
    """Also one that cannot be padded, for its own sizes: loads that follow the net."""
    structure, (prestress, _) = jc.scenes.saddle(2, 2)
    wind = jc.Phase(loads=jc.FacePressure([[0, 1, 2]], 50.0))
    jc.save_scene("wind.json", (structure, [prestress, wind]))
    assert main(["warm", "wind.json"]) == 0
    assert "wind.json: up to its own sizes" in capsys.readouterr().out
    assert files(kept)


def test_in_the_background(kept, capfd):
    """The command returns at once; programs appear within the time that one takes."""
    jc.save_scene("net.json", jc.scenes.saddle(1, 1))
    begin = time.monotonic()
    assert main(["warm", "net.json", "--background"]) == 0
    assert time.monotonic() - begin < 5.0
    assert "in the background (process " in capfd.readouterr().out
    while time.monotonic() - begin < 120.0:
        if (kept / "programs").is_dir() and len(files(kept)) == 2:
            break
        time.sleep(0.2)
    assert len(files(kept)) == 2
    assert warm._started.pop().wait(60.0) == 0


@pytest.mark.parametrize("words", [["ropes"], ["nets", "none.json"]])
def test_what_is_unknown_is_refused(words, kept, capsys):
    assert main(["warm", *words]) == 2
    text = f"warm: {words[-1]}: expected a scene, or one of nets, domes, masts, frames"
    assert text in capsys.readouterr().err


def test_without_kept_programs_there_is_nothing_to_warm(kept, monkeypatch, capsys):
    monkeypatch.setenv("JAXCABLE_PROGRAMS", "")
    assert main(["warm", "nets"]) == 2
    assert "warm: no programs are kept; let JAXCABLE_PROGRAMS name" in capsys.readouterr().err


@pytest.mark.parametrize("kind", ["nets", "domes", "masts", "frames"])
def test_usual_scenes_are_sound(kind):
    """They can be padded; the smallest and one of the largest small ones converge."""
    scenes = list(usual.KINDS[kind](usual.SIZES["small"]))
    keys = set()
    for structure, phases in scenes:
        task = prepare(structure, phases, None, None, to_end=True)
        padded = pad_analysis(task, (task.without_indices, task.arrays, task.method, task.code))
        assert padded is not None
        keys.add((jax.tree.structure(padded[0]), padded[2]))
    assert len(keys) < len(scenes)
    for structure, phases in (scenes[0], scenes[-1]):
        assert int(jc.solve(structure, phases).status) == 0
