"""Combinations of actions: published examples, brute force, and their analyses one by one."""

import itertools
import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from banks.shapes import spokes
from oracles.convergence import converged

import jaxcable as jc
from jaxcable.design import Action, combination_rules, combinations

DOWN = jc.NodalLoads([4, 5, 8, 9], (0.0, 0.0, -10.0))


def action(name, kind, **options):
    """An action whose loads do not matter."""
    return Action(name, kind, DOWN, **options)


def factors(found, name):
    """The combinations of one rule as a set of factors, in the order of the actions."""
    rows = zip(found.names, found.factors, strict=True)
    return {tuple(row.round(9)) for own, row in rows if own.rpartition("-")[0] == name}


G, S, W = (
    action(name, kind) for name, kind in zip("GSW", ("permanent", "snow", "wind"), strict=True)
)
Q = action("Q", "imposed B")


@pytest.mark.parametrize(
    ("actions", "rule", "published"),
    [
        # Steel Buildings in Europe, single-storey buildings, part 3, 3.2.3: 1.35 G + 1.5 S + 0.9 W,
        # 1.35 G + 1.5 W + 0.75 S; 3.3.2: G + S + 0.6 W, G + W + 0.5 S; 3.3.3: G + 0.2 S, G + 0.2 W
        ([G, S, W], "ULS 6.10", {(1.35, 1.5, 0.9), (1.35, 0.75, 1.5)}),
        ([G, S, W], "SLS characteristic", {(1, 1, 0.6), (1, 0.5, 1)}),
        ([G, S, W], "SLS frequent", {(1, 0.2, 0), (1, 0, 0.2)}),
        # the same, multi-storey buildings: G + S + 0.7 Q; G + 0.2 S + 0.3 Q
        ([G, S, Q], "SLS characteristic", {(1, 1, 0.7)}),
        ([G, S, Q], "SLS frequent", {(1, 0.2, 0.3)}),
    ],
)
def test_published_combinations(actions, rule, published):
    """All that a guide of the standard lists are there, and nothing larger."""
    found = factors(combinations(actions), rule)
    assert published <= found
    least, most = (f(np.array(sorted(published)), axis=0) for f in (np.min, np.max))
    every = np.array(sorted(found))
    assert (every.max(axis=0)[:1] == most[:1]).all() and (every.min(axis=0) <= least).all()


def brute_force(actions, gamma, psi, permanent):
    """Every row of (6.10): all subsets, each of them leading, each source with both factors."""
    variable = [k for k, one in enumerate(actions) if one.kind != "permanent"]
    steady = [k for k, one in enumerate(actions) if one.kind == "permanent"]
    sources = sorted({actions[k].source or str(k) for k in steady})
    rows = set()
    for bits in itertools.product([False, True], repeat=len(variable)):
        acting = [k for k, bit in zip(variable, bits, strict=True) if bit]
        for leading in acting or [None]:
            for choice in itertools.product(permanent, repeat=len(sources)):
                row = np.zeros(len(actions))
                for k in steady:
                    row[k] = choice[sources.index(actions[k].source or str(k))]
                for k in acting:
                    row[k] = gamma * (1.0 if k == leading else psi[actions[k].kind])
                rows.add(tuple(row.round(9)))
    return rows


def test_all_sets_of_actions_against_brute_force():
    """Their number is 2^s (1 + n 2^(n-1)) with s sources and n variable actions, none of psi0 = 0.

    Roofs of category H have psi0 = 0: with one of them there are fewer.
    """
    actions = [
        *(action("self-weight", "permanent", source="steel"), action("cladding", "permanent")),
        *(action("rails", "permanent", source="steel"), S, W, Q, action("T", "temperature")),
    ]
    psi = {"snow": 0.5, "wind": 0.6, "imposed B": 0.7, "temperature": 0.6}
    found = combinations(actions, which=["ULS 6.10"])
    assert factors(found, "ULS 6.10") == brute_force(actions, 1.5, psi, (1.35, 1.0))
    assert len(found) == 2**2 * (1 + 4 * 2**3) == 132
    roof = [*actions, action("H", "imposed H")]
    fewer = combinations(roof, which=["ULS 6.10"])
    assert factors(fewer, "ULS 6.10") == brute_force(roof, 1.5, psi | {"imposed H": 0.0}, (1.35, 1))
    assert len(fewer) == 4 * (33 + 1 + 15)  # H leads alone, or with any of the 15 sets


