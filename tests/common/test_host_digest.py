"""Digests of functions on the host: all that decides what they return, in every process alike."""

import os
import re
import subprocess
import sys
import textwrap

import jax
import numpy as np
import pytest

import jaxcable as jc
from jaxcable.common import code_digest, digest

MODULE = """
    import collections, dataclasses, enum, functools, logging, math, types
    from decimal import Decimal

    import jax
    import numpy as np

    import {name}_config as config

    log = logging.getLogger(__name__)
    SCALE = {SCALE}
    TABLE = np.array([1.0, {ENTRY}])
    NESTED = {{"a": [1.0, {{"b": {NESTED}}}]}}
    DEFAULTS = collections.defaultdict(lambda: {FACTORY})
    LIMIT = Decimal("{DECIMAL}")
    PROXY = types.MappingProxyType({{"x": {PROXY}}})
    RNG = np.random.default_rng({SEED})
    Pair = collections.namedtuple("Pair", "a b")
    PAIR = Pair(1, {PAIR})

    class Kind(enum.Enum):
        A = {MEMBER}

    class Base:
        factor = {CLASS}

        def scaled(self, x):
            return {METHOD} * x * self.factor

    class Slotted(Base):
        __slots__ = ("by",)

        def __init__(self, by):
            self.by = by

        def __call__(self, x):
            return self.scaled(x) + self.by

        @property
        def twice(self):
            return {PROPERTY} * self.by

    SLOTTED = Slotted({SLOT})

    @dataclasses.dataclass(frozen=True)
    class Data:
        values: tuple

        def mean(self):
            return sum(self.values) / {DATACLASS}

    DATA = Data((1.0, {FIELD}))

    def helper(x, more={DEFAULT}, *, keyword={KEYWORD}):
        return x + more + keyword + deeper(x)

    def deeper(x):
        return x * {DEEPER}

    def again(x, depth=2):
        return again(x, depth - 1) if depth else x + {RECURSIVE}

    partial = functools.partial(deeper, x={PARTIAL})
    bound = SLOTTED.scaled

    @functools.lru_cache
    def cached(k):
        return k + {CACHED}

    @jax.jit
    def compiled(x):
        return x * {COMPILED}

    def decorate(function):
        @functools.wraps(function)
        def inner(x):
            return {WRAPPER} * function(x)

        return inner

    @decorate
    def decorated(x):
        return x - {DECORATED}

    helper.attribute = {ATTRIBUTE}
    unused = {UNUSED}

    def cases(numbers):
        \"\"\"{UNUSED}\"\"\"
        import {name}_late as late

        log.debug("cases")
        inner = lambda x: x * SCALE + TABLE[1]  # a function in the function
        found = inner(numbers) + helper(numbers) + again(numbers) + partial() + bound(2.0)
        found = found + NESTED["a"][0] + DEFAULTS.default_factory() + float(LIMIT)
        found = found + PROXY["x"] + PAIR.b
        found = found + Kind.A.value + SLOTTED(1.0) + SLOTTED.twice + DATA.mean() + cached(1)
        found = found + np.asarray(compiled(2.0)) + decorated(1.0) + config.OFFSET + late.OFFSET
        found = found + config.deep.DEEP
        return found + helper.attribute + 0 * RNG.bit_generator.state["state"]["state"] + math.pi
"""

VALUES = (
    *("SCALE", "ENTRY", "NESTED", "FACTORY", "DECIMAL", "PROXY", "SEED", "PAIR", "MEMBER", "CLASS"),
    *("METHOD", "PROPERTY", "SLOT", "DATACLASS", "FIELD", "DEFAULT", "KEYWORD", "DEEPER"),
    *("RECURSIVE", "PARTIAL", "CACHED", "COMPILED", "WRAPPER", "DECORATED", "ATTRIBUTE"),
    *("UNUSED", "OFFSET", "LATE", "DEEP"),
)


def cases_of(folder, monkeypatch, **changed):
    """The function `cases` of a module of the user, with other numbers in some places."""
    monkeypatch.syspath_prepend(str(folder))
    name = "users_module"
    numbers = {value: 3 for value in VALUES} | changed
    files = {
        name: textwrap.dedent(MODULE).format(name=name, **numbers),
        f"{name}_config": "import {n}_deep as deep\nOFFSET = {OFFSET}\nOTHER = {UNUSED}\n".format(
            n=name, **numbers
        ),
        f"{name}_late": "OFFSET = {LATE}\n".format(**numbers),
        f"{name}_deep": "import {n}_late\nDEEP = {DEEP}\n".format(n=name, **numbers),
    }
    for module, text in files.items():
        monkeypatch.delitem(sys.modules, module, raising=False)
        (folder / f"{module}.py").write_text(text)
    namespaces = {}
    for module in (f"{name}_late", f"{name}_deep", f"{name}_config", name):
        namespaces[module] = type(sys)(module)
        monkeypatch.setitem(sys.modules, module, namespaces[module])
        exec(compile(files[module], f"{module}.py", "exec"), vars(namespaces[module]))
    return namespaces[name].cases


