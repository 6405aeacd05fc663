"""The notice that one waits for the compiler: where it is shown, once, and gone when it is over."""

import os
import re
import subprocess
import sys
import textwrap
import threading
import time
import types
from pathlib import Path

import jax.numpy as jnp
import pytest

import jaxcable as jc
from jaxcable.common import compile_notice, interrupt, program_store
from jaxcable.common.compile_notice import announce_compilation, show_compilation

pty = pytest.importorskip("pty", reason="this system has no pseudo-terminals")

ROOT = Path(__file__).parents[2]
LIMIT = 120  # seconds for a process that takes five
TEXT = "compiling the solver: some seconds in each process; jc.keep_programs() keeps it"


UNATTENDED = compile_notice._UNATTENDED


@pytest.fixture(autouse=True)
def attended(monkeypatch):
    """As where nobody has set anything, with a short pause."""
    for name in ("CI", "JAXCABLE_PROGRESS"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(compile_notice, "_UNATTENDED", ("CI",))  # pytest sets its own in each test
    monkeypatch.setattr(compile_notice, "_PAUSE", 0.02)
    monkeypatch.setattr(compile_notice, "_cells", [])
    monkeypatch.setattr(program_store, "_open_place", [])


class Stream:
    """A stream that is a terminal or not."""

    def __init__(self, terminal):
        self.terminal, self.text = terminal, ""

    def isatty(self):
        return self.terminal

    def write(self, text):
        self.text += text

    def flush(self):
        pass


def use_as_stderr(stream, monkeypatch):
    """Make the notice take a stream for stderr; pytest puts its own into `sys` for each test."""
    around = types.SimpleNamespace(stderr=stream, modules=sys.modules)
    monkeypatch.setattr(compile_notice, "sys", around)


@pytest.fixture
def terminal(monkeypatch):
    stream = Stream(True)
    use_as_stderr(stream, monkeypatch)
    return stream


def screen(text):
    """What a terminal shows of a text: one line, as carriage returns leave it."""
    line = ""
    for part in text.split("\r"):
        line = part + line[len(part) :]
    return line.rstrip(" ")


def wait_for(condition):
    """Wait until a condition holds; fail after ten seconds."""
    end = time.monotonic() + 10.0
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.005)


def test_a_terminal_shows_a_line_and_erases_it(terminal):
    with announce_compilation():
        wait_for(lambda: terminal.text)
        assert screen(terminal.text) == TEXT and len(TEXT) < 80
        assert interrupt.SHOWN_LINE  # what Ctrl-C on the command line writes first
        assert screen(terminal.text + interrupt.SHOWN_LINE[0] + "interrupted") == "interrupted"
    assert screen(terminal.text) == "" and "\n" not in terminal.text
    assert terminal.text.endswith("\r") and not interrupt.SHOWN_LINE


def test_short_waits_are_silent_and_nothing_comes_after_the_end(terminal):
    for _ in range(50):  # ends just as the line is to come
        with announce_compilation():
            time.sleep(0.02)
        text = terminal.text
        assert screen(text) == ""
        time.sleep(0.005)
        assert terminal.text == text
    terminal.text = ""
    with announce_compilation():
        pass
    time.sleep(0.1)
    assert terminal.text == ""


def test_a_line_as_long_as_the_terminal_is_wide_is_cut(terminal, monkeypatch):
    monkeypatch.setattr(compile_notice, "_columns_of_terminal", lambda: 30)
    with announce_compilation():
        wait_for(lambda: terminal.text)
    assert terminal.text == f"\r{TEXT[:29]}\r{' ' * 29}\r"


def test_one_wait_has_one_line(terminal):
    with announce_compilation():
        with announce_compilation(), announce_compilation():
            wait_for(lambda: terminal.text)
            time.sleep(0.1)
        assert screen(terminal.text) == TEXT
    assert terminal.text.count("compiling") == 1
    with announce_compilation():  # the next wait
        wait_for(lambda: terminal.text.count("compiling") == 2)


