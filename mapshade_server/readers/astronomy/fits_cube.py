"""FITS cubes, plain, gzip or tile-compressed (fits.gsfc.nasa.gov), with headers by astropy.

Plain voxels are read here as they are stored, only those of the box: astropy (8.0) would read them row by row, and
takes a BLANK of 0 for none. Tile-compressed images are unpacked by astropy, only the tiles that the box needs.
"""

import math
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from volsplat.mapshade_server.readers.astronomy.fits_geometry import placed
from volsplat.mapshade_server.readers.astronomy.fits_hdus import chosen_hdu, cubes_told
from volsplat.mapshade_server.readers.astronomy.fits_tiles import check_tiles_within
from volsplat.mapshade_server.readers.reading.extra import library
from volsplat.mapshade_server.readers.reading.grids import refuse_other_dimensions, refuse_vectors
from volsplat.mapshade_server.readers.reading.gzip_files import is_gzip
from volsplat.mapshade_server.readers.reading.opened_file import opened
from volsplat.mapshade_server.readers.reading.part_options import index_in, part_options
from volsplat.mapshade_server.readers.reading.parts import PartNeeded, numbered
from volsplat.mapshade_server.readers.reading.stored_voxels import one_piece
from volsplat.mapshade_server.readers.reading.volume_reader import OpenedVolume, ReadBox, VolumeFormat, Voxels
from volsplat.protocol.description.kind import Kind
from volsplat.protocol.description.volume import Box, Index, VolumeDescription
from volsplat.protocol.text.errors import BadInput

STORED_TYPES = {8: ">u1", 16: ">i2", 32: ">i4", 64: ">i8", -32: ">f4", -64: ">f8"}  # by BITPIX
MOST_AXES = 9
AXIS_OPTIONS = tuple(f"axis{n + 1}" for n in range(MOST_AXES))
COMPONENTS = ("STOKES", "COMPLEX", "RGB")  # what an axis may count that is neither space nor spectrum


def open_fits_cube(path: Path, part: str) -> OpenedVolume:
    """The reader for a cube; `part` names an HDU and the planes of further axes: DATA, 2, axis4=0 or DATA,axis4=0.

    Raises BadInput if there is no cube or several, and if the headers cannot be used or promise too much.
    """
    options = part_options(part, AXIS_OPTIONS)
    zipped = is_gzip(path)
    with _opened(path) as hdus:
        number, note = chosen_hdu(path, hdus, options.word)
        hdu = hdus[number]
        array = _array(path, number, hdu, options.values)
        scaling = _scaling(path, hdu.header)
        if _is_tiled(hdu):
            _check_tiles(path, number, hdu)
            stored: ReadBox = partial(_read_tiles, path, number, array)
        else:
            stored = _plain_voxels(path, hdu, array)
        place = placed(path, hdu.header, hdus, array.dims, array.axes, array.picked)
        texts = {key: str(hdu.header.get(key, "")).strip() for key in ("BUNIT", "BTYPE")}
        parts = cubes_told(hdus) if note else []
        of_several = f", HDU {number} ({hdu.name})" if len(hdus) > 1 else ""
    description = VolumeDescription(
        name=path.name,
        format="FITS" + of_several,
        geometry=place.geometry,
        scalar_type=scaling.scalar_type,
        unit=place.unit,
        value_unit=texts["BUNIT"],
        axes=place.axes,
        warnings=(*note, *place.warnings),
        kind=Kind.SPECTRAL_CUBE if place.spectral else Kind.UNKNOWN,
        kind_from=f"its axis {place.spectral}" if place.spectral else "",
        up="+z",  # north, or as images are shown
        density_name=texts["BTYPE"].lower() or "intensity",
        reads_sub_cubes=not zipped,
        chunk=(place.geometry.dims[0], 1, 1),
        why_whole="the file is compressed by gzip" if zipped else "",
    )
    return OpenedVolume(description, lambda box: scaling.applied(stored(box)), parts=parts)


