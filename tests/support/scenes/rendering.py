"""Renders a volume in memory by the programs' own stages, in one process and without sockets."""

import functools
from collections.abc import Sequence
from itertools import pairwise
from random import Random

import numpy as np
import torch
from torch import Tensor

from reference import mapping
from support.scenes.owned import even_regions, owners, wait_until_complete
from support.scenes.phantoms import QUANTISATION
from volsplat.client.coordinator.block_depths import BlockDepths, need_depths
from volsplat.mapshade_server.answers.voxel_answers import VoxelAnswers
from volsplat.mapshade_server.frames.frame_walk import FrameWalk
from volsplat.mapshade_server.held.sub_cube import SubCube
from volsplat.mapshade_server.links.shaded_part import ShadedPart, parts_of
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.volume import Box, Geometry
from volsplat.protocol.messages import messages
from volsplat.protocol.messages.drawing import Drawing
from volsplat.protocol.rules.closed_tiles import TILE_SIDE
from volsplat.protocol.rules.footprint_shape import FootprintShape, footprint_shape
from volsplat.protocol.rules.frame_plan import plan_frame
from volsplat.protocol.rules.grid_on_screen import grid_on_screen
from volsplat.protocol.rules.index_rules import Quantisation
from volsplat.protocol.rules.levels import Resolution, own_resolution
from volsplat.protocol.rules.packet_layout import SUBPIXEL_BITS
from volsplat.protocol.rules.regions import Region
from volsplat.splat_server._kernels import BatchMemory, Bell, ReadBudget
from volsplat.splat_server.footprint_table import footprint_table
from volsplat.splat_server.frame_assembly import FrameAssembly
from volsplat.splat_server.slabs import slabs_of


def rendered(
    values: Tensor,
    geometry: Geometry,
    scene: Scene,
    step: Step,
    quantisation: Quantisation = QUANTISATION,
    workers: Sequence[Sequence[Box]] | None = None,
    max_packets: int = 1 << 15,
    max_voxels: int = 1 << 20,
    threads: int = 1,
    walkers: int | None = 1,
    arrival: Random | None = None,
    resolution: Resolution | None = None,
) -> Tensor:
    """The image (H, W, 4) float32, associated alpha, of values (k, j, i); they are those of the resolution's level.

    `workers` are the boxes that each worker holds: together they partition the grid; each has as many `walkers`. Every
    one of the `threads` owns a region. `arrival` shuffles whose batch comes next, and cuts any regions; else one walker
    after the other delivers. Without `walkers` each region has its own, as in a single process.
    """
    held = resolution.geometry if resolution else geometry
    holdings = workers or [[held.box]]
    drawing = Drawing.planned(scene, step, geometry, quantisation, resolution or own_resolution(geometry, step))
    plan = drawing.plan
    regions = _regions(plan.height, threads, arrival)
    request = messages.RenderFrame(1, 1, drawing, {1: walkers or 1}, regions, exact=True)
    held_by = [[SubCube.of_volume(held, values, box) for box in boxes] for boxes in holdings]
    for sub_cubes in held_by:
        for sub_cube in sub_cubes:
            sub_cube.pack(quantisation)
    request = _lit(request, scene, held_by)
    news = Bell()
    if walkers is None:
        with owners(threads) as made:
            assembly = FrameAssembly(made, plan, 1, slabs_of(request))
            everything, tiles = [sub_cube for sub_cubes in held_by for sub_cube in sub_cubes], assembly.closed_tiles
            walk = FrameWalk(everything, drawing, tiles, regions, walkers)
            assembly.begin(regions, 0, news, walks=walk.walkers)
            wait_until_complete(assembly.splat, news)
            return _image(assembly)
    walks = []
    for sub_cubes in held_by:
        walks += FrameWalk(sub_cubes, drawing, None, regions, walkers).walkers
    budget = ReadBudget(1 << 62, news)
    with owners(threads) as made:
        assembly = FrameAssembly(made, plan, 1, slabs_of(request))
        assembly.begin(regions, len(walks), news)
        delivering = list(range(len(walks)))
        while delivering:
            source = arrival.choice(delivering) if arrival else delivering[0]
            batch = walks[source].next_batch(max_packets, max_voxels)
            if batch.last:
                delivering.remove(source)
            assembly.splat.push(source, batch_memory(parts_of(batch), budget), *batch.reached, batch.last)
        wait_until_complete(assembly.splat, news)
        return _image(assembly)


