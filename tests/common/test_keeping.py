"""Programs kept on disk for the next process (`keep_programs`), and forgotten (`forget_programs`).

Whether a program came from disk is seen from outside: where nothing can be traced, it runs all the
same.
"""

import json
import os
import subprocess
import sys
import textwrap
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from extensions.own_laws import Prager
from extensions.own_solver import NUMPY
from test_digest import module_texts

import jaxcable as jc
from jaxcable.analysis.preparation import prepare
from jaxcable.common import compilation, host_calls, jax_internals, program_store, python_objects
from jaxcable.common.program_folder import open_program_folder
from jaxcable.numerics import vectors

# --- other processes

PROCESS = """
    import json, sys, threading
    import jax
    jax.config.update("jax_enable_x64", True)
    import jaxcable as jc
    told = {"modules": sorted(sys.modules)}
    import jax.numpy as jnp, numpy as np
    from jaxcable.common import digest, host_calls
    from users_module import cases

    role, folder = sys.argv[1:]
    hits = []
    jax.monitoring.register_event_listener(lambda name, **_: hits.append(name))
    jc.keep_programs(folder)
    setting = "jax_persistent_cache_min_compile_time_secs"
    assert getattr(jax.config, setting) == 0.05

    # digests
    structure, phases = jc.scenes.flat_net()
    def analysed(load):
        heavy = jc.replace(phases[1].loads, forces=phases[1].loads.forces * load)
        solution = jc.solve(structure, [phases[0], jc.replace(phases[1], loads=heavy)])
        return {"z": solution.displacement, "of": {k: solution.status for k in {"a", "b", "c"}}}
    def host(x):
        return jax.pure_callback(lambda y: np.asarray(y) * 2.0, jax.ShapeDtypeStruct((), float), x)
    told["digests"] = [
        digest.of_function(jc.batched(analysed, 4), np.ones(5)),
        digest.of_function(host, 1.0),
        digest.of_host_function(cases),
    ]

    # a program with a function of NumPy, in the cache of jax
    @host_calls.register_host_function_family
    def double():
        return lambda x: (2 * x,)
    jax.config.update(setting, 0)
    shape = jax.ShapeDtypeStruct((3,), jnp.float32)
    lowered = jax.jit(lambda x: host_calls.call_on_host([double], [shape], x)).lower(shape)
    hits.clear()
    twice = lowered.compile()
    told["found"] = hits.count("/jax/compilation_cache/cache_hits")
    told["twice"] = np.asarray(twice(np.ones(3, np.float32))[0]).tolist()
    jax.config.update(setting, 0.05)

    # analyses, in threads where they are compiled
    jc.progress.SHOW.pause = 0.0
    saddle, told["tension"] = jc.scenes.saddle(3, 3), {}
    superlu = jc.Newton(linear_solver="superlu")
    works = {
        "dense": lambda: jc.solve(*saddle),
        "superlu": lambda: jc.solve(*saddle, superlu, progress=True),
        "banded": lambda: jc.solve(*jc.scenes.saddle(8, 8)),  # a net of that size gets it
    }
    def work(name):
        solution = works[name]()
        jc.raise_if_failed(solution)
        told["tension"][name] = np.asarray(solution.tension).tobytes().hex()
    if role == "next":
        def no_tracing(*_, **__):
            raise AssertionError("traced")
        jax.jit = no_tracing  # of jax: a program of changed code would not be found
        for name in works:
            work(name)
        try:
            jc.solve(*jc.scenes.saddle(2, 2))  # the control
        except AssertionError as error:
            told["control"] = str(error)
    else:
        names = works if role == "first" else ["dense"]
        threads = [threading.Thread(target=work, args=(name,)) for name in names]
        for thread in threads: thread.start()
        for thread in threads: thread.join()
    assert getattr(jax.config, setting) == 0.05
    print(json.dumps(told))
"""


def started(folder, role, seed):
    """A process that writes or reads programs in a folder; texts have other hashes in each."""
    clean = {k: v for k, v in os.environ.items() if not k.startswith("JAX_")}
    clean |= {"JAX_DISABLE_MOST_OPTIMIZATIONS": "1", "PYTHONHASHSEED": seed}
    clean["PYTHONPATH"] = os.pathsep.join([str(folder), *sys.path])
    words = [sys.executable, "-W", "error", "-c", textwrap.dedent(PROCESS), role]
    pipe = subprocess.PIPE
    return subprocess.Popen(
        [*words, str(folder / "kept")], env=clean, stdout=pipe, stderr=pipe, text=True
    )


def programs(folder):
    return sorted((folder / "programs").glob("*.program"))


