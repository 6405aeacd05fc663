"""The command line: what it prints and writes, exit statuses, one line for what goes wrong."""

import json
import os
import re
import shlex
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import jax
import jsonschema
import numpy as np
import pytest
import scenes
from oracles.convergence import converged

import jaxcable as jc
from jaxcable.cli import main
from jaxcable.cli.parser import parser
from jaxcable.files import FileError, codec

ROOT = Path(__file__).parents[2]
NET = jc.scenes.flat_net(load=15.0)
LOADED = NET.phases[1]


def environment(**changes):
    """That of a process beside this one, which compiles as the tests do: quickly, and once."""
    compiling = {"JAX_DISABLE_MOST_OPTIMIZATIONS": "1"}
    if jax.config.jax_compilation_cache_dir is not None:
        compiling["JAX_COMPILATION_CACHE_DIR"] = jax.config.jax_compilation_cache_dir
    return {**os.environ, "PYTHONPATH": str(ROOT), "MPLBACKEND": "Agg", **compiling, **changes}


def command(words):
    """Run a command; returns its exit status."""
    return main(words if isinstance(words, list) else shlex.split(words))


def one_line(text):
    """What was printed on stderr: one line that names the program."""
    (line,) = text.strip().splitlines()
    assert line.startswith("jaxcable: ")
    return line


@pytest.fixture
def refused(capsys):
    """A function that runs a command, which refuses its words in one line, and returns that."""

    def run(words):
        capsys.readouterr()
        assert command(words) == 2, words
        return one_line(capsys.readouterr().err)

    return run


@pytest.fixture(autouse=True)
def _nothing_takes_long(monkeypatch):
    """What is printed does not depend on the machine's speed."""
    monkeypatch.setattr(jc.progress.SHOW, "pause", 1e6)


@pytest.fixture
def scene(tmp_path, monkeypatch):
    """A folder with a scene, which is the working directory."""
    monkeypatch.chdir(tmp_path)
    jc.save_scene("net.json", NET)
    return tmp_path


def largest(solution):
    """The largest displacement of the last phase, m."""
    return float(np.linalg.norm(solution.phases[-1].displacement_in_phase, axis=1).max())


# --- solve


def test_solve_writes_what_it_is_asked_for(scene, capsys):
    uneven = jc.replace(NET.phases[0], pretension=np.linspace(50.0, 350.0, 12))
    jc.save_scene("net.json", (NET.structure, [uneven, LOADED]))
    names = ["r.json", "r.npz", "r.csv", "r.vtk", "r.py"]
    saves = " ".join(f"--save {name}" for name in names)
    assert command(f"solve net.json {saves} --plot net.svg --report net.txt") == 0
    out, err = capsys.readouterr()
    assert err == "" and out.startswith("status 0: converged\n")
    solution = converged(jc.solve(*jc.load_scene("net.json")))
    whole = float(np.linalg.norm(solution.displacement, axis=1).max())
    last, whole = f"{largest(solution):.6g}", f"{whole:.6g}"
    assert last != whole
    assert f"largest displacement in phase 2 alone: {last} m at node" in out
    assert f"largest displacement from the start (phases 1 to 2): {whole} m at node" in out
    assert "wrote net.svg" in out
    for name in ("r.json", "r.npz"):
        np.testing.assert_array_equal(jc.files.load_result(name)["tension"], solution.tension)
    data = json.loads(Path("r.json").read_text(encoding="utf-8"))  # others can read it, too
    assert data["format"] == "jaxcable result" and data["description"] == "converged"
    assert (scene / "net.svg").read_text().rstrip().endswith("</svg>")
    assert "Global equilibrium" in (scene / "net.txt").read_text()
    assert (scene / "r-elements.csv").exists() and (scene / "r.vtk").exists()
    assert not [path for path in scene.iterdir() if path.name.startswith(".")]
    assert command("solve net.json --report --corrections 2") == 0
    out = capsys.readouterr().out
    assert out.count("status 0: converged") == 1 and "Cutting list" in out


@pytest.mark.slow
def test_an_analysis_that_fails_ends_with_status_1_and_its_text(scene, capsys):
    loads = jc.replace(LOADED.loads, forces=(0.0, 0.0, -1e30))
    jc.save_scene("bad.json", (NET.structure, [NET.phases[0], jc.replace(LOADED, loads=loads)]))
    assert command("solve bad.json --save r.npz --save r.py --plot p.png") == 1
    out, err = capsys.readouterr()
    assert "FAILED: what follows is the last converged state, phase 1" in out
    lines = [line.removeprefix("jaxcable: ") for line in err.splitlines()]
    assert lines[0].startswith("warning: phase 2 (phases[1].loads): 1e+30 N on node 3")
    assert lines[1].startswith("r.py: not written: the analysis failed")
    assert lines[2] == "p.png: not drawn: the analysis failed"
    assert lines[3].startswith("bad.json: phase 2, increment 1 of 10 (load factor 0.1)")
    assert np.isfinite(jc.files.load_result("r.npz")["last.tension"]).all()


