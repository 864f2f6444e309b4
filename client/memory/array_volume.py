"""An array in memory as a volume: its place in space as its library or the caller tells it, shared with the servers.

What is shared is an open file without a name: it is gone with the last process that has it open, however that ends.
"""

from __future__ import annotations

import math
import os
import warnings
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Self

import numpy as np

from volsplat.client.caller.own_frames import level_of_caller
from volsplat.client.memory.array_source import ArraySource
from volsplat.client.memory.given_words import letters, numbers, unit_of, words
from volsplat.client.memory.known_arrays import source_of
from volsplat.client.memory.library_errors import library_errors
from volsplat.client.memory.shared_memory import SharedMemory, copied_memory, shared_memory
from volsplat.protocol.description.kind import Kind
from volsplat.protocol.description.shared_array import PAGE_BYTES, header_bytes, shared_array
from volsplat.protocol.description.volume import SCALAR_BYTES, Geometry, VolumeDescription
from volsplat.protocol.text.errors import BadInput

LPS = {"L": (0, 1.0), "R": (0, -1.0), "P": (1, 1.0), "A": (1, -1.0), "S": (2, 1.0), "I": (2, -1.0)}
PATIENT_KINDS = (Kind.CT, Kind.MR, Kind.SCAN)
NAME_SIDES = "name the sides of the patient that x, y and z grow to, as 'LPS' or 'RAS'"
HOW_TO_PLACE = "give spacing=(x, y, z) and space='LPS' (or 'RAS', 'LAS', ...), or affine= and space="
SAVE_FIRST = (
    "an array in memory is seen by servers of this machine and this session alone; save it first, as by "
    "numpy.save('volume.npy', array), where all servers see it, and give its path"
)


class OrientationUnknown(UserWarning):
    """Nobody says how an array lies in space."""


class Volume:
    """A volume in memory: an array of numpy, torch, xarray, dask, zarr or h5py, an image of ITK, nibabel or VTK.

    It has three axes of whole numbers or floats, of up to 64 bits each; NaN and infinities are no data, and so is what
    the library has masked. What the object's library tells of its place is taken from it; what is given here counts
    before that. `axes` names a bare array's axes in their order, "zyx" as numpy users have them (the default) or "xyz"
    as nibabel's data arrays; images know their own. `spacing` and `origin` are along x, y and z; or `affine`, 4 x 4,
    leads from indices (x, y, z) to physical axes, which `space` names by where they grow to: "RAS" as nibabel's, "LPS"
    as ITK's; "" where there is no patient. Lengths are in `unit`, as "mm", values in `value_unit`, as "HU". `kind` is a
    Kind or its name, as "CT". Warns by OrientationUnknown where nobody says how the array lies. Raises BadInput.
    """

    def __init__(
        self,
        array: Any,
        *,
        axes: str | Sequence[str] | None = None,
        spacing: Any = None,
        origin: Any = None,
        affine: Any = None,
        space: str | Sequence[str] = "",
        unit: Any = "",
        value_unit: Any = "",
        kind: Kind | str = Kind.UNKNOWN,
        name: str = "",
    ) -> None:
        source = source_of(array)
        if source is None:
            raise BadInput(f"a volume is wanted, not a {type(array).__name__}: an array or an image of three axes")
        source = _in_order(source, axes)
        if affine is not None and (spacing is not None or origin is not None):
            raise BadInput("affine= says spacing and origin, too; leave out spacing= and origin=")
        space = letters("space", space, NAME_SIDES)
        unit = words("unit", unit) or source.unit or next(filter(None, map(unit_of, (spacing, origin, affine))), "")
        if not (spacing is None and origin is None and affine is None and not space):
            source = _placed(source, spacing, origin, affine, space, unit)
        source = replace(source, unit=unit, value_unit=words("value_unit", value_unit) or source.value_unit)
        self._description = _description(source, _kind(kind), words("name", name))
        self._shared: SharedMemory = shared_memory(self._description, source.values)

    @classmethod
    def _of_contents(cls, contents: bytes) -> Self:
        """One that was pickled."""
        volume = cls.__new__(cls)
        volume._description = shared_array(contents[: header_bytes(contents[:PAGE_BYTES])]).description
        volume._shared = copied_memory(volume._description.name, contents)
        return volume

    def __reduce__(self) -> tuple[Any, ...]:
        """With its voxels: for a process that may outlive this one, or the volume here."""
        return type(self)._of_contents, (self._shared.contents(),)

    def __copy__(self) -> Self:
        return self  # nobody can change it

    def __deepcopy__(self, memo: object) -> Self:
        return self

    def __repr__(self) -> str:
        size = " x ".join(map(str, self._description.geometry.dims))
        return f"<volsplat volume in memory {self._description.name}: {size} voxels of {self._description.scalar_type}>"

    @property
    def description(self) -> VolumeDescription:
        return self._description

    @property
    def place(self) -> str:
        """By which name processes of this machine open it while this one lives. Raises BadInput once it is closed."""
        return self._shared.place

    def check_open(self) -> None:
        """Raises BadInput once it is closed."""
        self._shared.check_open()

    def close(self) -> None:
        """Give the memory back once the servers have; else that happens when nobody holds the volume any more."""
        self._shared.close()


