"""The first steps of a new user: `new`, its scenes and scripts, and `plot`."""

import base64
import inspect
import json
import re
import runpy
import subprocess
import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import jsonschema
import numpy as np
import pytest
from matplotlib.figure import Figure
from test_cli import objects, one_line

import jaxcable as jc
from jaxcable import plots
from jaxcable.cli import main, new

ROOT = Path(__file__).parents[2]


@pytest.fixture(autouse=True)
def _nothing_takes_long(monkeypatch):
    """What is printed does not depend on the machine's speed."""
    monkeypatch.setattr(jc.progress.SHOW, "pause", 1e6)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with what `new` writes of every kind."""
    place = tmp_path_factory.mktemp("first")
    for kind in new.KINDS:
        assert main(["new", kind, "--save", str(place / f"{kind}.json"), "--quiet"]) == 0
    return place


@pytest.fixture(scope="module")
def solved(folder):
    """Structure, phases and solution of every scene."""
    scenes = {kind: jc.load_scene(folder / f"{kind}.json") for kind in new.KINDS}
    return {kind: (*scene, jc.solve(*scene)) for kind, scene in scenes.items()}


# --- new


@pytest.mark.parametrize("kind", new.KINDS)
def test_scenes_are_valid_and_explain_themselves(kind, folder):
    text = (folder / f"{kind}.json").read_text()
    data = json.loads(text)
    schema = json.loads((folder / data["$schema"]).read_text())
    jsonschema.Draft202012Validator(schema).validate(data)
    places = [data["structure"], data["structure"]["supports"], *data["phases"]]
    assert all(place["comment"] for place in [data, *places])
    sections = [part for part in objects(data) if "laws" in part]
    assert all("comment" in part for part in sections)
    assert max(map(len, text.splitlines())) <= 100  # it can be read


def read(name):
    return Path(name).read_text(encoding="utf-8")


def test_new_says_what_to_type_next(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["new", "net", "--save", "my roof.json"]) == 0
    lines = capsys.readouterr().out.splitlines()
    wrote = [f"wrote {name}" for name in ("my roof.json", "my roof.py", "scene.schema.json")]
    assert [line.split(":")[0] for line in lines[:4]] == [*wrote, "next"]
    assert lines[4:] == [
        "  jaxcable solve 'my roof.json' --plot 'my roof.png'",
        "  jaxcable view 'my roof.json'",
    ]
    assert read("my roof.py").startswith('"""A saddle of prestressed cables')


def test_new_replaces_nothing_unasked(tmp_path, monkeypatch, capsys):
    """Files of people are edited: neither scene nor script, nor a schema that is there."""
    monkeypatch.chdir(tmp_path)
    Path("dome.py").write_text("mine", encoding="utf-8")
    Path("scene.schema.json").write_text("mine, too", encoding="utf-8")  # no schema of jaxcable
    assert main(["new", "dome"]) == 2
    assert one_line(capsys.readouterr().err) == (
        "jaxcable: dome.py: exists already; --save names another file, --force replaces it"
    )
    assert sorted(path.name for path in tmp_path.iterdir()) == ["dome.py", "scene.schema.json"]
    assert main(["new", "dome", "--save", "other.json"]) == 0
    assert "scene.schema.json" not in capsys.readouterr().out
    assert main(["new", "dome", "--force"]) == 0
    assert "mine" not in read("dome.py") and read("scene.schema.json") == "mine, too"
    for name, message in (
        ("random.json", "random.py would hide Python's module of that name"),
        ("jaxcable.json", "jaxcable.py would hide Python's module"),
        ("scene.schema.json", "is the name of the schema"),
        ("dome.txt", "expected a name that ends with .json"),
        ("no/dome.json", "no/dome.json: No such file or directory"),
    ):
        capsys.readouterr()
        assert main(["new", "dome", "--force", "--save", name]) == 2
        assert message in one_line(capsys.readouterr().err)
    assert not Path("random.py").exists() and not Path("dome.txt").exists()


