"""Units of files and reports: read into SI, written back, and shown with their names."""

import functools
import json
import re

import jax
import matplotlib.text
import meshio
import numpy as np
import pytest
from file_cases import CHECK, blown
from oracles.convergence import converged

import jaxcable as jc
from jaxcable.common.tree import pytree
from jaxcable.common.units import SI, SYMBOLS, Units, as_units
from jaxcable.elements.abilities import PHASE_INPUTS
from jaxcable.extend import PhaseInput
from jaxcable.files import codec
from jaxcable.files.field_docs import (
    OF_PHASE_INPUT,
    field_units,
    may_have_unit,
    unit_in_description,
)

PUBLISHED = {  # NIST SP 811 (2008), appendix B.8, all exact; differences of temperatures
    **{"N": 1.0, "kN": 1e3, "kgf": 9.80665, "lbf": 4.4482216152605, "kip": 4448.2216152605},
    **{"m": 1.0, "mm": 1e-3, "cm": 1e-2, "in": 0.0254, "ft": 0.3048, "K": 1.0, "F": 1 / 1.8},
}
SYSTEMS = ("kN, m", "N, mm", "kip, ft, F", "kgf, cm")
POWERS = {  # of force, length and temperature, of fields of scene files
    **dict.fromkeys(("axial_stiffness", "strength", "pretension", "jacking"), (1, 0, 0)),
    **dict.fromkeys(("nodes", "rest_length", "sag", "shortening", "y", "z"), (0, 1, 0)),
    **dict.fromkeys(("points", "displacements"), (0, 1, 0)),
    **dict.fromkeys(("force_density", "weight", "LineLoads.forces"), (1, -1, 0)),
    **dict.fromkeys(("E", "stress", "AreaLoads.forces", "FacePressure.pressure"), (1, -2, 0)),
    **dict.fromkeys(("torsion", "own"), (0, 4, 0)),
    **{"area": (0, 2, 0), "expansion": (0, 0, -1), "temperature": (0, 0, 1)},
    **{"compliance": (-1, 0, 0), "torsional_stiffness": (1, 2, 0), "springs": (1, 1, 0)},
    **{"NodalLoads.forces": (1, 0, 0), "moments": (1, 1, 0), "CablePressure.pressure": (1, -1, 0)},
    **dict.fromkeys(("EA", "GAy", "GAz", "PointLoads.forces", "Train.forces"), (1, 0, 0)),
    **dict.fromkeys(("EIy", "EIz", "EIyz", "GJ"), (1, 2, 0)),
    **dict.fromkeys(("gap", "ground", "heights", "diameter", "thickness", "ice"), (0, 1, 0)),
    **dict.fromkeys(("spacings", "position", "begin", "end", "lowest_height"), (0, 1, 0)),
    **dict.fromkeys(("roughness_length", "reference_height"), (0, 1, 0)),
    **dict.fromkeys(("velocity", "velocities", "gravity"), (0, 1, 0)),  # per s, per s2
    **{"pressures": (1, -2, 0), "Crowd.forces": (1, -1, 0), "density": (0, -3, 0)},
    **dict.fromkeys(("Springs.stiffness", "GroundContacts.stiffness"), (1, -1, 0)),
    **{"rotational_stiffness": (1, 1, 0), "preload": (1, 0, 0), "Parallel.spring": (-1, 2, 0)},
}
PLAIN = {"axes", "prestrain", "up", "factor", "axis", "direction", "rotations", "parameters"}
PLAIN |= {"factors", "shares", "strain", "drag", "exponent", "orography", "turbulence", "places"}
PLAIN |= {"normal", "vertical"}
NOT_THESE = {("Beams", "points"), ("Supports", "nodes"), ("NodalLoads", "nodes"), ("Phase", "own")}
NOT_THESE |= {("SupportMovement", "nodes"), ("PointMasses", "nodes")}


def powers_of(name, field):
    """Powers of force, length and temperature of a field by the table above, or None."""
    if (name, field) in NOT_THESE:
        return None
    return POWERS.get(f"{name}.{field}", POWERS.get(field))


