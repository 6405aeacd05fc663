"""The command line: what it prints and writes, exit statuses, one line for what goes wrong."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import jax
import matplotlib
import numpy as np
import pytest

import jaxcable as jc
from jaxcable.cli import main

ROOT = Path(__file__).parents[2]
LAW = jc.Polygonal([0.0, 0.003], [0.0, 300e6])  # of 1 mm2: 100 kN a unit of strain, to 300 N
COMMANDS = ("new", "info", "solve", "plot", "view", "form", "optimize", "convert", "schema", "demo")


def environment(**changes):
    """That of a process beside this one, which compiles as the tests do: quickly, and once."""
    compiling = {"JAX_DISABLE_MOST_OPTIMIZATIONS": "1"}
    if jax.config.jax_compilation_cache_dir is not None:
        compiling["JAX_COMPILATION_CACHE_DIR"] = jax.config.jax_compilation_cache_dir
    return {**os.environ, "PYTHONPATH": str(ROOT), "MPLBACKEND": "Agg", **compiling, **changes}


def process(*arguments, cwd, **changes):
    return subprocess.run(
        [sys.executable, "-m", "jaxcable", *arguments],
        cwd=cwd,
        env=environment(**changes),
        capture_output=True,
        text=True,
        check=False,
    )


def one_line(text):
    """What was printed on stderr: one line that names the program."""
    (line,) = text.strip().splitlines()
    assert line.startswith("jaxcable: ")
    return line


@pytest.fixture(autouse=True)
def _nothing_takes_long(monkeypatch):
    """What is printed does not depend on the machine's speed."""
    monkeypatch.setattr(jc.progress.SHOW, "pause", 1e6)


@pytest.fixture
def scene(tmp_path, monkeypatch):
    """A folder with a scene, which is the working directory."""
    monkeypatch.chdir(tmp_path)
    jc.save_scene("net.json", jc.scenes.flat_net(load=15.0))
    return tmp_path


# --- what the commands do


def test_programs_are_kept(scene):
    places = {"JAXCABLE_PROGRAMS": str(scene / "kept"), "JAX_COMPILATION_CACHE_DIR": "unused"}
    for _ in range(2):
        assert process("solve", "net.json", cwd=scene, **places).returncode == 0
        assert len(list((scene / "kept" / "programs").glob("*.program"))) == 1


@pytest.mark.skipif(os.name != "posix", reason="modes of POSIX")
def test_programs_are_not_kept_where_others_can_write(scene, capsys, monkeypatch):
    (scene / "kept").mkdir()
    (scene / "kept").chmod(0o777)
    monkeypatch.setenv("JAXCABLE_PROGRAMS", str(scene / "kept"))
    assert main(["info", "net.json"]) == 0
    said = capsys.readouterr().err
    assert said.startswith("jaxcable: warning: ") and said.count("\n") == 1
    assert "other users can write there" in said and "no programs are kept" in said
    assert main(["info", "net.json", "--quiet"]) == 0
    assert capsys.readouterr().err == "" and not list((scene / "kept").iterdir())


def test_demo_prints_its_table_and_writes_its_picture(tmp_path):
    """Without a display, as on a server."""
    changes = {"DISPLAY": "", "MPLBACKEND": "TkAgg"}
    result = process("demo", cwd=tmp_path, **changes)
    assert result.returncode == 0, result.stderr
    assert "status    0: converged" in result.stdout
    assert "identified from these deflections" in result.stdout
    for node in jc.scenes.hypar.NODE_NAMES:
        assert any(line.startswith(f"  {node:4d}  ") for line in result.stdout.splitlines())
    picture = (tmp_path / "hypar_net.png").read_bytes()
    assert picture.startswith(b"\x89PNG") and len(picture) > 20_000


