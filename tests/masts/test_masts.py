"""Guyed masts: against a rod on catenaries written apart, free bodies by hand, gusts, gradients."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracles import taylor
from oracles.rod_mast import GRAVITY, RodMast, guy_pull

import jaxcable as jc

CABLE = "Galfan spiral strand 16"
AZIMUTHS = [0.0, 120.0, 240.0]


def small_mast(**options):
    """A tube with guys at two levels, and an antenna on its top."""
    part = jc.masts.tube_section(24.0, "CHS 193.7x8")
    guys = [jc.masts.guy_level(h, r, AZIMUTHS, CABLE) for h, r in ((12.0, 12.0), (22.0, 16.0))]
    antenna = jc.masts.Ancillary(23.0, drag_area=1.5, weight=900.0)
    return jc.masts.GuyedMast([part], guys, [antenna], **{"element_length": 4.0} | options)


@functools.cache
def built():
    """The small mast, erected."""
    found = jc.masts.erect(small_mast())
    assert int(found.status) == jc.status.OK
    return found


CONSTANT = jc.masts.MastState(
    *(jc.WindTable(pressures=q) for q in (700.0, 1100.0)), ice=0.01, weight_factor=1.1
)
EUROCODE = jc.masts.eurocode_state(26.0, "II", wind_factor=1.3, ice=0.01, weight_factor=1.1)


def study_of(found):
    """The study of the small mast in the state CONSTANT."""
    job = jc.masts.MastJob(small_mast(), {"ice": CONSTANT}, [40.0])
    return jc.masts.MastStudy(job, built(), found, *jc.masts.extremes(found))


@functools.cache
def analysed(state=CONSTANT):
    """The cases of the small mast in one state with ice and gusts, wind to one direction."""
    found = jc.masts.analyse(built(), {"ice": state}, [40.0])
    assert (np.asarray(found.status) == jc.status.OK).all() and np.asarray(found.stable).all()
    return found


def case(found, *at):
    """The forces of one case, NumPy."""
    return jax.tree.map(lambda x: np.asarray(x)[at], found.forces)


def towards(direction):
    """Unit vector of the wind."""
    return np.array([np.cos(np.radians(direction)), np.sin(np.radians(direction)), 0.0])


def ice_weight(thickness, diameter):
    """Weight of ice around a member, N/m."""
    return GRAVITY * 900.0 * np.pi * thickness * (diameter + thickness)


def rod_of(mast, found, pressure, ice, direction, lost=()):
    """The mast as a `RodMast` under a constant pressure, N/m2, ice, m, and 1.1 times its weight."""
    wind, down = towards(direction), np.array([0.0, 0.0, -1.0])
    sections = [[float(getattr(p, k)) for k in ("top", "EA", "EI", "GJ")] for p in mast.sections]
    shear = [1e14 if p.GA is None else float(p.GA) for p in mast.sections]

    def load(s):
        p = next(p for p in mast.sections if p.top > s or p is mast.sections[-1])
        dead = 1.1 * p.weight + ice_weight(ice, p.ice_diameter) * p.ice_length
        return pressure * (p.drag_area + ice * p.ice_width) * wind + dead * down

    points = [
        (float(a.height), pressure * a.drag_area * wind + 1.1 * a.weight * down)
        for a in mast.ancillaries
    ]
    guys, k = [], -1
    for level in mast.guys:
        for azimuth, radius in zip(level.azimuths, level.radius, strict=True):
            k += 1
            anchor = radius * towards(azimuth)
            chord = np.array([0.0, 0.0, level.height]) - anchor
            size, rest = np.linalg.norm(chord), float(found.rest_length[k])
            across = wind - (wind @ chord) / size**2 * chord
            blown = pressure * 1.2 * (level.diameter + 2 * ice) * np.linalg.norm(across) * across
            dead = 1.1 * level.weight + ice_weight(ice, level.diameter)
            if k not in lost:
                own = float(level.EA), blown * size / rest + dead * down
                guys.append((float(level.height), anchor, rest, *own))
    return RodMast([(*s, g) for s, g in zip(sections, shear, strict=True)], load, points, guys)


def compare(mast, rod, forces, direction, tolerance):
    """Solve a rod from the forces on the base, and compare displacements, moments and tensions.

    Returns the largest differences of displacements and moments, over the largest of these.
    """
    c, s, _ = towards(direction)
    along, across, down = forces.base
    base = [along * c - across * s, along * s + across * c, -down]
    along, across, _ = forces.rotation[0]
    tilt = [-along * s - across * c, along * c - across * s]
    _, records = rod.solve(np.array([*base, *tilt, forces.base_moment[2]]))
    heights = np.asarray(mast.node_heights())
    largest = np.abs(forces.displacement).max(), np.abs(forces.moment).max()
    errors = []
    for height, state in records[1:]:
        node = int(np.argmin(np.abs(heights - height)))
        u, m = state[:3] - [0.0, 0.0, height], state[15:18]
        own = [u[0] * c + u[1] * s, u[1] * c - u[0] * s, u[2]]
        # moment of the part above, as bending in the planes along and across the wind
        bending = [-m[1] * c + m[0] * s, m[1] * s + m[0] * c]
        pairs = (own, forces.displacement[node]), (bending, forces.moment[node - 1, 2])
        errors.append([np.abs(np.subtract(*pair)).max() for pair in pairs])
    errors = np.max(errors, axis=0) / largest
    assert (errors < tolerance).all()
    there = [k for k, t in enumerate(forces.tensions[:, 0]) if t > 0]
    assert len(there) == len(rod.guys)
    for k, first, guy in zip(there, rod.pulls, rod.guys, strict=True):
        ends = [np.linalg.norm(first), np.linalg.norm(first - guy[2] * guy[4])]
        np.testing.assert_allclose(forces.tensions[k], ends, rtol=tolerance)
    return errors


def test_guys_have_their_tensions_at_the_anchors():
    found, strength = built(), 266e3
    np.testing.assert_allclose(found.tensions[:, 0], 0.1 * strength, rtol=1e-9)
    calm = jc.masts.forces_of(found)
    weight = 24.0 * float(found.mast.sections[0].weight) + 900.0
    weight += float((found.rest_length * found.mast.of_guys("weight")).sum())
    # base and anchors carry the weights, and the anchors pull the mast down
    assert abs(calm.base[2] - np.asarray(calm.anchors)[:, 2].sum() - weight) < 1e-6 * weight


def test_mast_is_a_rod_on_catenaries():
    """Beams of 4 m against the differential equation: to 4e-5, of 1 m to 5e-7."""
    rod = rod_of(built().mast, built(), 700.0, 0.01, 40.0)
    compare(built().mast, rod, case(analysed(), 0, 0, 0), 40.0, 1e-4)


@pytest.mark.slow
def test_lattice_mast_of_three_levels_is_a_rod_on_catenaries():
    """Shear of the lattice, two sections, guys of two sizes: elements of second order.

    What is left, 1.5e-6 of the largest moment with elements of 2 m, is their error: with 1 m it is
    a quarter.
    """
    parts = [
        jc.masts.lattice_section(z, 3, 0.8, 0.8, leg=d, diagonal=0.02, more_weight=100.0)
        for z, d in ((30.0, 0.05), (62.0, 0.04))
    ]
    guys = [jc.masts.guy_level(h, r, AZIMUTHS, CABLE) for h, r in ((20, 25), (40, 25), (58, 40))]
    top = jc.masts.Ancillary(60.0, drag_area=2.0, weight=1500.0)
    state = jc.masts.MastState(jc.WindTable(pressures=700.0), ice=0.01, weight_factor=1.1)
    errors = []
    for length in (2.0, 1.0):
        mast = jc.masts.GuyedMast(parts, guys, [top], element_length=length)
        found = jc.masts.erect(mast)
        results = jc.masts.analyse(found, {"wind": state}, [40.0])
        assert (np.asarray(results.status) == jc.status.OK).all()
        rod = rod_of(mast, found, 700.0, 0.01, 40.0)
        errors.append(compare(mast, rod, case(results, 0, 0, 0), 40.0, 3e-6))
    np.testing.assert_allclose(errors[0] / errors[1], 4.0, rtol=0.2)


@pytest.mark.slow
def test_rupture_is_a_mast_without_the_guy():
    """With the dynamic factor 1 the mast comes to rest on the other guys; four at each level."""
    part = jc.masts.tube_section(24.0, "CHS 193.7x8")
    guys = [jc.masts.guy_level(h, 14.0, [0, 90, 180, 270], CABLE) for h in (12.0, 22.0)]
    mast = jc.masts.GuyedMast([part], guys, element_length=1.5)
    found = jc.masts.erect(mast)
    state = jc.masts.MastState(jc.WindTable(pressures=100.0), weight_factor=1.1)
    results = jc.masts.rupture(found, 1, state, 30.0, dynamic_factor=1.0)
    assert (np.asarray(results.status) == jc.status.OK).all()
    rod = rod_of(mast, found, 100.0, 0.0, 30.0, lost=(1,))
    compare(mast, rod, case(results, 0, 0, 0), 30.0, 1e-4)
    more = jc.masts.rupture(found, 1, state, 30.0, dynamic_factor=1.2)
    assert more.forces.displacement[0, 0, 0, -1, 1] > results.forces.displacement[0, 0, 0, -1, 1]


@pytest.mark.parametrize("patch", [0, 2])
def test_free_body_of_one_direction(patch):
    """Wind, ice and weights by hand against base and anchors: forces to 1e-5 of the wind.

    Moments about the foot to 1e-3, as here the mast is straight between its nodes.
    """

    def pressure(z, inside):
        return 700.0 + 400.0 * inside

    free_body(analysed(), pressure, patch, 1e-5, 1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("patch", [0, 2])
def test_free_body_under_the_wind_of_the_eurocode(patch):
    """Peak pressure in one span: to 4e-3, as the profile has a corner at 2 m within an element."""

    def pressure(z, inside):
        log = np.log(np.maximum(z, 2.0) / 0.05)
        mean = 0.625 * (0.19 * log * 26.0) ** 2
        return 1.3 * mean * (1 + inside * 7 / log)

    free_body(analysed(EUROCODE), pressure, patch, 4e-3, 4e-3)


def free_body(found, pressure, patch, tolerance, of_moments):
    """Compare loads, by quadrature, with the forces on base and anchors; of the wind to 40.

    `pressure` is a function of heights and of what is in the patch, 0 to 1.
    """
    mast, direction, t = built().mast, 40.0, 0.01
    wind, down = towards(direction), np.array([0.0, 0.0, -1.0])
    low, high = [(0.0, 0.0), None, (12.0, 22.0)][patch]  # no patch; span 2
    points, weights = (np.arange(2400) + 0.5) / 1200 - 1, np.full(2400, 1 / 1200)
    parts = []  # places and forces
    z = 12.0 * (1 + points)
    part, antenna = mast.sections[0], mast.ancillaries[0]
    blown = pressure(z, (z >= low) & (z < high)) * (part.drag_area + t * part.ice_width)
    dead = 1.1 * part.weight + ice_weight(t, part.ice_diameter) * part.ice_length
    own = case(found, 0, 0, patch)
    c, s, _ = wind
    heights = np.asarray(mast.node_heights())
    moved = own.displacement @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    places = np.stack([np.interp(z, heights, moved[:, j]) for j in range(3)], axis=1)
    places[:, 2] += z
    parts.append((places, 12.0 * weights[:, None] * (np.outer(blown, wind) + dead * down)))
    at = np.argmin(np.abs(heights - 23.0))
    blown = pressure(23.0, 0.0) * antenna.drag_area
    parts.append((moved[at] + [0, 0, 23.0], blown * wind + 1.1 * antenna.weight * down))
    k = 0
    for level in mast.guys:
        for azimuth in AZIMUTHS:
            anchor = level.radius[0] * towards(azimuth)
            top = np.array([0.0, 0.0, level.height])
            size = np.linalg.norm(top - anchor)
            share = max(min(high, level.height) - max(low, 0.0), 0.0) / level.height
            x = 0.5 * (1 + points)
            q = pressure(x * level.height, share)
            across = wind - (wind @ (top - anchor)) / size**2 * (top - anchor)
            area = 1.2 * (level.diameter + 2 * t) * np.linalg.norm(across)
            force = (0.5 * size * weights * q * area)[:, None] * across
            dead = (1.1 * level.weight + ice_weight(t, level.diameter)) * built().rest_length[k]
            node = int(np.argmin(np.abs(heights - level.height)))
            curve = anchor + np.outer(x, top + moved[node] - anchor)
            parts.append((curve, force + 0.5 * weights[:, None] * float(dead) * down))
            k += 1
    total = sum(np.reshape(f, (-1, 3)).sum(0) for _, f in parts)
    moment = sum(np.cross(np.reshape(p, (-1, 3)), np.reshape(f, (-1, 3))).sum(0) for p, f in parts)
    along, across, downwards = own.base
    base = np.array([along * c - across * s, along * s + across * c, -downwards])
    pulls, places = [], []
    for k, azimuth in enumerate(AZIMUTHS * 2):
        inward, left, up = own.anchors[k]
        a = towards(azimuth)
        pulls.append(-inward * a + left * np.array([a[1], -a[0], 0.0]) + [0.0, 0.0, up])
        places.append(mast.guys[k // 3].radius[0] * a)
    carried = base + np.sum(pulls, axis=0)
    blown = np.linalg.norm(total[:2])
    assert np.abs(total - carried).max() < tolerance * blown
    error = moment - np.cross(places, pulls).sum(0)
    assert np.abs(error[:2]).max() < of_moments * np.linalg.norm(moment[:2])


def test_gusts_act_on_guys_by_their_height():
    def shares(anchor_height):
        level = jc.masts.guy_level(12.0, 12.0, AZIMUTHS, CABLE, anchor_height=anchor_height)
        mast = jc.replace(small_mast(), guys=[level, small_mast().guys[1]])
        return [mast.guy_share(patch)[0] for patch in mast.layout.patches[:3]]

    np.testing.assert_allclose(shares(4.0), [1.0, 0.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(shares(16.0), [0.0, 1.0, 0.0], atol=1e-12)  # anchors on a hill
    np.testing.assert_allclose(shares(12.0), [1.0, 0.0, 0.0], atol=1e-9)  # horizontal guys


def test_gusts_are_combined_by_the_root_of_their_squares():
    found = analysed()
    low, high = jc.masts.extremes(found)
    every = np.asarray(found.forces.moment)[0, 0]
    spread = np.sqrt(((every[1:] - every[0]) ** 2).sum(0))
    np.testing.assert_allclose(high.moment[0, 0], every[0] + spread, rtol=1e-12)
    np.testing.assert_allclose(low.moment[0, 0], every[0] - spread, rtol=1e-12)
    assert found.patches == ("mean", *(p.name for p in built().mast.layout.patches))


def test_report_of_cases_that_have_failed(tmp_path):
    found = jax.tree.map(lambda x: x + jnp.nan, analysed().forces)
    found = jc.replace(analysed(), forces=found, status=analysed().status + 1)
    study = study_of(found)
    report = study.report()
    assert report.status == 1 and f"no results of {found.status.size} cases" in report.summary[2]
    assert report.tables["guys"].rows[0][5] is None and len(report.summary) == 3
    jc.masts.plot_mast(study, tmp_path / "mast.png")
    assert report.tables["levels"].rows[1][:4] == [22.0, 16.0, "0 120 240", 0.0]
    assert report.tables["ancillaries"].rows[0][:4] == ["ancillary", 23.0, 1.5, 900.0]


def test_study_says_what_does_not_hold(monkeypatch):
    monkeypatch.setattr("jaxcable.masts.mast_study.erect", lambda mast: built())
    for name, factor, text in (
        ("tensions", 10.0, "above their strength"),
        ("rotation", 50.0, "the mast falls"),
    ):
        forces = analysed().forces
        forces = jc.replace(forces, **{name: factor * getattr(forces, name)})
        found = jc.replace(analysed(), forces=forces)
        monkeypatch.setattr("jaxcable.masts.mast_study.analyse", lambda *_, found=found: found)
        with pytest.warns(jc.InputWarning, match=text):
            study = jc.masts.study_mast(study_of(found).job)
        assert text in study.report().summary[2] and "'ice' (" in study.report().summary[2]
        assert not study.holds
    assert study_of(analysed()).holds
    column = study_of(analysed()).report().tables["guys"].columns.index("smallest")
    assert min(row[column] for row in study_of(analysed()).report().tables["guys"].rows) > 0
    mean = analysed().forces.tensions[:, :, :1]  # forty times the effects of gusts
    tensions = mean + 40 * (analysed().forces.tensions - mean)
    slack = jc.replace(analysed(), forces=jc.replace(analysed().forces, tensions=tensions))
    table = study_of(slack).report().tables["guys"]
    assert min(row[column] for row in table.rows) < 0 and "the guy goes slack" in table.notes[-1]
    unstable = jc.replace(analysed(), stable=np.zeros_like(analysed().stable))
    assert not study_of(unstable).holds


@pytest.mark.slow
def test_section_forces_are_those_on_the_base_and_of_its_slopes():
    """A clamped mast: moment, shear and axial force at its foot are those on the base."""
    mast = small_mast(base="clamped", element_length=6.0)
    found = jc.masts.erect(mast)
    wind = jc.masts.MastState(jc.WindTable(pressures=800.0))
    results = jc.masts.analyse(found, {"wind": wind}, [20.0])
    assert (np.asarray(results.status) == jc.status.OK).all()
    own = case(results, 0, 0, 0)
    size = np.abs(own.moment).max()
    np.testing.assert_allclose(own.base_moment[:2], own.moment[0, 0], atol=1e-9 * size)
    np.testing.assert_allclose(own.base[:2], own.shear[0, 0], rtol=1e-6)
    assert abs(own.base[2] + own.axial[0, 0]) < 1e-6 * own.base[2]
    # the slope of moments is the shear: of a parabola at the middle, to the second order effects
    rise = np.diff(np.asarray(mast.node_heights()))[:, None]
    slope = (own.moment[:, 2] - own.moment[:, 0]) / rise
    shear = own.shear[:, 1] + own.axial[:, 1:2] * np.diff(own.displacement[:, :2], axis=0) / rise
    assert np.abs(slope - own.shear[:, 1]).max() < 0.05 * np.abs(shear).max()


@pytest.mark.slow
def test_gradient_of_sway_by_tensions_radii_and_heights():
    """Taylor's test through erection and one case; the mast has one level and three elements."""
    part = jc.masts.tube_section(12.0, "CHS 139.7x6.3")
    guys = [jc.masts.guy_level(11.0, 8.0, AZIMUTHS, CABLE)]
    mast = jc.masts.GuyedMast([part], guys, element_length=6.0)
    state = jc.masts.MastState(jc.WindTable(pressures=900.0))
    at = jnp.array([26e3, 8.0, 11.0, 12e6])

    def top(x):
        level = jc.replace(
            mast.guys[0], tension=jnp.full(3, x[0]), radius=jnp.full(3, x[1]), height=x[2], EA=x[3]
        )
        found = jc.masts.erect(jc.replace(mast, guys=[level]))
        results = jc.masts.analyse(found, {"wind": state}, [25.0])
        status = jnp.max(jnp.append(results.status.ravel(), found.status))
        return results.forces.displacement[0, 0, 0, -1, 0], status

    taylor.assert_gradient(lambda y: top(y * at), jnp.ones(4))