def test_the_cause_of_a_failure_is_said_once(scene, capsys):
    """A net of bars without prestress: what is likely and what to try, without words of Python."""
    assert command("new net --save bars.json --quiet") == 0
    data = json.loads(Path("bars.json").read_text(encoding="utf-8"))
    for group in data["structure"]["elements"].values():
        group["type"] = "Bars"
    del data["phases"][0]["pretension"]
    Path("bars.json").write_text(json.dumps(data), encoding="utf-8")
    assert command("solve bars.json --report r.txt") == 1
    out, err = capsys.readouterr()
    assert out.startswith("status 1: the analysis failed in phase 1\n")
    assert "FAILED: no results: phase 1 did not converge" in out
    line = err.strip().splitlines()[-1].removeprefix("jaxcable: ")
    start = "bars.json: phase 1, increment 1 of 1 (load factor 1): no equilibrium found"
    assert line.startswith(start)
    assert "Likely: a mechanism" in line and "Try: more increments" in line
    said = out + err
    assert said.count("equilibrium found") == 1
    assert not [word for word in ("trace_path", "max_steps", "residual") if word in said]
    text = Path("r.txt").read_text(encoding="utf-8")  # has no table of zeros, and says why itself
    assert "Reactions" not in text and "no equilibrium found" in text


def test_forces_above_the_strength_are_said_on_the_screen(scene, capsys):
    """That `optimize` keeps below it is in `test_combining`; a target has no limits."""
    weak = jc.replace(NET.structure.elements, strength=150.0)
    jc.save_scene("weak.json", (jc.replace(NET.structure, elements=weak), NET.phases))
    assert command("solve weak.json") == 0
    out = capsys.readouterr().out
    assert "STRENGTH EXCEEDED: 12 elements above the breaking force (elements: 12 of 12)" in out
    assert command("optimize weak.json --target 200 --same-in-group") == 0
    out = capsys.readouterr().out
    assert "STRENGTH EXCEEDED: largest force / strength 1." in out and "violated" not in out
    assert "it fixes the cutting length, and is not the jacking force" in out


@pytest.mark.slow_cases("solve")
@pytest.mark.parametrize("name", ["solve", "info"])
def test_nodes_in_millimeters_are_doubted(name, scene, capsys):
    large = jc.replace(NET.structure, nodes=1e3 * np.asarray(NET.structure.nodes))
    jc.save_scene("mm.json", (large, NET.phases))
    command(f"{name} mm.json")
    said = capsys.readouterr().err
    assert "warning: mm.json: the structure extends over 1.2 km; nodes are in m" in said
    assert command(f"{name} net.json") == 0 and "extends" not in capsys.readouterr().err


# --- form


def test_form_takes_groups_by_name_and_loads_of_one_phase(scene, capsys, refused):
    links = NET.structure.elements.links
    groups = {"a": jc.Cables(links[:6], 1e5), "b": jc.Cables(links[6:], 1e5)}
    grouped = jc.replace(NET.structure, elements=groups)
    jc.save_scene("groups.json", (grouped, [*NET.phases, LOADED]))
    words = "form groups.json --force-density a=100 b=300 --save form.json"
    assert command(words) == 0
    told = "loads in the form: none, as phase 1 has none; --loads takes those of others, which have"
    assert f"{told} some: 2, 3\n" in capsys.readouterr().out
    assert len(jc.load_scene("form.json").phases) == 3
    assert command(f"{words} --loads 2") == 0
    assert "loads in the form: those of phase 2 (NodalLoads" in capsys.readouterr().out
    found = jc.load_scene("form.json")
    assert found.phases[0].force_density == {"a": 100.0, "b": 300.0}
    # balance at every free node, with the loads of phase 2
    forces = np.zeros(found.structure.nodes.shape)
    for name, q in found.phases[0].force_density.items():
        first, last = found.structure.elements[name].links.array.T
        pull = q * (found.structure.nodes[last] - found.structure.nodes[first])
        np.add.at(forces, first, pull)
        np.add.at(forces, last, -pull)
    load = np.broadcast_to(LOADED.loads.forces, (4, 3))
    np.testing.assert_allclose(forces[LOADED.loads.nodes.array], -load, atol=1e-8)
    line = refused("form groups.json --tension a=100 c=3")
    assert line.endswith("--tension: no group 'c'; there are a, b")
    line = refused("form groups.json --tension much")
    assert "expected a number, or group=number: much" in line


