"""SEG-Y 3-D post-stack surveys through segyio: i counts samples down a trace, j crosslines, k inlines.

Only the traces of the box are read. Grid positions without a trace become NaN.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from volsplat.mapshade_server.readers.geology.segy_traces import (
    ByteOrder,
    SegyFile,
    TraceGrid,
    header_fields,
    sampled,
    trace_grid,
)
from volsplat.mapshade_server.readers.geology.survey_geometry import DEFAULT_VELOCITY, Spot, Vertical, placed
from volsplat.mapshade_server.readers.reading.extra import library
from volsplat.mapshade_server.readers.reading.opened_file import opened
from volsplat.mapshade_server.readers.reading.part_options import part_options
from volsplat.mapshade_server.readers.reading.volume_reader import OpenedVolume, VolumeFormat, Voxels
from volsplat.protocol.description.kind import Kind
from volsplat.protocol.description.volume import Box, GridAxis, VolumeDescription
from volsplat.protocol.text.errors import BadInput

OPTIONS = ("il", "xl", "velocity", "domain")
INLINE, CROSSLINE = 189, 193  # where revision 1 has the numbers, by their first byte in the trace header

OFFSET_OF_FORMAT, LEAST_BYTES = 3224, 3600 + 240
BYTE_ORDERS: tuple[ByteOrder, ...] = ("big", "little")
SAMPLE_FORMATS = (1, 2, 3, 5, 6, 8, 9, 10, 11, 12, 16)
REFUSED_FORMATS = {4: "fixed point with gain", 7: "24-bit integers", 15: "24-bit integers"}

# Start time; scalar of the coordinates and their unit; the midpoint's x and y; the source's, which older files fill in.
SPOT_FIELDS = (109, 71, 89, 181, 185, 73, 77)
COORDINATE_COLUMNS = ((3, 4), (5, 6))
SAMPLE_INTERVAL = 117
BINARY_INTERVAL, MEASUREMENT_SYSTEM = 3217, 3255
FEET = 2

TRACES_AT_ONCE = 1 << 12


@dataclass(frozen=True)
class _Survey:
    """Reads the traces of one survey."""

    source: SegyFile
    grid: TraceGrid
    scalar_type: str

    def read(self, box: Box) -> Voxels:
        ni, nj, nk = box.size
        k, j, i = box.slices()
        traces = self.grid.traces[k, j].ravel()
        there = np.flatnonzero(traces >= 0)
        rows = there[np.argsort(traces[there])]  # in the file's order
        voxels = np.empty((nk * nj, ni), self.scalar_type)
        if len(rows) < len(traces):
            voxels[traces < 0] = np.nan
        with self.source.opened() as file:
            for part in _runs(traces, rows):
                first, last = int(traces[part[0]]), int(traces[part[-1]])
                self._check_numbers(file, box, first, part)
                for row, samples in zip(part, file.trace[first : last + 1, i], strict=True):
                    voxels[row] = samples
        return voxels.reshape(nk, nj, ni)

    def _check_numbers(self, file: Any, box: Box, first: int, rows: NDArray[np.int64]) -> None:
        """Raises BadInput if traces inside a line are not those that the line's ends let expect."""
        k, j = np.divmod(rows, box.size[1])
        match self.grid.unchecked:
            case "inline":
                field, due = self.source.inline, self.grid.inlines.numbers[box.low[2] + k]
            case "crossline":
                field, due = self.source.crossline, self.grid.crosslines.numbers[box.low[1] + j]
            case None:
                return
        got = file.attributes(field)[first : first + len(rows)]
        if wrong := np.flatnonzero(got != due).tolist():
            n = wrong[0]
            raise BadInput(
                f"{self.source.path}: trace {first + n} says {self.grid.unchecked} {got[n]} where the order of the "
                f"others lets expect {due[n]}; sort the survey by inline and crossline and export it again"
            )


def _runs(traces: NDArray[np.int32], rows: NDArray[np.int64]) -> Iterator[NDArray[np.int64]]:
    """The rows in pieces whose traces follow each other in the file, none too long."""
    breaks = np.flatnonzero(np.diff(traces[rows]) != 1) + 1
    for run in np.split(rows, breaks):
        for start in range(0, len(run), TRACES_AT_ONCE):
            yield run[start : start + TRACES_AT_ONCE]


def open_segy(path: Path, part: str) -> OpenedVolume:
    """The reader for a 3-D survey; `part` may say il=9,xl=21 (header bytes), domain=depth, velocity=2500 (m/s).

    Raises BadInput for 2-D lines, for pre-stack gathers and if the headers cannot be used.
    """
    said = _options(path, part)
    source = SegyFile(path, _byte_order(path), said.inline, said.crossline)
    with source.opened(with_lines=True) as file:
        if not len(file.samples):
            raise BadInput(f"{path}: its binary header states traces of no samples; correct bytes 3221 and 3222")
        grid = trace_grid(source, file)
        spots, units, nowhere = _spots(path, file, grid)
        interval, notes = _interval(path, file)
        start, samples = float(file.samples[0]), len(file.samples)
        in_feet = file.bin[MEASUREMENT_SYSTEM] == FEET
        stored = np.dtype(file.dtype)
    vertical = Vertical(start, interval, said.in_depth, said.velocity)
    inlines, crosslines = grid.inlines, grid.crosslines
    place = placed(path, (samples, crosslines.count, inlines.count), spots, units, vertical, in_feet)
    if nowhere:
        looked = len(spots) + nowhere
        notes.append(f"{nowhere} of {looked} traces looked at have no coordinates: the survey lies by the others")
    if grid.missing:
        notes.append(f"{grid.missing} of {grid.traces.size} traces of the grid are not in the file and hold no data")
    description = VolumeDescription(
        name=path.name,
        format=f"SEG-Y ({source.order} endian)",
        geometry=place.geometry,
        scalar_type=np.result_type(stored, np.float32).name if grid.missing else stored.name,
        unit=place.unit,
        axes=(
            place.axis,
            GridAxis("crossline", "", crosslines.first, crosslines.step),
            GridAxis("inline", "", inlines.first, inlines.step),
        ),
        warnings=(*place.warnings, *notes),
        kind=Kind.SEISMIC,
        chunk=(place.geometry.dims[0], 1, 1),
        kind_from="its format",
        density_name="amplitude",
        up="+z",  # time and depth grow downwards
    )
    return OpenedVolume(description, _Survey(source, grid, description.scalar_type).read, parts=())