def test_eight_winds_with_and_without_ice():
    """One wind at a time; iced members under the winds on ice only: counted by hand.

    Without ice: no wind, or 8, with snow or not; with ice: no wind, or 8 on ice. Sets of n actions
    have n leading ones.
    """
    winds = [action(f"wind {k}", "wind", exclusive="wind", excludes="ice") for k in range(8)]
    iced = [action(f"iced wind {k}", "wind", exclusive="wind", needs="ice") for k in range(8)]
    actions = [action("G", "permanent"), action("ice", "ice"), S, *winds, *iced]
    found = combinations(actions, which=["ULS 6.10"])
    n_without = 1 + 1 + 8 + 8 * 2  # none; snow; wind; wind and snow
    n_with = 1 + 2 + 8 * 2 + 8 * 3  # ice; and snow; and wind; and both
    assert len(found) == 2 * (n_without + n_with) == 138
    some = found.factors > 0
    assert (some[:, 3:].sum(axis=1) <= 1).all() and some[:, 3:].any(axis=0).all()
    assert not (some[:, 3:11].any(axis=1) & some[:, 1]).any()  # ice excludes the winds without
    assert (some[:, 1] | ~some[:, 11:].any(axis=1)).all()
    # psi2 of wind and ice is 0: quasi-permanent is G alone
    assert factors(combinations(actions), "SLS quasi-permanent") == {(1.0, *[0.0] * 18)}


ASCE = [  # kinds, and of each combination all rows that no other one exceeds
    (  # 2.3.1, written out
        ("permanent", "live", "roof live", "snow", "wind"),
        {
            "LRFD 1": {(1.4, 0, 0, 0, 0)},
            "LRFD 2": {(1.2, 1.6, 0.5, 0, 0), (1.2, 1.6, 0, 0.5, 0)},
            "LRFD 3": {
                *((1.2, 1.0, 1.6, 0, 0), (1.2, 0, 1.6, 0, 0.5)),
                *((1.2, 1.0, 0, 1.6, 0), (1.2, 0, 0, 1.6, 0.5)),
            },
            "LRFD 4": {(1.2, 1.0, 0.5, 0, 1.0), (1.2, 1.0, 0, 0.5, 1.0)},
            "LRFD 5": {(0.9, 0, 0, 0, 1.0)},
            "ASD 6": {(1, 0.75, 0.75, 0, 0.45), (1, 0.75, 0, 0.75, 0.45)},
            "ASD 7": {(0.6, 0, 0, 0, 0.6)},
        },
    ),
    (  # 2.4.5 (8 to 10), and 2.3.1, exception 1, with 2.3.6
        ("permanent", "live", "live up to 100 psf", "snow", "wind", "seismic"),
        {
            "ASD 8": {(1, 0, 0, 0, 0, 0.7)},
            "ASD 9": {(1, 0.75, 0.75, 0.75, 0, 0.525)},
            "ASD 10": {(0.6, 0, 0, 0, 0, 0.7)},
            "LRFD 2": {(1.2, 1.6, 1.6, 0.5, 0, 0)},
            "LRFD 3": {(1.2, 1.0, 0.5, 1.6, 0, 0), (1.2, 0, 0, 1.6, 0.5, 0)},
            "LRFD 4": {(1.2, 1.0, 0.5, 0.5, 1.0, 0)},
            "LRFD 6": {(1.2, 1.0, 0.5, 0.2, 0, 1.0)},
            "ASD 4": {(1, 0.75, 0.75, 0.75, 0, 0)},
        },
    ),
]


