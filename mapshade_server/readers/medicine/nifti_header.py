"""The header of NIfTI-1 and NIfTI-2 files, and of Analyze 7.5, whose numbers NIfTI-1 took over with their places."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from volsplat.mapshade_server.readers.reading.components import Component, are_colours, chosen_volume
from volsplat.mapshade_server.readers.reading.grids import refuse_other_dimensions, refuse_vectors
from volsplat.mapshade_server.readers.reading.gzip_files import first_bytes
from volsplat.mapshade_server.readers.reading.parts import Part
from volsplat.mapshade_server.readers.reading.stored_voxels import StoredVoxels, one_piece
from volsplat.protocol.text.errors import BadInput

HEADER_BYTES = (348, 348, 540)  # by the version of NIfTI, 0 for Analyze
FIRST_VOXEL = (0, 352, 544)  # by the version: at the earliest, if voxels follow the header in one file
LARGEST_OFFSET = 1 << 40
INTENT_STATISTICS = range(2, 25)  # the distributions of tests, from a correlation to the logarithm of a p-value
INTENT_COLOURS = (2003, 2004)
INTENT_VECTORS = (1006, 1007, 2006)  # displacements, vectors of any meaning, displacements by FSL
_NIFTI_1 = {
    "dim": (40, "i2", 8),
    "intent": (68, "i2", 1),
    "datatype": (70, "i2", 1),
    "pixdim": (76, "f4", 8),
    "vox_offset": (108, "f4", 1),
    "scl": (112, "f4", 2),
    "units": (123, "u1", 1),
    "codes": (252, "i2", 2),
    "quatern": (256, "f4", 6),
    "srow": (280, "f4", 12),
}
_NIFTI_2 = {
    "dim": (16, "i8", 8),
    "datatype": (12, "i2", 1),
    "pixdim": (104, "f8", 8),
    "vox_offset": (168, "i8", 1),
    "scl": (176, "f8", 2),
    "units": (500, "i4", 1),
    "intent": (504, "i4", 1),
    "codes": (344, "i4", 2),
    "quatern": (352, "f8", 6),
    "srow": (400, "f8", 12),
}


class NiftiVoxels(NamedTuple):
    """What is drawn of a file: its name, and the voxels of each component that is taken, one after the other."""

    name: str
    stored: list[StoredVoxels]
    component: Component
    parts: list[Part]


@dataclass(frozen=True)
class NiftiHeader:
    """The header's bytes, its version, 0 for Analyze, and byte order, < or >."""

    path: Path
    raw: bytes
    version: int
    order: str

    def values(self, name: str) -> list[float]:
        offset, kind, count = (_NIFTI_2 if self.version == 2 else _NIFTI_1)[name]
        numbers: list[float] = np.frombuffer(self.raw, f"{self.order}{kind}", count, offset).tolist()
        return numbers

    def wrong(self, name: str, value: object) -> BadInput:
        kind = "NIfTI" if self.version else "Analyze"
        return BadInput(f"{self.path}: the {kind} header's {name} {value} makes no sense; correct the header")

    @property
    def intent(self) -> int:
        return int(self.values("intent")[0])

    def voxels(self, part: str, scalar_types: dict[int, str]) -> NiftiVoxels:
        """The voxels of the frame and component that are named. Raises BadInput."""
        count, *sizes = (int(n) for n in self.values("dim"))
        if not 1 <= count <= 7 or min(sizes[:count]) < 1:
            raise self.wrong("dim", [count, *sizes])
        if self.version and count == 4 and self.intent in INTENT_VECTORS:  # components, which belong on the fifth axis
            count, sizes = 5, [*sizes[:3], 1, sizes[3]]
        components = sizes[4] if self.version and count >= 5 else 1
        refuse_other_dimensions(self.path, (*sizes[: min(count, 3)], *sizes[5 if self.version else 4 : count]))
        code, dims = int(self.values("datatype")[0]), (sizes[0], sizes[1], sizes[2])
        if code not in scalar_types:
            refuse_vectors(
                self.path, f"voxels of {'NIfTI' if self.version else 'Analyze'}'s type {code}, no plain number"
            )
        dtype = np.dtype(scalar_types[code]).newbyteorder(self.order)  # type: ignore[arg-type]
        if components > 1 and self.intent in INTENT_STATISTICS:
            refuse_vectors(self.path, "a statistic with its parameters at each voxel")
        if components > 1 and (self.intent in INTENT_COLOURS or are_colours(components, dtype.name)):
            refuse_vectors(self.path, f"{components} components a voxel, which are colours")
        frames = sizes[3] if count >= 4 else 1
        frame, name, component, parts = chosen_volume(self.path, part, frames, components)
        frame_bytes = math.prod(dims) * dtype.itemsize
        starts = [self._start() + (n * frames + frame) * frame_bytes for n in component.taken]
        stored = [one_piece(self.path, dims, dtype, start, self._data_file()) for start in starts]
        return NiftiVoxels(name, stored, component, parts)

    @property
    def start_told(self) -> tuple[str, ...]:
        """A warning if the header has voxels begin within itself."""
        if not self._begins_within_itself:
            return ()
        stated, taken = int(self.values("vox_offset")[0]), self._start()
        return (f"its vox_offset {stated} lies within the header; voxels are read from byte {taken} on",)

    def _start(self) -> int:
        """The byte of the data file at which voxels begin. Raises BadInput if it makes no sense."""
        start = self.values("vox_offset")[0]
        if not 0 <= start <= LARGEST_OFFSET:
            raise self.wrong("vox_offset", start)
        return FIRST_VOXEL[self.version] if self._begins_within_itself else int(start)

    @property
    def _begins_within_itself(self) -> bool:
        return self._in_one_file and self.values("vox_offset")[0] < HEADER_BYTES[self.version]

    @property
    def _in_one_file(self) -> bool:
        magic = self.raw[4:8] if self.version == 2 else self.raw[344:348]
        return bool(self.version) and not magic.startswith(b"ni")

    def _data_file(self) -> Path:
        """The file with the voxels: the header's own, or the .img beside a .hdr, whether it is there or not."""
        if self._in_one_file:
            return self.path
        header = self.path.with_name(self.path.name.removesuffix(".gz"))
        image = header.with_suffix(".IMG" if header.suffix.isupper() else ".img")
        zipped = image.with_name(image.name + ".gz")
        return zipped if zipped.is_file() and not image.is_file() else image


def nifti_header(path: Path) -> NiftiHeader:
    """The header of a file that begins as NIfTI does. Raises BadInput if it is truncated."""
    raw = first_bytes(path, HEADER_BYTES[2])
    for version, size in list(enumerate(HEADER_BYTES))[1:]:
        for order in "<>":
            if len(raw) >= size and np.frombuffer(raw, f"{order}i4", 1)[0] == size:
                return NiftiHeader(path, raw, version, order)
    raise BadInput(f"{path}: the NIfTI header is truncated or its size field is wrong; fetch the file again")
