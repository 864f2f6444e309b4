"""Who gets which part of the volume when servers are lost or join."""

from collections.abc import Mapping, Sequence
from itertools import combinations

from volsplat.client.coordinator.shares.sub_cubes import divided, divided_box
from volsplat.protocol.description.volume import Box, Geometry, Index

Boxes = dict[int, list[Box]]  # by map/shade server


def taken_over(
    missing: Sequence[Box], held: Mapping[int, list[Box]], newcomers: Sequence[int], geometry: Geometry, chunk: Index
) -> Boxes:
    """What is missing goes to the newcomers, or else to all in equal parts; what is held stays where it is."""
    boxes = {server: list(boxes) for server, boxes in held.items()}
    for lost in missing:
        heirs = sorted(newcomers or held, key=lambda server: sum(box.voxels for box in boxes.get(server, ())))
        for heir, part in zip(heirs, divided_box(geometry, lost, len(heirs), chunk), strict=False):
            boxes[heir] = _joined([*boxes.get(heir, ()), part])
    return boxes


def shared_anew(
    held: Mapping[int, list[Box]], newcomers: Sequence[int], geometry: Geometry, chunk: Index
) -> Boxes | None:
    """All of the volume among all; None if it has too few voxels."""
    servers = [*held, *newcomers]
    if len(servers) > geometry.box.voxels:
        return None
    return {server: [box] for server, box in zip(servers, divided(geometry, len(servers), chunk), strict=True)}


def _joined(boxes: list[Box]) -> list[Box]:
    """With boxes that make up a larger one as that."""
    for one, other in combinations(boxes, 2):
        i0, j0, k0 = map(min, one.low, other.low)
        i1, j1, k1 = map(max, one.high, other.high)
        both = Box((i0, j0, k0), (i1, j1, k1))
        if both.voxels == one.voxels + other.voxels:
            return _joined([both, *(box for box in boxes if box not in (one, other))])
    return boxes
