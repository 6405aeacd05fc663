"""Objects own their arrays: what a user does with his own afterwards changes nothing."""

import collections
import dataclasses
import inspect

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcable as jc
from jaxcable.common.owned import owned_copy
from jaxcable.common.tree import Indices
from jaxcable.files.codec import TYPES

LINKS = [[0, 4], [1, 4], [2, 4], [3, 4]]
NODES = [[-1.0, 0.0, 0.5], [1.0, 0.0, 0.5], [0.0, -1.0, 0.5], [0.0, 1.0, 0.5], [0.0, 0.0, 0.0]]
LAW = jc.Polygonal([0.0, 0.01, 0.05], [0.0, 5e8, 6e8])
STEEL = jc.Elastic(210e9)
SECTION = jc.Section.rectangle(0.1, 0.2, STEEL, shape=(2, 2))
NUMBERS = {"rest_length": [1.1] * 4, "weight": [5.0] * 4, "expansion": [1e-5] * 4}
CABLES = jc.Cables(LINKS, axial_stiffness=[1e5] * 4, strength=[1e4] * 4, **NUMBERS)


def examples():
    """Objects of every class that users construct, with as many arrays as it takes."""
    up = [[0.0, 0.0, 1.0]] * 4
    hinges = np.zeros((4, 2, 3), bool)
    hinges[:, 0] = True
    spring = {"hinges": hinges, "springs": np.where(hinges, 1e3, 0.0)}
    beams = jc.Beams(LINKS, SECTION, up=up, torsional_stiffness=[1e4] * 4, **spring)
    chains = jc.SlidingCables([[0, 4, 1], [2, 4, 3]], axial_stiffness=[1e5] * 2)
    ropes = jc.FrictionCables([[0, 4, 1]], axial_stiffness=[1e5], friction=[0.1])
    hung = jc.SlidingCatenaries([[0, 4, 1]], axial_stiffness=[1e5], weight=[5.0])
    bars = jc.Bars(LINKS, area=[1e-4] * 4, law=LAW)
    clamps = jc.clamped([0]) + jc.restrained([1, 2, 3], "xyz", axes=np.eye(3))
    mask = np.zeros((5, 3), bool)
    mask[:4] = True
    groups = {"net": CABLES, "rods": [bars, bars]}
    rigid = jc.Structure([*NODES, [0.0, 0.0, -1.0]], beams, jc.pinned([0, 1]), rigid=[[4, 5]])
    nodal = jc.NodalLoads([4, 3], [[0.0, 0.0, -10.0]] * 2, [[1.0, 0.0, 0.0]] * 2)
    line = jc.LineLoads([0.0, 0.0, -1.0], factor=np.array(2.0))
    phase = jc.Phase(
        loads=[nodal, line],
        supports=jc.Supports(mask),
        pretension={"net": [100.0] * 4, "rods": [None, np.full(4, 50.0)]},
        temperature=jc.only([True, False, True, False], [10.0, 20.0]),
        removes={"rods": [[True, False, False, False], None]},
    )
    parallel = jc.materials.Parallel([LAW, LAW], [0.25, 0.75])
    faces = [[0, 1, 4], [2, 3, 4]]
    target = jc.design.Target("tension", [1.0, 2.0], at=[0, 2])
    changes = {"temperature": {"net": np.ones(4)}, "removes": {"net": np.ones(4, bool)}}
    action = jc.design.Action("cold", "wind", [nodal], needs=["ice"], **changes)
    net = jc.files.Net(
        np.array(NODES),
        np.array(LINKS),
        mask,
        np.zeros((5, 3)),
        {"weight": np.ones(4)},
        names=("a", "b", "c", "d", "e"),
        marks={"layer": np.array([1, 2])},
    )
    structure = jc.Structure(NODES, groups, clamps)
    table = jc.WindTable([5.0, 20.0], velocities=[10.0, 20.0])
    eurocode = jc.EurocodeWind(np.array(24.0), roughness_length=0.1, lowest_height=np.array(2.0))
    linear = jc.Section.linear(*(np.array(x) for x in (1e8, 2e6, 3e6, 1e6, 4e7, 5e7, 1e5)))
    axes = np.tile(np.eye(3), (2, 1, 1))
    springs = jc.Springs([[0], [1]], [[1e3] * 3] * 2, [[1e2] * 3] * 2, axes, [[1.0, 0, 0]] * 2)
    return [
        *(linear, springs, jc.GroundContacts([[0], [1]], [1e3] * 2, [[0, 0, 1.0]] * 2, [0.1] * 2)),
        jc.Contacts(LINKS, axial_stiffness=[1e5] * 4, gap=[0.01] * 4, strength=[1e4] * 4),
        *(table, eurocode, jc.WindPowerLaw(np.array(20.0), np.array(0.2))),
        jc.WindLoads([1.0, 0, 0], table, [1.2] * 4, [0.1] * 4, ice=[0.01] * 4, factor=[1.0] * 4),
        jc.IceLoads([0.01] * 4, [0.1] * 4),
        jc.PointMasses([3, 4], [1.0, 2.0]),
        jc.PointLoads([0, 1], [0.2, 0.7], [[0, 0, -1.0]] * 2, moments=[[0, 1.0, 0]] * 2),
        jc.loads.Train([0, 1], np.array(0.5), [[0, 0, -1.0]] * 2, [0.3]),
        jc.loads.Crowd([0, 1], [0, 0, -1.0], [0.1, 0.6], [0.3, 0.9]),
        *(beams, chains, ropes, hung, bars, CABLES, clamps, jc.Supports(mask), rigid, structure),
        *(jc.Catenaries(LINKS, [1e5] * 4, weight=[5.0] * 4), nodal, line, phase),
        *(jc.AreaLoads(faces, [0.0, 0.0, -1.0]), jc.FacePressure(faces, [5.0, 6.0]), parallel),
        *(jc.SupportMovement([0, 1], [[0.1, 0.0, 0.0]] * 2), jc.SelfWeight([0.0, 0.0, -1.0])),
        *(jc.CablePressure([1.0] * 4, [0.0, 1.0, 0.0]), LAW, jc.Elastic(np.array(2e11)), SECTION),
        *(jc.only([0, 1], [1.0, 2.0]), jc.only([0, 1]), jc.Newton(np.array(1e-9))),
        jc.Varying(nodal, [0.0, 0.5, 1.0], [0.0, 1.0, 0.2]),
        *(jc.Incremental(tol=np.array(0.1)), target, net, action),
        jc.standards.SteelSection(*np.full((5, 1), 1e-3)),
        *motion(),
    ]


