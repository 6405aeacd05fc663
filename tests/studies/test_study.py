"""Studies in this process: cases, results in the store, what is computed again and what is not."""

import itertools
import os
import signal
import subprocess
import sys
import textwrap

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcable as jc
from jaxcable.common import status
from jaxcable.studies.grid import divide_into_chunks

STRUCTURE, (PRESTRESS, LOADING) = jc.scenes.flat_net()
FORCES = np.random.default_rng(0).uniform(-9.0, 9.0, (23, 4, 3))
LIMIT = 400  # seconds that a process may take on a machine that does other work


def analyse(forces):
    load = jc.NodalLoads(LOADING.loads.nodes, forces)
    solution = jc.solve(STRUCTURE, [PRESTRESS, jc.Phase(loads=load)])
    return {"tension": solution.tension, "status": solution.status}


def square(x):
    return {"square": x**2}


def contents(folder):
    """The contents of all files below a folder, by path."""
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def refused(message, function, *arguments, **options):
    with pytest.raises(ValueError, match=message):
        function(*arguments, **options)


# --- cases and results


@pytest.mark.slow
def test_results_are_those_of_a_batch(tmp_path):
    study = jc.study(analyse, FORCES, tmp_path / "a", chunk=5)
    found = study.load()
    batch = jc.batched(analyse)(jnp.asarray(FORCES))
    assert set(found) == {"tension", "status"} and study.failures == {}
    assert found["status"].shape == (23,) and not found["status"].any()
    # other orders of sums
    np.testing.assert_allclose(found["tension"], batch["tension"], rtol=1e-9)
    assert list(study.load("status")) == ["status"]


@pytest.mark.slow_cases("1", "4")
@pytest.mark.parametrize("chunk", [1, 4, 7, 1000])
def test_every_combination_is_where_its_coordinates_say(tmp_path, chunk):
    values = {"a": [1.0, 2.0, 5.0], "b": [[0.0, 1.0], [2.0, 3.0]], "c": np.arange(5)}
    cases = jc.studies.product(values)

    def function(case):
        return {"y": case["a"] + 10 * case["b"].sum() + 100 * case["c"]}

    study = jc.study(function, cases, tmp_path / "a", chunk=chunk)
    y = study.load("y")["y"]
    assert y.shape == (3, 2, 5) and study.n_case == 30
    for i, j, k in itertools.product(range(3), range(2), range(5)):
        assert y[i, j, k] == values["a"][i] + 10 * sum(values["b"][j]) + 100 * k


@pytest.mark.parametrize(
    ("shape", "chunk", "chunks"),
    [((7,), 3, (3,)), ((4, 5), 7, (1, 5)), ((3, 2, 5), 10, (1, 2, 5)), ((2, 9), 1, (1, 1))],
)
def test_chunks_are_all_cases_once(shape, chunk, chunks):
    grid = divide_into_chunks(shape, chunk)
    assert grid.chunks == chunks  # whole last dimensions, which change fastest
    numbers = [grid.numbers(k) for k in range(grid.n_chunk)]
    assert sorted(np.concatenate(numbers).tolist()) == list(range(int(np.prod(shape))))
    assert max(map(len, numbers)) == grid.chunk_size <= chunk


def test_results_are_masked_and_written_by_xarray(tmp_path):
    """Texts and marks are coordinates: masks and extremes of all results leave them out."""
    x = np.arange(6.0)
    x[3] = -1.0
    data = jc.study(rooted, x, tmp_path / "a", chunk=4).open()
    assert set(data.data_vars) == {"root", "n"} and "completed" in data.coords
    good = data.where(data.cause == "", drop=True)
    assert good.sizes["case"] == 5 and float(data.max().root) == 5.0**0.5
    good.drop_vars("cause").to_netcdf(tmp_path / "b.nc", engine="scipy")
    assert all(isinstance(value, str) for value in data.attrs.values())


def test_results_of_any_kind_of_number(tmp_path):
    def function(x):
        kinds = {"flag": x > 1, "count": jnp.uint8(x), "wave": x + 1j * x}
        return kinds | {"single": jnp.float32(x), "n": jnp.int64(x)}

    found = jc.study(function, np.arange(4.0), tmp_path / "a", chunk=3).load()
    assert found["flag"].dtype == bool and found["flag"].tolist() == [False, False, True, True]
    for name, kind in (("count", np.uint8), ("single", np.float32), ("n", int)):
        assert found[name].dtype == kind and found[name].tolist() == [0, 1, 2, 3]
    np.testing.assert_array_equal(found["wave"], np.arange(4) * (1 + 1j))


