"""Section forces and stresses in reports, against closed forms and against the solution itself."""

import csv
import io
import json
import re

import jax
import numpy as np
import pytest
from banks import shapes
from golden_files import assert_golden
from oracles.convergence import converged

import jaxcable as jc

LENGTH, WIDTH, HEIGHT = 6.0, 0.1, 0.2  # m
SECTION = jc.Section.rectangle(WIDTH, HEIGHT, jc.Elastic(10e9))
MODULUS = WIDTH * HEIGHT**2 / 6  # of the section, m3
SIMPLE = jc.restrained([0], "xyz", "x") + jc.restrained([1], "yz")
SMALL = 1.0  # N/m: slopes of 1e-5, whose second order is 1e-10
NEAR = 1e-9  # of q L^2, for that


def beam(supports, section=SECTION):
    """A level beam of one element."""
    return shapes.beam(1, section, LENGTH, supports)


def under(structure, force):
    """The solution under a uniform load along z, N/m."""
    return converged(jc.solve(structure, jc.Phase(loads=jc.LineLoads((0.0, 0.0, force)))))


def rows(table, group=None):
    """Lines of a table as dicts; names that occur twice are told apart by spaces."""
    found = [dict(zip(table.columns, row, strict=True)) for row in table.rows]
    return found if group is None else [row for row in found if row["group"] == group]


def test_a_simple_beam_in_one_element():
    structure = beam(SIMPLE)
    told = jc.report(structure, under(structure, -SMALL))
    size = SMALL * LENGTH**2
    (shear,), (moment,) = rows(told.tables["Vz"]), rows(told.tables["My"])
    half = SMALL * LENGTH / 2
    assert [shear["at first"], shear["at last"]] == pytest.approx([-half, half], abs=NEAR * size)
    assert [shear["lowest"], shear["at"]] == pytest.approx([-half, 0.0], abs=NEAR * size)
    assert [shear["highest"], shear["at "]] == pytest.approx([half, 1.0], abs=NEAR * size)
    assert moment["lowest"] == pytest.approx(-size / 8, abs=NEAR * size)
    assert moment["at"] == pytest.approx(0.5, abs=1e-9)
    assert [moment["highest"], moment["at first"]] == pytest.approx([0.0, 0.0], abs=NEAR * size)
    assert (moment["first"], moment["last"]) == (0, 1)
    assert not {"Vy", "T", "Mz"} & set(told.tables)
    assert "Vy, T, Mz: zero everywhere" in told.tables["N"].notes
    (stress,) = rows(told.tables["stresses"])
    edge = size / 8 / MODULUS  # tension below
    assert [stress["lowest"], stress["highest"]] == pytest.approx([-edge, edge], rel=1e-6)
    assert [stress["z"], stress["z "]] == pytest.approx([HEIGHT / 2, -HEIGHT / 2])
    assert [stress["at"], stress["at "]] == pytest.approx([0.5, 0.5], abs=1e-4)
    assert stress["used"] is None  # a linear law has no strength
    # a single state: no envelope; a single element: no cable that runs through several
    assert "min" not in told.tables["My"].columns
    assert not {"stress_envelope", "cables"} & set(told.tables)
    assert told.tables["cutting_list"].columns[-1] == "unstressed length"


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.0, 0.3])
def test_extremes_between_places_where_axial_forces_bend(share):
    """A propped column of one element under a part of Euler's load.

    Without that by closed forms; with it against forces at 2001 places.
    """
    structure = beam(jc.clamped([0]) + jc.restrained([1], "yz"))
    euler = np.pi**2 * 10e9 * WIDTH * HEIGHT**3 / 12 / LENGTH**2
    load = 1e3 if share else SMALL
    loads = [jc.LineLoads((0.0, 0.0, -load)), jc.NodalLoads([1], (-share * euler, 0.0, 0.0))]
    solution = jc.solve(structure, jc.Phase(loads=loads, increments=2))
    told = converged(jc.report(structure, solution))
    (shear,), (moment,), (stress,) = (rows(told.tables[n]) for n in ("Vz", "My", "stresses"))
    if share:
        exact = np.asarray(jc.section_forces(structure, solution, 2001))[0]
        for row, k in ((shear, 2), (moment, 4)):
            near = 1e-5 * np.abs(exact[:, k]).max()
            assert abs(row["lowest"] - exact[:, k].min()) < near
            assert abs(row["highest"] - exact[:, k].max()) < near
        where = np.linspace(0, 1, 2001)[exact[:, 4].argmin()]
        assert moment["at"] == pytest.approx(where, abs=2e-3)
        return
    size = SMALL * LENGTH**2
    assert [moment["highest"], moment["at "]] == pytest.approx([size / 8, 0.0], abs=NEAR * size)
    assert moment["lowest"] == pytest.approx(-9 * size / 128, abs=NEAR * size)
    assert moment["at"] == pytest.approx(5 / 8, abs=1e-6)
    ends = [-5 / 8 * SMALL * LENGTH, 3 / 8 * SMALL * LENGTH]
    assert [shear["at first"], shear["at last"]] == pytest.approx(ends, abs=NEAR * size)
    # the moment at the clamp governs; axial forces of second order are 1e-5 of it
    assert stress["highest"] == pytest.approx(size / 8 / MODULUS, rel=1e-5)
    assert (stress["at "], stress["z "]) == (0.0, pytest.approx(HEIGHT / 2))