def described_modules():
    """Names of all modules of the package that programs can be made of."""
    root = Path(jc.__file__).parent
    files = [path.relative_to(root).with_suffix("").parts for path in root.rglob("*.py")]
    modules = {".".join(("jaxcable", *parts)).removesuffix(".__init__") for parts in files}
    return set(filter(python_objects.is_program_module, modules))


def test_another_process_neither_traces_nor_compiles(tmp_path):
    """Two write at once, one of them from threads, and programs that call the host; a third reads.

    All agree on digests, and have what programs are made of from the beginning: a module that is
    imported later would be missing in the digest of the code.
    """
    for module, text in module_texts().items():
        (tmp_path / f"{module}.py").write_text(text)
    both = [started(tmp_path, role, seed) for role, seed in (("first", "1"), ("beside", "2"))]
    said = [process.communicate(timeout=300) for process in both]
    assert [process.returncode for process in both] == [0, 0], said
    folder = tmp_path / "kept"
    assert len(programs(folder)) == 3 and not list(folder.glob("**/*.new"))
    process = started(tmp_path, "next", "3")
    said.append(process.communicate(timeout=300))
    assert process.returncode == 0, said[-1][1]
    assert "phase 2 of 2" in said[-1][1]  # the progress of a program that is kept
    assert not any("Warning" in err for _, err in said)
    first, beside, after = told = [json.loads(out) for out, _ in said]
    assert after["tension"] == first["tension"] and len(first["tension"]) == 3
    assert beside["tension"]["dense"] == first["tension"]["dense"]
    assert after["control"] == "traced"
    assert first["digests"] == beside["digests"] == after["digests"]
    assert len(set(first["digests"])) == 3
    # the function of NumPy; the third finds it in the cache of jax
    assert [own["twice"] for own in told] == [[2.0, 2.0, 2.0]] * 3
    assert after["found"] == 1
    assert described_modules() <= set(first["modules"]) and len(described_modules()) > 150
    for run in compilation._PROGRAMS:
        made = run.__wrapped__
        if made.__module__.startswith("jaxcable"):
            assert (
                python_objects.is_program_module(made.__module__) and "<" not in made.__qualname__
            )


# --- a small program of the package, in this process


def no_tracing(*_, **__):
    raise AssertionError("traced")


def product(traced=True):
    """1 + 2 + 3, by a program that this process knows as little as a new one does."""
    run = compilation.jit_program(vectors.scalar_product)
    compilation._PROGRAMS.remove(run)
    with pytest.MonkeyPatch.context() as patch:
        if not traced:
            patch.setattr(jax, "jit", no_tracing)
        return float(run(np.arange(1.0, 4.0), np.ones(3), size=9))


@pytest.fixture
def kept(nothing_kept, tmp_path):
    """A folder with one program."""
    with pytest.raises(AssertionError, match="traced"):
        product(traced=False)
    jc.keep_programs(tmp_path)
    assert product() == product(traced=False) == 6.0 and len(programs(tmp_path)) == 1
    return tmp_path


def test_jax_keeps_programs_beside_ours_and_only_meanwhile(nothing_kept, tmp_path):
    names = "jax_compilation_cache_dir", "jax_persistent_cache_min_compile_time_secs"

    def settings():
        return [getattr(jax.config, name) for name in names]

    before = settings()
    jc.keep_programs(tmp_path)
    assert settings() == [str(tmp_path / "xla"), 0.05]
    jc.keep_programs(limit=0)
    assert settings() == before and product() == 6.0 and not programs(tmp_path)


