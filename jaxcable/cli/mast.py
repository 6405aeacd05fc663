"""``mast``: erect a guyed mast, analyse it under wind from all sides, with gusts and ice, report
envelopes.
"""

from __future__ import annotations

import sys
from argparse import Namespace

from .. import masts
from ..common import status
from . import outputs
from .guard import FAILED, NOT_PASSED, BadInput, print_message, refuse_value_errors


def run(options: Namespace) -> int | None:
    """Study the mast in `options.mast`, print what governs, and write report and picture.

    Return exit status 1 if a case has no equilibrium, 3 if the mast does not hold, else None.
    """
    tables = {key: getattr(options, key) for key in ("guys", "ancillaries", "states")}
    outputs.check_study_files(options, (".json",), [options.mast, *tables.values()])
    with refuse_value_errors(options.mast):
        job = masts.load_mast(options.mast, **tables)
        if options.directions is not None:
            job = job._replace(directions=options.directions)
        if not job.states:
            raise BadInput(f"{options.mast}: states: none; give some in the file or by --states")
        study = masts.study_mast(job)
    wrote = [] if options.save is None else [masts.save_mast(options.save, job)]

    def draw():
        return {"Envelopes of each state over all directions": masts.plot_mast(study)}

    outputs.print_study(options, study.report(), f"Mast {options.mast}", draw, wrote)
    if study.status != status.OK:
        return FAILED
    if not study.holds:
        sys.stdout.flush()
        print_message(f"{options.mast}: the mast does not hold")
        return NOT_PASSED
    return None
