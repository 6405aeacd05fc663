"""`plots.view`: the numbers in the page are those of the solution."""

import base64
import json
import re

import jax
import numpy as np
import pytest
import scenes
from oracles.convergence import converged

import jaxcable as jc
from jaxcable.__main__ import main

KINDS = {"f": "<f4", "u": "<u4", "b": "u1"}
SINGLE = 2e-7  # relative, rounding of float32


def decoded(page):
    """The description in a page, and its arrays by name, read independently of the page."""
    told = json.loads(re.search(r'id="data">(.*?)</script>', page.html, re.S)[1])
    block = base64.b64decode(re.search(r'id="bytes">(.*?)</script>', page.html, re.S)[1])
    arrays = {}
    for name, (kind, offset, shape) in told["arrays"].items():
        values = np.frombuffer(block, KINDS[kind], count=int(np.prod(shape)), offset=offset)
        arrays[name] = values.reshape(shape)
    for column in told["columns"]:
        arrays[column["label"]] = arrays[column["array"]]
    return told, arrays


def solved(structure, phases):
    return structure, phases, converged(jc.solve(structure, phases))


def shown(solution, structure, **options):
    return decoded(jc.plots.view(solution, None, structure=structure, **options))


@pytest.fixture(scope="module")
def hypar():
    return solved(*jc.scenes.hypar_net())


@pytest.fixture(scope="module")
def flat():
    return solved(*jc.scenes.flat_net(load=15.0))


def test_numbers_are_those_of_the_solution(hypar, tmp_path):
    structure, _, solution = hypar
    page = jc.plots.view(solution, tmp_path / "net.html", structure=structure, title="a <net>")
    assert page.path.read_text(encoding="utf-8") == page.html
    told, arrays = decoded(page)
    assert told["title"] == "a <net>" and "<title>a &lt;net&gt;</title>" in page.html
    place = np.array(told["origin"]) + arrays["start"] + arrays["moved"][-1].astype(float)
    extent = np.ptp(np.asarray(solution.positions), axis=0).max()
    np.testing.assert_allclose(place, solution.positions, atol=SINGLE * extent)
    ends = [k for k, shot in enumerate(told["shots"]) if shot["end"]]
    assert len(ends) == 2 and ends[-1] == len(told["shots"]) - 1
    for row, (k, phase) in enumerate(zip(ends, solution.phases, strict=True)):
        np.testing.assert_allclose(arrays["tension"][k], phase.tension, rtol=SINGLE)
        loads = np.zeros((len(place), 3))
        loads[arrays["loaded"]] = arrays["load"][row]
        np.testing.assert_allclose(loads, phase.load, rtol=SINGLE)
    path = solution.phases[1].path
    for shot in (shot for shot in told["shots"] if shot["phase"] == 2):
        assert shot["factor"] == pytest.approx(float(path.load_factor[shot["number"] - 1]))
    assert set(arrays["loaded"]) == set(np.flatnonzero(np.asarray(solution.load).any(axis=1)))
    np.testing.assert_allclose(arrays["rest_length"][1], solution.rest_length, rtol=SINGLE)
    reactions = np.asarray(solution.reactions)[arrays["held"]]
    np.testing.assert_allclose(arrays["reactions"][1], reactions, rtol=1e-6)
    for frames in (1, 7):  # only so many increments, and all ends
        told, arrays = shown(solution, structure, frames=frames)
        assert len(told["shots"]) == max(frames, 2) == len(arrays["moved"])
        assert [s["end"] for s in told["shots"]].count(True) == 2


def test_far_from_the_origin_displacements_keep_their_digits(flat):
    structure, phases, _ = flat
    far = jc.replace(structure, nodes=np.asarray(structure.nodes) + 1e6)
    solution = solved(far, phases)[2]
    _, arrays = shown(solution, None)
    np.testing.assert_allclose(arrays["moved"][-1], solution.displacement, rtol=1e-6, atol=1e-9)


def test_beams_are_bent_as_their_ends_turn():
    """A cantilever: the tip's slope is P L^2 / 2 EI, and its diagram of moments a straight line."""
    length, load = 2.0, 100.0
    section = jc.Section.rectangle(0.04, 0.1, jc.Elastic(20e9))
    beam = jc.Beams([[0, 1]], section=section)
    nodes = [[0.0, 0.0, 0.0], [length, 0.0, 0.0]]
    structure = jc.Structure(nodes, beam, supports=jc.clamped([0]))
    phase = jc.Phase(loads=jc.NodalLoads([1], (0.0, 0.0, -load)), increments=4)
    told, arrays = shown(solved(structure, phase)[2], structure)
    stiffness = 20e9 * 0.04 * 0.1**3 / 12
    tip, slope = load * length**3 / (3 * stiffness), load * length**2 / (2 * stiffness)
    chord = tip / length
    for k, part in enumerate((0.25, 0.5, 0.75, 1.0)):  # slopes against the chord, times its length
        expected = part * length * np.array([chord, chord - slope])
        np.testing.assert_allclose(arrays["bend"][k, 0, :, 2], expected, rtol=1e-4)
    places = np.linspace(0.0, 1.0, arrays["diagrams"].shape[2])
    moment = np.abs(arrays["diagrams"][0, 0, :, 4])
    np.testing.assert_allclose(moment, load * length * (1 - places), rtol=1e-4, atol=1e-3)
    assert arrays["largest My"][-1] == pytest.approx(load * length, rel=1e-4)
    assert np.isnan(arrays["largest My"][0]) and told["shots"][0]["factor"] == 0.25
    np.testing.assert_allclose(arrays["axes"][0, 0], [[0, 1, 0], [0, 0, 1]], atol=1e-3)


