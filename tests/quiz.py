"""Draw functions and classes of the package at random, for a reader who has never seen it.

A name explains itself if the reader can say from it and the signature what is done; a docstring, if
the reader can say so after having read it once. The first part prints names only, so that they are
guessed before the second part is read, in the same order, with docstrings.

    python tests/quiz.py 7                 # names of the draw with seed 7
    python tests/quiz.py 7 --docstrings    # its docstrings
    python tests/quiz.py --words           # words of all names, and sentences of all docstrings
"""

from __future__ import annotations

import argparse
import ast
import collections
import pathlib
import random
import re
from typing import NamedTuple

PACKAGE = pathlib.Path(__file__).parents[1] / "jaxcable"


class Definition(NamedTuple):
    """A function, method or class: where it is, its name, its signature and its docstring."""

    module: str
    name: str
    signature: str
    docstring: str

    @property
    def private(self) -> bool:
        """Whether only its own module, or its own class, may use it."""
        return any(part.startswith("_") for part in self.name.split("."))


def definitions(package: pathlib.Path = PACKAGE) -> list[Definition]:
    """All functions, methods and classes that are not nested in functions, in order of files."""
    found = []
    for path in sorted(package.rglob("*.py")):
        module = ".".join(path.relative_to(package.parent).with_suffix("").parts)
        found += _defined_in(ast.parse(path.read_text()), module, "")
    return found


def _defined_in(parent, module, prefix):
    """Definitions directly in a module or class; special methods are left out."""
    found = []
    for node in parent.body:
        if isinstance(node, ast.FunctionDef) and not node.name.startswith("__"):
            marks = [ast.unparse(d) for d in node.decorator_list]
            kept = [f"@{mark} " for mark in marks if mark in ("property", "classmethod")]
            returns = f" -> {ast.unparse(node.returns)}" if node.returns else ""
            signature = f"({ast.unparse(node.args)}){returns}"
            text = ast.get_docstring(node) or ""
            found.append(Definition(module, prefix + node.name, signature, text))
            if kept:
                found[-1] = found[-1]._replace(signature=f"{signature}  [{kept[0].strip()}]")
        elif isinstance(node, ast.ClassDef):
            bases = ", ".join(map(ast.unparse, node.bases))
            text = ast.get_docstring(node) or ""
            found.append(Definition(module, prefix + node.name, f": class({bases})", text))
            found += _defined_in(node, module, f"{prefix}{node.name}.")
    return found


def draw(seed: int, count: int = 60) -> list[Definition]:
    """The definitions of a seed, drawn without putting back."""
    return random.Random(seed).sample(definitions(), count)


def report_words() -> str:
    """Names that are defined in several modules, and the mean length of a docstring's sentence."""
    everything = definitions()
    modules = collections.defaultdict(set)
    for one in everything:
        if "." not in one.name:
            modules[one.name].add(one.module)
    several = {name: where for name, where in modules.items() if len(where) > 1}
    ranked = sorted(several, key=lambda name: (-len(several[name]), name))
    lines = [f"{len(everything)} definitions, {sum(one.private for one in everything)} private"]
    lines.append(f"{len(several)} names of functions or classes stand in several modules:")
    lines += [f"  {name}: {len(several[name])}" for name in ranked[:30]]
    sentences = [
        sentence.split()
        for one in everything
        for paragraph in one.docstring.split("\n\n")
        for sentence in re.split(r"(?<=[.;:?])\s", paragraph)
        if len(sentence.split()) > 2 and ">>>" not in paragraph
    ]
    mean = sum(map(len, sentences)) / len(sentences)
    lines.append(f"{len(sentences)} sentences and clauses of docstrings, {mean:.1f} words in each")
    return "\n".join(lines)


def main() -> None:
    """Print what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("seed", type=int, nargs="?", default=0)
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--docstrings", action="store_true")
    parser.add_argument("--words", action="store_true")
    given = parser.parse_args()
    if given.words:
        print(report_words())
        return
    for number, one in enumerate(draw(given.seed, given.count), 1):
        print(f"{number:2}. {one.module}: {one.name}{one.signature}")
        if given.docstrings:
            print("\n".join(f"      {line}" for line in one.docstring.splitlines()), end="\n\n")


if __name__ == "__main__":
    main()
