"""Densities at any place between voxels, in float64: known signals, and voxels joined by a cubic spline.

Places are grid coordinates i, j, k; densities are in the data's own units.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor

from volsplat.client.phantoms.known_signals import (
    MARSCHNER_LOBB_ALPHA,
    MARSCHNER_LOBB_FREQUENCY,
    marschner_lobb_signal,
)
from volsplat.protocol.description.volume import Geometry

CHUNK = 1 << 13  # places at a time, so that the weights around them stay in the cache
TAPS = 4  # of a cubic spline on each axis
MARGIN = 3  # taps beyond the outermost voxels that places there depend on
NEAR = 3  # taps to either side of a place that the spline half a voxel away can depend on


class DensityField(Protocol):
    def density(self, places: Tensor) -> Tensor:
        """(n,) at places (n, 3)."""

    def gradient(self, places: Tensor) -> Tensor:
        """(n, 3), per index step."""

    def bounds(self, places: Tensor) -> tuple[Tensor, Tensor]:
        """No density within half a voxel on every axis is below the first or above the second: (n,) each."""


@dataclass(frozen=True)
class KnownSignal:
    """A function of physical position with its greatest slope; the gradient is torch's own derivative."""

    signal: Callable[[Tensor, Tensor, Tensor], Tensor]
    steepest: float  # per unit of length
    geometry: Geometry  # upright

    def density(self, places: Tensor) -> Tensor:
        return self.signal(*self._positions(places).unbind(-1))

    def gradient(self, places: Tensor) -> Tensor:
        with torch.enable_grad():
            followed = places.detach().clone().requires_grad_()
            (slope,) = torch.autograd.grad(self.density(followed).sum(), followed)
        return slope

    def bounds(self, places: Tensor) -> tuple[Tensor, Tensor]:
        middle = self.density(places)
        change = self.steepest * math.hypot(*self.geometry.spacing) / 2
        return middle - change, middle + change

    def _positions(self, places: Tensor) -> Tensor:
        return places * _vector(self.geometry.spacing) + _vector(self.geometry.origin)


def marschner_lobb_field(geometry: Geometry) -> KnownSignal:
    ripple = 2 * math.pi * MARSCHNER_LOBB_FREQUENCY * math.pi / 2 * MARSCHNER_LOBB_ALPHA
    return KnownSignal(
        marschner_lobb_signal, math.hypot(ripple, math.pi / 2) / (2 * (1 + MARSCHNER_LOBB_ALPHA)), geometry
    )


def ball_field(geometry: Geometry, radius: float, edge: float) -> KnownSignal:
    """1 inside and 0 outside, with a smooth edge about so wide; lengths in voxels of a cubic grid."""
    step = geometry.reference_spacing

    def signal(x: Tensor, y: Tensor, z: Tensor) -> Tensor:
        distance = torch.sqrt(x * x + y * y + z * z + 1e-12) / step
        return torch.sigmoid(4 * (radius - distance) / edge)

    return KnownSignal(signal, 1 / (edge * step), geometry)


class SplineField:
    """The cubic B-spline through all voxels (k, j, i), mirrored at the outermost ones."""

    def __init__(self, values: Tensor) -> None:
        taps = values.double()
        for axis in range(3):
            taps = _prefiltered(taps, axis)
        self._dims = values.shape[::-1]
        self._low, self._high = (-_greatest_near(-taps), _greatest_near(taps))
        for axis in range(3):
            count = taps.shape[axis]
            taps = taps.index_select(axis, _mirrored(torch.arange(-MARGIN, count + MARGIN), count))
        nk, nj, ni = taps.shape
        self._padded = taps.flatten()
        self._strides = torch.tensor((1, ni, nj * ni))
        self._last_corner = torch.tensor((ni, nj, nk)) - TAPS
        k, j, i = torch.meshgrid(*(torch.arange(TAPS),) * 3, indexing="ij")
        self._offsets = ((k * nj + j) * ni + i).flatten()

    def density(self, places: Tensor) -> Tensor:
        return torch.cat([self._sums(part, derivative=None) for part in _parts(places)])

    def gradient(self, places: Tensor) -> Tensor:
        return torch.cat(
            [torch.stack([self._sums(part, axis) for axis in range(3)], dim=-1) for part in _parts(places)]
        )

    def bounds(self, places: Tensor) -> tuple[Tensor, Tensor]:
        i, j, k = (
            nearest.clamp(0, count - 1)
            for nearest, count in zip((places + 0.5).floor().long().unbind(-1), self._dims, strict=True)
        )
        return self._low[k, j, i], self._high[k, j, i]

    def _sums(self, places: Tensor, derivative: int | None) -> Tensor:
        first = places.floor()
        off = places - first
        corner = (first.long() + MARGIN - 1).clamp(torch.zeros(3, dtype=torch.int64), self._last_corner)
        around = self._padded[(corner @ self._strides)[:, None] + self._offsets].reshape(-1, TAPS * TAPS, TAPS)
        for axis in range(3):
            weight = (_slopes if axis == derivative else _weights)(off[:, axis])
            summed = torch.bmm(around, weight[..., None])
            around = summed.reshape(len(places), *((TAPS, TAPS) if axis == 0 else (1, TAPS) if axis == 1 else ()))
        return around


def _vector(numbers: tuple[float, float, float]) -> Tensor:
    return torch.tensor(numbers, dtype=torch.float64)


def _parts(places: Tensor) -> Iterator[Tensor]:
    return (places[low : low + CHUNK] for low in range(0, max(len(places), 1), CHUNK))


def _prefiltered(values: Tensor, axis: int) -> Tensor:
    """The weights of the B-splines on this axis with which their sums at the voxels are `values`."""
    count = values.shape[axis]
    sums = torch.zeros((count, count), dtype=torch.float64)
    voxel = torch.arange(count)
    for off, weight in ((-1, 1 / 6), (0, 4 / 6), (1, 1 / 6)):
        sums.index_put_(
            (voxel, _mirrored(voxel + off, count)), torch.tensor(weight, dtype=torch.float64), accumulate=True
        )
    lines = values.movedim(axis, 0)
    solved: Tensor = torch.linalg.solve(sums, lines.reshape(count, -1))
    return solved.reshape(lines.shape).movedim(0, axis)


def _mirrored(index: Tensor, count: int) -> Tensor:
    """Beyond an end the voxels come back, the outermost once."""
    if count == 1:
        return torch.zeros_like(index)
    period = 2 * (count - 1)
    around = index.remainder(period)
    return torch.minimum(around, period - around)


def _weights(off: Tensor) -> Tensor:
    """(n, 4) of the four B-splines about a place that lies so far behind the second."""
    back = 1 - off
    near, far = (2 / 3 - t * t + t**3 / 2 for t in (off, back))
    return torch.stack((back**3 / 6, near, far, off**3 / 6), dim=-1)


def _slopes(off: Tensor) -> Tensor:
    back = 1 - off
    near, far = (-2 * t + 1.5 * t * t for t in (off, back))
    return torch.stack((-(back**2) / 2, near, -far, off**2 / 2), dim=-1)


def _greatest_near(taps: Tensor) -> Tensor:
    """The greatest tap within NEAR of each one on every axis."""
    for axis in range(3):
        count = taps.shape[axis]
        moved = [
            taps.index_select(axis, (torch.arange(count) + by).clamp(0, count - 1)) for by in range(-NEAR, NEAR + 1)
        ]
        taps = torch.stack(moved).amax(dim=0)
    return taps
