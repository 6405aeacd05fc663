"""Wrong input, with random indices and values, and the argument that the answer has to name.

Each entry of `MISTAKES` is a function of a random generator, which makes the mistake, and a pattern
for the ValueError that it gets; None where the number is only known to be wrong when it is used:
then the analysis ends with a status other than OK.
"""

import numpy as np

import jaxcable as jc

NODES = np.array([[0.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0], [1.0, 1.0, 0]])
LINKS = np.array([[0, 1], [1, 2], [1, 3]])
BAD = (np.nan, np.inf, -np.inf)


def _cables(**changes):
    return jc.Cables(changes.pop("links", LINKS), **{"axial_stiffness": 1e4, **changes})


def _structure(nodes=NODES, elements=None, supports=None):
    elements = _cables() if elements is None else elements
    return jc.Structure(nodes, elements, jc.pinned([0, 2, 3]) if supports is None else supports)


def _solve(structure=None, pretension=(10.0, 10.0, 10.0), force=(0.0, 0.0, -1.0), **options):
    """Always one and the same program."""
    structure = _structure() if structure is None else structure
    tension, force = (np.asarray(v, float) for v in (pretension, force))
    phases = [jc.Phase(pretension=tension), jc.Phase(loads=jc.NodalLoads([1], force))]
    return jc.solve(structure, phases, **options)


def _phase(**changes):
    return jc.solve(_structure(), [jc.Phase(**changes)])


def _with(values, rng, bad):
    values = np.array(values, float)
    values[tuple(rng.integers(n) for n in values.shape)] = bad
    return values


def _below(rng):
    return -(10.0 ** rng.uniform(-300, 300))


def _beyond(rng):
    return int(rng.choice([4, 5, 2**31 - 1, 2**31, 2**32, 2**40]))


def _shape(rng):
    return np.ones(tuple(rng.integers(4, 7, rng.integers(1, 3))))


def _thing(rng):
    things = ("text", None, {"a": 1.0}, [1.0, None], [[1.0], [1.0, 2.0]], 1j, object(), True)
    return things[rng.integers(len(things))]


