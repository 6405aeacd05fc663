"""The page of `plots.view` in a browser: picking, phases, keys, dark and narrow, without errors.

Without a browser these tests are skipped, unless JAXCABLE_BROWSER asks for one.
"""

import contextlib
import os

import browser
import numpy as np
import pytest
import scenes
from extensions.own_membrane import Membranes, sheet
from oracles.convergence import converged

import jaxcable as jc

pytestmark = pytest.mark.skipif(
    browser.found() is None and not os.environ.get("JAXCABLE_BROWSER"), reason="no browser"
)
UNITS = {"N": 1.0, "kN": 1e3, "MN": 1e6, "m": 1.0, "N m": 1.0, "kN m": 1e3, "": 1.0}


@pytest.fixture(scope="module")
def chromium():
    with browser.started() as own:
        yield own


@pytest.fixture(scope="module")
def net(tmp_path_factory):
    structure, phases = jc.scenes.hypar_net()
    solution = converged(jc.solve(structure, phases))
    path = tmp_path_factory.mktemp("view") / "net.html"
    return solution, jc.plots.view(solution, path, structure=structure).path


@pytest.fixture
def page(chromium, net):
    with browser.opened(chromium, net[1]) as page:
        yield page
        assert page.faults == []


def click(page, kind, number):
    """Click on an element or a node."""
    x, y, _ = page.evaluate("([kind, number]) => view.place(kind, number)", [kind, number])
    box = page.locator("#canvas").bounding_box()
    page.mouse.click(box["x"] + x, box["y"] + y)


def values(page):
    """What the panel shows: its heading, and numbers in SI units (texts otherwise) by name."""
    found = {}
    for row in page.locator("#picked-values tr").all():
        name = row.locator("th").inner_text()
        texts = row.locator("td").inner_text().replace("\u2212", "-").split("\n")
        try:
            parts = [text.partition(" ") for text in texts]
            found[name] = np.squeeze([float(word) * UNITS[unit] for word, _, unit in parts])
        except (ValueError, KeyError):
            found[name] = texts[0]
    return page.locator("#picked-name").inner_text(), found


def choose(page, control, value):
    """Put a control to a value, as a user does."""
    page.locator(f"#{control}").evaluate(
        """(node, value) => {
            node.value = value;
            node.dispatchEvent(new Event(node.tagName === "SELECT" ? "change" : "input"));
        }""",
        str(value),
    )


@pytest.mark.slow
def test_a_node_tells_its_numbers(page, net):
    solution = net[0]
    loaded = int(np.abs(np.asarray(solution.load)[:, 2]).argmax())
    click(page, "node", loaded)
    name, found = values(page)
    assert name == f"Node {loaded}"
    place = np.asarray(solution.positions)[loaded]
    np.testing.assert_allclose(found["x, y, z"], place, atol=1e-4)
    moved = np.asarray(solution.phases[1].displacement_in_phase)[loaded]
    np.testing.assert_allclose(found["displacement in this phase"], moved, rtol=1e-3, atol=1e-8)
    np.testing.assert_allclose(found["load"], np.asarray(solution.load)[loaded], rtol=1e-4)
    held = int(np.abs(np.asarray(solution.reactions)[:, 2]).argmax())
    click(page, "node", held)
    expected = np.asarray(solution.reactions)[held]
    np.testing.assert_allclose(values(page)[1]["reaction"], expected, rtol=1e-3)


def test_the_slider_goes_through_phases(page, net):
    solution = net[0]
    click(page, "element", 3)
    assert page.locator("#when").inner_text() == "Phase 2, increment 10, load factor 1.00"
    choose(page, "phase", 1)
    assert "Phase 1" in page.locator("#when").inner_text()
    expected = float(solution.phases[0].tension[3])
    assert values(page)[1]["tension"] == pytest.approx(expected, rel=1e-4)
    shots = page.evaluate("view.model.shots")
    choose(page, "shot", len(shots) - 2)
    number = shots[-2]["number"] - 1
    assert shots[-2]["phase"] == 2
    expected = float(solution.phases[1].path.tension[number, 3])
    assert values(page)[1]["tension"] == pytest.approx(expected, rel=1e-4)


@pytest.mark.slow
def test_keys(page):
    angle = "view.camera.azimuth"
    before = page.evaluate(angle)
    page.keyboard.press("ArrowLeft")
    assert page.evaluate(angle) != before
    span = page.evaluate("view.camera.span")
    page.keyboard.press("+")
    assert page.evaluate("view.camera.span") == pytest.approx(span / 1.15)
    page.keyboard.press("z")
    assert page.evaluate("view.camera.elevation") == pytest.approx(np.pi / 2)
    page.keyboard.press("0")
    assert page.evaluate(angle) == pytest.approx(before)
    assert page.evaluate("view.camera.span") == pytest.approx(span)
    page.keyboard.press(" ")
    assert page.locator("#play").get_attribute("aria-label") == "Pause"
    browser.until(page, "view.shown.shot > 2")
    page.keyboard.press(" ")
    assert page.locator("#play").get_attribute("aria-label") == "Play"