def test_solve_writes_what_it_is_asked_for(scene, capsys):
    names = ["r.json", "r.npz", "r.csv", "r.vtk", "r.py"]
    saves = [word for name in names for word in ("--save", name)]
    assert main(["solve", "net.json", *saves, "--plot", "net.svg", "--report", "net.txt"]) == 0
    out, err = capsys.readouterr()
    assert err == "" and out.startswith("status 0: converged\n")
    assert "largest displacement in phase 2: 0.0128" in out and "wrote net.svg" in out
    solution = jc.solve(*jc.load_scene("net.json"))
    for name in ("r.json", "r.npz"):
        np.testing.assert_array_equal(jc.files.load_result(name)["tension"], solution.tension)
    assert (scene / "net.svg").read_text().rstrip().endswith("</svg>")
    assert "Global equilibrium" in (scene / "net.txt").read_text()
    assert (scene / "r-elements.csv").exists() and (scene / "r.vtk").exists()
    assert not [path for path in scene.iterdir() if path.name.startswith(".")]


def test_solve_can_be_quiet_or_report_on_the_screen(scene, capsys):
    assert main(["solve", "net.json", "--quiet"]) == 0
    assert capsys.readouterr() == ("", "")
    assert main(["solve", "net.json", "--report", "--corrections", "2"]) == 0
    out = capsys.readouterr().out
    assert out.count("status 0: converged") == 1 and "Cutting list" in out


def test_an_analysis_that_fails_ends_with_status_1_and_its_text(scene, capsys):
    structure, (prestress, _) = jc.scenes.flat_net()
    loose = jc.NodalLoads([3], (0.0, 0.0, -1e30))
    jc.save_scene("bad.json", (structure, [prestress, jc.Phase(loads=loose)]))
    assert main(["solve", "bad.json", "--save", "r.npz", "--save", "r.py", "--plot", "p.png"]) == 1
    out, err = capsys.readouterr()
    assert "FAILED: what follows is the last converged state, phase 1" in out
    lines = [line.removeprefix("jaxcable: ") for line in err.splitlines()]
    assert lines[0].startswith("warning: loads of phases[1]: 1e+30 N on node 3")
    assert lines[1] == "r.py: not written: a failed analysis has no state to compute again"
    assert lines[2] == "p.png: not drawn: the analysis failed"
    assert lines[3].startswith("bad.json: phase 2, increment 1 of 1 (load factor 1)")
    assert np.isfinite(jc.files.load_result("r.npz")["last.tension"]).all()


def test_form_writes_a_scene_in_equilibrium(scene, capsys):
    structure, phases = jc.scenes.saddle(2, 2)
    jc.save_scene("saddle.json", (structure, phases))
    for words in (["--tension", "5000"], ["--force-density", "4000"]):
        assert main(["form", "saddle.json", *words, "--loads", "none", "--save", "form.json"]) == 0
        assert "loads in the form: none\n" in (out := capsys.readouterr().out)
        assert "wrote form.json" in out
        found, (prestress, loading) = jc.load_scene("form.json")
        assert loading.loads is not None and loading.pretension is None
        solution = jc.solve(found, [prestress])
        assert int(solution.status) == 0
        assert np.abs(solution.displacement).max() < 1e-8  # it was in equilibrium already
    np.testing.assert_allclose(solution.tension / found_lengths(found), 4000.0, rtol=1e-8)


def found_lengths(structure):
    ends = structure.nodes[structure.elements.links.array]
    return np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)


def test_form_takes_groups_by_name(scene, capsys):
    structure, phases = jc.scenes.flat_net()
    both = (
        jc.Cables(structure.elements.links[:6], 1e5),
        jc.Cables(structure.elements.links[6:], 1e5),
    )
    grouped = jc.replace(structure, elements=dict(zip("ab", both, strict=True)))
    jc.save_scene("groups.json", (grouped, phases))
    words = ["--force-density", "a=100", "b=300", "--save", "form.json"]
    assert main(["form", "groups.json", *words]) == 0
    assert jc.load_scene("form.json").phases[0].force_density == {"a": 100.0, "b": 300.0}
    capsys.readouterr()
    assert main(["form", "groups.json", "--tension", "a=100", "c=3"]) == 2
    assert one_line(capsys.readouterr().err).endswith("--tension: no group 'c'; there are a, b")
    assert main(["form", "groups.json", "--tension", "much"]) == 2
    assert "expected a number, or group=number: much" in one_line(capsys.readouterr().err)