def in_units(data, factors, name=None):
    """Plain data of a scene in other units, by the table above: written apart from the package."""
    if isinstance(data, list):
        return [in_units(item, factors, name) for item in data]
    if not isinstance(data, dict):
        return data
    implied = {"structure": "Structure", "section": "Section", "supports": "Supports"}
    found = {}
    for key, value in data.items():
        powers = powers_of(data.get("type", name), key)
        if powers is not None:
            by = np.prod([factor**-power for factor, power in zip(factors, powers, strict=True)])
            found[key] = scaled(value, by)
        else:
            found[key] = in_units(value, factors, implied.get(key, "Phase"))
    return found


def scaled(value, by):
    if isinstance(value, dict):  # by group, or for some elements
        return {k: v if k in ("elements", "type") else scaled(v, by) for k, v in value.items()}
    if isinstance(value, list):
        return [scaled(item, by) for item in value]
    return value if value is None or isinstance(value, str) else value * by


def net():
    """Cables of a curve and of fibres, heated, with areas, weights and pressure."""
    nodes = [[-3.0, 0, 0.5], [3, 0, 0.5], [0, -3, 0], [0, 3, 0], [0, 0, 0.2], [1.5, 0, 0.3]]
    law = jc.Polygonal([0.0, 0.006, 0.03], [0.0, 9e8, 1.6e9])
    hard = jc.Section.disc(0.012, jc.Elastic(1.6e11), (1, 4))
    elements = {
        "ropes": jc.Cables([[0, 4], [4, 5], [5, 1]], area=[2e-4, 2.1e-4, 2e-4], law=law,
                           weight=16.0, expansion=1.2e-5, strength=2.5e5),
        "ties": jc.Cables([[2, 4], [3, 4]], section=hard, weight=30.0),
        "bars": jc.Bars([[2, 5], [3, 5]], axial_stiffness=2e7, compliance=1e-9),
    }  # fmt: skip
    structure = jc.Structure(nodes, elements, jc.pinned([0, 1, 2, 3]))
    faces = jc.AreaLoads([[4, 5, 1], [4, 5, 3]], (0.0, 0.0, -750.0))
    loads = [jc.NodalLoads([4, 5], (100.0, 0.0, -900.0)), faces, jc.LineLoads((0.0, 30.0, 0.0))]
    first = jc.Phase(
        pretension={"ropes": jc.only([0, 2], 2e4), "ties": 1.5e4}, loads=jc.SelfWeight()
    )
    return structure, [first, jc.Phase(loads=loads, temperature={"ropes": -25.0}, increments=2)]


def frame():
    """Beams with springs at their ends, moments, heat and a support that moves."""
    nodes = [[0.0, 0, 0], [0, 0, 4], [5, 0, 4], [5, 0, 0]]
    tube = jc.Section([0.0], [0.0], [0.0052], [jc.Elastic(2.1e11)], torsion=[3e-5],
                      own=[[2.2e-5, 1.8e-5, 0.0]])  # fmt: skip
    frame = jc.Beams([[0, 1], [1, 2], [2, 3]], section=tube, up=(0.0, 1.0, 0.0), weight=400.0,
                     expansion=1.2e-5, strength=1.2e6, hinges=[[False, False], [True, False],
                     [False, False]], springs=4e6)  # fmt: skip
    structure = jc.Structure(nodes, frame, jc.clamped([0, 3]))
    push = jc.NodalLoads([1], (3e4, 2e3, 0.0), moments=(0.0, 2e4, 0.0))
    moved = jc.SupportMovement([3], (0.0, 0.0, -0.01), rotations=(0.0, 0.002, 0.0))
    loads = [push, moved, jc.LineLoads((0.0, 0.0, -5e3), per="initial"), jc.SelfWeight()]
    return structure, [jc.Phase(loads=loads, temperature=15.0, increments=2)]


def hung():
    """Two catenaries, one with a given sag."""
    nodes = [[0.0, 0, 0], [80, 0, 10], [170, 5, 0]]
    cables = jc.Catenaries([[0, 1], [1, 2]], axial_stiffness=[9e7, 8e7], weight=[60.0, 55.0],
                           strength=8e5, expansion=1.2e-5)  # fmt: skip
    structure = jc.Structure(nodes, cables, jc.pinned([0, 2]) + jc.restrained([1], "z"))
    begin = jc.Phase(sag=[1.6, 2.1], loads=jc.SelfWeight())
    return structure, [begin, jc.Phase(loads=jc.NodalLoads([1], (500.0, 0, 0)), temperature=20.0)]


