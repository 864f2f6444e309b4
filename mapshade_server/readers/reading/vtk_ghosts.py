"""What VTK's files, of any of its formats, say of points and cells that are hidden: these are no data."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from volsplat.mapshade_server.readers.reading.volume_reader import Voxels

GHOSTS = "vtkGhostType"  # an array of each point or cell: whether it is hidden, and what else it is
GHOST_TYPE = "uint8"
HIDDEN_POINT, HIDDEN_CELL = 2, 32  # bits of VTK's vtkDataSetAttributes


def type_without_hidden(scalar_type: str) -> str:
    """The type for values of which some are hidden."""
    return np.result_type(scalar_type, np.float32).name


def without_hidden(values: Voxels, ghosts: NDArray[Any], of_cells: bool) -> Voxels:
    """The values, NaN where they are hidden."""
    found: Voxels = values.astype(type_without_hidden(values.dtype.name))
    found[ghosts & (HIDDEN_CELL if of_cells else HIDDEN_POINT) != 0] = np.nan
    return found
