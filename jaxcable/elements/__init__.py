"""Element laws, one a file: internal force from end state.

A law knows nothing about nodes, numbering or solvers. A group of elements is a pytree class with
these members. Of the whole group:

- ``links``: node numbers, [n_elem, n_end]; ``n_freedom``: freedoms that it gives a node, 3 or 6;
- ``inner``, ``n_inner_row``: unknowns of its own (`member`), as (row, column), and the rows of
  motion that they take after those of the ends; () and 0 for all but beams, whose ``idle()`` are
  the columns that no number stands in, and whose ``balls()`` the ends with a rotation of their own;
- ``properties()``: dict of the arrays with a leading [n_elem] axis, vmapped together with the
  state; everything else in the group (its material law, its section) is shared by the elements;
- ``rules()``: what its numbers keep (`_rules`); ``rules_at(nodes)``: what they and the initial
  positions [n_node, 3] keep together;
- ``start(ends)``: the state before the first phase, from initial end positions [n_elem, n_end, 3];
- ``weight``: per unstressed length, or None; ``chord(ends)``: initial lengths, [n_elem], m;
  ``at_ends(amount, ends)``: the share of each end in what acts along it, [n_elem, n_end];
- ``shaped_by_load``: whether its state has the load along it (`AxialState.line_load`);
  ``slides``: whether that load goes from node to node with it (then ``slid`` says how much does);
- ``restate(state, ends, inputs)``, if it can be prestressed, ``lock(state, ends, motion)``, if by
  a jack; ``capacity()``: the forces between which it can be (`prestress` has the common part);
- ``tension_only``, ``rising``: whether it holds only in tension, and whether its force is known not
  to fall with strain (both);
- ``breaks``: whether its curve can end; ``continued()``: the group for an iteration, without ends;
- ``remembers``: whether its state has plastic strains; ``virgin()``: those of an unused group.

Of one element, vmapped over the group by `elementwise` and `assembly`, from its state, the initial
positions of its ends and their motion, [n_end, 3] displacements, or with rotations [n_end, 7] (unit
quaternions):

- ``end_forces``: internal force at each end, [n_end, 3], N, or with moments [n_end, 6], and of
  inner numbers in the rows after them;
- ``tangent``: its derivative, the tangent stiffness, by autodiff and never written by hand;
- ``end_forces_about(state, ends, motion, step)``, with rotations: forces conjugate to a step;
- ``energy``: stored energy, J, written apart from the forces: they must be its gradient;
- ``tension``: axial force, N; ``peak_tension``, where a load along an element makes that vary: the
  one of largest size along it, with its sign;
- ``is_slack``: whether it has gone slack and holds nothing;
- ``reading(state, ends, motion, names)``: these results by name, with what they share found once;
- ``section_strain``: strains of its fibres; ``size``: sum of the forces in it that can balance each
  other, N;
- ``rounding``: what the rounding of displacements leaves of the end forces, as these; None if the
  residual need not be allowed it;
- ``beyond(strain)``: whether section strains have left their curve; ``settle(strain, plastic)``:
  plastic strains after an increment that ended with them; ``fibre_stress(strain, plastic)``;
- ``secant(state, ends, before, motion)``: symmetric matrix with ``K (u - u0) = f(u) - f(u0)``, if
  the secant scheme is offered, else None.
"""

from .bar import Bars
from .beam import Beams
from .cable import Cables
from .catenary import Catenaries
from .prestress import AxialState
from .sliding import SlidingCables

__all__ = ["AxialState", "Bars", "Beams", "Cables", "Catenaries", "SlidingCables"]
