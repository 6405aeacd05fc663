"""`make check` finds the test files of a module, a bank, a page and a test."""

from affected import HOUSE, MESSAGES, ROOT, TESTS, affected, files_for


def test_the_files_of_a_change():
    own = TESTS / "forms" / "test_relaxation.py"
    module = ROOT / "jaxcable" / "forms" / "relaxation.py"
    assert files_for(module)[0] == own
    assert {own, HOUSE, MESSAGES} <= set(affected([module]))
    assert affected([own]) == sorted([own, HOUSE])
    assert own not in affected([TESTS / "banks" / "net_bank.py"])
    assert TESTS / "equilibrium" / "test_net_bank.py" in affected([TESTS / "banks" / "net_bank.py"])
    assert TESTS / "project" / "test_claims.py" in affected([ROOT / "README.md"])
    assert HOUSE in affected([ROOT / "jaxcable" / "forms" / "gone.py"])
