"""Programs in memory, and on disk by jax's own cache."""

import gc
import json
import os
import subprocess
import sys
import textwrap
import threading
import time
import warnings

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from test_digest import module_texts

import jaxcable as jc
from jaxcable.common.checks import warn_user, without_warnings
from jaxcable.common.compilation import without_garbage_collection
from jaxcable.numerics import vectors
from jaxcable.programs import known
from jaxcable.programs.program_calls import as_program

# --- other processes

PROCESS = """
    import json, sys
    import jax
    jax.config.update("jax_enable_x64", True)
    import jaxcable as jc
    import jax.numpy as jnp, numpy as np
    from jaxcable.common import digest, host_calls
    from users_module import cases

    told, counts = {}, {"hits": 0, "misses": 0}
    def heard(name, **_):
        for word in counts:
            counts[word] += name == f"/jax/compilation_cache/cache_{word}"
    jax.monitoring.register_event_listener(heard)
    jax.config.update("jax_compilation_cache_dir", sys.argv[1])
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)

    # digests
    structure, phases = jc.scenes.flat_net()
    def analysed(load):
        heavy = jc.replace(phases[1].loads, forces=phases[1].loads.forces * load)
        solution = jc.solve(structure, [phases[0], jc.replace(phases[1], loads=heavy)])
        return {"z": solution.displacement, "of": {k: solution.status for k in {"a", "b", "c"}}}
    def host(x):
        return jax.pure_callback(lambda y: np.asarray(y) * 2.0, jax.ShapeDtypeStruct((), float), x)
    told["digests"] = [
        digest.function_digest(jc.batched(analysed, 4), np.ones(5)),
        digest.function_digest(host, 1.0),
        digest.host_function_digest(cases),
    ]

    # a program with a function of NumPy
    @host_calls.register_host_function_family
    def double():
        return lambda x: (2 * x,)
    shape = jax.ShapeDtypeStruct((3,), jnp.float32)
    twice = jax.jit(lambda x: host_calls.call_on_host([double], [shape], x))
    told["twice"] = np.asarray(twice(np.ones(3, np.float32))[0]).tolist()

    # an analysis
    solution = jc.solve(*jc.scenes.saddle(2, 2), jc.Newton(linear_solver="superlu"))
    jc.raise_if_failed(solution)
    told["tension"] = np.asarray(solution.tension).tobytes().hex()
    print(json.dumps(told | counts))
"""


def run_process(folder, seed):
    """What a process with jax's cache in a folder prints; texts have other hashes in each."""
    clean = {k: v for k, v in os.environ.items() if not k.startswith("JAX_")}
    clean |= {"JAX_DISABLE_MOST_OPTIMIZATIONS": "1", "PYTHONHASHSEED": seed}
    clean["PYTHONPATH"] = os.pathsep.join([str(folder), *sys.path])
    words = [sys.executable, "-c", textwrap.dedent(PROCESS), str(folder / "kept")]
    run = subprocess.run(words, env=clean, capture_output=True, text=True, timeout=300)
    assert run.returncode == 0, run.stderr
    return json.loads(run.stdout)


@pytest.mark.slow
def test_another_process_does_not_compile(tmp_path):
    """Neither an analysis nor a program that calls the host; both agree on digests."""
    for module, text in module_texts().items():
        (tmp_path / f"{module}.py").write_text(text)
    first, after = run_process(tmp_path, "1"), run_process(tmp_path, "2")
    assert first["misses"] > 0 and after["misses"] == 0 and after["hits"] > 0
    assert first["tension"] == after["tension"]
    assert first["twice"] == after["twice"] == [2.0, 2.0, 2.0]
    assert first["digests"] == after["digests"] and len(set(first["digests"])) == 3


# --- programs in memory


def test_forgotten_programs_are_made_again():
    run = as_program(vectors.scalar_product)
    before = run(np.ones(3), np.ones(3))
    assert len(run.known) == 1
    jc.forget_programs()
    assert not run.known
    assert float(before) == float(run(np.ones(3), np.ones(3))) == 3.0


def test_as_many_programs_as_are_allowed(monkeypatch):
    monkeypatch.setattr(known, "MOST_PROGRAMS", 3)
    run = as_program(lambda x: 2 * x)
    for n in (1, 2, 3, 4, 2, 5):
        np.testing.assert_array_equal(run(np.ones(n)), 2 * np.ones(n))
    lengths = [program[1][0][0][0] for program in run.known]
    assert lengths == [4, 2, 5]  # those of the last calls


@pytest.mark.parametrize("way", ["numpy", "xla"])
def test_where_an_argument_lives_and_its_type_matter(way):
    run = as_program(lambda x, y: x + y)
    there = jax.device_put(np.float64(2.0), jax.devices()[0])
    given = [np.float64(2.0), 2.0, 2, np.float32(2.0), there]
    with jc.evaluation(way):
        for x in given:
            assert float(run(x, np.float64(1.0))) == 3.0
        assert len(run.known) == len(given)
        # bound to no device: as those of NumPy, and as numbers of Python
        for x in (jnp.float64(2.0), jnp.float32(2.0), jnp.asarray(2.0)):
            assert float(run(x, np.float64(1.0))) == 3.0
        assert len(run.known) == len(given)
        assert run(jnp.float32(2.0), np.float32(1.0)).dtype == np.float32


# --- threads


def together(function, count=8, rounds=30):
    """Call a function from several threads at once, many times; True if all have ended."""
    barrier, errors = threading.Barrier(count), []

    def work():
        try:
            barrier.wait()
            for _ in range(rounds):
                function()
        except Exception as error:
            errors.append(error)

    threads = [threading.Thread(target=work, daemon=True) for _ in range(count)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(30)
    assert not errors
    return not any(thread.is_alive() for thread in threads)


def test_settings_are_as_before_when_threads_compile_at_once():
    def compiles():
        with without_garbage_collection(), without_warnings():
            time.sleep(1e-4)
            assert not gc.isenabled()
            warn_user("not issued")

    assert gc.isenabled()
    filters = list(warnings.filters)
    assert together(compiles)
    assert gc.isenabled() and warnings.filters == filters
    with pytest.warns(jc.InputWarning, match="issued"):
        warn_user("issued")