SCENES = {"net": net, "frame": frame, "hung": hung}
FILES = {**SCENES, "blown": blown}


@functools.cache
def solved(name):
    """A scene and its solution in SI."""
    structure, phases = FILES[name]()
    return structure, phases, converged(jc.solve(structure, phases))


def results(solution):
    """Positions, forces and reactions, each with the size to compare it with."""
    parts = [solution.positions, solution.displacement, solution.reactions, solution.rotation]
    parts += jax.tree.leaves((solution.tension, solution.section_forces, solution.rest_length))
    return [np.asarray(part) for part in parts if part is not None]


@pytest.mark.quick_cases("net-kip, ft, F", "frame-N, mm", "hung-kN, m", "blown-kgf, cm")
@pytest.mark.parametrize("system", SYSTEMS)
@pytest.mark.parametrize("name", FILES)
def test_a_scene_in_other_units_is_the_same_scene(name, system, tmp_path):
    structure, phases = FILES[name]()
    path = tmp_path / "scene.json"
    jc.save_scene(path, (structure, phases))
    data = json.loads(path.read_text("utf-8"))
    words = [*system.split(", "), "K"][:3]
    factors = [PUBLISHED[word] for word in words]
    system += ", kg"  # masses are not converted by the table above
    path.write_text(json.dumps({**in_units(data, factors), "units": system}), "utf-8")
    read = jc.load_scene(path)
    assert read.units == as_units(system) and len(read) == 2
    for a, b in zip(
        jax.tree.leaves((structure, phases)), jax.tree.leaves(tuple(read)), strict=True
    ):
        np.testing.assert_allclose(b, a, rtol=1e-12)  # three roundings, each of 2e-16
    if name == "net":  # the same numbers are the same analysis
        solution = converged(jc.solve(*read))
        for a, b in zip(results(solved(name)[2]), results(solution), strict=True):
            np.testing.assert_allclose(b, a, atol=1e-10 * max(np.abs(a).max(), 1e-6))
    # written again, it is in its units; and numbers come back
    jc.save_scene(path, read)
    again = jc.load_scene(path)
    assert json.loads(path.read_text("utf-8"))["units"]["force"] == words[0]
    for a, b in zip(jax.tree.leaves(tuple(read)), jax.tree.leaves(tuple(again)), strict=True):
        np.testing.assert_allclose(b, a, rtol=5e-16)  # two roundings


def test_whole_numbers_of_powers_of_ten_are_exact(tmp_path):
    """1500 mm are 1.5 m to the last digit, and 12.3 kN come back as they were written."""
    assert Units("kN", "mm").to_si(1500.0, "m") == 1.5
    assert [SI.text(1.5, "N m"), str(Units("kN", "m").from_si(12300.0, "N"))] == ["1.5 N m", "12.3"]
    scene = jc.scenes.flat_net()
    jc.save_scene(tmp_path / "net.json", scene, units="kN, m")
    text = (tmp_path / "net.json").read_text("utf-8")
    assert '"pretension": 0.2\n' in text and '"force": "kN"' in text


@pytest.mark.parametrize(("units", "mass"), [("kN, m", "kg"), ("kip, ft, F", "lb")])
def test_the_density_of_air_is_written_with_its_unit(units, mass, tmp_path):
    """Two roundings: 4e-16."""
    wind = jc.WindLoads((1.0, 0, 0), jc.WindTable(velocities=30.0), 1.2, 0.02)
    scene = jc.scenes.flat_net().structure, [jc.Phase(pretension=200.0, loads=wind)]
    jc.save_scene(tmp_path / "net.json", scene, units=units)
    read = jc.load_scene(tmp_path / "net.json")
    assert read.units.mass == mass
    assert read.phases[0].loads.profile.density == pytest.approx(1.25, rel=4e-16)


def test_a_scene_without_units_is_written_as_before(tmp_path):
    scene = jc.scenes.flat_net()
    jc.save_scene(tmp_path / "net.json", scene)
    data = json.loads((tmp_path / "net.json").read_text("utf-8"))
    assert list(data) == ["format", "version", "structure", "phases"]
    assert jc.load_scene(tmp_path / "net.json").units is None and scene.units is None
    other = scene.with_units("kN, m")._replace(phases=scene.phases[:1])
    assert other.units == as_units("kN, m") and len(other.phases) == 1
    assert scene._replace(phases=[]).units is None


