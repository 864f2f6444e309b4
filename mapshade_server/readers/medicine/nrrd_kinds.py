"""What an NRRD header says of the kind of its values: by the keys of 3D Slicer, NA-MIC and volsplat; and colours."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import msgspec

from volsplat.protocol.description.kind import BANDS_KEY, KIND_KEY, Band, Kind
from volsplat.protocol.text.errors import BadInput

# NA-MIC's convention for diffusion-weighted images.
_DIFFUSION = "DWMRI"
_SEGMENT = re.compile(r"Segment(\d+)_LabelValue")

_PLACES = ("domain", "space", "list", "time", "none", "???")  # an axis of these has a voxel at each index
_COLOUR_COUNTS = (3, 4)
_LEAST_PICTURE = 16  # pixels aside: less is no picture, but a volume made to try something


def kind_of(path: Path, pairs: Mapping[str, str], layer: int) -> tuple[Kind, str, tuple[Band, ...]]:
    """The kind, what states it, and the classes; segments may overlap, those of each `layer` are a volume.

    Raises BadInput if the keys are damaged.
    """
    try:
        bands = msgspec.json.decode(pairs.get(BANDS_KEY, "[]"), type=tuple[Band, ...])
        if KIND_KEY in pairs:
            return Kind(pairs[KIND_KEY]), f"the key {KIND_KEY} in its header", bands
        if segments := [match[1] for key in pairs if (match := _SEGMENT.fullmatch(key))]:
            own = [number for number in segments if int(pairs.get(f"Segment{number}_Layer", layer)) == layer]
            return Kind.LABELS, "the segments in its header", tuple(_segment(pairs, number) for number in own)
    except (ValueError, msgspec.MsgspecError) as error:
        raise BadInput(
            f"{path}: the header's keys for kind and classes cannot be used ({error}); correct them"
        ) from None
    if pairs.get("modality", "").strip() == _DIFFUSION:
        return Kind.MR, f"modality {_DIFFUSION} in its header", ()
    return Kind.UNKNOWN, "", ()


def _segment(pairs: Mapping[str, str], number: str) -> Band:
    """A segment as 3D Slicer writes it: its name, its value, its colour as three numbers."""
    value = float(pairs[f"Segment{number}_LabelValue"])
    colour = [float(word) for word in pairs.get(f"Segment{number}_Color", "").split()]
    known = (colour[0], colour[1], colour[2]) if len(colour) == 3 else None
    return Band(pairs.get(f"Segment{number}_Name", f"segment {number}"), value, value, known)


def refuse_flat_colours(path: Path, sizes: Sequence[int], kinds: Sequence[str], placed: bool) -> None:
    """Raises BadInput for a picture: three axes of which one counts colours or other components of a pixel.

    If neither kinds nor directions decide, a first axis of three or four beside two long ones is taken as such.
    """
    if len(sizes) != 3:
        return
    components = [n for n, kind in zip(sizes, kinds, strict=False) if n > 1 and kind not in _PLACES]
    told = len(kinds) == len(sizes) or placed
    guessed = [sizes[0]] if not told and sizes[0] in _COLOUR_COUNTS and min(sizes[1:]) >= _LEAST_PICTURE else []
    if not components and not guessed:
        return
    shown = " x ".join(str(n) for n in sizes)
    cure = "" if components else '; if it is a volume, write "kinds: domain domain domain" into its header'
    raise BadInput(
        f"{path}: a 2-D image of {(components or guessed)[0]} values a pixel, volsplat needs a volume: its size is "
        f"{shown}; give a file with several slices{cure}"
    )