def _image(assembly: FrameAssembly) -> Tensor:
    width, height = assembly.plan.image_size
    return torch.frombuffer(bytearray(assembly.published()), dtype=torch.float32).reshape(height, width, 4)


def _lit(request: messages.RenderFrame, scene: Scene, held_by: Sequence[Sequence[SubCube]]) -> messages.RenderFrame:
    """With what dims its light, by what each worker holds."""
    depths = BlockDepths()
    if not need_depths(scene, request.drawing.plan.step):
        return request
    for worker, asked in depths.ask(request, range(1, len(held_by) + 1)):
        answer = VoxelAnswers(held_by[worker - 1]).answer(asked)
        assert isinstance(answer.message, messages.DepthsSummed)
        depths.take(worker, answer.message, answer.whole_payload)
    return depths.dimmed(request, scene.light)


def _regions(lines: int, threads: int, arrival: Random | None) -> list[Region]:
    """One for each thread; or any, some of them empty."""
    if arrival is None:
        return [Region(1, *ends) for ends in even_regions(lines, threads)]
    inner = sorted(arrival.randrange(0, lines, TILE_SIDE) for _ in range(arrival.randrange(2 * threads)))
    return [Region(1, *ends) for ends in pairwise([0, *inner, lines])]


def batch_memory(parts: Sequence[ShadedPart], budget: ReadBudget) -> BatchMemory:
    payload = b"".join(memory for part in parts for memory in (part.runs, part.packets))
    return BatchMemory(payload, [(part.run_count, part.packet_count) for part in parts], budget)


class TableWeights:
    """The splat server's own footprint table, as the reference takes it (reference.render.Weights)."""

    def __init__(self, scene: Scene, geometry: Geometry, step: Step, resolution: Resolution | None = None) -> None:
        strides = plan_frame(scene, geometry, step, resolution).strides
        shape = footprint_shape(grid_on_screen(scene, geometry), strides, scene.reconstruction)
        self.offset_bits, self.starts, self.boxes = _table(shape)

    def __call__(self, samples: mapping.Samples, pixel_x: Tensor, pixel_y: Tensor) -> Tensor:
        shift = SUBPIXEL_BITS - self.offset_bits
        rounded = (samples.lattice + (samples.thresholds[:, None] << shift >> 32)) >> shift
        whole, part = rounded >> self.offset_bits, rounded & ((1 << self.offset_bits) - 1)
        entry = (part[:, 1] << self.offset_bits) + part[:, 0]
        column = pixel_x - whole[:, :1] - self.starts[entry, 0][:, None]
        row = pixel_y - whole[:, 1:] - self.starts[entry, 1][:, None]
        height, width = self.boxes.shape[1:]
        inside = ((row >= 0) & (row < height))[:, :, None] & ((column >= 0) & (column < width))[:, None, :]
        row, column = row.clamp(0, height - 1), column.clamp(0, width - 1)
        weights = self.boxes[entry[:, None, None], row[:, :, None], column[:, None, :]]
        return torch.where(inside, weights.double(), 0.0)


@functools.lru_cache(maxsize=4)
def _table(shape: FootprintShape) -> tuple[int, Tensor, Tensor]:
    """The offset bits, the boxes' left and top (entries, 2), and their weights (entries, height, width) float32."""
    table = footprint_table(shape)
    offsets = range(1 << table.offset_bits)
    entries = [table.weights_at(fx, fy) for fy in offsets for fx in offsets]
    starts = torch.tensor([entry[:2] for entry in entries])
    boxes = torch.from_numpy(np.array([entry[2] for entry in entries], np.float32))  # sooner than torch reads lists
    return table.offset_bits, starts, boxes.reshape(-1, table.height, table.width)