@pytest.mark.slow
def test_mouse_turns_moves_and_enlarges(page):
    box = page.locator("#canvas").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    angle, span = page.evaluate("[view.camera.azimuth, view.camera.span]")
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 60, y)
    page.mouse.up()
    assert page.evaluate("view.camera.azimuth") < angle
    assert page.locator("#picked").is_hidden()  # a drag is no click
    target = page.evaluate("view.camera.target[0]")
    page.keyboard.down("Shift")
    page.mouse.down()
    page.mouse.move(x, y)
    page.mouse.up()
    page.keyboard.up("Shift")
    assert page.evaluate("view.camera.target[0]") != target
    page.mouse.wheel(0, -200)
    browser.until(page, f"view.camera.span < {span}")


def brightness(page):
    """Mean of the pixels of the canvas, and how many differ from its corner."""
    return page.evaluate(
        """() => {
            const gl = document.getElementById("canvas").getContext("webgl2");
            const [w, h] = [gl.drawingBufferWidth, gl.drawingBufferHeight];
            const p = new Uint8Array(4 * w * h);
            view.paint();
            gl.readPixels(0, 0, w, h, gl.RGBA, gl.UNSIGNED_BYTE, p);
            let sum = 0, other = 0;
            for (let i = 0; i < p.length; i += 4) {
                sum += p[i];
                if (Math.abs(p[i] - p[0]) + Math.abs(p[i + 1] - p[1]) > 40) other++;
            }
            return [sum / (p.length / 4), other];
        }"""
    )


def test_dark_by_preference_and_by_button(chromium, net):
    with browser.opened(chromium, net[1], color_scheme="dark") as page:
        dark, drawn = brightness(page)
        assert dark < 60 and drawn > 1000
        page.locator("#theme").click()
        light, drawn = brightness(page)
        assert light > 200 and drawn > 1000
        assert page.faults == []


@pytest.mark.slow
def test_beams_and_all_that_can_be_shown(chromium, tmp_path):
    structure, phases = jc.scenes.guyed_mast()
    solution = jc.solve(structure, phases)
    page = jc.plots.view(solution, tmp_path / "mast.html", structure=structure)
    with browser.opened(chromium, page.path) as own:
        for name in ("nodes", "loads", "reactions", "axes"):
            before = brightness(own)[1]
            own.locator(f"#{name}").check()
            assert brightness(own)[1] != before, name
        for name in ("N", "Vy", "Vz", "T", "My", "Mz"):
            choose(own, "diagram", name)
            assert f"largest {name}" in own.locator("#keys").inner_text()
        for label in own.evaluate("view.model.columns.map(c => c.label)"):
            choose(own, "color", label)
            assert own.locator("#bar-name").inner_text()
        assert own.faults == []


def test_faces_are_filled_and_picked(chromium, tmp_path):
    nodes, triangles = sheet(3)
    rim = np.flatnonzero(((nodes[:, :2] == 0) | (nodes[:, :2] == 1)).any(axis=1))
    structure = jc.Structure(nodes, Membranes(triangles, 1e4), jc.pinned(rim))
    solution = jc.solve(structure, jc.Phase(prestrain=0.01))
    page = jc.plots.view(solution, tmp_path / "sheet.html", structure=structure)
    with browser.opened(chromium, page.path) as own:
        own.locator("#supports").uncheck()
        own.locator("#ghost").uncheck()
        filled = brightness(own)[1]
        click(own, "element", 7)
        name, found = values(own)
        assert name == "Element 7" and found["state"] == "active"
        assert found["membrane forces xx"] == "100 N/m"  # E t times the prestrain
        own.locator("#picked-close").click()
        own.evaluate("view.model.get('looks').fill(4)")
        choose(own, "shot", 0)
        assert brightness(own)[1] < 0.05 * filled
        assert own.faults == []


def test_without_webgl_it_says_so(chromium, net):
    context = chromium.new_context()
    page = context.new_page()
    page.add_init_script("HTMLCanvasElement.prototype.getContext = () => null")
    page.goto(net[1].as_uri())
    assert "WebGL" in page.locator("#message").inner_text()
    context.close()


