"""What makes another study, which a store refuses, and what does not."""

import os

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcable as jc

NODES = [[0.0, 0, 0], [4.0, 0, -1.0], [8.0, 0, 0]]
FORCES = np.array([100.0, 200.0, 300.0])


def make(
    *,
    axial=1e6,
    nodes=NODES,
    fixed=(0, 2),
    free_in_y=False,
    law=None,
    pretension=5e3,
    increments=1,
    direction=-1.0,
    tol=1e-10,
    factor=1.0,
    key=0,
    constant=0.0,
    name="sag",
    other=None,
    on_host=None,
):
    """A function of one case: the sag of a node on two cables, with a part of everything."""
    if law is None:
        cables = jc.Cables([[0, 1], [1, 2]], axial_stiffness=axial)
    else:
        cables = jc.Cables([[0, 1], [1, 2]], law=law, area=1e-4)
    held = jc.pinned(list(fixed))
    if free_in_y:
        held = jc.pinned([0]) + jc.restrained([2], "xz")
    structure = jc.Structure(nodes, cables, supports=held)
    noise = jax.random.normal(jax.random.key(key))

    def function(force):
        load = jc.NodalLoads([1], jnp.array([0.0, 0.0, direction]) * force * factor)
        phases = [jc.Phase(pretension=pretension), jc.Phase(loads=load, increments=increments)]
        solution = jc.solve(structure, phases, jc.Newton(tol=tol))
        sag = -solution.displacement[1, 2] + constant + 0.0 * noise
        if on_host is not None:
            shape = jax.ShapeDtypeStruct((), sag.dtype)
            sag = jax.pure_callback(on_host, shape, sag, vmap_method="sequential")
        found = {name: sag, "move": solution.displacement[1]}
        return found if other is None else found | {other: sag}

    return function


def law(stress):
    return jc.Polygonal([0.0, 0.01], [0.0, stress])


OTHER_MODELS = {
    "stiffness": {"axial": 1.0000001e6},
    "nodes": {"nodes": [*NODES[:2], [8.0, 0, 1e-9]]},
    "supports": {"free_in_y": True},
    "law": {"law": law(1e8)},
    "pretension": {"pretension": 5.001e3},
    "increments": {"increments": 2},
    "constant of the function": {"direction": -2.0},
    "method": {"tol": 1e-9},
    "captured number": {"factor": 1.5},
    "random key": {"key": 1},
    "another term": {"constant": 1e-12},
    "name of a result": {"name": "drop"},
    "another result": {"other": "drop"},
    "function on the host": {"on_host": lambda x: np.asarray(x) * 2.0},
}


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    """The store of a study with one chunk, which is computed once."""
    path = tmp_path_factory.mktemp("counts") / "a"
    jc.study(make(), FORCES, path, chunk=3)
    return path


def refused(part, function, cases, path, **options):
    with pytest.raises(ValueError, match="holds a study with") as found:
        jc.study(function, cases, path, **{"chunk": 3} | options)
    assert f"{part} = " in str(found.value), found.value
    assert str(found.value).count(", not ") >= 1  # both digests


@pytest.mark.slow_cases("increments", "law", "stiffness", "supports")
@pytest.mark.parametrize("changed", OTHER_MODELS.values(), ids=OTHER_MODELS)
def test_another_model_is_refused(store, changed):
    refused("function", make(**changed), FORCES, store)


def test_other_cases_are_refused(store):
    refused("cases", make(), FORCES + 1e-9, store)
    refused("shape", make(), FORCES[:2], store)
    refused("function", make(), FORCES.astype(np.float32), store)
    refused("dims", make(), jc.studies.table(FORCES, dim="force"), store)
    refused("cases", make(), jc.studies.table(FORCES, labels="abc"), store)
    refused("cases", make(), jc.studies.samples(lambda numbers: FORCES[numbers] + 1, 3), store)


def test_other_names_and_chunks_are_refused(store):
    refused("dims", make(), FORCES, store, dims={"move": ["axis"]})
    refused("coords", make(), FORCES, store, coords={"move_0": [1, 2, 3]})
    refused("chunks", make(), FORCES, store, chunk=2)


@pytest.mark.parametrize(
    ("part", "place", "value"),
    [
        ("jaxcable", "jaxcable.studies.task.package_version", lambda name: "9.9"),
        ("jax", "jax.__version__", "9.9"),
        ("backend", "jax.default_backend", lambda: "tpu"),
        ("fuse_loops", "jaxcable.studies.task.are_loops_fused", lambda: None),
    ],
    ids=["version", "version of jax", "backend", "fused loops"],
)
def test_other_versions_and_settings_are_refused(store, monkeypatch, part, place, value):
    monkeypatch.setattr(place, value)
    refused(part, make(), FORCES, store)


def test_what_changes_no_result_is_accepted(store, monkeypatch):
    before = {path: path.stat().st_mtime_ns for path in (store / "sag").rglob("*")}

    model, unused = make(nodes=np.array(NODES), fixed=[2, 0]), np.arange(3.0)

    def renamed(anything):  # the same model made anew; an array that is captured and not used
        return model(anything) if len(unused) else None

    jc.study(renamed, FORCES.copy(), store, chunk=3)
    jc.study(make(), list(FORCES), store, chunk=3, progress=lambda news: None)
    monkeypatch.chdir(store.parent)
    jc.study(make(), FORCES, os.path.relpath(store), chunk=3)
    assert {path: path.stat().st_mtime_ns for path in (store / "sag").rglob("*")} == before
    found = jc.study(make(), FORCES, store, chunk=3, units={"sag": "m"})
    assert found.open().sag.units == "m" and found.missing == []