@pytest.mark.slow
def test_form_finds_forces_in_masts_and_guys(scene, capsys, refused):
    """A mast of given length between guys: their forces are in balance in an analysis."""
    nodes = [[-4.0, -4, 0], [4, -4, 0], [0, 0, 3], [0, -4, 3], [0, 5, 0], [0, 0, 0]]
    elements = {
        "GUY": jc.Cables([[0, 2], [1, 2]], 1e7),
        "MAST": jc.Bars([[5, 2]], 1e8),
        "NET": jc.Cables([[2, 3], [3, 0], [3, 1], [2, 4]], 1e6),
    }
    structure = jc.Structure(nodes, elements, jc.pinned([0, 1, 4, 5]))
    jc.save_scene("mast.json", (structure, [jc.Phase()]))
    words = "form mast.json --force-density NET=1000 --save form.json"
    assert command(f"{words} --length MAST=3 GUY=drawn") == 0
    out = capsys.readouterr().out
    assert "GUY: tension " in out and "lengths 6.40312 m, 12.8062 m in total" in out
    assert "MAST: tension -" in out and "N, lengths 3 m" in out
    found, (prestress,) = jc.load_scene("form.json")
    solution = converged(jc.solve(found, prestress))
    # by hand: node 3 ends at the mean of its neighbours, and the head is pulled by 1000 N/m times
    # (0, 7/3, -5) m; guys take 1/8 of the 7/3 each way, and the mast the rest, along z
    pull = 1000 * (7 / 3) / 8 * np.sqrt(41)
    np.testing.assert_allclose(solution.tension["GUY"], pull, rtol=1e-8)
    np.testing.assert_allclose(solution.tension["MAST"], -1000 * (5 + 7 / 3 / 8 * 6), rtol=1e-8)
    # it is in balance from the start: the residual of form finding, 1e-10, over the stiffness
    assert float(np.abs(solution.displacement).max()) < 1e-9
    tension = jax.tree.map(np.asarray, prestress.pretension)
    assert tension["MAST"][0] < 0 < tension["GUY"].min()
    assert command("form mast.json --tension NET=3000 --length MAST=3 GUY=drawn") == 0
    for more, message in (
        ("", "q: element 0 of elements['GUY'] has no force density; every element needs one;"),
        ("--length MAST=drawn", "group 'GUY' has none of --tension, --force-density and"),
        ("--length MAST=drawn NET=5 GUY=drawn", "group 'NET' has more than one of --"),
        ("--length POST=drawn", "--length: no group 'POST'; there are GUY, MAST, NET"),
        ("--length POST=3", "--length: no group 'POST'; there are GUY, MAST, NET"),
        ("--length 3", "--length: expected group=drawn, or group=number, m"),
    ):
        assert message in refused(f"{words} {more}")


@pytest.mark.slow
def test_form_beside_groups_that_keep_their_stiffness(scene, capsys, refused):
    """Forces, densities and lengths together; with beams the scene is as drawn, with lengths."""
    nodes = [[-4.0, 0, 0], [0, 0, 0], [0, 0, 3], [4, 0, 4], [4, 4, 0]]
    elements = {
        "guy": jc.Cables([[0, 2]], 1e6, weight=20.0),
        "net": jc.Cables([[2, 3]], 1e6),
        "tie": jc.Cables([[2, 4]], 1e6),
    }
    phase = jc.Phase(loads=[jc.SelfWeight(), jc.SupportMovement([0], (0.0, 0.0, -0.1))])
    held = jc.pinned([0, 3, 4]) + jc.restrained([2], "y")
    section = jc.Section.linear(1e8, 1e6, 1e6, 1e6)
    bars, beams = jc.Bars([[1, 2]], 1e5), jc.Beams([[1, 2]], section=section)
    for mast, foot in ((bars, jc.pinned([1])), (beams, jc.clamped([1]))):
        structure = jc.Structure(nodes, elements | {"mast": mast}, held + foot)
        jc.save_scene("mast.json", (structure, [phase]))
        words = "form mast.json --tension guy=2000 --force-density net=200 --save form.json"
        assert command(f"{words} --length tie=6.4 --free mast") == 0
        out, err = capsys.readouterr()
        assert "guy: tension 2000 N" in out and "tie: tension " in out and "lengths 6.4 m" in out
        assert "SupportMovement (1), phase 1: form finding cannot take it" in err
        found, (prestress, *_) = jc.load_scene("form.json")
        solution = converged(jc.solve(found, prestress))
        assert float(solution.tension["guy"][0]) == pytest.approx(2000.0, rel=1e-6)
        ends = np.diff(np.asarray(solution.positions)[[2, 3]], axis=0)
        force = 200 * np.linalg.norm(ends)
        assert float(solution.tension["net"][0]) == pytest.approx(force, rel=1e-6)
        drawn = np.abs(found.nodes - np.asarray(nodes)).max() == 0
        assert drawn == isinstance(mast, jc.Beams)
        assert ("the structure as drawn, unstressed lengths" in out) == drawn
    for more, message in (
        ("--free mast", "group 'tie' has none of --tension, --force-density and --length; --free"),
        ("--free mast tie net", "group 'net' has one of --tension, --force-density and --length, "),
        ("--free post", "--free: no group 'post'; there are guy, mast, net, tie"),
        ("--free mast --length tie=6 net=4", "group 'net' has more than one of --tension"),
    ):
        assert message in refused(f"{words} {more}")


# --- optimize


def save_bare(name, load=0.0):
    """A scene of one phase, in which nothing but `load` acts."""
    loads = jc.replace(LOADED.loads, forces=(0.0, 0.0, load))
    jc.save_scene(name, (NET.structure, [jc.replace(NET.phases[0], loads=loads)]))


