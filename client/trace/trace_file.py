"""A trace as a file: the JSON of Chrome's Trace Event Format, which chrome://tracing and Perfetto load.

Spans are complete events ("X") in microseconds. What was written before a process was killed can still be loaded: in
this format the array's end may be missing.
"""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import msgspec

from volsplat.client.files.whole_file import is_stream
from volsplat.program.temporary_name import behind_links
from volsplat.protocol.messages.trace_messages import Span
from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.text.open_streams import to_open


class TraceFile:
    """One thread at a time may write."""

    def __init__(self, path: Path) -> None:
        """Raises BadInput if it cannot be written."""
        self._path = path
        self._rows: dict[tuple[int, str], int] = {}
        self._names: dict[int, str] = {}
        self._separator = b"\n"  # before the next event
        self._tells = False  # of any span, so that it is worth keeping
        try:
            # Nothing is lost with the process, and failures are told at once.
            self._file = open(to_open(path), "wb", buffering=0)
        except OSError as error:
            raise self._unwritable(error) from error
        self._write(b"[")

    def name(self, process: int, name: str) -> None:
        """What a process is called from now on."""
        if self._names.get(process) != name:
            self._names[process] = name
            self._write_events([_metadata("process_name", process, 0, name=name)])

    def add(self, process: int, frame: int, spans: Iterable[Span], offset: float) -> None:
        """What a process did for a frame; `offset` is added to its seconds. Raises BadInput, as all that writes."""
        self._write_events([event for span in spans for event in self._events(process, frame, span, offset)])
        self._tells = True

    def close(self) -> None:
        """May be called again."""
        if not self._file.closed:
            self._write(b"\n]\n")
            self._file.close()

    def _events(self, process: int, frame: int, span: Span, offset: float) -> Iterable[dict[str, Any]]:
        if (row := self._rows.get((process, span.row))) is None:
            row = self._rows[process, span.row] = len(self._rows) + 1
            yield _metadata("thread_name", process, row, name=span.row)
            yield _metadata("thread_sort_index", process, row, sort_index=row)
        # From one rounded moment to another: else an inner span could outlast the one that it lies in
        began, ended = (round((moment + offset) * 1e9) for moment in (span.began, span.ended))
        yield {
            "ph": "X",
            "name": span.name,
            "pid": process,
            "tid": row,
            "ts": began / 1000,
            "dur": (ended - began) / 1000,
            "args": {"frame": frame},
        }

    def _write_events(self, events: Iterable[dict[str, Any]]) -> None:
        if text := b",\n".join(map(msgspec.json.encode, events)):
            self._write(self._separator + text)
            self._separator = b",\n"

    def _write(self, text: bytes) -> None:
        """Raises BadInput, and writes nothing from then on."""
        left = memoryview(text if not self._file.closed else b"")
        try:
            while left:
                left = left[self._file.write(left) :]
        except OSError as error:
            self._file.close()
            if not self._tells and not is_stream(self._path):
                behind_links(self._path).unlink(missing_ok=True)
            raise self._unwritable(error) from error

    def _unwritable(self, error: OSError) -> BadInput:
        return BadInput(f"{self._path}: cannot write the trace: {error.strerror}; name another file")


def _metadata(kind: str, process: int, row: int, **told: object) -> dict[str, Any]:
    return {"ph": "M", "name": kind, "pid": process, "tid": row, "args": told}
