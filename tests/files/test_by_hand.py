"""Scenes that a person writes by hand: what may be left out, and what messages say."""

import collections
import copy
import json
import warnings

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from test_schema import CHECK

import jaxcable as jc
from jaxcable.cli import main
from jaxcable.files import FileError
from jaxcable.forms.members import stated

NODES = [[0, 0, 0], [0, 0, 3], [4, 0, 0], [-2, 3, 0], [-2, -3, 0]]
STEEL = jc.Elastic(210e9)
TUBE = jc.Section([0.0], [0.0], [0.0014], [STEEL], torsion=[4e-6], own=[[2e-6, 2e-6, 0]])


def mast(**more):
    """A mast of one beam with three guys, and a tie that stiffens nothing; groups by name."""
    guys = jc.Cables([[1, 2], [1, 3], [1, 4]], axial_stiffness=1e6, expansion=1e-5)
    groups = {"guys": guys, "mast": jc.Beams([[0, 1]], section=TUBE), **more}
    return jc.Structure(np.array(NODES, float), groups, jc.clamped([0]) + jc.pinned([2, 3, 4]))


FULL = {
    "pretension": {"guys": 10e3, "mast": None},
    "shortening": {"guys": jc.only([1], 0.002), "mast": None},
    "temperature": {"guys": np.array([1.0, 2.0, 3.0]), "mast": None},
    "jacking": {"guys": None, "mast": None},
    "adds": {"guys": jc.only([0]), "mast": None},
    "removes": {"guys": np.array([True, False, False]), "mast": None},
}


@pytest.mark.parametrize("name", FULL)
def test_groups_that_are_left_out_have_no_statement(name):
    """Bit by bit what None says, through two phases."""
    states = []
    for none in (True, False):
        stated = {k: v for k, v in FULL[name].items() if none or v is not None}
        phases = [jc.Phase(pretension=5e3), jc.Phase(**{name: stated})]
        solution = jc.solve(mast(), phases)
        assert solution.status == 0
        states.append(jax.tree.leaves((solution.displacement, solution.tension)))
    for one, other in zip(*states, strict=True):
        np.testing.assert_array_equal(one, other)


def test_an_empty_statement_states_nothing():
    assert all(not stated for stated in jc.Phase(pretension={}).inputs(mast()))


def test_they_may_be_traced():
    """Under jit, grad and vmap; the derivative is that of the scalar statement of the guys."""
    structure = mast()

    def top(force, by_name):
        stated = {"guys": force} if by_name else {"guys": force, "mast": None}
        solution = jc.solve(structure, jc.Phase(pretension=stated, shortening={"guys": 1e-4}))
        return solution.displacement[1, 2]

    named, full = (jax.jit(jax.value_and_grad(top), static_argnums=1)(9e3, k) for k in (1, 0))
    np.testing.assert_array_equal(named, full)
    assert full[1] < 0  # guys push the mast down
    forces = jnp.array([8e3, 9e3])
    batch = jax.vmap(top, in_axes=(0, None))(forces, True)
    np.testing.assert_allclose(batch[1], named[0], rtol=1e-9)  # another order of operations


def test_they_may_lie_within_others():
    """Groups in groups, beside lists, which need an entry for each."""
    cables = jc.Cables([[0, 1], [1, 2]], axial_stiffness=1e5)
    bars = [jc.Bars([[1, 3]], axial_stiffness=1e5), jc.Bars([[1, 4]], axial_stiffness=1e5)]
    nodes = np.array(NODES, float)
    groups = {"net": {"a": cables, "b": bars}, "tie": jc.Bars([[2, 3]], axial_stiffness=1e5)}
    structure = jc.Structure(nodes, groups, jc.pinned([0, 2, 3, 4]))

    def largest(value):
        found = jc.Phase(pretension=value).inputs(structure)
        return [float(np.max(of["pretension"].values)) if of else None for of in found]

    assert largest({"net": {"a": 1.0}}) == [1.0, None, None, None]
    assert largest({"net": {"b": [None, 2.0]}}) == [None, None, 2.0, None]
    assert largest({"net": 3.0}) == [3.0, 3.0, 3.0, None]
    assert largest({"tie": 4.0}) == [None, None, None, 4.0]
    ordered = collections.OrderedDict(tie=4.0)
    assert largest(ordered) == [None, None, None, 4.0]
    with pytest.raises(ValueError, match=r"pretension: expected one number, .* by group"):
        largest({"net": {"b": {"c": 1.0}}})
    with pytest.raises(ValueError, match=r"no group 'c' .*; there are 'a', 'b'"):
        largest({"net": {"c": 1.0}})


