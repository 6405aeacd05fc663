"""How many programs XLA compiles for a first call: none for plain ones, few for derivatives."""

import contextlib

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcable as jc
from jaxcable.design import Target, tune
from jaxcable.programs.program_calls import as_program

CROSS = [[-1.0, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0], [0, 0, 0]]
LOAD = jc.NodalLoads([4], (0.0, 0.0, -300.0))
PRESTRESS = jc.Phase(pretension=1000.0)
LOADED = [PRESTRESS, jc.Phase(loads=LOAD)]
_compiled: list[str] = []


def _listen(event, _, **given):
    """Note the name of a function that XLA compiles, or takes from its cache."""
    if "backend_compile" in event:
        _compiled.append(given.get("fun_name", "?"))


jax.monitoring.register_event_duration_secs_listener(_listen)


@contextlib.contextmanager
def compiled_programs():
    """Yield the list of names of functions that are compiled in the block, in a fresh state."""
    jax.clear_caches()
    jc.forget_programs()
    names: list[str] = []
    _compiled.clear()
    try:
        yield names
    finally:
        names.extend(_compiled)


def cross(**given):
    """Four cables from a frame to a node in their middle."""
    given = {"axial_stiffness": 100e3, "expansion": 1e-5} | given
    cables = jc.Cables([[0, 4], [1, 4], [2, 4], [3, 4]], **given)
    return jc.Structure(CROSS, cables, supports=jc.pinned([0, 1, 2, 3]))


def chord(elements, supports=(0, 2)):
    """Elements between three nodes in a line."""
    nodes = [[0.0, 0, 0], [1, 0, -0.1], [2, 0, 0]]
    return jc.Structure(nodes, elements, supports=jc.pinned(list(supports)))


def cantilever(law):
    """Two beams with a section of fibres."""
    section = jc.Section.rectangle(0.05, 0.1, law, shape=(2, 2))
    beams = jc.Beams([[0, 1], [1, 2]], section=section)
    return jc.Structure([[0.0, 0, 0], [1, 0, 0], [2, 0, 0]], beams, supports=jc.clamped([0]))


STRESSES = [-5e8, -4e8, 0.0, 4e8, 5e8]
PLASTIC = jc.Polygonal([-0.03, -0.002, 0.0, 0.002, 0.03], STRESSES, unloading="elastic")
TIP = jc.Phase(loads=jc.NodalLoads([2], (0.0, 0.0, -100.0)))

SOLVES = {
    "scene": jc.scenes.von_mises_truss,
    "stages and actions": lambda: (
        cross(weight=5.0),
        [
            jc.replace(PRESTRESS, removes=jc.only([3])),
            jc.Phase(shortening=1e-3, temperature=20.0, loads=[jc.SelfWeight(), LOAD]),
            jc.Phase(adds=jc.only([3]), loads=jc.LineLoads((0.0, 0.0, -10.0))),
            jc.Phase(jacking=jc.only([0, 1], 100.0)),
        ],
    ),
    "incremental": lambda: (cross(), LOADED, jc.Incremental(corrections=3)),
    "fibres, watched": lambda: (cantilever(PLASTIC), TIP, jc.Newton(watch=True)),
    "as built": lambda: (
        chord(jc.Catenaries([[0, 1], [1, 2]], axial_stiffness=1e5, weight=10.0), (0, 1, 2)),
        jc.Phase(end_tension=200.0, loads=jc.SelfWeight()),
    ),
    "many elements": lambda: (
        chord(
            {
                "hung": jc.Catenaries([[0, 1], [1, 2]], axial_stiffness=1e5, weight=10.0),
                "rope": jc.SlidingCables([[0, 1, 2]], axial_stiffness=1e5),
                "springs": jc.Springs([1], stiffness=(1e3, 1e3, 1e3)),
            }
        ),
        jc.Phase(
            pretension={"hung": 100.0, "rope": 50.0, "springs": None},
            loads=[jc.SelfWeight(on="hung"), jc.NodalLoads([1], (0.0, 0.0, -100.0))],
        ),
    ),
}


def test_counts_programs():
    """An operation of jax on an array is a program; what is compiled by choice is, too."""
    with compiled_programs() as names:
        jnp.arange(3.0) + 1.0
    assert names
    with jc.evaluation("xla"), compiled_programs() as names:
        as_program(lambda x: 2.0 * x)(1.0)
    assert names