@pytest.mark.parametrize(("kinds", "largest"), ASCE, ids=["usual", "seismic"])
def test_asce(kinds, largest):
    """ASCE 7-16: every row of the standard, and nothing larger."""
    found = combinations([action(kind, kind) for kind in kinds], "ASCE 7-16")
    for name, rows in largest.items():
        every, most = factors(found, name), np.array(sorted(rows))
        assert rows <= every, name
        assert all((np.array(row) <= most + 1e-12).all(axis=1).any() for row in every), name
    states = dict(zip(found.rules, found.limit_states, strict=True))
    assert states["ASD 7"] == "allowable stress"
    assert states.get("LRFD 6", "seismic") == "seismic"


def test_the_lists_of_another_program():
    """All combinations that Dlubal prints for two examples of EN 1990: eight, and three with three.

    FAQ 002341: permanent, an imposed load of factor 1.35, and two imposed loads that act without
    psi0 beside each other; manual of RF-CONCRETE Members, 004675: permanent and two imposed loads
    with psi2 = 0.6, which leaves out the permanent load alone.
    """
    rules = combination_rules("EN 1990")
    rules["kinds"] = {
        "imposed": {"psi": [1.0, 0.7, 0.6]},
        "screed": {"psi": [1.0, 1.0, 1.0], "gamma": 1.35},
    }
    rules["combinations"]["ULS 6.10"]["permanent"] = [1.35]
    lasting = [G, action("LF2", "screed"), action("LF3", "imposed"), action("LF4", "imposed")]
    printed = {
        *((1.35, 0, 0, 0), (1.35, 1.35, 0, 0), (1.35, 0, 1.5, 0), (1.35, 0, 1.5, 1.5)),
        *((1.35, 0, 0, 1.5), (1.35, 1.35, 1.5, 0), (1.35, 1.35, 1.5, 1.5), (1.35, 1.35, 0, 1.5)),
    }
    found = combinations(lasting, rules, which="ULS 6.10")
    assert len(found) == len(printed) == 8 and factors(found, "ULS 6.10") == printed
    found = combinations([lasting[0], *lasting[2:]], rules)
    ultimate = {(1.35, 1.5, 1.5), (1.35, 1.5, 0), (1.35, 0, 1.5)}
    assert factors(found, "ULS 6.10") == ultimate | {(1.35, 0, 0)}
    lasting_part = {(1, 0.6, 0.6), (1, 0.6, 0), (1, 0, 0.6)}
    assert factors(found, "SLS quasi-permanent") == lasting_part | {(1, 0, 0)}


def test_accidental_and_rules_of_a_user(tmp_path):
    """One accidental action each; (6.10a), (6.10b) on request; an annex as a dict and a file."""
    actions = [G, S, W, *(Action(n, "accidental", DOWN) for n in ("stay 1", "stay 2"))]
    found = combinations(actions)
    lost = {(1, 0.2, 0, 1, 0), (1, 0, 0.2, 1, 0), (1, 0, 0, 1, 0)}
    lost |= {(g, s, w, b, a) for g, s, w, a, b in lost}
    assert factors(found, "ACC 6.11") == lost
    assert set(found.limit_states) == {"ultimate", "accidental", "serviceability"}
    assert found.select_limit_states("accidental").names[0] == "ACC 6.11-1"
    assert found.formula(found.names.index("ACC 6.11-1")) == "1 G + 1 stay 1"
    two = combinations([G, S, W], which=["ULS 6.10a", "ULS 6.10b"])
    assert (1.35, 0.75, 0.9) in factors(two, "ULS 6.10a")
    assert (1.1475, 1.5, 0.9) in factors(two, "ULS 6.10b")
    rules = combination_rules("EN 1990")
    rules["kinds"]["snow"]["psi"] = [0.7, 0.5, 0.2]
    assert (1.35, 1.05, 1.5) in factors(combinations([G, S, W], rules), "ULS 6.10")
    path = tmp_path / "annex.json"
    path.write_text(json.dumps(rules))
    assert np.array_equal(
        combinations([G, S, W], path).factors, combinations([G, S, W], rules).factors
    )
    assert combination_rules("EN 1990")["kinds"]["snow"]["psi"] == [0.5, 0.2, 0.0]