def test_optimize_finds_a_pretension_that_can_be_checked(scene, capsys, refused):
    """Without load the tension is the pretension: 321 N."""
    save_bare("bare.json")
    words = "optimize bare.json --target 321 --bounds 300 400 --save tuned.json"
    assert command(words) == 0
    out, err = capsys.readouterr()
    assert one_line(err).endswith("starts at the nearest values within 300 to 400 N")
    assert out.startswith("status 0: converged") and "pretension 321 N" in out
    tuned = jc.load_scene("tuned.json")
    np.testing.assert_allclose(tuned.phases[0].pretension, 321.0, rtol=1e-6)
    density = jc.Phase(force_density=750.0)  # 300 N in each link of 0.4 m
    jc.save_scene("form.json", (NET.structure, [density]))
    assert command("optimize form.json --target 300 --save tuned.json") == 0
    out, err = capsys.readouterr()
    assert "the scene states force densities: the search began at these times" in out and not err
    tuned = jc.load_scene("tuned.json").phases[0]
    np.testing.assert_allclose(tuned.pretension, 300.0, rtol=1e-6)
    assert tuned.force_density is None
    jc.save_scene("none.json", (NET.structure, [jc.Phase(rest_length=0.3)]))
    for words, message in (
        ("bare.json", "give --target, or --deflection"),
        ("bare.json --target 321 --lowest 100", "--target cannot be combined with"),
        ("bare.json --target 321 --bounds 400 300", "--bounds 400 300: the first is above"),
        ("none.json --target 1", "no phase has a pretension (or force densities) to optimize; sta"),
    ):
        assert message in refused(f"optimize {words}")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("limit", "code", "needed"), [("0.5", 0, False), ("0.001 --bounds 0 0", 1, True)]
)
def test_optimize_without_pretension(limit, code, needed, scene, capsys):
    """None is needed; or bounds allow none: the sum is zero, and the net sags more than it may."""
    jc.save_scene("net.json", (NET.structure, [NET.phases[0], jc.replace(LOADED, increments=1)]))
    assert command(f"optimize net.json --deflection {limit} --same-in-group") == code
    out = capsys.readouterr().out
    none = "no pretension is needed: the limits below are met without any"
    assert (none not in out) == needed == ("violated by" in out)
    if needed:
        assert "the best design found has no pretension" in out
    else:
        assert "\npretension 0 N\n" in out and "KKT" not in out


@pytest.mark.slow
def test_optimize_that_fails_writes_nothing_unasked(scene, capsys):
    """The best design of a search that has not ended is written by --keep, none of a bad start."""
    save_bare("bare.json")
    words = "optimize bare.json --target 321 --bounds 300 400 --steps 1 --save t.json"
    Path("t.json").write_text("mine", encoding="utf-8")  # nor is what is there replaced
    assert command(f"{words} --quiet") == 1
    out, err = capsys.readouterr()
    assert out == "" and Path("t.json").read_text(encoding="utf-8") == "mine"
    first, second = err.strip().splitlines()  # and no warning of the start
    assert first == ("jaxcable: t.json: not written: the search did not converge; --keep writes it")
    assert "maximum number of optimization steps reached" in second
    assert command(f"{words} --keep") == 1
    out, err = capsys.readouterr()
    found = np.asarray(jc.load_scene("t.json").phases[0].pretension)
    assert (found > 200.0).all() and not np.allclose(found, 321.0, rtol=1e-6)
    assert f"pretension {found.min():.6g}" in out
    assert "wrote t.json: the scene with this pretension, the best one found" in out
    warning, error = err.strip().splitlines()
    assert "starts at the nearest values" in warning
    assert "maximum number of optimization steps reached" in error
    save_bare("weak.json", 1e30)
    assert command("optimize weak.json --target 321 --steps 1 --save n.json --quiet") == 1
    out, err = capsys.readouterr()
    first, second = err.strip().splitlines()
    assert out == "" and not Path("n.json").exists()
    said = "n.json: not written: the analysis fails with the pretension of the start"
    assert first == f"jaxcable: {said}" and "phase 1, increment 1 of 1" in second


def test_optimize_keeps_its_limits(scene, capsys, monkeypatch):
    jc.save_scene("net.json", (NET.structure, [NET.phases[0], jc.replace(LOADED, increments=1)]))
    words = "--deflection 0.012 --same-in-group --details --save t.json"
    assert command(f"optimize net.json {words}") == 0
    told, err = capsys.readouterr()
    assert "compiling" not in err + told  # in a terminal only
    reached = largest(converged(jc.solve(*jc.load_scene("t.json"))))
    assert 0.0115 < reached <= 0.012  # of a smooth bound of it, which lies above by up to 4 %
    limit = "limit on displacements of the last phase: 0.012 m, reached"
    assert f"{limit} {reached:.6g} m at node" in told and ": met\n" in told
    assert 0 <= float(told.split("residual (KKT) ")[1].split(",")[0]) <= 1e-6
    words = "--same-in-group --bounds 0 215 --deflection 0.0115 --lowest 250"
    assert command(f"optimize net.json {words} --save no.json") == 1
    told, err = capsys.readouterr()
    structure, (prestress, loading) = jc.load_scene("net.json")
    bound = jc.replace(prestress, pretension=215.0)
    held = converged(jc.solve(structure, [bound, loading]))
    reached, lowest = largest(held), float(held.tension.min())
    assert f"reached {reached:.6g} m at node" in told
    assert f"violated by {100 * (reached / 0.0115 - 1):.2g} %\n" in told
    assert f"reached {lowest:.6g} N, element " in told
    assert f": violated by {100 * (1 - lowest / 250):.2g} %" in told
    assert "no.json: not written: the limits are violated; --keep writes it" in err
    assert "constraints are violated" in err and not Path("no.json").exists()


