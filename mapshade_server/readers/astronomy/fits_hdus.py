"""Which HDU of a FITS file is meant: the one that is named, the only cube, or the data beside its errors and masks.

Instruments store a cube with others of its size: its variance, its errors, its bad pixels. ESO's data products say
which is which (HDUCLAS2), others by name: DATA and STAT as MUSE has them, SCI, ERR and DQ as Hubble and Webb, FLUX,
IVAR and MASK as MaNGA.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from volsplat.mapshade_server.readers.reading.parts import Part, PartNeeded
from volsplat.protocol.text.errors import BadInput

_DATA_NAMES = ("DATA", "SCI", "FLUX")
_CLASS, _CLASS_OF_DATA = "HDUCLAS2", "DATA"


def chosen_hdu(path: Path, hdus: Any, word: str) -> tuple[int, tuple[str, ...]]:
    """The number of the HDU that `word` names by its number or name, or of the cube that is meant if none is named.

    With a note if others like it are left out. Raises BadInput if none or several are meant.
    """
    cubes = [n for n, hdu in enumerate(hdus) if len(_long_axes(hdu)) > 2]
    if word:
        named = [n for n, hdu in enumerate(hdus) if str(n) == word] or [
            n for n, hdu in enumerate(hdus) if str(hdu.name).upper() == word.upper()
        ]
    else:
        named = cubes or [n for n, hdu in enumerate(hdus) if _long_axes(hdu)]
    if len(named) == 1 or named and not cubes:
        return named[0], ()
    listed = ", ".join(f"{n} ({_told(hdus[n])})" for n in cubes)
    if not cubes:
        raise BadInput(f"{path}: holds no image, only headers and tables; give a FITS file with a cube")
    if not word and (data := _data(hdus, cubes)) is not None:
        others = [str(hdus[n].name) or str(n) for n in cubes if n != data]
        return data, (f"of {len(cubes)} cubes {hdus[data].name} is shown; {path.name}#{others[0]} shows {others[0]}",)
    if not word or named:
        line = f"{path}: holds {len(cubes)} cubes: HDU {listed}; choose one, as in {path}#{cubes[0]}"
        raise PartNeeded(line, cubes_told(hdus))
    raise BadInput(f"{path}: has no HDU “{word}”; its cubes are HDU {listed}")


def cubes_told(hdus: Any) -> list[Part]:
    """All of a file, by their numbers."""
    return [Part(str(n), _told(hdu)) for n, hdu in enumerate(hdus) if len(_long_axes(hdu)) > 2]


def _data(hdus: Any, cubes: Sequence[int]) -> int | None:
    """The only cube of data, if the others are of its size and describe it; None if that is not so."""
    if len({tuple(_long_axes(hdus[n])) for n in cubes}) > 1:
        return None
    classed = [n for n in cubes if str(hdus[n].header.get(_CLASS, "")).strip().upper() == _CLASS_OF_DATA]
    named = [n for n in cubes if str(hdus[n].name).upper() in _DATA_NAMES]
    found = classed or named
    return found[0] if len(found) == 1 else None


def _long_axes(hdu: Any) -> list[int]:
    """The lengths of an image's axes that are longer than 1; none of other HDUs."""
    sizes = hdu.shape[::-1] if hdu.is_image and hdu.shape else ()
    return [n for n in sizes if n > 1] if 0 not in sizes else []


def _told(hdu: Any) -> str:
    sizes = " x ".join(str(n) for n in _long_axes(hdu))
    return f"{hdu.name}, {sizes}" if hdu.name else sizes
