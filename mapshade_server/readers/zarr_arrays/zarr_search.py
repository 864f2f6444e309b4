"""Which array of a Zarr hierarchy is meant: by path, as a level of an image's pyramid, or the only one there is."""

from collections.abc import Iterable, Iterator
from contextlib import suppress
from typing import Any, NamedTuple

from volsplat.mapshade_server.readers.arrays.array_part import ArrayPart, array_part
from volsplat.mapshade_server.readers.arrays.array_volume import array_told, choose_one, shown
from volsplat.mapshade_server.readers.reading.natural_order import natural_order
from volsplat.mapshade_server.readers.reading.part_options import listed
from volsplat.mapshade_server.readers.reading.parts import Part
from volsplat.mapshade_server.readers.zarr_arrays.ome_zarr import Multiscale, multiscale_of
from volsplat.mapshade_server.readers.zarr_arrays.zarr_folder import PACKET_STORE
from volsplat.mapshade_server.readers.zarr_arrays.zarr_paths import ZarrPaths
from volsplat.mapshade_server.readers.zarr_arrays.zarr_place import METADATA, MOST_ABOVE, ZarrPlace, folder
from volsplat.protocol.text.errors import BadInput

MOST_NODES = 200  # that are looked at for volumes


class FoundArray(NamedTuple):
    """The array that is meant. `part` has the array's own path; `image` is that of OME-Zarr, None for others."""

    part: ArrayPart
    place: ZarrPlace
    array: Any
    image: Multiscale | None = None
    level: int = 0
    named: bool = True  # not the first level of an image for want of a word


def named_array(part: str, place: ZarrPlace) -> FoundArray:
    """The array that a part of a name means. Raises BadInput if there is none, or several and none is named."""
    paths = ZarrPaths(place)
    try:
        return found_array(array_part(place.name, part, paths.has), place)
    except BadInput:
        if not paths.left_out:
            raise
        return found_array(array_part(place.name, part, ZarrPaths(place, thorough=True).has), place)


def found_array(part: ArrayPart, place: ZarrPlace) -> FoundArray:
    """The array that the part means. Raises BadInput if there is none, or several and none is named."""
    node = place.node(part.path)
    if _is_of_store(part, place, node):
        raise BadInput(
            f"{part.whole}: is of a packet store, which `volsplat prepare` has made: name the store itself, or, to "
            "prepare it anew, the volume that it was made from"
        )
    if node is None:
        return _level_by_number(part, place)
    if not place.is_array(node):
        return _in_group(part, place, node)
    return _level_of_image(part, place) or _level_from_above(part, place) or FoundArray(part, place, node)


def _is_of_store(part: ArrayPart, place: ZarrPlace, node: Any) -> bool:
    """Whether what is named, or a group that holds it, is a packet store, whose arrays are no volumes."""
    words = part.path.split("/") if part.path else []
    holding = (place.node("/".join(words[:depth])) for depth in range(len(words)))
    return any(PACKET_STORE in group.attrs for group in (node, *holding, *_nodes_above(place)) if group is not None)


def _nodes_above(place: ZarrPlace) -> Iterator[Any]:
    """The groups around a folder, from the inside out, as far as they are Zarr and open to this person."""
    if place.above is folder:
        with suppress(Exception):
            for above, _ in place.around():
                yield above.node("")


def _level_by_number(part: ArrayPart, place: ZarrPlace) -> FoundArray:
    """The level that the part's last word numbers, if it is no array's name."""
    path, _, number = part.path.rpartition("/")
    group = place.node(path)
    if group is None and not part.path:
        raise BadInput(
            f"{part.place}: there is no Zarr here, none of {', '.join(METADATA[:3])}; "
            "check the place, and download what is not Zarr first"
        )
    image = None if group is None else multiscale_of(part.whole, group.attrs)
    if image is not None and number.isdecimal() and int(number) < len(image.paths):
        return _level(part, place, path, image, int(number))
    held = f"its levels are 0 to {len(image.paths) - 1}" if image else f"it holds {_all_shown(place)}"
    raise BadInput(f"{part.place}: has no “{part.path}”; {held}")


def _in_group(part: ArrayPart, place: ZarrPlace, group: Any) -> FoundArray:
    """The finest level of the image that the group is, or the only volume in it."""
    image = multiscale_of(part.whole, group.attrs)
    if image is not None:
        return _level(part, place, part.path, image, 0)._replace(named=part.path != "")
    volumes = _volumes(place, part.path, group)
    if not volumes:
        raise BadInput(
            f"{part.whole}: no array with three axes is found in this group; name one, as in {part.place}#PATH"
        )
    if len(volumes) > 1:
        raise choose_one(part, part.whole, volumes)
    return found_array(part._replace(path=volumes[0].part), place)


def _level(part: ArrayPart, place: ZarrPlace, group: str, image: Multiscale, level: int) -> FoundArray:
    chosen = part._replace(path=f"{group}/{image.paths[level]}".strip("/"))
    array = place.node(chosen.path)
    if not place.is_array(array):
        raise BadInput(f"{part.place}: its level {level}, the array “{chosen.path}”, is missing; fetch it again")
    return FoundArray(chosen, place, array, image, level)


def _level_of_image(part: ArrayPart, place: ZarrPlace) -> FoundArray | None:
    """The array that the part names, as a level of the image that one of the groups around it is."""
    words = part.path.split("/") if part.path else []
    for depth in range(len(words) - 1, max(len(words) - 1 - MOST_ABOVE, -1), -1):
        group, path = "/".join(words[:depth]), "/".join(words[depth:])
        if (found := _as_level(part, place, group, path)) is not None:
            return found
    return None


def _level_from_above(part: ArrayPart, place: ZarrPlace) -> FoundArray | None:
    """The array that the place itself is, as a level of an image that begins above the place."""
    if part.path:
        return None
    with suppress(Exception):
        for above, path in place.around():
            if (found := _as_level(ArrayPart(above.name, path, part.options), above, "", path)) is not None:
                return found
    return None


def _as_level(part: ArrayPart, place: ZarrPlace, group: str, path: str) -> FoundArray | None:
    """The array at `path` from the group, if the group is an image that has it as a level."""
    node = place.node(group)
    image = None if node is None else multiscale_of(part.whole, node.attrs)
    level = None if image is None else image.level_at(path)
    return None if image is None or level is None else _level(part, place, group, image, level)


def _all_shown(place: ZarrPlace) -> str:
    return listed(shown(_volumes(place, "", None)), "no volume that could be listed")


def _volumes(place: ZarrPlace, path: str, group: Any) -> list[Part]:
    """The images, and the arrays with three axes or more, in a group and its groups, level by level."""
    found: list[Part] = []
    waiting = [(path, place.node(path) if group is None else group)]
    for _ in range(MOST_NODES):
        if not waiting:
            break
        path, node = waiting.pop(0)
        if place.is_array(node):
            if len(node.shape) >= 3:
                found.append(array_told(path or "an array", node.shape))
        elif node is not None and multiscale_of(path, node.attrs) is not None:
            found.append(Part(path, "an image"))
        elif node is not None:
            members = sorted(_members(node), key=lambda named: natural_order(named[0]))
            waiting += [(f"{path}/{name}".strip("/"), member) for name, member in members]
    return found


def _members(group: Any) -> Iterable[tuple[str, Any]]:
    """What is in a group; nothing if its store cannot list it."""
    try:
        return list(group.members())
    except (NotImplementedError, OSError, ValueError):
        return []
