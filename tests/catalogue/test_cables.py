"""Cables by name: every row of the tables, formulas of standards, tables of users, elements."""

import json
import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcable as jc
from jaxcable.catalogue import tables
from jaxcable.files import FileError

NAMES = jc.catalogue.cable_names()
ALL = [jc.catalogue.cable(name) for name in NAMES]

# Of each kind: range of the modulus, GPa; of the metallic area over the circle; of breaking force
# over area, MPa; of the density, kg/m3. Moduli: EN 1993-1-11, table 3.1 (+-10; suppliers of Galfan
# spiral strands state 160 +-10); fill factors: table 2.2, with what suppliers exceed; densities:
# steel with zinc, filling and lay, 83 kN/m3 = 8464 kg/m3 in EN 1993-1-11 (+-6 %)
RANGES = {
    "spiral strand": ((140, 170), (0.73, 0.79), (1480, 1730), (7950, 8970)),
    "stainless spiral strand": ((120, 140), (0.73, 0.79), (1250, 1460), (7950, 8970)),
    "full locked coil rope": ((150, 170), (0.84, 0.92), (1350, 1560), (7950, 8970)),
    "stainless full locked coil rope": ((120, 140), (0.84, 0.88), (1280, 1400), (7950, 8970)),
    "prestressing strand": ((195, 195), (0.75, 0.78), (1765, 1870), (7790, 7830)),
    "bar": ((205, 205), (0.999, 1.001), (415, 700), (7650, 8050)),
    "conductor": ((55, 110), (0.70, 0.79), (150, 590), (2700, 4900)),
}


@pytest.mark.parametrize("kind", RANGES)
def test_every_row_is_plausible(kind):
    rows = [data for data in ALL if data.kind == kind]
    assert [data.name for data in rows] == jc.catalogue.cable_names(kind) and len(rows) >= 4
    for data in rows:
        circle = np.pi / 4 * data.diameter**2
        found = (
            data.modulus / 1e9,
            data.area / circle,
            data.strength / data.area / 1e6,
            data.mass / data.area,
        )
        for value, (low, high) in zip(found, RANGES[kind], strict=True):
            assert low <= value * (1 + 1e-9) and value * (1 - 1e-9) <= high, (data.name, found)
        assert data.source and data.modulus_state in ("after bedding-in", "final", "")
        assert 1.1e-5 < data.expansion < 2.4e-5


def test_rows_increase_with_the_diameter():
    """Within a series of one source and kind: area, stiffness, weight and strength."""
    series = {}
    for data in ALL:
        word = re.sub(r"[\d.]+$", "", data.name)
        if data.kind != "conductor" and not data.name.startswith("Y"):
            series.setdefault((word, data.kind), []).append(data)
    assert len(series) == 11
    for rows in series.values():
        for name in ("diameter", "area", "axial_stiffness", "weight", "strength"):
            values = [getattr(data, name) for data in rows]
            assert (np.diff(values) > 0).all(), (rows[0].name, name)


def test_conductors_are_the_sum_of_their_wires():
    """Area of wires; mass by 2703 and 7780 kg/m3 (EN 60889, EN 50189) with 0.7 to 2.8 % for lay;
    diameter by layers; strength by that of wires, 165 and 1170 MPa, within 6 %."""
    across = {"6/1": (2, 1), "12/7": (2, 3), "14/7": (2, 3), "14/19": (2, 5), "24/7": (4, 3)}
    across |= {"26/7": (4, 3), "30/7": (4, 3), "45/7": (6, 3), "48/7": (6, 3), "54/7": (6, 3)}
    across |= {"54/19": (6, 5), "7": (3,), "19": (5,), "37": (7,), "61": (9,), "91": (11,)}
    checked = 0
    for data in ALL:
        wires = re.findall(r"(\d+)x([\d.]+) (?:Al|steel)", data.construction)
        if data.kind != "conductor" or not wires:
            continue
        checked += 1
        count, wide = np.array(wires, float).T
        area = count * np.pi / 4 * wide**2
        layers = across["/".join(number for number, _ in wires)]
        strength, density = np.array([165.0, 1170.0]), np.array([2703.0, 7780.0])
        # sums of two areas, each rounded to 0.1 mm2
        assert abs(1e6 * data.area - area.sum()) < 0.11, data.name
        lay = 1e6 * data.mass / (area @ density[: len(area)])
        assert 1.007 < lay < 1.0285, data.name
        # mm, three digits; small wires are rounded to 0.01 mm
        assert abs(1e3 * data.diameter / (np.array(layers) @ wide) - 1) < 0.006, data.name
        assert abs(data.strength / (area @ strength[: len(area)]) - 1) < 0.15, data.name
        if len(area) == 2:
            assert abs(data.strength / (area @ strength) - 1) < 0.06, data.name
    assert checked == 36 + 16