def test_scripts_pass_the_linter(folder):
    scripts = [f"{kind}.py" for kind in new.KINDS]
    settings = ["--config", str(ROOT / "pyproject.toml"), "--no-cache", *scripts]
    options = {"cwd": folder, "capture_output": True, "text": True, "check": False}
    for words in (["check"], ["format", "--check"]):
        done = subprocess.run([sys.executable, "-m", "ruff", *words, *settings], **options)
        assert done.returncode == 0, done.stdout + done.stderr
    for name in scripts:
        text = (folder / name).read_text()
        assert "jc.scenes" not in text and 40 <= len(text.splitlines()) <= 70


@pytest.mark.slow_cases("bridge", "mast", "net")
@pytest.mark.parametrize("kind", new.KINDS)
def test_scripts_agree_with_their_scenes(kind, folder, solved, tmp_path, monkeypatch, capsys):
    """As ``python net.py`` in another folder: they set precision by themselves.

    Scenes have coordinates to 1e-6 m: a stretch of 1e-6 m over 6 m is 5 N of 32 MN.
    """
    structure, _, solution = solved[kind]
    assert int(solution.status) == 0
    monkeypatch.chdir(tmp_path)
    jax.config.update("jax_enable_x64", False)
    try:
        found = runpy.run_path(str(folder / f"{kind}.py"), run_name="__main__")["solution"]
        assert jax.config.jax_enable_x64
    finally:
        jax.config.update("jax_enable_x64", True)
    printed = capsys.readouterr().out
    assert not list(tmp_path.iterdir())  # what they write is beside them
    np.testing.assert_allclose(found.displacement, solution.displacement, rtol=0, atol=2e-6)
    assert set(found.tension) == set(structure.elements)
    for group, force in solution.tension.items():
        np.testing.assert_allclose(found.tension[group], force, rtol=0, atol=10.0)
    # what is printed is that of the scene, too
    moved = 1e3 * np.linalg.norm(solution.phases[-1].displacement_in_phase, axis=1)
    told = re.search(r"largest displacement by .*: ([\d.]+) mm at node (\d+)", printed)
    assert abs(float(told[1]) - moved.max()) < 0.011  # two digits after the point
    assert moved[int(told[2])] > moved.max() - 0.01
    assert printed.startswith("status: converged")
    assert kind != "net" or "by snow: 17.68 mm" in printed
    assert (folder / f"{kind}.png").read_bytes().startswith(b"\x89PNG")
    assert "<canvas" in (folder / f"{kind}.html").read_text()


# --- are they structures that an engineer would build


def acting(data, lengths):
    """Sum of the loads of a scene, N, from its file; `lengths` unstressed, by group."""
    nodes, groups = np.array(data["structure"]["nodes"]), data["structure"]["elements"]
    total = np.zeros(3)
    for phase in data["phases"]:
        loads = phase.get("loads", [])
        for load in [loads] if isinstance(loads, dict) else loads:
            if load["type"] == "NodalLoads":
                total += (np.ones((len(load["nodes"]), 1)) * load["forces"]).sum(axis=0)
            elif load["type"] == "LineLoads":
                links = np.array(groups[load["on"]]["links"])
                spans = np.linalg.norm(nodes[links[:, 1]] - nodes[links[:, 0]], axis=1)
                total += np.array(load["forces"]) * spans.sum()
            else:
                assert load == {"type": "SelfWeight"}
                for name, group in groups.items():
                    total[2] -= group.get("weight", 0.0) * np.sum(lengths[name])
    return total