def test_patches_and_ice_of_standards():
    layout = small_mast().layout
    names = [patch.name for patch in layout.patches]
    assert names[:3] == ["span 1", "span 2", "span 3"] and len(names) == 6
    heights = np.asarray(small_mast().node_heights())
    ends = [heights[list(p.elements)].tolist() for p in layout.patches]
    assert ends == [[0, 12], [12, 22], [22, 24], [0, 6], [6, 17], [17, 24]]
    state = jc.masts.tia_state(40.0, "C", ice=0.01, directionality=1.0, gust_factor=1.0)
    z = np.array([3.0, 10.0, 40.0, 400.0])
    coefficient = 2.01 * (np.clip(z, 4.57, 274.32) / 274.32) ** (2 / 9.5)
    coefficient = np.maximum(coefficient, 0.85)
    np.testing.assert_allclose(state.wind.pressure_at(z), 0.613 * coefficient * 1600.0, rtol=1e-6)
    assert state.wind.describe().endswith("m/s at 274.32 m")
    growth = np.minimum((z / 10.0) ** 0.1, 1.4)
    np.testing.assert_allclose(state.ice_at(z), 0.02 * growth, rtol=1e-12)
    state = jc.masts.eurocode_state(25.0, "III", scaling=3.0)
    log = np.log(40.0 / 0.3)
    ratio = float(state.gust.pressure_at(40.0) / state.wind.pressure_at(40.0))
    assert abs(1 + (ratio - 1) * float(state.patch_factor) - (1 + 6 / log)) < 1e-12


