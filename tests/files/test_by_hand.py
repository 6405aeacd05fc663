"""Scenes that a person writes by hand: what may be left out, and what warnings say."""

import collections
import json
import warnings

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from banks.shapes import spokes
from file_cases import CHECK, MAST, NODES, changed, read_scene
from oracles.traced import traced

import jaxcable as jc
from jaxcable.analysis.activation import make_activation
from jaxcable.cli import main
from jaxcable.forms.input_checks import values_by_group

STEEL = jc.Elastic(210e9)
TUBE = jc.Section([0.0], [0.0], [0.0014], [STEEL], torsion=[4e-6], own=[[2e-6, 2e-6, 0]])
PLACES = np.array(NODES, float)


def mast():
    """A mast of one beam with three guys; groups by name."""
    guys = jc.Cables([[1, 2], [1, 3], [1, 4]], axial_stiffness=1e6, expansion=1e-5)
    groups = {"guys": guys, "mast": jc.Beams([[0, 1]], section=TUBE)}
    return jc.Structure(PLACES, groups, jc.clamped([0]) + jc.pinned([2, 3, 4]))


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("pretension", 10e3),
        ("shortening", jc.only([1], 0.002)),
        ("temperature", np.array([1.0, 2.0, 3.0])),
        ("jacking", None),
        ("adds", jc.only([0])),
        ("removes", np.array([True, False, False])),
    ],
)
def test_groups_that_are_left_out_have_no_statement(field, value):
    """What goes into an analysis is bit by bit what None says, as numbers and as traced ones."""
    structure = mast()
    short = {} if value is None else {"guys": value}
    full = {"guys": value, "mast": None}
    phases = [[jc.Phase(), jc.Phase(**{field: of})] for of in (short, full)]
    for read in (
        lambda all_: all_[1].inputs(structure),
        lambda all_: make_activation(structure, all_, None),
        lambda all_: (
            values_by_group({"guys": 2.0, **getattr(all_[1], field)}, structure, "q")
            if field == "pretension"
            else None
        ),  # what all inputs of form finding go through
    ):
        one, other = map(read, phases)
        assert jax.tree.structure(one) == jax.tree.structure(other)
        for a, b in zip(jax.tree.leaves(one), jax.tree.leaves(other), strict=True):
            np.testing.assert_array_equal(a, b)
    there = make_activation(structure, phases[0], None)
    assert (there is not None) == (field in ("adds", "removes"))
    assert bool(phases[0][1].inputs(structure)[0]) == (value is not None and there is None)


def test_groups_that_are_left_out_are_no_numbers_of_derivatives():
    def forces(force, more):
        phase = jc.Phase(pretension={"guys": force, **more})
        return phase.inputs(mast())[0]["pretension"].values

    for more in ({}, {"mast": None}):
        np.testing.assert_array_equal(jax.jit(jax.jacfwd(forces))(9e3, more), np.ones(3))
        batch = jax.vmap(forces, in_axes=(0, None))(jnp.array([8e3, 9e3]), more)
        np.testing.assert_array_equal(batch, [[8e3] * 3, [9e3] * 3])


def test_they_may_lie_within_others():
    """Groups in groups, beside lists, which need an entry for each."""
    cables = jc.Cables([[0, 1], [1, 2]], axial_stiffness=1e5)
    bars = [jc.Bars([[1, 3]], axial_stiffness=1e5), jc.Bars([[1, 4]], axial_stiffness=1e5)]
    groups = {"net": {"a": cables, "b": bars}, "tie": jc.Bars([[2, 3]], axial_stiffness=1e5)}
    structure = jc.Structure(PLACES, groups, jc.pinned([0, 2, 3, 4]))

    def largest(value):
        found = jc.Phase(pretension=value).inputs(structure)
        return [float(np.max(of["pretension"].values)) if of else None for of in found]

    assert largest({}) == [None] * 4
    assert largest({"net": {"a": 1.0}}) == [1.0, None, None, None]
    assert largest({"net": {"b": [None, 2.0]}}) == [None, None, 2.0, None]
    assert largest({"net": 3.0}) == [3.0, 3.0, 3.0, None]
    assert largest({"tie": 4.0}) == [None, None, None, 4.0]
    assert largest(collections.OrderedDict(tie=4.0)) == [None, None, None, 4.0]
    with pytest.raises(ValueError, match=r"\['net'\]\['b'\]: expected one number, .* got groups"):
        largest({"net": {"b": {"c": 1.0}}})
    with pytest.raises(ValueError, match=r"no group 'c' .*; there are 'a', 'b'"):
        largest({"net": {"c": 1.0}})


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
    data = changed(MAST, (("phases", 1), {field: value}))
    CHECK.validate(data)
    _, phases = read_scene(data, tmp_path)
    assert getattr(phases[1], field) is not None
    jc.save_scene(tmp_path / "again.json", (mast(), phases))
    again = json.loads((tmp_path / "again.json").read_text())
    assert again["phases"][1][field].keys() == value.keys()


