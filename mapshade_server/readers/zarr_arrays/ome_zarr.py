"""OME-Zarr's metadata (ngff.openmicroscopy.org, versions 0.1 to 0.5): levels of one image, their axes and places."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from volsplat.mapshade_server.readers.arrays.array_grid import LETTERS, ArrayAxis
from volsplat.mapshade_server.readers.arrays.array_part import ArrayPart
from volsplat.protocol.text.errors import BadInput

OLD_AXES = "tczyx"  # of version 0.2 and before, which name none

Json = Mapping[str, Any]


class Multiscale(NamedTuple):
    """One image at several resolutions, the finest first."""

    version: str
    entry: Json  # of the group's `multiscales`
    paths: tuple[str, ...]  # of the levels' arrays, from the group
    channels: tuple[str, ...]  # their names, if they have some
    others: int  # images that the group describes besides

    def level_at(self, path: str) -> int | None:
        return self.paths.index(path) if path in self.paths else None


def multiscale_of(whole: str, attributes: Json) -> Multiscale | None:
    """The image that a group's attributes describe, None if they describe none. Raises BadInput if damaged."""
    ome = attributes.get("ome", attributes)
    if not isinstance(ome, Mapping) or "multiscales" not in ome:
        return None
    try:
        entry, *others = ome["multiscales"]
        paths = tuple(str(dataset["path"]).strip("/") for dataset in entry["datasets"])
        paths[0]
        version = str(ome.get("version") or entry.get("version") or "of unknown version")
    except (AttributeError, IndexError, KeyError, TypeError, ValueError):
        raise _damaged(whole, "multiscales") from None
    return Multiscale(version, entry, paths, _channels(ome), len(others))


def level_axes(part: ArrayPart, image: Multiscale, level: int, shape: Sequence[int]) -> list[ArrayAxis]:
    """The axes of one level's array, in the units and at the places that the image's metadata gives them."""
    steps, firsts = [1.0] * len(shape), [0.0] * len(shape)
    try:
        stated = image.entry.get("axes", OLD_AXES[-len(shape) :])
        transformations = [
            *image.entry["datasets"][level].get("coordinateTransformations", ()),
            *image.entry.get("coordinateTransformations", ()),
        ]
        for one in transformations if "spacing" not in part.options else ():
            _transform(part, one, steps, firsts)
        return [_axis(*axis) for axis in zip(stated, shape, firsts, steps, strict=True)]
    except (AttributeError, KeyError, TypeError, ValueError):
        raise _damaged(part.whole, "axes or coordinateTransformations") from None


def _axis(axis: Any, length: int, first: float, step: float) -> ArrayAxis:
    """Version 0.3 has mere names, later ones have names with types and units."""
    if isinstance(axis, str):
        return ArrayAxis(length, axis, "", first, step, axis if axis in LETTERS else "")
    name = str(axis["name"])
    spatial = axis.get("type", "space") == "space" and name.lower() in tuple(LETTERS)
    return ArrayAxis(length, name, str(axis.get("unit") or ""), first, step, name.lower() if spatial else "")


def _transform(part: ArrayPart, one: Any, steps: list[float], firsts: list[float]) -> None:
    """Applies a transformation to what the indices stand for so far."""
    kind = one["type"]
    if kind == "identity":
        return
    if kind not in ("scale", "translation") or kind not in one:
        raise BadInput(
            f"{part.whole}: is placed by a transformation of type “{kind}”, which volsplat does not know; "
            f"give the spacing yourself, as in {part.advice('spacing=1x1x1')}"
        )
    for n, number in zip(range(len(steps)), one[kind], strict=True):
        if kind == "scale":
            steps[n] *= float(number)
            firsts[n] *= float(number)
        else:
            firsts[n] += float(number)


def _channels(ome: Json) -> tuple[str, ...]:
    """The channels' names as OMERO shows them; they are for people only, so damaged ones are left out."""
    try:
        return tuple(str(channel.get("label", "")) for channel in ome["omero"]["channels"])
    except (AttributeError, KeyError, TypeError):
        return ()


def _damaged(whole: str, what: str) -> BadInput:
    return BadInput(f"{whole}: its OME-Zarr metadata ({what}) cannot be used; check it with an OME-Zarr validator")