def test_lattice_section_by_hand():
    """Three faces with X: stiffness, weight, area by the sums of the members of a panel."""
    a, b, leg, brace = 0.9, 0.8, 0.05, 0.02
    part = jc.masts.lattice_section(30.0, 3, b, a, leg, brace, drag=1.5)
    length = np.hypot(a, b)
    area = np.pi / 4 * np.array([leg, brace]) ** 2
    assert abs(float(part.EA) / (3 * 210e9 * area[0]) - 1) < 1e-12
    volume = 3 * (area[0] * a + 2 * area[1] * length)
    assert abs(float(part.weight) / (7850 * GRAVITY * volume / a) - 1) < 1e-12
    assert abs(float(part.drag_area) / (1.5 * (2 * leg * a + 2 * brace * length) / a) - 1) < 1e-12
    ice = 0.01  # of all members, by their surfaces
    own = 3 * (ice_weight(ice, leg) * a + 2 * ice_weight(ice, brace) * length) / a
    found = ice_weight(ice, part.ice_diameter) * part.ice_length
    assert abs(found / own - 1) < 1e-12


def sideways_frequency(tension, weight, chord, drop):
    """Frequency of the first mode across the plane of a guy, Hz: finite differences of a string.

    `tension` is that at the lower end; along the chord it grows by the weight times the rise.
    """
    n = 4000
    s = (np.arange(n) + 0.5) / n
    pull = tension + weight * drop * s
    h = chord / n
    upper = 0.5 * (pull[1:] + pull[:-1]) / h**2
    main = np.zeros(n)
    main[:-1] += upper
    main[1:] += upper
    main[0] += 2 * pull[0] / h**2
    main[-1] += 2 * pull[-1] / h**2
    from scipy.linalg import eigh_tridiagonal

    (lowest,) = eigh_tridiagonal(main, -upper, select="i", select_range=(0, 0))[0]
    return np.sqrt(lowest * GRAVITY / weight) / (2 * np.pi)


