"""Studies of many cases in files: restarts, shares, and what is refused."""

import os
import re
import signal
import subprocess
import sys
import textwrap
import zipfile

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcable as jc

STRUCTURE, (PRESTRESS, LOADING) = jc.scenes.flat_net()
NUMBERS = np.arange(6.0)
FORCES = np.random.default_rng(0).uniform(-9.0, 9.0, (23, 4, 3))


def analyse(forces):
    load = jc.NodalLoads(LOADING.loads.nodes, forces)
    solution = jc.solve(STRUCTURE, [PRESTRESS, jc.Phase(loads=load)])
    return {"tension": solution.tension, "status": solution.status}


def square(x):
    return {"square": x**2}


def untouched(folder):
    """The contents of all files of a folder."""
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


def refused(message, function, *arguments, **options):
    with pytest.raises(ValueError, match=message):
        function(*arguments, **options)


def test_results_are_those_of_a_batch(tmp_path):
    study = jc.streamed(analyse, FORCES, tmp_path, 5)
    found = study.load()
    batch = jc.batched(analyse)(jnp.asarray(FORCES))
    assert set(found) == {"tension", "status"}
    assert found["status"].shape == (23,) and not found["status"].any()
    # other orders of sums
    np.testing.assert_allclose(found["tension"], batch["tension"], rtol=1e-9)
    assert list(study.load("status")) == ["status"]


