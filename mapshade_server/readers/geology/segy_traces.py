"""Which trace of a SEG-Y file lies where, by the inline and crossline numbers in the trace headers.

A survey whose traces fill its grid, as most do, is known from the headers at the ends of its lines. Of any other all
trace headers are read.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from volsplat.mapshade_server.readers.reading.extra import library
from volsplat.protocol.text.errors import BadInput

# Where programs put the numbers, other than at 189 and 193; named to a person whose file has a grid there.
OTHER_PLACES = ((9, 21), (5, 21), (9, 13), (17, 13), (17, 21), (181, 185))
SPARSE = 0.05  # share of the grid, below which numbers are no grid's
FEW_DOUBLED = 1.2  # traces a place: more are gathers, and not one trace or another that was written twice
SPOTS_A_SIDE = 9  # traces that stand for the whole survey
ByteOrder = Literal["big", "little"]
Place = tuple[int, int]  # inline, crossline, as indices of the grid


@dataclass(frozen=True)
class Lines:
    """The numbers of inlines or crosslines: `first`, and `count` - 1 more, `step` apart."""

    first: int
    step: int
    count: int

    @property
    def numbers(self) -> NDArray[np.int64]:
        return self.first + self.step * np.arange(self.count, dtype=np.int64)


@dataclass(frozen=True)
class TraceGrid:
    """Which trace lies where: `traces` is shaped (inline, crossline), -1 where there is none.

    `unchecked` is the number that differs from each trace to the next, if not all of its headers were read.
    """

    inlines: Lines
    crosslines: Lines
    traces: NDArray[np.int32]
    unchecked: Literal["inline", "crossline"] | None = None

    @property
    def missing(self) -> int:
        return int(np.count_nonzero(self.traces < 0))


@dataclass(frozen=True)
class SegyFile:
    """A file, and how it is to be read: its byte order, and the first bytes of the numbers in the trace header."""

    path: Path
    order: ByteOrder
    inline: int
    crossline: int

    @contextmanager
    def opened(self, with_lines: bool = False) -> Iterator[Any]:
        """segyio's file, on request with the lines that it finds. Raises BadInput if it cannot be read."""
        segyio = library("segyio", "SEG-Y")
        how = {"strict": False} if with_lines else {"ignore_geometry": True}
        try:
            with segyio.open(self.path, iline=self.inline, xline=self.crossline, endian=self.order, **how) as file:
                yield file
        except (RuntimeError, ValueError, OSError) as error:
            if isinstance(error, OSError) and error.errno:
                raise
            raise BadInput(
                f"{self.path}: cannot be read ({' '.join(str(error).split())}); it is truncated, its headers are wrong "
                "or its traces differ in length"
            ) from None


def trace_grid(source: SegyFile, file: Any) -> TraceGrid:
    """Which trace lies where. Raises BadInput if the traces lie on no grid of inlines and crosslines."""
    if not file.unstructured and min(len(file.ilines), len(file.xlines)) > 1:
        if len(file.offsets) > 1:
            raise _pre_stack(source, f"{len(file.offsets)} traces")
        if regular := _regular_grid(source, file):
            return regular
    every = np.arange(file.tracecount, dtype=np.int32)
    return _spread(source, _numbers(file, source.inline), _numbers(file, source.crossline), every)


def _numbers(file: Any, field: int) -> NDArray[np.int64]:
    """One field of all trace headers."""
    return np.asarray(file.attributes(field)[:], np.int64)


def _regular_grid(source: SegyFile, file: Any) -> TraceGrid | None:
    """The grid of traces in even order, as segyio finds it from the first lines; None if the edges belie it."""
    by_inline = file.sorting == library("segyio", "SEG-Y").TraceSortingFormat.INLINE_SORTING
    inlines, crosslines = np.asarray(file.ilines, np.int64), np.asarray(file.xlines, np.int64)
    order = np.arange(file.tracecount, dtype=np.int32)
    shape = (len(inlines), len(crosslines))
    traces = order.reshape(shape) if by_inline else order.reshape(shape[::-1]).T
    for k, j in _line_ends(shape, by_inline):
        if header_fields(file, traces[k, j], source.inline, source.crossline) != [inlines[k], crosslines[j]]:
            return None
    grid = _spread(source, inlines.repeat(shape[1]), np.tile(crosslines, shape[0]), traces.ravel())
    return replace(grid, unchecked="crossline" if by_inline else "inline")