@pytest.mark.parametrize("double", [False, True])
def test_precision_is_that_of_the_calling_thread(tmp_path, double):
    with jax.enable_x64(double):
        study = jc.study(lambda x: {"third": x / 3}, np.arange(1.0, 4.0), tmp_path / "a", chunk=2)
    kind = np.float64 if double else np.float32
    np.testing.assert_array_equal(study.load()["third"], np.arange(1, 4, dtype=kind) / kind(3))


def test_results_of_another_kind_are_refused(tmp_path):
    def draw(numbers):
        return numbers.astype(float if numbers[0] >= 20 else int)

    with pytest.raises(jc.studies.StudyError, match=r"are \['float64'\], and others \['int64'\]"):
        jc.study(lambda x: {"y": 2 * x}, jc.studies.samples(draw, 40), tmp_path / "a", chunk=10)
    assert jc.studies.Study(tmp_path / "a").missing == [2, 3]


def test_names_and_places_may_be_any_text(tmp_path):
    cases = jc.studies.table([1.0, 2.0], labels=["Böe", "雪"], dim="Einwirkung")
    options = {"coords": {"y_0": [np.nan, 1.0]}, "dims": {"z": ["Stütze 1.5"]}}
    for _ in range(2):  # the second call finds the same
        study = jc.study(
            lambda x: {"y": x * jnp.ones(2), "z": x * jnp.ones(3)}, cases, tmp_path / "a", **options
        )
    data = study.open()
    assert data.y.sel(Einwirkung="雪").values.tolist() == [2.0, 2.0]
    assert data.z.dims == ("Einwirkung", "Stütze 1.5")


def test_samples_are_drawn_by_their_numbers(tmp_path):
    drawn = []

    def draw(numbers):
        drawn.append(numbers)
        return {"x": np.stack([np.random.default_rng(k).normal(size=2) for k in numbers])}

    cases = jc.studies.samples(draw, 50, dim="wall")
    study = jc.study(lambda case: {"s": case["x"].sum()}, cases, tmp_path / "a", chunk=20)
    expected = [np.random.default_rng(k).normal(size=2).sum() for k in range(50)]
    np.testing.assert_allclose(study.load()["s"], expected, rtol=1e-14)  # rounding of one sum
    assert study.open().s.dims == ("wall",)
    assert max(map(len, drawn)) == 20  # never all at once


# --- failed cases


def root(x):
    """A square root on the host that does not take negative numbers."""

    def on_host(value):
        if (value < 0).any():
            raise ValueError(f"no root of {value.min()}")
        return np.sqrt(value)

    shape = jax.ShapeDtypeStruct((), x.dtype)
    return {"root": jax.pure_callback(on_host, shape, x, vmap_method="expand_dims"), "n": 1}


def rooted(x):
    found = root(x)
    return {"root": found["root"], "n": jnp.int32(x > 0)}


def test_cases_that_raise_are_alone(tmp_path):
    x = np.arange(100.0)
    x[[7, 8, 63]] *= -1
    study = jc.study(rooted, x, tmp_path / "a", chunk=40)
    found, good = study.load(), x >= 0
    np.testing.assert_array_equal(found["root"][good], np.sqrt(x[good]))
    assert np.isnan(found["root"][~good]).all() and (found["n"][~good] == -1).all()
    assert sorted(study.failures) == [7, 8, 63]
    assert study.failures[63] == "ValueError: no root of -63.0"


def test_a_case_that_raises_has_no_status(tmp_path):
    def function(x):
        return rooted(x) | {"status": jnp.where(x == 2.0, 6, jnp.where(x == 3.0, 1000, 0))}

    study = jc.study(function, np.array([1.0, -1.0, 2.0, 3.0]), tmp_path / "a")
    assert study.load("status")["status"].tolist() == [0, -1, 6, 1000]
    known = study.open().status
    meanings = dict(zip(known.flag_values, known.flag_meanings.split(), strict=True))
    assert meanings[status.MECHANISM] == "mechanism" and len(meanings) == len(status.NAMES)
    causes = "ValueError: no root of -1.0", jc.describe(status.MATERIAL_FAILURE), "status 1000"
    assert study.failures == dict(zip((1, 2, 3), causes, strict=True))


