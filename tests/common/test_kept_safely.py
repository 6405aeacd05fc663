"""Kept programs: nothing of the user's is removed, nobody else's is run, and none is outdated."""

import gc
import math
import os
import pickle
import re
import shutil
import subprocess
import sys
import textwrap
import threading
import time
import types
import warnings
import zlib

import jax
import numpy as np
import pytest
import scipy
from test_keeping import product

import jaxcable as jc
from jaxcable.common import jax_internals, program_folder, program_store, python_objects
from jaxcable.common.checks import warn_user, without_warnings
from jaxcable.common.compilation import without_garbage_collection
from jaxcable.common.program_folder import ProgramFolder, open_program_folder

posix = pytest.mark.skipif(not hasattr(os, "geteuid"), reason="owners and modes of POSIX")
KEYS = [16 * f"{k:02x}" for k in range(4)]


pytestmark = pytest.mark.usefixtures("nothing_kept")


# --- what is ours


def fill(place):
    """Four programs of 300 bytes and what jax adds, the first used longest ago; other things."""
    ours = [place.programs_folder / f"{key}.program" for key in KEYS]
    ours[1] = place.jax_cache_folder / f"jit__fn-{64 * 'a'}-cache"
    for k, path in enumerate(ours):
        path.write_bytes(bytes(300))
        os.utime(path, (k, k))
    others = [
        place.folder / "thesis.docx",
        place.programs_folder / "notes.program",
        place.programs_folder / f"{KEYS[0]}.program.bak",
        place.jax_cache_folder / "jit_mine-cache",
        place.folder / f"{KEYS[0]}.program",
    ]
    for path in others:
        path.write_bytes(bytes(5000))
        os.utime(path, (0, 0))  # older than all of ours
    return ours, others


def test_only_our_files_are_removed_and_the_oldest_first(tmp_path):
    place = open_program_folder(tmp_path, 1200)
    ours, others = fill(place)
    place.remove_oldest_files()
    assert all(path.exists() for path in (*ours, *others))  # 1200 bytes of ours
    ProgramFolder(place.folder, 1000).remove_oldest_files()  # 800 may be left
    assert [path.exists() for path in ours] == [False, False, True, True]
    assert all(path.exists() for path in others)
    ProgramFolder(place.folder, 0).remove_oldest_files()
    assert not any(path.exists() for path in ours) and all(path.exists() for path in others)
    assert (place.programs_folder / "CACHEDIR.TAG").read_bytes()[:43] == (
        b"Signature: 8a477f597d28d172789f06886806bc55"
    )


def test_a_folder_that_is_not_marked_is_left_alone(tmp_path):
    place = open_program_folder(tmp_path, 0)
    ours, _ = fill(place)
    for folder in (place.programs_folder, place.jax_cache_folder):
        (folder / "CACHEDIR.TAG").write_text("Signature: 8a477f597d28d172789f06886806bc55\n# pip")
    place.remove_oldest_files()
    assert all(path.exists() for path in ours)
    place.write_program(KEYS[0], b"new")
    assert ours[0].read_bytes() == bytes(300)


@posix
def test_links_are_not_followed(tmp_path):
    place = open_program_folder(tmp_path / "kept", 0)
    precious = tmp_path / "precious"
    precious.mkdir()
    (precious / f"{KEYS[0]}.program").write_bytes(bytes(300))
    link = place.programs_folder / f"{KEYS[0]}.program"
    link.symlink_to(precious / link.name)
    assert place.read_program(KEYS[0]) is None
    place.remove_oldest_files()
    assert link.is_symlink() and (precious / link.name).exists()
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "programs").symlink_to(precious)
    with pytest.raises(ValueError, match="symbolic link"):
        jc.keep_programs(tmp_path / "other")
    (tmp_path / "reached").symlink_to(tmp_path / "kept")  # the way there is the user's own
    assert open_program_folder(tmp_path / "reached", 9).folder == tmp_path / "kept"


def test_a_folder_with_other_things_of_that_name_is_refused(tmp_path):
    (tmp_path / "xla").mkdir()
    (tmp_path / "xla" / "compiler.cc").write_text("int main() {}")
    with pytest.raises(ValueError, match=r"folder: .*xla: contains files that jaxcable has not"):
        jc.keep_programs(tmp_path)
    assert [path.name for path in (tmp_path / "xla").iterdir()] == ["compiler.cc"]
    assert not program_store._open_place