def test_form_finds_forces_in_masts_and_guys(scene, capsys):
    """A mast of given length between guys: their forces are in balance in an analysis."""
    nodes = [[-4.0, -4, 0], [4, -4, 0], [0, 0, 3], [0, -4, 3], [0, 5, 0], [0, 0, 0]]
    elements = {
        "GUY": jc.Cables([[0, 2], [1, 2]], 1e7),
        "MAST": jc.Bars([[5, 2]], 1e8),
        "NET": jc.Cables([[2, 3], [3, 0], [3, 1], [2, 4]], 1e6),
    }
    structure = jc.Structure(nodes, elements, jc.pinned([0, 1, 4, 5]))
    jc.save_scene("mast.json", (structure, [jc.Phase()]))
    words = ["form", "mast.json", "--force-density", "NET=1000", "--save", "form.json"]
    assert main([*words, "--length", "MAST=3", "GUY=drawn"]) == 0
    out = capsys.readouterr().out
    assert "GUY: tension " in out and "lengths 6.40312 m, 12.8062 m in total" in out
    assert "MAST: tension -" in out and "N, lengths 3 m" in out
    found, (prestress,) = jc.load_scene("form.json")
    solution = jc.solve(found, prestress)
    assert int(solution.status) == 0
    # by hand: node 3 ends at the mean of its neighbours, and the head is pulled by 1000 N/m times
    # (0, 7/3, -5) m; guys take 1/8 of the 7/3 each way, and the mast the rest, along z
    pull = 1000 * (7 / 3) / 8 * np.sqrt(41)
    np.testing.assert_allclose(solution.tension["GUY"], pull, rtol=1e-8)
    np.testing.assert_allclose(solution.tension["MAST"], -1000 * (5 + 7 / 3 / 8 * 6), rtol=1e-8)
    # it is in balance from the start: the residual of form finding, 1e-10, over the stiffness
    assert float(np.abs(solution.displacement).max()) < 1e-9
    tension = jax.tree.map(np.asarray, prestress.pretension)
    assert tension["MAST"][0] < 0 < tension["GUY"].min()
    assert (
        main(["form", "mast.json", "--tension", "NET=3000", "--length", "MAST=3", "GUY=drawn"]) == 0
    )
    capsys.readouterr()
    for more, message in (
        (
            [],
            "q: element 0 of elements['GUY'] has no force density; every element needs one;",
        ),
        (["--length", "MAST=drawn"], "group 'GUY' has neither of --force-density and --length"),
        (["--length", "MAST=drawn", "NET=5", "GUY=drawn"], "group 'NET' has both of --force"),
        (["--length", "POST=drawn"], "--length: no group 'POST'; there are GUY, MAST, NET"),
        (["--length", "POST=3"], "--length: no group 'POST'; there are GUY, MAST, NET"),
        (["--length", "3"], "--length: expected group=drawn, or group=number, m"),
    ):
        assert main([*words, *more]) == 2
        assert message in one_line(capsys.readouterr().err)


