"""What all tests share: where the real volumes are, how long Hypothesis searches, and what is told of their cost."""

import os
import signal
import socket
from collections.abc import Generator, Iterator
from pathlib import Path

import psutil
import pytest
import torch
from hypothesis import HealthCheck, settings

from support.checkout import SHARED_DATA
from support.pages.browser import chromium
from support.processor_time import ProcessorTime
from support.programs.forked_programs import end_forkers
from support.programs.shared_fork_server import shared_fork_server
from support.thoroughness import PROFILE, examples
from volsplat.program.many_imports import many_imports

__all__ = ["chromium"]

WORKER_BYTES = 3 << 29  # what one that runs tests takes at the most, with its programs

# The tests themselves run side by side, and start programs; torch's own threads would only wait for each other.
os.environ.setdefault("OMP_NUM_THREADS", "1")
torch.set_num_threads(1)

# Whoever runs the tests may have these ignored (nohup, a shell's background jobs, some services); programs under test
# would inherit that.
signal.signal(signal.SIGHUP, signal.SIG_DFL)
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

settings.register_profile(
    "volsplat",
    deadline=None,
    max_examples=examples(25),
    derandomize="CI" in os.environ,  # a submission is judged by the same cases each time; people search on
    suppress_health_check=[HealthCheck.too_slow],
)
settings.register_profile("thorough", parent=settings.get_profile("volsplat"), derandomize=False)
settings.load_profile(PROFILE)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--processor-time", action="store_true", help="tell what takes how much of the processors")


@pytest.hookimpl(trylast=True)
def pytest_configure(config: pytest.Config) -> None:
    # For each test pytest-rerunfailures writes twice and then reads: TCP would hold the second back for 40 ms.
    counts = getattr(getattr(config, "failures_db", None), "sock", None)
    if counts is not None:
        counts.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    if config.getoption("--processor-time"):
        config.pluginmanager.register(ProcessorTime())


def pytest_xdist_auto_num_workers() -> int | None:
    """Twice as many as there are cores, where memory suffices: half of them wait for a process, a line or a clock."""
    if "PYTEST_XDIST_AUTO_NUM_WORKERS" in os.environ:
        return None
    room = psutil.virtual_memory().available // WORKER_BYTES
    return int(max(1, min(2 * len(os.sched_getaffinity(0)), room)))


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """What is collected stays to the end: to look for garbage in it takes a quarter of this time, and more later."""
    with many_imports():
        return (yield)


@pytest.fixture(scope="session", autouse=True)
def fork_server_for_all() -> Iterator[None]:
    with shared_fork_server():
        yield
    end_forkers()


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real volumes beside the checkout."""
    if not SHARED_DATA.is_dir():
        pytest.skip("the real volumes are not here: no folder shared/data beside the checkout")
    return SHARED_DATA