@pytest.mark.parametrize("kind", new.KINDS)
def test_they_are_in_equilibrium(kind, folder, solved):
    """As a whole, and every free node of what has no beams; from forces and places alone."""
    _, _, solution = solved[kind]
    data = json.loads((folder / f"{kind}.json").read_text())
    load = acting(data, {name: np.asarray(v) for name, v in solution.rest_length.items()})
    # loads along beams are per length of the beam before it bends: to 1e-3 its strain
    largest = np.abs(solution.reactions).max()
    left = load + np.asarray(solution.reactions).sum(axis=0)
    assert np.abs(load).max() > 8e3 and np.abs(left).max() < 1e-3 * np.abs(load).max(), left
    if kind not in ("net", "dome"):
        return
    places, forces = np.asarray(solution.positions), np.array(solution.load)
    for name, group in data["structure"]["elements"].items():
        first, last = np.array(group["links"]).T
        pull = places[last] - places[first]
        pull *= (np.asarray(solution.tension[name]) / np.linalg.norm(pull, axis=1))[:, None]
        np.add.at(forces, first, pull)
        np.add.at(forces, last, -pull)
    free = np.setdiff1d(np.arange(len(places)), data["structure"]["supports"]["nodes"])
    assert np.abs(forces[free]).max() < 1e-8 * largest  # tol of the analysis is 1e-10 of a sum
    held = np.setdiff1d(np.arange(len(places)), free)
    assert np.abs(forces + np.asarray(solution.reactions))[held].max() < 1e-8 * largest


SANE = {  # largest displacement by the loads over the span, of strength: least and most
    "net": (8.0, 1 / 600, 1 / 300, 0.35, 0.6),
    "mast": (30.0, 1 / 800, 1 / 300, 0.15, 0.5),
    "bridge": (24.0, 1 / 500, 1 / 300, 0.1, 0.5),
    "dome": (24.0, 1 / 500, 1 / 250, 0.3, 0.6),
}


@pytest.mark.parametrize("kind", new.KINDS)
def test_they_are_of_sane_proportions(kind, solved):
    structure, _, solution = solved[kind]
    span, low, high, least, most = SANE[kind]
    assert all(bool(phase.stable) for phase in solution.phases)
    moved = np.linalg.norm(solution.phases[-1].displacement_in_phase, axis=1).max() / span
    assert low < moved < high
    used = 0.0
    for name, group in structure.elements.items():
        if isinstance(group, jc.Cables):
            assert float(jnp.min(solution.tension[name])) > 0  # taut under the loads
            used = max(used, float(jnp.max(solution.tension[name] / group.strength)))
    assert least < used < most


def test_the_deck_of_the_bridge_ends_level(solved):
    solution = solved["bridge"][2]
    level = np.asarray(solution.phases[3].positions)[:5, 2]
    assert np.abs(level).max() < 2e-3  # of 24 m; single stages leave up to 10 mm
    assert np.abs(np.asarray(solution.phases[2].positions)[:4, 2]).max() > 5e-3
    assert [int(phase.status) for phase in solution.phases] == [0] * 5


def test_the_dome_stands_by_its_prestress_alone(solved):
    structure, _, solution = solved["dome"]
    assert np.abs(solution.phases[0].displacement).max() < 1e-6  # of rounded coordinates
    found = jc.forms.self_stress(structure)
    assert found.s == 4 and found.m == 9  # sectors - 2, sectors + 3: of Geiger domes of one ring


# --- plot


@pytest.fixture
def scenes(folder, monkeypatch, tmp_path):
    """An empty working folder with two of the scenes."""
    monkeypatch.chdir(tmp_path)
    for name in ("net.json", "mast.json"):
        Path(name).write_bytes((folder / name).read_bytes())
    return tmp_path


def test_plot_draws_what_its_options_ask_for(scenes, solved, capsys, monkeypatch):
    """Calls of `plots`, whose pictures have their own tests."""
    drawn, by_nodes = [], {len(scene[0].nodes): scene[2] for scene in solved.values()}

    def recorded(name):
        function = getattr(plots, name)

        def draw(*given, **options):
            call = inspect.signature(function).bind(*given, **options)
            call.apply_defaults()
            drawn.append((name, call.arguments))
            return Figure()

        return draw

    for name in ("net", "diagram", "sequence"):
        monkeypatch.setattr(plots, name, recorded(name))
    known = lambda structure, *_, **__: by_nodes[len(structure.nodes)]  # noqa: E731
    monkeypatch.setattr("jaxcable.cli.solving.solver.solve", known)
    plain = {"magnify": 1.0, "color": "tension", "view": None}
    use, large = {"color": "utilization"}, {"magnify": 20.0}
    for words, name, expected in (
        ("net.json", "net", plain | {"reactions": False}),
        ("net.json --of utilization", "net", plain | use),
        ("net.json --view elevation", "net", plain | {"view": "elevation"}),
        ("net.json --magnify 20", "net", plain | large),
        ("net.json --reactions", "net", plain | {"reactions": True}),
        ("net.json --sequence", "sequence", plain),
        ("net.json --sequence --magnify 20 --of utilization", "sequence", plain | use | large),
        ("mast.json --of My", "diagram", {"of": "My", "view": None}),
        ("mast.json --of Vz --view elevation", "diagram", {"of": "Vz", "view": "elevation"}),
    ):
        assert main(["plot", *words.split()]) == 0, words
        file = words.split()[0].replace(".json", ".png")
        assert capsys.readouterr() == (f"wrote {file}\n", "")
        assert Path(file).read_bytes().startswith(b"\x89PNG")
        kind, call = drawn.pop()
        assert kind == name and not drawn
        assert {key: call[key] for key in expected} == expected, words
        assert call["solution"] is by_nodes[len(call["structure"].nodes)]