@pytest.mark.slow
def test_the_net_to_begin_with_can_be_optimized(tmp_path, monkeypatch, capsys):
    """It ended STALLED after 20 779 analyses, with the limit met."""
    monkeypatch.chdir(tmp_path)
    assert command("new net --quiet") == 0
    assert command("optimize net.json --deflection 0.02 --save t.json") == 0
    told = capsys.readouterr().out
    assert told.startswith("status 0: converged\n") and ": met\n" in told
    assert "violated" not in told and "cables are kept taut: lowest tension" in told
    assert "met, BUT ONLY JUST: " in told
    assert int(told.split(" analyses")[0].split()[-1]) <= 200
    solution = converged(jc.solve(*jc.load_scene("t.json")))
    assert 0.0195 < largest(solution) <= 0.02 * (1 + 1e-9)


# --- info, convert, help


def test_info_tells_what_is_in_a_file(scene, capsys):
    assert command("info net.json") == 0
    out = capsys.readouterr().out
    for text in (
        *("scene of 12 nodes, 2 phases, float64", "unknowns: 12", "phase 2: 10 increments"),
        *("Cables: 12 elements, lengths 0.4 m, 4.8 m in total", "  97.970\n"),  # EA, kN
        "NodalLoads on 4 nodes, sum (0, 0, -60) N",
    ):
        assert text in out
    section = jc.Section.rectangle(0.1, 0.1, jc.Elastic(1e9))
    nodes = [[0.0, 0, 0], [0, 0, 2.0], [0, 0, 5.0]]
    mast = jc.Beams([[0, 1]], section, up=(1.0, 0, 0))
    arm = jc.Structure(nodes, mast, supports=jc.clamped([0]), rigid=[[1, 2]])
    jc.save_scene("arm.json", (arm, [jc.Phase()]))
    assert command("info arm.json") == 0
    assert "unknowns: 6" in capsys.readouterr().out  # the carried node has none of its own


def test_convert_makes_a_scene_of_a_net(scene, capsys, refused):
    (scene / "net.obj").write_text("v 0 0 0\nv 100 0 0\nv 200 0 0\nl 1 2 3\n")
    words = "--scale 0.01 --anchors 0 2-2 --axial-stiffness 1e5 --pretension 300"
    assert command(f"convert net.obj {words} --save obj.json") == 0
    structure, phases = jc.load_scene("obj.json")
    assert structure.nodes[:, 0].tolist() == [0, 1, 2]
    assert phases[0].pretension.tolist() == [300] * 2
    (scene / "n.csv").write_text("x,y,z,support\n0,0,0,1\n1,0,0,1\n")
    (scene / "l.csv").write_text("first,last,axial_stiffness\n0,1,1e5\n")
    assert command("convert n.csv l.csv --save csv.json") == 0
    capsys.readouterr()
    assert command("info net.obj") == 0
    assert "net of 3 nodes, 2 links: 2 cables" in capsys.readouterr().out
    stiff = "--axial-stiffness 1"
    for words, message in (
        (f"net.obj {stiff}", 'the file names no supports; give node numbers or "ends"'),
        ("net.obj --anchors ends", "axial_stiffness: the file has none; give --axial"),
        (f"net.obj --anchors two {stiff}", "anchors: 'two' is no node number"),
        (f"net.json {stiff}", "net.json: is a scene of jaxcable already"),
        (f"net.stl {stiff}", "net.stl: expected .obj, .dxf, .json, .fofin, or two .csv"),
        (f"n.csv {stiff}", "n.csv: expected .obj, .dxf, .json, .fofin, or two .csv"),
        (f"n.csv l.csv net.obj {stiff}", "expected one file, or two CSV tables"),
        (f"net.py {stiff}", "net.py: scripts are not read, those of OpenSees neither: give"),
    ):
        assert message in refused(f"convert {words} --save x.json")
    assert "jaxcable solve SCENE --save x.py" in refused("convert net.json --save x.py")


@pytest.mark.parametrize("name", ["form", "optimize"])
def test_help_says_in_which_units_numbers_are_read(name):
    """Each option with a force or a length says so."""
    [command] = [made for one, made in commands().items() if one == name]
    texts = [action.help for action in command._actions if action.help]
    numbers = [text for text in texts if re.search(r"\b(N|m|N/m) or in", text)]
    assert len(numbers) == (3 if name == "form" else 4)
    assert not [text for text in texts if re.search(r", (N/m|N|m)\b(?!/| or in)", text)]


def commands():
    """The commands by name, and their parsers."""
    (found,) = [action.choices for action in parser()._actions if action.dest == "command"]
    return found


