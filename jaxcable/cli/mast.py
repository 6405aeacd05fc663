"""``mast``: erect a guyed mast, analyse it under wind from all sides, with gusts and ice, report
envelopes.
"""

from __future__ import annotations

from argparse import Namespace

from .. import masts
from ..common import status
from . import outputs
from .guard import FAILED, BadInput, refuse_value_errors


def run(options: Namespace) -> int | None:
    """Study the mast in `options.mast`, print what governs, and write report and picture."""
    outputs.check_study_files(options, (".json",), [options.mast])
    with refuse_value_errors(options.mast):
        job = masts.load_mast(options.mast)
        if options.directions is not None:
            job = job._replace(directions=options.directions)
        if not job.states:
            raise BadInput(f"{options.mast}: states: none; give some, such as wind and ice")
        study = masts.study_mast(job)
    wrote = [] if options.save is None else [masts.save_mast(options.save, job)]

    def draw():
        return {"Envelopes of each state over all directions": masts.plot_mast(study)}

    outputs.print_study(options, study.report(), f"Mast {options.mast}", draw, wrote)
    return None if study.status == status.OK else FAILED
