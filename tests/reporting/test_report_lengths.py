"""Summaries in reports: groups, cables that run through several elements, where clamps are."""

import csv
import io

import numpy as np

import jaxcable as jc
from jaxcable.reporting.lengths import chains


def column(table, name):
    return [row[table.columns.index(name)] for row in table.rows]


def net(n=4):
    """A net of n x n cables with spacing 1 m, elements in no order; nodes and links."""
    places = [(i, j) for i in range(n + 2) for j in range(n + 2)]
    number = {place: k for k, place in enumerate(places)}
    links = [(number[i, j], number[i + 1, j]) for j in range(1, n + 1) for i in range(n + 1)]
    links += [(number[i, j], number[i, j + 1]) for i in range(1, n + 1) for j in range(n + 1)]
    random = np.random.default_rng(3)
    links = np.array(links)[random.permutation(len(links))]
    turned = random.random(len(links)) < 0.5
    links[turned] = links[turned][:, ::-1]
    used, flat = np.unique(links, return_inverse=True)
    nodes = np.array([(i, j, 0.02 * (i * i - j * j)) for i, j in places], float)[used]
    return nodes, flat.reshape(-1, 2)


def test_cables_of_a_net_run_through_all_crossings():
    nodes, links = net()
    found = chains(links, nodes)
    assert sorted(len(elements) for elements, _ in found) == [5] * 8
    assert sorted(np.concatenate([elements for elements, _ in found])) == list(range(40))
    for elements, turned in found:
        path = np.where(turned[:, None], links[elements][:, ::-1], links[elements])
        assert (path[1:, 0] == path[:-1, 1]).all()
        along = nodes[path[-1, 1]] - nodes[path[0, 0]]
        assert np.isclose(np.abs(along[:2]).max(), 5.0, rtol=1e-15)  # straight in plan
        assert np.abs(along[:2]).min() == 0.0


def test_a_ring_is_one_cable_and_a_corner_ends_two():
    angle = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    ring = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    links = np.column_stack([np.arange(12), np.roll(np.arange(12), -1)])
    ((elements, turned),) = chains(links, ring)
    assert sorted(elements) == list(range(12)) and not turned.any()
    corner = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0]])  # a right angle: no cable goes on
    assert len(chains(np.array([[0, 1], [1, 2]]), corner)) == 2
    flat = np.array([[0.0, 0, 0], [1, 0, 0], [1.6, 0.8, 0]])  # 53 degrees: it does
    assert len(chains(np.array([[0, 1], [2, 1]]), flat)) == 1


def test_marks_are_sums_of_unstressed_lengths():
    nodes, links = net()
    edge = np.flatnonzero(np.bincount(links.ravel(), minlength=len(nodes)) == 1)
    cables = {"net": jc.Cables(links, axial_stiffness=1e6), "idle": jc.Bars([[0, 1]], 1e3)}
    structure = jc.Structure(nodes, cables, supports=jc.pinned(edge))
    solution = jc.solve(structure, jc.Phase(pretension={"net": 5e3}))
    assert solution.status == 0
    report = jc.report(structure, solution)
    length = np.asarray(solution.rest_length["net"])
    pieces, whole = report.tables["cutting_list"], report.tables["cables"]
    assert column(whole, "group") == ["net"] * 8
    for number, total in zip(
        column(whole, "cable"), column(whole, "unstressed length"), strict=True
    ):
        own = [row for row in pieces.rows if row[0] == "net" and row[5] == number]
        assert len(own) == 5
        assert np.isclose(total, sum(length[row[1]] for row in own), rtol=1e-14)
        # every node of the cable has one mark, from whichever of its two elements it is read
        marks = {}
        for row in own:
            assert np.isclose(abs(row[7] - row[6]), length[row[1]], rtol=1e-12)
            for node, mark in ((row[2], row[6]), (row[3], row[7])):
                assert np.isclose(marks.setdefault(node, mark), mark, atol=1e-12)
        assert len(marks) == 6 and min(marks.values()) == 0.0
        assert np.isclose(max(marks.values()), total, rtol=1e-14)
    idle = [row for row in pieces.rows if row[0] == "idle"]
    assert idle[0][5:] == [None] * 3
    read = list(csv.DictReader(io.StringIO(report.csv()["cables"])))
    assert [float(row["unstressed length (m)"]) for row in read] == column(
        whole, "unstressed length"
    )


