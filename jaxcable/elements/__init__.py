"""Element laws, one a file: internal force from end state.

A law knows nothing about nodes, numbering or solvers. A group of elements is a pytree class with
these members. Of the whole group:

- ``links``: node numbers, [n_elem, n_end];
- ``properties()``: dict of the arrays with a leading [n_elem] axis, vmapped together with the
  state; everything else in the group (its material law) is shared by the elements;
- ``start(ends)``: the state before the first phase, from initial end positions [n_elem, n_end, 3];
- ``weight``: None, or ``weight_at_ends(state)`` gives the share of each end, [n_elem, n_end], N;
- ``restate(state, chord, inputs)`` and ``lock(state, ends, motion)``, if it can be prestressed.

Of one element, vmapped over the group by `assembly`, from its state, the initial positions of its
ends and their displacements, both [n_end, 3]:

- ``end_forces``: internal force at each end, [n_end, 3], N; its derivative by autodiff is the
  tangent stiffness, which is never written by hand;
- ``energy``: stored energy, J, written apart from the forces: they must be its gradient;
- ``tension``: the element's result, N;
- ``is_slack``: whether it has gone slack and holds nothing;
- ``secant(state, ends, before, motion)``: symmetric matrix with ``K (u - u0) = f(u) - f(u0)``, if
  the secant scheme is offered.
"""

from .bar import Bars
from .cable import Cables
from .prestress import AxialState

__all__ = ["AxialState", "Bars", "Cables"]
