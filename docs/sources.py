"""The sources of the site, in one folder: pages of `docs`, and what they show of the repository.

    python docs/sources.py FOLDER

Notebooks, results, and pages of other folders with their links; help texts of commands; live pages.
"""

import io
import re
import shutil
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
SOURCE = "https://github.com/jaxcable/jaxcable/blob/main"
LINK = re.compile(r"(?<=\]\()(?!https?:|#)([^)\s#]+)(#[^)\s]*)?(?=\))")
BADGE = re.compile(r"!\[([^\]]*)\]\([^)]*badge.svg\)")  # the site asks no other host for pictures
PAGES = {  # links to these become links to pages of the site
    "experiments/README.md": "validation.md",
    "CHANGELOG.md": "changelog.md",
    "README.md": "index.md",
}


def with_links_of_the_site(text, folder):
    """Rewrite the links of a Markdown text of `folder`, relative to the root, for the site.

    Results and pages are links within the site, anything else is a link to the repository.
    """

    def rewrite(found):
        target = (ROOT / folder / found[1]).resolve()
        name, anchor = target.relative_to(ROOT).as_posix(), found[2] or ""
        if name.startswith("experiments/results/"):
            return name.removeprefix("experiments/") + anchor
        if name in PAGES and not (name == "README.md" and anchor):
            return PAGES[name] + anchor
        if name.startswith("notebooks/"):
            return name + anchor
        return f"{SOURCE}/{name}{anchor}"

    return LINK.sub(rewrite, text)


def copy_pages(made):
    """Copy pages, notebooks and results, and pages whose links are rewritten."""
    shutil.rmtree(made, ignore_errors=True)
    scripts = shutil.ignore_patterns("__pycache__", "check_site.py", "sources.py")
    shutil.copytree(HERE, made, ignore=scripts)
    (made / "notebooks").mkdir()
    (made / "parts").mkdir()
    for path in sorted((ROOT / "notebooks").glob("*.ipynb")):
        text = BADGE.sub(r"\1", path.read_text(encoding="utf-8"))
        (made / "notebooks" / path.name).write_text(text, encoding="utf-8")
    results = ROOT / "experiments" / "results"
    shutil.copytree(results, made / "results", ignore=shutil.ignore_patterns("*.json"))
    for name, folder, page in (
        ("experiments/README.md", "experiments", "validation.md"),
        ("CHANGELOG.md", "", "changelog.md"),
        ("README.md", "", "parts/readme.md"),
    ):
        text = (ROOT / name).read_text(encoding="utf-8")
        (made / page).write_text(with_links_of_the_site(text, folder), encoding="utf-8")
    shutil.copy(ROOT / "CITATION.cff", made / "parts")


def write_commands(made):
    """Write the help texts of all commands as one page."""
    from jaxcable.cli.parser import parser

    of_commands = next(action for action in parser()._actions if isinstance(action.choices, dict))
    out = io.StringIO()
    for name, command in of_commands.choices.items():
        out.write(f"## {name}\n\n```text\n{command.format_help().strip()}\n```\n\n")
    (made / "parts" / "commands.md").write_text(out.getvalue(), encoding="utf-8")


def write_statuses(made):
    """Write the numbers, names and texts of all statuses as a table."""
    from jaxcable.common import status

    lines = ["| code | name | text |", "|---|---|---|"]
    for code, name in status.NAMES.items():
        lines.append(f"| {code} | `{name}` | {status.describe(code)} |")
    (made / "parts" / "statuses.md").write_text("\n".join(lines) + "\n", encoding="utf-8")


def write_live_pages(made):
    """Analyse some scenes, and write their interactive pages, to `extra/live`."""
    import jax

    jax.config.update("jax_enable_x64", True)
    sys.path.insert(0, str(ROOT / "experiments"))
    import scenes

    import jaxcable as jc

    place = made / "extra" / "live"
    place.mkdir(parents=True)
    for name, scene in (
        ("bridge", scenes.cable_stayed_bridge()),
        ("mast", jc.scenes.guyed_mast()),
        ("hypar", jc.scenes.hypar_net()),
        ("dome", scenes.geiger_dome()),
    ):
        structure, phases = scene
        solution = jc.solve(structure, phases)
        jc.raise_if_failed(solution)
        jc.plots.view(solution, place / f"{name}.html", structure=structure)


def main(folder):
    """Write the sources of the site into a folder, which is replaced if it is one of these."""
    made = Path(folder).resolve()
    if made.exists() and not (made / "parts" / "readme.md").exists():
        raise SystemExit(f"{folder}: is there, and no earlier one of these folders")
    copy_pages(made)
    write_commands(made)
    write_statuses(made)
    write_live_pages(made)


if __name__ == "__main__":
    main(sys.argv[1])
