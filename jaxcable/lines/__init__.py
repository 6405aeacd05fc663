"""Overhead lines: sections of towers, stringing, states, sag-tension tables, loads on towers.

A `LineSection` is made of a table of towers, `string` finds the lengths of its conductor, and
`analyse` its states of ice, wind, heat and broken conductors; `study_line` does a whole job.
"""

from .line_analysis import LineResults, analyse, stretch
from .line_files import Line, load_line, save_line
from .line_section import LineSection
from .line_states import LineState
from .line_study import LineStudy, study_line
from .line_tables import load_trees, sag_tension_table, section_tables
from .profiles import plot_profile, profile_lines, save_profile
from .span_tables import RulingSpan, SagTension, ruling_span, sag_tension
from .stringing import PulleyStates, Stringing, pulleys, string

__all__ = [
    "Line",
    "LineResults",
    "LineSection",
    "LineState",
    "LineStudy",
    "PulleyStates",
    "RulingSpan",
    "SagTension",
    "Stringing",
    "analyse",
    "load_line",
    "load_trees",
    "plot_profile",
    "profile_lines",
    "pulleys",
    "ruling_span",
    "sag_tension",
    "sag_tension_table",
    "save_line",
    "save_profile",
    "section_tables",
    "stretch",
    "string",
    "study_line",
]