# --- whose they are


def refused_twice(folder, said, monkeypatch):
    """An error where a call names the folder, a warning where the environment does."""
    with pytest.raises(ValueError, match=rf"folder: {said}"):
        jc.keep_programs(folder)
    monkeypatch.setenv("JAXCABLE_PROGRAMS", str(folder))
    with pytest.warns(RuntimeWarning, match=rf"{said}.*; no programs are kept"):
        jc.keep_programs()
    assert not program_store._open_place and jax.config.jax_compilation_cache_dir != str(
        folder / "xla"
    )


@posix
@pytest.mark.parametrize("inside", ["", "programs"])
def test_a_folder_that_others_can_write_to_is_refused(inside, tmp_path, monkeypatch):
    folder = open_program_folder(tmp_path / "kept", 9).folder
    (folder / inside).chmod(0o770)
    refused_twice(folder, ".*other users can write to it.*`chmod go-w", monkeypatch)


@posix
def test_files_that_others_own_or_can_write_are_refused(tmp_path, monkeypatch):
    place = open_program_folder(tmp_path, 1 << 20)
    place.write_program(KEYS[0], b"of mine")
    assert place.read_program(KEYS[0]) == b"of mine"
    (place.programs_folder / f"{KEYS[0]}.program").chmod(0o666)
    with pytest.warns(RuntimeWarning, match="other users can write"):
        assert program_store._load_program(place, KEYS[0], []) is None
    monkeypatch.setattr(os, "geteuid", lambda: os.getuid() + 1)
    with pytest.raises(ValueError, match="belongs to another user"):
        jc.keep_programs(tmp_path)
    with pytest.warns(RuntimeWarning, match="belongs to another user.*compiled again"):
        assert program_store._load_program(place, KEYS[0], []) is None


@posix
def test_a_folder_that_others_can_replace_is_refused(tmp_path, monkeypatch):
    """Because they can write to one on the way to it, perhaps behind a link."""
    shared = tmp_path / "shared"
    (shared / "below" / "kept").mkdir(parents=True)
    shared.chmod(0o777)
    said = rf"{re.escape(str(shared))}: other users can write to it .*`chmod go-w"
    (tmp_path / "link").symlink_to(shared / "below" / "kept")  # into it
    (tmp_path / "relative").symlink_to(os.path.join("shared", "below"))
    (shared / "out").symlink_to(tmp_path / "own")  # a link in it, which others can turn
    (tmp_path / "own").mkdir(mode=0o700)
    for folder in (
        shared / "below" / "kept",
        shared / "new" / "newer",
        tmp_path / "link",
        tmp_path / "relative" / "kept",
        tmp_path / "own" / ".." / "shared" / "below" / "kept",
        shared / "out",
        shared / "out" / "new",
    ):
        refused_twice(folder, said, monkeypatch)
    assert sorted(path.name for path in shared.iterdir()) == ["below", "out"]  # nothing is made
    assert not any((shared / "below" / "kept").iterdir()) and not any((tmp_path / "own").iterdir())
    shared.chmod(0o1777)  # as /tmp: nobody moves what others own
    assert jc.keep_programs(shared / "below" / "kept") and program_store._open_place
    jc.keep_programs(limit=0)
    shared.chmod(0o770)
    monkeypatch.setattr(program_folder, "_is_private_group", lambda number: False)
    refused_twice(shared / "below" / "kept", said, monkeypatch)
    monkeypatch.setattr(program_folder, "_is_private_group", lambda number: True)
    assert jc.keep_programs(shared / "below" / "kept") and program_store._open_place


@posix
def test_a_folder_on_the_way_of_another_user_is_refused(tmp_path, monkeypatch):
    (tmp_path / "theirs" / "kept").mkdir(parents=True)
    real, theirs = os.lstat, str(tmp_path / "theirs")

    def lstat(path):
        found = list(real(path))
        found[4] += 4321 * (str(path) == theirs)  # its owner
        return os.stat_result(found)

    monkeypatch.setattr(os, "lstat", lstat)
    said = rf"{re.escape(theirs)}: belongs to another user, who could replace the programs"
    refused_twice(tmp_path / "theirs" / "kept", said, monkeypatch)


