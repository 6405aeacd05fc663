"""Masts in files and on the command line."""

import json
import types

import jax
import numpy as np
import pytest

import jaxcable as jc
from jaxcable.cli.parser import main
from jaxcable.files import FileError

MAST = {
    "element_length": 8,
    "directions": [0, 90],
    "sections": [
        {"top": 12, "profile": "CHS 168.3x6.3", "comment": "below"},
        {"top": 20, "sides": 3, "width": 0.5, "panel": 0.5, "leg": 0.03, "diagonal": 0.012},
        {"top": 24, "EA": 3e8, "EI": 4e6, "GJ": 2e6, "weight": 200, "drag_area": 0.2},
    ],
    "guys": [
        {"height": 12, "radius": 9, "azimuths": [0, 120, 240], "cable": "Galfan spiral strand 12"},
        {
            **{"height": 22, "radius": [14, 14, 15], "azimuths": [0, 120, 240], "EA": 16e6},
            **{"weight": 8, "diameter": 0.012, "strength": 15e4, "tension": 15e3, "arm": 0.3},
        },
    ],
    "ancillaries": [{"name": "dish", "height": 21, "drag_area": 0.8, "weight": 300, "offset": 0.5}],
    "states": {
        "wind": {"standard": "EN 1993-3-1", "velocity": 22, "terrain": "III", "scaling": 3.0},
        "ice": {"standard": "TIA-222", "velocity": 20, "exposure": "B", "ice": 0.01},
        "own": {"wind": {"type": "WindTable", "pressures": 300.0}, "weight_factor": 1.1},
    },
}


def written(folder, **changed):
    """A file of the mast, with other contents."""
    path = folder / "mast.json"
    path.write_text(json.dumps(MAST | changed))
    return path


def test_a_mast_goes_to_json_and_back(tmp_path):
    job = jc.masts.load_mast(written(tmp_path))
    again = jc.masts.load_mast(jc.masts.save_mast(tmp_path / "again.json", job))
    assert jax.tree.structure(job) == jax.tree.structure(again)
    for one, other in zip(jax.tree.leaves(job), jax.tree.leaves(again), strict=True):
        np.testing.assert_array_equal(one, other)
    assert list(job.directions) == [0, 90] and list(job.states) == ["wind", "ice", "own"]
    assert job.mast.guys[0].tension[0] == 15e3 and job.mast.ancillaries[0].name == "dish"


TABLES = {
    "sections": "top,profile,sides,width,panel,leg,diagonal,EA,EI,GJ,weight,drag_area\n"
    "12,CHS 168.3x6.3,,,,,,,,,,\n20,,3,0.5,0.5,0.03,0.012,,,,,\n"
    "24,,,,,,,3e8,4e6,2e6,200,0.2\n",
    "guys": "height,radius,azimuths,cable,EA,weight,diameter,strength,tension,arm\n"
    "12,9,0 120 240,Galfan spiral strand 12,,,,,,\n"
    "22,14 14 15,0 120 240,,16e6,8,0.012,15e4,15e3,0.3\n",
    "ancillaries": "name,height,drag_area,weight,offset\ndish,21,0.8,300,0.5\n",
    "states": "state,standard,velocity,terrain,scaling,exposure,ice\n"
    "wind,EN 1993-3-1,22,III,3.0,,\nice,TIA-222,20,,,B,0.01\n",
}


def tabulated(folder, **changed):
    """The tables of the mast in a folder, by the arguments of `load_mast`, with other contents."""
    for name, text in (TABLES | changed).items():
        (folder / f"{name}.csv").write_text(text)
    names = ("guys", "ancillaries", "states")
    return {"path": folder / "sections.csv"} | {name: folder / f"{name}.csv" for name in names}