# --- supports: directions that are left out, and the remedy for a mast that spins

SUPPORTS = ("structure", "supports")


def test_directions_that_are_left_out_are_x_y_z(tmp_path):
    held = [[False, True, False, False, False, True]]
    data = changed(MAST, (SUPPORTS, {"nodes": [0, 2, 3, 4], "chosen": [0], "held": held}))
    CHECK.validate(data)
    supports = read_scene(data, tmp_path)[0].supports
    np.testing.assert_array_equal(supports.directions(5), np.tile(np.eye(3), (5, 1, 1)))
    np.testing.assert_array_equal(supports.fixed(5)[0], [1, 1, 1, 0, 0, 1])
    own = jc.restrained([0], "y", "z")  # the same, made in Python
    np.testing.assert_array_equal(own.axes.array, supports.axes.array)


@pytest.mark.parametrize(
    ("top", "analyse"),
    [
        ([0.0, 0.0, 3.0], False),
        ([1.0, 0.5, 3.0], False),
        pytest.param([1.0, 0.5, 3.0], True, marks=pytest.mark.slow),
    ],
)
def test_the_remedy_for_a_spin_helps(top, analyse, tmp_path):
    """What the warning says for scene files, put into the file, ends it."""
    pinned = {"nodes": [0, 2, 3, 4]}
    upright = (("structure", "elements", "mast", "up"), [1, 0, 0])
    data = changed(MAST, (SUPPORTS, pinned), upright, (("structure", "nodes", 1), top))
    with pytest.warns(jc.InputWarning, match="can spin about") as seen:
        read_scene(data, tmp_path)
    (text,) = {str(w.message) for w in seen}
    remedy = json.loads("{" + text.split("in supports, ")[1] + "}")
    assert ("axes" in remedy) == (top[0] != 0)
    data = changed(data, (SUPPORTS, pinned | remedy))
    CHECK.validate(data)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        scene = read_scene(data, tmp_path)
    if analyse:
        assert jc.solve(*scene).status == 0


# --- beams without bending stiffness


@pytest.mark.parametrize(
    ("fibres", "words"),
    [
        ({"y": [0.3], "z": [-0.2]}, "all axes, because it is a single fibre; give `own`"),
        ({"y": [-0.1, 0.1], "z": [0.1, 0.3]}, "one axis, because its fibres lie on one line"),
    ],
)
def test_a_beam_that_does_not_resist_bending_is_named(fibres, words):
    count = len(fibres["y"])
    section = jc.Section(**fibres, area=[0.001] * count, laws=[STEEL], torsion=[1e-6])
    with pytest.warns(jc.InputWarning, match=r"elements\['mast'\].section: .* EI is zero") as seen:
        beams = {"mast": jc.Beams([[0, 1]], section=section)}
        jc.Structure(PLACES[:2], beams, jc.clamped([0]))
    assert words in str(seen[-1].message)
    if "one line" in words:  # which is enough where nothing leaves a plane
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            in_plane = jc.Supports([[False, True, False]] * 2)
            jc.Structure(PLACES[:2], beams, jc.clamped([0]) + in_plane)


def test_a_fibre_with_moments_is_not_and_nothing_traced_is():
    """The second moments count for linear laws only, see `Section.own`."""
    thin = jc.Section.rectangle(1e-5, 1.0, STEEL, shape=(1, 4))  # a ratio of 1e-10 of EI and EA b2
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        layers = jc.Section.rectangle(0.1, 0.2, jc.materials.steel(), shape=(1, 8))  # in a plane
        for section in (TUBE, thin, layers):
            jc.Structure(PLACES[:2], jc.Beams([[0, 1]], section=section), jc.clamped([0]))

        def inside(area):
            section = jc.Section([0.0], [0.0], area, [STEEL], torsion=[1e-6])
            jc.Structure(PLACES[:2], jc.Beams([[0, 1]], section=section), jc.clamped([0]))
            return area

        traced(inside)(jnp.array([1.0]))
    law = jc.Polygonal([-0.01, 0, 0.01], [-1e8, 0, 1e8])
    section = jc.Section([0.0], [0.0], [0.001], [law], torsion=[1e-6], own=[[1e-6, 1e-6, 0]])
    with pytest.warns(jc.InputWarning, match="EI is zero about all axes, .*; give more fibres"):
        jc.Structure(PLACES[:2], jc.Beams([[0, 1]], section=section), jc.clamped([0]))