def test_published_numbers_of_single_cables():
    """Numbers as printed, which other sources have, too."""
    strand = jc.catalogue.cable("Y1860S7 15.7")  # DYWIDAG 2006: 150 mm2, 1.18 kg/m, 279 kN, 195 GPa
    assert strand.area == pytest.approx(150e-6) and strand.strength == pytest.approx(279e3)
    assert strand.mass == pytest.approx(1.18, rel=0.01) and strand.modulus == pytest.approx(195e9)
    drake = jc.catalogue.cable(
        "ACSR Drake"
    )  # GO 95 (California), table 23: 1.093 lb/ft, 0.7261 in2
    assert drake.mass == pytest.approx(1.093 * 0.45359237 / 0.3048, rel=0.002)
    assert drake.area == pytest.approx(0.7261 * 0.0254**2, rel=0.001)
    assert drake.modulus == pytest.approx(10.1e6 * 6894.757, rel=0.001)  # 6.4 + 3.7 million psi
    stainless = jc.catalogue.cable("stainless 1x19 8")  # Ronstan prints 52.8 kN
    assert stainless.strength == pytest.approx(38.2e-6 * 1570e6 * 0.88, rel=0.002)
    for thread in ("M12", "M30", "M64", "M100"):
        weak, strong = (jc.catalogue.cable(f"Macalloy {g} {thread}") for g in (460, 520))
        assert strong.strength / weak.strength == pytest.approx(660 / 610, rel=0.012)  # f_u


# --- formulas


def test_ropes_have_the_numbers_that_standards_print():
    """ASTM A1023-02, table C.1, 6x7 with fibre core: kg/100 m, and kN of grades 1770 and 1960."""
    printed = {
        6: (12.4, 21.2, 23.4),
        10: (34.5, 58.8, 65.1),
        20: (138, 235, 260),
        36: (447, 762, 843),
    }
    for d, (mass, *forces) in printed.items():
        for grade, force in zip((1770e6, 1960e6), forces, strict=True):
            rope = jc.catalogue.rope("6x7 FC", 1e-3 * d, grade=grade)
            assert 100 * rope.mass == pytest.approx(mass, rel=0.005)
            assert rope.strength / 1e3 == pytest.approx(force, rel=0.005)
    steel = jc.catalogue.rope("6x36 iwrc", 0.020)
    assert steel.strength is None and "strength" not in steel.keys()
    assert steel.modulus == pytest.approx(100e9) and steel.area == pytest.approx(0.460 * 400e-6)


def test_strands_by_formula_are_near_those_of_suppliers():
    """EN 1993-1-11: areas within 6 % of tables, weights within 8 %; the table of the standard."""
    for formula, layers, name in (
        ("spiral strand", 3, "Galfan spiral strand 24"),
        ("spiral strand", 7, "Redaelli OSS 60"),
        ("full locked coil rope", 2, "Redaelli FLC 32"),
        ("full locked coil rope", 3, "Redaelli FLC 100"),
        ("stainless spiral strand", 2, "stainless 1x19 12"),
    ):
        data = jc.catalogue.cable(name)
        rope = jc.catalogue.rope(formula, data.diameter, layers=layers)
        assert rope.area / data.area == pytest.approx(1, abs=0.075), name
        assert rope.weight / data.weight == pytest.approx(1, abs=0.08), name
        assert rope.axial_stiffness / data.axial_stiffness == pytest.approx(1, abs=0.15), name
    factor = [
        jc.catalogue.rope("spiral strand", 0.02, layers=n).area / (np.pi / 4 * 0.02**2)
        for n in (1, 2, 3, 6, 7, 9)
    ]
    np.testing.assert_allclose(factor, [0.77, 0.76, 0.75, 0.75, 0.73, 0.73])


# --- elements


def test_a_record_goes_into_elements():
    data = jc.catalogue.cable("Redaelli FLC 40")
    arguments = dict(**data)
    assert list(arguments) == ["axial_stiffness", "weight", "strength", "expansion"]
    for kind in (jc.Cables, jc.Catenaries, jc.Bars):
        group = kind([[0, 1], [1, 2]], **data)
        for name, value in arguments.items():
            np.testing.assert_array_equal(getattr(group, name), [value, value])
    assert jc.SlidingCables([[0, 1, 2]], **data).axial_stiffness[0] == data.axial_stiffness
    with pytest.raises(KeyError):
        data["diameter"]
    many = jc.catalogue.cable("Y1860S7 15.3", count=19)
    one = jc.catalogue.cable("Y1860S7 15.3")
    for name in arguments:
        factor = 1 if name == "expansion" else 19
        assert many[name] == pytest.approx(factor * one[name], rel=1e-15)
    assert many.diameter is None and many.modulus == pytest.approx(one.modulus)


