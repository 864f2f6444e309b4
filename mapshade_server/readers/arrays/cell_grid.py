"""Values of cells instead of points, as VTK's files have them: one fewer along each axis, at the cells' middles."""

from pathlib import Path

from volsplat.mapshade_server.readers.reading.simple_itk import checked_geometry
from volsplat.protocol.description.volume import Geometry


def grid_of_cells(path: Path, points: Geometry) -> Geometry:
    """The grid of the cells between these points; along an axis of one point the cells are flat and lie on it."""
    ni, nj, nk = points.dims
    first = (0.5 if ni > 1 else 0.0, 0.5 if nj > 1 else 0.0, 0.5 if nk > 1 else 0.0)
    dims = (max(ni - 1, 1), max(nj - 1, 1), max(nk - 1, 1))
    return checked_geometry(path, dims, points.index_to_physical, points.physical(first))
