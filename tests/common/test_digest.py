"""Digests of functions: of what they compute, with all constants; of functions on the host with all
that decides what they return. That processes agree on them is in `test_keeping`."""

import dataclasses
import functools
import importlib
import os
import sys
import textwrap

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.extend.core import ClosedJaxpr

import jaxcable as jc
from jaxcable.common import digest


def of(function, *arguments):
    return digest.function_digest(function, *(arguments or (np.ones(3),)))


def test_what_is_computed_counts_and_not_how_it_is_called():
    values = np.arange(3.0)

    def named(x):
        helper = jax.jit(lambda y: y * values)
        return {"a": helper(x)}

    def other_name(z):
        return {"a": jax.jit(lambda y: y * np.arange(3.0))(z)}

    assert of(named) == of(named) == of(other_name)
    found = [
        of(named),
        of(lambda x: {"b": jax.jit(lambda y: y * values)(x)}),  # another name of the result
        of(lambda x: {"a": jax.jit(lambda y: y + values)(x)}),
        of(lambda x: {"a": jax.jit(lambda y: y * (values + 1))(x)}),
        of(named, np.ones(3, np.float32)),
        of(lambda x: x),
        of(lambda x: x, np.ones((2, 3))),
        of(lambda x: 2.0 * x),
        of(lambda x: jax.lax.scan(lambda s, _: (s * x, None), x, None, length=3)[0]),
        of(lambda x: jax.lax.scan(lambda s, _: (s * x, None), x, None, length=4)[0]),
        of(lambda x: jax.lax.cond(x[0] > 0, lambda: x, lambda: -x)),
        of(lambda x: jax.lax.cond(x[0] > 0, lambda: x, lambda: -2 * x)),
        of(lambda x: x + jax.random.normal(jax.random.key(0))),
        of(lambda x: x + jax.random.normal(jax.random.key(1))),
    ]
    assert len(set(found)) == len(found)


def test_large_constants_count_to_their_last_byte():
    values = np.zeros(200_000)
    before = of(lambda x: x + jnp.asarray(values).sum())
    values[123_456] = 1e-300
    assert of(lambda x: x + jnp.asarray(values).sum()) != before


@dataclasses.dataclass(eq=False)
class Offset:
    by: np.ndarray

    def __call__(self, x):
        return np.asarray(x) + self.by


def test_functions_on_the_host_count_by_code_and_closure():
    def calls(function):
        shape = jax.ShapeDtypeStruct((3,), float)
        return lambda x: jax.pure_callback(function, shape, x)

    def times(factor):
        return lambda x: np.asarray(x) * factor

    def recursive(depth):
        def again(x):
            return x if depth else again(x)

        return again

    large = np.zeros(5000)
    large[2500] = 1.0
    found = [
        of(calls(times(2.0))),
        of(calls(times(3.0))),
        of(calls(times(large))),
        of(calls(times(2 * large))),
        of(calls(lambda x: np.asarray(x) + 2.0)),
        of(calls(Offset(large))),
        of(calls(Offset(2 * large))),
        of(calls(functools.partial(np.multiply, 2.0))),
        of(calls(functools.partial(np.multiply, 3.0))),
        of(calls(Offset(large).__call__)),
        of(calls(Offset(2 * large).__call__)),
        of(calls(recursive(0))),
        of(calls(recursive(1))),
    ]
    assert len(set(found)) == len(found)
    assert of(calls(times(2.0))) == found[0] and of(calls(Offset(large))) == found[5]


# --- functions on the host

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


NAME = "users_module"


def module_texts(**changed):
    """The texts of a module of the user and of those that it imports, with some other numbers."""
    numbers = {"n": NAME} | {value: 3 for value in VALUES} | changed
    return {  # in the order in which they can be run
        f"{NAME}_late": "OFFSET = {LATE}\n".format(**numbers),
        f"{NAME}_deep": "import {n}_late\nDEEP = {DEEP}\n".format(**numbers),
        f"{NAME}_config": "import {n}_deep as deep\nOFFSET = {OFFSET}\nOTHER = {UNUSED}\n".format(
            **numbers
        ),
        NAME: textwrap.dedent(MODULE).format(name=NAME, **numbers),
    }


