"""Profiles by name: against their tables, against finite elements, in scenes."""

import csv
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import jaxcable as jc
from jaxcable.catalogue import tables

STEEL = jc.Elastic(210e9)
ROLLED = [row.text("name") for row in tables.package_rows("profiles.csv", tables.PROFILE_COLUMNS)]
REFERENCE = Path(__file__).parents[1] / "reference" / "hollow_sections.csv"
PRINTED = 0.0061
"""Relative error of a printed number: three digits, the last one rounded, of a small first one."""


def numbers(section):
    """Area, Iy, Iz, Iyz and torsion constant of a section, [5]."""
    return np.array([section.total_area, *section.inertia(), section.torsion[0]])


# --- against tables


@pytest.mark.slow_cases("HEAA", "IPE", "L")
@pytest.mark.parametrize(
    "family", ["IPE", "IPE A", "IPE O", "HEAA", "HEA", "HEB", "HEM", "UPE", "UPN", "L"]
)
def test_rolled_profiles_have_the_properties_of_their_tables(family):
    """Computed from dimensions; the table of the manufacturer has three digits.

    Of tapered channels, UPN, radii of toes are rounded, and the torsion constant is for parallel
    flanges: wide bounds.
    """
    tapered, names = family == "UPN", jc.catalogue.profile_names(family)
    assert len(names) >= 13 and (len(names) == 18 or not tapered)
    near = [PRINTED, PRINTED, *([0.009, 0.007] if tapered else [PRINTED] * 2)]
    for name in names:
        data = jc.catalogue.profile_data(name)
        area, Iy, Iz, Iyz, It = numbers(jc.catalogue.profile(name, STEEL))
        printed = np.array([data.A, data.Iy, data.Iz, data.mass])
        found = np.array([area, Iy, Iz, 7850 * area])
        assert (abs(found / printed - 1) < near).all(), name
        assert abs(It / data.It - 1) < (0.021 if tapered else 0.009), name  # of IPE A 80: 2 digits
        assert (Iyz < -0.2 * Iy) if family == "L" else abs(Iyz) < 1e-9 * Iz, name