def test_optimize_finds_a_pretension_that_can_be_checked(scene, capsys):
    """Without load the tension is the pretension: 321 N."""
    structure, (prestress, _) = jc.scenes.flat_net()
    jc.save_scene("bare.json", (structure, [prestress]))
    assert main(["optimize", "bare.json", "--target", "321", "--save", "tuned.json"]) == 0
    out = capsys.readouterr().out
    assert out.startswith("status 0: converged") and "pretension 321 N" in out
    tuned = jc.load_scene("tuned.json")
    np.testing.assert_allclose(tuned.phases[0].pretension, 321.0, rtol=1e-6)
    assert main(["optimize", "bare.json"]) == 2
    assert "give --target, or --deflection" in one_line(capsys.readouterr().err)
    assert main(["optimize", "bare.json", "--target", "321", "--lowest", "100"]) == 2
    assert "--target has no limits" in one_line(capsys.readouterr().err)
    assert main(["optimize", "bare.json", "--target", "321", "--bounds", "300", "400"]) == 0
    assert one_line(capsys.readouterr().err).endswith(
        "within 300 to 400 N, where the scene does not"
    )
    assert main(["optimize", "bare.json", "--target", "321", "--bounds", "400", "300"]) == 2
    assert "--bounds 400 300: the first is above" in one_line(capsys.readouterr().err)
    jc.save_scene("none.json", (structure, [jc.Phase(rest_length=0.3)]))
    assert main(["optimize", "none.json", "--target", "1"]) == 2
    assert "no phase has a pretension" in one_line(capsys.readouterr().err)


def test_optimize_that_fails_writes_nothing_unasked(scene, capsys):
    """The best design of a search that has not ended is written by --keep, none of a bad start."""
    structure, (prestress, loading) = jc.scenes.flat_net(increments=(1, 1))
    weak = jc.replace(structure.elements, axial_stiffness=None, area=1e-6, law=LAW)
    jc.save_scene("bare.json", (structure, [prestress]))
    jc.save_scene("weak.json", (jc.replace(structure, elements=weak), [prestress, loading]))
    words = ["optimize", "bare.json", "--target", "321", "--steps", "1", "--save", "t.json"]
    assert main(words) == 1
    told = capsys.readouterr()
    assert not Path("t.json").exists() and "wrote" not in told.out
    (best,) = [line for line in told.out.splitlines() if line.startswith("pretension ")]
    first, second = told.err.strip().splitlines()
    assert first == (
        "jaxcable: t.json: not written: the search has not come to its end; --keep writes it"
    )
    assert "maximum number of optimization steps reached" in second
    Path("t.json").write_text("mine")  # nor is what is there replaced
    assert main([*words, "--quiet"]) == 1
    assert capsys.readouterr().out == "" and Path("t.json").read_text() == "mine"
    assert main([*words, "--keep"]) == 1
    told = capsys.readouterr()
    assert "wrote t.json: the scene with this pretension, the best one found" in told.out
    assert best in told.out and "maximum number of optimization steps reached" in one_line(told.err)
    found = np.asarray(jc.load_scene("t.json").phases[0].pretension)
    assert (found > 200.0).all() and not np.allclose(found, 321.0, rtol=1e-6)
    assert main(["optimize", "weak.json", "--target", "100", "--save", "n.json", "--quiet"]) == 1
    first, second = capsys.readouterr().err.strip().splitlines()
    assert first == (
        "jaxcable: n.json: not written: the analysis fails with the pretension of the start"
    )
    assert "phase 2, increment 1 of 1" in second and not Path("n.json").exists()
    with pytest.raises(SystemExit):
        main(["optimize", "bare.json", "--target", "3_21"])
    assert "--target: invalid number value: '3_21'" in capsys.readouterr().err


@pytest.mark.slow
def test_optimize_keeps_its_limits(scene, capsys):
    assert main(["optimize", "net.json", "--deflection", "0.012", "--one", "--save", "t.json"]) == 0
    solution = jc.solve(*jc.load_scene("t.json"))
    largest = float(np.linalg.norm(solution.phases[1].displacement, axis=1).max())
    assert 0.0115 < largest <= 0.012  # of a smooth bound of it, which lies above by up to 4 %
    told = capsys.readouterr().out
    limit = "limit on displacements of the last phase: 0.012 m, reached"
    assert f"{limit} {largest:.6g} m at node" in told and ": met\n" in told
    assert 0 <= float(told.split("KKT residual ")[1].split(",")[0]) <= 1e-6
    words = ["--one", "--bounds", "0", "215", "--deflection", "0.0115", "--lowest", "250"]
    assert main(["optimize", "net.json", *words, "--save", "no.json"]) == 1
    told = capsys.readouterr()
    structure, (prestress, loading) = jc.load_scene("net.json")
    held = jc.solve(structure, [jc.replace(prestress, pretension=215.0), loading])  # its bound
    largest = float(np.linalg.norm(held.phases[1].displacement, axis=1).max())
    excess = f"violated by {100 * (largest / 0.0115 - 1):.2g} %\n"
    assert f"reached {largest:.6g} m at node" in told.out and excess in told.out
    lowest = float(held.tension.min())
    excess = f"reached {lowest:.6g} N: violated by {100 * (1 - lowest / 250):.2g} %"
    assert excess in told.out and not Path("no.json").exists()
    assert "no.json: not written: the limits are violated; --keep writes it" in told.err
    assert "constraints are violated" in told.err