def test_programs_kept_on_disk_are_compiled_once(terminal, monkeypatch):
    monkeypatch.setattr(program_store, "_open_place", [None])
    with announce_compilation():
        wait_for(lambda: terminal.text)
        assert screen(terminal.text).endswith("some seconds, in the first run only")


@pytest.mark.parametrize("how", ["pipe", "none", "closed", "CI", "pytest", "variable", "thread"])
def test_nobody_who_does_not_look_is_told(how, terminal, monkeypatch):
    if how in ("pipe", "closed"):
        terminal.terminal = False
    if how == "none":
        use_as_stderr(None, monkeypatch)
    if how == "closed":
        terminal.isatty = lambda: "".index("closed")  # as a closed file does
    if how == "pytest":
        monkeypatch.setattr(compile_notice, "_UNATTENDED", UNATTENDED)
    if how in ("CI", "variable"):
        monkeypatch.setenv("CI" if how == "CI" else "JAXCABLE_PROGRESS", "0")

    def work():
        with announce_compilation():
            time.sleep(0.1)

    if how == "thread":
        thread = threading.Thread(target=work)
        thread.start()
        thread.join()
    else:
        work()
    assert terminal.text == ""


def test_a_command_works_in_a_thread_of_its_own(terminal):
    def work():
        with show_compilation("terminal"), announce_compilation():
            wait_for(lambda: terminal.text)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert terminal.text.count("compiling") == 1 and screen(terminal.text) == ""


def test_the_outer_call_decides(terminal):
    with show_compilation(False), show_compilation(True), announce_compilation():
        time.sleep(0.1)
    with show_compilation(print), announce_compilation():  # reports of progress go elsewhere
        time.sleep(0.1)
    assert terminal.text == ""
    with show_compilation(None), announce_compilation():
        wait_for(lambda: terminal.text)


@pytest.mark.parametrize(
    "work",
    [
        lambda progress: jc.solve(*jc.scenes.saddle(2, 2), progress=progress),
        lambda progress: jc.minimize(
            lambda x: jnp.sum((x - 2.0) ** 4), jnp.zeros(3), progress=progress
        ),
        lambda progress: jc.fit(lambda x: x - 2.0, jnp.zeros(3), progress=progress),
        lambda progress: jc.design.minimize_subject_to(
            lambda x: (jnp.sum(x), 1.0 - x), jnp.full(3, 2.0), progress=progress
        ),
    ],
    ids=["solve", "minimize", "fit", "minimize_subject_to"],
)
def test_calls_that_compile_say_so_unless_they_shall_not(work, terminal, monkeypatch):
    monkeypatch.setattr(compile_notice, "_PAUSE", 1e-3)
    jc.forget_programs()
    work(False)
    assert terminal.text == ""
    jc.forget_programs()
    work(None)
    assert terminal.text.count(TEXT) >= 1 and screen(terminal.text) == ""
    assert "\n" not in terminal.text


class Kernel:
    """A kernel of IPython that executes a cell, for a person or for a program."""

    def __init__(self, asks):
        self.asks = asks

    def get_parent(self, channel):
        assert channel == "shell"
        return {"content": {"allow_stdin": self.asks}} if self.asks is not None else {}


def in_notebook(monkeypatch, kernel):
    """Make this process look like one that a notebook uses; return its shell and its stderr."""
    stream, shell = Stream(False), types.SimpleNamespace(execution_count=1)
    if kernel is not None:
        shell.kernel = kernel
    monkeypatch.setitem(sys.modules, "IPython", types.SimpleNamespace(get_ipython=lambda: shell))
    use_as_stderr(stream, monkeypatch)
    return shell, stream


