"""How long does an office wait for its first report, from an empty process to the PDF?

Question   Seconds that the pages docs/how-to/checks.md (a guyed mast) and report.md (a footbridge
           in stages) take, each in a new process, up to the PDF: stages,
           combinations, checks, pictures. How do the pages of these reports look?
Reference  None: times, with the machine; pages to look at.
Error      None.
Command    python experiments/deliverables.py   (three minutes on 2 cores; writes
           results/deliverables.txt, and pages of the reports and a spoked wheel as
           results/deliverables_*.png. Needs the extra `reports`, with Typst 0.14 or newer)
"""

import io
import os
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import typst
from PIL import Image
from record import RESULTS, ROOT, Record

import jaxcable as jc
from jaxcable.common.writing import atomic_write

BLOCK = re.compile(r"^```python\n(.*?)^```$", re.M | re.S)
REPORTS = {  # page, file that it writes, pages of that to show
    "guyed mast": ("checks.md", "mast.pdf", (5, 7)),
    "footbridge": ("report.md", "footbridge.pdf", (2, 3)),
}
SHEETS = """#set page(width: auto, height: auto, margin: 6pt, fill: luma(70%))
#grid(columns: 2, gutter: 6pt, ..({pages},).map(k =>
  box(fill: white, image("{file}", page: k, width: 15cm))))"""


def script(page, file):
    """The Python blocks of a page up to the one that writes a file."""
    blocks = BLOCK.findall((ROOT / "docs" / "how-to" / page).read_text(encoding="utf-8"))
    last = next(k for k, block in enumerate(blocks) if f'"{file}"' in block)
    return "\n".join(blocks[: last + 1])


def main():
    say = Record("deliverables")
    environment = os.environ | {"PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1"}
    environment.pop("JAX_COMPILATION_CACHE_DIR", None)
    say(f"{'seconds':>8}  up to the report, in a new process")
    for name, (page, file, shown) in REPORTS.items():
        with tempfile.TemporaryDirectory() as folder:
            program = Path(folder, "program.py")
            program.write_text(script(page, file), encoding="utf-8")
            begin = time.perf_counter()
            run = [sys.executable, program]
            told = subprocess.run(
                run, cwd=folder, env=environment, check=True, capture_output=True, text=True
            )
            seconds = time.perf_counter() - begin
            count = re.search(r"(\d+) combinations", told.stdout)[1]
            say(f"{seconds:8.0f}  {name}, {count} combinations")
            sheet = Path(folder, "sheet.typ")
            sheet.write_text(SHEETS.format(file=file, pages=", ".join(map(str, shown))), "utf-8")
            with atomic_write(RESULTS / f"deliverables_{name.split()[-1]}.png", "wb") as stream:
                # with fewer points an inch Typst leaves out lines of points, and cuts letters
                image = Image.open(io.BytesIO(typst.compile(sheet, format="png", ppi=180)))
                image.convert("RGB").quantize(64).save(stream, format="png", optimize=True)
    say.close()
    structure, phases = jc.scenes.roof_ring()
    solution = jc.solve(structure, phases)
    jc.raise_if_failed(solution)
    wheel = RESULTS / "deliverables_wheel.png"
    jc.plots.net(solution, wheel, structure=structure, units="kN, m", loads=False)


if __name__ == "__main__":
    main()