def test_everything_that_a_function_uses_counts(tmp_path, monkeypatch):
    """Every number in the module, and nothing that has no influence; texts have no memory."""
    first = digest.of_host_function(cases_of(tmp_path, monkeypatch))
    assert digest.of_host_function(cases_of(tmp_path, monkeypatch)) == first
    found = {None: first}
    for value in VALUES:
        function = cases_of(tmp_path, monkeypatch, **{value: 5})
        found[value] = digest.of_host_function(function)
    assert found.pop("UNUSED") != "" and len(set(found.values())) == len(found)


def test_what_a_function_does_not_use_does_not_count(tmp_path, monkeypatch):
    def cases(scale, text):
        space = {"np": np, "SCALE": 2.0, "OTHER": scale}
        exec(f"def cases(numbers):\n    # {text}\n    return SCALE * numbers.astype(float)", space)
        return space["cases"]

    def attribute(value):
        space = {"real": value}  # the name of an attribute below, and of no global there
        exec("def cases(numbers):\n    return numbers.real", space)
        return space["cases"]

    of = digest.of_host_function
    assert of(attribute(1.0)) == of(attribute(2.0))
    assert of(cases(1.0, "a")) == of(cases(2.0, "another comment"))


def test_a_function_that_has_been_called_is_the_same(tmp_path, monkeypatch):
    function = cases_of(tmp_path, monkeypatch)
    first = digest.of_host_function(function)
    function(np.arange(3.0))
    assert digest.of_host_function(function) == first


def test_processes_agree(tmp_path, monkeypatch):
    cases_of(tmp_path, monkeypatch)  # writes the module
    program = (
        "from users_module import cases; from jaxcable.common import digest; "
        "print(digest.of_host_function(cases))"
    )
    found = set()
    for seed in ("1", "2"):
        environment = {**os.environ, "PYTHONHASHSEED": seed}
        environment["PYTHONPATH"] = os.pathsep.join([str(tmp_path), *sys.path])
        command = [sys.executable, "-c", program]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
        found.add(done.stdout)
    assert len(found) == 1


def test_arrays_in_files_count_by_their_file(tmp_path):
    np.save(tmp_path / "a.npy", np.arange(30.0))

    def cases(data):
        return lambda numbers: data[numbers]

    def mapped():
        return digest.of_host_function(cases(np.load(tmp_path / "a.npy", mmap_mode="r")))

    first = mapped()
    assert mapped() == first
    np.save(tmp_path / "a.npy", np.arange(30.0) + 1.0)
    os.utime(tmp_path / "a.npy", (1, 1))
    assert mapped() != first


def test_objects_without_an_end_are_named():
    nested = []
    for _ in range(100_000):
        nested = [nested]
    with pytest.raises(ValueError, match="nested too deeply"):
        digest.of_host_function(lambda numbers: nested)
    ring = []
    ring.append(ring)
    assert digest.of_host_function(lambda numbers: ring)


# --- no stale answer


def square(x):
    return {"square": x**2}


LEVEL = 1.0


def test_a_study_sees_globals_of_its_cases(tmp_path, monkeypatch):
    """Of 100 cases one differs that is not among those that are compared."""

    def shift(numbers):
        return np.where(numbers == 50, LEVEL, 0.0)

    def cases(numbers):
        return numbers + shift(numbers)

    first = jc.streamed(square, cases, tmp_path, 40, n_case=100).load()["square"]
    again = jc.streamed(square, cases, tmp_path, 40, n_case=100).load()["square"]
    np.testing.assert_array_equal(first, again)
    assert first[50] == 51.0**2
    monkeypatch.setitem(globals(), "LEVEL", 2.0)
    with pytest.raises(ValueError, match=r"holds a study with cases_function = .* globals"):
        jc.streamed(square, cases, tmp_path, 40, n_case=100)
    monkeypatch.setitem(globals(), "LEVEL", 1.0)
    jc.streamed(square, cases, tmp_path, 40, n_case=100)


def test_a_study_sees_globals_of_functions_on_the_host(tmp_path, monkeypatch):
    def on_host(x):
        return np.asarray(x) * LEVEL

    def function(x):
        shape = jax.ShapeDtypeStruct((), x.dtype)
        return {"y": jax.pure_callback(on_host, shape, x, vmap_method="sequential")}

    first = jc.streamed(function, np.arange(3.0), tmp_path, 2).load()["y"]
    assert first.tolist() == [0.0, 1.0, 2.0]
    jc.streamed(function, np.arange(3.0), tmp_path, 2)
    monkeypatch.setitem(globals(), "LEVEL", 2.0)
    with pytest.raises(ValueError, match=re.escape("holds a study with function = ")):
        jc.streamed(function, np.arange(3.0), tmp_path, 2)


def test_kept_programs_see_keywords_of_partial_functions(monkeypatch):
    import functools

    from jaxcable.numerics import vectors

    found = []
    for factor in (1.0, 2.0, 1.0):
        partial = functools.partial(vectors.inner, b=factor)
        monkeypatch.setattr(vectors, "a_partial", partial, raising=False)
        found.append(code_digest.code_digest())
    assert found[0] == found[2] != found[1]