@pytest.mark.slow
def test_a_force_that_is_rounding_has_no_place():
    """A load is taken away again: what is left of its shear has no extreme, its envelope has."""
    group = jc.Beams([[0, 1], [1, 2]], section=SECTION)
    along = np.array([1.0, 2.0, 0.5])
    structure = jc.Structure(np.outer([0.0, 1.0, 2.0], along), group, jc.clamped([0]))
    loads = [jc.NodalLoads([2], (0.0, 0.0, -20.0)), jc.LineLoads((30.0, 0.0, 0.0))]
    away = jc.LineLoads((-30.0, 0.0, 0.0))
    phases = [jc.Phase(loads=loads), jc.Phase(loads=away)]
    solution = converged(jc.solve(structure, phases))
    told = rows(jc.report(structure, solution, phases).tables["Vy"])
    for row in told:
        assert row["lowest"] == row["highest"] == 0.0  # of 60 N
        assert row["at"] is None and row["at "] is None
        assert "phase 1" in (row["in"], row["in "])
        assert [row["at  "], row["at   "]] != [None, None]


def test_a_cantilever_with_a_load_at_its_tip():
    """Clamped at its last node; long tables show the elements that govern, which are there."""
    count = 4
    structure = shapes.beam(count, SECTION, LENGTH, jc.clamped([count]))
    load = jc.NodalLoads([0], (0.0, 0.0, -SMALL))
    told = converged(jc.report(structure, jc.solve(structure, jc.Phase(loads=load))))
    moment, shear = rows(told.tables["My"])[-1], rows(told.tables["Vz"])[-1]
    bend = SMALL * LENGTH
    assert [moment["at first"], moment["at last"]] == pytest.approx([0.75 * bend, bend], abs=1e-8)
    assert [moment["lowest"], moment["at"]] == pytest.approx([0.75 * bend, 0.0], abs=1e-8)
    assert shear["lowest"] == pytest.approx(SMALL, rel=1e-8)
    assert shear["at"] is None and shear["at "] is None  # the same all along
    stress = rows(told.tables["stresses"])[-1]
    assert stress["highest"] == pytest.approx(bend / MODULUS, rel=1e-6)
    (clamp,) = rows(told.tables["reactions"])
    assert clamp["My"] == pytest.approx(bend, rel=1e-8) and clamp["Rz"] == pytest.approx(SMALL)
    part = told.text(rows=2).split("My, bending")[1].split("Stresses")[0].splitlines()
    lines = [line.split() for line in part]
    first = next(k for k, words in enumerate(lines) if words and words[0] == "3")
    assert [words[0] for words in lines[first : first + 2]] == ["3", "2"]
    assert "the largest 2 of 4" in part[first + 2]


