"""What an array of any library tells of itself, in the terms of a volume. Knows no library."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from volsplat.protocol.geometry import matrices
from volsplat.protocol.geometry.matrices import Matrix, Vector

UNPLACED = "the array does not say how it lies in space"
HOW_TO_SAY_MORE = "Volume(array, spacing=...) says more"


@dataclass(frozen=True)
class ArraySource:
    """`values` are indexed [k, j, i]; a slice of the first axis gives what numpy makes an array of."""

    values: Any
    name: str = "array"
    matrix: Matrix = matrices.IDENTITY  # index to physical
    origin: Vector = (0.0, 0.0, 0.0)
    unit: str = ""
    value_unit: str = ""
    ordered: bool = False  # it says which of its axes are x, y and z
    anatomical: bool = False
    placed: bool = False  # it says where it lies; else the matrix is only a stand-in
    unplaced: str = (  # the warning where it is not
        f"{UNPLACED}: it is drawn as [z, y, x] with cubic voxels, and may be mirrored; "
        f"{HOW_TO_SAY_MORE.replace('...', '..., axes=...')}"
    )
    warnings: tuple[str, ...] = field(default=())