# --- own tables

COLUMNS = "name,area_mm2,axial_stiffness_MN,mass_kg_per_m,breaking_force_kN"


def test_own_tables(tmp_path):
    (tmp_path / "a.csv").write_text(f"{COLUMNS}\nridge,548,88.9,4.53,912\nvalley,244,39.0,,408\n")
    own = jc.catalogue.load(tmp_path / "a.csv")
    assert list(own) == ["ridge", "valley"]
    ridge = own["ridge"]
    assert ridge.axial_stiffness == pytest.approx(88.9e6) and ridge.area == pytest.approx(548e-6)
    assert ridge.weight == pytest.approx(4.53 * 9.80665) and ridge.strength == pytest.approx(912e3)
    assert ridge.expansion is None and "expansion" not in dict(**ridge)
    assert own["valley"].weight == pytest.approx(83e3 * 244e-6)  # EN 1993-1-11, 2.3.1

    # a spreadsheet with decimal commas, another unit of stiffness, and a column of its own
    text = (
        "name;area_mm2;modulus_GPa;breaking_force_kN;diameter_mm;price\nedge;54,8;160,5;91,2;10;7\n"
    )
    (tmp_path / "b.csv").write_text(text)
    with pytest.warns(jc.InputWarning, match="price"):
        edge = jc.catalogue.load(tmp_path / "b.csv")["edge"]
    assert edge.axial_stiffness == pytest.approx(160.5e9 * 54.8e-6)
    assert edge.diameter == pytest.approx(0.010)

    row = {"name": "ridge", "area_mm2": 548, "axial_stiffness_MN": 88.9, "mass_kg_per_m": 4.53}
    row |= {"breaking_force_kN": 912, "expansion_1e-6_per_K": None, "source": "certificate 17"}
    (tmp_path / "c.json").write_text(json.dumps({"cables": [row]}))
    again = jc.catalogue.load(tmp_path / "c.json")["ridge"]
    assert dict(**again) == dict(**ridge) and again.source == "certificate 17"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("name,area_mm2\na,1\n", "column 'breaking_force_kn' is missing"),
        (f"{COLUMNS}\na,548,88.9,4.53\n", "line 2: 4 fields"),
        (f"{COLUMNS}\na,548,,4.53,912\n", "give one of axial_stiffness_MN and modulus_GPa"),
        (f"{COLUMNS}\na,-548,88.9,4.53,912\n", "line 2: area_mm2 = -548: must be positive"),
        (f"{COLUMNS}\na,x,88.9,4.53,912\n", "line 2: area_mm2: 'x' is not a number"),
        (f"{COLUMNS}\na,,88.9,4.53,912\n", "line 2: area_mm2: is empty"),
        (f"{COLUMNS}\n,5,88.9,4.53,912\n", "line 2: name: is empty"),
        (f"{COLUMNS}\na,5,8,4,9\na,5,8,4,9\n", "line 3: name 'a' occurs twice"),
        ('{"cables": {"a": 1}}', "cables: expected a list of objects"),
        ('{"cables": [{"name": "a"}]}', r"cables\[0\]: area_mm2: is missing"),
    ],
)
def test_wrong_tables_are_refused(tmp_path, text, message):
    path = tmp_path / ("own.json" if text.startswith("{") else "own.csv")
    path.write_text(text)
    with pytest.raises(FileError, match=message):
        jc.catalogue.load(path)


def test_names_and_sources():
    rows = tables.package_rows("cables.csv", tables.CABLE_COLUMNS)
    assert len(NAMES) == len(set(NAMES)) == len(rows) == 169
    for name, other in {
        "242-AL1/39-ST1A": "hawk",
        "485-AL1/63-ST1A": "LA 545",
        "490-AL1/64-ST1A": "al/st 490/65",
        "Galfan spiral strand 20": "galfan spiral-strand 20",
    }.items():
        assert jc.catalogue.cable(other).name == name
    for row in rows:
        assert jc.catalogue.cable(row.text("name")).source == tables.source_text(row.text("source"))
        assert len(tables.source_text(row.text("source"))) > 40  # no short name without a source
    assert isinstance(jnp.asarray(ALL[0].axial_stiffness), jax.Array)
