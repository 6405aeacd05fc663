"""Do README.md and experiments/README.md have the figures of the result files?

Question   Is every measured figure in README.md and experiments/README.md the one in the file that
           its script wrote?
Reference  The files in experiments/results.
Error      None: figures are rounded as in the text, and compared as text.
Command    python experiments/claims.py   (writes the figures into the text; a test checks that this
           changes nothing)

A claim is a pattern in a text, whose groups are figures, and a function that reads these figures
from result files.
"""

import json
import re
from collections.abc import Callable
from pathlib import Path
from statistics import median
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
    figures: Callable[[], tuple[str, ...]]


def figure(value):
    """A time as the tables have it: two digits, no more than one behind the point."""
    return f"{value:.0f}" if value >= 10 else f"{value:.1f}"


def span(values, form="{:.0f}"):
    """The smallest and the largest, as text."""
    return form.format(min(values)), form.format(max(values))


# --- work_precision.txt

ROWS = {
    "`Newton`, the default": "full Newton",
    "`Incremental`, 2 corrections an increment": "tangent, 2 corrections",
    "the secant form of the paper of 2011": "secant",
    "OpenSees, Newton, analysis alone": "OpenSees",
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
    ratios = re.findall(r"fused loops\s+[\d.]+\s+[\d.]+\s+([\d.]+)", text)
    return span([float(ratio) for ratio in ratios], "{:.1f}")


def scaling(part):
    """The kept figures of a part of the benchmark."""
    return json.loads((RESULTS / "scaling.json").read_text())[part]["found"]


def of_sides(figure_of):
    """A figure of every size: of PARDISO, below 1 200 unknowns of fused loops, or nothing."""

    def figures():
        rows = [
            found["jaxcable"]["fused" if int(n) < 20 else "pardiso"]
            for n, found in scaling("nets").items()
        ]
        return tuple(text for row in rows if (text := figure_of(row)) is not None)

    return figures


def step_ratio(row):
    """A Newton step over the bare solver's factorisation and solve."""
    if "factor_ms" not in row:
        return None
    step, factor, solve = (median(row[k]) for k in ("value_ms", "factor_ms", "solve_ms"))
    return ratio(step / row["iterations"] / (factor + solve))


def batch_times():
    """Microseconds of a load case: fused loops, least and most; OpenSees, twice; plain."""
    found = scaling("batches")
    good = [row for row in found["opensees"].values() if row.get("ok")]
    peer = min(good, key=lambda row: row["analyze_s"])
    built = peer["analyze_s"] + peer["build_s"]
    cases = {key: median(row["us_a_case"]) for key, row in found.items() if key != "opensees"}
    fused, plain = (
        span([us for key, us in cases.items() if key.endswith("fused") is kind])
        for kind in (True, False)
    )
    return *fused, f"{1e6 * peer['analyze_s']:.0f}", f"{1e6 * built:.0f}", *plain


def gradient_rows():
    """Value and gradient over value of the nets of gradient_cost, medians: (unknowns, ratio)."""
    text = (RESULTS / "gradient_cost.txt").read_text().split("The first solver")[0]
    for line in text.splitlines():
        cells = re.findall(r"([\d.]+) \([\d.]+-[\d.]+\)", line)
        if len(cells) == 3:
            yield line.split()[0], float(cells[2])


def gradient_share():
    """What a gradient costs more than its value, percent."""
    return span([100 * (ratio - 1) for _, ratio in gradient_rows()])


def gradient_ratios():
    """Value and gradient over value, of the first solver of each net."""
    return tuple(f"{ratio:.1f}" for ratio in dict(reversed([*gradient_rows()])).values())[::-1]


# --- evaluation.json


def first_call_scenes():
    """The rows of the scenes, by NumPy first: seconds by kind, and the unit."""
    found = json.loads((RESULTS / "evaluation.json").read_text())
    return {k: own for k, own in found.items() if "unit" in own and "," not in k}


def first_calls():
    """Seconds of the first call of the scenes, plain `solve`."""
    return span([own["plain"] for own in first_call_scenes().values()], "{:.1f}")


def first_calls_with_gradients():
    """Least and most seconds of plain calls, and of gradients after them."""
    scenes = first_call_scenes().values()
    spans = [span([own[kind] for own in scenes], "{:.1f}") for kind in ("plain", "after")]
    return (*spans[0], *spans[1])


def first_calls_of(scene):
    """A function to the seconds of a scene: plain, and the gradient after it."""

    def seconds():
        own = first_call_scenes()[scene]
        return tuple(f"{own[kind]:.1f}" for kind in ("plain", "after"))

    return seconds


# --- the studies: figures that stand in one line of their file


def read(file, *patterns, forms=()):
    """A claim's function: what the groups of patterns hold in a result file.

    Args:
        file: its name, without ending.
        patterns: regular expressions, each there once.
        forms: what becomes of each group, a function of its text; default as it is.
    """

    def figures():
        text, groups = (RESULTS / f"{file}.txt").read_text(), []
        for pattern in patterns:
            found = list(re.finditer(pattern, text, re.M))
            if len(found) != 1:
                raise ValueError(f"{file}.txt: {len(found)} places match {pattern!r}")
            groups += found[0].groups()
        return tuple(f(g) for f, g in zip(forms or [str] * len(groups), groups, strict=True))

    return figures


def rounded(digits):
    """A function that writes a number with so many digits behind the point."""
    return lambda text: f"{float(text):.{digits}f}"


def deviations():
    """The smallest and the largest of the largest deviations from the published columns, mm."""
    return span(
        [float(x) for x in read("hypar_net", r"mm\n(?:.*\n)+?largest +(.+)$")()[0].split()],
        "{:.2f}",
    )


def misfits():
    """Of the published columns: largest misfits, mm, smallest and largest; steps likewise."""
    text = (RESULTS / "identify_spacings.txt").read_text()
    rows = re.findall(r"^\S.+? +(\d+) +(0\.\d+) +0\.\d+ +0\.", text, re.M)
    steps, largest = zip(*((int(a), float(b)) for a, b in rows), strict=True)
    return (*span(largest, "{:.2f}"), *span(steps))


def large_nets(column, name="pardiso"):
    """A row of the table of nets: of every size a solver's, or below 1 200 that of fused loops."""

    def figures():
        rows = {}
        for unknowns, solver, numbers in scaling_rows():
            if solver == ("fused" if unknowns < 1200 and name == "pardiso" else name):
                rows[unknowns] = column(numbers)
        return tuple(row for n, row in rows.items() if n >= 1200 or name == "pardiso")

    return figures


def three_digits(value):
    """Milliseconds with two digits, or three from 100 on, thousands apart."""
    if value < 10:
        return f"{value:.1f}"
    return (
        f"{value:,.0f}".replace(",", " ")
        if value < 1000
        else f"{round(value, -1):,.0f}".replace(",", " ")
    )


def ratio(value):
    """A ratio with one digit behind the point, two below 1; None was not run."""
    if value is None:
        return "not run"
    return f"{value:.1f}" if value >= 1 else f"{value:.2f}"


def first_call_ratios():
    """First calls of nets over those of the bare one, and that of the mast."""
    plain = {k: own["plain"] / own["unit"] for k, own in first_call_scenes().items()}
    nets = [plain[name] for name in ("flat_net", "hypar_net")]
    return (*span(nets, "{:.1f}"), f"{plain['guyed_mast']:.0f}")


# --- many_cases.txt

MANY_CASES = read(
    "many_cases",
    r"rate of two workers over one: ([\d.]+)",
    r"^ +(\d+) cases that differ",
    r"1 000 000 cases: ([\d.]+) hours",
    r"threads ([\d.]+), two workers",
    r"two workers ([\d.]+), bare",
    r"0 ms each way, chunks of 1.0 s: busy (\d+) %",
    r"^100 simulated cores, chunks of 1 s: busy (\d+) %",
    forms=(rounded(1), str, rounded(1), str, str, str, str),
)
"""Rate of two workers over one; cases that differ; hours of a core for a million; ms a chunk in one
process and by two workers; % of the time that simulated cores are busy, without and with files."""

ENVELOPES = read(
    "envelopes",
    *(
        rf"^{name} .* ([\d.]+) +([\d.]+) +([\d.]+) +[\d.]+ +[\de.-]+$"
        for name in ("guyed mast", "footbridge", "wheel")
    ),
    forms=[rounded(1)] * 9,
)
"""Milliseconds a case of a batch, of its envelope, and of a loop over `solve`, for three scenes."""

RELIABILITY = read(
    "reliability",
    r"^either: [\d.e-]+ to ([\d.]+)e-04",
    r"^First order: ([\d.]+) s",
    r"^crude +1000000 +([\d.]+)e-04",
    r"^crude +1000000 +\S+ +([\d.]+)e-05",
    r"^crude .* ([\d.]+) +[\d.-]+$",
    r"^around design points +\d+ +([\d.]+)e-04",
    r"^around design points .* ([\d.]+) +[\d.-]+$",
    forms=(rounded(2), rounded(1), rounded(2), str, rounded(0), rounded(2), rounded(0)),
)
"""Probability of first order, 1e-4, and its seconds; that of a million samples, its standard error,
1e-5, and seconds; that around the design points, and seconds."""

CLUSTER = read(
    "many_cases",
    r"rate of two workers over one: ([\d.]+)",
    r"threads ([\d.]+), two workers",
    r"two workers ([\d.]+), bare",
    r"bare tasks of Dask ([\d.]+)",
    r"0 ms each way, chunks of 1.0 s: busy (\d+) %",
    r"0 ms each way, chunks of 0.2 s: busy \d+ %, (\d+) chunks",
    r"^100 simulated cores, chunks of 1 s: busy (\d+) %",
    r"cases: ([\d.]+) hours",
    forms=(rounded(1), *[str] * 7),
)
"""Rate of two workers over one; ms a chunk in one process, by two workers, of Dask; % busy without
files; chunks a second that the scheduler serves; % busy with files; hours of a core for 1e6."""

FRAMES = read(
    "frames_batch",
    *(
        rf"^{kind} +{what} +{way} +[\d.]+ +\d+ +[\d.]+ +(\d+)$"
        for kind in ("linear", "fibres")
        for way in ("batched", "alone")
        for what in ("value", "gradient")
    ),
)
"""Microseconds of a core of a frame, value and gradient, in a batch and alone; with fibres."""

STAGES = read(
    "stages",
    r"deck level within (\S+) m",
    r"erection within\n(\S+) m",
    r"order differ by (\S+) of that",
    r"median (\S+) mm",
)
"""Level of the tuned deck, taken down again, m; derivatives; median of 1 000 bridges, mm."""


def compile_times():
    """Seconds to compile the cantilever beside OpenSees, least and most."""
    text = (RESULTS / "opensees_cantilever_times.txt").read_text().split("batch of 64")[0]
    rows = re.findall(r"1?x? 40 +[\d.]+ +[\d.]+ +([\d.]+)  ", text)
    return span([float(own) for own in rows])


def valid_scenes():
    """Random scenes that are no mistakes, how many end NOT_CONVERGED."""
    text = (RESULTS / "fuzz.txt").read_text()
    missed = re.search(r"^ +(\d+) NOT_CONVERGED$", text, re.M)
    found = (re.search(rf"{name}: (\d+)", text)[1] for name in ("valid scenes", "defects"))
    count, defects = found
    assert defects == "0"
    return count, missed[1] if missed else "0"


def bank():
    """The bank of nets: scenes, without equilibrium, steps, median and most; without in float32."""
    double, single = (RESULTS / "cable_bank.txt").read_text().split("float32")[:2]
    rows = [
        re.search(r"^all +(\d+) +(\d+) +(\d+) +(\d+) +\d+ +(\d+) +\d+ +(\d+) ", text, re.M)
        for text in (double, single)
    ]
    counts = [[int(number) for number in row.groups()] for row in rows]
    count, missed, hidden, wrong, median, most = counts[0]
    assert wrong == counts[1][3] == 0
    none = sum(counts[1][1:3])
    return tuple(str(number) for number in (count, missed + hidden, median, most, none))


def slack_grids():
    """Grids with slack regions: their largest side, fewest and most steps; all converge."""
    text = (RESULTS / "slack_regions.txt").read_text()
    kinds = "half|third|patches|hung"
    rows = re.findall(rf"^ +(\d+)  (?:{kinds}) +(?:EA )?\S+ +(\d+) (.*)", text, re.M)
    sides, steps, rest = zip(*rows, strict=True)
    assert len(rows) >= 40
    assert not any("status" in end for end in rest)
    return str(max(map(int, sides))), *span([int(count) for count in steps])


def bars():
    """The bank of bars: scenes, failed, steps in the median and in 99 % of increments."""
    text = (RESULTS / "bar_bank.txt").read_text()
    row = re.search(r"^all +(\d+) +(\d+) +(\d+) +(\d+) +(\d+) ", text, re.M)
    count, failed, wrong, median, most = row.groups()
    assert wrong == "0"
    return count, failed, median, most


def seconds(*commands):
    """Whole seconds that commands take together, as the benchmark `first_screen` has noted them."""
    lines = (RESULTS / "first_screen.txt").read_text().splitlines()
    noted = dict(line.split(maxsplit=1)[::-1] for line in lines if len(line.split()) > 1)
    return f"{sum(float(noted[command]) for command in commands):.0f}"


def dome():
    """The dome with limits: loss and evaluations by SLSQP, evaluations by IPOPT, the old loss."""
    ways = json.loads((RESULTS / "constrained.json").read_text())["limits"]["dome"]
    slsqp, ipopt, old = (ways[name] for name in ("slsqp", "ipopt", "multipliers"))
    assert slsqp["status"] == ipopt["status"] == 0
    counts = (str(way["evaluations"]) for way in (slsqp, ipopt))
    return f"{slsqp['loss']:.3f}", *counts, f"{old['loss']:.3f}"


def deliverables():
    """Whole seconds to the first reports: mast, bridge, and the combinations of the bridge."""
    text = (RESULTS / "deliverables.txt").read_text()
    mast = re.search(r"^ *(\d+)  guyed mast", text, re.M)[1]
    bridge, count = re.search(r"^ *(\d+)  footbridge, (\d+) combinations", text, re.M).groups()
    return mast, count, bridge


STUDIES = "experiments/README.md"
SPEED = "docs/how-to/speed.md"
CLAIMS = [
    Claim(
        "README.md",
        r"^make demo +# (\d+) s the first time, then (\d+) s$",
        lambda: (
            seconds("make .venv/installed", "make demo  # first"),
            seconds("make demo  # again"),
        ),
    ),
    Claim(
        "README.md",
        r"^.venv/bin/jaxcable view bridge.json +# (\d+) s the first time, then (\d+) s$",
        lambda: tuple(
            seconds(f".venv/bin/jaxcable view bridge.json --no-open  # {k}")
            for k in ("first", "again")
        ),
    ),
    *(
        Claim(
            "README.md",
            rf"^\| {re.escape(text)} \| (.+?) \| (.+?) \| (.+?) \|$",
            lambda kind=kind: speed_row(kind),
        )
        for text, kind in ROWS.items()
    ),
    *(
        Claim(
            page,
            r"takes ([\d.]+) to ([\d.]+) s, a gradient after it ([\d.]+) to ([\d.]+) s",
            first_calls_with_gradients,
        )
        for page in ("README.md", SPEED)
    ),
    *(
        Claim(SPEED, rf"\| {text} \| ([\d.]+) \| ([\d.]+) \|", first_calls_of(scene))
        for text, scene in (
            ("flat net", "flat_net"),
            ("guyed mast", "guyed_mast"),
            ("bridge in stages", "cable_stayed_bridge"),
        )
    ),
    Claim(SPEED, r"`jax.jit` cost (\d+) to (\d+) % of an analysis more", gradient_share),
    Claim(
        "README.md",
        r"the mast takes (\d+) s, a .+ with (\d+)\s+combinations (\d+) s",
        deliverables,
    ),
    Claim("README.md", r"jaxcable is ([\d.]+) to ([\d.]+) times faster in batches", batch_ratios),
    Claim("README.md", r"and (\d+)\s+to (\d+) times on single nets", ahead_of_opensees),
    Claim("README.md", r"costs (\d+) to (\d+) % of an analysis more", gradient_share),
    Claim(
        STUDIES,
        r"with jacks \| (\d+) \| (\d+) \| (\d+) \| (\d+) \|.+\n.+EA/N to 1e5 \| \d+ \| (\d+) \|",
        bank,
    ),
    Claim(STUDIES, r"of up to (\d+) nodes on a side.+\| (\d+) to (\d+) \|", slack_grids),
    Claim(
        STUDIES,
        r"from crooked starts \| (\d+) \| (\d+) \| (\d+) \| (\d+) in 99 % of increments",
        bars,
    ),
    Claim(STUDIES, r"float32 among them \| (\d+) \| (\d+) \|", valid_scenes),
    Claim(
        STUDIES,
        r"OpenSees\s+takes (\d+) us a case, (\d+) us with fibres",
        read(
            "frames_batch",
            r"linear: OpenSees [\d.]+, (\d+) us",
            r"fibres: OpenSees [\d.]+, (\d+) us",
        ),
    ),
    Claim(STUDIES, r"First calls take ([\d.]+) to ([\d.]+) s", first_calls),
    Claim(
        STUDIES,
        r"takes ([\d.]+) to ([\d.]+) times as long as that of the bare one.+\s.*mast (\d+) times",
        first_call_ratios,
    ),
    Claim(STUDIES, r"seven\s+columns ([\d.]+) to ([\d.]+) mm", deviations),
    Claim(
        STUDIES,
        r"misfit ([\d.]+) to\s+([\d.]+) mm \(.+\) in (\d+) to (\d+) steps",
        misfits,
    ),
    Claim(
        STUDIES,
        r"\[(\d+) % less pretension\]",
        read("least_pretension", r"the optimum has (\d+)% less"),
    ),
    Claim(
        STUDIES,
        r"two optima within 1 %: (\d+) of (\d+) random starts",
        lambda: read("least_pretension", r"(\d+) random starts: sums .+?, (\d+) of them within")()[
            ::-1
        ],
    ),
    Claim(
        STUDIES,
        r"ends at ([\d.]+) after (\d+) evaluations by SLSQP and (\d+) by IPOPT; the\s+"
        r"method of multipliers stopped at ([\d.]+)\.",
        dome,
    ),
    Claim(
        STUDIES,
        r"to its plan with (\d+) evaluations, SciPy's `least_squares`\s+with (\d+);",
        lambda: tuple(
            str(way["evaluations"])
            for way in json.loads((RESULTS / "constrained.json").read_text())["free"][
                "dome's plan: fit, least_squares"
            ]
        ),
    ),
    Claim(
        STUDIES,
        r"same gradients: (\d+) of (\d+)\)",
        lambda: read("least_pretension", r"same starts: (\d+) succeed.+?(\d+) of them within")()[
            ::-1
        ],
    ),
    Claim(
        STUDIES,
        r"tensions (\d+) % off, (\d+) % after one step",
        read(
            "retensioning",
            r"tensions off by up to ([\d.]+) %",
            r"matrix of the design +1 +(\d+) ",
            forms=(rounded(0), str),
        ),
    ),
    Claim(
        STUDIES,
        r"over the value alone, ([\d.]+), ([\d.]+) and ([\d.]+) for 12, 300",
        gradient_ratios,
    ),
    Claim(
        STUDIES,
        r"from the published\s+field to ([\d.]+) m rms, ([\d.]+) m at most",
        read(
            "saddle_net",
            r"^  rms ([\d.]+) m",
            r"largest misfit ([\d.]+) m",
            forms=(rounded(3), str),
        ),
    ),
    Claim(
        STUDIES,
        r"^\| jaxcable with PARDISO .+?, ms" + r" \| (.+?)" * 7 + r" \|$",
        large_nets(lambda row: three_digits(row[0])),
    ),
    Claim(
        STUDIES,
        r"^\| OpenSees over it" + r" \| (.+?)" * 7 + r" \|$",
        large_nets(lambda row: ratio(row[4])),
    ),
    *(
        Claim(
            STUDIES,
            rf"^\| OpenSees over jaxcable with {name} \| \|" + r" \| (.+?)" * 4 + r" \| not run",
            large_nets(lambda row: ratio(row[4]), name.lower()),
        )
        for name in ("CHOLMOD", "SuperLU")
    ),
    Claim(
        STUDIES,
        r"compute ([\d.]+) times as many cases[^|]+?and (\d+) differ[^|]+?take ([\d.]+) hours[^|]+?"
        r"costs ([\d.]+) ms[^|]+?([\d.]+) ms through[^|]+?files (\d+) % are busy[^|]+?all, (\d+) %",
        MANY_CASES,
    ),
    Claim(
        STUDIES,
        r"a mast ([\d.]+) ms a case, ([\d.]+) for the envelope, and ([\d.]+) in a loop[^|]+?"
        r"footbridge ([\d.]+), ([\d.]+) and\s([\d.]+); a wheel ([\d.]+), ([\d.]+) and ([\d.]+) ms",
        ENVELOPES,
    ),
    Claim(
        STUDIES,
        r"first order ([\d.]+)e-4 in ([\d.]+) s[^|]+?analyses ([\d.]+)e-4 with a standard error of "
        r"([\d.]+)e-5, in ([\d.]+) s[^|]+?points ([\d.]+)e-4 in ([\d.]+) s",
        RELIABILITY,
    ),
    Claim(
        "docs/how-to/clusters.md",
        r"workers compute ([\d.]+) times[^|]+?costs ([\d.]+) ms[^|]+?and ([\d.]+) ms through"
        r"[^|]+?costs ([\d.]+) ms[^|]+?busy\s(\d+) %[^|]+?serves (\d+) chunks[^|]+?busy\s(\d+) %"
        r"[^|]+?cases, ([\d.]+) hours",
        CLUSTER,
    ),
    Claim(
        STUDIES,
        r"^\| value and gradient over value" + r" \| (.+?)" * 7 + r" \|$",
        large_nets(lambda row: f"{row[6]:.2f}"),
    ),
    Claim(
        STUDIES,
        r"^\| one Newton step over PARDISO.+? \| \|" + r" \| (.+?)" * 5 + r" \|$",
        of_sides(step_ratio),
    ),
    Claim(
        STUDIES,
        r"^\| peak memory with the gradient, GB" + r" \| (.+?)" * 7 + r" \|$",
        of_sides(lambda row: f"{row['peak_rss_MB'][1] / 1e3:.1f}"),
    ),
    Claim(
        STUDIES,
        r"at 1 000 000 unknowns, mostly for the analysis of the pattern, (\d+) s",
        lambda: (f"{scaling('nets')['577']['jaxcable']['pardiso']['first_s']:.0f}",),
    ),
    Claim(
        STUDIES,
        r"batch takes (\d+) to (\d+) us on two.+ OpenSees (\d+) us, (\d+) us with(?:.*\n)+?.+"
        r"all cases, (\d+) to (\d+) us",
        batch_times,
    ),
    Claim(
        STUDIES,
        r"takes (\d+) us of a core by `jc.batched`, (\d+) us with its gradient,\s"
        r"and (\d+) and (\d+) us alone; with .+ section (\d+), (\d+), (\d+) and (\d+) us",
        FRAMES,
    ),
    Claim(
        STUDIES,
        r"SuperLU and PARDISO that net takes\s(.+), (.+) and (.+) ms",
        lambda: tuple(
            figure(cheapest()[f"Newton, {k}"][0]) for k in ("dense", "superlu", "pardiso")
        ),
    ),
    Claim(
        STUDIES,
        r"random guesses within ([\d.e-]+) m[^|]+?within ([\d.e-]+) m; derivatives[^|]+?to "
        r"([\d.e-]+); stays[^|]+?by ([\d.]+) mm",
        STAGES,
    ),
    Claim(
        STUDIES,
        r"converges in (\d+) steps and (\d+)\s+factorisations",
        read("scaling", r"jaxcable +yes +[\d.]+ +(\d+) +(\d+) +124"),
    ),
    Claim(
        STUDIES,
        r"to ([\de-]+) m; straight elements are a quarter",
        read("isolated_cable", r"^catenaries: ([\de-]+) m in"),
    ),
    Claim(
        STUDIES,
        r"displacement of 5.7 m \| ([\de-]+) m",
        read("isolated_cable", r"^catenaries: ([\de-]+) m in"),
    ),
    Claim(
        STUDIES,
        r"in space, takes ([\d.]+) of OpenSees' time once compiled \((\d+) to (\d+) s\)",
        lambda: (
            *read(
                "opensees_cantilever_times",
                r"^space, n = 40, 4 x 40 +[\d.]+ +[\d.]+ +[\d.]+ {20,}.+ ([\d.]+)$",
            )()[:1],
            *compile_times(),
        ),
    ),
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
    from record import write

    for file in dict.fromkeys(claim.file for claim in CLAIMS):
        path = ROOT / file
        text = before = path.read_text()
        for claim in CLAIMS:
            if claim.file == file:
                text = corrected(claim, text)
        if text != before:
            write(path, text)
        print(f"{file}: {'changed' if text != before else 'as the results have it'}")


if __name__ == "__main__":
    main()