def test_single_elements_are_no_cables():
    structure, phases = jc.scenes.von_mises_truss()
    solution = jc.solve(structure, phases)
    assert solution.status == 0
    report = jc.report(structure, solution)
    assert "cables" not in report.tables
    assert report.tables["cutting_list"].columns[-1] == "unstressed length"


def test_phases_have_names_of_their_own():
    structure, phases = jc.scenes.flat_net(load=15.0)
    solution = jc.solve(structure, phases)
    assert solution.status == 0
    report = jc.report(structure, solution, names=["prestress", "people"])
    members = report.tables["members"]
    assert set(column(members, "in")) | set(column(members, "in ")) == {"prestress", "people"}
    for names in (["one"], ["a", "a"], ["end", "b"]):
        try:
            jc.report(structure, solution, names=names)
        except ValueError as error:
            assert str(error).startswith("names: ")
        else:
            raise AssertionError(names)


def test_names_of_columns_are_apart_in_csv():
    for scene in (jc.scenes.guyed_mast, jc.scenes.flat_net):
        structure, phases = scene()
        solution = jc.solve(structure, phases)
        assert solution.status == 0
        for name, text in jc.report(structure, solution).csv().items():
            head = next(csv.reader(io.StringIO(text)))
            assert len({*head}) == len(head), name


def test_groups_have_their_extremes_and_what_governs():
    """Against the forces of the phases themselves, by NumPy."""
    structure, phases = jc.scenes.guyed_mast()
    solution = jc.solve(structure, phases)
    assert solution.status == 0
    table = jc.report(structure, solution, names=["prestress", "wind"]).tables["groups"]
    names = list(structure.elements)
    assert sorted(column(table, "group")) == sorted(names)
    for row in table.rows:
        group, count, low, of, when, high, of_high, when_high = row[:8]
        force = np.array([np.asarray(p.peak_tension[group]) for p in solution.phases])
        assert count == force.shape[1]
        assert (low, high) == (force.min(), force.max())
        assert force[["prestress", "wind"].index(when), of] == low
        assert force[["prestress", "wind"].index(when_high), of_high] == high
    assert len({tuple(row[2:8]) for row in table.rows}) == len(names) > 1


def test_groups_say_which_element_is_most_used():
    nodes = [[0.0, 0, 0], [0, 0, -1], [0, 0, -2], [1, 0, 0], [1, 0, -1]]
    parts = {
        "rope": jc.Cables([[0, 1], [1, 2]], axial_stiffness=1e6, strength=[1e3, 5e2]),
        "wire": jc.Cables([[3, 4]], axial_stiffness=1e5),
    }
    structure = jc.Structure(nodes, parts, supports=jc.pinned([0, 3]))
    load = jc.NodalLoads([1, 2, 4], [[0, 0, -100.0], [0, 0, -300.0], [0, 0, -50.0]])
    solution = jc.solve(structure, jc.Phase(loads=load))
    assert solution.status == 0
    rope, wire = jc.report(structure, solution).tables["groups"].rows
    # 400 N of 1 kN above, 300 N of 500 N below: the lower one is used more
    np.testing.assert_allclose([rope[2], rope[5], rope[8]], [300.0, 400.0, 0.6], rtol=1e-9)
    assert (rope[3], rope[6], rope[9]) == (1, 0, 1)
    assert wire[8:] == [None, None]
    alone = jc.report(*jc.scenes.flat_net()[:1], jc.solve(*jc.scenes.flat_net()))
    assert "groups" not in alone.tables