@pytest.mark.slow
def test_envelopes_name_the_case_that_governs():
    """1 N/m down and 0.5 N/m up, from a start without load; a third case fails."""
    structure = beam(SIMPLE)
    start = under(structure, 0.0)

    def case(q):
        load = jc.LineLoads((0.0, 0.0, q))
        return jc.solve(structure, jc.Phase(loads=load, increments=2), start=start)

    cases = jax.tree.map(lambda *of: np.stack(of), *map(case, (-1.0, 0.5, np.nan)))
    assert cases.status.tolist()[:2] == [0, 0] and int(cases.status[2]) != 0
    told = jc.report(structure, start, cases=cases, names=["snow", "wind", "broken"])
    (moment,) = rows(told.tables["My"])
    size = LENGTH**2 / 8
    assert [moment["min"], moment["at  "]] == pytest.approx([-size, 0.5], abs=1e-7)
    assert [moment["max"], moment["at   "]] == pytest.approx([0.5 * size, 0.5], abs=1e-7)
    assert (moment["in"], moment["in "]) == ("snow", "wind")
    assert moment["lowest"] == moment["highest"] == 0.0  # at the end of `start`
    (stress,) = rows(told.tables["stress_envelope"])
    ends = [-size / MODULUS, size / MODULUS]
    assert [stress["lowest"], stress["highest"]] == pytest.approx(ends, rel=1e-6)
    assert (stress["in"], stress["in "]) == ("snow", "snow")
    assert stress["z"] == pytest.approx(HEIGHT / 2)
    assert "broken" not in told.csv()["My"] and "nan" not in told.text()
    json.dumps(told.dict(), allow_nan=False)
    calm = jax.tree.map(lambda x: np.asarray(x)[1:2], cases)
    (alone,) = rows(jc.report(structure, start, cases=calm).tables["stress_envelope"])
    # upwards, -z is pressed; half of the load comes first, and counts nowhere
    assert (alone["in"], alone["z"]) == ("case 0", pytest.approx(-HEIGHT / 2))


@pytest.mark.slow
def test_envelopes_over_phases_and_of_a_failed_analysis():
    """1 N/m down, then 1.5 N/m up in three increments: both ends govern one side.

    Where the second phase fails, the first one is reported; nothing, where that one fails.
    """
    reports = []
    for first, second in ((-1.0, 1.5), (-1.0, np.nan), (np.nan, 0.0)):
        loads = [jc.LineLoads((0.0, 0.0, q)) for q in (first, second)]
        phases = [jc.Phase(loads=loads[0]), jc.Phase(loads=loads[1], increments=3)]
        reports.append(jc.report(beam(SIMPLE), jc.solve(beam(SIMPLE), phases)))
    told, failed, nothing = reports
    size = LENGTH**2 / 8
    assert told.status == 0 and failed.status != 0 != nothing.status
    (moment,) = rows(told.tables["My"])
    assert [moment["min"], moment["max"]] == pytest.approx([-size, 0.5 * size], abs=1e-7)
    assert (moment["in"], moment["in "]) == ("phase 1", "phase 2")
    assert moment["highest"] == pytest.approx(0.5 * size, abs=1e-7)
    (end,), (all_,) = (rows(told.tables[n]) for n in ("stresses", "stress_envelope"))
    assert end["highest"] == pytest.approx(0.5 * size / MODULUS, rel=1e-6)
    assert all_["highest"] == pytest.approx(size / MODULUS, rel=1e-6)
    assert (all_["in "], all_["z "]) == ("phase 1", pytest.approx(-HEIGHT / 2))
    (moment,), (stress,) = (rows(failed.tables[n]) for n in ("My", "stresses"))
    assert moment["lowest"] == pytest.approx(-size, abs=1e-7)
    assert (moment["min"], moment["in"]) == (moment["lowest"], "phase 1")
    assert stress["highest"] == pytest.approx(size / MODULUS, rel=1e-6)
    assert not {"My", "stresses"} & set(nothing.tables)
    for of in (failed, nothing):
        json.dumps(of.dict(), allow_nan=False)


def test_an_increment_within_a_phase_governs_by_its_load_factor():
    """A strut that is pulled while its end comes down: the largest stress is not at an end."""
    steel = jc.Bars([[0, 1], [1, 2]], area=1e-4, law=jc.Elastic(210e9))
    nodes = [[0.0, 0, 0], [1.0, 0, 0.01], [2.0, 0, 0]]
    structure = jc.Structure(nodes, steel, jc.pinned([0, 2]) + jc.restrained([1], "xyz"))
    moved = jc.Phase(loads=jc.SupportMovement([1], (0.0, 0.0, -0.02)), increments=4)
    told = converged(jc.report(structure, jc.solve(structure, moved)))
    first = rows(told.tables["stress_envelope"])[0]
    assert first["in"] == "phase 1, 0.5"  # straight
    strain = 1 / np.hypot(1.0, 0.01) - 1
    assert first["lowest"] == pytest.approx(210e9 * strain, rel=1e-9)
    assert first["at"] is None and first["y"] is None  # the same all over a bar
    # back at its length; rounding of lengths, 1e-16, of 210 GPa
    assert rows(told.tables["stresses"])[0]["lowest"] == pytest.approx(0.0, abs=1e-3)