def test_changed_factors_are_said():
    """The clause of the standard stands beside its own factors only."""
    rules, other = combination_rules("EN 1990"), combination_rules("EN 1990")
    same = combinations([G, S], rules)
    assert set(same.clauses) == set(combinations([G, S]).clauses)
    rules["gamma"], rules["source"] = 1.6, "NA"
    said = "CHANGED factors, source: NA"
    assert all(clause.endswith(said) for clause in combinations([G, S], rules).clauses)
    other["combinations"]["ULS 6.10"]["permanent"] = [1.2, 0.95]
    found = combinations([G, S], other)
    changed = {rule for rule, c in zip(found.rules, found.clauses, strict=True) if "CHANGED" in c}
    assert changed == {"ULS 6.10"}


# --- analyses

LINKS = [[0, 1], [1, 2], [2, 3], [4, 1], [1, 5], [6, 2], [2, 7]]
NODES = [
    *([0, 0, 0], [2, 0, -0.4], [4, 0, -0.4], [6, 0, 0]),
    *([2, -3, -2], [2, 3, -2], [4, -3, -2], [4, 3, -2]),
]


def hall():
    """A hanging rope with two nodes, each held down by two ropes."""
    own = {"weight": 20.0, "expansion": 1.2e-5}
    ropes = {
        "ridge": jc.Cables(LINKS[:3], axial_stiffness=2e6, **own),
        "down": jc.Cables(LINKS[3:], axial_stiffness=1e6, **own | {"weight": 10.0}),
    }
    return jc.Structure(np.array(NODES, float), ropes, jc.pinned([0, 3, 4, 5, 6, 7]))


PRESTRESS = jc.Phase(pretension={"ridge": 40e3, "down": 8.3e3}, loads=jc.SelfWeight())


def hall_actions(snow=-4e3):
    warm = {"ridge": jnp.full(3, 30.0), "down": jnp.full(4, 30.0)}
    lost = {"ridge": np.zeros(3, bool), "down": np.arange(4) == 2}
    return [
        Action("self-weight", "permanent", jc.SelfWeight(), in_phases=True),
        Action("prestress", "prestress", in_phases=True),
        Action("snow", "snow", jc.NodalLoads([1, 2], jnp.array([0.0, 0.0, 1.0]) * snow)),
        Action("wind", "wind", [jc.NodalLoads([1], (0.0, 2e3, 1e3)), jc.LineLoads((0.0, 50, 0))]),
        Action("warm", "temperature", temperature=warm, exclusive="temperature"),
        Action(
            "cold", "temperature", exclusive="temperature",
            temperature=jax.tree.map(lambda t: -0.5 * t, warm),
        ),
        Action("turnbuckle", "accidental", shortening={"ridge": None, "down": jnp.full(4, 0.01)}),
        Action("rope lost", "accidental", removes=lost),
    ]  # fmt: skip


def alone(row):
    """The result of one combination, stated without `combinations`: all at once, by factors."""
    dead, _, snow, wind, warm, cold, jack, lost = (float(x) for x in row)
    loads = [
        jc.SelfWeight((0.0, 0.0, -dead)),
        jc.NodalLoads([1, 2], (0.0, 0.0, -4e3 * snow)),
        jc.NodalLoads([1], (0.0, 2e3 * wind, 1e3 * wind)),
        jc.LineLoads((0.0, 50.0 * wind, 0.0)),
    ]
    case = jc.Phase(
        loads=loads[1:],
        temperature=30.0 * warm - 15.0 * cold,
        shortening={"down": 0.01 * jack},
        removes={"down": np.arange(4) == 2} if lost else None,
    )
    first = jc.Phase(pretension=PRESTRESS.pretension, loads=loads[0])
    return jc.solve(hall(), [first, case])


@pytest.fixture(scope="module")
def analysed():
    found = combinations(hall_actions())
    return found, jc.design.solve_cases(hall(), PRESTRESS, found)