def motion():
    """Objects of motion in time, of overhead lines and of masts."""
    dynamics, post = jc.dynamics, ["post", "suspension", "post"]
    layer = jc.catalogue.Layer([0.0, 7e10], np.array(7e10), 2e-5, [0.0, 6e10])
    sizes = (np.array(x) for x in (4e-4, 0.03, 15.0, 1e5))
    conductor = jc.catalogue.Conductor((layer,), *sizes)
    ground = {"profile": [[0.0, 0.0], [2.0, 0.0]], "crossings": {"road": np.zeros((2, 3))}}
    places = [0.0, 1.0, 2.0], [0.0] * 3, [9.0] * 3, post
    return [
        *(dynamics.Rayleigh(np.array(0.1)), dynamics.ModalDamping([1.0], np.ones((1, 2, 3)), 0.1)),
        *(dynamics.Dashpots([[0, 1]], [5.0]), dynamics.Removal({"net": np.ones(4, bool)})),
        dynamics.Turbulence(jc.WindPowerLaw(20.0, 0.2), np.array(3.0), np.array(150.0)),
        *(layer, conductor, jc.lines.LineState(np.array(5.0), ice=[0.01, 0.02])),
        jc.lines.LineSection(conductor, *places, string_length=[2.0] * 3, **ground),
        *masts(),
    ]


def masts():
    """A guyed mast, its parts, and a state of wind."""
    part = jc.masts.MastSection(np.array(20.0), 1e9, 5e7, 2e7, weight=np.array(800.0))
    sizes = (np.array(x) for x in (3e7, 16.0, 0.018, 3e5, 3e4))
    level = jc.masts.GuyLevel(19.0, [9.0] * 3, [0.0, 120.0, 240.0], *sizes)
    dish = jc.masts.Ancillary(np.array(18.0), drag_area=np.array(1.6))
    state = jc.masts.MastState(jc.WindTable(pressures=500.0), ice=np.array(0.01))
    return part, level, dish, state, jc.masts.GuyedMast([part], [level], [dish])


def shared(value, taken):
    """A copy of an argument that its user can change; arrays, lists and dicts go into `taken`."""
    if isinstance(value, Indices):
        value = value.array
    if isinstance(value, np.ndarray | jax.Array):
        value = np.array(value)
    elif type(value) in (list, tuple):
        value = type(value)(shared(item, taken) for item in value)
    elif type(value) is dict:
        value = {key: shared(item, taken) for key, item in value.items()}
    if isinstance(value, np.ndarray | list | dict):
        taken.append(value)
    return value


def spoil(taken):
    """Change everything in place that a user can change."""
    for value in taken:
        if isinstance(value, np.ndarray):
            value[...] = ~value if value.dtype == bool else value + 1
        elif value:
            value.pop() if isinstance(value, list) else value.popitem()