def test_a_function_that_raises_for_all_cases_is_an_error(tmp_path):
    with pytest.raises(
        jc.studies.StudyError, match=r"chunk 0 \(cases 0 to 29\): ValueError: no root"
    ):
        jc.study(rooted, -1.0 - np.arange(50.0), tmp_path / "a", chunk=30)
    study = jc.studies.Study(tmp_path / "a")
    assert study.missing == [0, 1]
    refused("2 of 2 chunks are missing, the first is 0", study.load)


# --- interruptions


def test_what_is_there_is_not_computed_again(tmp_path):
    study = jc.study(square, np.arange(6.0), tmp_path / "a", chunk=2)
    before = contents(tmp_path)
    times = {path: path.stat().st_mtime_ns for path in before}
    for name in ("completed", "square"):  # the mark is not enough
        path = study.store / name / "c" / "2"
        path.unlink()
        assert study.missing == [2]
        refused("1 of 3 chunks are missing, the first is 2", study.load)
        jc.study(square, np.arange(6.0), tmp_path / "a", chunk=2)
        assert contents(tmp_path) == before
    changed = {path for path in times if path.stat().st_mtime_ns != times[path]}
    assert {path.name for path in changed} == {"2"} and len(changed) == 3


SCRIPT = """
    import os, resource, signal, sys
    import jax
    jax.config.update("jax_enable_x64", True)
    import numpy as np
    import jaxcable as jc

    def draw(numbers):
        if numbers[0] == 3000 and "STOP" in os.environ:
            {action}
        return numbers.astype(float)

    cases = jc.studies.samples(draw, 10_000)
    jc.study(lambda x: {{"square": x**2}}, cases, sys.argv[1], chunk=500)
"""


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="signals of POSIX")
@pytest.mark.parametrize(
    ("action", "returned", "said", "n_missing"),
    [
        ("os.kill(os.getpid(), signal.SIGKILL)", -9, "", 14),
        ("os.kill(os.getpid(), signal.SIGTERM)", 143, "", 13),
        ("os.kill(os.getpid(), signal.SIGINT)", -2, "KeyboardInterrupt", 13),
        ("resource.setrlimit(resource.RLIMIT_FSIZE, (100, 100))", 1, "File too large", 14),
    ],
    ids=["killed", "terminated", "interrupted", "full"],
)
def test_an_interrupted_study_goes_on(tmp_path, action, returned, said, n_missing):
    """What was computed before stays as it is, and only the rest is computed by the next call."""
    code = textwrap.dedent(SCRIPT.format(action=action))
    words = [sys.executable, "-c", code, str(tmp_path / "a")]
    options = {"timeout": LIMIT, "capture_output": True, "text": True}
    done = subprocess.run(words, env={**os.environ, "STOP": "1"}, **options)
    assert done.returncode == returned and said in done.stderr, done.stderr
    study = jc.studies.Study(tmp_path / "a")
    assert len(study.missing) == n_missing
    times = {path: path.stat().st_mtime_ns for path in contents(tmp_path)}
    done = subprocess.run(words, env=os.environ, **options)
    assert done.returncode == 0, done.stderr
    np.testing.assert_array_equal(study.load()["square"], np.arange(10_000.0) ** 2)
    unfinished = {  # a part that is no chunk yet: removed by nobody, and read by nobody
        path for path in times if ".partial" in path.name or path.name in ("6", "zarr.json")
    }
    for path in set(times) - unfinished:
        assert path.stat().st_mtime_ns == times[path]


def test_signals_are_obeyed_again_after_a_study(tmp_path):
    before = signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)

    def draw(numbers):
        if numbers[0] == 40 and not called:
            called.append(True)
            os.kill(os.getpid(), signal.SIGINT)
        return numbers.astype(float)

    called = []
    cases = jc.studies.samples(draw, 100)
    with pytest.raises(KeyboardInterrupt):
        jc.study(square, cases, tmp_path / "a", chunk=20)
    assert (signal.getsignal(signal.SIGINT), signal.getsignal(signal.SIGTERM)) == before
    assert jc.studies.Study(tmp_path / "a").missing == [3, 4]  # chunk 2 was finished