@pytest.fixture(scope="module")
def _fresh_state():
    """One fresh state for all kinds: what none of them compiles is no help to the next one."""
    with compiled_programs():
        pass


@pytest.mark.usefixtures("_fresh_state")
@pytest.mark.parametrize("kind", SOLVES)
def test_first_solve_compiles_nothing(kind):
    """Structure, phases, analysis and what is read of the solution."""
    _compiled.clear()
    solution = jc.solve(*SOLVES[kind]())
    text = f"{solution!r} {solution.phases!r} {solution.phases[-1].path!r} {solution.last!r}"
    assert jc.describe(solution.status) == "converged" and "converged" in text
    solution.displacement_since(0)
    assert solution.rotation_vector is None or kind == "fibres, watched"
    assert _compiled == []


def test_next_phases_compile_nothing():
    """What starts from a solution, or from its last state, also with elements that come and go."""
    structure = cross()
    staged = [PRESTRESS, jc.Phase(removes=jc.only([3]))]
    first = jc.solve(structure, staged)
    with compiled_programs() as names:
        second = jc.solve(structure, jc.Phase(loads=LOAD), start=first)
        jc.solve(structure, jc.Phase(adds=jc.only([3])), start=second.last)
    assert not names


def _tune():
    wanted = Target("positions", -0.06, at=(4, 2), phase=1)
    with jc.evaluation("numpy"):  # a search runs its programs often enough to compile them
        repr(tune(cross(), LOADED, [(0, "pretension")], [wanted], steps=2))


def _path_of_beams():
    """Their tangent is not symmetric: its null vectors are singular ones, for which is no rule."""
    pushed = jc.Phase(loads=jc.NodalLoads([2], (0.0, 0.0, -1e3)))
    assert int(jc.trace_path(cantilever(jc.Elastic(2e11)), pushed, steps=3).status) >= 0


CALLS = {
    "path": (lambda: repr(jc.trace_path(*jc.scenes.von_mises_truss(), steps=4)), 0),
    "path of beams": (_path_of_beams, 0),
    "force density": (lambda: jc.force_density(cross(), 10.0, loads=LOAD), 0),
    "form": (lambda: jc.find_form(cross(), tension=10.0), 0),
    "tune": (_tune, 0),
}


@pytest.mark.slow_cases("path of beams", "tune")
@pytest.mark.parametrize("name", CALLS)
def test_first_call_compiles_few(name):
    """Other functions of the package, outside of `jax.jit`."""
    call, most = CALLS[name]
    with compiled_programs() as names:
        call()
    assert len(names) <= most, names


def _sag(pretension):
    """A result of one number, which no operation of this function computes."""
    return jc.solve(cross(), [jc.Phase(pretension=pretension), LOADED[1]]).tension


def _pull(cotangent):
    """The cotangent of the pretension."""
    return lambda pretension: jax.vjp(_sag, pretension)[1](cotangent)[0]


def _pulled(force):
    return jc.solve(cross(), [PRESTRESS, jc.Phase(loads=jc.NodalLoads([4], force))]).tension


DOWN = np.array([0.0, 0.0, -300.0])
DERIVATIVES = {
    "jvp": (lambda: jax.jvp(_sag, (1000.0,), (1.0,)), 0),
    "vjp": (lambda: jax.vjp(_sag, 1000.0)[1](np.ones(4)), 0),
    "jvp of vjp": (lambda: jax.jvp(_pull(np.ones(4)), (1000.0,), (1.0,)), 0),
    "vmap": (lambda: jax.vmap(_sag)(np.array([1000.0, 1001.0])), 0),
    "jvp by a load": (lambda: jax.jvp(_pulled, (DOWN,), (DOWN,)), 0),
}


@pytest.mark.slow_cases("jvp", "vjp", "jvp by a load")  # parts of "jvp of vjp"
@pytest.mark.parametrize("name", DERIVATIVES)
def test_derivatives_compile_few(name):
    """Derivatives outside of `jax.jit`: the operations of the package are in its programs."""
    call, most = DERIVATIVES[name]
    with compiled_programs() as names:
        call()
    assert len(names) <= most, names
