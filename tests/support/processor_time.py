"""`pytest --processor-time` tells which files and tests take most of the processors, with the programs that they run.

Unlike a clock, it says much the same on a busy machine. A process whose parent has ended is not counted.
"""

import os
from collections import defaultdict
from collections.abc import Generator
from contextlib import suppress

import psutil
import pytest

PROPERTY = "processor seconds"
SHOWN = 25  # files, and tests


def used() -> float:
    """Seconds, by this process and its descendants, living or not."""
    total: float = sum(os.times()[:4])
    for child in psutil.Process().children(recursive=True):
        with suppress(psutil.Error):  # it has ended, and counts with its parent from now on
            total += sum(child.cpu_times()[:4])
    return total


class ProcessorTime:
    """In a worker: notes it with each report. In who started the workers: adds it up, and prints it."""

    def __init__(self) -> None:
        self._before = used()
        self._of_tests = defaultdict[str, float](float)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(self) -> Generator[None, pytest.TestReport, pytest.TestReport]:
        report = yield
        now = used()  # in each phase: with the last one goes what nobody waits for, like a browser's tabs
        report.user_properties.append((PROPERTY, max(0.0, now - self._before)))
        self._before = now
        return report

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        seconds = dict(report.user_properties).get(PROPERTY, 0.0)
        assert isinstance(seconds, float)
        self._of_tests[report.nodeid] += seconds

    def pytest_terminal_summary(self, terminalreporter: pytest.TerminalReporter) -> None:
        of_files = defaultdict[str, float](float)
        for test, seconds in self._of_tests.items():
            of_files[test.partition("::")[0]] += seconds
        terminalreporter.section(f"processor time: {sum(self._of_tests.values()):.0f} s")
        for counted in (of_files, self._of_tests):
            for name, seconds in sorted(counted.items(), key=lambda one: one[1], reverse=True)[:SHOWN]:
                terminalreporter.write_line(f"{seconds:8.1f} s  {name}")
            terminalreporter.write_line("")