def test_form_finding_takes_them_too():
    """What all of its statements go through."""
    full, short = (stated(q, mast(), "q") for q in ({"guys": 2.0, "mast": None}, {"guys": 2.0}))
    for one, other in zip(jax.tree.leaves(full), jax.tree.leaves(short), strict=True):
        np.testing.assert_array_equal(one, other)
    assert short[0][1] is None and not short[1][1].any()


SCENE = {
    "format": "jaxcable scene",
    "version": 1,
    "structure": {
        "nodes": NODES,
        "elements": {
            "guys": {"type": "Cables", "links": [[1, 2], [1, 3], [1, 4]], "axial_stiffness": 1e6},
            "mast": {
                "type": "Beams",
                "links": [[0, 1]],
                "section": {
                    "y": [0],
                    "z": [0],
                    "area": [0.0014],
                    "own": [[2e-6, 2e-6, 0]],
                    "torsion": [4e-6],
                    "laws": [{"type": "Elastic", "E": 210e9}],
                },
            },
        },
        "supports": {"clamps": [0], "nodes": [2, 3, 4]},
    },
    "phases": [
        {"pretension": {"guys": 10e3}},
        {"loads": [{"type": "NodalLoads", "nodes": [1], "forces": [100, 0, 0]}]},
    ],
}


def read(tmp_path, *changes):
    """`load_scene` of the scene with some changes, pairs (path, value)."""
    data = copy.deepcopy(SCENE)
    for path, value in changes:
        part = data
        for key in path[:-1]:
            part = part[key]
        part[path[-1]] = value
    (tmp_path / "scene.json").write_text(json.dumps(data))
    return jc.load_scene(tmp_path / "scene.json"), data


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("pretension", {"guys": 1e3}),
        ("jacking", {"guys": {"type": "Only", "elements": [0], "values": 1e3}}),
        ("shortening", {"guys": [0.001, 0.002, 0.001]}),
        ("pretension", {}),
        ("removes", {"guys": {"type": "Selection", "elements": [0]}}),
        ("removes", {"guys": [True, False, False]}),
    ],
)
def test_files_may_leave_groups_out(field, value, tmp_path):
    (_, phases), data = read(tmp_path, (("phases", 1), {field: value}))
    CHECK.validate(data)
    assert getattr(phases[1], field) is not None
    jc.save_scene(tmp_path / "again.json", (mast(), phases))
    assert (
        json.loads((tmp_path / "again.json").read_text())["phases"][1][field].keys() == value.keys()
    )