@pytest.mark.slow
def test_the_net_to_begin_with_can_be_optimized(tmp_path, monkeypatch, capsys):
    """It ended STALLED after 20 779 analyses, with the limit met."""
    monkeypatch.chdir(tmp_path)
    assert main(["new", "net", "--quiet"]) == 0
    capsys.readouterr()
    assert main(["optimize", "net.json", "--deflection", "0.02", "--save", "t.json"]) == 0
    told = capsys.readouterr().out
    assert told.startswith("status 0: converged\n") and ": met\n" in told
    assert int(told.split(" analyses")[0].split()[-1]) <= 200
    solution = jc.solve(*jc.load_scene("t.json"))
    largest = float(np.linalg.norm(solution.phases[-1].displacement, axis=1).max())
    assert 0.0195 < largest <= 0.02 * (1 + 1e-9)


def test_info_tells_what_is_in_a_file(scene, capsys):
    assert main(["info", "net.json"]) == 0
    out = capsys.readouterr().out
    assert "scene of 12 nodes, 2 phases, float64" in out and "unknowns: 12" in out
    assert "Cables: 12 elements, lengths 0.4 m, 4.8 m in total" in out
    assert "axial_stiffness 97970" in out and "phase 2: 10 increments" in out
    bend = jc.Section.rectangle(0.1, 0.1, jc.Elastic(1e9))
    mast = jc.Beams([[0, 1]], section=bend, up=(1.0, 0, 0))
    nodes = [[0.0, 0, 0], [0, 0, 2.0], [0, 0, 5.0]]
    arm = jc.Structure(nodes, mast, supports=jc.clamped([0]), rigid=[[1, 2]])
    jc.save_scene("arm.json", (arm, [jc.Phase()]))
    assert main(["info", "arm.json"]) == 0
    assert "unknowns: 6" in capsys.readouterr().out  # the carried node has none of its own
    assert "NodalLoads on 4 nodes, sum (0, 0, -60) N" in out


def test_convert_makes_a_scene_of_a_net(scene, capsys):
    (scene / "net.obj").write_text("v 0 0 0\nv 1000 0 0\nv 2000 0 0\nl 1 2 3\n")
    options = ["--scale", "0.001", "--anchors", "0", "2-2", "--axial-stiffness", "1e5"]
    words = ["convert", "net.obj", *options, "--pretension", "300", "--save", "obj.json"]
    assert main(words) == 0
    structure, phases = jc.load_scene("obj.json")
    assert (
        structure.nodes[:, 0].tolist() == [0, 1, 2] and phases[0].pretension.tolist() == [300] * 2
    )
    (scene / "n.csv").write_text("x,y,z,support\n0,0,0,1\n1,0,0,1\n")
    (scene / "l.csv").write_text("first,last,axial_stiffness\n0,1,1e5\n")
    assert main(["convert", "n.csv", "l.csv", "--save", "csv.json"]) == 0
    capsys.readouterr()
    assert main(["info", "net.obj"]) == 0
    assert "net of 3 nodes, 2 links: 2 cables" in capsys.readouterr().out
    for words, message in (
        (["net.obj"], 'anchors: the file names no supports; give node numbers or "ends"'),
        (
            ["net.obj", "--anchors", "ends"],
            "axial_stiffness: the file has none; give --axial",
        ),
        (["net.obj", "--anchors", "two"], "anchors: 'two' is no node number"),
        (["net.json"], "net.json: is a scene of jaxcable already"),
        (["net.stl"], "net.stl: expected .obj, .dxf, .json, or two .csv"),
        (["n.csv"], "n.csv: expected .obj, .dxf, .json, or two .csv"),
        (["n.csv", "l.csv", "net.obj"], "expected one file, or two CSV tables"),
    ):
        stiff = ["--axial-stiffness", "1"] if "ends" not in words else []
        assert main(["convert", *words, *stiff, "--save", "x.json"]) == 2
        assert message in one_line(capsys.readouterr().err)