@contextmanager
def _opened(path: Path, **how: bool) -> Iterator[Any]:
    """The list of HDUs; astropy's many exceptions become BadInput, and it says nothing of its own."""
    fits = library("astropy.io.fits", "FITS")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", library("astropy.utils.exceptions", "FITS").AstropyWarning)
        try:
            # The file is opened here since astropy leaves it open if it fails, and not mapped since one that is cut
            # short meanwhile would end the process.
            with opened(path) as file, fits.open(file, memmap=False, do_not_scale_image_data=True, **how) as hdus:
                yield hdus
        except BadInput:
            raise
        except Exception as error:  # astropy raises anything over a damaged file, also exceptions without public names
            if isinstance(error, OSError) and error.errno:
                raise
            reason = " ".join(str(error).split()).rstrip(".")[:160] or type(error).__name__
            raise BadInput(f"{path}: a damaged or truncated FITS file ({reason}); fetch or export it again") from None


def _is_tiled(hdu: Any) -> bool:
    return isinstance(hdu, library("astropy.io.fits", "FITS").CompImageHDU)


@dataclass(frozen=True)
class _Array:
    """An image's axes, from the fastest: their lengths, which three are the volume's, and the planes of others."""

    sizes: tuple[int, ...]
    axes: Index
    picked: Mapping[int, int]

    @property
    def dims(self) -> Index:
        return (self.sizes[self.axes[0]], self.sizes[self.axes[1]], self.sizes[self.axes[2]])


def _array(path: Path, number: int, hdu: Any, said: Mapping[str, str]) -> _Array:
    """The cube's axes. Raises BadInput if there are other than three, besides those of which a plane is picked."""
    if not (hdu.is_image and hdu.shape):
        raise BadInput(f"{path}: HDU {number} ({hdu.name}) is no image; give the number or name of a cube")
    sizes = tuple(int(n) for n in hdu.shape[::-1])
    names = [str(hdu.header.get(f"CTYPE{n + 1}", "")).partition("-")[0].strip().upper() for n in range(len(sizes))]
    picked = {
        axis: index_in(path, said[f"axis{axis + 1}"], n, f"planes along axis {axis + 1}")
        for axis, n in enumerate(sizes)
        if f"axis{axis + 1}" in said
    }
    axes = [axis for axis, n in enumerate(sizes) if n > 1 and axis not in picked]
    if len(axes) > 3:
        more = next((axis for axis in axes if names[axis] in COMPONENTS), axes[-1])
        shown = " x ".join(f"{sizes[axis]} {names[axis]}".strip() for axis in axes)
        plane = f"{path}#{f'{number},' if number else ''}axis{more + 1}=0"
        line = (
            f"{path}: {len(axes)} axes, {shown}, volsplat needs three; choose a plane of axis {more + 1}, "
            f"0 to {sizes[more] - 1}, as in {plane}"
        )
        planes = numbered(sizes[more], names[more] or f"plane of axis {more + 1}", f"axis{more + 1}")
        given = "".join(f"axis{axis + 1}={n}," for axis, n in picked.items())
        before = f"{number},{given}" if number else given
        raise PartNeeded(line, [one._replace(part=f"{before}{one.part}") for one in planes])
    refuse_other_dimensions(path, tuple(sizes[axis] for axis in axes) or (1,))
    for axis in axes:
        if names[axis] in COMPONENTS:
            refuse_vectors(path, f"{sizes[axis]} values of {names[axis]} a pixel, no third axis")
    return _Array(sizes, (axes[0], axes[1], axes[2]), picked)


@dataclass(frozen=True)
class _Scaling:
    """What turns stored numbers into values: value = stored * slope + zero; `blank` is stored for no data."""

    scalar_type: str
    slope: float = 1.0
    zero: float = 0.0
    blank: int | None = None

    def applied(self, stored: Voxels) -> Voxels:
        """The values. Those of the other signedness are stored with their top bit turned, which is exact."""
        kind = np.dtype(self.scalar_type)
        if (self.slope, self.zero, self.blank) == (1.0, 0.0, None):
            return stored
        if kind.kind in "iu":
            bits = stored.view(f"u{kind.itemsize}")
            bits ^= bits.dtype.type(1 << (8 * kind.itemsize - 1))
            return bits.view(kind)
        values = (stored.astype(np.float64) * self.slope + self.zero).astype(kind)
        if self.blank is not None:
            values[stored == self.blank] = np.nan
        return values