LOADS = ("phases", 1, "loads")
PHASES = ("phases",)
MAST = ("structure", "elements", "mast")
SUPPORTS = ("structure", "supports")
NAMES = "'guys', 'mast'; did you mean "
MOVED = {"type": "SupportMovement", "nodes": [1], "displacements": [1, 0, 0]}
WRONG = {  # what is put where, and what the reader says
    "misspelt group": (
        (*PHASES, 0, "pretension"),
        {"guy": 1.0},
        rf"phases\[0\].pretension: no group 'guy' .* {NAMES}'guys'",
    ),
    "misspelt added group": (
        (*PHASES, 1, "adds"),
        {"mats": True},
        rf"phases\[1\].adds: no group 'mats' .* {NAMES}'mast'\?",
    ),
    "misspelt added key": (
        (*PHASES, 1, "adds"),
        "mats",
        rf"phases\[1\].adds = 'mats': no such key .* {NAMES}'mast'\?",
    ),
    "groups within a group": (
        (*PHASES, 0, "pretension"),
        {"guys": {"first": 1.0}},
        r"phases\[0\].pretension: expected one number, .* by group: .* 'guys', 'mast', got",
    ),
    "text for a number": (
        (*PHASES, 0, "pretension"),
        {"guys": "10"},
        r"phases\[0\]: pretension: expected numbers, got text",
    ),
    "group that cannot": (
        (*PHASES, 0, "temperature"),
        {"guys": -30.0},
        r"phases\[0\].temperature: the group has no expansion",
    ),
    "group of a load": (
        (*LOADS, 0),
        {"type": "LineLoads", "forces": [1, 0, 0], "on": "Mast"},
        rf"phases\[1\].loads\[0\]: on = 'Mast': .* {NAMES}'mast'",
    ),
    "load without type": (
        LOADS,
        [{"nodes": [1], "forces": [1, 0, 0]}],
        r'phases\[1\].loads\[0\]: no "type"; a load has one, such as NodalLoads',
    ),
    "only load without type": (LOADS, {"nodes": [1]}, r'phases\[1\].loads: no "type"'),
    "group without type": (
        ("structure", "elements", "guys"),
        {"links": [[1, 2]]},
        r'structure.elements\[.guys.\]: no "type"; .* such as Cables',
    ),
    "law without type": (
        (*MAST, "section", "laws"),
        [{"E": 1.0}],
        r'section.laws\[0\]: no "type"; a law has one, such as Elastic',
    ),
    "short node": (
        ("structure", "nodes", 2),
        [4, 0],
        r"structure.nodes\[2\]: .* got 2 where others have 3",
    ),
    "text in a node": (
        ("structure", "nodes", 2, 1),
        "0",
        r'structure.nodes\[2\]\[1\]: expected a number, got "0"',
    ),
    "movement of a free node": (
        (*LOADS, 0),
        MOVED,
        r"phases\[1\].loads\[0\]: displacements\[0\]: node 1 is free along x",
    ),
    "held alone": (SUPPORTS, {"nodes": [0], "held": [[True] * 6]}, "supports chosen: missing"),
    "chosen alone": (SUPPORTS, {"chosen": [0]}, "supports held: missing"),
    "nothing held": (SUPPORTS, {}, "nothing is held; give nodes or clamps"),
}
SPEAKS = ("prefix", "pytree", "None", "<U", "dict", "ndarray is")


@pytest.mark.parametrize("name", WRONG)
def test_messages_name_the_place_and_what_is_known(name, tmp_path):
    path, value, message = WRONG[name]
    with pytest.raises(FileError, match=message) as caught:
        read(tmp_path, (path, value))
    assert not any(word in str(caught.value) for word in SPEAKS)


# --- supports: directions that are left out, and the remedy for a mast that spins


def test_directions_that_are_left_out_are_x_y_z(tmp_path):
    held = [[False, True, False, False, False, True]]
    (structure, _), data = read(
        tmp_path, (("structure", "supports"), {"nodes": [0, 2, 3, 4], "chosen": [0], "held": held})
    )
    CHECK.validate(data)
    np.testing.assert_array_equal(structure.supports.directions(5), np.tile(np.eye(3), (5, 1, 1)))
    np.testing.assert_array_equal(structure.supports.fixed(5)[0], [1, 1, 1, 0, 0, 1])
    own = jc.restrained([0], "y", "z")  # the same, made in Python
    np.testing.assert_array_equal(own.axes.array, structure.supports.axes.array)