@pytest.mark.parametrize("asks", [True, None])
def test_a_cell_of_a_notebook_has_one_line(asks, monkeypatch):
    shell, stream = in_notebook(monkeypatch, Kernel(asks))
    for _ in range(3):  # an analysis, its gradient, ...
        with announce_compilation():
            time.sleep(0.1)
    assert stream.text == f"{TEXT}\n"
    shell.execution_count = 2
    with announce_compilation():
        wait_for(lambda: stream.text == f"{TEXT}\n" * 2)


@pytest.mark.parametrize("kernel", [Kernel(False), None], ids=["executed", "no kernel"])
def test_a_notebook_that_a_program_executes_has_none(kernel, monkeypatch):
    _, stream = in_notebook(monkeypatch, kernel)
    with announce_compilation():
        time.sleep(0.1)
    assert stream.text == ""


# --- processes

SCRIPT = """
    import sys
    import jax
    from jaxcable.common import compile_notice
    import jaxcable as jc

    jax.config.update("jax_enable_x64", True)
    compile_notice._PAUSE = 0.1  # it is traced for longer
    scene = jc.scenes.saddle(2, 2)
    print("begin", file=sys.stderr)
    status = int(jc.solve(*scene).status)
    print("status", status, file=sys.stderr)
    assert int(jc.solve(*jc.scenes.saddle(2, 3), progress=False).status) == 0
    print("end", file=sys.stderr)
"""


def environment(**variables):
    """Environment of a process that pytest has not started, with some variables."""
    own = {name: text for name, text in os.environ.items() if name not in UNATTENDED}
    return {**own, "PYTHONPATH": str(ROOT), **variables}


def run_in_terminal(words, **variables):
    """Run a command in a pseudo-terminal; return its exit status, and what it has written there."""
    ours, theirs = pty.openpty()
    running = subprocess.Popen(
        words,
        stdin=theirs,
        stdout=theirs,
        stderr=theirs,
        env=environment(**variables),
    )
    os.close(theirs)
    end, text = threading.Timer(LIMIT, running.kill), b""
    end.start()
    try:
        while part := os.read(ours, 4096):
            text += part
    except OSError:  # Linux: the other side is closed
        pass
    finally:
        os.close(ours)
        code = running.wait()
        end.cancel()
    return code, text.decode().replace("\r\n", "\n")


def test_a_script_in_a_terminal():
    script = textwrap.dedent(SCRIPT)
    code, text = run_in_terminal([sys.executable, "-c", script])
    assert code == 0 and [screen(line) for line in text.split("\n")] == [
        "begin",
        "status 0",
        "end",
        "",
    ], text
    assert TEXT in text and text.endswith("\nend\n")
    run = subprocess.run(
        [sys.executable, "-c", script],
        capture_output=True,
        text=True,
        env=environment(),
        timeout=LIMIT,
    )
    assert run.stderr == "begin\nstatus 0\nend\n"  # in a pipe


def test_the_command_line_in_a_terminal(tmp_path):
    jc.save_scene(tmp_path / "net.json", jc.scenes.saddle(2, 2))
    begin = "import sys; from jaxcable.common import compile_notice; "
    begin += "compile_notice._PAUSE = 0.1; from jaxcable.cli import main; "
    begin += f"sys.argv = ['jaxcable', 'solve', {str(tmp_path / 'net.json')!r}, *sys.argv[1:]]; "
    words = [sys.executable, "-c", f"{begin} sys.exit(main())"]
    kept = {"JAXCABLE_PROGRAMS": str(tmp_path / "kept"), "JAX_COMPILATION_CACHE_DIR": ""}
    code, text = run_in_terminal(words, **kept)
    assert code == 0 and "compiling the solver: some seconds, in the first run only" in text, text
    shown = [screen(line) for line in text.split("\n")]
    assert shown[0].startswith("status 0: converged") and "compiling" not in "".join(shown)
    code, again = run_in_terminal(words, **kept)  # it is kept
    assert code == 0 and again.split("\n") == shown
    code, text = run_in_terminal([*words, "--quiet"], JAXCABLE_PROGRAMS="")
    assert code == 0 and not re.search(r"\S", text)
