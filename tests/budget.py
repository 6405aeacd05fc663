"""What a run of the whole suite may cost: processor time, in units of the bare analysis.

`budgets.toml` has the budgets. The unit is the first call of the bare analysis of `experiments`,
taken before the tests by as many processes as run them, so that machine and neighbours count on
both sides. A run beyond its budget fails, and shows the dearest tests. A run of some tests has no
budget.
"""

import os
import pathlib
import statistics
import subprocess
import sys
import tomllib

import jax
import pytest

TESTS = pathlib.Path(__file__).parent
SHOWN = 20  # of the dearest tests
UNIT = """
import sys, time
sys.path.insert(0, sys.argv[1])
import jax
jax.config.update("jax_enable_x64", True)
from benchmarks.bare import bare
run, values = bare()
begin = time.process_time()
jax.block_until_ready(jax.jit(run)(*values))
print(time.process_time() - begin)
"""


def processor_seconds():
    """Seconds that this process, and those that it has waited for, have taken of processors."""
    return sum(os.times()[:4])


def measure_unit(count):
    """Return the processor time of the unit, s: the median of `count` processes at once, twice."""
    command = [sys.executable, "-c", UNIT, str(TESTS.parent / "experiments")]
    other = "XLA_FLAGS", "JAX_COMPILATION_CACHE_DIR"  # of the tests; the unit is compiled anew
    environment = {k: v for k, v in os.environ.items() if k not in other}
    found = []
    for _ in range(2):
        runs = [
            subprocess.Popen(command, stdout=subprocess.PIPE, env=environment) for _ in range(count)
        ]
        found += [float(run.communicate()[0]) for run in runs]
    return statistics.median(found)


class Budget:
    """A plugin of pytest: in a worker it notes what tests cost, in the controller it judges.

    Args:
        allowed: units that the run may take, "run", and a test, "test"; None: no budget.
        unit: function that returns the seconds of a unit, for a number of processes.
    """

    def __init__(self, allowed, unit=measure_unit):
        self.allowed, self.measure, self.unit = allowed, unit, None
        self.tests, self.workers, self.compiled = [], 0.0, 0
        jax.monitoring.register_event_duration_secs_listener(self._listen)

    def _listen(self, event, _, **__):
        self.compiled += "backend_compile" in event

    def pytest_sessionstart(self, session):
        """Take the unit, before workers begin."""
        config = session.config
        if self.allowed is not None and not hasattr(config, "workerinput"):
            self.unit = self.measure(len(config.getoption("tx", None) or [0]))
            self.begin = processor_seconds()

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_setup(self, item):
        """Begin to count for a test, its fixtures included."""
        item.stash[_BEGIN] = processor_seconds(), self.compiled
        return (yield)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(self, item, call):
        """Note in the last report of a test what it has cost."""
        report = yield
        if call.when == "teardown":
            seconds, compiled = item.stash[_BEGIN]
            cost = processor_seconds() - seconds, self.compiled - compiled
            report.user_properties.append(("cost", cost))
        return report

    def pytest_runtest_logreport(self, report):
        """Collect the costs of tests in the controller."""
        self.tests += [
            (*cost, report.nodeid) for name, cost in report.user_properties if name == "cost"
        ]

    def pytest_sessionfinish(self, session):
        """Judge, or tell the controller what this worker has taken."""
        config = session.config
        if hasattr(config, "workerinput"):
            config.workeroutput["seconds"] = processor_seconds()
        elif self.unit is not None and self._judge()[1]:
            session.exitstatus = pytest.ExitCode.TESTS_FAILED

    @pytest.hookimpl(optionalhook=True)  # of pytest-xdist
    def pytest_testnodedown(self, node):
        """Add what a worker has taken."""
        self.workers += getattr(node, "workeroutput", {}).get("seconds", 0.0)

    def _judge(self):
        """Return the units that the run has taken, and what is wrong with that."""
        # workers are children, too: those that have ended are in both numbers
        total = max(self.workers, processor_seconds() - self.begin) / self.unit
        wrong = []
        if total > self.allowed["run"]:
            wrong.append(f"the run took {total:.0f} units, and may take {self.allowed['run']}")
        for seconds, _, name in sorted(self.tests, reverse=True):
            if seconds > self.allowed["test"] * self.unit:
                units = seconds / self.unit
                wrong.append(f"{name} took {units:.1f}, and a test may take {self.allowed['test']}")
        return total, wrong

    def pytest_terminal_summary(self, terminalreporter):
        """Tell what the run has cost, and if that is too much, of which tests."""
        if self.unit is None:
            return
        say, (total, wrong) = terminalreporter.write_line, self._judge()
        say(f"{total:.0f} of {self.allowed['run']} units of {self.unit:.2f} s of processor time")
        if not wrong:
            return
        terminalreporter.section("beyond the budget (tests/budgets.toml)", red=True)
        for line in wrong:
            say(line)
        say("the dearest tests: units, programs that XLA compiled or read")
        for seconds, compiled, name in sorted(self.tests, reverse=True)[:SHOWN]:
            say(f"{seconds / self.unit:6.1f} {compiled:5}  {name}")


_BEGIN = pytest.StashKey()


def budget_of(config):
    """Return what a run may cost, a dict, or None if it is not a run of the whole suite."""
    whole = [pathlib.Path(name).resolve() for name in config.args] in ([TESTS], [config.rootpath])
    if not whole or config.option.keyword or config.option.collectonly:
        return None
    budgets = tomllib.loads((TESTS / "budgets.toml").read_text("utf-8"))
    allowed = budgets.get(config.option.markexpr)
    if allowed is None or jax.__version_info__ < (0, 11):
        return allowed
    return {**allowed, "run": allowed["run_with_newer_jax"]}