def volume_in_memory(volume: Any) -> Volume | None:
    """Any array or image as a volume; None of what is named by a path or is no array. Raises BadInput."""
    if isinstance(volume, Volume):
        return volume
    if isinstance(volume, str | bytes | os.PathLike) or source_of(volume) is None:
        return None
    return Volume(volume)


def _in_order(source: ArraySource, axes: str | Sequence[str] | None) -> ArraySource:
    """With values indexed [z, y, x]. Raises BadInput unless there are three axes of one or more voxels."""
    if axes is not None and source.ordered:
        raise BadInput(f"axes={axes!r}: {source.name} says itself which of its axes are x, y and z; leave axes= out")
    axes = "zyx" if axes is None else letters("axes", axes, "name each of x, y and z once, as 'zyx'")
    if sorted(axes) != sorted("xyz"):
        raise BadInput(f"axes={axes!r}: name each of x, y and z once, in the order of the array's axes, as 'zyx'")
    shape = tuple(source.values.shape)
    if len(shape) != 3:
        raise BadInput(f"an array of shape {shape} is no volume, which has three axes; {_made_three(shape)}")
    if any(map(math.isnan, shape)):
        raise BadInput(
            f"an array of shape {shape} does not know it yet; have dask find it by array.compute_chunk_sizes()"
        )
    if 0 in shape:
        raise BadInput(f"an array of shape {shape} has no voxels; choose a part that has some")
    if axes == "zyx":
        return source
    with library_errors("the array"):
        values = np.asarray(source.values)
    return replace(source, values=values.transpose([axes.index(axis) for axis in "zyx"]))


def _made_three(shape: tuple[int, ...]) -> str:
    """How an array of another number of axes becomes a volume."""
    if len(shape) < 3:
        return "put slices together, as np.stack(slices)"
    are_colours = len(shape) == 4 and shape[-1] in (3, 4)
    return f"choose a part, as array[{'..., 0' if are_colours else ', '.join('0' * (len(shape) - 3))}]"


def _placed(source: ArraySource, spacing: Any, origin: Any, affine: Any, space: str, unit: str) -> ArraySource:
    """Placed as the caller says."""
    if source.anatomical and space and affine is None:
        raise BadInput(f"the image says itself which sides of the patient are where; leave out space={space!r}")
    if affine is not None:
        matrix = numbers("affine", affine, (4, 4), unit)
        to_physical, first = matrix[:3, :3], matrix[:3, 3]
    else:
        own = np.array(source.matrix)
        lengths = np.linalg.norm(own, axis=0)
        given = lengths if spacing is None else numbers("spacing", spacing, (3,), unit)
        to_physical = own / lengths * given
        first = numbers("origin", origin, (3,), unit) if origin is not None else np.array(source.origin)
    if space:
        turn = _lps(space)
        to_physical, first = turn @ to_physical, turn @ first
    rows = [tuple(map(float, row)) for row in to_physical]
    return replace(
        source,
        matrix=(rows[0], rows[1], rows[2]),  # type: ignore[arg-type]
        origin=tuple(map(float, first)),  # type: ignore[arg-type]
        anatomical=bool(space) or source.anatomical and affine is None,
        placed=True,
    )


def _lps(space: str) -> Any:
    """The matrix from axes that grow to these sides of a patient to left, posterior and superior."""
    sides = [LPS.get(letter) for letter in space.upper()]
    turn = np.zeros((3, 3))
    for column, side in enumerate(sides[:3]):
        if side is not None:
            turn[side[0], column] = side[1]
    if len(sides) != 3 or np.linalg.matrix_rank(turn) < 3:
        raise BadInput(f"space={space!r}: {NAME_SIDES}")
    return turn


def _kind(kind: Kind | str) -> Kind:
    for one in Kind:
        if one.value.lower() == str(kind).lower():
            return one
    raise BadInput(f"kind={kind!r}: is none of {', '.join(Kind)}")


def _description(source: ArraySource, kind: Kind, name: str) -> VolumeDescription:
    if kind in PATIENT_KINDS and not source.anatomical:
        raise BadInput(f"kind={kind.value}: is of a patient, whose sides the array does not tell; {HOW_TO_PLACE}")
    if not source.placed:
        warnings.warn(source.unplaced, OrientationUnknown, stacklevel=level_of_caller())
    dims = source.values.shape[::-1]
    try:
        geometry = Geometry((int(dims[0]), int(dims[1]), int(dims[2])), source.matrix, source.origin)
    except (ValueError, ArithmeticError) as error:
        raise BadInput(f"the array has no place in space: {error}") from None
    return VolumeDescription(
        name=name or source.name,
        format="array in memory",
        geometry=geometry,
        scalar_type=_scalar_type(source.values.dtype),
        unit=source.unit,
        value_unit=source.value_unit,
        warnings=source.warnings if source.placed else (*source.warnings, source.unplaced),
        anatomical=source.anatomical,
        kind=kind,
        kind_from="the script" if kind is not Kind.UNKNOWN else "",
    )


def _scalar_type(dtype: Any) -> str:
    """The type that a volume of such numbers has. Raises BadInput."""
    try:
        name: str = np.dtype(dtype).name
    except TypeError:
        name = str(dtype)
    name = {"bool": "uint8", "float16": "float32"}.get(name, name)
    if name not in SCALAR_BYTES:
        raise BadInput(
            f"an array of {dtype} is no volume; convert it to numbers such as float32, complex ones by abs(), or "
            "choose one of several fields"
        )
    return name
