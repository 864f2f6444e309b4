"""The walk that a frame takes through a server's sub-cubes."""

from collections.abc import Sequence

from volsplat.mapshade_server import _kernels
from volsplat.mapshade_server.frame_walk import FrameWalk
from volsplat.mapshade_server.slab_walk import SlabWalk
from volsplat.mapshade_server.sub_cube import SubCube
from volsplat.protocol.messages.frame_messages import RenderFrame

Walk = FrameWalk | SlabWalk


def walk_of(
    request: RenderFrame, sub_cubes: Sequence[SubCube], closed_tiles: "_kernels.Array | None", walkers: int
) -> Walk:
    """By so many walkers. See FrameWalk for `closed_tiles`."""
    plan = request.plan
    if plan.slabs is not None:
        return SlabWalk(
            sub_cubes, request.geometry, request.shading, plan, plan.slabs, closed_tiles, request.regions, walkers
        )
    return FrameWalk(
        sub_cubes,
        request.geometry,
        request.quantisation,
        request.shading,
        plan,
        closed_tiles,
        request.regions,
        walkers,
    )