def test_bars_that_are_taken_away_have_no_values():
    """Two bars side by side share 100 N; then one of them bears it."""
    bars = {name: jc.Bars([[0, 1]], area=1e-4, law=jc.Elastic(1e9)) for name in ("stay", "prop")}
    guide = jc.pinned([0]) + jc.restrained([1], "xy")
    structure = jc.Structure([[0.0, 0, 0], [0, 0, -1]], bars, guide)
    phases = [jc.Phase(loads=jc.NodalLoads([1], (0, 0, -100.0))), jc.Phase(removes="prop")]
    told = converged(jc.report(structure, jc.solve(structure, phases)))
    active = [line.split("; ")[-1] for line in told.summary if line.startswith("phase")]
    assert active == ["2 of 2 elements active", "1 of 2 elements active"]
    (stay,), (prop,) = (rows(told.tables["members"], name) for name in bars)
    assert prop["force"] is None and prop["highest"] == pytest.approx(50.0, rel=1e-4)
    assert (prop["in"], prop["in "], stay["in "]) == ("phase 1", "phase 1", "phase 2")
    assert stay["force"] == stay["highest"] == pytest.approx(100.0, rel=1e-9)
    (stress,) = rows(told.tables["stresses"], "prop")
    assert set(stress.values()) == {"prop", 0, None}
    (ever,) = rows(told.tables["stress_envelope"], "prop")
    assert ever["highest"] == pytest.approx(50.0 / 1e-4, rel=1e-4) and ever["in "] == "phase 1"
    absent = "the element is not active in the final state"
    assert f"no final force: {absent}" in told.tables["members"].notes
    assert f"no stress: {absent}" in told.tables["stresses"].notes
    assert not {"slack", "loose", "present"} & told.tables.keys()


@pytest.mark.slow
def test_beams_that_are_not_there_have_no_values():
    """A cantilever is prolonged, and its prop, another beam, taken away again."""
    nodes = [[0.0, 0, 0], [2, 0, 0], [4, 0, 0], [2, 0, -1]]
    groups = {
        "deck": jc.Beams([[0, 1], [1, 2]], section=SECTION),
        "prop": jc.Beams([[3, 1]], section=SECTION, up=(1.0, 0.0, 0.0)),
    }
    structure = jc.Structure(nodes, groups, jc.clamped([0, 3]))
    load = [jc.NodalLoads([k], (0.0, 0.0, -10.0)) for k in (1, 2)]
    longer = jc.Phase(adds={"deck": jc.only([1]), "prop": None}, loads=load[1])
    solution = jc.solve(structure, [jc.Phase(loads=load[0]), longer, jc.Phase(removes="prop")])
    told = converged(jc.report(structure, solution))
    (prop,) = rows(told.tables["N"], "prop")
    names = "at first", "at last", "lowest", "at", "highest", "at "
    assert [prop[name] for name in names] == [None] * 6
    # the second phase adds to the first; along the bent prop the force varies by 1e-5
    exact = np.asarray(solution.phases[1].section_forces["prop"])[0, 0, 0]
    assert prop["min"] == pytest.approx(exact, rel=1e-4) and prop["in"] == "phase 2"
    come = rows(told.tables["My"], "deck")[1]
    assert come["min"] is not None and "phase 1" not in (come["in"], come["in "])
    assert "no values: the element is not active in the final state" in told.tables["N"].notes
    json.dumps(told.dict(), allow_nan=False)