# --- dimensions


def test_every_number_of_every_class_has_a_unit():
    """Also those that are added to the package later: the docstring has to state it."""
    missing, seen = [], set()
    for name, cls in codec.TYPES.items():
        if cls.__module__.partition(".")[0] != "jaxcable":  # of another test
            continue
        units = field_units(cls, codec.TYPES)
        for field in codec.user_fields(cls):
            if not may_have_unit(cls, field.name, str(field.type)):
                continue
            if field.name not in units:
                missing.append(f"{name}.{field.name}")
                continue
            unit, powers = units[field.name], powers_of(name, field.name)
            if unit == OF_PHASE_INPUT:
                assert (name, field.name) in (("Only", "values"), ("Phase", "own"))
            elif powers is not None:
                base = (1000.0, 0.3048, 1 / 1.8)
                factor = float(Units("kN", "ft", "F", "kg").factor(unit))
                expected = np.prod([b**p for b, p in zip(base, powers, strict=True)])
                assert factor == pytest.approx(expected, rel=1e-14), (name, field.name)
                seen.add(field.name)
            elif field.name in PLAIN:
                assert Units("kip", "ft", "F").factor(unit) == 1, (name, field.name)
                seen.add(field.name)
    assert missing == [] and len(seen) > 35
    for name, phase_input in PHASE_INPUTS.items():  # stated twice: here, and by the docstring
        assert field_units(jc.Phase, codec.TYPES)[name] == phase_input.unit


@pytest.mark.parametrize(
    ("text", "unit"),
    [
        ("breaking force, scalar or [n_elem], N; for utilization", "N"),
        ("stiffness, N m/rad; default none", "N m/rad"),
        ("density, kg/m3.", "kg/m3"),
        ("factor, without unit; default 1", "-"),
        ("wind speed at 10 m, m/s (mean of ten minutes)", "m/s"),
        ("one fibre with E, A, I, J is enough", None),
        ("[3] or [n, 3], m, along freedoms", "m"),
        ("number of points, at most 5 m apart", None),
        ("a value, in the unit of what is stated;", OF_PHASE_INPUT),
    ],
)
def test_a_unit_ends_its_clause(text, unit):
    assert unit_in_description(text) == unit


def test_factors_are_the_published_ones():
    for name, value in PUBLISHED.items():
        (kind,) = [kind for kind, names in SYMBOLS.items() if name in names]
        assert float(SYMBOLS[kind][name]) == pytest.approx(value, rel=1e-15)


def test_factors_are_those_of_another_library():
    pint = pytest.importorskip("pint")
    registry = pint.UnitRegistry()
    names = {"kip": "kip", "tf": "metric_ton * g_0", "kgf": "kilogram_force", "lbf": "force_pound"}
    names |= {"F": "delta_degF", "C": "delta_degC", "in": "inch", "t": "metric_ton", "lb": "pound"}
    bases = {"force": "newton", "length": "meter", "temperature": "kelvin", "mass": "kilogram"}
    for kind, symbols in SYMBOLS.items():
        for name, factor in symbols.items():
            other = (1.0 * registry.parse_expression(names.get(name, name))).to(bases[kind])
            assert float(factor) == pytest.approx(other.magnitude, rel=1e-14), name
    assert Units("kip", "ft").factor("Pa") == pytest.approx(
        registry("kip / ft**2").to("pascal").magnitude, rel=1e-14
    )


# --- what is refused


@pytest.mark.parametrize(
    ("units", "text"),
    [
        ("kn, m", "unknown unit 'kn'; did you mean 'kN'"),
        ("kN, meter", "unknown unit 'meter'"),
        ("KIP, ft", "unknown unit 'KIP'; did you mean 'kip'"),
        ("foot, kip", "unknown unit 'foot'; did you mean 'ft'"),
        ("kN", "no unit of length; give one of force and one of length"),
        ("kN, lbf, m", "kN and lbf are both units of force"),
        ("lb, ft", "lb is a mass: did you mean lbf"),
        ("kN m", "separate units by commas"),
        ({"force": "m", "length": "kN"}, "units.force: 'm' is a unit of length; units of force"),
        ({"force": "kN", "lenght": "m"}, "unknown key 'lenght'; .*did you mean 'length'"),
        ({"force": "kN", "length": 1}, "units.length: expected a text"),
        (5, "expected a text such as"),
    ],
)
def test_wrong_units_are_refused(units, text, tmp_path):
    data = '{"format": "jaxcable scene", "version": 1, "structure": {}, "phases": [], "units": %s}'
    (tmp_path / "net.json").write_text(data % json.dumps(units), "utf-8")
    with pytest.raises(jc.files.FileError, match=text):
        jc.load_scene(tmp_path / "net.json")
    with pytest.raises(ValueError, match=text):
        jc.save_scene(tmp_path / "new.json", jc.scenes.flat_net(), units=units)
    assert not (tmp_path / "new.json").exists()


