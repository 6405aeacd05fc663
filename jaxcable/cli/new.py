"""``new``: write a small commented scene to begin with, and the same as a Python script."""

from __future__ import annotations

import shlex
import sys
from argparse import Namespace
from importlib import resources
from pathlib import Path

from ..common.writing import atomic_write_together
from ..files import scene_schema
from ..files.json_format import format_json
from . import outputs
from .guard import BadInput, require_writable

KINDS = {
    "net": "a saddle of prestressed cables, under snow",
    "mast": "a guyed mast that bends, under wind",
    "bridge": "a stayed footbridge, erected in stages",
    "dome": "a cable dome with struts, under snow",
}
_SCHEMA = "scene.schema.json"  # as the scenes name it


def run(options: Namespace) -> None:
    """Write a scene of the kind in `options.kind`, its Python script, and the schema of scenes."""
    scene = Path(f"{options.kind}.json" if options.save is None else options.save)
    outputs.check_suffix(str(scene), (".json",), "--save")
    script = scene.with_suffix(".py")
    if script.stem in sys.stdlib_module_names | {"jax", "jaxcable", "matplotlib", "numpy", "scipy"}:
        raise BadInput(f"--save {scene}: {script.name} would hide Python's module of that name")
    if scene.name == _SCHEMA:
        raise BadInput(
            f"--save {scene}: is the name of the schema that is written beside the scene"
        )
    texts = {
        scene: _read_template(f"{options.kind}.json"),
        script: _read_template(f"{options.kind}.py.txt"),
    }
    there = [str(path) for path in texts if path.exists()]
    if there and not options.force:
        names = ", ".join(there)
        raise BadInput(f"{names}: exists already; --save names another file, --force replaces it")
    schema = scene.with_name(_SCHEMA)
    if not schema.exists() or (options.force and _is_scene_schema(schema)):
        texts[schema] = format_json(scene_schema()) + "\n"
    require_writable(*texts)
    with atomic_write_together() as begin:
        for path, text in texts.items():
            begin(path).write(text)
    name, picture = shlex.quote(str(scene)), shlex.quote(str(scene.with_suffix(".png")))
    print(f"wrote {scene}: {KINDS[options.kind]}")
    print(f"wrote {script}: the same in Python, with a picture and an interactive 3-D view (HTML)")
    if schema in texts:
        print(f"wrote {schema}: with it, editors explain and check the scene")
    print(f"next:\n  jaxcable solve {name} --plot {picture}\n  jaxcable view {name}")


def _is_scene_schema(schema):
    """Return whether a file is a JSON Schema of scenes, of any version of jaxcable."""
    try:
        return '"urn:jaxcable:scene:' in schema.read_text("utf-8")[:1000]
    except (OSError, UnicodeDecodeError):
        return False


def _read_template(name):
    """Return the text of a file in the folder `templates` of this package."""
    return (resources.files(__package__) / "templates" / name).read_text("utf-8")