def test_tension_from_frequency():
    """A string of varying tension by finite differences: 2e-4, its sag left out."""
    mast, tension = small_mast(), 30e3
    weight = float(mast.guys[1].weight)
    weight /= 1 + tension / float(mast.guys[1].EA)  # per stretched length
    frequency = sideways_frequency(tension, weight, np.hypot(16.0, 22.0), 22.0)
    found = jc.masts.tension_from_frequency(mast, 4, frequency)
    np.testing.assert_allclose(found, [tension, tension + 22.0 * weight], rtol=2e-4)


@pytest.mark.slow
def test_tension_from_sag():
    """A catenary by quadrature: the sag at midspan gives back its tension to 1e-6."""
    mast, length = small_mast(), 27.19
    level, top = mast.guys[1], np.array([16.0, 0.0, 22.0])
    load = np.array([0.0, 0.0, -float(level.weight)])
    first = guy_pull(np.zeros(3), top, length, float(level.EA), load, top * 1e3)[0]
    parts = np.linspace(0.0, 1.0, 20001)
    along = first - np.outer(parts * length, load)
    size = np.linalg.norm(along, axis=1, keepdims=True)
    rates = along * (1 / size + 1 / float(level.EA)) * length
    curve = np.cumsum(np.vstack([np.zeros(3), 0.5 * (rates[1:] + rates[:-1])]), axis=0) / 20000
    sag = 11.0 - np.interp(8.0, curve[:, 0], curve[:, 2])
    found = jc.masts.tension_from_sag(mast, 4, sag)
    np.testing.assert_allclose(found[0], np.linalg.norm(first), rtol=1e-6)


