"""Lines in files, on the command line, in drawings and pictures; conductors of the catalogue."""

import collections
import json

import ezdxf
import numpy as np
import pytest

import jaxcable as jc
from jaxcable.cli.parser import main
from jaxcable.files import FileError

TOWERS = """\
tower,kind,station_m,ground_m,height_m,offset_m,string_length_m,string_weight_N
A,strain,0,100,22,0,2.5,1500
B,suspension,280,104,26,3,2.5,900
C,strain,600,98,22,0,2.5,1500
"""
STATES = """\
state,temperature_C,ice_mm,wind_Pa,condition,role
everyday,15,,,,creeps
heavy,-5,20 15,,,stretches
hot,75,,,final,
"""
GROUND = "station_m,elevation_m\n-10,100\n150,103\n280,104\n450,99\n610,98\n"
CROSSINGS = "crossing,station_m,offset_m,elevation_m\nroad,440,-30,99.5\nroad,460,30,99.5\n"


@pytest.fixture
def folder(tmp_path):
    """A folder with the tables of a line."""
    for name, text in (
        ("towers", TOWERS),
        ("states", STATES),
        ("ground", GROUND),
        ("crossings", CROSSINGS),
    ):
        (tmp_path / f"{name}.csv").write_text(text)
    return tmp_path


def load(folder, **changed):
    """The line of a folder."""
    tables = {name: folder / f"{name}.csv" for name in ("states", "ground", "crossings")}
    given = {"conductor_name": "Drake", "stringing": {"parameter": 1400.0, "temperature": 10.0}}
    return jc.lines.load_line(folder / "towers.csv", **tables | given | changed)


def test_tables_become_a_line(folder):
    line = load(folder)
    section = line.section
    assert section.names == ("A", "B", "C") and section.kinds[1] == "suspension"
    np.testing.assert_array_equal(section.offset, [0.0, 3.0, 0.0])
    np.testing.assert_array_equal(section.angle, np.zeros(3))
    np.testing.assert_array_equal(section.profile[1], [150.0, 103.0])
    np.testing.assert_array_equal(section.crossings["road"][1], [460.0, 30.0, 99.5])
    assert (line.loads, line.creep) == (("heavy",), "everyday")
    np.testing.assert_allclose(line.states["heavy"].ice, [0.02, 0.015])
    assert line.states["hot"].condition == "final"


def test_a_line_goes_to_json_and_back(folder):
    line = load(folder)
    path = jc.lines.save_line(folder / "line.json", line)
    text = path.read_text()
    assert '"temperature_C"' in text and '"string_weight_N"' in text and '_c"' not in text
    again = jc.lines.load_line(path)
    for one, other in zip(
        (line.section, *line.states.values()), (again.section, *again.states.values()), strict=True
    ):
        for name in type(one)._all_fields:
            if name not in ("conductor", "crossings"):
                np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    assert line.stringing == again.stringing and line.loads == again.loads
    assert (line.creep, line.temperatures) == (again.creep, again.temperatures)


@pytest.mark.parametrize(
    ("table", "old", "new", "text"),
    [
        ("towers", "suspension", "hanging", "line 3: kind"),
        ("towers", "280", "x", "line 3: station_m"),
        ("states", "20 15", "20 y", "line 3: ice_mm"),
        ("states", "20 15", "20 15 10", "states.csv: line 3: ice_mm: 3 numbers, for 2 spans"),
        ("states", "stretches", "pulls", "line 3: role 'pulls': expected stretches, creeps"),
        ("states", "stretches", "creeps", "line 3: role: state 'everyday' creeps already"),
        ("states", "20 15", "-20", "states.csv: line 3: ice = -0.02"),
        ("states", "hot", "heavy", "line 4: state 'heavy' occurs twice"),
        ("states", "final", "last", "line 4: condition"),
        (
            "ground",
            "elevation_m",
            "z",
            r"^[^:]*ground.csv: line 1: column .elevation_m. is",
        ),
        ("crossings", "road,460", "rail,460", r"crossings.csv: crossing 'road': has one point"),
        ("ground", "280", "150", r"ground.csv: line 4: station_m = 150: must be more"),
    ],
)
@pytest.mark.filterwarnings("ignore::jaxcable.InputWarning")  # of the column that is left out
def test_wrong_tables_are_refused(folder, table, old, new, text):
    path = folder / f"{table}.csv"
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(FileError, match=text):
        load(folder)


def test_a_state_may_stretch_and_creep(folder):
    path = folder / "states.csv"
    path.write_text(path.read_text().replace("creeps", "stretches creeps"))
    line = load(folder)
    assert (line.loads, line.creep) == (("everyday", "heavy"), "everyday")
    again = jc.lines.load_line(jc.lines.save_line(folder / "line.json", line))
    assert (again.loads, again.creep) == (line.loads, line.creep)


