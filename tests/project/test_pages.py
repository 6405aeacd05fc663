"""Pages of the site: their scripts run, print what they say, and show pictures that they made."""

import re
from pathlib import Path

import jax
import matplotlib
import pytest
from test_readme import BLOCK, run

import jaxcable as jc

DOCS = Path(__file__).parents[2] / "docs"
PAGES = sorted(
    path for path in DOCS.rglob("*.md") if re.search("^```python$", path.read_text("utf-8"), re.M)
)
TOCTREE = re.compile(r"^```\{toctree\}\n(.*?)^```$", re.M | re.S)
NAMES = [path.relative_to(DOCS).as_posix() for path in PAGES]
BY_NUMPY = "how-to/friction.md", "how-to/guyed-mast.md"
"""Pages with programs that XLA would compile for longer than NumPy needs for all of their runs."""


@pytest.fixture
def _settings_of_users():
    """The suite is stricter on shapes than jax is by itself."""
    before = jax.config.jax_numpy_rank_promotion
    jax.config.update("jax_numpy_rank_promotion", "allow")
    yield
    jax.config.update("jax_numpy_rank_promotion", before)


@pytest.mark.slow
@pytest.mark.usefixtures("_settings_of_users")
# pages show what a doubtful drawing or an unstable state says; for users that is no error either
@pytest.mark.filterwarnings("ignore::jaxcable.InputWarning", "ignore::jaxcable.UnstableWarning")
@pytest.mark.parametrize("name", NAMES)
def test_a_page_runs_and_prints_what_it_says(name, tmp_path, monkeypatch):
    matplotlib.use("Agg")
    monkeypatch.chdir(tmp_path)
    path = DOCS / name
    text = path.read_text(encoding="utf-8")
    blocks = [pair for pair in BLOCK.findall(text) if pair[0] in ("python", "sh", "text")]
    assert blocks[0][0] == "python" and "jax_enable_x64" in blocks[0][1]
    with jc.evaluation("numpy" if name in BY_NUMPY else "auto"):
        pairs = run(blocks, {"__name__": "__main__"})
    for printed, said in pairs:
        assert printed == said
    shown = re.findall(r"!\[[^\]]+\]\((pictures/[^)]+)\)", text)
    for picture in shown:
        made = picture.removeprefix(f"pictures/{path.stem}-")
        assert (tmp_path / made).stat().st_size > 5_000  # not an empty picture
        assert (path.parent / picture).stat().st_size > 5_000


def test_every_public_name_is_in_the_reference():
    text = "\n".join(path.read_text("utf-8") for path in (DOCS / "reference").glob("*.md"))
    listed = set(re.findall(r"auto(?:class|function|exception):: (\S+)", text))
    modules = "loads materials sections elements forms design paths plots reporting results scenes"
    missing = {f"jaxcable.{name}" for name in jc.__all__ if callable(getattr(jc, name))} - listed
    more = "stiffness dynamics studies files catalogue standards reliability lines masts"
    for module in [*modules.split(), *more.split()]:
        place = getattr(jc, module)
        for name in place.__all__:
            thing = getattr(place, name)
            elsewhere = getattr(jc, name, None) is thing
            if callable(thing) and not elsewhere:
                missing |= {f"jaxcable.{module}.{name}"} - listed
    assert not missing


def test_every_page_is_in_a_list_of_pages():
    """What no list names, nobody finds."""
    listed = set()
    for path in DOCS.rglob("*.md"):
        for block in TOCTREE.findall(path.read_text("utf-8")):
            for line in block.splitlines():
                if line and not line.startswith(":"):
                    listed.add((path.parent / line).relative_to(DOCS).as_posix())
    pages = {path.relative_to(DOCS).with_suffix("").as_posix() for path in DOCS.rglob("*.md")}
    assert pages - listed == {"index"}
