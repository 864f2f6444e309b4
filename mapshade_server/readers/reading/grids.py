"""What every format asks of a grid: three axes, one number a voxel, and a place in space that its axes span."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.geometry import matrices
from volsplat.protocol.geometry.matrices import Vector
from volsplat.protocol.text.errors import BadInput

EVEN = 1e-3  # of a step, that others may differ from it
PALETTE_LEFT_OUT = "its palette of colours is left out: values are the numbers that it gives colours to"
ROUNDING = 4  # units in the last place of the file's own numbers
ORIGIN: Vector = (0.0, 0.0, 0.0)


def refuse_other_dimensions(path: Path, size: tuple[int, ...]) -> None:
    """Raises BadInput unless `size` is that of one volume: three axes, and more only if they are 1 long."""
    shown = " x ".join(str(n) for n in size)
    if len(size) < 3:
        kind = "a 1-D list" if len(size) == 1 else "a 2-D image"
        raise BadInput(f"{path}: {kind}, volsplat needs a volume: its size is {shown}; give a file with several slices")
    if max(size[3:], default=1) > 1:
        raise BadInput(f"{path}: a series of {shown} voxels, volsplat needs one volume; export one frame of it")


def refuse_vectors(path: Path, what: str) -> None:
    raise BadInput(f"{path}: has {what}, volsplat needs one number a voxel; export one component or its magnitude")


def checked_geometry(path: Path, dims: tuple[int, ...], matrix: Any, origin: Any = ORIGIN) -> Geometry:
    """The Geometry of a header's values: `matrix` has rows of three numbers, or only the steps along x, y and z.

    Raises BadInput if they span no space.
    """
    try:
        return geometry(dims, matrix, origin)
    except ValueError as error:
        raise BadInput(f"{path}: its spacing and directions cannot be used: {error}; correct the header") from None


def geometry(dims: tuple[int, ...], matrix: Any, origin: Any) -> Geometry:
    """Likewise, but raises ValueError."""
    stated = np.asarray(matrix, np.float64) + 0.0  # which turns -0.0 into 0.0
    rows = np.diag(stated) if stated.ndim == 1 else stated
    place = np.asarray(origin, np.float64) + 0.0
    if not np.isfinite(place).all():
        raise ValueError("the origin is not finite")
    (i, j, k), (x, y, z) = rows.tolist(), place.tolist()
    return Geometry(
        dims=(dims[0], dims[1], dims[2]), index_to_physical=(tuple(i), tuple(j), tuple(k)), origin=(x, y, z)
    )


def grid_of_cells(path: Path, points: Geometry) -> Geometry:
    """The grid of the cells between points, as VTK's files have them: one fewer along each axis, at their middles.

    Along an axis of one point the cells are flat and lie on it.
    """
    first = matrices.scaled(tuple(min(n - 1, 1) for n in points.dims), 0.5)  # type: ignore[arg-type]
    dims = tuple(max(n - 1, 1) for n in points.dims)
    return checked_geometry(path, dims, points.index_to_physical, points.physical(first))


class Unevenness(NamedTuple):
    """The least and the greatest step between places that should lie evenly, by their size."""

    least: float
    greatest: float


def unevenness(stated: NDArray[Any]) -> Unevenness | None:
    """How places along an axis lie apart, None if that is even: within a thousandth of a step and their rounding."""
    places = stated.astype(np.float64)
    steps = np.diff(places)
    step = float(places[-1] - places[0]) / max(len(steps), 1)
    rounding = ROUNDING * float(np.finfo(stated.dtype).eps) * np.abs(places).max() if stated.dtype.kind == "f" else 0.0
    if np.abs(steps - step).max(initial=0.0) <= EVEN * abs(step) + rounding:
        return None
    return Unevenness(*sorted((float(steps.min()), float(steps.max())), key=abs))
