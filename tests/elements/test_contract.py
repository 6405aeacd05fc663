"""The contract of elements: every name that is asked of a group, and what happens without it."""

import ast
import warnings
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from extensions.own_elements import GroundSprings, TurningSprings
from extensions.own_links import Brittle, Hooks, Jacks, Lying, Thrusters
from extensions.own_membrane import Membranes
from numpy.testing import assert_allclose

import jaxcable as jc
from jaxcable.common import memory, status
from jaxcable.elements import abilities, check
from jaxcable.elements.element import Element, ElementState
from jaxcable.elements.straight import Straight
from jaxcable.loads.load import Dead, Following, Load, Measured, Moving, OnNodes
from jaxcable.materials.law import Law

PACKAGE = Path(jc.__file__).parent
ABILITIES = [x for x in vars(abilities).values() if isinstance(x, type) and issubclass(x, Element)]
ROOMS = {  # rooms in which a variable of this name is always of this kind
    "group": [p.name for p in PACKAGE.iterdir() if p.is_dir() and p.name != "elements"],
    "any_group": ["analysis"],
    "stateable": ["mechanics"],
    "state": ["mechanics", "loads"],
    "load": ["mechanics", "analysis", "equilibrium", "paths", "results"],
    "law": ["design", "reporting", "plots", "model"],
}


def names_of(*classes):
    """Attributes and annotations of classes."""
    found = set()
    for one in classes:
        found.update(dir(one))
        for base in one.__mro__:
            found.update(vars(base).get("__annotations__", {}))
    return found


KNOWN = {
    "group": names_of(*ABILITIES),
    "any_group": names_of(*ABILITIES),
    "stateable": names_of(*ABILITIES),
    "state": names_of(ElementState),
    "load": names_of(Load, OnNodes, Moving, Dead, Measured, Following),
    "law": names_of(Law),
}
OTHERS = {  # what a variable of this name is besides, here
    "load": {"ndim", "shape", "at", "begun"},
    "group": {"_index_fields", "_static_fields"},  # of every `pytree`
}
STRAIGHT = ("forms/prescribed.py", "files/opensees.py")
"""Modules that refuse all groups but those that derive from `Straight` first."""


