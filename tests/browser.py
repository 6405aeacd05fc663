"""A headless Chromium for tests and measurements of pages, drawn without a graphics card."""

import contextlib
import os
import shutil
import time

NAMES = ("chromium", "chromium-browser", "google-chrome")
FLAGS = [
    "--no-sandbox",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
    "--disable-component-update",
    "--no-first-run",
]


def found():
    """Path of a browser, or None; JAXCABLE_BROWSER may be a path itself."""
    asked = os.environ.get("JAXCABLE_BROWSER", "")
    paths = [asked] if os.path.isfile(asked) else []
    return next(iter([*paths, *filter(None, map(shutil.which, NAMES))]), None)


@contextlib.contextmanager
def started():
    """A running browser."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=found(), headless=True, args=FLAGS)
        yield browser
        browser.close()


def until(page, expression, limit=30.0):
    """Wait for a condition in a page; its policy forbids to send functions, as libraries do."""
    end = time.monotonic() + limit
    while not page.evaluate(expression):
        assert time.monotonic() < end, expression
        page.wait_for_timeout(20)


@contextlib.contextmanager
def opened(browser, path, size=(1000, 640), **options):
    """A page, which collects in `faults` what must not be: errors, warnings and requests."""
    width, height = size
    context = browser.new_context(viewport={"width": width, "height": height}, **options)
    page = context.new_page()
    page.faults = []

    def note(kind, text):
        # a slow driver tells that reading pixels takes time, on a machine that does other work
        if "GPU stall due to ReadPixels" not in str(text):
            page.faults.append(f"{kind}: {text}")

    page.on("pageerror", lambda error: note("error", error))
    page.on("console", lambda m: m.type in ("error", "warning") and note(m.type, m.text))
    page.on("request", lambda r: r.url.startswith(("file:", "data:")) or note("request", r.url))
    page.goto(path.as_uri())
    until(page, "!!window.view")
    yield page
    context.close()