@pytest.mark.parametrize("damage", ["cut", "changed", "empty"])
def test_a_damaged_file_is_made_again(damage, kept):
    (path,) = programs(kept)
    text = bytearray(path.read_bytes())
    text[len(text) // 2] ^= 1
    path.write_bytes({"cut": text[: len(text) // 2], "changed": text, "empty": b""}[damage])
    with pytest.warns(RuntimeWarning, match="the file is damaged; the program is compiled again"):
        assert product() == 6.0
    assert product(traced=False) == 6.0


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="Linux's folder of processes")
def test_a_disk_on_which_no_folder_can_be_made(nothing_kept):
    jc.keep_programs("/proc/jaxcable")
    assert product() == 6.0


def test_a_full_disk(nothing_kept, tmp_path):
    resource = pytest.importorskip("resource")
    jc.keep_programs(tmp_path)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, hard))  # Python ignores the signal of it
    try:
        assert product() == 6.0
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert [path.name for path in (tmp_path / "programs").iterdir()] == ["CACHEDIR.TAG"]
    assert product() == product(traced=False) == 6.0


@host_calls.register_host_function_family
def hears():
    return lambda x: ()


def test_programs_that_call_by_address_are_not_kept(tmp_path):
    """Those with listeners of the user; `progress.SHOW` is called by its name."""
    place = open_program_folder(tmp_path, 1 << 20)
    for k, told in enumerate(
        (
            lambda x: jax.debug.callback(print, x),
            lambda x: host_calls.call_without_results([hears], x),
        )
    ):
        compiled = jax.jit(lambda x, told=told: told(x) or x).lower(1.0).compile()
        program_store._store_program(place, 32 * "a", compiled)
        assert len(programs(tmp_path)) == k


def test_forgotten_programs_are_compiled_again():
    run = compilation.jit_program(vectors.scalar_product)
    before = run(np.ones(3), np.ones(3), size=9)
    assert len(run.known) == 1
    jc.forget_programs()
    assert not any(own.known for own in compilation._PROGRAMS)
    assert float(before) == float(run(np.ones(3), np.ones(3), size=9)) == 3.0
    compilation._PROGRAMS.remove(run)


# --- on what a program depends

WORDS = "jaxcable.analysis.phase_loop", "analyse"


def key(structure, phases, method=None):
    task = prepare(structure, phases, method, None)
    core = task.without_indices, task.arrays, task.method, task.code
    return program_store._program_key(WORDS, core, {"bundles": task.bundles})


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
        program_store._describe_machine.cache_clear()
        others.append(key(structure, phases))
    program_store._describe_machine.cache_clear()
    assert len({same, *others}) == 1 + len(others)


def test_what_is_defined_elsewhere_is_not_kept():
    nodes, links = [[0.0, 0, 0], [1.0, 0, 0.1], [2.0, 0, 0]], [[0, 1], [1, 2]]

    def of_law(law):
        cables = jc.Bars(links, area=1e-4, law=law)
        return key(jc.Structure(nodes, cables, jc.pinned([0, 2])), jc.Phase(pretension=1e3))

    assert of_law(jc.Polygonal([0.0, 0.01], [0.0, 2e9]))
    with pytest.raises(python_objects.ForeignCodeError):
        of_law(Prager(2e11, 4e8, 1e10))
    with pytest.raises(python_objects.ForeignCodeError):  # a solver of the tests
        structure, phases = jc.scenes.saddle(8, 8)
        key(structure, phases, jc.Newton(linear_solver=NUMPY))


@pytest.mark.parametrize("folder", ["", "named"])
def test_the_environment_names_the_folder(folder, tmp_path, monkeypatch):
    monkeypatch.setattr(program_store, "_open_place", [])
    monkeypatch.setenv("JAXCABLE_PROGRAMS", str(tmp_path / folder) if folder else "")
    found = jc.keep_programs()
    assert [place.folder for place in program_store._open_place] == (
        [tmp_path / "named"] if folder else []
    )
    assert not folder or found == tmp_path / "named"


def test_the_folder_for_caches(tmp_path, monkeypatch):
    monkeypatch.setattr(program_store, "_open_place", [])
    monkeypatch.delenv("JAXCABLE_PROGRAMS")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    if sys.platform.startswith("linux"):
        assert jc.keep_programs() == tmp_path / "jaxcable"
        assert (tmp_path / "jaxcable").stat().st_mode & 0o777 == 0o700


def test_as_many_programs_as_are_allowed(monkeypatch):
    monkeypatch.setattr(compilation, "MOST_PROGRAMS", 3)
    run = compilation.jit_program(lambda x: 2 * x)
    for n in (1, 2, 3, 4, 2, 5):
        np.testing.assert_array_equal(run(np.ones(n), size=9), 2 * np.ones(n))
    lengths = [program[1][0][0][0] for program in run.known]
    assert lengths == [4, 2, 5]  # those of the last calls
    compilation._PROGRAMS.remove(run)


def test_where_an_argument_lives_and_its_type_matter():
    run = compilation.jit_program(lambda x, y: x + y)
    there = jax.device_put(np.float64(2.0), jax.devices()[0])
    given = [np.float64(2.0), 2.0, 2, np.float32(2.0), there, jnp.asarray(2.0)]
    for x in given:
        assert float(run(x, np.float64(1.0), size=9)) == 3.0
    assert len(run.known) == len(given)
    for x in (jnp.float64(2.0), jnp.float32(2.0)):  # bound to no device: as those of NumPy
        assert float(run(x, np.float64(1.0), size=9)) == 3.0
    assert len(run.known) == len(given)
    assert run(jnp.float32(2.0), np.float32(1.0), size=9).dtype == np.float32
    compilation._PROGRAMS.remove(run)