@pytest.mark.slow
def test_retensioning_finds_the_lengths_of_guys():
    """Guys let out by known lengths: found from their tensions and the lean to 1e-6 m."""
    mast = small_mast(element_length=6.0)
    found = jc.masts.erect(mast)
    longer = np.array([0.004, -0.002, 0.003, 0.006, 0.001, -0.003])
    phase = jc.Phase(shortening={"guys": -longer})
    now = jc.solve(found.structure, phase, start=found.solution)
    assert int(now.status) == jc.status.OK
    tensions = jc.forms.end_tensions(found.structure, now)["guys"][:, 0]
    lean = np.asarray(now.displacement)[list(mast.layout.guys), :2]
    fitted = jc.masts.retension(mast, tensions, lean, pitch=0.005, order=[3, 4, 5, 0, 1, 2])
    assert int(fitted.status) == jc.status.OK
    np.testing.assert_allclose(fitted.shortening, longer, atol=1e-6)
    np.testing.assert_allclose(fitted.turns, longer / 0.005, atol=1e-3)
    np.testing.assert_allclose(fitted.readings[-1], found.tensions[:, 0], rtol=1e-5)
    np.testing.assert_allclose(fitted.fitted, tensions, rtol=1e-5)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:phase:jaxcable.UnstableWarning")  # a mast without its guys
def test_a_retensioning_that_is_not_found_has_no_turns():
    """Tensions in kN, taken for N: no lengths of guys come near them."""
    mast = small_mast(element_length=6.0)
    wrong = np.asarray(jc.masts.erect(mast).tensions[:, 0]) / 1e6
    found = jc.masts.retension(mast, wrong, pitch=0.005)
    assert int(found.status) != jc.status.OK
    assert np.isnan(found.turns).all() and np.isnan(found.readings).all()
