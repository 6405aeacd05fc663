"""How large and how fast are interactive 3-D pages: time to write, size, first paint, frame rate?

Question   `plots.view` of nets of 10 000 and 100 000 elements: seconds to write the page, its size,
           milliseconds to the first paint of the browser and until the structure is drawn, and
           frames a second while it is rotated. Does it look right?
Reference  Requirements for 10 000 elements: written within 1 s, at most 6 MB, painted within 1 s,
           30 frames a second.
Error      none: times and sizes, with the machine; ten pictures to look at.
Command    python experiments/view.py [pictures]
           (writes experiments/results/view.txt, or results/view_*.png; needs a Chromium. It draws
           without a graphics card; with one, the frame rate is that of the screen)
"""

import sys
import tempfile
import time
from pathlib import Path

import jax
import scenes
from record import RESULTS, Record

import jaxcable as jc

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))
import browser

SIZE = (1000, 640)  # of the window, px
TURNING = """() => {
    const begin = performance.now();
    let count = 0;
    for (view.turn(); performance.now() - begin < 3000; count++) view.turn();
    return 1000 * count / (performance.now() - begin);
}"""
PAINT = "performance.getEntriesByName('first-contentful-paint')[0]?.startTime"


def written(folder, name, scene, **options):
    """The page of a scene, its solution solved, and the seconds that writing took (second call)."""
    solution = jax.block_until_ready(jc.solve(*scene))
    assert int(solution.status) == 0, name
    for _ in range(2):
        begin = time.perf_counter()
        page = jc.plots.view(solution, folder / f"{name}.html", structure=scene[0], **options)
        seconds = time.perf_counter() - begin
    return page.path, seconds


def measured(record, own, folder, n, increments):
    """A line for a net of n x n free nodes."""
    scene = jc.scenes.saddle(n, n, increments=increments)
    path, seconds = written(folder, f"net{n}", scene)
    members = len(scene[0].groups[0].links.array)
    with browser.opened(own, path, SIZE) as page:
        browser.until(page, f"{PAINT} !== undefined")
        painted, drawn = page.evaluate(f"[{PAINT}, view.drawn]")
        pictures = []
        for ghost in (False, True):
            page.evaluate(f"() => {{ {put(ghost=ghost)} }}")
            pictures.append(page.evaluate(TURNING))
        assert page.faults == []
    size = path.stat().st_size / 1e6
    line = f"{members:8d}   {seconds:8.3f}   {size:6.2f}   {painted:8.0f}   {drawn:8.0f}"
    record(f"{line}   {pictures[0]:8.1f}   {pictures[1]:8.1f}")


def study():
    record = Record("view")
    record("Saddle nets in two phases, window of 1000 x 640 px, Chromium without a graphics card\n")
    record(
        " members   write, s       MB   paint, ms   drawn, ms   pictures a second, with the other"
    )
    with tempfile.TemporaryDirectory() as folder, browser.started() as own:
        own.new_page().close()  # the browser itself has started
        for n, increments in ((22, (1, 10)), (70, (1, 10)), (223, (1, 4))):
            measured(record, own, Path(folder), n, increments)
        record(f"\n{own.browser_type.name} {own.version}, SwiftShader")
    record(
        "Layers of more than 2 000 lines are drawn one pixel wide while the picture turns, and of"
    )
    record("more than 40 000 lines a part; all of it, and smooth up to 30 000, when it rests. The")
    record(
        "geometry compared with is not drawn at first where there are more than 3 000 (last column:"
    )
    record("pictures a second with it).")
    record.close()


def put(**controls):
    """A script that puts controls to values, as a user does."""
    return "".join(
        f"""{{ const c = document.getElementById("{name.replace("_", "-")}"), v = {value!r};
        if (c.type === "checkbox") c.checked = v; else c.value = v;
        c.dispatchEvent(new Event(c.type === "range" ? "input" : "change")); }}""".replace(
            "True", "true"
        ).replace("False", "false")
        for name, value in controls.items()
    )


NARROW = {"size": (390, 720), "is_mobile": True, "has_touch": True}
PICTURES = [  # name, scene, its options, controls, what else is done, options of the window
    ("hypar", "hypar_net", {}, {"loads": True}, "", {}),
    ("mode", "hypar_net", {}, {"magnify": 50, "nodes": True}, "", {}),
    ("mast", "guyed_mast", {}, {"axes": True, "loads": True, "reactions": True}, "", {}),
    ("dome", "geiger_dome", {}, {"colour": "tension"}, "", {}),
    ("bridge", "cable_stayed_bridge", {}, {"diagram": "My"}, "", {}),
    ("bridge_dark", "cable_stayed_bridge", {}, {"diagram": "N"}, "", {"color_scheme": "dark"}),
    ("catenary", "suspended_cable", {}, {"reactions": True}, "view.look('y')", {}),
    ("picked", "guyed_mast", {}, {}, "click", {}),
    ("phone", "geiger_dome", {}, {}, "click", NARROW),
    ("large", "saddle", {"n_x": 70, "n_y": 70}, {}, "", {}),
]


def pictures():
    with tempfile.TemporaryDirectory() as folder, browser.started() as own:
        for name, scene, numbers, controls, script, options in PICTURES:
            made = scenes.EVERY[scene](**numbers)
            path, _ = written(Path(folder), name, made, title=scene.replace("_", " "))
            with browser.opened(own, path, **options) as page:
                page.evaluate(f"() => {{ {put(**controls)} }}")
                if script == "click":
                    x, y, _ = page.evaluate("view.place('element', 5)")
                    page.mouse.click(x, y)
                elif script:
                    page.evaluate(script)
                page.wait_for_timeout(500)
                page.screenshot(path=RESULTS / f"view_{name}.png")
                assert page.faults == [], name


if __name__ == "__main__":
    pictures() if "pictures" in sys.argv[1:] else study()
