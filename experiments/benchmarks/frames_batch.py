"""What does a load case of a small frame cost in a batch, with and without its gradient?

Question   1 000 load cases of a frame of ten beams: microseconds a case by `jc.batched`, by
           `jax.vmap` in `jax.jit`, and by one call after the other of the same jitted function; the
           same of the case with its gradient by all forces; and the seconds of the first call.
Reference  The single calls; a stiffness matrix written in NumPy (Euler-Bernoulli, under a
           millionth of the loads); central differences; with OPENSEES_PYTHON the same frames in
           OpenSees, one after the other: elasticBeamColumn or dispBeamColumn, Corotational, with
           BandGeneral and Newton's method.
Error      Largest difference of displacements over the largest displacement of the case, likewise
           of gradients; number of cases whose status or number of steps differs.
Results    frames_batch.txt; five minutes, and fifteen beside other work

The frame: two columns of 3 m in three beams each, a beam of 4 m in four, clamped at the feet, nine
free nodes (54 unknowns, with the inner unknowns of fibre sections 94). Section 0.1 m by 0.2 m of
steel: linear, or 100 elastic-plastic fibres at 5 points of each beam, with 4 increments. Each case
has random forces on all free nodes, up to 30 kN (linear) or 20 kN. Times are wall microseconds of a
case, medians of calls in alternating order; cores are processor time over wall time. The product of
both, microseconds of a core, is what other work on the machine changes least.
"""

import time

import jax
import jax.numpy as jnp
import numpy as np
from record import Record

import jaxcable as jc

from .measure import clock, opensees

WIDTH, HEIGHT, E, YIELD, HARDENING = 0.1, 0.2, 210e9, 235e6, 0.01
KINDS = {"linear": (1, 30e3), "fibres": (4, 20e3)}  # increments, largest force in N
FREE = np.arange(1, 10)
SINGLE = 100  # cases solved one after the other


def portal(kind):
    """The frame, with linear or elastic-plastic sections."""
    up, along = np.linspace(0.0, 3.0, 4), np.linspace(0.0, 4.0, 5)[1:]
    left = [[0.0, 0.0, z] for z in up]
    nodes = np.array(left + [[x, 0.0, 3.0] for x in along] + [[4.0, 0.0, z] for z in up[::-1][1:]])
    law = jc.Elastic(E) if kind == "linear" else jc.materials.steel(YIELD, E, HARDENING)
    section = jc.Section.rectangle(WIDTH, HEIGHT, law)
    links = [[k, k + 1] for k in range(10)]
    beams = jc.Beams(links, section=section, up=(0.0, 1.0, 0.0))
    return jc.Structure(nodes, beams, supports=jc.clamped([0, 10]))


def functions_of(kind):
    """The analysis of a case, and the same with the gradient of its mean sway."""
    structure, increments = portal(kind), KINDS[kind][0]

    def one(force):
        loads = jc.NodalLoads(FREE, force)
        solution = jc.solve(structure, jc.Phase(loads=loads, increments=increments))
        steps = jnp.sum(solution.phases[0].path.iterations)
        return solution.displacement, solution.status, steps

    def sway(force):
        found = one(force)
        return jnp.mean(found[0][FREE, 0]), found

    return {"value": one, "gradient": jax.value_and_grad(sway, has_aux=True)}


def measure(kind, count, repeats, record):
    """Times of all ways to solve the cases, and how far their results are apart."""
    rng, (_, most) = np.random.default_rng(0), KINDS[kind]
    forces = jnp.asarray(rng.uniform(-most, most, (count, len(FREE), 3)))
    few = forces[:SINGLE]
    for name, function in functions_of(kind).items():
        single = jax.jit(function)
        ways = {
            "alone": lambda forces, single=single: [single(force) for force in forces],
            "batched": jc.batched(function),
            "vmap": jax.jit(jax.vmap(function)),
        }
        own = {"alone": few, "batched": forces, "vmap": forces}
        first, found, spent = {}, {}, {way: [] for way in ways}
        first["alone"] = clock(single, forces[0])[0]
        for way, solve in ways.items():
            seconds, found[way] = clock(solve, own[way])
            first.setdefault(way, seconds)
        for turn in range(repeats):
            for way in list(ways)[:: 1 if turn % 2 else -1]:
                busy = time.process_time()
                wall, _ = clock(ways[way], own[way])
                spent[way].append((wall, (time.process_time() - busy) / wall, len(own[way])))
        for way, rows in spent.items():
            wall, cores, cases = np.median(rows, axis=0)
            record(
                f"{kind:8}{name:>10}{way:>10}{first[way]:10.1f}{1e6 * wall / cases:12.0f}"
                f"{cores:8.2f}{1e6 * wall * cores / cases:14.0f}"
            )
        compare(kind, name, found, forces, single, record)


