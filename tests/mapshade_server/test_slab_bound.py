"""What step G may need of a sub-cube is reckoned by blocks: never less than what it takes, and little of little."""

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from support.scenes.shaded_packets import all_batches
from volsplat.client.scene.presets import preset_scene
from volsplat.mapshade_server.frames.frame_walk import FrameWalk
from volsplat.mapshade_server.frames.slab_bound import most_needed
from volsplat.mapshade_server.held.block_densities import BLOCK
from volsplat.mapshade_server.held.sub_cube import SubCube
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.volume import Box, Geometry
from volsplat.protocol.messages.drawing import Drawing
from volsplat.protocol.rules.index_rules import Quantisation
from volsplat.protocol.rules.levels import own_resolution

DIMS = (70, 61, 53)  # no whole blocks
WHOLE, PART = Geometry(DIMS).box, Box((8, 0, 16), (62, 61, 53))


def reckoned_and_taken(values: NDArray[Any], box: Box) -> tuple[int, int]:
    geometry, quantisation = Geometry(DIMS), Quantisation((0.0, 255.0), 100.0)
    cube = SubCube.of_volume(geometry, values, box)
    cube.pack(quantisation)
    drawing = Drawing.planned(preset_scene("ct-skin"), Step.G, geometry, quantisation, own_resolution(geometry, Step.G))
    assert drawing.plan.slabs is not None
    taken = sum(batch.packet_count for batch in all_batches(FrameWalk([cube], drawing)))
    return most_needed(cube.block_densities, box, drawing, drawing.plan.slabs), taken


@pytest.mark.parametrize("box", [WHOLE, PART], ids=["whole", "part"])
@pytest.mark.parametrize("seed", range(6))
def test_no_more_is_taken_than_is_reckoned(seed: int, box: Box) -> None:
    random = np.random.default_rng(seed)
    values = random.integers(0, random.choice([1, 8, 40]), DIMS[::-1]).astype(np.float32)
    for value in (*random.integers(100, 256, 2), np.nan):
        (k, j, i), side = BLOCK * random.integers(0, 5, 3), BLOCK * random.integers(1, 3)  # filled to the blocks' ends
        values[k : k + side, j : j + side, i : i + side] = value
    reckoned, taken = reckoned_and_taken(values, box)
    assert taken <= reckoned <= box.voxels


def test_of_a_small_thing_little_is_reckoned() -> None:
    values = np.zeros(DIMS[::-1], np.uint8)
    assert reckoned_and_taken(values, WHOLE) == (0, 0)
    values[24:32, 24:32, 24:32] = 200
    reckoned, taken = reckoned_and_taken(values, WHOLE)
    assert 0 < taken <= reckoned < WHOLE.voxels / 3
