"""How much memory do programs of many shapes need in one process?

Question   Memory of a process that analyses 500 nets of different shape, and its memory maps.
Reference  None.
Error      None: the results are those of the tests.
Results    kept_programs_many.txt
"""

import gc
import re
from pathlib import Path

import record


def resident():
    """Memory of this process, MB, and number of its memory maps."""
    size = re.search(
        r"VmRSS:\s+(\d+)", Path("/proc/self/status").read_text(encoding="utf-8")
    ).group(1)
    return int(size) / 1e3, len(Path("/proc/self/maps").read_text(encoding="utf-8").splitlines())


def run(cases, _):
    import jax

    import jaxcable as jc
    from jaxcable.programs.known import MOST_PROGRAMS

    jax.config.update("jax_enable_x64", True)
    say = record.Record("kept_programs_many")
    say(
        f"\n{cases.nets} nets of different shape, each analysed once by jc.solve; "
        f"{MOST_PROGRAMS} programs"
    )
    say("are known at a time. Memory of the process, and its memory maps (65 530 are allowed)\n")
    say(f"{'nets':>6}{'MB':>8}{'maps':>8}")
    for k in range(cases.nets + 1):
        if k:
            net = jc.scenes.saddle(3 + (k - 1) % 25, 3 + (k - 1) // 25, load=100.0)
            assert int(jc.solve(*net).status) == 0
        if k in (0, 1, 10, MOST_PROGRAMS) or k % 100 == 0:
            say("{:6}{:8.0f}{:8}".format(k, *resident()))
    jc.forget_programs()
    gc.collect()
    say("\nafter jc.forget_programs(): {:.0f} MB, {} maps".format(*resident()))
    say.close()
