"""What an NRRD header says of its values and volumes: by the keys of 3D Slicer, NA-MIC and volsplat; and colours."""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TypeVar

import msgspec

from volsplat.mapshade_server.readers.reading.part_options import listed
from volsplat.protocol.description.kind import BANDS_KEY, KIND_KEY, Band, Kind
from volsplat.protocol.geometry.matrices import Vector
from volsplat.protocol.text.errors import BadInput

Stated = TypeVar("Stated")

# NA-MIC's convention for diffusion-weighted images.
_DIFFUSION = "DWMRI"
_B_VALUE = "DWMRI_b-value"
_GRADIENT = re.compile(r"DWMRI_gradient_(\d{1,9})")
_SEGMENT = re.compile(r"Segment(\d{1,9})_(?:ID|Name|LabelValue)")

_PLACES = ("domain", "space", "list", "time", "none", "???")  # an axis of these has a voxel at each index
_COLOUR_COUNTS = (3, 4)
_LEAST_PICTURE = 16  # pixels aside: less is no picture, but a volume made to try something


def kind_of(path: Path, pairs: Mapping[str, str], layer: int, layers: int) -> tuple[Kind, str, tuple[Band, ...]]:
    """The kind, what states it, and the classes; segments may overlap, those of each `layer` are a volume.

    Raises BadInput if the keys are damaged.
    """
    try:
        bands = msgspec.json.decode(pairs.get(BANDS_KEY, "[]"), type=tuple[Band, ...])
        if KIND_KEY in pairs:
            return Kind(pairs[KIND_KEY]), f"the key {KIND_KEY} in its header", bands
        if by_layer := _segments(pairs, layers):
            return Kind.LABELS, "the segments in its header", tuple(by_layer.get(layer, ()))
    except (ValueError, msgspec.MsgspecError) as error:
        raise BadInput(
            f"{path}: the header's keys for kind and classes cannot be used ({error}); correct them"
        ) from None
    if _is_diffusion(pairs):
        return Kind.MR, f"modality {_DIFFUSION} in its header", ()
    return Kind.UNKNOWN, "", ()


def _is_diffusion(pairs: Mapping[str, str]) -> bool:
    return pairs.get("modality", "").strip() == _DIFFUSION


def are_volumes(pairs: Mapping[str, str]) -> bool:
    """Whether several numbers a voxel are those of several volumes, whatever the kind of their axis."""
    return _is_diffusion(pairs) or any(map(_SEGMENT.fullmatch, pairs))


def volume_names(pairs: Mapping[str, str], count: int) -> list[str]:
    """What tells so many volumes apart, empty where nothing does: as 3D Slicer has them, gradients or segments."""
    if _is_diffusion(pairs):
        return _diffusion_names(pairs, count)
    try:
        by_layer = _segments(pairs, count)
    except (ValueError, msgspec.MsgspecError):  # whoever opens one of them is told
        return [""] * count
    return [listed([band.name for band in by_layer.get(layer, ())], "") for layer in range(count)]


def layers_missed(pairs: Mapping[str, str], layers: int) -> tuple[str, ...]:
    """A line on segments of layers beyond the file's, which 3D Slicer leaves out, too."""
    if KIND_KEY in pairs or not (
        missed := {layer: bands for layer, bands in _segments(pairs, layers).items() if not 0 <= layer < layers}
    ):
        return ()
    names = listed([band.name for bands in missed.values() for band in bands], "")
    stated, has = ", ".join(map(str, sorted(missed))), "layer 0 alone" if layers == 1 else f"layers 0 to {layers - 1}"
    return (f"the segments {names} are left out: they belong to layer {stated}, but the file has {has}",)


def _segments(pairs: Mapping[str, str], layers: int) -> dict[int, list[Band]]:
    """By their layers. One that states none has a layer of its own, if there are several."""
    found: dict[int, list[Band]] = {}
    for number in dict.fromkeys(match[1] for key in pairs if (match := _SEGMENT.fullmatch(key))):
        layer = _stated(pairs, f"Segment{number}_Layer", int, "a whole number", int(number) if layers > 1 else 0)
        found.setdefault(layer, []).append(_segment(pairs, number))
    return found


def _segment(pairs: Mapping[str, str], number: str) -> Band:
    """A segment as 3D Slicer writes it: its name, its value, its colour as three numbers."""
    value = _stated(pairs, f"Segment{number}_LabelValue", float, "a number", 1.0)
    colour = _stated(pairs, f"Segment{number}_Color", _floats, "three numbers", list[float]())
    known = (colour[0], colour[1], colour[2]) if len(colour) == 3 else None
    name = pairs.get(f"Segment{number}_Name") or pairs.get(f"Segment{number}_ID") or f"segment {number}"
    return Band(name, value, value, known)


def _stated(pairs: Mapping[str, str], key: str, read: Callable[[str], Stated], what: str, otherwise: Stated) -> Stated:
    """What a key states. Raises ValueError, which names it, if that is not what it should be."""
    try:
        return read(pairs[key]) if key in pairs else otherwise
    except ValueError:
        raise ValueError(f"{key} should be {what}, not “{pairs[key]}”") from None


def _floats(words: str) -> list[float]:
    return [float(word) for word in words.split()]


def _diffusion_names(pairs: Mapping[str, str], count: int) -> list[str]:
    """The longest gradient has the stated b-value, a shorter one as much less as its square is."""
    gradients, b_value = _gradients(pairs, count), _numbers(pairs.get(_B_VALUE, ""), 1)
    longest = max((math.hypot(*gradient) for gradient in gradients.values()), default=0.0)
    names = []
    for n in range(count):
        if (gradient := gradients.get(n)) is None:
            names.append("")
        elif (length := math.hypot(*gradient)) == 0.0:
            names.append("baseline")
        else:
            along = ", ".join(f"{component / length + 0.0:.3g}" for component in gradient)
            b_told = [f"b = {b_value[0] * (length / longest) ** 2:.4g}"] if b_value else []
            names.append(", ".join([*b_told, f"gradient ({along})"]))
    return names


def _gradients(pairs: Mapping[str, str], count: int) -> dict[int, Vector]:
    """By the volume's number: of those that are stated, for one volume or some in a row."""
    stated = [match for key in pairs if (match := _GRADIENT.fullmatch(key))]
    found: dict[int, Vector] = {}
    for match in stated:
        numbers, (times,) = _numbers(pairs[match[0]], 3), _numbers(pairs.get(f"DWMRI_NEX_{match[1]}", ""), 1) or (1.0,)
        first = int(match[1])
        for n in range(first, int(min(first + times, count))) if numbers else ():
            found[n] = (numbers[0], numbers[1], numbers[2])
    return found


def _numbers(words: str, count: int) -> list[float]:
    """None if they are not so many, of a length: some scanners state no gradients."""
    try:
        numbers = _floats(words)
    except ValueError:
        return []
    return numbers if len(numbers) == count and math.isfinite(math.hypot(*numbers)) else []


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