@dataclass(frozen=True)
class _Options:
    inline: int
    crossline: int
    in_depth: bool
    velocity: float | None


def _options(path: Path, part: str) -> _Options:
    word, values = part_options(part, OPTIONS)
    example = f"as in {path}#il=9,xl=21"
    if word:
        raise BadInput(f"{path}: holds one survey, it has no part “{word}”; header bytes are chosen {example}")
    places = []
    for key, usual in (("il", INLINE), ("xl", CROSSLINE)):
        said = values.get(key, str(usual))
        if said not in map(str, _field_places()):
            raise BadInput(
                f"{path}: “{key}={said}” is no byte where a field of the trace header starts; say it {example}"
            )
        places.append(int(said))
    if (domain := values.get("domain", "time")) not in ("time", "depth"):
        raise BadInput(f"{path}: “domain={domain}” is neither time nor depth")
    velocity = None
    if "velocity" in values:
        try:
            velocity = float(values["velocity"])
        except ValueError:
            velocity = math.nan
        if not 0 < velocity < math.inf or domain == "depth":
            raise BadInput(
                f"{path}: “velocity={values['velocity']}” is no velocity in m/s that turns time into depth; "
                f"it is {DEFAULT_VELOCITY:g} where none is given"
            )
    return _Options(places[0], places[1], domain == "depth", velocity)


def _field_places() -> set[int]:
    """The first bytes of the trace header's fields."""
    return {int(field) for field in library("segyio", "SEG-Y").TraceField.enums()}


def _byte_order(path: Path) -> ByteOrder:
    """By the code of the sample format, which is a small number in the right order alone."""
    with opened(path) as file:
        head = file.read(LEAST_BYTES)
    if len(head) < LEAST_BYTES:
        raise BadInput(f"{path}: is too short for a SEG-Y file with a trace; fetch or export it again")
    for order in BYTE_ORDERS:
        code = int.from_bytes(head[OFFSET_OF_FORMAT : OFFSET_OF_FORMAT + 2], order)
        if code in REFUSED_FORMATS:
            raise BadInput(
                f"{path}: its samples are {REFUSED_FORMATS[code]} (format {code}), which volsplat does not read; "
                "export it as IBM or IEEE floats"
            )
        if code in SAMPLE_FORMATS:
            return order
    raise BadInput(f"{path}: its binary header states no format of samples; it is no SEG-Y file or a damaged one")


def _spots(path: Path, file: Any, grid: TraceGrid) -> tuple[list[Spot], int, int]:
    """Where some traces lie on the map, by the first coordinates that are filled in, and the code of their unit.

    At 0, 0 lies none, since dead traces often have no others: how many of these there are, if there are spots.
    Raises BadInput if the traces do not begin together, which a grid cannot hold.
    """
    places = list(sampled(grid))
    headers = [header_fields(file, grid.traces[place], *SPOT_FIELDS) for place in places]
    times = [header[0] for header in headers]
    if min(times) != max(times):
        raise BadInput(
            f"{path}: its traces begin at different times, {min(times)} to {max(times)} ms; "
            "export them with one start time"
        )
    for x, y in COORDINATE_COLUMNS:
        filled = [(place, header) for place, header in zip(places, headers, strict=True) if header[x] or header[y]]
        if filled:
            spots = [
                Spot(j, k, _scaled(header[x], header[1]), _scaled(header[y], header[1])) for (k, j), header in filled
            ]
            return spots, filled[0][1][2], len(places) - len(spots)
    return [], 0, 0


def _scaled(coordinate: int, scalar: int) -> float:
    """A negative scalar divides, a positive one multiplies."""
    return coordinate / -scalar if scalar < 0 else float(coordinate * (scalar or 1))


def _interval(path: Path, file: Any) -> tuple[float, list[str]]:
    """The distance of samples in ms (or in thousandths of what a depth counts), and a note if headers disagree."""
    stated = file.bin[BINARY_INTERVAL] & 0xFFFF
    of_trace = file.header[0][SAMPLE_INTERVAL] & 0xFFFF
    if not (stated or of_trace):
        raise BadInput(f"{path}: its headers state a sample interval of 0; correct bytes 3217 and 3218 of the file")
    notes = []
    if stated and of_trace and stated != of_trace:
        notes.append(f"the binary header's sample interval of {stated} µs is used, the first trace says {of_trace} µs")
    return (stated or of_trace) / 1000, notes


FORMATS = (VolumeFormat("SEG-Y survey (.sgy, .segy)", open_segy, extensions=(".sgy", ".segy"), parts=False),)