def test_info_names_the_groups_of_statements(tmp_path, capsys):
    some = {"guys": {"type": "Only", "elements": [0], "values": 0.01}}
    warm = (("structure", "elements", "guys", "expansion"), 1e-5)
    data = changed(
        MAST,
        warm,
        (("phases",), [{"temperature": -30, "pretension": 10e3}, {"shortening": some}]),
        (("structure", "elements", "mast", "section", "own"), None),
    )
    (tmp_path / "scene.json").write_text(json.dumps(data))
    assert main(["info", str(tmp_path / "scene.json")]) == 0
    printed = capsys.readouterr()
    assert "  pretension 10 kN on guys; none on mast\n" in printed.out
    assert "  temperature -30 K on guys; mast has no expansion\n" in printed.out
    assert "  shortening 0.01 m on guys (element 0 of 3); none on mast\n" in printed.out
    assert "elements['mast'].section: its bending stiffness EI is zero" in printed.err
    jc.save_scene(tmp_path / "net.json", jc.scenes.flat_net())
    assert main(["info", str(tmp_path / "net.json")]) == 0
    assert "  pretension 200 N\n" in capsys.readouterr().out


# --- what `form` takes of a scene


def test_form_takes_loads_and_force_densities_of_the_scene(tmp_path, capsys, monkeypatch):
    """Four bars to a node, which their force densities q lift by 1 kN / 4 q."""
    monkeypatch.chdir(tmp_path)
    structure = spokes(4, group=jc.Bars).structure
    loads, snow = (jc.NodalLoads([0], (0.0, 0.0, force)) for force in (-1e3, -50.0))
    snow = jc.Phase(loads=snow)
    for phases in (
        [jc.Phase(force_density=-2e3), jc.Phase(loads=loads), snow],
        [jc.Phase(force_density=-2e3, loads=loads), snow],
    ):
        jc.save_scene("cross.json", (structure, phases))
        number = len(phases) - 1
        taken = ["--loads", "2"] * (number == 2)  # by default those of phase 1
        assert main(["form", "cross.json", *taken, "--save", "form.json"]) == 0
        out, err = capsys.readouterr()
        assert "force densities: those of phase 1\n" in out and "left out" not in err
        assert f"loads in the form: those of phase {number} (" in out
        found, (first, second) = jc.load_scene("form.json")
        np.testing.assert_allclose(found.nodes[0], [0, 0, 1e3 / 8e3], atol=1e-15)
        assert len(first.loads) == 1 and second.loads[0].nodes.array.tolist() == [0]
    assert main(["form", "cross.json", "--force-density", "-4e3", "--save", "form.json"]) == 0
    told = "force_density (1), phase 1: the prestress of the form replaces"
    assert told in capsys.readouterr().err
    found, _ = jc.load_scene("form.json")
    assert found.nodes[0, 2] == pytest.approx(1e3 / 16e3, rel=1e-14)
    assert main(["form", "cross.json", "--loads", "none"]) == 0
    out, _ = capsys.readouterr()
    assert "loads in the form: none\n" in out and "it lies in a plane, without loads" in out
    assert main(["form", "cross.json", "--loads", "9"]) == 2
    assert "--loads: expected numbers of phases, 1 to 2, or none" in capsys.readouterr().err


def test_form_tells_what_it_does_not_take(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    nodes = [[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [1, 1, 0]]
    cables = {"a": jc.Cables([[0, 1], [1, 2]], 1e5), "b": jc.Cables([[1, 3]], 1e5)}
    structure = jc.Structure(nodes, cables, jc.pinned([0, 2, 3]))
    settled = jc.SupportMovement([0], (0.0, 0.0, -0.01))
    phases = [
        jc.Phase(force_density={"a": 100.0}, pretension={"b": 70.0}),
        jc.Phase(loads=[jc.NodalLoads([1], (0.0, 0.0, -60.0)), settled]),
        jc.Phase(removes="b"),
        jc.Phase(pretension={"a": 30.0}),
    ]
    jc.save_scene("net.json", (structure, phases))
    assert main(["form", "net.json"]) == 2
    assert "element 0 of elements['b'] has no force density" in capsys.readouterr().err
    words = ["--force-density", "b=100", "--loads", "2", "--save", "form.json"]
    assert main(["form", "net.json", *words]) == 0
    out, err = capsys.readouterr()
    assert "force densities: those of phase 1, a\n" in out
    rows = [row.split(":")[0] for row in err.split("left out:\n")[1].splitlines()]
    assert rows == ["  SupportMovement (1), phase 2", "  pretension (2), phase 1, phase 4"]
    found, later = jc.load_scene("form.json")
    np.testing.assert_allclose(found.nodes[1], [1, 1 / 3, -0.2], atol=1e-14)  # 60 / (3 100)
    assert later[0].force_density == {"a": 100.0, "b": 100.0} and len(later[0].loads) == 1
    assert type(later[1].loads[0]) is jc.SupportMovement and later[2].removes is not None
    assert len(later) == 3
