"""Studies of many cases in files: restarts, shares, and what is refused."""

import os
import signal
import subprocess
import sys
import textwrap
import zipfile

import jax.numpy as jnp
import numpy as np
import pytest

import jaxcable as jc

STRUCTURE, (PRESTRESS, LOADING) = jc.scenes.flat_net()
FORCES = np.random.default_rng(0).uniform(-9.0, 9.0, (23, 4, 3))


def analyse(forces):
    load = jc.NodalLoads(LOADING.loads.nodes, forces)
    solution = jc.solve(STRUCTURE, [PRESTRESS, jc.Phase(loads=load)])
    return {"tension": solution.tension, "status": solution.status}


def files(folder):
    return sorted(f.name for f in folder.iterdir())


@pytest.mark.parametrize("chunk", [5, 23, 100])
def test_results_are_those_of_a_batch(tmp_path, chunk):
    study = jc.streamed(analyse, FORCES, tmp_path, chunk)
    assert study.missing == [] and study.n_chunk == len(files(tmp_path)) - 1 == -(-23 // chunk)
    found = study.load()
    batch = jc.batched(analyse)(jnp.asarray(FORCES))
    assert set(found) == {"tension", "status"}
    assert found["status"].shape == (23,) and not found["status"].any()
    np.testing.assert_allclose(
        found["tension"], batch["tension"], rtol=1e-9
    )  # other orders of sums
    numbers = np.concatenate([numbers for numbers, _ in study.chunks()])
    assert numbers.tolist() == list(range(23))
    assert list(study.load("status")) == ["status"]


def test_what_is_there_is_not_computed_again(tmp_path):
    study = jc.streamed(analyse, FORCES, tmp_path, 5)
    before = study.load()
    times = {name: (tmp_path / name).stat().st_mtime_ns for name in files(tmp_path)}
    study.file(2).unlink()
    assert study.missing == [2]
    with pytest.raises(ValueError, match="1 of 5 chunks are missing, the first is 2"):
        study.load()
    after = jc.streamed(analyse, FORCES, tmp_path, 5).load()
    np.testing.assert_array_equal(after["tension"], before["tension"])
    changed = {n for n in times if (tmp_path / n).stat().st_mtime_ns != times[n]}
    assert changed == {"chunk-000002.npz"}


def test_shares_are_all_of_it_and_do_not_meet(tmp_path):
    def cases(numbers):
        return FORCES[numbers]

    first = jc.streamed(analyse, cases, tmp_path, 4, n_case=23, share=(0, 2))
    assert first.missing == [1, 3, 5]
    second = jc.streamed(analyse, cases, tmp_path, 4, n_case=23, share=(1, 2))
    assert second.missing == []
    whole = jc.streamed(analyse, FORCES, tmp_path / "whole", 4)
    np.testing.assert_array_equal(second.load()["tension"], whole.load()["tension"])


KILLED = """
    import os, signal, sys
    import jax
    jax.config.update("jax_enable_x64", True)
    import numpy as np
    import jaxcable as jc

    def cases(numbers):
        if numbers[0] == 6:
            os.kill(os.getpid(), signal.SIGKILL)
        return numbers.astype(float)

    jc.streamed(lambda x: {"square": x**2}, cases, sys.argv[1], 2, n_case=10)
"""


def test_a_killed_process_loses_nothing_that_it_has_finished(tmp_path):
    command = [sys.executable, "-c", textwrap.dedent(KILLED), str(tmp_path)]
    assert subprocess.run(command, env=os.environ).returncode == -signal.SIGKILL
    assert files(tmp_path) == [f"chunk-00000{k}.npz" for k in range(3)] + ["study.json"]
    begun = []

    def cases(numbers):
        begun.append(int(numbers[0]))
        return numbers.astype(float)

    study = jc.streamed(lambda x: {"square": x**2}, cases, tmp_path, 2, n_case=10)
    assert begun == [6, 8]
    np.testing.assert_array_equal(study.load()["square"], np.arange(10.0) ** 2)


def test_a_file_is_there_as_a_whole_or_not_at_all(tmp_path, monkeypatch):
    def cut(file, **_):
        file.write(b"half")
        raise OSError("no space left")

    with monkeypatch.context() as patch:
        patch.setattr(np, "savez", cut)
        with pytest.raises(OSError, match="no space left"):
            jc.streamed(analyse, FORCES, tmp_path, 5)
    assert files(tmp_path) == ["study.json"]
    study = jc.streamed(analyse, FORCES, tmp_path, 5)
    assert study.missing == [] and all(zipfile.is_zipfile(study.file(k)) for k in range(5))


def test_what_is_refused(tmp_path):
    jc.streamed(analyse, FORCES, tmp_path, 5)
    for other, said in (
        ({"cases": FORCES[:20]}, "n_case = 23, not 20"),
        ({"chunk": 4}, "chunk = 5, not 4"),
        ({"cases": FORCES + 1.0}, "holds a study with cases = "),
    ):
        with pytest.raises(ValueError, match=said):
            jc.streamed(analyse, **{"cases": FORCES, "chunk": 5, "folder": tmp_path, **other})
    new = tmp_path / "new"
    for arguments, options, said in (
        ((FORCES, new, 0), {}, "chunk"),
        ((FORCES, new), {"share": (2, 2)}, "processes are numbered from 0"),
        ((FORCES, new), {"share": (-1, 2)}, r"share\[0\]"),
        ((FORCES, new), {"n_case": 5}, "n_case = 5: there are 23 cases"),
        ((lambda numbers: FORCES[numbers], new), {}, "n_case: missing"),
        (((FORCES, FORCES[:3]), new), {}, "one common leading axis"),
        ((np.zeros((0, 3)), new), {}, "one common leading axis"),
    ):
        with pytest.raises(ValueError, match=said):
            jc.streamed(analyse, *arguments, **options)
    assert not new.exists()
    with pytest.raises(ValueError, match="expected a dict of arrays by name, got"):
        jc.streamed(lambda force: force, FORCES, new)