@pytest.mark.slow
def test_hollow_sections_have_the_properties_of_their_tables():
    """Of EN 10210-2 and EN 10219-2, as the Blue Book prints them: all standard sizes."""
    with REFERENCE.open(encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == 726
    for row in rows:
        made = {"manufacture": row["manufacture"]}
        data = jc.catalogue.profile_data(row["name"], **made)
        printed = {key: float(value) for key, value in row.items() if value and key[0] in "AIW"}
        mass = float(row["mass_kg_per_m"])
        units = {"cm2": 1e4, "cm4": 1e8, "cm3": 1e6}
        for key, value in printed.items():
            field, _, unit = key.rpartition("_")
            assert abs(getattr(data, field) * units[unit] / value - 1) < PRINTED, (row, key)
        assert abs(data.mass / mass - 1) < PRINTED, row
    for name in ("RHS 200x100x8", "SHS 100x6.3", "CHS 168.3x8"):
        data = jc.catalogue.profile_data(name)
        area, Iy, Iz, Iyz, It = numbers(jc.catalogue.profile(name, STEEL))
        stated = [data.A, data.Iy, data.Iz, data.It]
        np.testing.assert_allclose([area, Iy, Iz, It], stated, rtol=1e-12)
        assert abs(Iyz) < 1e-12 * Iy


def test_plastic_moduli_of_the_tables_are_those_of_the_fibres():
    """``sum A |z|`` of fine fibres: half the area on each side, of doubly symmetric shapes."""
    for name in ("IPE 300", "HEA 200", "HEM 300", "IPE O 600", "RHS 200x100x8", "CHS 168.3x8"):
        data = jc.catalogue.profile_data(name)
        section = data.section(STEEL, size=max(data.h, data.b) / 160)
        about_y = np.sum(section.area * abs(section.z))
        about_z = np.sum(section.area * abs(section.y))
        # the cell of a fillet is one fibre, and so is one through a thin wall
        assert abs(about_y / data.Wpl_y - 1) < 0.008, name
        assert abs(about_z / data.Wpl_z - 1) < 0.008, name


# --- against finite elements

ELEMENTS = {
    # sectionproperties 3.10.2, quadratic triangles of a sixth (rolled I, UPE) or a quarter of the
    # wall: area mm2, Iy, Iz, |Iyz| mm4, torsion constant mm4
    "IPE 80": (764.401, 801443, 84891.3, 0, 6729.91),
    "IPE 300": (5381.75, 8.35709e07, 6.03784e06, 0, 197648),
    "IPE 600": (15599.8, 9.20939e08, 3.38738e07, 0, 1.64664e06),
    "HEA 200": (5383.92, 3.69264e07, 1.33552e07, 0, 204461),
    "HEB 300": (14909.6, 2.51683e08, 8.56288e07, 0, 1.87503e06),
    "HEM 300": (30309.6, 5.92036e08, 1.94032e08, 0, 1.41505e07),
    "HEB 1000": (40006.8, 6.44793e09, 1.62759e08, 0, 1.27214e07),
    "UPE 80": (1007.04, 1.07215e06, 254148, 0, 14628.9),
    "UPE 200": (2900.74, 1.90944e07, 1.87302e06, 0, 88873.2),
    "UPE 400": (9193.46, 2.09819e08, 1.04472e07, 0, 791845),
    "L 50x5": (480.273, 109634, 109634, 64166.9, 4394.12),
    "L 100x10": (1915.5, 1.76667e06, 1.76667e06, 1.03663e06, 68223.8),
    "L 200x16": (6178.86, 2.34127e07, 2.34127e07, 1.38125e07, 551812),
    "RHS 200x100x8 | hot-finished": (4475.23, 2.2335e07, 7.38984e06, 0, 1.83619e07),
    "RHS 200x100x8 | cold-formed": (4323.92, 2.09054e07, 7.05289e06, 0, 1.81353e07),
    "RHS 200x100x12.5 | cold-formed": (6203.38, 2.65804e07, 8.91962e06, 0, 2.47239e07),
    "SHS 100x6.3 | hot-finished": (2318.59, 3.35556e06, 3.35556e06, 0, 5.4544e06),
    "SHS 40x5 | hot-finished": (673.135, 133663, 133663, 0, 234265),
    "SHS 60x5 | cold-formed": (1035.52, 504872, 504872, 0, 866773),
    "CHS 168.3x8 | hot-finished": (4027.16, 1.29623e07, 1.29623e07, 0, 2.59243e07),
    "UPN 80": (1102.39, 1.05933e06, 193570, 0, 21562.7),
    "UPN 200": (3218.58, 1.91096e07, 1.47747e06, 0, 120179),
    "UPN 380": (8035.47, 1.57559e08, 6.15164e06, 0, 616894),
    "UPN 400": (9148.99, 2.03538e08, 8.51053e06, 0, 829973),
}


def test_against_finite_elements():
    """Their arcs are 24 to 128 chords: 4e-4 of the area of a circle of 128, 8e-4 of its inertia.

    The formulas of torsion are approximate: up to 3 % for I, U and L, 4 % for a tube whose wall is
    an eighth of its width.
    """
    for name, (area, Iy, Iz, Iyz, J) in ELEMENTS.items():
        name, _, made = name.partition(" | ")
        made = {"manufacture": made} if made else {}
        found = numbers(jc.catalogue.profile(name, STEEL, **made))
        np.testing.assert_allclose(1e6 * found[0], area, rtol=4.1e-4, err_msg=name)
        np.testing.assert_allclose(1e12 * found[1:3], [Iy, Iz], rtol=8.1e-4, err_msg=name)
        np.testing.assert_allclose(1e12 * abs(found[3]), Iyz, rtol=2e-4, atol=1e-9 * Iz)
        assert abs(1e12 * found[4] / J - 1) < (0.04 if name == "SHS 40x5" else 0.03), name


# --- meshes, names, scenes


def test_moments_do_not_depend_on_the_mesh():
    for name in ("IPE 300", "UPE 200", "UPN 220", "L 100x10", "RHS 200x100x8", "CHS 168.3x8"):
        coarse = jc.catalogue.profile(name, STEEL)
        fine = jc.catalogue.profile(name, STEEL, size=0.005)
        assert fine.n_fibre >= 3 * coarse.n_fibre and coarse.n_fibre <= 42
        np.testing.assert_allclose(numbers(fine)[:3], numbers(coarse)[:3], rtol=1e-12)
        for section in (coarse, fine):
            y, z = section.centroid()
            assert abs(y) < 1e-15 and abs(z) < 1e-15 and section.placed
            # the own moments are no remainder: fibres as points converge from below
            points = np.sum(section.area * section.z**2)
            assert 0 < section.inertia()[0] - points < 0.15 * section.inertia()[0]
        assert fine.own[:, 0].sum() < 0.4 * coarse.own[:, 0].sum()


def test_names_are_tolerant():
    same = {
        "HEA 200": ["hea200", "HE 200 A", "he-200-a", "HE200A", "HEA  200"],
        "IPE A 240": ["IPE 240 A", "ipea240"],
        "L 100x10": ["L 100x100x10", "L100\u00d710", "L 100X10.0"],
        "CHS 168.3x8": ["chs168,3\u00d78", "CHS 168.30 x 8.0"],
        "SHS 100x5": ["SHS 100x100x5", "RHS 100x100x5"],
    }
    for name, others in same.items():
        for other in others:
            assert jc.catalogue.profile_data(other).name == name, other
    assert jc.catalogue.profile_data("RHS 217x83x3.7").h == pytest.approx(0.217)  # of any size
    names = jc.catalogue.profile_names()
    assert len(names) == len(set(names)) and set(ROLLED) <= set(names)
    for name in names:
        assert jc.catalogue.profile_data(name).name == name
        assert jc.catalogue.profile_data(name).source


def test_corners_of_cold_formed_sections():
    hot, cold = (
        jc.catalogue.profile_data("SHS 100x6.3", manufacture=made)
        for made in ("hot-finished", "cold-formed")
    )
    assert hot.r == pytest.approx(1.5 * 0.0063) and hot.r2 == pytest.approx(0.0063)
    assert cold.r == pytest.approx(2.5 * 0.0063) and cold.r2 == pytest.approx(1.5 * 0.0063)
    assert cold.A < hot.A


def test_scenes_with_profiles_and_cables_make_a_round_trip(tmp_path):
    nodes = [[0.0, 0, 0], [0.0, 0, 5.0], [4.0, 0, 0]]
    mast = jc.catalogue.profile_data("CHS 168.3x8")
    elements = {
        "mast": jc.Beams([[0, 1]], mast.section(STEEL), weight=mast.weight),
        "stay": jc.Catenaries([[2, 1]], **jc.catalogue.cable("Galfan spiral strand 20")),
        "tie": jc.Cables([[0, 2]], **jc.catalogue.cable("Macalloy 460 M20")),
    }
    structure = jc.Structure(nodes, elements, jc.clamped([0]) + jc.pinned([2]))
    jc.save_scene(tmp_path / "scene.json", (structure, [jc.Phase(loads=jc.SelfWeight())]))
    again, _ = jc.load_scene(tmp_path / "scene.json")
    for name in ("y", "z", "area", "torsion", "own", "points"):
        before, after = (getattr(s.elements["mast"].section, name) for s in (structure, again))
        np.testing.assert_array_equal(before, after)
    for group in ("stay", "tie"):
        for name in ("axial_stiffness", "weight", "strength", "expansion"):
            before, after = (getattr(s.elements[group], name) for s in (structure, again))
            np.testing.assert_array_equal(before, after)


@pytest.mark.slow
def test_importing_reads_no_table():
    text = """
import sys
opened = []
sys.addaudithook(lambda event, what: opened.append(str(what[0])) if event == "open" else None)
import jaxcable
files = [name for name in opened if "catalogue" in name and name.endswith((".csv", ".json"))]
jaxcable.catalogue.profile_data("IPE 300")
later = [name for name in opened if "catalogue" in name and name.endswith((".csv", ".json"))]
print(len(files), sorted({name.rpartition("/")[2] for name in later}))
"""
    run = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=True)
    assert run.stdout.split("\n")[0] == "0 ['profiles.csv', 'sources.json']"
