"""Pictures of results (matplotlib), and an interactive 3-D view as a page.

Functions return a matplotlib `Figure` (`animation` returns the path of its file, `view` a `Page`),
and save it if they get a `path`. Notebooks show the figure if it is the last value of a cell. It is
not registered with pyplot: no figure stays open, no setting changes, no display is needed. For a
window: ``pyplot.figure(figure); pyplot.show()`` (matplotlib 3.11).

Pictures are legible at a width of 10 cm. Axes of geometry have equal scales. Colors can be
distinguished by the color-blind, and slack and compressed elements also differ by their lines.
"""

from .animation import animation
from .convergence import convergence, work_precision
from .diagrams import diagram
from .envelopes import envelope_diagram
from .histories import history
from .increments import increments
from .mode_shapes import mode_shapes
from .model_pictures import model
from .motions import motion
from .nets import net
from .paths import path
from .report_pictures import for_report
from .sections import section
from .sequences import sequence
from .tensions_along import tension_along
from .view import view

__all__ = [
    "animation",
    "convergence",
    "diagram",
    "envelope_diagram",
    "for_report",
    "history",
    "increments",
    "mode_shapes",
    "model",
    "motion",
    "net",
    "path",
    "section",
    "sequence",
    "tension_along",
    "view",
    "work_precision",
]
