"""Natural modes as pictures, and as moving shapes on the page."""

import browser
import numpy as np
import pytest
from oracles.convergence import converged
from test_view import decoded

import jaxcable as jc


@pytest.fixture(scope="module")
def vibrating():
    """The flat net under its loads, with masses, and its first three modes."""
    structure, phases = jc.scenes.flat_net()
    solution = converged(jc.solve(structure, phases))
    return structure, solution, converged(jc.dynamics.modes(structure, solution, n=3, masses=3.0))


def test_pictures_of_modes(vibrating, tmp_path):
    structure, solution, found = vibrating
    options = {"structure": structure, "n": 2}
    figure = jc.plots.mode_shapes(found, solution, tmp_path / "modes.png", **options)
    axes = figure.axes[:2]
    titles = [f"mode {k + 1}: {found.frequency[k]:.3g} Hz" for k in range(2)]
    assert [own.get_title() for own in axes] == titles and all(own.name == "3d" for own in axes)
    assert (tmp_path / "modes.png").stat().st_size > 5_000
    texts = [text.get_text() for legend in figure.legends for text in legend.get_texts()]
    assert "at rest" in texts and len(figure.axes) == 2  # forces have no colors in a mode
    colored = jc.plots.mode_shapes(found, solution, color="tension", **options)
    assert len(colored.axes) == 3  # with the color bar
    in_plane = jc.plots.mode_shapes(found, solution, n=1, view="plan", phase=0)
    assert in_plane.axes[0].name == "rectilinear"
    with pytest.raises(ValueError, match=r"modes: has shapes \(3, 2, 3\); expected \[n, 12, 3\]"):
        jc.plots.mode_shapes(jc.replace(found, shape=found.shape[:, :2]), solution)


def test_the_page_moves_them(vibrating):
    """A period of each mode in 24 instants about the state, which is the initial geometry there."""
    structure, solution, found = vibrating
    told, arrays = decoded(jc.plots.view(solution, None, structure=structure, modes=found))
    assert told["repeats"] and len(told["shots"]) == 72 and len(told["phases"]) == 3
    assert told["phases"][0] == f"mode 1: {found.frequency[0]:.3g} Hz"
    start = arrays["start"] + np.array(told["origin"])
    np.testing.assert_allclose(start, solution.positions, atol=1e-6)
    peaks = arrays["moved"].reshape(3, 24, -1, 3)
    extent = np.ptp(np.asarray(solution.positions), axis=0).max()
    np.testing.assert_allclose(peaks[:, -1], 0.08 * extent * found.shape, atol=1e-6)
    np.testing.assert_allclose(peaks[:, 11], -peaks[:, -1], atol=1e-6)


@pytest.mark.slow
@pytest.mark.skipif(browser.found() is None, reason="no browser")
def test_playing_repeats_the_period(vibrating, tmp_path):
    structure, solution, found = vibrating
    path = tmp_path / "modes.html"
    jc.plots.view(solution, path, structure=structure, modes=found)
    with browser.started() as chromium, browser.opened(chromium, path) as page:
        assert page.locator("#when").inner_text().startswith("mode 1: ")
        page.locator("#play").click()
        browser.until(page, "view.shown.shot < 12")
        browser.until(page, "view.shown.shot > 20")
        assert page.evaluate("view.model.shots[view.shown.shot].phase") == 1
        assert page.faults == []