def test_pictures_have_the_names_of_the_phases_of_a_scene(scenes, solved, capsys, monkeypatch):
    scene = jc.load_scene("net.json").with_phase_names(["tensioned", "under snow"])
    jc.save_scene("named.json", scene)
    monkeypatch.setattr("jaxcable.cli.solving.solver.solve", lambda *_, **__: solved["net"][2])
    assert main(["solve", *"named.json --report r.html --plot solved.svg".split()]) == 0
    assert main(["plot", *"named.json --save plot.svg".split()]) == 0
    assert main(["view", *"named.json --save view.html --no-open".split()]) == 0
    pictures = re.findall('data:image/svg[^,]*,([^"]+)', read("r.html"))
    texts = [base64.b64decode(text).decode() for text in pictures[1:2]]
    for text in (*texts, read("solved.svg"), read("plot.svg")):  # texts are in comments, too
        assert "<!-- tensioned: " in text and "<!-- under snow -->" in text
    assert len(pictures) == 2
    assert "under snow" in read("view.html")


def test_plot_lies_beside_its_scene_and_is_of_every_kind(scenes, capsys):
    Path("deep").mkdir()
    Path("net.json").rename("deep/net.json")
    assert main(["plot", "deep/net.json"]) == 0
    assert Path("deep/net.png").exists() and not Path("net.png").exists()
    assert main(["plot", "deep/net.json", "--save", "m.pdf"]) == 0
    assert main(["plot", *"deep/net.json --sequence --magnify 20 --save s.svg".split()]) == 0
    assert Path("m.pdf").read_bytes().startswith(b"%PDF")
    assert "</svg>" in read("s.svg") and "displacements x 20" in read("s.svg")
    told = [f"wrote {Path(name)}\n" for name in ("deep/net.png", "m.pdf", "s.svg")]
    assert capsys.readouterr() == ("".join(told), "")


def test_plot_names_what_it_cannot_draw(scenes, capsys):
    for words, message in (
        ("net.json --of My", "net.json: solution: has no beams"),
        ("net.json --of beauty", "color = 'beauty': expected one of"),
        ("mast.json --of My --sequence", "--sequence: not for diagrams"),
        ("mast.json --of My --magnify 2", "--magnify: not for diagrams"),
        ("mast.json --of My --reactions", "--reactions: not for diagrams"),
        ("mast.json --of My --one-scale", "--one-scale: not for diagrams"),
        ("net.json --sequence --reactions", "--reactions: not with --sequence"),
        ("net.json --save p.doc", "--save p.doc: expected a name that ends with .png"),
        ("none.json", "none.json: No such file or directory"),
    ):
        assert main(["plot", *words.split()]) == 2, words
        assert message in one_line(capsys.readouterr().err)
    text = Path("net.json").read_text(encoding="utf-8").replace("-3e3]", "-1e30]")
    Path("net.json").write_text(text, encoding="utf-8")
    assert main(["plot", "net.json"]) == 1
    assert "jaxcable: net.png: not drawn: the analysis failed" in capsys.readouterr().err
    assert not Path("net.png").exists()