@pytest.mark.slow
def test_diagrams_of_beams_that_turn_far():
    structure, _, solution = solved(*scenes.toggle_frame())
    _, arrays = shown(solution, structure)
    n = arrays["diagrams"].shape[2]
    exact = np.concatenate(jax.tree.leaves(jc.section_forces(structure, solution, n)))
    forces, moments = np.abs(exact[..., :3]).max(), np.abs(exact[..., 3:]).max()
    error = np.abs(arrays["diagrams"][-1] - exact)  # see `results.between`
    assert error[..., :3].max() < 1e-3 * forces and error[..., 3:].max() < 1e-3 * moments


@pytest.mark.slow
def test_catenaries_hang_in_every_phase():
    structure, phases, solution = solved(*scenes.suspended_cable())
    _, arrays = shown(solution, structure)
    n = arrays["sag"].shape[2] + 2
    parts = np.linspace(0, 1, n)[1:-1, None]
    for k in range(len(phases)):
        alone = solved(structure, phases[: k + 1])[2]
        curve = np.asarray(jax.tree.leaves(jc.forms.catenary_curves(structure, alone, n))[0])
        chord = (1 - parts) * curve[:, :1] + parts * curve[:, -1:]
        np.testing.assert_allclose(arrays["sag"][k], curve[:, 1:-1] - chord, atol=1e-5)


def test_a_failed_analysis_shows_what_converged(flat):
    structure, phases, _ = flat
    few = jc.Newton(max_steps=1)
    failed = jc.solve(structure, phases, few)
    assert int(failed.status) != 0
    with pytest.raises(ValueError, match="solution: has no converged increment"):
        jc.plots.view(jc.solve(structure, phases[1:], few), None)
    told, arrays = shown(failed, structure)
    assert [shot["phase"] for shot in told["shots"]] == [1] and "did not finish" in told["note"]
    np.testing.assert_allclose(arrays["tension"][0], failed.last.tension, rtol=SINGLE)


def test_a_truss_that_snaps_through_shows_its_way_there():
    """A load beyond the limit: the slider ends within the phase, with the loads of that factor."""
    structure, phases = jc.scenes.von_mises_truss(rise=0.1, load=500.0)
    phases = [jc.replace(phases[0], increments=20)]
    failed = jc.solve(structure, phases, jc.Newton(max_steps=4))
    last = failed.last
    assert int(failed.status) != 0 and 0 < float(last.load_factor) < 1
    told, arrays = shown(failed, structure)
    shot = told["shots"][-1]
    assert shot["end"] and shot["factor"] == pytest.approx(float(last.load_factor))
    assert f"load factor {float(last.load_factor):.3g}" in told["note"]
    load = arrays["load"][-1, list(arrays["loaded"]).index(1), 2]
    assert load == pytest.approx(-500.0 * shot["factor"], rel=SINGLE)


def test_page_needs_nothing_else_and_texts_cannot_break_it(flat):
    structure, phases, _ = flat
    evil = "</script><script>alert(1)</script>"
    named = jc.replace(structure, elements={evil: structure.elements})
    page = jc.plots.view(solved(named, phases)[2], None, structure=named, title=evil)
    assert page.path is None and page.html.count("</script>") == 3
    for word in ("http://", "https://", "src=", "import("):
        assert word not in page.html.replace("http://www.w3.org/2000/svg", "")
    frame = page._repr_html_()
    assert frame.startswith("<iframe") and "<script" not in frame


def test_command_writes_and_opens_it(tmp_path, monkeypatch, capsys):
    opened = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    scene, out = tmp_path / "net.json", tmp_path / "seen.html"
    jc.save_scene(scene, jc.scenes.flat_net())
    assert main(["view", str(scene), "--save", str(out)]) == 0
    assert opened == [out.resolve().as_uri()] and f"wrote {out}" in capsys.readouterr().out
    assert main(["view", str(scene), "--save", str(out), "--no-open", "--quiet"]) == 0
    assert len(opened) == 1 and capsys.readouterr().out == ""
    assert main(["view", str(scene), "--save", str(tmp_path / "x.png")]) == 2
    assert "--save" in capsys.readouterr().err