def test_the_schema_knows_units():
    structure = {"nodes": [[0, 0, 0], [1, 0, 0]], "supports": {"nodes": [0, 1]}, "elements": {
        "type": "Cables", "links": [[0, 1]], "axial_stiffness": 1}}  # fmt: skip
    data = {"format": "jaxcable scene", "version": 1, "structure": structure, "phases": [{}]}
    for units in ("kN, m", None, {"force": "kip", "length": "ft", "temperature": "F"}):
        assert CHECK.is_valid({**data, "units": units})
    for units in (3, {"force": "kN"}, {"force": "m", "length": "kN"}, {"length": "m", "kN": 1}):
        assert not CHECK.is_valid({**data, "units": units})


def test_the_order_does_not_matter():
    assert as_units("m, kN") == as_units(" kN ,m ") == as_units({"length": "m", "force": "kN"})
    assert as_units("F, ft, kip") == Units("kip", "ft", "F") and as_units("°C, m, N").is_si
    assert Units("kip", "ft").name("kg/m2") == "lb/ft2" and Units("N", "mm").name("J") == "N mm"


def test_temperatures_need_a_unit_where_lengths_are_not_metric(tmp_path):
    path = tmp_path / "frame.json"
    with pytest.raises(ValueError, match=r"expansion: depends on the unit of temp.*kip, ft, F"):
        jc.save_scene(path, frame(), units="kip, ft")
    jc.save_scene(path, frame(), units="kip, ft, F")
    data = json.loads(path.read_text("utf-8"))
    assert data["phases"][0]["temperature"] == pytest.approx(27.0, rel=1e-15)
    del data["units"]["temperature"]
    path.write_text(json.dumps(data), "utf-8")
    with pytest.raises(jc.files.FileError, match=r"depends on the unit of temperatures"):
        jc.load_scene(path)


def test_messages_say_that_their_numbers_are_in_si(tmp_path):
    path = tmp_path / "net.json"
    jc.save_scene(path, jc.scenes.flat_net(), units="kN, m")
    text = path.read_text("utf-8").replace('"axial_stiffness": 97.97', '"axial_stiffness": -97.97')
    path.write_text(text, "utf-8")
    with pytest.raises(jc.files.FileError, match=r"-97970.*in SI units, not in kN, m"):
        jc.load_scene(path)
    text = text.replace("-97.97", "97.97")
    for old, new in (('"increments": 10', '"increments": 5000000'), ("[3, 4, 7, 8]", "[3, 4, 99]")):
        assert old in text
        path.write_text(text.replace(old, new), "utf-8")
        with pytest.raises(jc.files.FileError) as error:
            jc.load_scene(path)
        assert "SI units" not in str(error.value), "of a count, or of numbers of nodes"


# --- classes of users


def own_class(doc, phase_input):
    """A class of cables with an input, and a field of its own, whose docstring is `doc`."""

    @pytree(indices=("links",), kw_only=True)
    class Glued(jc.Cables):
        glue: object = None

    Glued.__doc__ = doc
    Glued.phase_inputs = ("pretension", phase_input)
    return Glued