def asked(source):
    """Pairs (variable, name) of attributes, and ("group", text) of methods called by their name."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            yield node.value.id, node.attr
        if isinstance(node, ast.Call) and node.args:
            called = node.func.id if isinstance(node.func, ast.Name) else ""
            first = node.args[0]
            if called in ("each", "of_each", "of_all") and isinstance(first, ast.Constant):
                yield "group", first.value


def holes(source, room, extra=()):
    """Names that are asked of groups, states, loads or laws, and are not in their contract."""
    return {
        (variable, name)
        for variable, name in asked(source)
        if room in ROOMS.get(variable, ())
        and name not in KNOWN[variable] | OTHERS.get(variable, set()) | set(extra)
    }


def test_every_name_that_is_asked_for_is_in_the_contract():
    found, seen = {}, set()
    for path in sorted(PACKAGE.rglob("*.py")):
        where = str(path.relative_to(PACKAGE))
        room, source = where.split("/")[0], path.read_text()
        extra = names_of(Straight) if where in STRAIGHT else ()
        if missing := holes(source, room, extra):
            found[where] = missing
        seen |= {name for variable, name in asked(source) if variable == "group"}
    assert found == {}
    assert {"strain", "tension", "lock", "beyond", "links", "symmetric"} <= seen


def test_the_search_finds_what_is_missing():
    assert holes('each("wobble", group, state)', "paths") == {("group", "wobble")}
    assert holes("f(group.wobble, state.wobble)", "mechanics") == {
        ("group", "wobble"),
        ("state", "wobble"),
    }


@pytest.mark.parametrize(
    "group",
    [
        GroundSprings([[1], [2]], np.array([[3.0, 2.0, 5.0]] * 2)),
        TurningSprings([[1], [2]], np.array([3.0, 4.0])),
        Membranes([[0, 1, 2], [1, 2, 3]], 1e4, 0.3, weight=3.0),
        Hooks([[0, 1], [2, 1]], 1e3, -0.2),
        Brittle([[0, 1]], 1e3, 2.0),
        Thrusters([[0, 1]], 10.0, 3.0),
        jc.Cables([[0, 1]], axial_stiffness=1e3, rest_length=0.9),
        jc.Bars([[0, 1], [1, 2]], area=1e-3, law=jc.Polygonal([0, 0.1, 1], [0, 1e6, 2e6])),
        jc.Beams([[0, 1]], section=jc.Section.disc(0.3, jc.Elastic(3e4), (2, 2))),
    ],
    ids=lambda g: type(g).__name__,
)
def test_elements_keep_their_contract(group):
    check(group, NODES)


def test_what_does_not_keep_the_contract_is_told():
    with pytest.raises(ValueError, match=r"Lying: symmetric: its tangent is not .* symmetric = F"):
        check(Lying([[0, 1]], 10.0, 3.0), NODES, conservative=False)
    with pytest.raises(ValueError, match="energy: the end forces are not its gradient"):
        check(Lying([[0, 1]], 10.0, 3.0), NODES)
    with pytest.raises(ValueError, match="Jacks: Jacked: its state needs a field `jack_force`"):
        check(Jacks([[0, 1]], 1e3), NODES)

    class Careless(Brittle):
        beyond = Element.beyond

    group = Careless([[0, 1]], 1e3)
    with pytest.raises(
        ValueError, match=r"elements\['own'\] \(Careless\): breaks = True needs .*`b"
    ):
        jc.Structure(NODES[:2], {"own": group}, jc.pinned([0]))


# --- own elements in every call

NODES = np.array([[-4.0, 0.0, 3.0], [0.0, 0.0, 0.0], [4.0, 0.0, 3.0], [0.0, 4.0, 3.0]])
LINKS = [[0, 1], [1, 2], [1, 3]]


@pytest.fixture(scope="module")
def own():
    """Cables, hooks that are slack and rods of one's own: structure, phases and solution."""
    elements = {
        "net": jc.Cables(LINKS, axial_stiffness=1e5),
        "hooks": Hooks([[0, 1], [2, 1]], 1e3, 0.5),
        "rods": Brittle([[3, 1]], 1e3, 5.0),
    }
    structure = jc.Structure(NODES, elements, jc.pinned([0, 2, 3]))
    load = jc.NodalLoads([1], (3.0, 5.0, -40.0))
    phases = [jc.Phase(pretension={"net": 500.0}), jc.Phase(loads=load, increments=4)]
    with warnings.catch_warnings():  # the weight of the rods is for frequencies: no `SelfWeight`
        warnings.simplefilter("ignore", jc.InputWarning)
        return structure, phases, jc.solve(structure, phases)


def test_own_elements_in_every_result(own, tmp_path):
    structure, phases, solution = own
    assert solution.status == status.OK
    told = jc.forms.statements(structure, solution)
    assert np.isnan(told.rest_length["hooks"]).all() and np.isnan(told.pretension["rods"]).all()
    assert_allclose(told.rest_length["rods"], 5.0)  # a 3-4-5 triangle
    assert_allclose(told.pretension["net"], solution.tension["net"], rtol=1e-10)
    assert jc.fibre_stress(structure, solution.phases[1])["rods"] is None
    text = str(jc.report(structure, solution, names=["prestress", "wind"]))
    assert "phase 2, wind: 4 of 4 increments converged" in text
    assert_allclose(
        jc.energy_balance(structure, phases, solution).relative[1], 0.0, atol=0.02
    )  # increments^2
    jc.files.save_result(tmp_path / "own.npz", structure, solution)
    assert "tension.hooks" in jc.files.load_result(tmp_path / "own.npz")
    jc.plots.net(solution, structure=structure, phase=0)


