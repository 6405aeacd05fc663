"""Where is a GPU faster: batches, small dense nets, or single large nets, in float64 or float32?

Question   Time of a two-phase analysis on an accelerator beside the CPU of the same machine: a case
           of a batch of 48 unknowns, nets solved densely, single nets of 30 000 and 120 000
           unknowns (there the matrix is factorised on the host, and only the rest is computed on
           the device).
Reference  The same analysis in float64 on the CPU.
Error      Relative error of the deflection of the middle; for batches, number of failed cases.
Results    gpu.txt; on a machine with a GPU and jax's build for it (`pip install "jax[cuda13]"`),
           some ten minutes. Without a GPU it says so and times the CPU alone.
"""

import statistics

from record import Record

from .measure import analysis


def platforms():
    """Names of the platforms that there are, the CPU first."""
    import jax

    try:
        jax.devices("gpu")
    except RuntimeError:
        return ["cpu"]
    return ["cpu", "gpu"]


def run(cases, _):
    say, there = Record("gpu"), platforms()
    if len(there) == 1:
        say("no GPU: the CPU alone")
    batches, dense, sparse = cases.gpu
    single = {"of": "pretension", "repeats": cases.repeats}
    work = {f"{count} cases of 48 unknowns": {"cases": count, "side": 4} for count in batches}
    work |= {f"{3 * n * n} unknowns, dense": {"side": n, "solver": "dense"} for n in dense}
    work |= {f"{3 * n * n} unknowns": {"side": n} for n in sparse}
    for label, case in work.items():
        n, truth = case.pop("side"), None
        for platform in there:
            for dtype in ("float64", "float32"):
                own = {"scene": f"saddle {n}", "load": 5000.0 / (n + 1), **single, **case}
                found = analysis({**own, "platform": platform, "dtype": dtype})
                if "cases" in case:
                    ms, first = statistics.median(found["us_a_case"]) / 1e3, found["first_case_s"]
                    end = f"failed {found['failed']}"
                else:
                    jitted, z = found["jitted"], found["z_middle"]
                    ms, first = statistics.median(jitted["ms"]), jitted["first_s"]
                    truth = z if truth is None else truth
                    end = f"error {abs(z / truth - 1):.0e}, status {found['status']}"
                times = f"{ms:10.4f} ms a case, first call {first:6.2f} s"
                say(f"{label:32s} {platform} {dtype}: {times}, {end}")
    say.close()