def test_own_classes_state_their_units_in_the_same_way(tmp_path, monkeypatch):
    monkeypatch.setattr(codec, "TYPES", dict(codec.TYPES))
    path = tmp_path / "own.json"
    for doc in ("Glued.\n\nArgs:\n    glue: of it.", "Glued.\n\nArgs:\n    glue: of it, N/m2."):
        cls = codec.TYPES["Glued"] = own_class(doc, PhaseInput("dried", "N/m"))
        cables = {"own": cls([[0, 1]], axial_stiffness=1e6, glue=5e3)}
        structure = jc.Structure([[0.0, 0, 0], [1, 0, 0]], cables, jc.pinned([0, 1]))
        phase = jc.Phase(own={"dried": {"own": 70.0}})
        if "N/m2" not in doc:
            jc.save_scene(path, (structure, phase))  # in SI nothing is asked for
            with pytest.raises(ValueError, match=r"own'\]\.glue: the docstring of Glued does not"):
                jc.save_scene(path, (structure, phase), units="kN, mm")
    jc.save_scene(path, (structure, phase), units="kN, mm")
    data = json.loads(path.read_text("utf-8"))
    own = data["structure"]["elements"]["own"]
    assert own["glue"] == pytest.approx(5e-6, rel=1e-15)
    assert np.ravel(own["axial_stiffness"])[0] == 1e3
    assert data["phases"][0]["own"]["dried"]["own"] == pytest.approx(7e-5, rel=1e-15)


# --- reports, results, pictures


UNIT = r"(?<![\w/])(?:N|m|mm|kN|MPa|Pa|J|kJ|kN m|N m|N/m|m2)(?![\w/'-])"
"""Units of SI in texts."""


@pytest.mark.quick_cases("net-lbf, in, F", "frame-kip, ft, F")
@pytest.mark.parametrize("system", [*SYSTEMS, "lbf, in, F"])
@pytest.mark.parametrize("name", SCENES)
def test_reports_have_the_stated_units(name, system):
    structure, phases, solution = solved(name)
    plain = jc.report(structure, solution, phases, energy=True)
    found = jc.report(structure, solution, phases, energy=True, units=system)
    force, length = (PUBLISHED[word] for word in system.split(", ")[:2])
    factors = {"N": force, "m": length, "N m": force * length, "J": force * length, "m2": length**2}
    factors |= {"Pa": force / length**2, "N/m": force / length}
    assert found.tables.keys() == plain.tables.keys() and len(plain.tables) > 6
    compared = 0
    for key, table in plain.tables.items():
        other = found.tables[key]
        for k, unit in enumerate(table.units):
            assert (other.units[k] == unit) == (
                unit in ("", "-", "%", "deg") or unit in system.split(", ")
            )
            own = table.columns.index("unit") if "unit" in table.columns else None
            for row, new in zip(table.rows, other.rows, strict=True):
                if isinstance(row[k], float):
                    expected = row[k] / factors.get(row[own] if own else unit, 1.0)
                    assert new[k] == pytest.approx(expected, rel=1e-14, abs=0.0), (key, unit)
                    compared += 1
    assert compared > 40
    if system in ("kip, ft, F", "lbf, in, F"):
        said = found.text() + json.dumps([found.summary, *(t.notes for t in found.tables.values())])
        said = re.sub(r"[\w.-]* [NTyz], |N > 0|table N|\bN,", "", said)  # the axial force is N, too
        assert re.findall(UNIT, said) == []
        assert f"({as_units(system).force})" in said and "(in)" in said
    header = found.csv()["members"].splitlines()[0]
    assert f"force ({as_units(system).force})" in header
    assert found.dict()["units"]["length"] == as_units(system).length


def test_texts_of_reports_have_the_usual_small_units():
    structure, phases, solution = solved("net")
    for system, small, stress in (
        *(("kN, m", "mm", "MPa"), ("kip, ft", "in", "kip/in2"), ("kgf, m", "mm", "kgf/cm2")),
        ("lbf, in", "in", "lbf/in2"),
    ):
        text = jc.report(structure, solution, phases, units=system).text()
        lines = text.splitlines()
        assert f"Displacements from the start, by phase ({small})" in lines
        k = lines.index("Stresses in the final state, tension positive")
        assert f"({stress})" in "".join(lines[k : k + 4])
    # 1 MPa is 1e6/6894.757293168 lbf/in2 (NIST SP 811)
    table = jc.report(structure, solution, phases).tables["stresses"]
    mega = max(row[table.columns.index("highest")] for row in table.rows) / 6894.757293168
    assert f"{mega:.3f}" in text


