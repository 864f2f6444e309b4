"""Room for the voxels that step G keeps is asked for by what frames before leave, however they have ended."""

from pathlib import Path

import msgspec
import numpy as np
import pytest

from support.scenes.arbitrary import plain_scene
from volsplat.mapshade_server.frames.slab_bound import most_needed
from volsplat.mapshade_server.held.memory_budget import LIST_BYTES, MemoryBudget, bytes_to_walk_slabs
from volsplat.mapshade_server.held_volume import HeldVolume
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Reconstruction, SlabKernel
from volsplat.protocol.description.shading_tables import ScalarTable
from volsplat.protocol.description.volume import Box, Geometry
from volsplat.protocol.messages import messages
from volsplat.protocol.messages.drawing import Drawing
from volsplat.protocol.rules.index_rules import Quantisation
from volsplat.protocol.rules.levels import own_resolution
from volsplat.protocol.rules.packet_layout import VOXEL_PACKET_BYTES
from volsplat.protocol.text.errors import NoRoom

GEOMETRY = Geometry((32, 32, 128))
LOWER, UPPER = Box((0, 0, 0), (32, 32, 64)), Box((0, 0, 64), (32, 32, 128))
QUANTISATION = Quantisation((0.0, 255.0), 100.0)


def held_with(budget: MemoryBudget, folder: Path) -> HeldVolume:
    """Both halves. In the lower one there is something of 100 in 0, in the upper one something of 200 in 150."""
    path, values = folder / "halves.npy", np.zeros(GEOMETRY.dims[::-1], np.uint8)
    values[64:] = 150
    values[8:24, 8:24, 8:24], values[104:120, 8:24, 8:24] = 100, 200
    np.save(path, values)
    held = HeldVolume(budget)
    (described,) = held.answers(messages.DescribeVolume(str(path)))
    assert isinstance(described.message, messages.VolumeDescribed)
    held.answers(messages.ReadSubCubes(1, str(path), [LOWER, UPPER], described.message.identity))
    held.answers(messages.PackVoxels(1, QUANTISATION))
    return held


def drawing_of(*shown: int) -> Drawing:
    """What shows these densities alone: the kernel's weights are all above 0, so that no others are brought to them."""
    opac = ScalarTable(points=tuple(point for value in shown for point in peak(value)))
    scene = plain_scene(reconstruction=Reconstruction(slab_kernel=SlabKernel.KAISER_BESSEL))
    scene = msgspec.structs.replace(scene, tables=msgspec.structs.replace(scene.tables, opac=opac))
    return Drawing.planned(scene, Step.G, GEOMETRY, QUANTISATION, own_resolution(GEOMETRY, Step.G))


def peak(value: int) -> list[tuple[float, float]]:
    steps = ((-11, 0.0), (-10, 1.0), (10, 1.0), (11, 0.0))
    return [((value + aside) / 255, opacity) for aside, opacity in steps]


def room_of(held: HeldVolume, drawing: Drawing) -> int:
    slabs = drawing.plan.slabs
    assert slabs is not None
    return sum(
        bytes_to_walk_slabs(cube.box, most_needed(cube.block_densities, cube.box, drawing, slabs))
        for cube in held.sub_cubes(0)
    )


def test_what_one_sub_cube_kept_for_a_frame_is_free_for_another_in_the_next(tmp_path: Path) -> None:
    """Also if that frame was aborted before anything was kept."""
    lower, upper, both = drawing_of(100), drawing_of(200), drawing_of(100, 200)
    large = held_with(MemoryBudget(), tmp_path)
    room = max(room_of(large, lower), room_of(large, upper))
    assert room < room_of(large, both)
    packets = sum(VOXEL_PACKET_BYTES * box.voxels + int(LIST_BYTES * box.voxels) for box in (LOWER, UPPER))
    held = held_with(MemoryBudget(limit=packets + room), tmp_path)
    for drawing in (lower, upper, lower):
        with held.room_to_walk(drawing, held.sub_cubes(0)):
            pass
        with pytest.raises(NoRoom), held.room_to_walk(both, held.sub_cubes(0)):
            pass


def test_what_a_frame_took_that_ended_by_an_error_is_not_asked_for_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    held, drawing = held_with(MemoryBudget(), tmp_path), drawing_of(100)
    left = room_of(held, drawing)
    monkeypatch.setattr("volsplat.mapshade_server.held.memory_budget.available_memory", lambda: left)
    with pytest.raises(OSError, match="no splat server"), held.room_to_walk(drawing, held.sub_cubes(0)):
        left = 0
        raise OSError("no splat server is left")
    with held.room_to_walk(drawing, held.sub_cubes(0)):
        pass
    with pytest.raises(NoRoom), held.room_to_walk(drawing_of(100, 200), held.sub_cubes(0)):
        pass