def test_a_changed_conductor_is_not_saved(folder):
    line = load(folder)
    drake = line.section.conductor
    layer = jc.replace(drake.layers[0], modulus=5e10)
    elastic = jc.catalogue.Conductor((layer,), 5e-4, 0.03, 16.0, 1e5, name="Drake")
    for changed in (jc.replace(drake, weight=20.0), elastic, jc.replace(elastic, name="mine")):
        other = line._replace(section=jc.replace(line.section, conductor=changed))
        with pytest.raises(ValueError, match="is not that of the catalogue"):
            jc.lines.save_line(folder / "line.json", other)
    assert not (folder / "line.json").exists()


@pytest.mark.parametrize("span", ["2.5", "0", "3"])
def test_broken_spans_are_whole_numbers_from_one(folder, span):
    path = folder / "states.csv"
    rows = path.read_text().replace("role", "role,broken_span").splitlines()
    path.write_text("\n".join([rows[0], *(row + "," for row in rows[1:-1]), rows[-1] + "," + span]))
    with pytest.raises(FileError, match=rf"line 4: broken_span = {span}: expected .* from 1 to 2"):
        load(folder)
    path.write_text(path.read_text()[: -len(span)] + "2")
    assert load(folder).states["hot"].broken == 1


def test_a_line_needs_a_conductor_and_a_stringing(folder):
    with pytest.raises(FileError, match="conductor"):
        load(folder, conductor_name=None)
    with pytest.raises(FileError, match="stringing"):
        load(folder, stringing=None)
    with pytest.raises(ValueError, match=r"stringing.*tension"):
        load(folder, stringing={"tension": 2e4})


@pytest.mark.slow
def test_command_writes_report_drawing_and_picture(folder, capsys, monkeypatch):
    monkeypatch.chdir(folder)
    words = "line towers.csv --states states.csv --ground ground.csv --crossings crossings.csv"
    words += " --conductor Drake --parameter 1400 --at 10 --report line.pdf --report line.json"
    assert main([*words.split(), "--save", "line.dxf", "--plot", "line.png"]) == 0
    said = capsys.readouterr().out
    assert "status 0: converged" in said and "least distance from road" in said
    assert "Tensions, sags, clearances" in said and "Loads on towers" not in said
    tables = json.loads((folder / "line.json").read_text())["tables"]
    names = "towers states spans stringing swings tower_loads ruling_span"
    assert list(tables) == names.split()
    assert len(tables["tower_loads"]["rows"]) == 9 and len(tables["spans"]["rows"]) == 6
    drawing = ezdxf.readfile(folder / "line.dxf").modelspace()
    kinds = collections.Counter((one.dxf.layer, one.dxftype()) for one in drawing)
    spans = dict.fromkeys(((name, "POLYLINE") for name in ("everyday", "heavy", "hot")), 2)
    others = {("ground", "POLYLINE"): 1, ("towers", "LINE"): 3, ("strings", "LINE"): 3}
    assert kinds == others | spans
    assert (folder / "line.pdf").stat().st_size > 10_000
    assert (folder / "line.png").stat().st_size > 10_000
    assert main([*words.split()[:-4], "--quiet"]) == 0
    assert capsys.readouterr() == ("", "")
    assert main(["line", "towers.csv", "--conductor", "Drake", "--sag", "5"]) == 2
    assert "no states" in capsys.readouterr().err


def test_conductors_have_plausible_curves():
    """Slopes of first loading below the final modulus, creep below first loading."""
    drake = jc.catalogue.conductor("ACSR Drake")
    assert len(drake.layers) == 2
    assert abs(drake.final_modulus / 69.6e9 - 1) < 1e-3  # that of the table of cables
    for layer in drake.layers:
        strains = np.linspace(1e-3, 4e-3, 7)
        first = sum(c * strains**k for k, c in enumerate(layer.initial))
        creep = sum(c * strains**k for k, c in enumerate(layer.creep))
        slopes = np.diff(first) / np.diff(strains)
        assert (slopes < 1.05 * layer.modulus).all() and (slopes > 0).all()
        assert (creep < 1.1 * first).all()
    elastic = jc.catalogue.conductor("Hawk")
    assert elastic.final_modulus == jc.catalogue.cable("Hawk").modulus
    with pytest.raises(ValueError, match="not a conductor"):
        jc.catalogue.conductor("Galfan spiral strand 20")
    with pytest.raises(ValueError, match="initial"):
        jc.catalogue.Layer([1.0], 1.0, 1e-5)
    with pytest.raises(ValueError, match="layers"):
        jc.catalogue.Conductor((), 1.0, 1.0, 1.0, 1.0)
