"""Pictures of results (matplotlib).

Functions return a matplotlib `Figure` (`animation` the file that it made) and save it if they get a
`path`. Notebooks show the figure when it is the last value of a cell. pyplot does not know it:
nothing is left open, no setting is changed, no display is needed. For a window:
``pyplot.figure(figure); pyplot.show()`` (matplotlib 3.11).

Pictures are made to be read 10 cm wide. Axes of geometry are equal, colours are told apart by the
colour-blind, and what colours say about single elements (slack, compression) lines say too.
"""

from .animation import animation
from .convergence import convergence, work_precision
from .histories import history
from .increments import increments
from .nets import net
from .paths import path
from .sections import section

__all__ = [
    "animation",
    "convergence",
    "history",
    "increments",
    "net",
    "path",
    "section",
    "work_precision",
]
