"""A Dask cluster of a test's own: a scheduler and workers, each a process of this machine, or on a host in a box."""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import psutil

from support.patience import PATIENCE, wait_until
from volsplat.bench.hosts.namespaces import Host

LOOPBACK = Host("127.0.0.1", None, "lo", "")


class DaskCluster:
    def __init__(self, folder: Path, host: Host = LOOPBACK) -> None:
        """The scheduler runs on `host`."""
        self.folder = folder
        self.scheduler_file = folder / "scheduler.json"
        self._processes: list[subprocess.Popen[bytes]] = []
        self.scheduler = self._start(host, "scheduler", "--port", "0", "--no-dashboard", "--no-show")
        wait_until(self.scheduler_file.is_file, "written by the scheduler")

    def worker(self, *options: str, host: Host = LOOPBACK) -> psutil.Process:
        """One more, of one thread, which is not started anew."""
        place = ("--local-directory", str(self.folder), "--no-dashboard")
        return self._start(host, "worker", "--no-nanny", "--nthreads", "1", *place, *options)

    def close(self) -> None:
        for process in reversed(self._processes):
            process.kill()
            process.wait(PATIENCE)

    def _start(self, host: Host, what: str, *options: str) -> psutil.Process:
        command = [*host.inside, sys.executable, "-m", "dask", what, "--host", host.address]
        words = [*command, "--scheduler-file", str(self.scheduler_file), *options]
        with (self.folder / f"{what}-{len(self._processes)}.log").open("wb") as log:
            process = subprocess.Popen(words, stdin=subprocess.DEVNULL, stdout=log, stderr=log)
        self._processes.append(process)
        return psutil.Process(process.pid)

    @property
    def said(self) -> str:
        """What scheduler and workers have logged."""
        return "".join(log.read_text(encoding="utf-8", errors="replace") for log in self.folder.glob("*.log"))


@contextmanager
def dask_cluster(folder: Path, host: Host = LOOPBACK) -> Iterator[DaskCluster]:
    cluster = DaskCluster(folder, host)
    try:
        yield cluster
    finally:
        cluster.close()
