"""Regions: the bands of lines that an image is cut into; each has one owner, which alone merges and splats into it.

Lines are those of the frame's plan: rows of the image, or its columns if the plan is turned.
"""

from collections.abc import Sequence
from typing import Annotated, NamedTuple

import msgspec
from msgspec import Meta

from volsplat.protocol.description.scene import LARGEST_EXTENT
from volsplat.protocol.rules.closed_tiles import TILE_SIDE
from volsplat.protocol.rules.frame_plan import FramePlan

MOST_REGIONS = 4096

ServerNumber = Annotated[int, Meta(ge=1, le=2**31 - 1)]
LineNumber = Annotated[int, Meta(ge=0, le=LARGEST_EXTENT)]


class Region(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The lines `begin` to before `end`, owned by a thread of this splat server. It may be empty."""

    server: ServerNumber
    begin: LineNumber
    end: LineNumber


Regions = Annotated[list[Region], Meta(min_length=1, max_length=MOST_REGIONS)]


def check_regions(regions: Sequence[Region], lines: int) -> None:
    """Raises ValueError unless the regions follow each other, cut at tiles, from the first line to the last.

    Those of one server must lie side by side.
    """
    begin, servers = 0, [regions[0].server]
    for region in regions:
        if region.begin != begin or not begin <= region.end <= lines:
            raise ValueError(f"a region of lines {region.begin} to {region.end} cannot follow line {begin} of {lines}")
        if region.end % TILE_SIDE and region.end != lines:
            raise ValueError(f"a region ends at line {region.end}, within a tile")
        if region.server != servers[-1]:
            servers.append(region.server)
        begin = region.end
    if begin != lines:
        raise ValueError(f"the regions end at line {begin} of {lines}")
    if len(set(servers)) != len(servers):
        raise ValueError(f"the regions of a splat server lie apart: {servers}")


def regions_of(regions: Sequence[Region], server: int) -> list[Region]:
    """Those of this server. Raises ValueError if it has none."""
    own = [region for region in regions if region.server == server]
    if not own:
        raise ValueError(f"no region of the frame is of splat server {server}")
    return own


def lines_of(regions: Sequence[Region], server: int) -> tuple[int, int]:
    """From which to before which line this server's regions reach. Raises ValueError if it has none."""
    own = regions_of(regions, server)
    return own[0].begin, own[-1].end


class Rectangle(NamedTuple):
    """A part of the published image, in pixels from its top left corner; it may be empty."""

    left: int
    top: int
    width: int
    height: int


def rectangle_of(plan: FramePlan, lines: tuple[int, int]) -> Rectangle:
    """What lines of the plan are of the published image."""
    begin, end = lines
    if plan.turned:
        return Rectangle(begin, 0, end - begin, plan.width)
    return Rectangle(0, begin, plan.width, end - begin)