@pytest.mark.parametrize("name", [None, *commands()])
def test_help_has_an_example_that_parses(name, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["--help"] if name is None else [name, "--help"])
    assert ended.value.code == 0
    out = capsys.readouterr().out
    (example,) = [line for line in out.splitlines() if line.startswith("example: jaxcable ")]
    options = parser().parse_args(example.split()[2:])
    assert options.command == (name or "solve")
    assert "exit status: 0 done, 1 the analysis failed, 2 bad input, 3 checks not passed" in out


# --- quiet, and progress

QUIET = {
    "new": "bridge",
    "info": "net.json",
    "solve": "net.json --report --plot q.png",
    "plot": "net.json",
    "view": "net.json --no-open",
    "form": "net.json --tension 15000 --save formed.json",
    "optimize": None,  # in `test_optimize_that_fails_writes_nothing_unasked`
    "line": None,  # in tests/lines/test_line_files.py
    "mast": None,  # in tests/masts/test_mast_files.py
    "convert": "net.json --save net.dxf",
    "schema": "",
    "demo": "",
}


def test_every_command_can_be_quiet():
    assert list(commands()) == list(QUIET)  # in the order of a first use
    assert all("--quiet" in own.format_help() for own in commands().values())


@pytest.mark.slow_cases("demo")
@pytest.mark.parametrize("name", [name for name, words in QUIET.items() if words is not None])
def test_quiet_prints_nothing(name, scene, capsys, monkeypatch):
    """No results, no warnings, no progress."""
    monkeypatch.setattr(jc.progress.SHOW, "pause", 0.0)
    if name == "convert":
        pytest.importorskip("ezdxf")
    before = set(scene.iterdir())
    assert command(f"{name} {QUIET[name]} --quiet") == 0
    assert capsys.readouterr() == ("", "")
    assert (set(scene.iterdir()) > before) == (name not in ("info", "schema"))


def test_quiet_prints_errors(scene, refused, capsys):
    assert refused("info none.json --quiet").endswith("No such file or directory")
    assert command("info net.json") == 0  # stdout is back
    assert capsys.readouterr().out.startswith("scene of 12 nodes")