def _line_ends(shape: tuple[int, int], by_inline: bool) -> list[Place]:
    """Where the lines of a file begin and end, as (inline, crossline) of its grid."""
    lines, traces = shape if by_inline else shape[::-1]
    ends = [(line, end) for line in range(lines) for end in (0, traces - 1)]
    return ends if by_inline else [end[::-1] for end in ends]


def header_fields(file: Any, trace: int, *fields: int) -> list[int]:
    """Some fields of one trace header."""
    header = file.header[int(trace)]
    return [int(header[field]) for field in fields]


def _spread(
    source: SegyFile,
    inlines: NDArray[np.int64],
    crosslines: NDArray[np.int64],
    traces: NDArray[np.int32],
) -> TraceGrid:
    """The traces on the grid of their numbers."""
    rows, columns = _lines(inlines), _lines(crosslines)
    if min(rows.count, columns.count) < 2 or len(traces) < SPARSE * rows.count * columns.count:
        raise _no_grid(source, rows, columns, len(traces))
    cells = (inlines - rows.first) // rows.step * columns.count + (crosslines - columns.first) // columns.step
    spread = np.full(rows.count * columns.count, -1, np.int32)
    spread[cells] = traces
    alone = int(np.count_nonzero(spread >= 0))
    if len(traces) > FEW_DOUBLED * alone:
        raise _pre_stack(source, f"{len(traces) / alone:.3g} traces on average")
    if len(traces) > alone:
        n = int(np.flatnonzero(spread[cells] != traces)[0])
        pair = f"{traces[n]} and {spread[cells[n]]} both at inline {inlines[n]} and crossline {crosslines[n]}"
        raise BadInput(
            f"{source.path}: its {len(traces)} traces lie at {alone} places, as {pair}; remove copies, "
            "or stack the survey if it has gathers"
        )
    return TraceGrid(rows, columns, spread.reshape(rows.count, columns.count))


def _lines(numbers: NDArray[np.int64]) -> Lines:
    """The evenly stepped numbers that include all of `numbers`."""
    different = np.unique(numbers)
    step = int(np.gcd.reduce(np.diff(different))) if len(different) > 1 else 1
    return Lines(int(different[0]), step, int(different[-1] - different[0]) // step + 1)


def _pre_stack(source: SegyFile, count: str) -> BadInput:
    return BadInput(
        f"{source.path}: has {count} at one inline and crossline: pre-stack gathers; volsplat needs a post-stack "
        "survey: stack it, or export one offset"
    )


def _no_grid(source: SegyFile, rows: Lines, columns: Lines, traces: int) -> BadInput:
    """What to say of traces that lie on no grid, with the header bytes that would do."""
    where = f"inlines (byte {source.inline}) and crosslines (byte {source.crossline})"
    if max(rows.count, columns.count) < 2:
        what = f"its {traces} traces have no numbers that differ for {where}"
    elif min(rows.count, columns.count) < 2:
        what = f"a 2-D line, volsplat needs a volume: {traces} traces on {rows.count} x {columns.count} {where}"
    else:
        what = f"{traces} traces are too few for the grid of {rows.count} x {columns.count} {where}"
    for inline, crossline in OTHER_PLACES:
        if (inline, crossline) != (source.inline, source.crossline) and _has_grid(source, inline, crossline):
            return BadInput(
                f"{source.path}: {what}; bytes {inline} and {crossline} look like a grid's: "
                f"give {source.path}#il={inline},xl={crossline}"
            )
    return BadInput(
        f"{source.path}: {what}; if it is a 3-D survey, say where its numbers are, as in {source.path}#il=9,xl=21"
    )


def _has_grid(source: SegyFile, inline: int, crossline: int) -> bool:
    """Whether other header bytes would place each trace on a grid that most of it fills."""
    with source.opened() as file:
        inlines, crosslines = _numbers(file, inline), _numbers(file, crossline)
    rows, columns = _lines(inlines), _lines(crosslines)
    pairs = np.unique(np.stack([inlines, crosslines]), axis=1).shape[1]
    fills = 2 * len(inlines) >= rows.count * columns.count
    return min(rows.count, columns.count) > 1 and pairs == len(inlines) and fills


def sampled(grid: TraceGrid) -> Iterator[Place]:
    """Grid positions of traces spread over the whole survey."""
    for k in _spread_indices(len(grid.traces)):
        there = np.flatnonzero(grid.traces[k] >= 0)
        for n in _spread_indices(len(there)):
            yield k, int(there[n])


def _spread_indices(count: int) -> Sequence[int]:
    return sorted({n * (count - 1) // (SPOTS_A_SIDE - 1) for n in range(SPOTS_A_SIDE)}) if count else []
