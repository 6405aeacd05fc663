"""``schema``: print the JSON Schema of scene files, with which editors explain and check them."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path

from ..common.writing import atomic_write
from ..files import scene_schema
from ..files.json_format import format_json
from . import outputs


def run(options: Namespace) -> None:
    """Print the JSON Schema of scene files, or write it to the file in `options.save`."""
    outputs.check_output_file(options.save, (".json",))
    text = format_json(scene_schema())
    if options.save is None:
        print(text)
        return
    with atomic_write(options.save) as stream:
        stream.write(text + "\n")
    print(f'wrote {options.save}; in a scene beside it: "$schema": "{Path(options.save).name}"')