def test_demo_prints_its_table_and_writes_its_picture(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert command("demo") == 0
    out = capsys.readouterr().out
    assert "status    0: converged" in out
    assert "identified from these deflections" in out
    for node in jc.scenes.hypar.NODE_NAMES:
        assert any(line.startswith(f"  {node:4d}  ") for line in out.splitlines())
    picture = Path("hypar_net.png").read_bytes()
    assert picture.startswith(b"\x89PNG") and len(picture) > 20_000


# --- what goes wrong


def test_wrong_words_end_with_status_2(scene, refused, capsys):
    for words, message in (
        ("", "required: COMMAND"),
        ("nonsense", "invalid choice: 'nonsense'"),
        ("solve", "required: scene"),
        ("solve net.json --tol -1", "--tol: -1: expected a positive number"),
        ("solve net.json --tol abc", "--tol: abc: expected a positive number"),
        ("solve net.json --corrections 1.5", "--corrections: 1.5: expected a whole number from"),
        ("optimize net.json --target 3_21", "--target: 3_21: expected a number"),
    ):
        with pytest.raises(SystemExit) as ended:
            command(words)
        assert ended.value.code == 2 and message in capsys.readouterr().err
    jc.save_scene("mast.json", scenes.isolated_cable())
    for words, message in (
        ("solve nothing.json", "nothing.json: No such file or directory"),
        ("solve .", ".: Is a directory"),
        ("info nothing.json", "nothing.json: No such file or directory"),
        ("solve net.json --save r.xls", "--save r.xls: expected a name that ends with"),
        ("solve net.json --plot r.doc", "--plot r.doc: expected a name that ends with"),
        ("solve net.json --report r.doc", "--report r.doc: expected a name that ends"),
        ("solve net.json --save no/r.json", "no/r.json: No such file or directory"),
        ("solve net.json --save net.json/r.json", "net.json/r.json: Not a directory"),
        ("solve mast.json --save r.py", "mast.json: structure: elements are Catenaries"),
        ("demo --plot no/p.png", "no/p.png: No such file or directory"),
    ):
        assert message in refused(words)


def test_a_wrong_file_names_its_field(scene, refused):
    text = Path("net.json").read_text(encoding="utf-8")
    Path("bad.json").write_text(text.replace("[8, 11]", "[8, 12]"), encoding="utf-8")
    more = {"solve": "", "info": "", "form": "--tension 1", "optimize": "--target 1"}
    for name, options in more.items():
        assert "bad.json: structure: elements.links[11]" in refused(f"{name} bad.json {options}")
    many = [jc.Phase(increments=1_000_000)] * 40
    jc.save_scene("many.json", (NET.structure, [*NET.phases, *many]))
    assert "results of all increments would need 15 GB" in refused("solve many.json")


def test_a_folder_that_cannot_be_written_to_and_a_defect(scene, refused, monkeypatch):
    """Told before the analysis, not after it; a defect has its traceback: nothing is swallowed."""

    def broken(*_, **__):
        raise ZeroDivisionError("a defect")

    monkeypatch.setattr("jaxcable.cli.solving.solver.solve", broken)
    with pytest.raises(ZeroDivisionError, match="a defect"):
        command("solve net.json")

    def denied(*_, **__):
        raise PermissionError(13, "Permission denied", "x")

    monkeypatch.setattr("jaxcable.common.writing.os.open", denied)
    assert refused("solve net.json --save r.json") == "jaxcable: r.json: Permission denied"
    assert refused("demo") == "jaxcable: hypar_net.png: Permission denied"


def test_large_files_and_nonsense(scene, refused):
    """Neither read to the end nor parsed; also if more is allowed."""
    with open("junk.json", "wb") as stream:
        stream.write(b"{" + bytes(range(128, 256)))
        stream.truncate(100_000_000)
    line = refused("solve junk.json")
    assert line.startswith("jaxcable: junk.json: larger than the limit of 64 MB")
    begin = time.monotonic()
    refused("solve junk.json --largest 200")
    assert time.monotonic() - begin < 5.0  # reading 100 MB once takes a fraction of a second
    text = '{"format": "jaxcable scene", "version": 1, ' + "[{" * 1_000_000
    Path("junk.json").write_text(text, encoding="utf-8")
    assert "junk.json: line 1, column" in refused("solve junk.json")


# --- comments in scenes


def objects(value, inside=None):
    """All objects of classes in a scene: what has a type, and what need not name it."""
    if isinstance(value, dict):
        implied = inside in ("structure", "supports", "section", "phases")
        if implied or value.get("type") in codec.TYPES:
            yield value
        for key, item in value.items():
            yield from objects(item, key)
    elif isinstance(value, list):
        for item in value:
            yield from objects(item, inside)


def test_comments_may_stand_in_every_object_of_a_class(tmp_path):
    """Whatever they are; where keys are names of groups, neither schema nor reader takes one."""
    nodes = [[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0]]
    section, law = jc.Section.rectangle(0.1, 0.1, jc.Elastic(1e9)), jc.Polygonal([0, 1], [0, 1e9])
    elements = {
        "beam": jc.Beams([[0, 1]], section),
        "cable": jc.Cables([[1, 2], [2, 3]], area=1e-4, law=law, weight=1.0),
    }
    structure = jc.Structure(nodes, elements, supports=jc.clamped([0]) + jc.pinned([3]))
    tension = {"beam": None, "cable": jc.only([0], 100.0)}
    loads = [jc.SelfWeight(), jc.NodalLoads([2], (0.0, 0.0, -1.0))]
    path, again = tmp_path / "scene.json", tmp_path / "again.json"
    jc.save_scene(path, (structure, [jc.Phase(pretension=tension, loads=loads)]))
    plain = path.read_text()
    data = json.loads(plain)
    check = jsonschema.Draft202012Validator(jc.files.scene_schema())
    places = list(objects(data))
    assert len(places) == 11, [place.get("type") for place in places]
    for k, place in enumerate(places):
        place["comment"] = ["a text", ["lines"], {"type": "Nonsense"}, None][k % 4]
    path.write_text(json.dumps(data))
    check.validate(data)
    jc.save_scene(again, jc.load_scene(path))
    assert again.read_text() == plain and "comment" not in plain
    for names in (data["structure"]["elements"], data["phases"][0]["pretension"]):
        names["comment"] = "a text"
        path.write_text(json.dumps(data))
        with pytest.raises(FileError, match="comment"):
            jc.load_scene(path)
        assert not check.is_valid(data)
        del names["comment"]


# --- processes

WHOLE = """
    import sys
    from jaxcable.cli import main

    sys.argv = ["jaxcable", "solve", "net.json"]
    assert main() == 0
"""


@pytest.mark.slow
def test_a_process_draws_without_a_display(scene):
    """Its reader may have gone, as in ``jaxcable solve ... | head -1``: what is to be saved is."""
    around = environment(DISPLAY="", MPLBACKEND="TkAgg")
    words = "solve net.json --save r.npz --plot net.png"
    whole = f"{shlex.quote(sys.executable)} -u -m jaxcable {words} | true"
    run = subprocess.run(whole, shell=True, capture_output=True, text=True, env=around, check=False)
    assert run.stdout == "" and run.stderr == ""
    assert jc.files.load_result("r.npz")["status"] == 0
    assert Path("net.png").read_bytes().startswith(b"\x89PNG")
    # by its function, without words
    run = [sys.executable, "-c", textwrap.dedent(WHOLE)]
    run = subprocess.run(run, capture_output=True, text=True, env=around, check=False)
    assert run.returncode == 0 and run.stdout.startswith("status 0: converged"), run.stderr


@pytest.mark.slow_cases("True")
@pytest.mark.parametrize("begun", [False, True])
def test_ctrl_c_ends_with_one_line(begun, scene):
    """While jax still loads, and in the middle of a long analysis."""
    long = jc.replace(LOADED, increments=200_000)
    jc.save_scene("long.json", (NET.structure, [NET.phases[0], long]))
    Path("net.json").unlink()
    told = {} if begun else {"PYTHONPROFILEIMPORTTIME": "1"}  # what it has loaded
    running = subprocess.Popen(
        [sys.executable, "-m", "jaxcable", "solve", "long.json", "--save", "r.json"],
        env=environment(**told),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    line = ""
    if begun:
        while not line.startswith("phase 2"):
            line = running.stderr.readline()
            assert line.startswith("phase "), line  # progress
    else:
        while "jaxcable.common.interrupt" not in line:
            line = running.stderr.readline()
            assert line.startswith("import time:"), line
    assert running.poll() is None  # it had enough to do
    running.send_signal(signal.SIGINT)
    begin = time.monotonic()
    try:
        out, err = running.communicate(timeout=60)
    finally:
        running.kill()
    assert time.monotonic() - begin < 5.0
    assert running.returncode == 130 and out == ""
    lines = [line for line in err.splitlines() if not line.startswith("import time:")]
    assert lines[-1] == "jaxcable: interrupted"
    assert all(line.startswith("phase ") for line in lines[:-1])
    assert [path.name for path in scene.iterdir()] == ["long.json"]  # no half of a result


# --- units


def test_commands_work_in_the_units_of_the_scene(scene, capsys):
    jc.save_scene("kn.json", NET, units="kN, mm")
    assert command("info kn.json") == 0
    out = capsys.readouterr().out
    assert "units of the file: kN, mm" in out and "  97.970\n" in out
    assert "extent: 1200 x 1200 x 0 mm" in out and "sum (0, 0, -0.06) kN" in out
    assert "pretension 0.2 kN" in out
    assert command("solve kn.json --report kn.txt --save kn.csv --save kn.npz --save kn.vtk") == 0
    out = capsys.readouterr().out
    assert "final axial forces: 0.2336 to 0.23376 kN\n" in out
    assert "in phase 2 alone: 12.8385 mm at node" in out
    assert "x (mm)" in Path("kn-nodes.csv").read_text("utf-8")
    assert "(kN)" in Path("kn.txt").read_text("utf-8")
    assert jc.files.load_result("kn.npz")["tension"].min() > 200.0  # in SI
    assert command('solve net.json --show-units "kip, ft"') == 0
    assert "final axial forces: 0.0525153 to 0.052551" in capsys.readouterr().out


def test_numbers_on_the_command_line_are_in_the_units_of_the_scene(scene, capsys):
    jc.save_scene("kn.json", NET, units="kN, mm")
    for name, density in (("kn", "4e-4"), ("net", "400")):
        assert command(f"form {name}.json --force-density {density} --save {name}_form.json") == 0
    out = capsys.readouterr().out
    assert "kN, lengths" in out
    one, other = jc.load_scene("kn_form.json"), jc.load_scene("net_form.json")
    assert one.units is not None and other.units is None
    np.testing.assert_allclose(one.structure.nodes, other.structure.nodes, atol=1e-12)
    limits = {"kn": "--deflection 12.5 --bounds 0 5", "net": "--deflection 0.0125 --bounds 0 5000"}
    for name, words in limits.items():
        words = f"optimize {name}.json {words} --same-in-group --save {name}_best.json"
        assert command(words) == 0
    out = capsys.readouterr().out
    assert "limit on displacements of the last phase: 12.5 mm, reached 12.4965 mm" in out
    one, other = jc.load_scene("kn_best.json"), jc.load_scene("net_best.json")
    np.testing.assert_allclose(one.phases[0].pretension, other.phases[0].pretension, rtol=1e-6)


def test_nets_without_a_unit_take_one(scene, capsys, refused):
    Path("n.csv").write_text("x,y,z,support,fz\n0,0,0,1,\n4000,0,0,,-2\n8000,0,0,1,\n", "utf-8")
    Path("l.csv").write_text("first,last\n0,1\n1,2\n", "utf-8")
    words = '--units "kN, mm" --axial-stiffness 3e4 --pretension 5'
    assert command(f"convert n.csv l.csv {words} --save csv.json") == 0
    read = jc.load_scene("csv.json")
    assert str(read.units) == "kN, mm, K"
    np.testing.assert_array_equal(read.structure.nodes[2], [8.0, 0, 0])
    np.testing.assert_array_equal(read.structure.elements.axial_stiffness, [3e7, 3e7])
    np.testing.assert_array_equal(read.phases[0].pretension, [5e3, 5e3])
    np.testing.assert_array_equal(read.phases[1].loads.forces, [[0, 0, -2e3]])
    capsys.readouterr()
    assert command('info n.csv l.csv --units "kN, mm"') == 0
    out = capsys.readouterr().out
    assert "extent: 8000 x 0 x 0 mm" in out and "loads: sum (0, 0, -2) kN" in out
    command("info n.csv l.csv")
    assert 'such as units="N, mm" (--units "N, mm")' in capsys.readouterr().err
    said = refused('info net.json --units "kN, m"')
    assert 'a scene states its own at its top, such as "units": "kN, m"' in said
    said = refused("info n.csv l.csv --units kn,mm")
    assert "--units: units = 'kn,mm': unknown unit 'kn'; did you mean 'kN'" in said