@contextlib.contextmanager
def phone(chromium, path):
    """The page on a phone, with fingers: a function that puts them at places on the canvas."""
    options = {"has_touch": True, "is_mobile": True, "device_scale_factor": 2}
    with browser.opened(chromium, path, size=(390, 760), **options) as page:
        session = page.context.new_cdp_session(page)
        box = page.locator("#canvas").bounding_box()

        def touch(kind, *fingers):
            points = [
                {"x": box["x"] + x, "y": box["y"] + y, "id": k} for k, (x, y) in enumerate(fingers)
            ]
            session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

        yield page, touch, (box["width"] / 2, box["height"] / 2)
        assert page.faults == []


CAMERA = "[view.camera.azimuth, view.camera.elevation, view.camera.span, ...view.camera.target]"


@pytest.mark.slow
def test_a_menu_one_finger_turns_and_a_tap_picks(chromium, net):
    with phone(chromium, net[1]) as (page, touch, (x, y)):
        assert page.evaluate("document.documentElement.scrollWidth") <= 390
        assert page.locator("#side").is_hidden()
        page.locator("#menu").tap()
        assert page.locator("#side").is_visible() and page.locator("#color").is_visible()
        page.locator("#menu").tap()
        before = page.evaluate(CAMERA)
        touch("touchStart", (x, y))
        for step in (20, 40, 60):
            touch("touchMove", (x + step, y + step / 2))
        touch("touchEnd")
        page.wait_for_timeout(100)  # moves come with the pictures
        azimuth, elevation, *others = page.evaluate(CAMERA)
        # half a turn in some 500 px, see `camera.js`: 0.0065 rad a pixel
        assert azimuth == pytest.approx(before[0] - 0.0065 * 60, abs=1e-6)
        assert elevation == pytest.approx(before[1] + 0.0065 * 30, abs=1e-6)
        assert others == before[2:]
        assert page.locator("#picked").is_hidden()  # that was no tap
        x, y, _ = page.evaluate("view.place('element', 3)")
        touch("touchStart", (x, y))
        touch("touchEnd")
        assert values(page)[0] == "Element 3"


@pytest.mark.slow
def test_two_fingers_enlarge_and_move(chromium, net):
    with phone(chromium, net[1]) as (page, touch, (x, y)):
        before = page.evaluate(CAMERA)
        touch("touchStart", (x - 40, y))
        touch("touchStart", (x - 40, y), (x + 40, y))
        for apart in (50, 60, 80):
            touch("touchMove", (x - apart, y), (x + apart, y))
        browser.until(page, f"Math.abs(view.camera.span - {before[2] / 2}) < 1e-6")
        azimuth, elevation, span, *target = page.evaluate(CAMERA)
        # twice as far apart: half as much is seen, and the middle stays where it was
        assert span == pytest.approx(before[2] / 2, rel=1e-6)
        assert [azimuth, elevation] == before[:2]
        height = page.evaluate("document.getElementById('canvas').clientHeight")
        pixel = span / height  # places of fingers are whole pixels of the canvas
        np.testing.assert_allclose(target, before[3:], atol=pixel)
        for move in (10, 30):
            touch("touchMove", (x - 80 + move, y), (x + 80 + move, y))
        page.wait_for_timeout(100)  # moves come with the pictures
        right = page.evaluate("view.camera.directions()[0]")
        moved = np.array(page.evaluate(CAMERA)[3:]) - target
        np.testing.assert_allclose(moved, -30 * pixel * np.array(right), atol=pixel)
        touch("touchEnd")
        assert page.locator("#picked").is_hidden()
        # the page itself has not been enlarged or moved
        assert page.evaluate("[visualViewport.scale, scrollX, scrollY]") == [1, 0, 0]
        touch("touchStart", (x, y))  # and one finger turns again
        touch("touchMove", (x + 30, y))
        touch("touchEnd")
        page.wait_for_timeout(100)
        assert page.evaluate(CAMERA)[0] == pytest.approx(azimuth - 0.0065 * 30, abs=1e-6)


def test_a_segment_of_a_cable_with_friction_tells_its_tension(chromium, tmp_path):
    structure, phases = scenes.saddle_stay(increments=2)
    solution = converged(jc.solve(structure, phases))
    path = jc.plots.view(solution, tmp_path / "stay.html", structure=structure).path
    with browser.opened(chromium, path) as page:
        choose(page, "phase", 2)
        click(page, "element", 1)  # the middle of the stay is in its second segment
        found = values(page)[1]
        expected = solution.phases[1].element_results["segment_tension"]["stay"][0, 1]
        assert found["tension of this segment"] == pytest.approx(float(expected), rel=1e-4)
        mean = float(solution.phases[1].tension["stay"][0])
        assert found["tension"] == pytest.approx(mean, rel=1e-4)
        assert page.faults == []
