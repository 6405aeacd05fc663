"""The table of faults stays true to the package; `tests/mutants.py` puts them in and runs tests."""

import ast
from collections import Counter

import rooms
from mutants_table import FAULTS


def test_text_of_a_fault_occurs_once():
    for fault in FAULTS:
        text = (rooms.PACKAGE / fault.file).read_text()
        assert text.count(fault.old) == 1 and fault.old != fault.new, fault
        faulty = ast.parse(text.replace(fault.old, fault.new))
        assert ast.dump(faulty) != ast.dump(ast.parse(text)), fault  # more than a comment
        assert fault.what


def test_every_room_has_faults():
    count = Counter(fault.room for fault in FAULTS)
    assert len(FAULTS) == 67 == len(set(FAULTS))
    assert set(count) == set(rooms.rooms()) and min(count.values()) >= 2