def test_csv_and_vtk_results_have_the_stated_units(tmp_path):
    structure, _, solution = solved("net")
    paths = jc.files.save_result(tmp_path / "r.csv", structure, solution, units="kip, ft")
    text = paths[1].read_text("utf-8").splitlines()
    length = "unstressed length at present temperature (ft)"
    assert text[0].startswith(f"group,element,first,last,tension (kip),{length}")
    value = float(next(line for line in text if line.startswith("ropes,0,")).split(",")[4])
    assert value == pytest.approx(float(solution.tension["ropes"][0]) / 4448.2216152605, rel=1e-14)
    assert "(N)" not in "".join(p.read_text("utf-8") for p in paths)
    (path,) = jc.files.save_vtk(tmp_path / "r.vtk", structure, solution, units="kip, ft")
    mesh = meshio.read(path)
    np.testing.assert_allclose(mesh.points * 0.3048, solution.positions, rtol=1e-14)
    moved = mesh.point_data["displacement_(ft)"] * 0.3048
    np.testing.assert_allclose(moved, solution.displacement, rtol=1e-14)
    assert "tension_(kip)" in mesh.cell_data and "jaxcable, kip, ft;" in path.read_text("utf-8")
    with pytest.raises(ValueError, match=r"units: results in .npz files are in SI units"):
        jc.files.save_result(tmp_path / "r.npz", structure, solution, units="kip, ft")


def words_of(figure):
    return [text.get_text() for text in figure.findobj(matplotlib.text.Text) if text.get_text()]


@pytest.mark.slow_cases("N, mm", "kN, m", "kgf, cm", "kip, ft, F")
@pytest.mark.parametrize("system", [*SYSTEMS, "lbf, in"])
def test_pictures_have_the_stated_units(system):
    structure, _, solution = solved("frame")
    force, length = system.split(", ")[:2]
    plain = jc.plots.net(solution, structure=structure, reactions=True)
    figure = jc.plots.net(solution, structure=structure, reactions=True, units=system)
    words = words_of(figure)
    assert {f"x ({length})", f"z ({length})"} <= set(words)
    assert f"axial force ({force}), tension positive" in words
    (largest,) = [word for word in words if word.startswith("largest load")]
    size = float(np.linalg.norm(np.asarray(solution.last.load), axis=1).max())
    assert largest == f"largest load {size / PUBLISHED[force]:.3g} {force}"
    for old, new in zip(plain.axes[:1], figure.axes[:1], strict=True):
        ratio = np.ptp(old.get_xlim()) / np.ptp(new.get_xlim())
        assert ratio == pytest.approx(PUBLISHED[length], rel=1e-9)  # the same picture, in units
    diagram = jc.plots.diagram(solution, "My", structure=structure, units=system)
    assert diagram.axes[0].get_title() == f"My ({force} {length}), at the end"
    moments = np.asarray(solution.section_forces)[..., 4]
    largest = max(abs(float(text.get_text())) for text in diagram.axes[0].texts)
    size = np.abs(moments).max() / PUBLISHED[force] / PUBLISHED[length]
    assert largest == pytest.approx(size, rel=0.02)  # four digits, at places along the beams
    rows = jc.plots.sequence(solution, structure=structure, units=system, diagram="Vz")
    assert {f"Vz positive ({force})", f"Vz negative ({force})"} <= set(words_of(rows))
    page = jc.plots.view(solution, None, structure=structure, units=system).html
    assert f'"N m": [{1 / (PUBLISHED[force] * PUBLISHED[length]):.6g}'[:12] in page
    assert f'"{force} {length}"' in page


def test_pictures_of_sections_have_the_stated_units():
    disc = jc.Section.disc(0.05, jc.Elastic(210e9), (2, 8))
    figure = jc.plots.section(disc, disc.fibre_stress(1e-4, 0.0, 0.0), units="kip, ft")
    assert figure.axes[0].get_xlabel() == "y (in)"
    assert figure.axes[1].get_ylabel() == "stress (kip/in2), tension positive"
    assert figure.axes[0].collections[0].get_array()[0] == pytest.approx(21e6 / 6894757.293168)
    plain = jc.plots.section(disc).axes[0]
    assert plain.get_xlabel() == "y (mm)"
    ratio = np.array(plain.get_xlim()) / np.array(figure.axes[0].get_xlim())
    np.testing.assert_allclose(ratio, 25.4, rtol=1e-12)


# --- nets of other programs