def test_stresses_of_bars_and_cables_by_their_areas_and_strengths():
    """Two strands in a row under 100 kN, of 1 and 2 cm2, and a bar of two laws beside them."""
    square = jc.Section.rectangle
    mixed = jc.Section.composite(
        [
            square(0.01, 0.01, jc.Elastic(200e9)),
            square(0.01, 0.01, jc.Elastic(50e9)).shifted(0.0, 0.01),
        ]
    )
    groups = {
        "bar": jc.Bars([[0, 2]], section=mixed),
        "strands": jc.Cables([[0, 1], [1, 2]], area=[1e-4, 2e-4], law=jc.materials.strand()),
        "tie": jc.Bars([[0, 1]], axial_stiffness=1e3),
    }
    guides = jc.pinned([0]) + jc.restrained([1, 2], "xy")
    structure = jc.Structure([[0.0, 0, 0], [0, 0, -1], [0, 0, -3]], groups, guides)
    solution = jc.solve(structure, jc.Phase(loads=jc.NodalLoads([2], (0.0, 0.0, -100e3))))
    told = converged(jc.report(structure, solution))
    stress = np.asarray(solution.tension["strands"]) / np.array([1e-4, 2e-4])
    found = rows(told.tables["stresses"], "strands")
    np.testing.assert_allclose([row["highest"] for row in found], stress, rtol=1e-12)
    np.testing.assert_allclose([row["used"] for row in found], stress / 1860e6, rtol=1e-12)
    assert [row["lowest"] for row in found] == [row["highest"] for row in found]
    (bar,) = rows(told.tables["stresses"], "bar")
    # 1 cm2 each: the stiffer part takes four fifths of the force
    share = float(solution.tension["bar"][0]) / 5e-4
    assert [bar["lowest"], bar["highest"]] == pytest.approx([share, 4 * share], rel=1e-9)
    assert bar["z"] > 0.005 > bar["z "] and bar["used"] is None
    fibre = jc.fibre_stress(structure, solution.phases[0])
    assert fibre["tie"] is None
    np.testing.assert_allclose(fibre["strands"], stress[None], rtol=1e-12)
    assert not rows(told.tables["stresses"], "tie")
    assert "tie: no area given, so no stress" in told.tables["stresses"].notes
    assert not {"N", "My"} & set(told.tables)


@pytest.mark.slow
def test_stresses_beyond_the_linear_range_are_those_of_the_fibres():
    """A law that bends at 1 MPa: stresses of fibres, and their share of 1.2 MPa."""
    law = jc.Polygonal([-3e-4, -1e-4, 0.0, 1e-4, 3e-4], [-1.2e6, -1e6, 0.0, 1e6, 1.2e6])
    section = jc.Section.rectangle(WIDTH, HEIGHT, law, (20, 20))
    structure = beam(SIMPLE, section)
    solution = jc.solve(structure, jc.Phase(loads=jc.LineLoads((0.0, 0.0, -160.0)), increments=4))
    told = converged(jc.report(structure, solution))
    every = np.asarray(jc.fibre_stress(structure, solution.phases[0]))
    (end,), (ever,) = (rows(told.tables[n]) for n in ("stresses", "stress_envelope"))

    # computed by two programs: at 15 of 20 loads their last digits differ, by at most 1.5 eps
    def alike(*values):
        return pytest.approx(values, rel=4 * np.finfo(float).eps, abs=0.0)

    assert (end["lowest"], end["highest"]) == alike(every[-1].min(), every[-1].max())
    assert (ever["lowest"], ever["highest"]) == alike(every.min(), every.max())
    assert every.max() > 1e6 and end["used"] == pytest.approx(np.abs(every[-1]).max() / 1.2e6)
    assert end["z "] == pytest.approx(-0.095)
    # the outermost fibre has its centre at 95 mm of 100
    assert any("further out by 5.3 % (beams)" in note for note in told.tables["stresses"].notes)


@pytest.fixture(scope="module")
def mast():
    structure, phases = jc.scenes.guyed_mast(30.0, 1, per_level=2, wind=3e3, increments=(1, 2))
    solution = converged(jc.solve(structure, phases))
    told = jc.report(structure, solution, phases, names=["prestress", "wind"])
    return structure, phases, solution, told


def test_a_report_of_a_mast_is_fit_to_hand_in(mast):
    structure, _, _, told = mast
    text = told.text()
    # two guys have the same force: which of them has the smaller one is rounding
    assert_golden("mast.txt", re.sub(r"(guys +3 +\S+) +[12] ", r"\1   1, 2 ", text))
    assert max(map(len, text.splitlines()[4:])) <= 120  # after the summary
    for name, content in told.csv().items():
        head = next(csv.reader(io.StringIO(content)))  # names of columns are apart
        assert name == "summary" or len(head) == len({*head}) == len(told.tables[name].columns)
    data = json.loads(json.dumps(told.dict(), allow_nan=False))
    assert data["tables"]["My"]["rows"] == told.tables["My"].rows
    assert len(data["tables"]["My"]["rows"]) == len(structure.elements["mast"].links)