def test_a_batch_of_combinations_equals_each_alone(analysed):
    """Elastic ropes do not depend on the order of loads: all weight first, by its factor.

    One of each limit state and every lost or heated case: 1e-9, the tolerance of the iteration.
    """
    found, batch = analysed
    assert set(np.asarray(batch.status)) == {0}
    assert len(found.select_limit_states("ultimate")) == 2 * (1 + 4 + 2 * 5 + 3 * 2)  # by set sizes
    chosen = {}
    for k, row in enumerate(found.factors):
        chosen.setdefault((found.limit_states[k], tuple(row > 0)), k)
    assert len(chosen) > 30
    for k in list(chosen.values())[::4]:
        one, near = converged(alone(found.factors[k])), {"atol": 1e-6, "err_msg": found.names[k]}
        for name, tension in one.tension.items():
            np.testing.assert_allclose(batch.tension[name][k], tension, rtol=1e-9, **near)
        np.testing.assert_allclose(batch.displacement[k], one.displacement, atol=1e-10)


def test_a_report_names_the_combination_that_governs(analysed):
    """Forces, and reactions with all their components, by name: NumPy finds the same."""
    found, batch = analysed
    prestressed = converged(jc.solve(hall(), PRESTRESS))
    tables = jc.report(hall(), prestressed, cases=batch, combinations=found).tables
    force = np.asarray(batch.tension["ridge"])[:, 0]
    row = next(row for row in tables["members"].rows if list(row[:2]) == ["ridge", 0])
    assert found.names[int(force.argmax())] in row and found.names[int(force.argmin())] in row
    listed = tables["combinations"]
    assert [row[0] for row in listed.rows] == list(found.names)
    assert listed.rows[0][2] == found.formula(0)
    sums = np.array([row[5:8] for row in listed.rows])
    reactions = np.asarray(batch.reactions)
    noise = 1e-7 * np.abs(reactions).max()  # what is smaller is zero in a report
    np.testing.assert_allclose(sums, reactions.sum(axis=1), atol=noise)
    assert listed.columns == (
        *("combination", "limit state", "actions", "status", "named"),
        *("sum Rx", "sum Ry", "sum Rz", "clause"),
    )
    governing = {cell for row in tables["members"].rows for cell in row} & set(found.names)
    assert governing and all(row[4] > 0 for row in listed.rows if row[0] in governing)
    envelope, reactions = tables["reaction_envelope"], np.asarray(batch.reactions)
    assert envelope.columns == ("node", "extreme", "Rx", "Ry", "Rz", "in")
    assert len(envelope.rows) == 6 * 3 * 2
    for node, extreme, *parts, case in envelope.rows:
        word, component = extreme.split()
        values = reactions[:, node, "xyz".index(component[1])]
        assert parts["xyz".index(component[1])] == (values.min() if word == "min" else values.max())
        assert parts == reactions[found.names.index(case), node].tolist()


def test_a_post_without_two_of_its_guys_is_named():
    """It stands upright, but not for long: status OK, a warning, a word in the report.

    A weight that acts twice is warned of before.
    """
    top = 4
    nodes = [[3.0, 0, 0], [0, 3.0, 0], [-3.0, 0, 0], [0, -3.0, 0], [0, 0, 4.0], [0, 0, 0.0]]
    elements = {
        "guys": jc.Cables([[k, top] for k in range(4)], axial_stiffness=1e6, weight=1.0),
        "post": jc.Bars([[5, top]], axial_stiffness=1e8, weight=10.0),
    }
    structure = jc.Structure(nodes, elements, jc.pinned([0, 1, 2, 3, 5]))
    calm = jc.Phase(pretension={"guys": 500.0}, loads=jc.SelfWeight())
    lost = Action("two lost", "accidental", removes={"guys": np.arange(4) % 2 == 0, "post": None})
    weight = Action("weight", "permanent", jc.SelfWeight(), in_phases=True)
    found = combinations([weight, lost], which=["ACC 6.11"])
    with pytest.warns(jc.UnstableWarning, match=r"^ACC 6.11-1: end in an unstable equilibrium"):
        solutions = jc.design.solve_cases(structure, calm, found)
    assert np.asarray(solutions.status).tolist() == [0] and not solutions.stable.any()
    before = converged(jc.solve(structure, calm))
    report = jc.report(structure, before, cases=solutions, combinations=found)
    assert "UNSTABLE at their ends, but in the envelopes: ACC 6.11-1" in report.summary
    assert report.tables["combinations"].rows[0][3] == "UNSTABLE"
    twice = combinations([jc.replace(weight, in_phases=False), lost], which=["ACC 6.11"])
    said = pytest.warns(jc.InputWarning, match="'weight' is a SelfWeight.*acts twice")
    with pytest.warns(jc.UnstableWarning), said:
        jc.design.solve_cases(structure, calm, twice)


