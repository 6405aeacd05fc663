"""Events on paths of frames, domes and loads that follow: easily missed, invented or misnamed."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles.traced import traced
from scenes.frames import solid

import jaxcable as jc


def ok(path, code=0):
    assert int(path.status) == code, jc.describe(path.status)
    return path


# --- loads that follow: the tangent is not symmetric


@pytest.mark.slow
def test_a_load_that_follows_makes_no_bifurcation():
    """The symmetric part of the tangent is singular elsewhere; the limit load has a derivative."""
    nodes = np.array([[0, 0, 1], [-1, 0, 0], [1, 0, 0], [-0.2, -1, 0.9], [0.2, 1, 1.1]])
    held = np.ones((5, 3), bool)
    held[0, [0, 2]] = False

    @traced
    def both(p):
        def value(p):
            bars = jc.Bars([[0, 1], [0, 2]], axial_stiffness=p[0] * 1e4)
            structure = jc.Structure(nodes, bars, supports=jc.Supports(held))
            phases = [
                jc.Phase(loads=jc.FacePressure([[0, 3, 4]], 6000.0 * p[1])),
                jc.Phase(loads=jc.NodalLoads([0], (0, 0, -4000.0))),
            ]
            path = jc.trace_path(structure, phases)
            return path.failure_load, path

        return jax.value_and_grad(value, has_aux=True)(p)

    point, step = jnp.ones(2), 1e-5 * jnp.eye(2)
    (top, path), gradient = both(point)
    assert [name for name in ok(path).events.names if name != "none"] == ["limit point"] * 2
    # at a limit point no load above is carried near by: the path itself is the witness
    assert abs(top - float(path.load_factor[:30].max())) < 1e-12 and abs(top - 0.52729) < 1e-4
    assert set(np.asarray(path.n_negative).tolist()) == {0, 1, -1}  # -1: nothing was reached
    central = [(both(point + h)[0][0] - both(point - h)[0][0]) / 2e-5 for h in step]
    # differences of load factors located to 1e-12 are good to 1e-7, and of second order
    assert np.allclose(gradient, central, rtol=1e-6)


def test_two_columns_that_buckle_together_under_loads_that_follow():
    """An even number of eigenvalues crosses zero: no sign of a determinant tells.

    Rigid struts between springs across; a pressed face beside each top couples both ways across by
    ``-s`` and ``s = p c / 6``, c its edge. With kx, ky of the springs and the load P on the top the
    tangent ``[[kx - P/h, -s], [s, ky - P/h]]`` has closed eigenvalues.
    """
    h, side, kx, ky, s, edge = 2.0, 4.0, 1e3, 2.4e3, 400.0, 1.5
    top = np.array([[0, 0, h]])
    springs = top + side * np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]])
    corners = top + np.array([[1, 0, -edge / 2], [1, 0, edge / 2]])
    one = np.concatenate([top, [[0, 0, 0]], springs, corners])
    nodes = np.concatenate([one, one + np.array([20.0, 0, 0])])
    both = np.array([0, 8])
    struts = jc.Bars(both[:, None] + [0, 1], axial_stiffness=1e12)
    links = (both[:, None, None] + [[0, 2], [0, 3], [0, 4], [0, 5]]).reshape(-1, 2)
    soft = jc.Bars(links, axial_stiffness=np.tile(side / 2 * np.array([kx, kx, ky, ky]), 2))
    held = np.ones((16, 3), bool)
    held[both] = False
    parts = {"struts": struts, "springs": soft}
    structure = jc.Structure(nodes, parts, supports=jc.Supports(held))
    pressure = 6 * s / edge
    faces = jc.FacePressure(both[:, None] + [0, 6, 7], pressure)
    area = 0.5 * np.cross(corners[0] - top[0], corners[1] - top[0])
    phases = [
        # what the face pushes in its first place is taken by a dead load
        jc.Phase(loads=[faces, jc.NodalLoads(both, -pressure / 3 * area)]),
        jc.Phase(loads=jc.NodalLoads(both, (0, 0, -5000.0))),
    ]
    path = ok(jc.trace_path(structure, phases))
    middle, half = (kx + ky) / 2, np.sqrt(((ky - kx) / 2) ** 2 - s**2)
    assert path.events.names == ["bifurcation"] * 2
    assert np.asarray(path.events.multiplicity).tolist() == [2, 2]
    exact = h * np.array([middle - half, middle + half])
    # the struts are shortened by P / EA = 5e-9, brackets are squares of 1e-5
    assert np.allclose(5000 * path.events.load_factor, exact, rtol=1e-7)
    numbers = np.asarray(path.n_negative)
    assert numbers[0] == 0 and numbers[-1] == 4 and set(numbers.tolist()) == {0, 2, 4}
    # within the bracket, though the struts' stiffness is 5e8 times what its rounding is judged by
    lower, upper = 5000 * np.asarray([path.events.lower, path.events.upper])
    assert (lower < exact).all() and (exact < upper).all() and (upper - lower < 0.1).all()


@pytest.mark.slow
@pytest.mark.parametrize("per", ["current", "unstressed"])
def test_a_ring_under_pressure_buckles_in_two_modes_at_once(per):
    """``p = 3 EI / R^3`` of an inextensible ring; of `unstressed` pressure there is no potential.

    Pressure works on the enclosed area: the polygon of 24 has that of the circle (with its nodes on
    the circle its area is 1.1 % too small, and the pressure is 1.4 % above). A soft skin on the
    nodes of the beams, with EI = 100, is what is pressed; the supports are statically determinate.
    """
    n, inertia = 24, 100 / 2e11
    at = 2 * np.pi * np.arange(n) / n
    radius = np.sqrt(np.pi / 12 / np.sin(np.pi / 12))
    nodes = radius * np.column_stack([np.cos(at), 0 * at, np.sin(at)])
    links = np.column_stack([np.arange(n), (np.arange(n) + 1) % n])
    section = solid(1e5 * inertia / radius**2, inertia, 2e11)
    beams = jc.Beams(links, section=section, torsional_stiffness=1e3, up=(0.0, 1.0, 0.0))
    held = np.zeros((n, 6), bool)
    held[:, [1, 3, 5]] = held[0, [0, 2]] = held[n // 2, 2] = True
    parts = {"beams": beams, "skin": jc.Bars(links, axial_stiffness=1e-4)}
    structure = jc.Structure(nodes, parts, supports=jc.Supports(held))
    pressure = -1.2 * 3 * 100  # 20 % above that of a ring of R = 1
    load = jc.CablePressure(pressure, axis=(0.0, 1.0, 0.0), on="skin", per=per)
    path = ok(jc.trace_path(structure, jc.Phase(loads=load), step=0.2, largest=0.2))
    assert float(path.load_factor[0]) == 0 and float(path.load_factor[-1]) == 1
    assert path.events.names == ["bifurcation"] and int(path.events.multiplicity[0]) == 2
    assert set(np.asarray(path.n_negative).tolist()) == {0, 2}
    assert abs(1.2 * float(path.failure_load) - 1) < 5e-3
    mode = np.asarray(path.events.mode[0])[:, [0, 2]]
    parts = np.abs(np.fft.rfft(mode[:, 0] * np.cos(at) + mode[:, 1] * np.sin(at)))
    # two waves round the ring; supports give it a translation, one wave
    assert parts[2] > 100 * np.delete(parts, [1, 2]).max()


# --- frames