def test_progress_tells_chunks_and_failures(tmp_path):
    x, reports = np.arange(100.0), []
    x[7] = -1.0
    jc.study(rooted, x, tmp_path / "a", chunk=30, progress=reports.append)
    assert [(news.chunk, news.chunks) for news in reports] == [(k, 4) for k in (1, 2, 3, 4)]
    assert reports[-1].n_failed == 1 and reports[-1].left == 0.0 and reports[0].first
    assert all(news.rate > 0 for news in reports)
    (tmp_path / "a" / "completed" / "c" / "1").unlink()
    reports.clear()
    jc.study(rooted, x, tmp_path / "a", chunk=30, progress=reports.append)
    assert [(news.chunk, news.chunks) for news in reports] == [(4, 4)]


# --- stores of others, and damaged ones


def test_folders_of_others_are_left_alone(tmp_path):
    import zarr

    (tmp_path / "texts").mkdir()
    (tmp_path / "texts" / "letter.txt").write_text("dear")
    zarr.create_group(tmp_path / "zarr")
    (tmp_path / "file").write_text("one")
    before = contents(tmp_path)
    for name in ("texts", "zarr", "file"):
        refused(f"{name}.* holds no study", jc.study, square, np.arange(3.0), tmp_path / name)
    assert contents(tmp_path) == before
    (tmp_path / "empty").mkdir()
    jc.study(square, np.arange(3.0), tmp_path / "empty")
    assert not [path for path in tmp_path.iterdir() if path.name.startswith(".")]


@pytest.mark.parametrize("kind", ["cut", "changed", "of another chunk"])
def test_damaged_chunks_are_named(tmp_path, kind):
    study = jc.study(square, np.arange(600.0), tmp_path / "a", chunk=200)
    path = study.store / "square" / "c" / "1"
    whole = path.read_bytes()
    n = len(whole) // 2
    damaged = {"cut": whole[:n], "of another chunk": b""}
    damaged["changed"] = whole[:n] + bytes([whole[n] ^ 1]) + whole[n + 1 :]
    path.write_bytes(damaged[kind])
    refused(r"square.c.1: is damaged .*; delete this file", study.load)
    path.unlink()
    jc.study(square, np.arange(600.0), tmp_path / "a", chunk=200)
    assert path.read_bytes() == whole


def test_a_damaged_description_is_named(tmp_path):
    study = jc.study(square, np.arange(3.0), tmp_path / "a")
    path, said = study.store / "zarr.json", "holds no study of jaxcable, or is damaged"
    for text in ("", "{", path.read_text().replace("jaxcable_study", "other")):
        path.write_text(text)
        refused(said, jc.study, square, np.arange(3.0), path.parent)
        refused(said, study.load)


READ = """
    import sys
    sys.modules["jaxcable"] = sys.modules["jax"] = None
    import xarray
    data = xarray.open_zarr(sys.argv[1])
    print(float(data.y.sel(F=2.0)), data.y.units, data.sizes["F"])
"""
COMPUTE = """
    import sys
    sys.modules["dask"] = sys.modules["distributed"] = sys.modules["cloudpickle"] = None
    import jaxcable as jc
    import numpy as np
    cases = jc.studies.product(F=np.arange(1.0, 3.0))
    study = jc.study(lambda case: {"y": 3 * case["F"]}, cases, sys.argv[1], units={"y": "m"})
    print(study.load()["y"][1], study.open().y.units, study.n_case)
"""


@pytest.mark.slow_cases("without dask")
@pytest.mark.parametrize("code", [READ, COMPUTE], ids=["without this package", "without dask"])
def test_a_store_is_read_without_this_package_and_a_study_needs_no_dask(code, tmp_path):
    if code is READ:
        cases = jc.studies.product(F=[1.0, 2.0])
        jc.study(lambda case: {"y": 3 * case["F"]}, cases, tmp_path / "a.zarr", units={"y": "m"})
    words = [sys.executable, "-W", "error", "-c", textwrap.dedent(code), str(tmp_path / "a.zarr")]
    done = subprocess.run(words, timeout=LIMIT, capture_output=True, text=True)
    assert done.stdout.split() == ["6.0", "m", "2"], done.stderr


# --- input