def test_chosen_rules_and_limit_states():
    """An accidental action may be left out, by the factor zero; a limit state stands for its rules.

    For those on request it does not stand; a rule is listed once.
    """
    load = jc.NodalLoads([1], (0.0, 0.0, -1.0))
    dead, snow = Action("dead", "permanent", load), Action("snow", "snow", load)
    found = combinations([dead, Action("impact", "accidental", load)], which=["ULS 6.10"])
    assert found.factors.tolist() == [[1.35, 0.0], [1.0, 0.0]]
    assert found.cases.loads[0].forces.shape[0] == 2
    every, chosen = (combinations([dead, snow], which=w) for w in (None, ["serviceability"]))
    assert chosen.names == every.select_limit_states("serviceability").names
    assert set(chosen.limit_states) == {"serviceability"}
    both = combinations([dead, snow], which=["SLS frequent", "serviceability"])
    assert sorted(both.names) == sorted(chosen.names)


def test_cases_that_add_nothing_to_the_phases_are_a_batch():
    weight = jc.NodalLoads([1], (0.0, 0.0, -1.0))
    actions = [Action("dead", "permanent", weight, in_phases=True)]
    found, structure = combinations(actions, which=["SLS quasi-permanent"]), spokes(3).structure
    phases = [jc.Phase(pretension=10.0, loads=jc.NodalLoads([0], (0.0, 0.0, -1.0)))]
    solutions = jc.design.solve_cases(structure, phases, found)
    alone = converged(jc.solve(structure, phases))
    assert solutions.status.tolist() == [0]
    np.testing.assert_allclose(solutions.tension[0], alone.tension, rtol=1e-9)  # tol of Newton


def test_residual_capacity_has_roof_live_loads():
    """ASCE 7-16, 2.5.2.2: (0.9 or 1.2) D + 0.5 L + 0.2 (Lr or S or R), and the loss."""
    kinds = "permanent", "live", "roof live", "snow", "rain"
    lost = Action("lost", "accidental", removes=np.array([True, False]))
    found = combinations([*(action(kind, kind) for kind in kinds), lost], "ASCE 7-16")
    rows = itertools.product((1.2, 0.9), (0, 0.5), range(4))
    wanted = {(d, live, *np.eye(4, 3)[k] * 0.2, 1.0) for d, live, k in rows}
    assert factors(found, "residual") == {tuple(np.round(row, 9)) for row in wanted}


def test_parts_of_one_imposed_action_are_there_or_absent():
    """Imposed loads on two spans, and wind: EN 1990 (6.10) with both parts leading together.

    Steel Buildings in Europe and textbooks on continuous beams list 1.35 G + 1.5 (Q1 + Q2),
    1.35 G + 1.5 Q1, 1.35 G + 1.5 Q2, each with 0.9 W, and 1.5 W with 1.05 Q.
    """
    spans = [action(name, "imposed B", source="floor") for name in ("Q1", "Q2")]
    found = combinations([G, *spans, W], which=["ULS 6.10"])
    loaded = list(itertools.product((0, 1), repeat=2))
    wanted = {(g, 1.5 * a, 1.5 * b, w) for g in (1.35, 1) for a, b in loaded for w in (0, 0.9)}
    wanted -= {(g, 0, 0, 0.9) for g in (1.35, 1)}  # wind alone leads
    wanted |= {(g, 1.05 * a, 1.05 * b, 1.5) for g in (1.35, 1) for a, b in loaded}
    assert factors(found, "ULS 6.10") == {tuple(np.round(row, 9)) for row in wanted}
    apart = combinations([G, *(jc.replace(one, source=None) for one in spans)], which="ULS 6.10")
    assert (1.35, 1.5, 1.05) in factors(apart, "ULS 6.10")  # two actions: one leads
    assert (1.35, 1.5, 1.5) not in factors(apart, "ULS 6.10")
