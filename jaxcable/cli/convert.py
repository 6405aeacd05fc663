"""``convert``: make a scene of a net (OBJ, DXF, JSON of compas or jax_fdm, two CSV tables), or a
drawing of a scene.
"""

from __future__ import annotations

from argparse import Namespace

from ..files import save_dxf, save_network, save_scene
from ..files.net_units import unit_of_net_value
from . import inputs, outputs
from .guard import BadInput, refuse_value_errors

PROPERTIES = "axial_stiffness", "weight", "strength", "expansion", "pretension", "force_density"
"""Options with the properties that a net lacks to be a scene."""

_OMITTED = {
    ".dxf": "a drawing has no stiffnesses, prestress or loads",
    ".compas.json": "without a result it has no stiffnesses, prestress or loads",
}
"""What a file of each format cannot store of a scene."""


def run(options: Namespace) -> None:
    """Read a net or scene and write it in another format, that of the suffix of `options.save`."""
    _refuse_scripts(options)
    outputs.check_output_file(options.save, (".json", ".dxf"), inputs=options.files)
    name, scale = options.save.lower(), None
    if name.endswith((".dxf", ".compas.json")) and inputs.is_scene_file(options):
        others = ("anchors", "bars", "split", "tol", "supports", "sagitta", "hidden", "columns")
        inputs.refuse_options_without_effect(
            options, (*PROPERTIES, *others), "is for nets, not for scenes"
        )
        inputs.refuse_options_without_effect(options, ("units",), inputs.STATED)
        if not name.endswith(".dxf"):
            inputs.refuse_options_without_effect(options, ("scale",), "is for drawings (.dxf)")
        options.scene, scale = options.files[0], options.scale
        scene = inputs.read_scene(options)
    else:
        scene = _scene_of_net(options)
    with refuse_value_errors(options.save):
        if name.endswith(".dxf"):
            units = scene.units if scale is None else None
            save_dxf(options.save, scene.structure, scale=scale, units=units)
        elif name.endswith(".compas.json"):
            save_network(options.save, scene.structure)
        else:
            save_scene(options.save, scene)
    count = sum(len(group.links) for group in scene.structure.groups)
    lost = next((f"; {text}" for end, text in _OMITTED.items() if name.endswith(end)), "")
    print(f"wrote {options.save}: {scene.structure.n_node} nodes, {count} links{lost}")


def _refuse_scripts(options):
    """Raise `BadInput` if a Python script, also one of OpenSees, is to be read or written."""
    if any(name.lower().endswith(".py") for name in options.files):
        raise BadInput(
            f"{options.files[0]}: scripts are not read, those of OpenSees neither: give the net as "
            ".obj, .dxf, .json (scene, compas, jax_fdm) or two .csv tables, or write the scene by "
            "jaxcable.save_scene in Python"
        )
    if options.save.lower().endswith(".py"):
        raise BadInput(
            f"--save {options.save}: a script of OpenSees has the end of an analysis: jaxcable "
            f"solve SCENE --save {options.save}"
        )


def _scene_of_net(options):
    """Return the `Scene` of the net in `options.files`, with the properties that options give."""
    net, units = inputs.read_net(options), inputs.parse_units(options.units)
    properties = {}
    for name in PROPERTIES:
        if (words := getattr(options, name)) is not None:
            read = inputs.number_parser(units, unit_of_net_value(name))
            properties[name] = inputs.parse_numbers(words, "--" + name.replace("_", "-"), read)
    try:
        scene = net.scene(inputs.parse_anchors(options.anchors), bars=options.bars, **properties)
        return scene if units is None else scene.with_units(units)
    except ValueError as error:
        hint = str(error).replace("axial_stiffness=...", "--axial-stiffness")
        raise BadInput(f"{options.files[0]}: {hint}") from None