def compare(kind, name, found, forces, single, record):
    """Say how far batches are from single analyses, and these from the references."""
    alone = jax.tree.map(lambda *a: np.stack(a), *found["alone"])
    for way in ("batched", "vmap"):
        batch = jax.tree.map(lambda a: np.asarray(a)[: len(alone[-1])], found[way])
        moved, code, steps = batch if name == "value" else batch[0][1]
        own, own_code, own_steps = alone if name == "value" else alone[0][1]
        other = int(np.sum((code != own_code) | (steps != own_steps)))
        text = f"displacements {apart(moved, own):.0e}, {other} other statuses or steps"
        if name == "gradient":
            text += f", gradients {apart(batch[1], alone[1]):.0e}"
        record(f"  {way} from alone: {text}; {int(np.sum(code != 0))} cases have failed")
    if name == "gradient":
        way, step = np.random.default_rng(1).normal(size=forces[0].shape), 1.0
        ends = [float(single(forces[0] + s * way)[0][0]) for s in (step, -step)]
        exact = float(np.sum(np.asarray(alone[1][0]) * way))
        error = abs((ends[0] - ends[1]) / (2 * step) / exact - 1)
        record(f"  gradient from a central difference: {error:.0e}")
    elif kind == "linear":
        small = np.asarray(forces[0]) * 1e-6
        error = apart(np.asarray(single(small)[0])[None], linear_displacements(small)[None])
        record(f"  a millionth of the loads, from a stiffness matrix in NumPy: {error:.0e}")


def apart(found, expected):
    """Largest difference of a case over its largest entry, of arrays [n_case, ...]."""
    axes = tuple(range(1, found.ndim))
    return float(np.max(np.abs(found - expected).max(axes) / np.abs(expected).max(axes)))


def linear_displacements(force):
    """Displacements of the frame in linear theory, [11, 3], by a stiffness matrix of its own."""
    structure, shear = portal("linear"), E / 2.6
    nodes, links = np.asarray(structure.nodes), structure.elements.links.array
    twisted = float(structure.elements.section.torsional_stiffness())
    area = WIDTH * HEIGHT
    inertia = WIDTH * HEIGHT**3 / 12, HEIGHT * WIDTH**3 / 12  # about y and z
    assert abs(twisted / shear / (HEIGHT * WIDTH**3) - 0.229) < 1e-3  # Timoshenko, h = 2 b
    matrix = np.zeros((66, 66))
    for i, j in links:
        length = np.linalg.norm(nodes[j] - nodes[i])
        x = (nodes[j] - nodes[i]) / length
        z = np.array([0.0, 1.0, 0.0])
        axes = np.stack([x, np.cross(z, x), z])
        own = np.zeros((12, 12))
        for at, stiffness in ((0, E * area / length), (3, twisted / length)):
            own[np.ix_([at, at + 6], [at, at + 6])] = stiffness * np.array([[1, -1], [-1, 1]])
        bent = np.array(
            [[12, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4]], float
        ) * np.outer([1, length, 1, length], [1, length, 1, length])
        for k, (at, sign) in enumerate((([2, 4, 8, 10], -1), ([1, 5, 7, 11], 1))):
            signs = np.outer([1, sign, 1, sign], [1, sign, 1, sign])
            own[np.ix_(at, at)] = E * inertia[k] / length**3 * bent * signs
        turned = np.kron(np.eye(4), axes)
        at = np.r_[6 * i : 6 * i + 6, 6 * j : 6 * j + 6]
        matrix[np.ix_(at, at)] += turned.T @ own @ turned
    load = np.zeros((11, 6))
    load[FREE, :3] = force
    moved = np.zeros(66)
    moved[6:60] = np.linalg.solve(matrix[6:60, 6:60], load.ravel()[6:60])
    return moved.reshape(11, 6)[:, :3]


def beside_opensees(kind, count, record):
    """The same cases in OpenSees, if it is there."""
    structure, (increments, most) = portal(kind), KINDS[kind]
    forces = np.random.default_rng(0).uniform(-most, most, (count, len(FREE), 3))
    case = {"nodes": np.asarray(structure.nodes).tolist(), "width": WIDTH, "height": HEIGHT}
    case |= {"E": E, "fibres": [10, 10] if kind == "fibres" else None, "points": 5}
    case |= {"torsion": float(structure.elements.section.torsional_stiffness())}
    case |= {"yield_stress": YIELD, "hardening": HARDENING, "increments": increments}
    case |= {"up": [0.0, 1.0, 0.0], "free": FREE.tolist(), "forces": forces.tolist()}
    found = opensees("opensees_frames.py", case)
    if "error" in found:
        record(f"{kind}: OpenSees was not measured: {found['error']}")
        return
    moved = np.asarray(found["displacements"])
    single = jax.jit(functions_of(kind)["value"])
    own = np.stack([single(jnp.asarray(force))[0] for force in forces[: len(moved)]])
    record(
        f"{kind}: OpenSees {found['version']}, {found['analyze_us']:.0f} us a case, with building "
        f"{found['analyze_us'] + found['build_us']:.0f} us; {found['failed']} have failed; "
        f"displacements {apart(own, moved):.0e} apart"
    )


def run(cases, _):
    """Measure all kinds of frames."""
    count, repeats = cases.frames
    record = Record("frames_batch")
    record(f"\n{count} load cases of a frame of ten beams")
    record(f"{'':8}{'':10}{'':10}{'first, s':>10}{'us a case':>12}{'cores':>8}{'us of a core':>14}")
    for kind in KINDS:
        measure(kind, count, repeats, record)
    record("")
    for kind in KINDS:
        beside_opensees(kind, count, record)
    record.close()