NODES = "node,x,y,z,support,fz\na,0,0,0,1,\nb,{0},0,0,,-{1}\nc,{2},0,0,1,\n"
LINKS = "first,last,axial_stiffness,weight,pretension\na,b,{3},{4},{5}\nb,c,{3},{4},{5}\n"


@pytest.mark.parametrize("system", SYSTEMS)
def test_csv_tables_in_units(system, tmp_path):
    force, length = (PUBLISHED[word] for word in system.split(", ")[:2])
    sizes = 2.0, 300.0, 5.0, 1e6, 12.0, 5e3
    units = length, force, length, force, force / length, force
    values = [size / unit for size, unit in zip(sizes, units, strict=True)]
    n, m = tmp_path / "n.csv", tmp_path / "l.csv"
    n.write_text(NODES.format(*map(repr, values)).replace("-{1}", "-"), "utf-8")
    m.write_text(LINKS.format(*map(repr, values)), "utf-8")
    net = jc.files.read_csv(n, m, units=system)
    np.testing.assert_allclose(net.nodes[1:, 0], [2.0, 5.0], rtol=1e-15)
    assert net.loads[1, 2] == pytest.approx(-300.0, rel=1e-15)
    for name, value in (("axial_stiffness", 1e6), ("weight", 12.0), ("pretension", 5e3)):
        np.testing.assert_allclose(net.values[name], value, rtol=1e-15)


def test_a_network_in_units(tmp_path):
    """Loads on edges become loads of nodes, in the units of the file."""
    nodes = {"0": {"x": 0, "y": 0, "is_support": True}, "1": {"x": 10, "y": 0, "pz": -2.0}}
    edges = {"0": {"1": {"q": 3.0, "pz": -0.5}}}
    data = {"dtype": "compas.datastructures/Graph", "data": {"node": nodes, "edge": edges}}
    (tmp_path / "n.json").write_text(json.dumps(data), "utf-8")
    net = jc.files.read_network(tmp_path / "n.json", units="kip, ft")
    assert net.nodes[1, 0] == pytest.approx(3.048, rel=1e-15)
    assert net.loads[1, 2] == pytest.approx(-4.5 * 4448.2216152605, rel=1e-15)  # 2 + 0.5 * 10 / 2
    assert net.values["force_density"][0] == pytest.approx(3 * 4448.2216152605 / 0.3048, rel=1e-15)


def test_drawings_in_units(tmp_path):
    path = tmp_path / "n.obj"
    path.write_text("v 0 0 0\nv 1000 0 0\nv 2000 0 500\nl 1 2 3\n", "utf-8")
    nodes = jc.files.read_obj(path, units="kN, mm").nodes
    np.testing.assert_array_equal(nodes, [[0, 0, 0], [1, 0, 0], [2, 0, 0.5]])
    with pytest.raises(ValueError, match="scale, units: both are given"):
        jc.files.read_obj(path, 1e-3, units="kN, mm")
    with pytest.warns(
        jc.InputWarning, match=r'km if its.*give it, such as units="N, mm" \(--units'
    ):
        jc.files.read_obj(path)
    jc.files.read_obj(path, 1.0)  # who says that it is in m means it


def test_dxf_in_units(tmp_path):
    pytest.importorskip("ezdxf")
    structure, _ = jc.scenes.flat_net()
    jc.files.save_dxf(tmp_path / "net.dxf", structure, units="kip, ft")
    with pytest.raises(jc.files.FileError, match=r"says that its unit is 0.3048 m, and units"):
        jc.files.read_dxf(tmp_path / "net.dxf", units="N, mm")
    text = (tmp_path / "net.dxf").read_text("utf-8")
    text = re.sub(r"(\$INSUNITS\s+70\s+)2", r"\g<1>0", text)
    (tmp_path / "bare.dxf").write_text(text, "utf-8")
    with pytest.raises(jc.files.FileError, match=r'or units="N, mm" \(--units "N, mm"\)'):
        jc.files.read_dxf(tmp_path / "bare.dxf")
    for name, units in (("net", None), ("bare", "kip, ft")):  # the header of the first says feet
        extent = np.ptp(jc.files.read_dxf(tmp_path / f"{name}.dxf", units=units).nodes, axis=0)
        np.testing.assert_allclose(extent, np.ptp(structure.nodes, axis=0), rtol=1e-14)