def test_wrong_input_is_refused(tmp_path):
    y = lambda case: {"y": 2 * case["F"], "v": jnp.ones(3) * case["F"]}  # noqa: E731
    cases = jc.studies.product(F=[1.0, 2.0])
    for said, options in (
        ("chunk", {"chunk": 0}),
        ("patience = nan: expected a positive number", {"patience": float("nan")}),
        (r"dims\['v'\] = \['a', 'b'\]: .* of 1 different names", {"dims": {"v": ["a", "b"]}}),
        (r"dims\['v'\] = 'a': expected a list", {"dims": {"v": "a"}}),
        ("dims = .*: expected a dict", {"dims": ["a"]}),
        (r"dims\['v'\] = \['F'\].*other than those of dimensions", {"dims": {"v": ["F"]}}),
        (r"dims\['v'\] = \['y'\]", {"dims": {"v": ["y"]}}),
        ("dims: 'w' is no result; there are 'v', 'y'", {"dims": {"w": ["a"]}}),
        ("units: 'w' is no result", {"units": {"w": "m"}}),
        ("coords: 'w' is no dimension", {"coords": {"w": [1.0]}}),
        (
            r"coords\['v_0'\] has shape \(2,\), the dimension has length 3",
            {"coords": {"v_0": [1, 2]}},
        ),
        ("client: expected None, or a distributed.Client", {"client": "tcp://here:8786"}),
    ):
        refused(said, jc.study, y, cases, tmp_path / "a", **options)
    for said, function in (
        ("expected a dict of arrays by name, got tuple", lambda case: (case["F"],)),
        ("got an empty one", lambda case: {}),
        ("'y' is a dict, no array; expected numbers", lambda case: {"y": {"z": case["F"]}}),
        ("cannot be the name of an array", lambda case: {"a/b": case["F"]}),
        ("'F' has the name of something else", lambda case: {"F": case["F"]}),
        ("'cause' cannot be the name of an array", lambda case: {"cause": case["F"]}),
        ("no numbers", lambda case: {"y": jnp.zeros(0)}),
        (r"'status' is int64\[2\], expected one code", lambda case: {"status": jnp.zeros(2, int)}),
        ("'status' is float64", lambda case: {"status": case["F"]}),
        ("not a valid JAX type", lambda case: {"y": "high"}),
    ):
        refused(said, jc.study, function, cases, tmp_path / "a")
    assert not (tmp_path / "a").exists()


def test_wrong_cases_are_refused():
    product, table, samples = jc.studies.product, jc.studies.table, jc.studies.samples
    refused("expected values by name, got none", product)
    refused(r"F has shape \(\), expected values", product, F=1.0)
    refused("F has shape", product, F=[])
    refused("is of <U1, expected numbers; names of cases are `labels`", product, F=["a"])
    refused("one common leading axis", table, {"a": [1.0, 2.0], "b": [1.0]})
    refused("one common leading axis", table, np.zeros((0, 3)))
    refused("labels: expected different names", table, [1.0, 2.0], labels=["a", "a"])
    refused(r"give studies.samples\(function, n_case\)", table, lambda numbers: numbers)
    refused("expected values by name, got list", product, [1.0])
    refused("labels: 1 labels for 2 cases", table, [1.0, 2.0], labels=["a"])
    refused("is the name of an array", table, {"case": [1.0]}, labels=["a"])
    refused("n_case", samples, lambda numbers: numbers, 0)
    refused("draw: expected a function", samples, np.zeros(3), 3)
    refused("dim: 'a/b' cannot be the name", table, [1.0], dim="a/b")
    for name in ("completed", "cause", "zarr.json", "a/b", "", "__a"):
        refused("cannot be the name of an array", product, {name: [1.0]})
        refused("cannot be the name of an array", table, {name: [1.0]})
    cases = samples(lambda numbers: np.zeros(2), 5)
    refused(r"draw: expected arrays \[5, ...\]", cases.digest)


@pytest.mark.parametrize("package", ["zarr", "xarray"])
def test_missing_packages_are_named(tmp_path, monkeypatch, package):
    real = jc.studies.study.importlib.util.find_spec
    monkeypatch.setattr("importlib.util.find_spec", lambda n: None if n == package else real(n))
    with pytest.raises(ModuleNotFoundError, match=r'pip install "jaxcable\[studies\]"'):
        jc.study(square, np.arange(3.0), tmp_path / "a").open()