MISTAKES = {
    # numbers that are none: a status
    "nodes nan": (lambda r: _solve(_structure(_with(NODES, r, r.choice(BAD)))), None),
    "stiffness nan": (
        lambda r: _solve(
            _structure(elements=_cables(axial_stiffness=_with([1e4] * 3, r, r.choice(BAD[:2]))))
        ),
        None,
    ),
    "pretension nan": (
        lambda r: _solve(pretension=_with([10.0] * 3, r, r.choice(BAD[:2]))),
        None,
    ),
    "force nan": (lambda r: _solve(force=_with([0, 0, -1], r, r.choice(BAD))), None),
    "nodes huge": (lambda r: _solve(_structure(NODES * 10 ** r.uniform(160, 300))), None),
    # signs
    **{
        f"{name} sign": (
            lambda r, name=name: _cables(**{name: _with([1] * 3, r, _below(r))}),
            rf"^{name}\[\d\] = ",
        )
        for name in ("axial_stiffness", "rest_length", "weight")
    },
    "area sign": (
        lambda r: jc.Cables(LINKS, area=_with([1] * 3, r, _below(r)), law=jc.Elastic(1e9)),
        r"^area\[\d\] = ",
    ),
    "modulus sign": (lambda r: jc.Elastic(_below(r)), "^E = "),
    **{
        f"{name} below {least}": (
            lambda r, name=name, least=least: _phase(
                **{name: _with([1] * 3, r, least + _below(r))}
            ),
            rf"^phases\[0\].{name}\[\d\] = ",
        )
        for name, least in (
            ("pretension", 0),
            ("jacking", 0),
            ("rest_length", 0),
            ("prestrain", -1),
        )
    },
    # shapes
    "nodes shape": (lambda r: _structure(_shape(r)), "^nodes: expected shape"),
    "links shape": (lambda r: _cables(links=_shape(r).astype(int)), "^links: expected shape"),
    "stiffness shape": (lambda r: _cables(axial_stiffness=_shape(r)), "^axial_stiffness: expected"),
    "pretension shape": (lambda r: _phase(pretension=_shape(r)), r"^phases\[0\].pretension: exp"),
    "forces shape": (lambda r: jc.NodalLoads([1], _shape(r)), "^forces: expected shape"),
    "movement shape": (lambda r: jc.SupportMovement([1], _shape(r)), "^displacements: expected"),
    "mask shape": (
        lambda r: jc.Supports(_shape(r)[..., :5].astype(bool)),
        "^supports mask: |^Supports",
    ),
    # numbers of nodes
    "links unknown": (
        lambda r: _structure(elements=_cables(links=[[0, 1], [1, 2], [1, _beyond(r)]])),
        r"links\[2\] = ",
    ),
    "links negative": (
        lambda r: _cables(links=[[0, 1], [-int(r.integers(1, 99)), 2]]),
        r"^links\[1\] = ",
    ),
    "links equal": (
        lambda r: _cables(links=[[0, 1], [int(k := r.integers(9)), int(k)]]),
        r"^links\[1\] = ",
    ),
    "links twice": (
        lambda r: _cables(links=[*LINKS.tolist(), LINKS[r.integers(3)][::-1].tolist()]),
        r"^links\[3\] = .*repeats links\[\d\]",
    ),
    "idle node": (
        lambda r: _structure(np.concatenate([NODES, r.normal(size=(1, 3))])),
        r"^nodes\[4\]: no element",
    ),
    "pinned unknown": (
        lambda r: _structure(supports=jc.pinned([0, _beyond(r)])),
        r"^pinned nodes\[1\] = ",
    ),
    "load unknown": (
        lambda r: _phase(loads=jc.NodalLoads([1, _beyond(r)], (0, 0, 1.0))),
        r"^(phases\[0\]\.loads\[0\]: )?load nodes\[1\] = ",
    ),
    "movement unknown": (
        lambda r: _phase(loads=jc.SupportMovement([_beyond(r)], (0, 0, 1.0))),
        r"^(phases\[0\]\.loads\[0\]: )?moved nodes\[0\] = ",
    ),
    "movement free": (
        lambda r: _phase(loads=jc.SupportMovement([1], r.normal(size=3))),
        r"^phases\[0\]\.loads\[0\]: displacements\[0\]: node 1 is free",
    ),
    "only unknown": (
        lambda r: _phase(pretension=jc.only([_beyond(r)], 1.0)),
        r"elements\[0\] = ",
    ),
    # numbers of phases, laws and methods
    "increments": (
        lambda r: jc.Phase(
            increments=[0, -3, 1.5, True, None, "3", np.nan, np.ones(2)][r.integers(8)]
        ),
        "^increments = ",
    ),
    "curve": (
        lambda r: jc.Polygonal(np.sort(r.random(4))[::-1], np.arange(4)),
        r"^strain\[\d\] = |^strain: ",
    ),
    "tol": (lambda r: jc.Newton(tol=_below(r)), "^tol = "),
    "drift": (lambda r: jc.Incremental(tol=r.choice([np.nan, 0, _below(r)])), "^tol = "),
    # things of another kind
    "nodes thing": (lambda r: _structure(_thing(r)), "^nodes: "),
    "nodes dtype": (
        lambda r: _structure(NODES.astype([np.float16, np.complex64, bool, str][r.integers(4)])),
        "^nodes: expected ",
    ),
    "links thing": (lambda r: _cables(links=_thing(r)), "^links: "),
    "forces thing": (lambda r: jc.NodalLoads([1], _thing(r)), "^forces: "),
    "pretension thing": (lambda r: _phase(pretension=[1.0, _thing(r), 1j]), "^pretension"),
    "loads thing": (
        lambda r: jc.Phase(loads=[(_thing(r), jc.SelfWeight)[r.integers(2)]]),
        r"^loads\[0\]: ",
    ),
}
