"""Scenes and results in files: JSON, NPZ, CSV, DXF; ParaView, OpenSees; nets of other programs.

Nets that other programs drew are read by ``read_*``; scenes and results by ``load_*``; all is
written by ``save_*``:

===========================  ======================================  ===========================
file                         read                                    written
===========================  ======================================  ===========================
scene, ``.json``             `load_scene`: structure and phases      `save_scene`
result, ``.json .npz .csv``  `load_result` (``.json``, ``.npz``)     `save_result`
drawing, ``.dxf``            `read_dxf`: a `Net`                     `save_dxf`
compas, jax_fdm, ``.json``   `read_network`: a `Net`                 `save_network`
lines, ``.obj``              `read_obj`: a `Net`
two tables, ``.csv``         `read_csv`: a `Net`
ParaView, ``.vtk``                                                   `save_vtk`
OpenSees, ``.py``                                                    `save_opensees`
===========================  ======================================  ===========================

A `Net` is completed to a scene by its method ``scene``, with supports and stiffnesses; its method
``split`` makes nodes where links cross.

What a reader leaves out of a file is told in one `InputWarning` and listed in ``Net.omissions``, a
table of `Omission`; scene files have no field that is not read, other than comments.

Files are data: nothing in them is executed. A file with wrong contents raises a `FileError` that
names the file and the line or field. `scene_schema` describes scene files to editors.
"""

from .codec import register
from .csv_nets import read_csv
from .dxf import read_dxf
from .dxf_writing import save_dxf
from .nets import Net
from .network_writing import save_network
from .networks import read_network
from .obj import read_obj
from .omissions import Omission
from .opensees import save_opensees
from .reading import LARGEST, FileError
from .results import load_result, save_result
from .scene import load_scene, save_scene
from .schema import scene_schema
from .vtk import save_vtk

__all__ = [
    "LARGEST",
    "FileError",
    "Net",
    "Omission",
    "load_result",
    "load_scene",
    "read_csv",
    "read_dxf",
    "read_network",
    "read_obj",
    "register",
    "save_dxf",
    "save_network",
    "save_opensees",
    "save_result",
    "save_scene",
    "save_vtk",
    "scene_schema",
]