def test_tables_become_the_mast_of_the_json_file(tmp_path):
    states = {name: MAST["states"][name] for name in ("wind", "ice")}
    job = jc.masts.load_mast(written(tmp_path, states=states))
    tables = tabulated(tmp_path)
    beside = written(tmp_path, **{key: f"{key}.csv" for key in TABLES})  # JSON that names them
    for own in (jc.masts.load_mast(beside), jc.masts.load_mast(**tables)):
        mast = jc.replace(own.mast, element_length=8, layout=job.mast.layout)
        assert jax.tree.structure((job.mast, job.states)) == jax.tree.structure((mast, own.states))
        pairs = jax.tree.leaves(job[:2]), jax.tree.leaves((mast, own.states))
        for one, other in zip(*pairs, strict=True):
            np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize(
    ("table", "old", "new", "text"),
    [
        ("states", "ice,TIA", "wind,TIA", "states.csv: line 3: state: expected a name of its own"),
        ("states", "TIA-222", "TIA", "states.csv: line 3: standard = 'TIA': expected one of"),
        ("guys", "120 240,,", "x 240,,", "guys.csv: line 3: azimuths: 'x' is not a number"),
        ("sections", "12,CHS", "x,CHS", "sections.csv: line 2: top: 'x' is not a number"),
    ],
)
def test_wrong_tables_are_refused(tmp_path, table, old, new, text):
    with pytest.raises(FileError) as caught:
        jc.masts.load_mast(**tabulated(tmp_path, **{table: TABLES[table].replace(old, new)}))
    assert text in str(caught.value)


