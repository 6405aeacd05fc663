"""Names of jax that are not documented as stable, and the flags of XLA."""

import ast
import os
import re
import tomllib
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcable as jc
from jaxcable.common import fusion, jax_internals
from jaxcable.numerics import vectors
from jaxcable.programs.program_calls import as_program

ROOT = Path(__file__).parents[2]


def product():
    """1 + 2 + 3, compiled."""
    with jc.evaluation("xla"):
        return float(as_program(vectors.scalar_product)(np.arange(1.0, 4.0), np.ones(3)))


def test_the_range_of_versions_is_that_of_the_package():
    stated = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["dependencies"]
    first, end = (".".join(map(str, version)) for version in jax_internals.TESTED)
    wanted = rf"(jax|jaxlib)>={re.escape(first)}(\.\d+)?,<{re.escape(end)}"
    assert sum(bool(re.fullmatch(wanted, one)) for one in stated) == 2
    assert jax_internals.TESTED[0] <= jax.__version_info__[:2] < jax_internals.TESTED[1]


def unstable(path):
    """Names in a file that jax does not document as stable."""
    private = ("jax.extend", "jax.interpreters", "jax._src", "jax.experimental", "jaxlib")
    private += ("jax.config.values", "jax.core.ShapedArray", "jax.ffi.register_ffi_target")
    text = path.read_text()
    if not any(all(word in text for word in name.split(".")) for name in private):
        return  # parsing takes longer
    for node in ast.walk(ast.parse(text)):
        names = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and not node.level:
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        elif isinstance(node, ast.Attribute):
            names = [ast.unparse(node)]
        yield from (
            name for name in names if f"{name}.".startswith(tuple(f"{p}." for p in private))
        )


def test_unstable_names_are_in_two_modules():
    """Beside it only the version of jaxlib, which is printed and is part of keys, is asked for."""
    found = {
        f"{path.name}: {name}"
        for path in (ROOT / "jaxcable").rglob("*.py")
        if path.name not in ("jax_internals.py", "xla_calls.py")
        for name in unstable(path)
    }
    about_version = {"jaxlib", "jaxlib.__version__"}
    assert {text.split(": ")[1] for text in found} <= about_version, found
    assert "jaxlib.version" in set(unstable(ROOT / "jaxcable" / "common" / "jax_internals.py"))


def test_whether_a_program_is_traced():
    seen = []

    def look(x):
        seen.append(jax_internals.is_tracing())
        return x

    look(1.0)
    jax.jit(lambda x: look(x))(1.0)
    jax.grad(jax.jit(lambda x: look(x)))(1.0)
    jax.jit(jax.grad(lambda x: look(x)))(1.0)
    assert seen == [False, True, True, True]


def test_whether_a_derivative_is_taken_of_numbers():
    seen = []

    def look(x):
        seen.append((jax_internals.is_tracing(), jax_internals.is_differentiating()))
        return x**2

    x = jnp.ones(2)
    look(1.0)
    for derivative in (jax.grad, jax.value_and_grad, jax.hessian, jax.jacfwd):
        derivative(look)(1.0)
        assert seen.pop() == (False, True)
    jax.vmap(jax.grad(look))(x)
    jax.vmap(look)(x)
    jax.jit(jax.grad(look))(1.0)
    jax.grad(jax.checkpoint(look))(1.0)
    assert seen == [(False, False), (False, True), (False, False), (True, False), (True, False)]


def test_where_a_program_is_and_is_not():
    """Within a program nothing runs by itself."""
    run = as_program(lambda x: 2 * x)
    assert float(jax.jit(lambda: run(np.ones(())))()) == 2.0 and not run.known
    assert product() == 6.0


def test_without_quick_options(monkeypatch):
    """jax 0.12 has none."""
    if jax.default_backend() == "cpu":
        assert (jax_internals.quick_compile_options() is None) == (jax.__version_info__ >= (0, 12))
    monkeypatch.setattr(jax_internals, "quick_compile_options", lambda: None)
    assert product() == 6.0


# --- flags of XLA: an unknown one ends the process


def test_flags_are_set_for_known_versions_only(monkeypatch):
    before = os.environ.get("XLA_FLAGS")
    monkeypatch.setattr(jax_internals, "_flags", [])
    monkeypatch.setattr(fusion, "has_xla_started", lambda: False)
    monkeypatch.setattr("jaxlib.version.__version_info__", (*jax_internals.TESTED[1], 0))
    with pytest.warns(RuntimeWarning, match=r"known for jaxlib 0.10 up to 0.13 only"):
        jc.fuse_loops()
    assert (
        os.environ.get("XLA_FLAGS") == before
        and not fusion.are_loops_fused()
        and not fusion.request_fused_loops()
    )


def test_a_file_of_flags_is_left_as_it_is(monkeypatch):
    monkeypatch.setattr(jax_internals, "_flags", [])
    monkeypatch.setattr(jax_internals, "has_xla_started", lambda: False)
    monkeypatch.setattr(fusion, "has_xla_started", lambda: False)
    monkeypatch.setenv("XLA_FLAGS", "/etc/flags.txt")
    with pytest.warns(RuntimeWarning, match="XLA_FLAGS names a file"):
        jc.fuse_loops()
    assert os.environ["XLA_FLAGS"] == "/etc/flags.txt"


def test_whether_jax_has_started():
    jnp.zeros(()).block_until_ready()
    assert jax_internals.has_xla_started()


def test_flags_are_those_that_xla_has_read(monkeypatch):
    read = jax_internals.xla_flags_in_effect()
    monkeypatch.setenv("XLA_FLAGS", "--xla_of_later=true")
    assert jax_internals.xla_flags_in_effect() == read != "--xla_of_later=true"
