"""The table of faults stays true to the package; `tests/mutants.py` puts them in and runs tests."""

import ast
from collections import Counter

import mutants
import rooms
from lines_of_tests import executable
from mutants_table import FAULTS, Fault


def test_text_of_a_fault_occurs_once():
    for fault in FAULTS:
        text = (rooms.PACKAGE / fault.file).read_text()
        assert text.count(fault.old) == 1 and fault.old != fault.new, fault
        faulty = ast.parse(text.replace(fault.old, fault.new))
        assert ast.dump(faulty) != ast.dump(ast.parse(text)), fault  # more than a comment
        assert fault.what


def test_every_room_has_faults():
    count = Counter(fault.room for fault in FAULTS)
    assert len(FAULTS) == 60 and len(set(FAULTS)) == 60
    assert set(count) == set(rooms.rooms()) and min(count.values()) >= 2


def test_lines_of_a_fault_are_those_of_its_text():
    text = "A = 1\n\n\ndef f(x):\n    '''Doc.'''\n    y = (\n        x\n    )\n    return y\n"
    assert executable(text) <= {6, 7, 9} and executable(text) >= {7, 9}
    for fault in FAULTS:
        exact, statement, function = mutants.place(fault)
        assert exact <= function and statement <= function, fault.file


def test_cheapest_tests_of_a_line_come_first():
    fault = next(fault for fault in FAULTS if fault.file == "elements/corotation.py")
    (line,) = mutants.place(fault)[0]
    cheap, dear, beside = (
        {"id": name, "cpu": cpu, "lines": {fault.file: lines}}
        for name, cpu, lines in (("a", 1.0, [line]), ("b", 2.0, [line]), ("c", 0.1, [line + 2]))
    )
    assert mutants.chosen(fault, [dear, beside, cheap], "abc")[0] == ["a", "b"]
    assert mutants.chosen(fault, [dear, beside, cheap], "bc")[0] == ["b"]
    assert mutants.chosen(fault, [beside], "abc") == ([], "run its line")
    told = Fault("forms/self_stress.py", '(True, True): "IV"', "", "only importing runs it")
    touching = [{"id": "a", "cpu": 1.0, "lines": {told.file: [1000]}}]
    assert mutants.chosen(told, touching, "a") == (["a"], "run its module")
    assert mutants.chosen(fault, [], "abc")[0] == []