@pytest.mark.slow
def test_reactions_have_the_components_that_supports_hold():
    """A beam on a fork that turns, a roller aslant, and a prop that is taken away."""
    nodes = [[0.0, 0, 0], [3, 0, 0], [6, 0, 0]]
    group = jc.Beams([[0, 1], [1, 2]], section=SECTION)
    fork = jc.restrained([0], "xyz", "x")
    aslant = jc.restrained([2], "z", axes=[[0.8, 0, -0.6], [0, 1, 0], [0.6, 0, 0.8]])
    side = jc.restrained([1], "y")
    before = fork + aslant + jc.restrained([1], "yz")
    structure = jc.Structure(nodes, group, before)
    load = jc.Phase(loads=jc.LineLoads((0.0, 0.0, -SMALL)))
    solution = jc.solve(structure, [load, jc.Phase(supports=fork + aslant + side)])
    told = converged(jc.report(structure, solution))
    first, middle, last = rows(told.tables["reactions"])
    assert None not in [first[n] for n in ("Rx", "Ry", "Rz", "Mx")]
    assert first["My"] is None and first["Mz"] is None
    assert last["Ry"] is None and last["Rx"] / last["Rz"] == pytest.approx(0.75, rel=1e-9)
    assert (middle["Rx"], middle["Rz"]) == (None, None) and middle["Ry"] is not None
    # a prop that is taken away keeps its largest reaction: who built it needs it
    carried = np.linalg.norm(np.asarray(solution.phases[0].reactions)[1])
    assert middle["in"] == "phase 1" and middle["largest R"] == pytest.approx(carried)
    assert carried > SMALL
    assert "blank: direction not supported in the final state" in told.tables["reactions"].notes
    assert "on the structure" in told.tables["reactions"].title


@pytest.mark.slow
def test_springs_and_bearings_are_among_the_reactions():
    """q L / 2 on a bearing at one end; at the other q L / 2 too, and a spring takes the torque.

    The sum is the load, as in the global equilibrium.
    """
    group = jc.Beams([[0, 1]], section=SECTION)
    elements = {
        "beam": group,
        "pad": jc.GroundContacts([1], 1e6),
        "soil": jc.Springs([0], (0.0, 0.0, 1e6), rotational_stiffness=(5e4, 0.0, 0.0)),
    }
    held = jc.restrained([0], "xy", "z") + jc.restrained([1], "y")
    structure = jc.Structure([[0.0, 0, 0], [LENGTH, 0, 0]], elements, held)
    torque, load = 0.4, jc.LineLoads((0.0, 0.0, -SMALL), on="beam")
    twist = jc.NodalLoads([1], (0.0, 0.0, 0.0), (torque, 0.0, 0.0))
    solution = converged(jc.solve(structure, jc.Phase(loads=[load, twist])))
    told = jc.report(structure, solution)
    table = told.tables["reactions"]
    found = {(row["by"], row["node"]): row for row in rows(table)}
    assert set(found) == {("support", 0), ("support", 1), ("pad 0", 1), ("soil 0", 0)}
    half = SMALL * LENGTH / 2
    for key in (("pad 0", 1), ("soil 0", 0)):
        assert [found[key]["Rz"], found[key]["R"]] == pytest.approx([half, half], rel=1e-6)
    assert found["soil 0", 0]["Mx"] == pytest.approx(-torque, rel=1e-6)
    assert found["pad 0", 1]["Mx"] is None and found["support", 1]["Rz"] is None
    assert table.notes[0] == "sum of the forces: (0, 0, 6) N"
    (sums,) = (row for row in told.tables["equilibrium"].rows if row[0] == "reactions")
    assert sum(row["Rz"] or 0.0 for row in found.values()) == pytest.approx(sums[3], rel=1e-9)
    assert all(row["group"] == "beam" for row in rows(told.tables["tilts"]))  # springs have none


def test_reactions_balance_the_wind_about_the_foot_of_a_mast(mast):
    """Forces along the wind, and all moments, where nodes are in the end."""
    _, phases, solution, told = mast
    table = told.tables["reactions"]
    assert table.columns[5:8] == ("Mx", "My", "Mz") and table.units[5] == "N m"
    total = {row[0]: row[1] for row in told.tables["equilibrium"].rows}
    wind = np.asarray(phases[1].loads.forces)[:, 0].sum()
    assert wind > 0 and total["reactions"] == pytest.approx(-wind, rel=1e-8)
    places = np.asarray(solution.positions)
    moments = np.cross(places, np.asarray(solution.load)).sum(axis=0)
    for row in table.rows:
        moments += np.cross(places[row[0]], row[1:4])
        moments += [value or 0.0 for value in row[5:8]]
    # the weight of leaning elements acts on nodes by moments, too, w l^2/12 times the lean: 2e-4
    assert np.abs(moments).max() < 5e-4 * wind * 30.0


