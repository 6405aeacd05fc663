"""`import jaxcable` brings what an analysis needs; other rooms come when they are used."""

import subprocess
import sys
import textwrap

CODE = """
    import sys
    import jaxcable as jc
    rooms = sorted(m for m in sys.modules if m.startswith("jaxcable.") and m.count(".") == 1)
    print(*rooms, "scipy.optimize" in sys.modules)
    assert set(jc.__all__) <= set(dir(jc))
    for name in jc.__all__:
        assert getattr(jc, name) is getattr(jc, name), name
    try:
        jc.modes
    except AttributeError as error:
        print(error)
"""


def test_rooms_beside_the_analysis_come_when_they_are_used():
    words = [sys.executable, "-c", textwrap.dedent(CODE)]
    done = subprocess.run(words, capture_output=True, text=True, timeout=100)
    rooms, refusal = done.stdout.splitlines()
    *rooms, optimizer = rooms.split()
    assert "jaxcable.analysis" in rooms and "jaxcable.elements" in rooms
    later = "catalogue design dynamics files lines masts plots reliability reporting studies"
    assert not {f"jaxcable.{room}" for room in later.split()} & set(rooms)
    assert optimizer == "False"
    assert refusal == "module 'jaxcable' has no attribute 'modes'"
