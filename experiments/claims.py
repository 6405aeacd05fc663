"""Do README and the tables of experiments say what the result files hold?

Question   Is every figure of README.md and experiments/README.md that a script has measured the one
           in the file that the script wrote?
Reference  The files in experiments/results.
Error      None: figures are rounded as the text has them, and compared as text.
Command    python experiments/claims.py   (writes the figures into the text; a test sees to it that
           this changes nothing)

A claim is a pattern whose groups are figures, in a file, and a function that reads them off.
"""

import json
import re
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parent.parent
RESULTS = ROOT / "experiments" / "results"
GOALS = ("1e-3", "1e-6", "1e-9")


class Claim(NamedTuple):
    """Figures in a text.

    Attributes:
        file: the text, from the root.
        pattern: regular expression that is there once; its groups are the figures.
        figures: function that gives them as text, from result files.
    """

    file: str
    pattern: str
    figures: object


def figure(value):
    """A time as the tables have it: two digits, no more than one behind the point."""
    return f"{value:.0f}" if value >= 10 else f"{value:.1f}"


def span(values, form="{:.0f}"):
    """The smallest and the largest, as text."""
    return form.format(min(values)), form.format(max(values))


# --- work_precision.txt

ROWS = {
    "net of 300 unknowns: `Newton`": "full Newton",
    "the same in float32": "Newton, float32",
    "`Incremental`, 2 corrections an increment": "tangent, 2 corrections",
    "`Incremental`, 1 correction": "tangent, 1 corrections",
    "`Incremental`, no correction": "tangent, 0 corrections",
    "the paper's secant form": "secant",
    "OpenSees, Newton, analysis alone": "OpenSees",
    "isolated cable: one catenary a span": "catenaries",
    "isolated cable: straight elements": "straight elements",
}


def cheapest():
    """Milliseconds of the cheapest setting of each kind, by goal, or None; a dict of kinds."""
    text = (RESULTS / "work_precision.txt").read_text().split("Cheapest setting")[1]
    found = {}
    for line in text.splitlines()[2:]:
        cells = re.findall(r"\S+: ([\d.]+) \([\d.]+\)|(not reached)", line)
        if len(cells) == len(GOALS):
            kind = re.split(r"\s{2,}", line.strip())[0]
            found[kind] = [float(ms) if ms else None for ms, _ in cells]
    return found


def speed_row(kind):
    """The cells of a row of the table of speed."""
    times = cheapest()[kind]
    return tuple("not reached" if ms is None else figure(ms) for ms in times)


def behind_opensees():
    """How much faster OpenSees is on the single net, for all goals."""
    found = cheapest()
    ratios = [a / b for a, b in zip(found["full Newton"], found["OpenSees"], strict=True)]
    return span(ratios, "{:.1f}")


# --- scaling.txt, scaling.json


def scaling_rows():
    """Rows of the table of nets: a list of (unknowns, solver, numbers or None)."""
    text = (RESULTS / "scaling.txt").read_text()
    block = text.split("value and gradient over value\n")[1].split("\n\n")[0]
    rows = [line.split() for line in block.splitlines()[2:]]
    return [
        (int(row[0]), row[1], [None if cell == "-" else float(cell) for cell in row[2:]])
        for row in rows
    ]


def ahead_of_opensees():
    """How much faster PARDISO is on large nets, without building models."""
    rows = [row for n, solver, row in scaling_rows() if solver == "pardiso" and n >= 7500]
    return span([row[4] for row in rows if row[4] is not None])


def batch_ratios():
    """OpenSees' time of a case over that of a batch, analysis alone."""
    text = (RESULTS / "scaling.txt").read_text().split("=== batches")[1].split("===")[0]
    ratios = re.findall(r"devices: [12]\s+[\d.]+\s+[\d.]+\s+([\d.]+)", text)
    return span([float(ratio) for ratio in ratios])


def gradient_share():
    """What a gradient costs more than its value, percent, medians of the nets of gradient_cost."""
    text = (RESULTS / "gradient_cost.txt").read_text().split("The first solver")[0]
    lines = [re.findall(r"([\d.]+) \([\d.]+-[\d.]+\)", line) for line in text.splitlines()]
    return span([100 * (float(own[2]) - 1) for own in lines if len(own) == 3])


# --- first_call.json


def first_calls():
    """Seconds of the first call of the scenes, plain `solve`."""
    found = json.loads((RESULTS / "first_call.json").read_text())
    scenes = [own["plain"]["first"] for name, own in found.items() if "phases" not in name]
    return span(scenes, "{:.1f}")


CLAIMS = [
    *(
        Claim(
            "README.md",
            rf"^\| {re.escape(text)} \| (.+?) \| (.+?) \| (.+?) \|$",
            lambda kind=kind: speed_row(kind),
        )
        for text, kind in ROWS.items()
    ),
    Claim("README.md", r"first call takes ([\d.]+) to\s([\d.]+) s", first_calls),
    Claim("README.md", r"OpenSees is ([\d.]+) to ([\d.]+) times faster on", behind_opensees),
    Claim("README.md", r"jaxcable is (\d+) to (\d+) times faster in batches", batch_ratios),
    Claim("README.md", r"and (\d+) to (\d+) times on single nets", ahead_of_opensees),
    Claim("README.md", r"costs\s(\d+) to\s(\d+) % of an analysis more", gradient_share),
    Claim("experiments/README.md", r"First calls take ([\d.]+) to ([\d.]+) s", first_calls),
]


def corrected(claim, text):
    """The text with the figures of a claim as the results have them."""
    found = list(re.finditer(claim.pattern, text, re.M))
    if len(found) != 1:
        raise ValueError(f"{claim.file}: {len(found)} places match {claim.pattern!r}")
    (match,) = found
    figures = claim.figures()
    for k in range(len(figures), 0, -1):
        begin, end = match.span(k)
        text = text[:begin] + figures[k - 1] + text[end:]
    return text


def main():
    for file in dict.fromkeys(claim.file for claim in CLAIMS):
        path = ROOT / file
        text = before = path.read_text()
        for claim in CLAIMS:
            if claim.file == file:
                text = corrected(claim, text)
        path.write_text(text)
        print(f"{file}: {'changed' if text != before else 'as the results have it'}")


if __name__ == "__main__":
    main()
