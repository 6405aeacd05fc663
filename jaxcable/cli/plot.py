"""``plot``: draw a scene, after its analysis or before, without a report."""

from __future__ import annotations

from argparse import Namespace
from typing import TYPE_CHECKING, Any

from ..analysis.solution import Solution
from ..common import status
from ..common.units import Units
from ..elements.element import SECTION_FORCES
from ..scenes import Scene
from . import file_names, inputs, outputs
from .guard import BadInput, print_message, refuse_value_errors
from .solving import solve_and_show

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MODEL = "model"
"""What `--of` names for a picture of the structure before any analysis."""


def run(options: Namespace) -> int | None:
    """Analyse the scene that options name and draw it; return 1 if the analysis fails."""
    from .. import plots  # slow to import: matplotlib

    diagram = options.of in SECTION_FORCES.components
    if diagram or options.of == _MODEL:
        why = f"not for diagrams and --of {_MODEL}; give --of tension, or another result in colors"
        names = "sequence", "magnify", "reactions", "one_scale"
        inputs.refuse_options_without_effect(options, names, why)
    if options.sequence and options.reactions:
        raise BadInput("--reactions: not with --sequence")
    usual = file_names.path_beside(options.scene, ".png")
    path = outputs.check_output_file(
        options.save, outputs.PICTURES, usual=usual, inputs=[options.scene]
    )

    if options.of == _MODEL:
        scene = inputs.read_scene(options)
        units = inputs.shown_units(options, scene)
        with refuse_value_errors(options.scene):
            picture = plots.model(scene.structure, view=options.view, units=units)
        outputs.save_picture(picture, path)
        print(f"wrote {path}")
        return None

    def draw(scene: Scene, solution: Solution, units: Units | None) -> Figure | None:
        if int(solution.status) != status.OK:
            return None
        same: dict[str, Any] = {"structure": scene.structure, "names": scene.phase_names}
        same |= {"view": options.view, "units": units}
        if diagram:
            return plots.diagram(solution, options.of, **same)
        colors = {"color": options.of, "one_scale": options.one_scale}
        magnify = 1.0 if options.magnify is None else options.magnify
        if options.sequence:
            return plots.sequence(solution, None, magnify, **colors, **same)
        reactions = options.reactions
        return plots.net(solution, None, magnify, reactions=reactions, **colors, **same)

    solution, figure = solve_and_show(options, draw)
    if figure is None:
        print_message(f"{path}: not drawn: the analysis failed")
    else:
        outputs.save_picture(figure, path)
        print(f"wrote {path}")
    return outputs.report_failure(options, solution)
