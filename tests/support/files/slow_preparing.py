"""Prepares a small store so slowly that the process can be killed meanwhile, and prints each report as a line on
stderr.

Run as `python -m support.files.slow_preparing VOLUME OUT.zarr`.
"""

import sys
import time
from pathlib import Path

from volsplat.mapshade_server.prepare import Options, prepare
from volsplat.mapshade_server.prepare.layout import PROGRAM_BYTES, Layout

SMALL = Layout(brick=8, shard=16, coarsest=8**3)
LITTLE = Options(layout=SMALL, memory=PROGRAM_BYTES + 232 * 1024)  # a shard at a time


class _Slow:
    def note(self, text: str) -> None:
        print(text, file=sys.stderr)

    def begin(self, stage: str, total: int) -> None:
        print(stage, file=sys.stderr)

    def advance(self, done: int) -> None:
        print("+", file=sys.stderr)
        time.sleep(0.02)

    def check_wanted(self) -> None:
        """It is."""


if __name__ == "__main__":
    prepare(sys.argv[1], Path(sys.argv[2]), LITTLE, _Slow())
