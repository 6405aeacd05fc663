"""Every public name has an example in its docstring, and all examples give what they say."""

import doctest
import importlib.util
import inspect
import pkgutil
import re
import types
from pathlib import Path

import jax
import jax.numpy as jnp
import matplotlib
import numpy as np
import pytest
import scenes

import jaxcable as jc

matplotlib.use("Agg")

NAMES = {"jax": jax, "jnp": jnp, "np": np, "jc": jc, "scenes": scenes}
"""What examples assume; the docstring of the package says so (and of scenes of the studies)."""

PLACES = [jc, jc.loads, jc.sections, jc.elements]
PLACES += [place for place in (getattr(jc, name) for name in jc.__all__) if inspect.ismodule(place)]
PLACES.remove(jc.extend)  # bases, with one example for all of them, and names of elsewhere

METHODS = {
    jc.Section: "disc ring rectangle i_shape box polygon mesh composite shifted centred "
    "centroid inertia stiffness torsional_stiffness uniaxial fibre_stress forces strains "
    "interaction",
    jc.files.Net: "scene split",
    jc.forms.SelfStress: "describe unbalanced mechanism_stiffness stiffens",
    jc.paths.TracedPath: "failure_load",
}
"""Methods that users call; those of elements, laws and loads are called by the analysis."""

MODULES = ["jaxcable", *(m.name for m in pkgutil.walk_packages(jc.__path__, "jaxcable."))]
MODULES += [m.name for m in pkgutil.walk_packages(scenes.__path__, "scenes.")]


def public(place):
    """The public functions and classes of a module, and their names."""
    names = getattr(place, "__all__", None)
    if names is None:
        names = [
            name
            for name, thing in vars(place).items()
            if not name.startswith("_") and getattr(thing, "__module__", None) == place.__name__
        ]
    for name in names:
        thing = getattr(place, name)
        if callable(thing):
            yield f"{place.__name__}.{name}", thing


def without_example(things):
    """Names of the things whose docstrings have no example."""
    return [name for name, thing in things if ">>> " not in (inspect.getdoc(thing) or "")]


def test_every_public_name_has_an_example():
    things = [pair for place in PLACES for pair in public(place)]
    methods = [
        (f"{owner.__name__}.{name}", inspect.getattr_static(owner, name))
        for owner, names in METHODS.items()
        for name in names.split()
    ]
    assert len(things) > 130
    missing = without_example(things + methods)
    assert not missing, missing


def test_a_name_without_example_is_found():
    def bare():
        """Does something."""

    def shown():
        """>>> 1 + 1
        2
        """

    place = types.SimpleNamespace(
        __name__="place", __all__=["bare", "shown"], bare=bare, shown=shown
    )
    assert without_example(public(place)) == ["place.bare"]


def examples(name):
    """The docstrings with examples of a module, `doctest.DocTest`."""
    module = importlib.import_module(name)
    found = doctest.DocTestFinder().find(module, globs=NAMES)
    return [test for test in found if test.examples]


ANALYSES = re.compile(
    r"^ *(>>>|\.\.\.) .*\b(solve|trace_path|minimize|find_form|fit|tune|influence|moving_load"
    r"|study|first_order|string|analyse|sag_tension|transient|erect|retension)\w*\(",
    re.M,
)
"""Calls that make an example slow; tests of the rooms call them as well."""


def cases():
    """The modules with examples; those with analyses are slow."""
    for name in MODULES:
        text = Path(importlib.util.find_spec(name).origin).read_text("utf-8")
        if ">>> " in text:
            yield pytest.param(name, marks=[pytest.mark.slow] * bool(ANALYSES.search(text)))


@pytest.mark.filterwarnings("ignore:fuse_loops")  # this process has computed already
@pytest.mark.parametrize("name", [*cases()])
def test_examples(name):
    runner = doctest.DocTestRunner()
    tests = examples(name)
    for test in tests:
        runner.run(test)
    assert runner.failures == 0
    assert runner.tries == sum(len(test.examples) for test in tests)


def test_there_are_examples():
    assert sum(len(test.examples) for name in MODULES for test in examples(name)) > 500