@pytest.mark.parametrize("top", [[0.0, 0.0, 3.0], [1.0, 0.5, 3.0]])
def test_the_remedy_for_a_spin_helps(top, tmp_path):
    """What the warning says for scene files, put into the file, ends it."""
    pinned = ("structure", "supports"), {"nodes": [0, 2, 3, 4]}
    upright = ("structure", "elements", "mast", "up"), [1, 0, 0]
    changes = (pinned, upright, (("structure", "nodes", 1), top))
    with pytest.warns(jc.InputWarning, match="can spin about") as seen:
        read(tmp_path, *changes)
    (text,) = {str(w.message) for w in seen}
    remedy = json.loads("{" + text.split("in supports, ")[1] + "}")
    assert ("axes" in remedy) == (top[0] != 0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        (structure, phases), data = read(tmp_path, *changes, (pinned[0], pinned[1] | remedy))
    CHECK.validate(data)
    assert jc.solve(structure, phases).status == 0


# --- beams without bending stiffness


@pytest.mark.parametrize(
    ("fibres", "words"),
    [
        ({"y": [0.0], "z": [0.0]}, "all axes: its fibres are one point; give `own`"),
        ({"y": [0.3], "z": [-0.2]}, "all axes: its fibres are one point; give `own`"),
        ({"y": [-0.1, 0.1], "z": [0.1, 0.3]}, "one axis: its fibres are points on one line"),
    ],
)
def test_a_beam_that_does_not_resist_bending_is_named(fibres, words):
    count = len(fibres["y"])
    section = jc.Section(**fibres, area=[0.001] * count, laws=[STEEL], torsion=[1e-6])
    nodes = np.array(NODES[:2], float)
    with pytest.warns(jc.InputWarning, match=r"elements\['mast'\].section: .* EI is zero") as seen:
        beams = {"mast": jc.Beams([[0, 1]], section=section)}
        jc.Structure(nodes, beams, jc.clamped([0]))
    assert words in str(seen[-1].message)
    if "one line" in words:  # which is enough where nothing leaves a plane
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            in_plane = jc.Supports([[False, True, False]] * 2)
            jc.Structure(nodes, beams, jc.clamped([0]) + in_plane)


def test_a_fibre_with_moments_is_not_and_nothing_traced_is():
    """The second moments count for linear laws only, see `Section.own`."""
    nodes = np.array(NODES[:2], float)
    thin = jc.Section.rectangle(1e-5, 1.0, STEEL, shape=(1, 4))  # a ratio of 1e-10 of EI and EA b2
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        layers = jc.Section.rectangle(0.1, 0.2, jc.materials.steel(), shape=(1, 8))  # in a plane
        for section in (TUBE, thin, layers):
            jc.Structure(nodes, jc.Beams([[0, 1]], section=section), jc.clamped([0]))

        def traced(area):
            section = jc.Section([0.0], [0.0], area, [STEEL], torsion=[1e-6])
            jc.Structure(nodes, jc.Beams([[0, 1]], section=section), jc.clamped([0]))
            return area

        jax.jit(traced)(jnp.array([1.0]))
    law = jc.Polygonal([-0.01, 0, 0.01], [-1e8, 0, 1e8])
    section = jc.Section([0.0], [0.0], [0.001], [law], torsion=[1e-6], own=[[1e-6, 1e-6, 0]])
    with pytest.warns(jc.InputWarning, match="EI is zero about all axes: .*; give more fibres"):
        jc.Structure(nodes, jc.Beams([[0, 1]], section=section), jc.clamped([0]))


# --- what `info` prints


def test_info_names_the_groups_of_statements(tmp_path, capsys):
    some = {"guys": {"type": "Only", "elements": [0], "values": 0.01}}
    more = [{"temperature": -30, "pretension": 10e3}, {"shortening": some}]
    warm = ("structure", "elements", "guys", "expansion"), 1e-5
    _, data = read(tmp_path, warm, (("phases",), more))
    del data["structure"]["elements"]["mast"]["section"]["own"]
    (tmp_path / "scene.json").write_text(json.dumps(data))
    assert main(["info", str(tmp_path / "scene.json")]) == 0
    printed = capsys.readouterr()
    assert "  pretension 10000 N on guys; none on mast\n" in printed.out
    assert "  temperature -30 K on guys; mast has no expansion\n" in printed.out
    assert "  shortening 0.01 m on guys (1 of 3 elements); none on mast\n" in printed.out
    assert "elements['mast'].section: its bending stiffness EI is zero" in printed.err
    jc.save_scene(tmp_path / "net.json", jc.scenes.flat_net())
    assert main(["info", str(tmp_path / "net.json")]) == 0
    assert "  pretension 200 N\n" in capsys.readouterr().out
