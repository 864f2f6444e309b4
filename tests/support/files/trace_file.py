"""Reads a trace file, as viewers of traces do."""

import json
import re
from collections import defaultdict
from pathlib import Path
from typing import Any

Event = dict[str, Any]


class Trace:
    """A trace file, by process and row."""

    def __init__(self, path: Path) -> None:
        events = json.loads(path.read_bytes())
        told = [event for event in events if event["ph"] == "M"]
        self.names = {event["pid"]: event["args"]["name"] for event in told if event["name"] == "process_name"}
        row_names = {
            (event["pid"], event["tid"]): event["args"]["name"] for event in told if event["name"] == "thread_name"
        }
        self.rows: defaultdict[tuple[str, str], list[Event]] = defaultdict(list)
        for event in events:
            if event["ph"] == "X":
                self.rows[self.names[event["pid"]], row_names[event["pid"], event["tid"]]].append(event)

    def of(self, process: str, row: str, frame: int) -> list[Event]:
        """The spans of a process's rows that begin so."""
        return [
            span
            for (named, at), spans in self.rows.items()
            for span in spans
            if named.startswith(process) and at.startswith(row) and span["args"]["frame"] == frame
        ]

    def error(self, process: str) -> float:
        """What the clocks of processes whose names begin so may be off at most, in microseconds."""
        stated = [re.search(r"clock ± (\d+) µs", name) for name in self.names.values() if name.startswith(process)]
        return max(float(error[1]) for error in stated if error is not None)
