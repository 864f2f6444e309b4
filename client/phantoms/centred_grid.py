"""The grid of a phantom: axes along the physical axes, the physical origin in its middle."""

from collections.abc import Iterator

import torch

from volsplat.protocol.matrices import Vector
from volsplat.protocol.volume import Geometry, Index

SLAB_VOXELS = 1 << 17  # worked on at a time, so that a phantom's making takes little more memory than itself


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


def slabs(geometry: Geometry) -> Iterator[tuple[slice, torch.Tensor, torch.Tensor, torch.Tensor]]:
    """Ranges of k with the positions x (1, 1, i), y (1, j, 1), z (k, 1, 1) of their voxels."""
    x = axis_positions(geometry, 0)[None, None, :]
    y = axis_positions(geometry, 1)[None, :, None]
    z = axis_positions(geometry, 2)[:, None, None]
    ni, nj, nk = geometry.dims
    sheets = max(1, SLAB_VOXELS // (ni * nj))
    for low in range(0, nk, sheets):
        part = slice(low, min(low + sheets, nk))
        yield part, x, y, z[part]


class SheetNoise:
    """Normal noise that depends on the seed and the voxel only, not on how many sheets are asked for at once."""

    def __init__(self, seed: int, deviation: float) -> None:
        self._generator = torch.Generator().manual_seed(seed)
        self._deviation = deviation

    def next(self, sheets: int, nj: int, ni: int) -> torch.Tensor:
        """The next sheets, float32 (sheets, nj, ni)."""
        drawn = [torch.randn((nj, ni), generator=self._generator) for _ in range(sheets)]
        return torch.stack(drawn) * self._deviation