@pytest.mark.parametrize("command", [None, *COMMANDS])
def test_help_has_an_example_that_parses(command, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["--help"] if command is None else [command, "--help"])
    assert ended.value.code == 0
    out = capsys.readouterr().out
    (example,) = [line for line in out.splitlines() if line.startswith("example: jaxcable ")]
    from jaxcable.cli.parser import parser

    options = parser().parse_args(example.split()[2:])
    assert options.command == (command or "solve")
    assert "exit status: 0 done, 1 the analysis failed, 2 bad input" in out


# --- what goes wrong


def test_wrong_words_end_with_status_2(scene, capsys):
    for words in ([], ["nonsense"], ["solve"], ["solve", "net.json", "--tol", "-1"]):
        with pytest.raises(SystemExit) as ended:
            main(words)
        assert ended.value.code == 2
    capsys.readouterr()
    jc.save_scene("mast.json", jc.scenes.isolated_cable())
    for words, message in (
        (["solve", "nothing.json"], "nothing.json: No such file or directory"),
        (["solve", "."], ".: Is a directory"),
        (["info", "nothing.json"], "nothing.json: No such file or directory"),
        (["solve", "net.json", "--save", "r.xls"], "--save r.xls: expected a name that ends with"),
        (["solve", "net.json", "--plot", "r.doc"], "--plot r.doc: expected a name that ends with"),
        (["solve", "net.json", "--report", "r.doc"], "--report r.doc: expected a name that ends"),
        (["solve", "net.json", "--save", "no/r.json"], "no/r.json: No such file or directory"),
        (["solve", "net.json", "--save", "net.json/r.json"], "net.json/r.json: Not a directory"),
        (["solve", "mast.json", "--save", "r.py"], "mast.json: structure: elements are Catenaries"),
        (["demo", "--plot", "no/p.png"], "no/p.png: No such file or directory"),
    ):
        assert main(words) == 2
        assert message in one_line(capsys.readouterr().err)


def test_a_wrong_file_names_its_field(scene, capsys):
    text = Path("net.json").read_text()
    Path("bad.json").write_text(text.replace("[8, 11]", "[8, 12]"))
    for command in (["solve"], ["info"], ["form", "--tension", "1"], ["optimize", "--target", "1"]):
        assert main([command[0], "bad.json", *command[1:]]) == 2
        assert "bad.json: structure: elements.links[11]" in one_line(capsys.readouterr().err)
    structure, phases = jc.scenes.flat_net()
    many = [jc.Phase(increments=1_000_000)] * 40
    jc.save_scene("many.json", (structure, [*phases, *many]))
    assert main(["solve", "many.json"]) == 2
    assert "its increments would need 15 GB" in one_line(capsys.readouterr().err)


def test_a_folder_that_cannot_be_written_to(scene, capsys, monkeypatch):
    """Told before the analysis, not after it."""

    def denied(*_, **__):
        raise PermissionError(13, "Permission denied", "x")

    monkeypatch.setattr("jaxcable.common.writing.os.open", denied)
    monkeypatch.setattr("jaxcable.cli.solve.solver.solve", pytest.fail)
    assert main(["solve", "net.json", "--save", "r.json"]) == 2
    assert one_line(capsys.readouterr().err) == "jaxcable: r.json: Permission denied"
    assert main(["demo"]) == 2
    assert one_line(capsys.readouterr().err) == "jaxcable: hypar_net.png: Permission denied"