@pytest.mark.parametrize("chunk", [5, 23, 100])
def test_chunks(tmp_path, chunk):
    study = jc.streamed(square, np.arange(23.0), tmp_path, chunk)
    n_chunk = -(-23 // chunk)
    assert study.missing == [] and study.n_chunk == len(untouched(tmp_path)) - 1 == n_chunk
    np.testing.assert_array_equal(study.load()["square"], np.arange(23.0) ** 2)
    numbers = np.concatenate([numbers for numbers, _ in study.chunks()])
    assert numbers.tolist() == list(range(23))


def test_what_is_there_is_not_computed_again(tmp_path):
    study = jc.streamed(square, NUMBERS, tmp_path, 2)
    before = untouched(tmp_path)
    times = {path: path.stat().st_mtime_ns for path in tmp_path.iterdir()}
    study.file(2).unlink()
    assert study.missing == [2]
    refused("1 of 3 chunks are missing, the first is 2", study.load)
    jc.streamed(square, NUMBERS, tmp_path, 2)
    assert untouched(tmp_path) == before
    changed = [path for path in times if path.stat().st_mtime_ns != times[path]]
    assert changed == [study.file(2)]


def test_shares_are_all_of_it_and_do_not_meet(tmp_path):
    def cases(numbers):
        return numbers.astype(float)

    first = jc.streamed(square, cases, tmp_path, 4, n_case=23, share=(0, 2))
    assert first.missing == [1, 3, 5]
    second = jc.streamed(square, cases, tmp_path, 4, n_case=23, share=(1, 2))
    assert second.missing == []
    np.testing.assert_array_equal(second.load()["square"], np.arange(23.0) ** 2)


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
    found = [f"chunk-00000{k}.npz" for k in range(3)]
    assert sorted(untouched(tmp_path)) == [*found, "study.json"]
    begun = []

    def cases(numbers):
        begun.append(int(numbers[0]))
        return numbers.astype(float)

    study = jc.streamed(square, cases, tmp_path, 2, n_case=10)
    assert begun == [0, 6, 8]  # first some cases, to see that they are the same
    np.testing.assert_array_equal(study.load()["square"], np.arange(10.0) ** 2)


def test_a_file_is_there_as_a_whole_or_not_at_all(tmp_path, monkeypatch):
    def cut(file, *_, **__):
        file.write(b"half")
        raise OSError("no space left")

    with monkeypatch.context() as patch:
        patch.setattr("jaxcable.analysis.chunk_files.write_npz", cut)
        with pytest.raises(OSError, match="no space left"):
            jc.streamed(square, NUMBERS, tmp_path, 2)
    assert [*untouched(tmp_path)] == ["study.json"]
    study = jc.streamed(square, NUMBERS, tmp_path, 2)
    assert study.missing == [] and all(zipfile.is_zipfile(study.file(k)) for k in range(3))


def test_what_is_refused(tmp_path):
    jc.streamed(square, NUMBERS, tmp_path, 2)
    for said, cases, chunk in (
        ("n_case = 6, not 4", NUMBERS[:4], 2),
        ("chunk = 2, not 4", NUMBERS, 4),
        ("holds a study with cases = ", NUMBERS + 1.0, 2),
    ):
        refused(said, jc.streamed, square, cases, tmp_path, chunk)
    new = tmp_path / "new"
    for said, cases, options in (
        ("chunk", NUMBERS, {"chunk": 0}),
        ("processes are numbered from 0", NUMBERS, {"share": (2, 2)}),
        (r"share\[0\]", NUMBERS, {"share": (-1, 2)}),
        ("n_case = 5: there are 6 cases", NUMBERS, {"n_case": 5}),
        ("n_case: missing", lambda numbers: NUMBERS[numbers], {}),
        ("one common leading axis", (NUMBERS, NUMBERS[:3]), {}),
        ("one common leading axis", np.zeros((0, 3)), {}),
        (r"expected arrays \[7, ...\] for 7", lambda numbers: np.zeros(3), {"n_case": 7}),
    ):
        refused(said, jc.streamed, square, cases, new, **options)
    assert not new.exists()
    refused("expected a dict of arrays by name, got", jc.streamed, lambda x: x, NUMBERS, new)


def sums(values, key=0):
    """A function of one case that closes over an array and a random key."""
    values, random = np.array(values), jax.random.key(key)
    return lambda x: {"sum": x * values.sum() + jax.random.normal(random)}


def test_another_function_is_refused(tmp_path):
    """Another array or key that it closes over, another result, another model."""

    def model(height):
        structure = jc.replace(STRUCTURE, nodes=STRUCTURE.nodes + np.array([0.0, 0.0, height]))
        return lambda q: {"z": jc.force_density(structure, q)}

    for begun, same, others in (
        (sums([1.0]), sums([1.0]), [sums([2.0]), sums([1.0], key=1), lambda x: {"sum": x}]),
        (model(0.0), model(0.0), [model(1.0)]),
    ):
        folder = tmp_path / str(len(others))
        first = jc.streamed(begun, np.arange(3.0) + 1.0, folder).load()
        before = untouched(folder)
        again = jc.streamed(same, np.arange(3.0) + 1.0, folder).load()
        assert all((again[name] == first[name]).all() for name in first)
        for other in others:
            said = r"with function = \w+, not \w+ .* another folder"
            refused(said, jc.streamed, other, np.arange(3.0) + 1.0, folder)
        assert untouched(folder) == before


def test_other_cases_of_a_function_and_other_versions_are_refused(tmp_path, monkeypatch):
    def cases(scale):
        return lambda numbers: scale * numbers.astype(float)

    def study(scale):
        return jc.streamed(square, cases(scale), tmp_path, 4, n_case=100)

    study(1.0)
    study(1.0)
    refused("a study with cases = ", study, 2.0)
    monkeypatch.setattr(jax, "__version__", "0.1")
    refused("a study with jax = .*, not 0.1; take", study, 1.0)


def test_results_may_have_any_names(tmp_path):
    names = ["file", "allow_pickle", "arr_0", "a", "a.npy", "../a/b", "\u00fc {}", "self"]

    def named(x):
        return {name: x + k for k, name in enumerate(names)}

    jc.streamed(named, np.zeros(3), tmp_path, 2)
    study = jc.streamed(named, np.zeros(3), tmp_path, 2)
    found = study.load()
    assert {n: found[n].tolist() for n in names} == {n: [k] * 3 for k, n in enumerate(names)}
    assert np.load(study.file(0))["allow_pickle"].tolist() == [1.0, 1.0]
    refused("no result 'fle'; there are .*; did you mean 'file'", study.load, "fle")
    for name in ("", "a\nb", 3):
        said, new = "no name of printable characters", tmp_path / "new"
        refused(said, jc.streamed, lambda x, name=name: {name: x}, np.zeros(3), new)
    assert not new.exists()


def put_folder(path):
    path.unlink()
    path.mkdir()


DAMAGES = {  # of the file of a chunk, whose contents and those of the first chunk are given
    "cut": lambda path, data, _: path.write_bytes(data[: len(data) // 2]),
    "empty": lambda path, *_: path.write_bytes(b""),
    "text": lambda path, *_: path.write_text("a letter"),
    "of other cases": lambda path, _, first: path.write_bytes(first),
    "other results": lambda path, *_: np.savez(path, other=np.zeros(1)),
    "objects": lambda path, *_: np.savez(path, square=np.array([{}], dtype=object)),
    "a folder": lambda path, *_: put_folder(path),
    # which only those who read the numbers see
    "a byte": lambda path, data, _: path.write_bytes(data.replace(FOUR, b"\x01" + FOUR[1:])),
}
FOUR = np.float64(4.0).tobytes()


@pytest.mark.parametrize("kind", DAMAGES)
def test_damaged_chunks_are_named(tmp_path, kind):
    study = jc.streamed(square, np.arange(3.0), tmp_path, 2)
    own = study.file(1)
    DAMAGES[kind](own, own.read_bytes(), study.file(0).read_bytes())
    before = untouched(tmp_path)
    said = rf"{re.escape(str(own))}: .*; .*delete this file and run the study again"
    refused(said, study.load)
    if kind != "a byte":
        refused(said, jc.streamed, square, np.arange(3.0), tmp_path, 2)
    assert untouched(tmp_path) == before


def cubed(x):
    return {"square": x**3}  # other values under the same name, of the same shape


@pytest.mark.parametrize(
    ("function", "cases", "k", "said"),
    [
        (cubed, NUMBERS, 1, "holds results of another study"),
        (square, NUMBERS + 1.0, 1, "holds results of another study"),
        (square, np.arange(8.0), 1, "holds results of another study"),
        (square, NUMBERS, 0, "holds the results of chunk 0, not of chunk 1"),
        (square, NUMBERS, 2, "holds the results of chunk 2, not of chunk 1"),
    ],
)
def test_files_of_other_studies_and_chunks_are_named(tmp_path, function, cases, k, said):
    """They have results of the same names, shapes and numbers of cases."""
    study = jc.streamed(square, NUMBERS, tmp_path / "own", 2)
    stranger = jc.streamed(function, cases, tmp_path / "other", 2)
    study.file(1).write_bytes(stranger.file(k).read_bytes())
    before = untouched(study.folder)
    for read in (
        study.load,
        lambda: list(study.chunks()),
        lambda: jc.streamed(square, NUMBERS, study.folder, 2),
        jc.results.Study(study.folder, 6, 2).load,
    ):
        refused(rf"{re.escape(str(study.file(1)))}: {said}.*delete", read)
    assert untouched(study.folder) == before
    (study.folder / "study.json").unlink()  # nothing describes the study: its files disagree
    refused(r"chunk-000001\.npz: holds", study.load)


def test_equal_studies_can_exchange_files(tmp_path):
    """Computed by several machines without a common folder, and gathered."""
    first = jc.streamed(square, np.arange(5.0), tmp_path / "a", 2, share=(0, 2))
    second = jc.streamed(square, np.arange(5.0), tmp_path / "b", 2, share=(1, 2))
    first.file(1).write_bytes(second.file(1).read_bytes())
    assert jc.streamed(square, np.arange(5.0), first.folder, 2).missing == []
    np.testing.assert_array_equal(first.load()["square"], np.arange(5.0) ** 2)


def test_files_that_do_not_say_what_they_are(tmp_path):
    """They are read where the study is of an earlier version, as nothing else can be."""
    study = jc.streamed(square, np.arange(4.0), tmp_path, 2)
    np.savez(study.file(1), square=np.array([7.0, 8.0]))
    for read in (study.load, lambda: jc.streamed(square, np.arange(4.0), tmp_path, 2)):
        refused(r"000001\.npz: does not say of which study", read)
    np.savez(study.file(0), square=np.array([5.0, 6.0]))
    (tmp_path / "study.json").write_text('{"n_case": 4, "chunk": 2, "cases": "ab"}')
    assert study.load()["square"].tolist() == [5.0, 6.0, 7.0, 8.0]
    for n_case, chunk in ((4, 1), (3, 2), (4, 4)):
        said = f"of 4 cases in chunks of 2, not of {n_case} in"
        refused(said, jc.results.Study(tmp_path, n_case, chunk).load)
    (tmp_path / "study.json").unlink()
    assert study.load()["square"].tolist() == [5.0, 6.0, 7.0, 8.0]


def test_folders_of_strangers_are_left_alone(tmp_path):
    for k, (name, content, said) in enumerate(
        (
            ("study.json", "{", r"study.json: damaged, or not of jaxcable"),
            ("study.json", "[1]", "study.json: describes no study of jaxcable"),
            ("study.json", '{"title": "thesis"}', "study.json: describes no study of jaxcable"),
            ("study.json", '{"n_case": 3, "chunk": 2, "cases": "ab"}', "of an earlier version"),
            ("chunk-000001.npz", "mine", "holds chunk-000001.npz but no study.json"),
        )
    ):
        folder = tmp_path / str(k)
        folder.mkdir()
        (folder / name).write_text(content)
        (folder / "letter.txt").write_text("mine")
        before = untouched(folder)
        refused(said, jc.streamed, square, np.arange(3.0), folder, 2)
        assert untouched(folder) == before
    (folder / name).unlink()
    jc.streamed(square, np.arange(3.0), folder, 2)  # beside other files
    assert (folder / "letter.txt").read_text() == "mine" and len(untouched(folder)) == 4
    refused("is a file", jc.streamed, square, np.arange(3.0), folder / "letter.txt", 2)
