"""What a run of the whole suite may cost: processor time, in units of the bare analysis.

`budgets.toml` has the budgets. The unit is the first call of the bare analysis of `experiments`,
taken by a process of its own again and again among the tests, so that machine and neighbours count
on both sides: within a minute the clock of a processor changes by a fifth. A run beyond its budget
fails, and shows the dearest tests. A run of some tests has no budget.
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
EVERY = 60.0  # seconds of processor time of a worker, after which it takes the unit once more
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


def measure_unit():
    """Return the processor time of the unit, s."""
    command = [sys.executable, "-c", UNIT, str(TESTS.parent / "experiments")]
    other = "XLA_FLAGS", "JAX_COMPILATION_CACHE_DIR"  # of the tests; the unit is compiled anew
    environment = {k: v for k, v in os.environ.items() if k not in other}
    run = subprocess.run(command, stdout=subprocess.PIPE, env=environment, check=True)
    return float(run.stdout)


class Budget:
    """A plugin of pytest: in a worker it notes what tests cost, in the controller it judges.

    Args:
        allowed: units that the run may take, "run", and a test, "test"; None: no budget.
        measure: function that returns the seconds of a unit.
    """

    def __init__(self, allowed, measure=measure_unit):
        self.allowed, self.measure = allowed, measure
        self.tests, self.compiled = [], 0
        self.units, self.measuring = [], 0.0  # seconds of a unit, and that all measurements took
        self.workers = 0.0  # seconds
        jax.monitoring.register_event_duration_secs_listener(self._listen)

    def _listen(self, event, _, **__):
        self.compiled += "backend_compile" in event

    def pytest_sessionstart(self):
        """Begin to count."""
        self.begin = self.measured = processor_seconds()

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self):
        """Take the unit before a test, if it is time for it."""
        begin = processor_seconds()
        if self.allowed is not None and (not self.units or begin - self.measured > EVERY):
            self.units.append(self.measure())
            self.measured = processor_seconds()
            self.measuring += self.measured - begin
        return (yield)

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
            config.workeroutput["budget"] = processor_seconds(), self.units, self.measuring
        elif self.units and self._judge()[2]:
            session.exitstatus = pytest.ExitCode.TESTS_FAILED

    @pytest.hookimpl(optionalhook=True)  # of pytest-xdist
    def pytest_testnodedown(self, node):
        """Add what a worker has taken."""
        seconds, units, measuring = getattr(node, "workeroutput", {}).get("budget", (0.0, [], 0.0))
        self.workers += seconds
        self.units += units
        self.measuring += measuring

    def _judge(self):
        """Return the seconds of a unit, the units of the run, and what is wrong with them."""
        unit = statistics.median(self.units)
        # workers are children, too: those that have ended are in both numbers
        seconds = max(self.workers, processor_seconds() - self.begin) - self.measuring
        total = seconds / unit
        wrong = []
        if total > self.allowed["run"]:
            wrong.append(f"the run took {total:.0f} units, and may take {self.allowed['run']}")
        for seconds, _, name in sorted(self.tests, reverse=True):
            if seconds > self.allowed["test"] * unit:
                units = seconds / unit
                wrong.append(f"{name} took {units:.1f}, and a test may take {self.allowed['test']}")
        return unit, total, wrong

    def pytest_terminal_summary(self, terminalreporter):
        """Tell what the run has cost, and if that is too much, of which tests."""
        if not self.units:
            return
        say, (unit, total, wrong) = terminalreporter.write_line, self._judge()
        low, high = min(self.units), max(self.units)
        say(
            f"{total:.0f} of {self.allowed['run']} units of {unit:.2f} s of processor time "
            f"({low:.2f} to {high:.2f})"
        )
        if not wrong:
            return
        terminalreporter.section("beyond the budget (tests/budgets.toml)", red=True)
        for line in wrong:
            say(line)
        say("the dearest tests: units, programs that XLA compiled or read")
        for seconds, compiled, name in sorted(self.tests, reverse=True)[:SHOWN]:
            say(f"{seconds / unit:6.1f} {compiled:5}  {name}")


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
