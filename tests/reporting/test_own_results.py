"""Results of own elements at several places: in reports, tables, files and pictures.

A square membrane, pinned at its edge, with the same prestrain e everywhere: its inner node stays,
and N = E t e / (1 - nu) in every direction, without shear.
"""

import csv
import json
import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from extensions.own_membrane import Membranes, sheet
from oracles.convergence import converged

import jaxcable as jc
from jaxcable.common.tree import pytree
from jaxcable.elements.element import Result

ET, NU = 2e5, 0.25
SHARE = {"top": 2.0, "bottom": -0.5}  # of N, 1/m: stresses of a coated membrane
NEAR = 1e-9  # relative; the tolerance of an analysis is 1e-10


@pytree(indices=("links",))
class Coated(Membranes):
    """A membrane that tells stresses of both sides, and its principal forces, without names."""

    results = (
        Result("skin_stress", "Pa", ("xx", "yy", "xy"), places=("top", "bottom")),
        Result("principal", "N/m"),
    )

    def skin_stress(self, state, ends, motion):
        forces = self.membrane_forces(state, ends, motion)
        return jnp.stack([share * forces for share in SHARE.values()])

    def principal(self, state, ends, motion):
        xx, yy, xy = self.membrane_forces(state, ends, motion)
        return jnp.linalg.eigvalsh(jnp.array([[xx, xy], [xy, yy]]))


def scene(strains=(0.01, 0.03), present=None):
    """The sheet with a cable beside it, and a phase for each prestrain."""
    nodes, triangles = sheet(2)
    nodes = np.concatenate([nodes, [[5.0, 0.0, 0.0], [6.0, 0.0, 0.0]]])
    groups = {"cable": jc.Cables([[9, 10]], 1e4), "sheet": Coated(triangles, ET, NU)}
    held = jc.pinned([0, 1, 2, 3, 5, 6, 7, 8, 9]) + jc.restrained([10], "yz")
    phases = [jc.Phase(prestrain={"cable": 1e-4, "sheet": strain}) for strain in strains]
    phases[0] = jc.replace(phases[0], loads=jc.NodalLoads([10], (1.0, 0.0, 0.0)))
    if present is not None:
        phases[1] = jc.replace(phases[1], removes={"cable": None, "sheet": present})
    structure = jc.Structure(nodes, groups, held)
    return structure, converged(jc.solve(structure, phases))


def force(strain):
    return ET * strain / (1 - NU)


def test_a_report_has_every_place_and_component_and_the_states_of_the_extremes():
    structure, solution = scene()
    found = jc.report(structure, solution, names=["first", "second"])
    table = found.tables["skin_stress"]
    assert table.columns[:8] == (
        *("group", "element", "first", "last", "place"),
        *("xx", "lowest xx", "in"),
    )
    lines = [dict(zip(table.columns, row, strict=True)) for row in table.rows]
    assert [(line["element"], line["place"]) for line in lines] == [
        (k, place) for k in range(8) for place in SHARE
    ]
    for line in lines:
        share = SHARE[line["place"]]
        assert line["xx"] == pytest.approx(share * force(0.03), rel=NEAR)
        low, high = sorted([share * force(0.01), share * force(0.03)])
        assert line["lowest yy"] == pytest.approx(low, rel=NEAR)
        assert line["highest yy"] == pytest.approx(high, rel=NEAR)
        order = ["first", "second"] if share > 0 else ["second", "first"]
        heads = list(table.columns)
        at = [line[heads[heads.index(f"{word} yy") + 1]] for word in ("lowest", "highest")]
        assert at == order
    assert found.tables["principal"].columns[4:6] == ("place", "principal")
    assert {row[4] for row in found.tables["principal"].rows} == {"0", "1"}

    most = found.tables["results"]
    lines = {row[0]: row[1:] for row in most.rows}
    components = ("xx", "yy", "xy")
    assert set(lines) == {"principal", *(f"skin_stress {component}" for component in components)}
    unit, low, group, _, *where_low, high, _, _, place, phase = lines["skin_stress xx"]
    assert (unit, group, where_low) == ("Pa", "sheet", ["bottom", "second"])
    assert (place, phase) == ("top", "second")
    assert low == pytest.approx(SHARE["bottom"] * force(0.03), rel=NEAR)
    assert high == pytest.approx(SHARE["top"] * force(0.03), rel=NEAR)
    heads = found.csv()["results"].splitlines()[0].split(",")
    assert len({*heads}) == len(heads)  # every column of the CSV table has a name of its own
    assert "skin_stress xx" in found.text()
    json.dumps(found.dict(), allow_nan=False)


def test_cases_and_elements_that_are_not_there():
    structure, solution = scene(present=jc.only([3]))
    table = jc.report(structure, solution).tables["skin_stress"]
    gone = [row for row in table.rows if row[1] == 3]
    xx = table.columns.index("xx")
    assert len(gone) == 2 and all(row[xx] is None for row in gone)
    assert gone[0][xx + 3] == pytest.approx(2 * force(0.01), rel=NEAR)  # in phase 1 it was there

    structure, solution = scene()
    cases = jax.tree.map(lambda x: jnp.stack([x, x]), solution)
    table = jc.report(structure, solution, cases=cases, names=["a", "b"]).tables["results"]
    assert {row[6] for row in table.rows} <= {"a", "b"}


def test_files_and_pictures_have_them(tmp_path):
    structure, solution = scene()
    jc.files.save_result(tmp_path / "sheet.csv", structure, solution)
    with (tmp_path / "sheet-elements.csv").open() as stream:
        lines = list(csv.DictReader(stream))
    value = float(lines[1]["skin stress bottom yy (Pa)"])
    assert value == pytest.approx(SHARE["bottom"] * force(0.03), rel=NEAR)
    assert lines[0]["principal 1 (N/m)"] == "" and lines[0]["tension (N)"] != ""
    head = r"SCALARS skin_stress_top_xx double 1\nLOOKUP_TABLE default\n(.*)\n(.*)"
    for increments, name in ((False, "sheet.vtk"), (True, "sheet-0001.vtk")):
        jc.files.save_vtk(tmp_path / "sheet.vtk", structure, solution, increments)
        values = re.search(head, (tmp_path / name).read_text())
        assert np.isnan(float(values[1]))  # the cable
        strain = 0.01 if increments else 0.03
        assert float(values[2]) == pytest.approx(2 * force(strain), rel=NEAR)
    page = str(jc.plots.view(solution, structure=structure, path=None).html)
    labels = [f"skin_stress {place} {k}" for place in SHARE for k in ("xx", "yy", "xy")]
    assert all(f'"label": "{label}"' in page for label in [*labels, "principal 0"])
    jc.plots.net(solution, color="skin_stress bottom xx")


def test_the_contract_asks_for_the_places_that_it_names():
    nodes, triangles = sheet(2)
    jc.elements.check(Coated(triangles, ET, NU), nodes, tol=1e-5)

    @pytree(indices=("links",))
    class Wrong(Coated):
        results = (Result("skin_stress", "Pa", ("xx", "yy", "xy"), places=("top",)),)

    with pytest.raises(ValueError, match="skin_stress has 1 places, in the axis before"):
        jc.elements.check(Wrong(triangles, ET, NU), nodes)