def test_own_elements_are_loaded_along_their_length(own):
    structure, phases, _ = own
    line = jc.LineLoads((0.0, 0.0, -2.0), on="rods")
    solution = jc.solve(structure, [phases[0], jc.Phase(loads=[line, jc.SelfWeight()])])
    assert solution.status == status.OK
    assert_allclose(solution.load[1], [0.0, 0.0, -0.5 * (2.0 + 5.0) * 5.0], rtol=1e-12)


def test_what_own_elements_cannot_do_is_refused_by_name(own):
    structure, phases, solution = own
    hooks = r"elements\['hooks'\] \(Hooks\)"
    pressure = jc.CablePressure(1.0, (0.0, 1.0, 0.0), on="hooks", per="unstressed")
    for text, call in (
        (rf"{hooks} is not made of straight", lambda: jc.find_form(structure, tension=1.0)),
        (rf"{hooks} is not made of straight", lambda: jc.forms.self_stress(structure)),
        (rf"{hooks} has no strain along an axis \(ability `Uniaxial`\)", lambda: slack(own)),
        (rf"{hooks} has slack elements and no method `unst", lambda: buckle(structure, solution)),
        (rf"{hooks} has no unstressed length; give per", lambda: loaded(structure, pressure)),
        (rf"{hooks} cannot come and go", lambda: jc.solve(structure, jc.Phase(removes="rods"))),
        (
            rf"{hooks} has no length to load",
            lambda: loaded(structure, jc.LineLoads((1.0, 0, 0), on="hooks")),
        ),
        (r"secant.*elements\['hooks'\] \(Hooks\)", lambda: secant(structure, phases)),
        ("cannot be prestressed; in elements.'hooks'", lambda: stated(structure, pretension=1.0)),
        ("both state the prestress of elements.'net'", lambda: twice(structure)),
    ):
        with pytest.raises(ValueError, match=text):
            call()


def slack(own):
    return jc.design.slack_distance(own[0], own[2])


def buckle(structure, solution):
    return jc.stiffness.buckling_factor(structure, solution)


def loaded(structure, load):
    return jc.solve(structure, jc.Phase(loads=load))


def secant(structure, phases):
    return jc.solve(structure, phases, jc.Incremental(stiffness="secant"))


def stated(structure, **statement):
    return jc.solve(structure, jc.Phase(**{name: {"hooks": v} for name, v in statement.items()}))


def twice(structure):
    return jc.solve(structure, jc.Phase(pretension={"net": 1.0}, prestrain={"net": 1e-3}))


def test_a_state_without_the_field_of_a_statement_is_refused():
    structure = jc.Structure(
        NODES[:2], Jacks([[0, 1]], 1e3), jc.pinned([0]) + jc.restrained([1], "yz")
    )
    with pytest.raises(
        ValueError, match="Long: a state of elements without the field `jack_force`"
    ):
        jc.solve(structure, jc.Phase(jacking=10.0))
    with pytest.raises(TypeError, match=r"abstract method '?tension"):

        class Untold(abilities.Jacked):
            start = restate = lock = end_forces = energy = None

        Untold()


def test_paths_of_own_elements_to_their_failure():
    """A rod breaks at a strain of 1 %, at 1 % of EA; a slack hook takes part from 5 mm on."""
    nodes = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    elements = {"rod": Brittle([[0, 1]], 1e3), "hook": Hooks([[0, 1]], 1e3, 0.005)}
    structure = jc.Structure(nodes, elements, jc.pinned([0]) + jc.restrained([1], "xy"))
    load = jc.Phase(loads=jc.NodalLoads([1], (0.0, 0.0, -20.0)))
    path = jc.trace_path(structure, load, step=0.2)
    assert path.status == status.MATERIAL_FAILURE
    assert path.events.names == ["tightening", "material failure"]
    # 5 N at 5 mm; 10 N and 5 N at 10 mm
    assert_allclose(path.events.load_factor, [5.0 / 20.0, 15.0 / 20.0], atol=1e-4)


# --- unsymmetric elements

K, D = 10.0, 2.0