def _scaling(path: Path, header: Any) -> _Scaling:
    stored = np.dtype(STORED_TYPES[header["BITPIX"]])
    slope, zero = float(header.get("BSCALE", 1)), float(header.get("BZERO", 0))
    if slope == 0 or not (math.isfinite(slope) and math.isfinite(zero)):
        raise BadInput(f"{path}: the header's BSCALE of {slope:g} and BZERO of {zero:g} give no values; correct it")
    blank = header.get("BLANK") if stored.kind in "iu" else None
    if blank is None and slope == 1:
        top = 2.0 ** (8 * stored.itemsize - 1)
        if zero == 0:
            return _Scaling(stored.name)
        if stored.kind == "i" and zero == top:
            return _Scaling(f"u{stored.name}", zero=top)
        if stored.kind == "u" and zero == -top:
            return _Scaling("int8", zero=-top)
    scalar_type = "float32" if stored.itemsize <= 2 or stored.name == "float32" else "float64"
    return _Scaling(scalar_type, slope, zero, None if blank is None else int(blank))


def _plain_voxels(path: Path, hdu: Any, array: _Array) -> ReadBox:
    """What reads them: sheets lie `stride` stored sheets apart if a plane of an axis between them was picked.

    Raises BadInput if the file cannot hold them, or if an axis of which a plane is picked varies fastest.
    """
    i, j, k = array.axes
    inner = [axis for axis in range(j) if axis != i and array.sizes[axis] > 1]
    if inner:
        raise BadInput(
            f"{path}: axis {inner[0] + 1} lies between the pixels of a plane, which volsplat cannot read; "
            "reorder the axes so that it comes last"
        )
    first, stride, sheets = 0, 1, 1
    for axis in range(j + 1, len(array.sizes)):
        first += array.picked.get(axis, 0) * sheets
        stride = sheets if axis == k else stride
        sheets *= array.sizes[axis]
    dims = (array.sizes[i], array.sizes[j], sheets)
    stored = one_piece(path, dims, np.dtype(STORED_TYPES[hdu.header["BITPIX"]]), hdu.fileinfo()["datLoc"])
    if stride == 1:
        return partial(stored.read_from, first)

    def read(box: Box) -> Voxels:
        sheets = range(box.low[2], box.high[2])
        return np.concatenate(
            [stored.read_from(first + k * stride, Box((*box.low[:2], 0), (*box.high[:2], 1))) for k in sheets]
        )

    return read


def _read_tiles(path: Path, number: int, array: _Array, box: Box) -> Voxels:
    """The voxels of a box of a tile-compressed image."""
    key = [slice(n, n + 1) for n in (array.picked.get(axis, 0) for axis in range(len(array.sizes)))]
    for axis, low, high in zip(array.axes, box.low, box.high, strict=True):
        key[axis] = slice(low, high)
    wanted = tuple(key[::-1])
    with _opened(path, disable_image_compression=True) as tables, _opened(path) as hdus:
        hdu = hdus[number]
        check_tiles_within(tables[number], hdu.tile_shape, hdu.shape, wanted)
        voxels = hdu.section[wanted].reshape(box.size[::-1])
    return np.array(voxels, voxels.dtype.newbyteorder("="), order="C")


def _check_tiles(path: Path, number: int, hdu: Any) -> None:
    """Raises BadInput if there are not as many tiles as the sizes need, or the file ends before they do."""
    tiles = math.prod(-(-n // tile) for n, tile in zip(hdu.shape, hdu.tile_shape, strict=True))
    with _opened(path, disable_image_compression=True) as hdus:
        table, place = hdus[number].header, hdus[number].fileinfo()
    if table["NAXIS2"] != tiles:
        raise BadInput(
            f"{path}: the header's sizes need {tiles} tiles, but {table['NAXIS2']} are stored; correct the header"
        )
    if place["datLoc"] + place["datSpan"] > path.stat().st_size and not is_gzip(path):
        raise BadInput(f"{path}: is truncated, it ends before its tiles do; fetch or export the file again")


FORMATS = (
    VolumeFormat("FITS cube (.fits, .fits.gz)", open_fits_cube, lambda head: head.startswith(b"SIMPLE  ="), gzip=True),
)
