"""Scenes and results in files: JSON, NPZ, CSV, DXF; ParaView, OpenSees; nets of other programs.

``read_*`` reads nets of other programs, ``load_*`` our scenes and results, and ``save_*`` writes:

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

Scenes state their units (`Units`), SI by default; readers and writers of other formats take
``units=``. What is read is in SI units in any case.

A `Net` is completed to a scene by its method ``scene``, with supports and stiffnesses; its method
``split`` makes nodes where links cross.

One `InputWarning` shows what a reader has left out of a file, and ``Net.omissions`` lists it, a
table of `Omission`. Of scene files everything is read but comments.

Files are data: nothing in them is executed. A file with wrong contents raises a `FileError` that
names the file and the line or field. `scene_schema` describes scene files to editors.
"""

from ..common.units import Units
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
    "Units",
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