def thrown(thrust, kind=Thrusters, **options):
    """Position of the end of a thruster, which stands on x, in the plane."""
    nodes = np.array([[0.0, 0.0, 0.0], [D, 0.0, 0.0]])
    elements = {"push": kind([[0, 1]], K, thrust)}
    structure = jc.Structure(nodes, elements, jc.pinned([0]) + jc.restrained([1], "z"))
    return structure, jc.solve(structure, jc.Phase(increments=3), **options)


def exact(thrust):
    size = np.sqrt(D**2 - (thrust / K) ** 2)
    z = K * D / (K - 1j * thrust / size)
    return np.array([z.real, z.imag])


@pytest.mark.parametrize("solver", [None, "superlu"])
def test_a_follower_force_of_an_element(solver):
    """Against its closed form; derivatives forward, backward and by differences agree."""
    method = jc.Newton(linear_solver=solver)
    structure, solution = thrown(7.0, method=method)
    assert solution.status == status.OK and solution.stable
    assert_allclose(solution.positions[1, :2], exact(7.0), rtol=1e-10)
    tangent = jc.stiffness.tangent_of(structure, solution)
    assert np.abs(tangent - tangent.T).max() > 1.0

    def end(p):
        return thrown(p, method=method)[1].positions[1, :2]

    _, forward = jax.jvp(end, (7.0,), (1.0,))
    (backward,) = zip(*(jax.vjp(end, 7.0)[1](row) for row in jnp.eye(2)), strict=True)
    h = 1e-4
    slope = (exact(7.0 + h) - exact(7.0 - h)) / (2 * h)  # of order h^2
    assert_allclose(forward, slope, rtol=1e-7)
    assert_allclose(backward, forward, rtol=1e-10)


def test_taylor_and_a_lie_as_control():
    """Remainders fall with slope 2; a tangent that is taken as symmetric gives another adjoint."""
    at, steps = 7.0, 1e-2 * 0.5 ** np.arange(4)

    def order(kind):
        slope = float(jax.grad(lambda p: thrown(p, kind)[1].positions[1, 0])(at))
        left = [abs(exact(at + h)[0] - exact(at)[0] - h * slope) for h in steps]
        return np.polyfit(np.log(steps), np.log(left), 1)[0]

    assert order(Thrusters) == pytest.approx(2.0, abs=0.1)
    assert order(Lying) == pytest.approx(1.0, abs=0.1)


def test_what_needs_symmetry_is_refused():
    structure, solution = thrown(3.0)
    named = r": elements\['push'\] \(Thrusters\) has symmetric = False"
    for call in (
        jc.stiffness.buckling_factor,
        jc.stiffness.natural_frequencies,
        jc.stiffness.modes,
    ):
        with pytest.raises(ValueError, match=call.__name__ + named):
            call(structure, solution)
    given = jc.stiffness.flexibility(structure, solution, [1], "xy")
    tangent = np.asarray(jc.stiffness.tangent_of(structure, solution))
    assert_allclose(given, np.linalg.inv(tangent), rtol=1e-10)


# --- moments without a potential, memory, warnings


def test_a_torque_buckles_a_column_as_if_semi_tangential():
    """pi EI / L for a moment that turns with half of the rotation of its node (Ziegler 1968)."""
    n, length = 16, 6.0
    section = jc.Section.box(0.1, 0.1, 0.005, jc.Elastic(210e9))
    inertia = (0.1**4 - 0.09**4) / 12
    beams = jc.Beams([[k, k + 1] for k in range(n)], section=section)
    nodes = np.linspace([0.0, 0.0, 0.0], [0.0, 0.0, length], n + 1)
    structure = jc.Structure(nodes, beams, supports=jc.clamped([0]))
    load = jc.NodalLoads([n], (0.0, 0.0, 0.0), moments=(0.0, 0.0, 50.0))
    solution = jc.solve(structure, jc.Phase(loads=load))
    assert solution.status == status.OK
    with pytest.warns(jc.InputWarning, match="semi-tangential"):
        found = jc.stiffness.buckling_factor(structure, solution)
    # of order 2 in the length of elements: 4.6 % of 8, 1.2 % of 16
    assert_allclose(50.0 * found.factor[0], np.pi * 210e9 * inertia / length, rtol=0.015)


