"""Nothing is lost: of a stranger's files only the one that a call names may change."""

import numpy as np
import pytest
from banks import strangers

import jaxcable as jc


@pytest.fixture(scope="module")
def solution():
    return jc.solve(*strangers.SCENE)


@pytest.mark.parametrize(
    "count", [60, pytest.param(200, marks=pytest.mark.slow)], ids=["some", "many"]
)
def test_files_of_strangers_stay_bit_by_bit(tmp_path, monkeypatch, solution, count):
    monkeypatch.chdir(tmp_path)
    strangers.fill(tmp_path)
    faults, wrote, refused = strangers.harm(tmp_path, count, count, solution, every=count > 100)
    assert faults == []
    assert wrote > count // 5 and refused > count // 10  # of both there were many


def test_the_control_finds_what_harms(tmp_path, monkeypatch, solution):
    """One that deletes, one that leaves something behind, one that stops half way."""
    strangers.fill(tmp_path)

    def deletes(path):
        (tmp_path / "letter.txt").unlink(missing_ok=True)

    def leaves(path):
        (tmp_path / ".net.part").write_text("half")

    def half(path):
        (tmp_path / "data.bin").write_text("half")
        raise ValueError

    for harmful in (deletes, leaves, half):
        monkeypatch.setattr(strangers, "calls", lambda *_, f=harmful: [(f, lambda path: [], "")])
        monkeypatch.chdir(tmp_path)
        faults, _, _ = strangers.harm(tmp_path, 1, 0, solution)
        assert len(faults) == 1


def test_a_file_keeps_its_permissions_and_a_failed_set_leaves_nothing(tmp_path):
    from jaxcable.common.writing import atomic_write_together

    (tmp_path / "a.txt").write_text("old")
    (tmp_path / "a.txt").chmod(0o600)
    with pytest.raises(np.exceptions.AxisError), atomic_write_together() as begin:
        begin(tmp_path / "a.txt").write("new")
        begin(tmp_path / "b.txt").write("new")
        raise np.exceptions.AxisError("a fault")
    assert [path.name for path in tmp_path.iterdir()] == ["a.txt"]
    assert (tmp_path / "a.txt").read_text() == "old"
    with atomic_write_together() as begin:
        begin(tmp_path / "a.txt").write("new")
        begin(tmp_path / "b.txt").write("new")
    assert (tmp_path / "a.txt").read_text() == (tmp_path / "b.txt").read_text() == "new"
    assert (tmp_path / "a.txt").stat().st_mode & 0o777 == 0o600
