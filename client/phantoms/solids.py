"""Smooth solids of which phantoms are built, as signed distances: below 0 inside, in the units of the positions."""

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from volsplat.protocol.geometry.matrices import Vector, dot, minus

FAR = 1e3  # the distance given for a solid that does not reach into some sheets


@dataclass(frozen=True)
class Ellipsoid:
    centre: Vector
    radii: Vector

    def distance(self, x: Tensor, y: Tensor, z: Tensor) -> Tensor:
        """First-order distance, exact on the surface."""
        px, py, pz = (x - self.centre[0], y - self.centre[1], z - self.centre[2])
        rx, ry, rz = self.radii
        scaled = torch.sqrt((px / rx) ** 2 + (py / ry) ** 2 + (pz / rz) ** 2)
        slope = torch.sqrt((px / rx**2) ** 2 + (py / ry**2) ** 2 + (pz / rz**2) ** 2)
        return scaled * (scaled - 1) / slope.clamp_(min=1e-6)

    def z_range(self) -> tuple[float, float]:
        return self.centre[2] - self.radii[2], self.centre[2] + self.radii[2]

    def mirrored(self) -> "Ellipsoid":
        return replace(self, centre=(-self.centre[0], *self.centre[1:]))


@dataclass(frozen=True)
class RoundCone:
    """Spheres along a line from `start` to `end`, their radius changing evenly from one to the other."""

    start: Vector
    end: Vector
    start_radius: float
    end_radius: float

    def distance(self, x: Tensor, y: Tensor, z: Tensor) -> Tensor:
        along = minus(self.end, self.start)
        px, py, pz = (x - self.start[0], y - self.start[1], z - self.start[2])
        share = ((px * along[0] + py * along[1] + pz * along[2]) / dot(along, along)).clamp(0, 1)
        gap = torch.sqrt((px - share * along[0]) ** 2 + (py - share * along[1]) ** 2 + (pz - share * along[2]) ** 2)
        return gap - (self.start_radius + share * (self.end_radius - self.start_radius))

    def z_range(self) -> tuple[float, float]:
        ends = ((self.start[2], self.start_radius), (self.end[2], self.end_radius))
        return min(z - r for z, r in ends), max(z + r for z, r in ends)

    def mirrored(self) -> "RoundCone":
        return replace(self, start=(-self.start[0], *self.start[1:]), end=(-self.end[0], *self.end[1:]))


Solid = Ellipsoid | RoundCone


def both_sides(*solids: Solid) -> tuple[Solid, ...]:
    """The solids and their mirror images in x."""
    return tuple(side for solid in solids for side in (solid, solid.mirrored()))


def union(solids: tuple[Solid, ...], x: Tensor, y: Tensor, z: Tensor, blend: float = 0.0) -> Tensor:
    """The distance from all solids together; `blend` is the length over which neighbours flow into each other."""
    reach = 4 * blend + 20
    lowest, highest = float(z.min()) - reach, float(z.max()) + reach
    distance = torch.full_like(x + y + z, FAR)
    for solid in solids:
        low, high = solid.z_range()
        if low <= highest and high >= lowest:
            distance = blended_minimum(distance, solid.distance(x, y, z), blend)
    return distance


def blended_minimum(a: Tensor, b: Tensor, blend: float) -> Tensor:
    """The minimum, rounded where both differ by less than `blend`."""
    if blend == 0.0:
        return torch.minimum(a, b)
    share = (0.5 + (b - a) / (2 * blend)).clamp_(0, 1)
    return b + share * (a - b) - blend * share * (1 - share)


def without(a: Tensor, b: Tensor, blend: float = 0.0) -> Tensor:
    """The distance from what is in `a` but not in `b`."""
    return -blended_minimum(-a, b, blend)


def coverage(distance: Tensor, edge: float) -> Tensor:
    """1 inside, 0 outside, a smooth step of the width `edge` across the surface."""
    share = (0.5 - distance / edge).clamp_(0, 1)
    return share * share * (3 - 2 * share)
