"""Prepares a store so slowly that the process can be killed meanwhile. Loads nothing but what it needs for that."""

import time
from multiprocessing.connection import Connection
from pathlib import Path

from volsplat.mapshade_server.prepare import Options, prepare


class _Slow:
    """Hands on each report as a line."""

    def __init__(self, reports: Connection) -> None:
        self._reports = reports

    def note(self, text: str) -> None:
        self._reports.send(text)

    def begin(self, stage: str, total: int) -> None:
        self._reports.send(stage)

    def advance(self, done: int) -> None:
        self._reports.send("+")
        time.sleep(0.02)

    def check_wanted(self) -> None:
        """It is."""


def prepare_slowly(volume: str, out: Path, options: Options, reports: Connection) -> None:
    prepare(volume, out, options, _Slow(reports))
