"""What VTK's files, of any of its formats, say of points and cells that are hidden: these are no data."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from volsplat.mapshade_server.readers.reading.volume_reader import ReadBox, Voxels
from volsplat.protocol.description.volume import Box, Index

GHOSTS = "vtkGhostType"  # an array of each point or cell: whether it is hidden, and what else it is
GHOST_TYPE = "uint8"
HIDDEN_POINT, HIDDEN_CELL = 2, 32  # bits of VTK's vtkDataSetAttributes
SEARCHED_AT_ONCE = 1 << 24  # bytes

Reader = Callable[[Index], ReadBox]
ReadHidden = Callable[[Box], NDArray[np.bool_]]


@dataclass(frozen=True)
class Ghosts:
    """What gives the readers of the arrays that tell of points and of cells, None where there is none."""

    points: Reader | None = None
    cells: Reader | None = None
    reads_whole: bool = False  # whether any box costs as much as all

    def shown(self, scalar_type: str, read: ReadBox, dims: Index, of_cells: bool) -> tuple[str, ReadBox]:
        """The type of a grid's values, and what reads them: NaN where they are hidden.

        Whole numbers become wider for it only if some are hidden, for which the arrays are searched.
        """
        wider = np.result_type(scalar_type, np.float32).name
        hidden = self._cells(dims) if of_cells else self._points(dims)
        if wider != scalar_type:
            hidden = [one for one in hidden if _any(one, dims, self.reads_whole)]
        if not hidden:
            return scalar_type, read

        def shown(box: Box) -> Voxels:
            values: Voxels = read(box).astype(wider)
            for one in hidden:
                values[one(box)] = np.nan
            return values

        return wider, shown

    def _cells(self, dims: Index) -> list[ReadHidden]:
        return [_with_bit(self.cells(dims), HIDDEN_CELL)] if self.cells else []

    def _points(self, dims: Index) -> list[ReadHidden]:
        """A point is hidden by its own array, or by all cells around it."""
        ni, nj, nk = dims
        cells = (max(ni - 1, 1), max(nj - 1, 1), max(nk - 1, 1))
        own = [_with_bit(self.points(dims), HIDDEN_POINT)] if self.points else []
        return own + [_around(one, cells) for one in self._cells(cells)]


def _with_bit(read: ReadBox, bit: int) -> ReadHidden:
    return lambda box: read(box) & bit != 0


def _around(cells: ReadHidden, dims: Index) -> ReadHidden:
    """What tells which points have hidden cells on all sides; there are `dims` cells."""

    def hidden(box: Box) -> NDArray[np.bool_]:
        low = (max(box.low[0] - 1, 0), max(box.low[1] - 1, 0), max(box.low[2] - 1, 0))
        high = (min(box.high[0], dims[0]), min(box.high[1], dims[1]), min(box.high[2], dims[2]))
        beyond = [
            (1 - at + first, end - last) for at, first, end, last in zip(box.low, low, box.high, high, strict=True)
        ]
        every = np.pad(cells(Box(low, high)), beyond[::-1], constant_values=True)
        every = every[1:] & every[:-1]
        every = every[:, 1:] & every[:, :-1]
        return every[:, :, 1:] & every[:, :, :-1]

    return hidden


def _any(hidden: ReadHidden, dims: Index, at_once: bool) -> bool:
    ni, nj, nk = dims
    sheets = nk if at_once else max(SEARCHED_AT_ONCE // (ni * nj), 1)
    return any(hidden(Box((0, 0, k), (ni, nj, min(k + sheets, nk)))).any() for k in range(0, nk, sheets))