def test_private_groups_are_those_of_one_user(monkeypatch):
    grp, pwd = pytest.importorskip("grp"), pytest.importorskip("pwd")
    user = pwd.struct_passwd(("anna", "x", os.geteuid(), 700, "", "/", "/bin/sh"))
    monkeypatch.setattr(pwd, "getpwuid", lambda number: user)
    for name, number, members, own in (
        ("anna", 700, [], True),
        ("anna", 700, ["anna"], True),
        ("anna", 700, ["anna", "bert"], False),
        ("users", 700, [], False),
        ("anna", 701, [], False),
    ):
        group = grp.struct_group((name, "x", number, members))
        monkeypatch.setattr(grp, "getgrgid", lambda _, group=group: group)
        assert program_folder._is_private_group(number) is own


@posix
def test_a_file_is_no_folder(tmp_path, monkeypatch):
    file = tmp_path / "letter.txt"
    file.write_text("mine")
    (tmp_path / "link").symlink_to(file)
    os.mkfifo(tmp_path / "pipe")
    said = rf"{re.escape(str(file))}: is a file, not a folder"
    for folder in (file, tmp_path / "link", file / "kept", tmp_path / "link" / "kept"):
        refused_twice(folder, said, monkeypatch)
    refused_twice(tmp_path / "pipe", ".*pipe: is a file, not a folder", monkeypatch)
    for k in range(2):
        (tmp_path / f"ring{k}").symlink_to(tmp_path / f"ring{1 - k}")
    refused_twice(tmp_path / "ring0", ".*leads through more than 40 symbolic links", monkeypatch)
    assert file.read_text() == "mine"
    (tmp_path / "dangling").symlink_to(tmp_path / "made")  # is made
    assert jc.keep_programs(tmp_path / "dangling") and (tmp_path / "made" / "xla").is_dir()


def test_wrong_folders_and_limits():
    for folder in ("", 3):
        with pytest.raises(ValueError, match=r"folder = .*: expected the path of a folder"):
            jc.keep_programs(folder)
    for limit in (-1, 2.5):
        with pytest.raises(ValueError, match="limit"):
            jc.keep_programs("never", limit=limit)


# --- damage


@pytest.mark.parametrize("text", [b"", b"no zlib", zlib.compress(b"no pickle"), None])
def test_a_file_that_makes_no_sense_is_said_and_not_used(text, tmp_path):
    place = open_program_folder(tmp_path, 1 << 20)
    text = zlib.compress(pickle.dumps(("two", "parts"))) if text is None else text
    place.write_program(KEYS[0], text)  # with a right checksum
    path = re.escape(str(place.program_path(KEYS[0])))
    named = rf"{path}: the file is damaged; the program is compiled again"
    with pytest.warns(RuntimeWarning, match=named):
        assert program_store._load_program(place, KEYS[0], []) is None


def test_a_file_under_another_key_is_not_used(tmp_path):
    place = open_program_folder(tmp_path, 1 << 20)
    place.write_program(KEYS[0], b"program")
    os.rename(
        place.programs_folder / f"{KEYS[0]}.program", place.programs_folder / f"{KEYS[1]}.program"
    )
    with pytest.raises(program_folder.DamagedFileError):
        place.read_program(KEYS[1])
    assert place.read_program(KEYS[2]) is None


# --- of which code

EDITED = """
    import pathlib, sys
    import jax; jax.config.update("jax_enable_x64", True)
    import jaxcable as jc
    jc.keep_programs("kept")
    if "edit" in sys.argv:
        file = pathlib.Path(jc.elements.straight.__file__)
        old, new = "return stiffness * strain if law", "return 2.0 * stiffness * strain if law"
        text = file.read_text()
        assert text.count(old) == 1
        file.write_text(text.replace(old, new))
    nodes = [[-1.0, 0, 0], [1, 0, 0], [0, 0, 0.0]]
    cables = jc.Cables([[0, 2], [1, 2]], axial_stiffness=1e5)
    structure = jc.Structure(nodes, cables, jc.pinned([0, 1]) + jc.restrained([2], "xy"))
    load = jc.Phase(loads=jc.NodalLoads([2], (0.0, 0.0, -300.0)))
    solution = jc.solve(structure, [jc.Phase(pretension=1000.0), load])
    print(int(solution.status), float(solution.displacement[2, 2]))
"""


