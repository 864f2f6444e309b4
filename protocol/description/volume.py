"""What a volume is to everybody but its reader: its grid, its place in physical space, and boxes of its grid."""

import math
from collections.abc import Iterator
from functools import lru_cache
from itertools import chain
from operator import le
from typing import NamedTuple

import msgspec

from volsplat.protocol.description.kind import Band, Kind
from volsplat.protocol.geometry import matrices
from volsplat.protocol.geometry.matrices import Matrix, Vector
from volsplat.protocol.geometry.upright import Up
from volsplat.protocol.text.printable import printable

Index = tuple[int, int, int]  # always grid (i, j, k)

LONGEST_AXIS = 2**31 - 1  # voxels
MOST_VOXELS = 2**48  # of a volume: their bytes are counted in 64 bits, and so is what is kept of each

KEPT_PLACES = 64  # matrices of which what follows is remembered: each frame brings the same ones to each server

_SAME_STEP = 1e-3  # of a voxel, by which the steps of grids that are alike may differ

HALO = 1  # voxels around a sub-cube that its gradients need

# The types that values may have, by their torch names, and the bytes of each.
SCALAR_BYTES = {
    "uint8": 1,
    "int8": 1,
    "uint16": 2,
    "int16": 2,
    "uint32": 4,
    "int32": 4,
    "uint64": 8,
    "int64": 8,
    "float32": 4,
    "float64": 8,
}