def cases_of(monkeypatch, **changed):
    """The function `cases` of the module of the user."""
    for module, text in module_texts(**changed).items():
        own = type(sys)(module)
        monkeypatch.setitem(sys.modules, module, own)
        exec(compile(text, f"{module}.py", "exec"), vars(own))
    return own.cases


def test_everything_that_a_function_uses_counts(monkeypatch):
    """Every number in the module that it uses, and no other; nor does a call change anything."""
    function = cases_of(monkeypatch)
    first = digest.host_function_digest(function)
    function(np.arange(3.0))
    assert digest.host_function_digest(function) == first
    assert digest.host_function_digest(cases_of(monkeypatch)) == first
    found = {None: first}
    for value in VALUES:
        found[value] = digest.host_function_digest(cases_of(monkeypatch, **{value: 5}))
    assert found.pop("UNUSED") == first
    assert len(set(found.values())) == len(found)


def test_what_a_function_does_not_use_does_not_count():
    """Nor do lines and comments."""

    def defined(text, **names):
        space = {"__name__": NAME, "np": np, **names}
        exec(compile(text, f"file {len(text)}", "exec"), space)
        return digest.host_function_digest(space["cases"])

    one = "def cases(numbers):\n    return {'a', 'b'} & SCALE * numbers.astype(float)"
    two = "\n\n# words\n" + one.replace("\n", "\n    # more\n")
    assert defined(one, SCALE=2.0, OTHER=1.0) == defined(two, SCALE=2.0, OTHER=2.0)
    assert defined(one, SCALE=2.0) != defined(one, SCALE=3.0)
    assert defined(one, SCALE=2.0) != defined(one.replace("'a'", "'c'"), SCALE=2.0)


def test_arrays_in_files_count_by_their_file(tmp_path):
    np.save(tmp_path / "a.npy", np.arange(30.0))

    def cases(data):
        return lambda numbers: data[numbers]

    def mapped():
        return digest.host_function_digest(cases(np.load(tmp_path / "a.npy", mmap_mode="r")))

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
        digest.host_function_digest(lambda numbers: nested)
    ring = []
    ring.append(ring)
    assert digest.host_function_digest(lambda numbers: ring)


def test_libraries_are_known_wherever_they_are_installed(tmp_path, monkeypatch):
    """On a cluster PYTHONPATH names their folder: they count by name and version."""
    folder = tmp_path / "site-packages"
    folder.mkdir()
    monkeypatch.syspath_prepend(folder)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)  # of the first one
    found = []
    for factor in (2.0, 3.0):
        (folder / "library_of_others.py").write_text(f"def scaled(x):\n    return {factor} * x\n")
        monkeypatch.delitem(sys.modules, "library_of_others", raising=False)
        scaled = importlib.import_module("library_of_others").scaled
        assert scaled(1.0) == factor
        found.append(digest.host_function_digest(lambda x, scaled=scaled: scaled(x)))
    assert found[0] == found[1]


def test_a_function_may_use_the_class_of_jaxprs():
    def kind(x):
        return isinstance(x, ClosedJaxpr)

    assert digest.host_function_digest(kind)


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

    first = jc.study(square, jc.studies.samples(cases, 100), tmp_path, chunk=40).load()["square"]
    again = jc.study(square, jc.studies.samples(cases, 100), tmp_path, chunk=40).load()["square"]
    np.testing.assert_array_equal(first, again)
    assert first[50] == 51.0**2
    monkeypatch.setitem(globals(), "LEVEL", 2.0)
    with pytest.raises(ValueError, match=r"holds a study with cases_function = .* globals"):
        jc.study(square, jc.studies.samples(cases, 100), tmp_path, chunk=40)
    monkeypatch.setitem(globals(), "LEVEL", 1.0)
    jc.study(square, jc.studies.samples(cases, 100), tmp_path, chunk=40)
