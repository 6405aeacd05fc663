"""``convert``: make a scene of a net: OBJ, DXF, JSON of compas or jax_fdm, two CSV tables; or a
drawing.
"""

from __future__ import annotations

from argparse import Namespace

from ..files import save_dxf, save_network, save_scene
from . import inputs, outputs
from .guard import Refused, refusing

PROPERTIES = "axial_stiffness", "weight", "strength", "expansion", "pretension", "force_density"
"""Options that complete a net to a scene."""

_NOT_THERE = {
    ".dxf": "a drawing has no stiffnesses, prestress or loads",
    ".compas.json": "without a result it has no stiffnesses, prestress or loads",
}
"""What files of a kind do not hold of a scene."""


def run(options: Namespace) -> None:
    """Read the net or scene that `options` name and write it in the format of the suffix."""
    outputs.target(options.save, (".json", ".dxf"), inputs=options.files)
    name, scale = options.save.lower(), 1.0
    if name.endswith((".dxf", ".compas.json")) and inputs.is_scene(options):
        others = ("anchors", "bars", "split", "tol", "supports", "sagitta", "hidden", "columns")
        inputs.refuse_options(options, (*PROPERTIES, *others), "is for nets, not for scenes")
        if not name.endswith(".dxf"):
            inputs.refuse_options(options, ("scale",), "is for drawings (.dxf)")
        options.scene, scale = options.files[0], options.scale or 1.0
        scene = inputs.scene(options)
    else:
        scene = _scene(options)
    with refusing(options.save):
        if name.endswith(".dxf"):
            save_dxf(options.save, scene.structure, scale=scale)
        elif name.endswith(".compas.json"):
            save_network(options.save, scene.structure)
        else:
            save_scene(options.save, scene)
    count = sum(len(group.links) for group in scene.structure.groups)
    lost = next((f"; {text}" for end, text in _NOT_THERE.items() if name.endswith(end)), "")
    print(f"wrote {options.save}: {scene.structure.n_node} nodes, {count} links{lost}")


def _scene(options):
    """The scene of the net that `options` name."""
    net = inputs.net(options)
    properties = {name: getattr(options, name) for name in PROPERTIES}
    properties = {
        name: inputs.numbers(words, "--" + name.replace("_", "-"))
        for name, words in properties.items()
        if words is not None
    }
    try:
        return net.scene(inputs.anchors(options.anchors), bars=options.bars, **properties)
    except ValueError as error:
        hint = str(error).replace("axial_stiffness=...", "--axial-stiffness")
        raise Refused(f"{options.files[0]}: {hint}") from None
