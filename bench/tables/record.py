"""What a benchmark leaves behind: one JSON file of figures, each with its spread, so that any two can be compared."""

import statistics
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path

import msgspec

from volsplat.client.files.whole_file import whole_file
from volsplat.program.this_machine import this_machine
from volsplat.protocol.description.machine import Machine
from volsplat.protocol.text.errors import BadInput


class Figure(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A measured quantity: the median of its samples and the bounds of their middle half."""

    name: str
    unit: str
    median: float
    low: float
    high: float
    samples: tuple[float, ...]
    setting: str = ""  # what was drawn, and by how many map/shade servers, where both can be other ones
    servers: int | None = None


class Record(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """All figures of one run. `facts` say in words what was measured."""

    command: str
    volsplat: str  # version
    machine: Machine
    facts: dict[str, str]
    figures: tuple[Figure, ...]


def figure(name: str, unit: str, samples: Sequence[float], setting: str = "", servers: int | None = None) -> Figure:
    """The figure of one or more samples."""
    low, high = samples[0], samples[0]
    if len(samples) > 1:
        low, _, high = statistics.quantiles(samples, n=4, method="inclusive")
    return Figure(name, unit, statistics.median(samples), low, high, tuple(samples), setting, servers)


def record(command: str, facts: dict[str, str], figures: Sequence[Figure]) -> Record:
    """A record of this machine and this version."""
    return Record(command, version("volsplat"), this_machine(), facts, tuple(figures))


def write_record(path: Path, written: Record) -> None:
    """Write as JSON, whole or not at all. Raises BadInput if the file cannot be written."""
    write_text(path, msgspec.json.format(msgspec.json.encode(written), indent=2).decode() + "\n")


def read_record(path: Path) -> Record:
    """Read what write_record wrote. Raises BadInput."""
    try:
        return msgspec.json.decode(path.read_bytes(), type=Record)
    except OSError as error:
        raise BadInput(f"{path}: cannot read the record: {error.strerror}") from error
    except (msgspec.MsgspecError, UnicodeDecodeError) as error:
        raise BadInput(f"{path}: is no record that `volsplat bench … --json` wrote: {error}") from error


def write_text(path: Path, text: str) -> None:
    """Write a file whole or not at all. Raises BadInput."""
    with whole_file(path, "cannot write this file") as file:
        file.write(text.encode())