class Box(NamedTuple):
    """A half-open box of the grid: low <= (i, j, k) < high."""

    low: Index
    high: Index

    @property
    def size(self) -> Index:
        return (self.high[0] - self.low[0], self.high[1] - self.low[1], self.high[2] - self.low[2])

    @property
    def voxels(self) -> int:
        ni, nj, nk = self.size
        return ni * nj * nk

    def contains(self, index: Index) -> bool:
        return all(low <= at < high for low, at, high in zip(self.low, index, self.high, strict=True))

    def within(self, other: "Box") -> bool:
        """Whether no voxel of it lies outside the other."""
        return all(map(le, other.low, self.low)) and all(map(le, self.high, other.high))

    def slices(self, origin: Index = (0, 0, 0)) -> tuple[slice, slice, slice]:
        """What to index an array (k, j, i) with that begins at `origin`, to have the box."""
        i, j, k = (slice(low - at, high - at) for low, high, at in zip(*self, origin, strict=True))
        return k, j, i

    def cut(self, axis: int, at: int) -> tuple["Box", "Box"]:
        """What is below and above a place on an axis, which must lie within."""
        below, above = list(self.high), list(self.low)
        below[axis] = above[axis] = at
        return Box(self.low, (below[0], below[1], below[2])), Box((above[0], above[1], above[2]), self.high)

    def layers(self, axis: int, size: int, start: int = 0) -> Iterator["Box"]:
        """Cut across an axis at `start` and at every `size` voxels before and after it, the lowest layer first."""
        rest = self
        while (end := start + ((rest.low[axis] - start) // size + 1) * size) < rest.high[axis]:
            layer, rest = rest.cut(axis, end)
            yield layer
        yield rest

    def common(self, other: "Box") -> "Box | None":
        """What lies in both; None if that is nothing."""
        i0, j0, k0 = map(max, self.low, other.low)
        i1, j1, k1 = map(min, self.high, other.high)
        return Box((i0, j0, k0), (i1, j1, k1)) if i0 < i1 and j0 < j1 and k0 < k1 else None

    def without(self, *others: "Box") -> list["Box"]:
        """What lies in none of the others, in as few boxes as each takes: whole sheets, then rows, then samples."""
        rest = [self]
        for other in others:
            rest = [part for box in rest for part in box._without(other)]
        return rest

    def _without(self, other: "Box") -> list["Box"]:
        if self.common(other) is None:
            return [self]
        rest, parts = self, list[Box]()
        for axis in (2, 1, 0):
            if rest.low[axis] < other.low[axis]:
                part, rest = rest.cut(axis, other.low[axis])
                parts.append(part)
            if other.high[axis] < rest.high[axis]:
                rest, part = rest.cut(axis, other.high[axis])
                parts.append(part)
        return parts

    def grown(self, margin: int, dims: Index) -> "Box":
        """The box with `margin` more voxels on every side, clipped to a grid of `dims`."""
        low = (max(self.low[0] - margin, 0), max(self.low[1] - margin, 0), max(self.low[2] - margin, 0))
        high = (
            min(self.high[0] + margin, dims[0]),
            min(self.high[1] + margin, dims[1]),
            min(self.high[2] + margin, dims[2]),
        )
        return Box(low, high)


class Geometry(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A volume's grid and its place in space.

    `index_to_physical` has the physical step of i, j, k as its *columns* (spacing times direction; handedness
    kept, skew allowed). `origin` is the physical position of the centre of voxel (0, 0, 0).
    """

    dims: Index
    index_to_physical: Matrix = matrices.IDENTITY
    origin: Vector = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        if min(self.dims) < 1:
            raise ValueError(f"a volume needs at least one voxel on each axis, not {self.dims}")
        if max(self.dims) > LONGEST_AXIS or self.box.voxels > MOST_VOXELS:
            raise ValueError(
                f"a volume has at most {LONGEST_AXIS} voxels on each axis and {MOST_VOXELS} in all, not {self.dims}"
            )
        _check_place(self.index_to_physical, self.origin)

    @property
    def box(self) -> Box:
        return Box((0, 0, 0), self.dims)

    @property
    def spacing(self) -> Vector:
        """Physical length of one step along i, j and k."""
        return _spacing(self.index_to_physical)

    @property
    def reference_spacing(self) -> float:
        """The cube root of a voxel's volume, in physical units."""
        return _reference_spacing(self.index_to_physical)

    def is_like(self, other: "Geometry") -> bool:
        """Whether it has the same size and, within a thousandth of a voxel, the same steps; wherever it lies."""
        steps = zip(chain(*self.index_to_physical), chain(*other.index_to_physical), strict=True)
        nearest = _SAME_STEP * self.reference_spacing
        return self.dims == other.dims and all(abs(a - b) <= nearest for a, b in steps)

    def physical(self, index: Vector) -> Vector:
        """The physical position of a grid point."""
        return matrices.plus(matrices.applied(self.index_to_physical, index), self.origin)


@lru_cache(KEPT_PLACES)
def _check_place(index_to_physical: Matrix, origin: Vector) -> None:
    spacing, volume = _spacing(index_to_physical), matrices.determinant(index_to_physical)
    told = f"index_to_physical is {index_to_physical}"
    if any(step == (0.0, 0.0, 0.0) for step in matrices.transposed(index_to_physical)):
        raise ValueError(f"a volume's three axes do not span space: one has spacing 0; {told}")
    computable = all(0.0 < step < math.inf for step in spacing) and math.isfinite(volume)
    if computable and volume == 0.0 and _has_size(spacing):
        raise ValueError(f"a volume's three axes do not span space; {told}")
    inverse = matrices.inverse(index_to_physical) if computable and volume != 0.0 else ()
    numbers = (*origin, *(entry for row in inverse for entry in row))
    if not inverse or not all(map(math.isfinite, numbers)) or not _reference_spacing(index_to_physical) > 0.0:
        raise ValueError(
            f"a volume's place in space must be of a size that float64 can compute with; {told}, origin {origin}"
        )


def _has_size(spacing: Vector) -> bool:
    """Whether a voxel's volume does not vanish for the smallness of its sides alone."""
    return spacing[0] * spacing[1] * spacing[2] > 0.0


@lru_cache(KEPT_PLACES)
def _spacing(index_to_physical: Matrix) -> Vector:
    i, j, k = (matrices.length(matrices.column(index_to_physical, axis)) for axis in range(3))
    return (i, j, k)


@lru_cache(KEPT_PLACES)
def _reference_spacing(index_to_physical: Matrix) -> float:
    return matrices.cube_root(abs(matrices.determinant(index_to_physical)))


HOUNSFIELD, CT_NUMBER = "HU", "CT number"
VALUE_NAMES = {  # what values are called that are no density
    Kind.UNKNOWN: "value",
    Kind.SCAN: "value",
    Kind.MR: "signal",
    Kind.STATISTIC_MAP: "statistic",
    Kind.LABELS: "label",
    Kind.PATTERSON: "Patterson function",
    Kind.WAVE_FUNCTION: "wave function",
}


class GridAxis(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What the indices of one grid axis stand for, where that is more than a length: inlines, time, velocity, ...

    Index n stands for first + n * step, in `unit`.
    """

    name: str
    unit: str
    first: float
    step: float

    def __post_init__(self) -> None:
        for field in ("name", "unit"):
            msgspec.structs.force_setattr(self, field, printable(getattr(self, field)))


class VolumeDescription(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What a reader tells of a volume without reading its voxels; texts are made printable, for they are shown."""

    name: str
    format: str
    geometry: Geometry
    scalar_type: str  # a torch name: uint8, int16, float32, ...
    unit: str = ""  # of lengths: "mm", or "" where the file states none
    value_unit: str = ""  # of the voxels' values: "HU", or "" where the file states none
    axes: tuple[GridAxis, GridAxis, GridAxis] | None = None  # of i, j, k, where the file names them
    warnings: tuple[str, ...] = ()  # what the reader had to change, for the person to know
    anatomical: bool = False  # physical axes are left, posterior, superior
    kind: Kind = Kind.UNKNOWN
    kind_from: str = ""  # what in the file states the kind; "" where nothing does
    bands: tuple[Band, ...] = ()  # what the values mean, where they are classes; they do not overlap
    up: Up | None = None  # the physical axis that points up, None where the file does not tell; superior of a patient
    density_name: str = ""  # what the packet's first byte holds; by default what one calls it of this kind
    strength_name: str = "gradient strength"  # what its second byte holds
    second_scalar: tuple[float, float] | None = None  # the range of what it holds in place of gradient strength
    reads_sub_cubes: bool = True  # False: one server reads the whole file, and the others get theirs from it
    why_whole: str = ""  # the reason, when it does; or what else of the file each server must read
    chunk: Index = (1, 1, 1)  # voxels along i, j, k that only come together: a file's rows, its sheets, its chunks

    def __post_init__(self) -> None:
        for field in _TEXTS:
            msgspec.structs.force_setattr(self, field, printable(getattr(self, field)))
        msgspec.structs.force_setattr(self, "warnings", tuple(printable(warning) for warning in self.warnings))
        if min(self.chunk) < 1:
            raise ValueError(f"a chunk needs at least one voxel on each axis, not {self.chunk}")
        if self.anatomical and self.up is None:
            msgspec.structs.force_setattr(self, "up", "+z")
        if not self.density_name:
            name = CT_NUMBER if self.value_unit == HOUNSFIELD else VALUE_NAMES.get(self.kind, "density")
            msgspec.structs.force_setattr(self, "density_name", name)
        if self.second_scalar is not None:
            low, high = self.second_scalar
            if not (low < high and math.isfinite(1.0 / (high - low)) and math.isfinite(high - low)):
                raise ValueError(f"the second scalar needs a range, not {low} to {high}")


_TEXTS = (
    "name",
    "format",
    "scalar_type",
    "unit",
    "value_unit",
    "kind_from",
    "density_name",
    "strength_name",
    "why_whole",
)
