"""The grid of a phantom: axes along the physical axes, the physical origin in its middle."""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import torch

from volsplat.protocol.description.kind import Band, Kind
from volsplat.protocol.description.volume import Geometry, Index
from volsplat.protocol.geometry.matrices import Vector

VOXELS_AT_ONCE = 1 << 17  # worked on at a time, so that a phantom's making takes little more memory than itself


class Phantom(NamedTuple):
    """A phantom in the making: its voxels come some sheets at a time, once."""

    geometry: Geometry
    dtype: torch.dtype
    sheets: Iterator[torch.Tensor]  # consecutive ones, shaped (k, j, i)
    kind: Kind = Kind.UNKNOWN
    bands: tuple[Band, ...] = ()  # where its values are classes
    unit: str = ""  # of lengths, if they have one
    anatomical: bool = False  # physical axes are left, posterior, superior

    def whole(self) -> tuple[torch.Tensor, Geometry]:
        """All voxels, shaped (k, j, i), and their place."""
        values = torch.empty(self.geometry.dims[::-1], dtype=self.dtype)
        made = 0
        for sheets in self.sheets:
            values[made : made + len(sheets)] = sheets
            made += len(sheets)
        return values, self.geometry


def at_once(make: Callable[[], torch.Tensor]) -> Iterator[torch.Tensor]:
    """The sheets of a phantom that is made whole, when it is asked for."""
    yield make()


def centred_geometry(size: Index, spacing: Vector) -> Geometry:
    (ni, nj, nk), (di, dj, dk) = size, spacing
    return Geometry(
        dims=size,
        index_to_physical=((di, 0.0, 0.0), (0.0, dj, 0.0), (0.0, 0.0, dk)),
        origin=(-(ni - 1) / 2 * di, -(nj - 1) / 2 * dj, -(nk - 1) / 2 * dk),
    )


def placed_grid(size: Index, spacing: Vector | None, field: Vector) -> tuple[Geometry, float]:
    """A grid for something that needs the lengths `field`, and the factor by which it must grow to fill that grid.

    Without a spacing voxels are cubes, as large as is needed, and the factor is 1.
    """
    if spacing is None:
        step = max(length / count for length, count in zip(field, size, strict=True))
        spacing = (step, step, step)
    scale = min(count * step / length for count, step, length in zip(size, spacing, field, strict=True))
    return centred_geometry(size, spacing), scale


def axis_positions(geometry: Geometry, axis: int) -> torch.Tensor:
    """Physical positions along one axis, float32 (dims[axis],)."""
    steps = torch.arange(geometry.dims[axis], dtype=torch.float64) * geometry.index_to_physical[axis][axis]
    return (steps + geometry.origin[axis]).to(torch.float32)


def sheet_positions(geometry: Geometry) -> Iterator[tuple[torch.Tensor, torch.Tensor, torch.Tensor]]:
    """The positions x (1, 1, i), y (1, j, 1), z (k, 1, 1) of the voxels of consecutive ranges of k."""
    x = axis_positions(geometry, 0)[None, None, :]
    y = axis_positions(geometry, 1)[None, :, None]
    z = axis_positions(geometry, 2)[:, None, None]
    ni, nj, nk = geometry.dims
    sheets = max(1, VOXELS_AT_ONCE // (ni * nj))
    for low in range(0, nk, sheets):
        yield x, y, z[low : low + sheets]


class SheetNoise:
    """Normal noise that depends on the seed and the voxel only, not on how many sheets are asked for at once."""

    def __init__(self, seed: int, deviation: float) -> None:
        self._generator = torch.Generator().manual_seed(seed)
        self._deviation = deviation

    def next(self, sheets: int, nj: int, ni: int) -> torch.Tensor:
        """The next sheets, float32 (sheets, nj, ni)."""
        drawn = [torch.randn((nj, ni), generator=self._generator) for _ in range(sheets)]
        return torch.stack(drawn) * self._deviation
