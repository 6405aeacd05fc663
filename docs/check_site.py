"""Open every page of the site in a browser, and follow its links.

    python docs/check_site.py build/site [--pictures FOLDER]

Errors are: a message of a page's console, something that does not load or that a page asks of
another host, a picture without size or without text for those who do not see it, a page wider than
the window of a phone, two main headings or none, a skipped level of headings, a link within the
site that leads nowhere, a search that does not find, and serious violations that axe-core finds
(contrast, names, order of headings). Prints them and exits with 1.
"""

import argparse
import contextlib
import functools
import http.server
import itertools
import sys
import threading
from pathlib import Path
from urllib.parse import urldefrag, urljoin

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests"))
import browser
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import TimeoutError

WIDE, PHONE = {"width": 1280, "height": 900}, {"width": 390, "height": 844}
LOOK = """() => ({
    links: [...document.querySelectorAll('a[href]')].map(a => a.href),
    names: [...document.querySelectorAll('[id]')].map(e => e.id),
    pictures: [...document.images].filter(i => !i.naturalWidth).map(i => i.src),
    silent: [...document.images].filter(i => !i.alt.trim()).map(i => i.src),
    levels: [...document.querySelectorAll('h1, h2, h3, h4, h5, h6')].map(h => +h.tagName[1]),
    language: document.documentElement.lang,
})"""
WIDER = "() => document.documentElement.scrollWidth - window.innerWidth"
SEARCHES = {
    "pretension": "First steps",
    "slack": "Slack cables",
    "NaturalModes": "Natural modes and gusts",
}  # a word, and what is found by it


class Quiet(http.server.SimpleHTTPRequestHandler):
    """A server of files that prints nothing."""

    def log_message(self, *_):
        pass


@contextlib.contextmanager
def served(folder):
    """Serve a folder on this machine; the address."""
    handler = functools.partial(Quiet, directory=str(folder))
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield f"http://127.0.0.1:{server.server_port}/"
    finally:
        server.shutdown()


class Check:
    """The pages that were opened, their names and links, and the errors."""

    def __init__(self, base, window):
        self.base, self.window = base, window
        self.errors, self.names, self.links = [], {}, {}
        self.page = "-"
        window.on("console", lambda m: m.type in ("error", "warning") and self.say(m.text))
        window.on("pageerror", lambda error: self.say(str(error)))
        window.on("requestfailed", self.not_loaded)
        window.on("request", self.of_this_site)
        window.on("response", lambda r: r.status >= 400 and self.say(f"{r.status}: {r.url}"))

    def say(self, text):
        self.errors.append(f"{self.page}: {text}")

    def not_loaded(self, request):
        if request.failure != "net::ERR_ABORTED":  # by leaving the page
            self.say(f"does not load: {request.url}")

    def of_this_site(self, request):
        if not request.url.startswith((self.base, "data:", "blob:")):
            self.say(f"asks another host: {request.url}")

    def open(self, name):
        self.page = name
        self.window.set_viewport_size(WIDE)
        self.window.goto(self.base + name, wait_until="load")
        seen = self.window.evaluate(LOOK)
        self.names[name], self.links[name] = set(seen["names"]), seen["links"]
        if name.startswith("live/"):
            return
        for place in seen["pictures"]:
            self.say(f"picture without size: {place}")
        for place in seen["silent"]:
            self.say(f"picture without text: {place}")
        levels = seen["levels"]
        if levels.count(1) != 1 and name != "search.html":  # made by its script
            self.say(f"{levels.count(1)} main headings")
        for above, below in itertools.pairwise(levels):
            if below > above + 1:
                self.say(f"a heading of level {below} below one of level {above}")
        if not seen["language"]:
            self.say("no language")
        for found in Axe().run(self.window).response["violations"]:
            if found["impact"] in ("serious", "critical"):
                place = found["nodes"][0]["html"][:80]
                self.say(f"{found['id']} ({len(found['nodes'])} times): {place}")
        self.window.set_viewport_size(PHONE)
        wider = self.window.evaluate(WIDER)
        if wider > 0:
            self.say(f"{wider} px wider than a phone")

    def follow_links(self, folder):
        """Links within the site: the file is there, and in pages the named place."""
        for name, links in self.links.items():
            self.page = name
            for link in set(links):
                target, anchor = urldefrag(urljoin(self.base + name, link))
                if not target.startswith(self.base):
                    continue
                path = target.removeprefix(self.base).split("?")[0] or "index.html"
                if not (folder / path).is_file():
                    self.say(f"leads nowhere: {link}")
                elif anchor and path in self.names and anchor not in self.names[path]:
                    self.say(f"no such place: {link}")

    def search(self, word, wanted):
        self.page = f"search for {word}"
        self.window.set_viewport_size(WIDE)
        self.window.goto(f"{self.base}search.html?q={word}", wait_until="load")
        found = "#search-results li"
        try:
            self.window.wait_for_selector(found, timeout=20_000)
            text = self.window.inner_text("#search-results")
            if wanted not in text:
                self.say(f"{wanted} is not found")
        except TimeoutError as error:  # a page without results is an error of the site
            self.say(str(error).splitlines()[0])


def main(words):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("site")
    parser.add_argument("--pictures", help="folder for pictures of all pages, wide and narrow")
    chosen = parser.parse_args(words)
    folder = Path(chosen.site).resolve()
    names = sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*.html"))
    names = [name for name in names if not name.startswith("_")]
    if not names:
        raise SystemExit(f"{folder}: no pages")
    with served(folder) as base, browser.started() as program:
        check = Check(base, program.new_page())
        for name in names:
            check.open(name)
            if chosen.pictures:
                for kind, size in (("wide", WIDE), ("phone", PHONE)):
                    check.window.set_viewport_size(size)
                    path = Path(chosen.pictures) / f"{name.replace('/', '-')[:-5]}-{kind}.png"
                    check.window.screenshot(path=path)
        check.follow_links(folder)
        for word, wanted in SEARCHES.items():
            check.search(word, wanted)
    print("\n".join(check.errors) or f"{len(names)} pages, no errors")
    return min(len(check.errors), 1)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