def test_dense_matrices_that_do_not_fit_are_refused(monkeypatch):
    structure, phases = jc.scenes.flat_net()
    solution = jc.solve(structure, phases)
    monkeypatch.setattr(memory, "available", lambda: 2000)
    monkeypatch.setattr(memory, "_SMALL", 0)  # the net of this test is small
    calls = (
        jc.stiffness.tangent_of,
        jc.stiffness.modes,
        jc.stiffness.buckling_factor,
        lambda *at: jc.stiffness.natural_frequencies(*at, masses=1.0),
        lambda *at: jc.stiffness.flexibility(*at, [3]),
        lambda *at: jc.forms.self_stress(structure),
        lambda *at: jc.influence(structure, phases, of="displacement", wrt="load"),
        lambda *at: jc.solve(structure, phases, jc.Newton(linear_solver="dense", max_steps=99)),
    )
    for call in calls:
        with pytest.raises(
            ValueError, match=r"needs about .* MiB of memory, and 0.00191 MiB are left; "
        ):
            call(structure, solution)


def test_memory_that_is_left():
    assert 2**20 < memory.available() < 2**50
    memory.require(1.0, "nothing", "")


def test_names_of_phases_are_in_every_table():
    ends = jc.restrained([0], "xyz", "x") + jc.restrained([1], "yz")
    section = jc.Section.rectangle(0.1, 0.2, jc.Elastic(10e9))
    nodes = [[0.0, 0.0, 0.0], [6.0, 0.0, 0.0]]
    structure = jc.Structure(nodes, jc.Beams([[0, 1]], section=section), supports=ends)
    load = jc.Phase(loads=jc.LineLoads((0.0, 0.0, -1e3)))
    solution = jc.solve(structure, [load, load])
    report = jc.report(structure, solution, names=["dead", "snow"])
    assert report.tables["stress_envelope"].rows[0].count("snow") == 2
    cells = [cell for table in report.tables.values() for row in table.rows for cell in row]
    assert not [cell for cell in cells if isinstance(cell, str) and cell.startswith("phase")]
    assert any(line.startswith("phase 2, snow: ") for line in report.summary)


def test_rotations_in_degrees_are_suspected():
    with pytest.warns(
        jc.InputWarning, match=r"rotations\[1\]: a turn of 5 rad, which is 286.479 deg"
    ):
        jc.SupportMovement([0, 1], None, rotations=[[0.0, 0.1, 0.0], [0.0, 5.0, 0.0]])
    jc.SupportMovement([0, 1], None, rotations=np.radians([0.0, 180.0, 0.0]))  # no warning


def test_coordinates_of_maps_in_single_precision_are_suspected():
    nodes = NODES + np.array([3512345.12, 5411111.0, 400.0])
    cables = {"net": jc.Cables(LINKS, axial_stiffness=1e5)}
    with pytest.warns(
        jc.InputWarning, match=r"float32, whose next number is 0.5 m .*\['net'\] are 5 m"
    ):
        jc.Structure(nodes.astype(np.float32), cables, jc.pinned([0, 2, 3]))
    jc.Structure(nodes, cables, jc.pinned([0, 2, 3]))  # no warning
    jc.Structure(NODES.astype(np.float32), cables, jc.pinned([0, 2, 3]))


def test_weights_lighter_than_any_solid_are_suspected():
    rods = [jc.Bars([[0, 1]], area=1e-3, law=jc.Elastic(210e9), weight=w) for w in (77.0, 0.0077)]
    jc.Structure(NODES[:2], rods[0], jc.pinned([0]))
    with pytest.warns(jc.InputWarning, match=r"weight\[0\] = 0.0077: of a volume that weighs less"):
        jc.Structure(NODES[:2], rods[1], jc.pinned([0]))