def content(value):
    """All that is in an object, as bytes and texts."""
    if isinstance(value, Indices):
        return content(value.array)
    if isinstance(value, np.ndarray | np.generic | jax.Array):
        return np.asarray(value).dtype.str, np.shape(value), np.asarray(value).tobytes()
    if type(value) is dict:
        return {key: content(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [content(item) for item in value]
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return [content(getattr(value, f.name)) for f in dataclasses.fields(value)]
    return repr(value)


def arguments(one, taken):
    """Arguments of the constructor of an object that its user shares with it, a dict."""
    if hasattr(one, "_fields"):
        fields = {name: getattr(one, name) for name in one._fields}
    else:
        fields = {f.name: getattr(one, f.name) for f in dataclasses.fields(one) if f.init}
    return {name: shared(value, taken) for name, value in fields.items() if value is not None}


@pytest.mark.parametrize("one", examples(), ids=lambda one: type(one).__name__)
def test_what_is_done_to_arguments_afterwards_changes_nothing(one):
    taken = []
    made = type(one)(**arguments(one, taken))
    assert taken
    before = content(made)
    assert before == content(one)  # and nothing was lost on the way
    spoil(taken)
    assert content(made) == before


def is_check(own):
    """Whether an object is a class of checks."""
    return inspect.isclass(own) and issubclass(own, jc.design.Check)


def test_every_class_that_users_construct_is_among_the_examples():
    known = {type(one) for one in examples()}
    shipped = {one for one in TYPES.values() if one.__module__.startswith("jaxcable.")}
    assert {
        one for one in shipped if not is_check(one)
    } <= known  # others are registered by other tests of this process
    made_by_the_package = {"Scene", "Study", "Report", "Table", "Increment", "Step", "Trial"}
    made_by_the_package |= {"Line", "LineStudy", "MastJob", "MastStudy"}
    made_by_the_package |= {"Omission", "Cases", "ChunkReport", "CableData", "ProfileData", "Units"}
    # declarations in the bodies of own classes, texts and functions: no arrays
    made_by_the_package |= {"PhaseInput", "Result", "Rule"}
    # settings of one call, which copy what they are given (tests/design/test_checks.py)
    made_by_the_package |= {own.__name__ for own in vars(jc.design).values() if is_check(own)}

    def walk(module):
        for own in (getattr(module, name) for name in module.__all__):
            if inspect.ismodule(own) and hasattr(own, "__all__"):
                yield from walk(own)
            elif inspect.isclass(own) and (
                dataclasses.is_dataclass(own) or hasattr(own, "_fields")
            ):
                yield own

    others = {
        own for own in walk(jc) if own not in known and own.__name__ not in made_by_the_package
    }
    assert others and all(hasattr(own, "_all_fields") for own in others)  # results, as pytrees


def test_what_is_owned_cannot_be_written_to_and_what_nobody_can_change_is_not_copied():
    nodes = np.array(NODES)
    structure = jc.Structure(nodes, {"net": CABLES}, jc.pinned([0, 1, 2, 3]))
    with pytest.raises(ValueError, match="read-only"):
        structure.nodes[3] += 1.0
    assert jc.replace(structure, supports=jc.pinned([0, 1])).nodes is structure.nodes
    assert structure.elements["net"] is CABLES
    traced = jnp.asarray(NODES)
    assert jc.replace(structure, nodes=traced).nodes is traced
    view = np.broadcast_to(nodes, nodes.shape)  # read-only, of an array that is not
    moved = jc.replace(structure, nodes=view)
    nodes[3] += 1.0
    assert not view.flags.writeable and (moved.nodes == np.array(NODES)).all()
    found = jax.tree.map(lambda x: 2 * x, structure)
    assert (found.nodes == 2 * np.array(NODES)).all() and isinstance(found.nodes, np.ndarray)


def test_other_containers_are_taken_apart():
    """Those that jax knows: what is in them is copied, and they are made anew."""
    one, ordered = np.zeros(2), collections.OrderedDict(b=np.zeros(2), a=[np.zeros(1)])
    kept = owned_copy({"x": (one, jc.scenes.Scene(None, [one])), "y": ordered, "z": "text"})
    one += 1.0
    ordered["b"] += 1.0
    ordered["a"].append(one)
    assert kept["x"][0].sum() == kept["x"][1].phases[0].sum() == kept["y"]["b"].sum() == 0.0
    assert list(kept["y"]) == ["b", "a"] and len(kept["y"]["a"]) == 1 and kept["z"] == "text"
    masked = owned_copy(np.ma.masked_array([1.0, 2.0], [True, False]))
    assert not masked.flags.writeable


@pytest.mark.slow
def test_results_do_not_change_with_arguments_either():
    """Of functions that keep what they are given, or a part of it."""
    structure, (prestress, loading) = jc.scenes.flat_net(increments=(1, 1))
    phases, force, start = [prestress, loading], np.full((4, 3), -1.0), np.array([3.0, 4.0])
    held = np.eye(3)
    made = [
        jc.solve(structure, phases),
        jc.restrained([0], "x", axes=held),
        jc.loads.combine({"a": jc.NodalLoads([0, 1, 2, 3], force)}, np.ones(1)),
        jc.minimize(lambda x: ((x - 1.0) ** 2).sum(), start, steps=1).params,
        jc.Section.polygon(held[:, :2], [], STEEL, size=0.5),
    ]
    before = content(made)
    phases.pop()
    for array in (force, start, held):
        array += 1.0
    assert content(made) == before