def test_groups_have_their_extremes_and_what_governs(mast):
    """Against the forces of the phases themselves, by NumPy."""
    structure, _, solution, told = mast
    table = told.tables["groups"]
    assert sorted(row["group"] for row in rows(table)) == sorted(structure.elements)
    for group, count, low, of, when, high, of_high, when_high, *_ in table.rows:
        force = np.array([np.asarray(p.peak_tension[group]) for p in solution.phases])
        assert count == force.shape[1]
        assert (low, high) == (force.min(), force.max())
        assert force[["prestress", "wind"].index(when), of] == low
        assert force[["prestress", "wind"].index(when_high), of_high] == high
    assert len({tuple(row[2:8]) for row in table.rows}) == len(structure.elements) > 1


def statics(loads, q=0.0):
    """Vz and My at many places of the simple beam by cutting it, with both sides of each load.

    `loads` are tuples (place from 0 to 1, force along z, moment about y); q acts along z, N/m.
    """
    cuts = np.array([load[0] for load in loads])
    s = np.concatenate([np.linspace(0.0, 1.0, 20001), cuts, cuts])
    beyond = np.concatenate([np.zeros(20001 + len(cuts)), np.ones(len(cuts))])
    x = LENGTH * s
    # reaction at the start, along z, from the moments of all loads about the other end
    about = sum(f * (1 - a) * LENGTH + m for a, f, m in loads) + q * LENGTH**2 / 2
    shear = np.full(len(x), about / LENGTH) - q * x
    moment = about / LENGTH * x - q * x**2 / 2
    for a, f, m in loads:
        passed = (s > a) | ((s == a) & (beyond > 0))
        shear = shear - f * passed
        moment = moment - (f * (x - a * LENGTH) + m) * passed
    return s, shear, moment


@pytest.mark.slow
def test_extremes_at_loads_within_an_element():
    """Two forces, a couple and a line load; then the first force is gone: both phases govern.

    Between places of the elements the report follows the loads, not a polynomial.
    """
    first = [(0.3, -1.0, 0.0), (0.8, -0.6, 0.0), (0.55, 0.0, 1.5)]
    second = [(0.3, 2.0, 0.0)]
    structure, line = beam(SIMPLE), 0.2
    each = [
        jc.PointLoads([0] * len(p), [a for a, *_ in p], [(0, 0, f) for _, f, _ in p],
                      [(0, m, 0) for *_, m in p])
        for p in (first, second)
    ]  # fmt: skip
    phases = [
        jc.Phase(loads=[each[0], jc.LineLoads((0.0, 0.0, line))]),
        jc.Phase(loads=each[1], increments=2),
    ]
    solution = converged(jc.solve(structure, phases))
    told = jc.report(structure, solution)
    ways = [statics([*first, (0.3, 0.0, 0.0)], line), statics(first + second, line)]
    for name, k in (("Vz", 1), ("My", 2)):
        (row,) = rows(told.tables[name])
        end = ways[1][k]
        # slopes of 1e-5; the places of the oracle are 3e-4 m apart: q dx^2 is 1e-8 N m
        assert [row["lowest"], row["highest"]] == pytest.approx([end.min(), end.max()], abs=3e-8)
        both = np.concatenate([way[k] for way in ways])
        assert [row["min"], row["max"]] == pytest.approx([both.min(), both.max()], abs=3e-8)
        assert np.abs(end - ways[0][k]).max() > 0.5
    (row,) = rows(told.tables["My"])
    s, _, moment = ways[1]
    assert row["at "] == pytest.approx(s[moment.argmax()], abs=1e-4)
    (stress,), (all_,) = (rows(told.tables[n]) for n in ("stresses", "stress_envelope"))
    largest = np.abs(moment).max() / MODULUS
    assert [stress["lowest"], stress["highest"]] == pytest.approx([-largest, largest], rel=1e-6)
    largest = max(np.abs(way[2]).max() for way in ways) / MODULUS
    assert [all_["lowest"], all_["highest"]] == pytest.approx([-largest, largest], rel=1e-6)