REFUSED = {
    "no list": ({"guys": {}}, "guys: expected a list"),
    "no sections": ({"sections": []}, "sections: none"),
    "unknown key": ({"guy": []}, "'guy': has no meaning here"),
    "missing argument": (
        {"sections": [{"top": 24, "sides": 3}]},
        "sections[0]: missing a required",
    ),
    "unknown argument": ({"ancillaries": [{"heigth": 3}]}, "ancillaries[0]: "),
    "no object": ({"guys": [3]}, "guys[0]: expected an object"),
    "unknown standard": (
        {"states": {"a": {"standard": "EN"}}},
        "states.a: standard = 'EN': expected",
    ),
    "wrong number": (
        {"states": {"a": {"standard": "TIA-222", "velocity": 20, "ice": -1}}},
        "states.a: ice = -2.0: must not be negative",
    ),
    "directions": ({"directions": 0}, "directions = 0: expected a whole number"),
    "heights": ({"guys": [*MAST["guys"][::-1]]}, "guys: heights [22.0, 12.0] m must increase"),
    "above": ({"ancillaries": [{"height": 25}]}, "ancillaries: heights [25.0] m, of 0 to 24 m"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_wrong_contents_are_refused(tmp_path, name):
    changed, text = REFUSED[name]
    path = written(tmp_path, **changed)
    with pytest.raises(FileError) as caught:
        jc.masts.load_mast(path)
    assert str(path) in str(caught.value) and text in str(caught.value)


def mast_of(part, level):
    """A mast of one section and one level of guys."""
    return jc.masts.GuyedMast([part], [level])


CALLS = {
    "base": (lambda part, level: jc.masts.GuyedMast([part], [level], base="fixed"), "base"),
    "sections": (lambda part, level: jc.masts.GuyedMast([level], [part]), "sections[0]: expected"),
    "length": (lambda part, level: jc.masts.GuyedMast([part], [level], element_length=0.0), "must"),
    "guys": (lambda part, level: jc.replace(level, azimuths=[0.0]), "azimuths: expected shape"),
    "radius": (lambda part, level: jc.replace(level, radius=-3.0), "radius"),
    "EA": (lambda part, level: jc.replace(part, EA=0.0), "EA"),
    "profile": (lambda part, level: jc.masts.tube_section(9.0, "IPE 300"), "is not round"),
    "sides": (lambda part, level: jc.masts.lattice_drag(5, 0.2), "sides = 5"),
    "solidity": (lambda part, level: jc.masts.lattice_drag(3, 60.0), "solidity = 60.0: expected 0"),
    "millimeters": (
        lambda part, level: jc.masts.lattice_section(9.0, 3, 0.9, 0.9, leg=60.0, diagonal=20.0),
        "solidity",
    ),
    "leg": (
        lambda part, level: jc.masts.lattice_section(9.0, 3, 0.9, 0.9, leg=-0.06, diagonal=0.02),
        "leg = -0.06: must be positive",
    ),
    "share": (
        lambda part, level: jc.masts.guy_level(
            9.0, 8.0, [0, 120, 240], "Galfan spiral strand 12", 0.1, tension=1e4
        ),
        "share, tension: give one of them",
    ),
    "arms": (
        lambda part, level: jc.masts.GuyLevel(9, 8, [0, 90], 1e6, 9, 1, 1e5, 1e4, 0, None, [1, 2]),
        "arm_azimuths: there is no arm",
    ),
    "guy": (lambda part, level: mast_of(part, level).index_of_guy("1 at 0"), "guy = '1 at 0'"),
    "frequency": (
        lambda part, level: jc.masts.tension_from_frequency(mast_of(part, level), 3, 2.0),
        "there are guys 0 to 2",
    ),
    "fast": (
        lambda part, level: jc.masts.tension_from_frequency(mast_of(part, level), 0, 3.1e6),
        "frequency = 3100000.0 Hz: of a tension of 1.444e+16 N, above the strength of guy 0",
    ),
    "measured": (
        lambda part, level: jc.masts.retension(mast_of(part, level), [1e4, -1e4, 1e4]),
        "measured",
    ),
    "wind": (lambda part, level: jc.masts.MastState(500.0), "wind: expected a wind profile"),
    "exposure": (lambda part, level: jc.masts.tia_state(30.0, "A"), "exposure"),
}


@pytest.mark.parametrize("name", CALLS)
def test_wrong_numbers_are_refused(name):
    call, text = CALLS[name]
    part = jc.masts.tube_section(20.0, "CHS 168.3x6.3")
    level = jc.masts.guy_level(19.0, 12.0, [0, 120, 240], "Galfan spiral strand 12")
    with pytest.raises(ValueError) as caught:
        call(part, level)
    assert text in str(caught.value)


def test_thick_ice_is_warned_of():
    with pytest.warns(jc.InputWarning, match=r"ice = 20: more than 0\.3 m; it is in meters"):
        jc.masts.tia_state(30.0, ice=10.0)


@pytest.mark.parametrize(("status", "holds", "code"), [(0, True, 0), (1, True, 1), (0, False, 3)])
def test_exit_status_tells_failed_analyses_and_masts_that_do_not_hold(
    tmp_path, monkeypatch, capsys, status, holds, code
):
    def report():
        return jc.reporting.Report(status, ("a sentence",), {})

    study = types.SimpleNamespace(status=status, holds=holds, report=report)
    monkeypatch.setattr("jaxcable.masts.study_mast", lambda job: study)
    tables = {key: str(path) for key, path in tabulated(tmp_path).items()}
    words = ["mast", tables.pop("path")]
    for key, path in tables.items():
        words += [f"--{key}", path]
    assert main(words) == code
    out, err = capsys.readouterr()
    assert "a sentence" in out and ("the mast does not hold" in err) == (code == 3)


@pytest.mark.slow
def test_command_reports_a_mast(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    written(tmp_path)
    words = "mast mast.json --report mast.html --report mast.json.txt --plot mast.png"
    assert main(words.split()) == 0
    told = capsys.readouterr().out
    assert "status 0: converged" in told and "wrote mast.png" in told
    page = (tmp_path / "mast.html").read_text()
    for title in ("Tensions of guys", "Envelope of the mast", "Forces on foundations"):
        assert title in page
    assert main(["mast", "mast.json", "--quiet"]) == 0
    assert capsys.readouterr() == ("", "")
    assert main(["mast", "mast.json", "--save", "mast.json"]) == 2
    assert "mast.json" in capsys.readouterr().err
    written(tmp_path, states={})
    assert main(["mast", "mast.json"]) == 2
    assert "states: none" in capsys.readouterr().err
