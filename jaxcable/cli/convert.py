"""``convert``: read a net of another program and write it as a scene."""

from __future__ import annotations

from argparse import Namespace

from ..files import save_scene
from . import inputs, outputs
from .guard import Refused, require_writable


def run(options: Namespace) -> None:
    """Read the net that `options` name and write it as a scene."""
    outputs.check_suffix(options.save, (".json",), "--save")
    require_writable(options.save)
    net = inputs.net(options)
    names = ("axial_stiffness", "weight", "pretension", "force_density")
    properties = {name: getattr(options, name) for name in names}
    properties = {name: value for name, value in properties.items() if value is not None}
    try:
        scene = net.scene(inputs.anchors(options.anchors), **properties)
    except ValueError as error:
        hint = str(error).replace("axial_stiffness=...", "--axial-stiffness")
        raise Refused(f"{options.files[0]}: {hint}") from None
    save_scene(options.save, scene)
    print(f"wrote {options.save}: {scene.structure.n_node} nodes, {len(net.links)} links")
