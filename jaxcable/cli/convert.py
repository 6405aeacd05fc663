"""``convert``: a net of another program as a scene."""

from __future__ import annotations

from argparse import Namespace

from ..files import save_scene
from . import inputs, outputs
from .guard import Refused, require_writable


def run(options: Namespace) -> None:
    """Read the net of `options` and write it as a scene."""
    outputs.check_suffix(options.save, (".json",), "--save")
    require_writable(options.save)
    net = inputs.net(options)
    names = ("axial_stiffness", "weight", "pretension", "force_density")
    given = {name: getattr(options, name) for name in names}
    given = {name: value for name, value in given.items() if value is not None}
    try:
        scene = net.scene(inputs.anchors(options.anchors), **given)
    except ValueError as error:
        hint = str(error).replace("axial_stiffness=...", "--axial-stiffness")
        raise Refused(f"{options.files[0]}: {hint}") from None
    save_scene(options.save, scene)
    print(f"wrote {options.save}: {scene.structure.n_node} nodes, {len(net.links)} links")