def test_a_hundred_megabytes_of_nonsense(tmp_path):
    """Neither read to the end nor parsed; also if more is allowed."""
    block = np.random.default_rng(0).bytes(1_000_000)
    with (tmp_path / "junk.json").open("wb") as stream:
        for _ in range(100):
            stream.write(block)
    result = process("solve", "junk.json", cwd=tmp_path)
    assert result.returncode == 2
    assert one_line(result.stderr).startswith("jaxcable: junk.json: larger than 64 MB")
    begin = time.monotonic()
    assert main(["solve", str(tmp_path / "junk.json"), "--largest", "200"]) == 2
    assert time.monotonic() - begin < 5.0  # reading 100 MB once takes a fraction of a second


def test_nonsense_that_begins_like_a_scene(scene, capsys):
    Path("junk.json").write_text('{"format": "jaxcable scene", "version": 1, ' + "[{" * 1_000_000)
    assert main(["solve", "junk.json"]) == 2
    assert "junk.json: line 1, column" in one_line(capsys.readouterr().err)


def test_a_reader_that_goes_away(scene):
    """``jaxcable solve ... | head -1`` ends in silence, and what was to be saved is."""
    words = "solve net.json --report --save r.npz"
    command = f"{sys.executable} -u -m jaxcable {words} | head -c 1"
    done = subprocess.run(
        command, shell=True, capture_output=True, text=True, env=environment(), check=False
    )
    assert done.stdout == "s" and done.stderr in ("", "compiling\n")
    assert jc.files.load_result("r.npz")["status"] == 0


@pytest.mark.parametrize("after", [0.3, 5.0])
def test_ctrl_c_ends_with_one_line(after, tmp_path):
    """While jax still loads, and in the middle of a long analysis."""
    structure, phases = jc.scenes.flat_net()
    long = [jc.Phase(loads=phases[1].loads, increments=200_000)]
    jc.save_scene(tmp_path / "long.json", (structure, [phases[0], *long]))
    words = [sys.executable, "-m", "jaxcable", "solve", "long.json", "--save", "r.json"]
    # jobs in the background of a shell, as these tests may be, have Ctrl-C ignored
    listening = "import os, signal, sys; signal.signal(signal.SIGINT, signal.SIG_DFL); "
    running = subprocess.Popen(
        [sys.executable, "-c", listening + "os.execv(sys.argv[1], sys.argv[1:])", *words],
        cwd=tmp_path,
        env=environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    time.sleep(after)
    assert running.poll() is None  # it had enough to do
    running.send_signal(signal.SIGINT)
    begin = time.monotonic()
    try:
        out, err = running.communicate(timeout=60)
    finally:
        running.kill()
    assert time.monotonic() - begin < 5.0
    assert running.returncode == 130 and out == ""
    lines = err.strip().splitlines()
    assert lines[-1] == "jaxcable: interrupted"
    assert all(line.startswith(("phase ", "compiling")) for line in lines[:-1])  # progress
    assert [path.name for path in tmp_path.iterdir()] == ["long.json"]  # no half of a result


def test_an_error_of_the_program_is_not_hidden(scene, monkeypatch):
    """A defect has its traceback: nothing is swallowed."""

    def broken(*_, **__):
        raise ZeroDivisionError("a defect")

    monkeypatch.setattr("jaxcable.cli.solve.solver.solve", broken)
    with pytest.raises(ZeroDivisionError, match="a defect"):
        main(["solve", "net.json"])


def test_json_of_a_result_can_be_read_by_others(scene, capsys):
    assert main(["solve", "net.json", "--save", "r.json", "--quiet"]) == 0
    data = json.loads(Path("r.json").read_text())
    assert data["format"] == "jaxcable result" and data["description"] == "converged"
    assert matplotlib.get_backend().lower() == "agg"