def test_source_that_is_edited_between_import_and_first_call(tmp_path):
    """Its program is one of the source that was imported; the next process compiles anew."""
    shutil.copytree(os.path.dirname(jc.__file__), tmp_path / "jaxcable")
    clean = {k: v for k, v in os.environ.items() if not k.startswith("JAX")}
    clean |= {"PYTHONPATH": str(tmp_path), "PYTHONDONTWRITEBYTECODE": "1"}
    clean |= {"JAX_DISABLE_MOST_OPTIMIZATIONS": "1"}

    def sag(*words):
        command = [sys.executable, "-c", textwrap.dedent(EDITED), *words]
        run = subprocess.run(command, env=clean, cwd=tmp_path, capture_output=True, timeout=120)
        assert run.returncode == 0, run.stderr.decode()
        code, down = run.stdout.split()
        assert int(code) == jc.status.OK
        return -float(down)

    def by_hand(factor):
        """Where two cables of `factor` times the stiffness carry the load, from 1000 N on."""

        def lacks(s):
            length = math.hypot(1.0, s)
            rest = (
                1.0 / 1.01
            )  # 1 m, as long as a pretension of 1000 N asks for: that was not edited
            return 2 * factor * 1e5 * (length / rest - 1) * s / length - 300.0

        return scipy.optimize.brentq(lacks, 0.0, 1.0, xtol=1e-14)

    np.testing.assert_allclose([sag("edit"), sag()], [by_hand(1.0), by_hand(2.0)], rtol=1e-9)


# --- threads


def together(function, count=8, rounds=30):
    """Call a function from several threads at once, many times; True if all have ended."""
    barrier, errors = threading.Barrier(count), []

    def work():
        try:
            barrier.wait()
            for _ in range(rounds):
                function()
        except Exception as error:
            errors.append(error)

    threads = [threading.Thread(target=work, daemon=True) for _ in range(count)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(30)
    assert not errors
    return not any(thread.is_alive() for thread in threads)


def test_settings_are_as_before_when_threads_compile_at_once():
    seconds = jax.config.jax_persistent_cache_min_compile_time_secs

    def compiles():
        with jax_internals.without_jax_cache(), without_garbage_collection(), without_warnings():
            assert jax.config.jax_persistent_cache_min_compile_time_secs == float("inf")
            time.sleep(1e-4)
            assert not gc.isenabled()
            warn_user("not issued")

    assert gc.isenabled()
    filters = list(warnings.filters)
    assert together(compiles)
    assert gc.isenabled() and warnings.filters == filters
    assert jax.config.jax_persistent_cache_min_compile_time_secs == seconds
    with pytest.warns(jc.InputWarning, match="issued"):
        warn_user("issued")


# --- what jax lacks


def test_without_a_way_to_store_programs(tmp_path, monkeypatch):
    monkeypatch.setattr(jax_internals, "_warned_features", set())
    monkeypatch.setattr(jax_internals, "program_serializer", lambda: None)
    with pytest.warns(RuntimeWarning, match=f"jax {jax.__version__} lacks .*serialize_executable"):
        jc.keep_programs(tmp_path)
    assert product() == 6.0
    assert not list((tmp_path / "programs").glob("*.program"))
    jc.keep_programs(tmp_path)  # is said once


def test_without_the_settings_of_jax(tmp_path, monkeypatch):
    monkeypatch.setattr(jax_internals, "_warned_features", set())
    monkeypatch.setattr(jax_internals, "jax_settings", lambda: None)
    with pytest.warns(RuntimeWarning, match="lacks jax.config.values: programs are not kept"):
        jc.keep_programs(tmp_path)
    with pytest.raises(python_objects.ForeignCodeError):
        program_store._program_key(("jaxcable.analysis.phase_loop", "analyse"), np.ones(2), {})


def test_a_program_that_jax_cannot_describe_is_said_and_not_kept(tmp_path, monkeypatch):
    def fails(_):
        raise NotImplementedError("constants")

    monkeypatch.setattr(jax_internals, "program_serializer", lambda: (fails, None))
    program = types.SimpleNamespace(as_text=lambda: "")
    with pytest.warns(RuntimeWarning, match="could not be saved: NotImplementedError: constants"):
        program_store._store_program(open_program_folder(tmp_path, 9), KEYS[0], program)
