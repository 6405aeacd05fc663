"""Wrong input, with random indices and values, and the argument that the answer has to name.

`MISTAKES` has for each call a function of a random generator `r`, which makes the mistake, and a
pattern for the ValueError that it gets; None where the number is only known to be wrong when it is
used: then the analysis ends with a status other than OK.
"""

import functools
import re

import numpy as np

import jaxcable as jc

NODES = np.array([[0.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0], [1.0, 1.0, 0]])
LINKS = np.array([[0, 1], [1, 2], [1, 3]])
BAD = (np.nan, np.inf, -np.inf)
COUNTS = [0, -3, 1.5, True, None, "3", np.nan, np.ones(2)]
DTYPES = [np.float16, np.complex64, bool, str]
THINGS = ("text", None, {"a": 1.0}, [1.0, None], [[1.0], [1.0, 2.0]], 1j, object(), True)


def cables(links=LINKS, **numbers):
    return jc.Cables(links, **{"axial_stiffness": 1e4, **numbers})


def made(nodes=NODES, elements=None, supports=None):
    elements = cables() if elements is None else elements
    return jc.Structure(nodes, elements, jc.pinned([0, 2, 3]) if supports is None else supports)


def solve(structure=None, pretension=(10.0, 10.0, 10.0), force=(0.0, 0.0, -1.0)):
    """Always one and the same program."""
    tension, force = (np.asarray(v, float) for v in (pretension, force))
    phases = [jc.Phase(pretension=tension), jc.Phase(loads=jc.NodalLoads([1], force))]
    return jc.solve(made() if structure is None else structure, phases)


def phase(**changes):
    return jc.solve(made(), [jc.Phase(**changes)])


def spoilt(values, r, bad):
    """An array of which one entry, a random one, is bad."""
    values = np.array(values, float)
    values[tuple(r.integers(n) for n in values.shape)] = bad
    return values


def below(r):
    """A negative number of any size."""
    return -(10.0 ** r.uniform(-300, 300))


def beyond(r):
    """The number of no node."""
    return int(r.choice([4, 5, 2**31 - 1, 2**31, 2**32, 2**40]))


def shape(r):
    """An array of another shape than any that is expected."""
    return np.ones(tuple(r.integers(4, 7, r.integers(1, 3))))


def thing(r):
    return THINGS[r.integers(len(THINGS))]


# calls, and patterns of their messages; a dash stands for a status
TABLE = r"""
solve(made(spoilt(NODES, r, r.choice(BAD))))  # -
solve(made(elements=cables(axial_stiffness=spoilt([1e4] * 3, r, r.choice(BAD[:2])))))  # -
solve(pretension=spoilt([10.0] * 3, r, r.choice(BAD[:2])))  # -
solve(force=spoilt([0, 0, -1], r, r.choice(BAD)))  # -
solve(made(NODES * 10 ** r.uniform(160, 300)))  # -
cables(axial_stiffness=spoilt([1] * 3, r, below(r)))  # ^axial_stiffness\[\d\] =
cables(rest_length=spoilt([1] * 3, r, below(r)))  # ^rest_length\[\d\] =
cables(weight=spoilt([1] * 3, r, below(r)))  # ^weight\[\d\] =
jc.Cables(LINKS, area=spoilt([1] * 3, r, below(r)), law=jc.Elastic(1e9))  # ^area\[\d\] =
jc.Elastic(below(r))  # ^E =
phase(pretension=spoilt([1] * 3, r, below(r)))  # ^phases\[0\].pretension\[\d\] =
phase(jacking=spoilt([1] * 3, r, below(r)))  # ^phases\[0\].jacking\[\d\] =
phase(rest_length=spoilt([1] * 3, r, below(r)))  # ^phases\[0\].rest_length\[\d\] =
phase(prestrain=spoilt([1] * 3, r, -1 + below(r)))  # ^phases\[0\].prestrain\[\d\] =
made(shape(r))  # ^nodes: expected shape
cables(shape(r).astype(int))  # ^links: expected shape
cables(axial_stiffness=shape(r))  # ^axial_stiffness: expected
phase(pretension=shape(r))  # ^phases\[0\].pretension: exp
jc.NodalLoads([1], shape(r))  # ^forces: expected shape
jc.SupportMovement([1], shape(r))  # ^displacements: expected
jc.Supports(shape(r)[..., :5].astype(bool))  # ^supports mask: |^Supports
made(elements=cables([[0, 1], [1, 2], [1, beyond(r)]]))  # links\[2\] =
cables([[0, 1], [-int(r.integers(1, 99)), 2]])  # ^links\[1\] =
cables([[0, 1], [int(k := r.integers(9)), int(k)]])  # ^links\[1\] =
cables([*LINKS.tolist(), LINKS[r.integers(3)][::-1].tolist()])  # ^links\[3\] = .*repeats
made(np.concatenate([NODES, r.normal(size=(1, 3))]))  # ^nodes\[4\]: no element
made(supports=jc.pinned([0, beyond(r)]))  # ^pinned nodes\[1\] =
phase(loads=jc.NodalLoads([1, beyond(r)], (0, 0, 1.0)))  # load nodes\[1\] =
phase(loads=jc.SupportMovement([beyond(r)], (0, 0, 1.0)))  # moved nodes\[0\] =
phase(loads=jc.SupportMovement([1], r.normal(size=3)))  # displacements\[0\]: node 1 is free
phase(pretension=jc.only([beyond(r)], 1.0))  # elements\[0\] =
jc.Phase(increments=COUNTS[r.integers(8)])  # ^increments =
jc.Polygonal(np.sort(r.random(4))[::-1], np.arange(4))  # ^strain\[\d\] = |^strain:
jc.Newton(tol=below(r))  # ^tol =
jc.Incremental(tol=r.choice([np.nan, 0, below(r)]))  # ^tol =
made(thing(r))  # ^nodes:
made(NODES.astype(DTYPES[r.integers(4)]))  # ^nodes: expected
cables(thing(r))  # ^links:
jc.NodalLoads([1], thing(r))  # ^forces:
phase(pretension=[1.0, thing(r), 1j])  # ^pretension
jc.Phase(loads=[(thing(r), jc.SelfWeight)[r.integers(2)]])  # ^loads\[0\]:
"""


def _make(call, r):
    return eval(call, globals() | {"r": r})


MISTAKES = {
    call: (functools.partial(_make, call), None if pattern == "-" else pattern)
    for call, pattern in re.findall(r"^(.+)  # (.+)$", TABLE, re.M)
}
