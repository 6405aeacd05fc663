"""Every public name has an example in its docstring, and all examples give what they say."""

import doctest
import importlib
import inspect
import pkgutil
import types

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
PLACES += [place for place in map(jc.__dict__.get, jc.__all__) if inspect.ismodule(place)]
PLACES.remove(jc.extend)  # bases, with one example for all of them, and names of elsewhere

METHODS = {
    jc.Section: "disc ring rectangle i_shape box polygon mesh composite shifted centred "
    "centroid inertia stiffness torsional_stiffness axial fibre_stress forces strains interaction",
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


@pytest.mark.slow_cases(
    "jaxcable",
    "jaxcable.analysis.batches",
    "jaxcable.analysis.phase_results",
    "jaxcable.analysis.phases",
    "jaxcable.analysis.results",
    "jaxcable.analysis.solution",
    "jaxcable.analysis.solver",
    "jaxcable.common.checks",
    "jaxcable.common.compilation",
    "jaxcable.common.progress",
    "jaxcable.common.status",
    "jaxcable.design.confidence",
    "jaxcable.design.constrained",
    "jaxcable.design.descent",
    "jaxcable.design.fit",
    "jaxcable.design.influence",
    "jaxcable.design.influence_line",
    "jaxcable.design.load_cases",
    "jaxcable.design.minimize",
    "jaxcable.design.moving_loads",
    "jaxcable.design.tune",
    "jaxcable.elements.bar",
    "jaxcable.elements.beam",
    "jaxcable.elements.cable",
    "jaxcable.elements.catenary",
    "jaxcable.elements.contact",
    "jaxcable.elements.contract",
    "jaxcable.elements.sliding",
    "jaxcable.equilibrium.incremental",
    "jaxcable.equilibrium.newton",
    "jaxcable.extend",
    "jaxcable.forms.equivalent_prestress",
    "jaxcable.forms.force_density",
    "jaxcable.forms.form",
    "jaxcable.forms.hanging_cables",
    "jaxcable.forms.prescribed_forces",
    "jaxcable.forms.relaxation",
    "jaxcable.loads.along",
    "jaxcable.loads.ice",
    "jaxcable.loads.line_loads",
    "jaxcable.loads.movement",
    "jaxcable.loads.nodal",
    "jaxcable.loads.path_loads",
    "jaxcable.loads.pressure",
    "jaxcable.loads.wind",
    "jaxcable.loads.wind_profiles",
    "jaxcable.materials.polygonal",
    "jaxcable.materials.presets",
    "jaxcable.paths.events",
    "jaxcable.paths.result",
    "jaxcable.plots.animation",
    "jaxcable.plots.diagrams",
    "jaxcable.plots.nets",
    "jaxcable.reporting.report",
    "jaxcable.results.energy",
    "jaxcable.results.internal_forces",
    "jaxcable.results.rotations",
    "jaxcable.results.stresses",
    "jaxcable.scenes.building_blocks",
    "jaxcable.scenes.snap_through",
    "jaxcable.sections.linear_section",
    "jaxcable.sections.section",
    "jaxcable.sections.shapes",
    "jaxcable.sections.strains",
    "jaxcable.stiffness.buckling",
    "jaxcable.stiffness.flexibility",
    "jaxcable.stiffness.imperfections",
    "jaxcable.stiffness.tangent",
    "jaxcable.stiffness.vibration",
    "jaxcable.studies.study",
    "scenes.cables",
)
@pytest.mark.filterwarnings("ignore:fuse_loops")  # this process has computed already
@pytest.mark.parametrize("name", MODULES)
def test_examples(name):
    runner = doctest.DocTestRunner()
    tests = examples(name)
    for test in tests:
        runner.run(test)
    assert runner.failures == 0
    assert runner.tries == sum(len(test.examples) for test in tests)


def test_there_are_examples():
    assert sum(len(test.examples) for name in MODULES for test in examples(name)) > 500
