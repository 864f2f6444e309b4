"""Takes batches of shaded packets apart, by the bits that packet_layout states."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import torch
from torch import Tensor

from volsplat.mapshade_server._kernels import Batch, Walker
from volsplat.mapshade_server.frames.frame_walk import DEFAULT_PACKETS, DEFAULT_VOXELS, FrameWalk
from volsplat.mapshade_server.links.shaded_part import parts_of
from volsplat.protocol.rules.packet_layout import COLOUR_SHIFT, OPACITY_SHIFT, POSITION_BITS, ROW_RUN_BYTES

OFFSETS = 1 << POSITION_BITS


@dataclass(frozen=True)
class Packets:
    """n shaded packets, int64."""

    keys: Tensor  # (n, 2) sheet and row
    position: Tensor  # (n, 2) x and y in 1/64 pixel
    opacity: Tensor  # (n,) codes
    colour: Tensor  # (n, 3) 0..255

    def rows(self) -> list[list[int]]:
        """One list of numbers for each packet: what must be equal for two walks to be equal."""
        return torch.cat((self.keys, self.position, self.opacity[:, None], self.colour), dim=1).tolist()


@dataclass(frozen=True)
class Runs:
    """n row runs, int64."""

    keys: Tensor  # (n, 3) sheet, row, first
    count: Tensor
    origin: Tensor  # (n, 2)


def all_batches(walk: FrameWalk, max_packets: int = DEFAULT_PACKETS, max_voxels: int = DEFAULT_VOXELS) -> list[Batch]:
    """The batches of a whole frame with one walker; they share no memory."""
    [walker] = walk.walkers
    return list(batches_of(walker, max_packets, max_voxels))


def batches_of(walker: Walker, max_packets: int = DEFAULT_PACKETS, max_voxels: int = DEFAULT_VOXELS) -> Iterator[Batch]:
    last = False
    while not last:
        batch = walker.next_batch(max_packets, max_voxels)
        last = batch.last
        yield batch


def runs_of(batches: Iterable[Batch], region: int = 0) -> Runs:
    data = b"".join(parts_of(batch)[region].runs for batch in batches)
    numbers = torch.tensor(list(memoryview(data).cast("i")), dtype=torch.int64).reshape(-1, ROW_RUN_BYTES // 4)
    return Runs(keys=numbers[:, :3], count=numbers[:, 3], origin=numbers[:, 4:])


def packets_of(batches: list[Batch], region: int = 0) -> Packets:
    runs = runs_of(batches, region)
    data = b"".join(parts_of(batch)[region].packets for batch in batches)
    packet = torch.tensor(list(memoryview(data).cast("q")), dtype=torch.int64)
    offset = torch.stack((packet % OFFSETS, packet >> POSITION_BITS & (OFFSETS - 1)), dim=1)
    colour = torch.stack([packet >> shift & 255 for shift in range(COLOUR_SHIFT, 64, 8)], dim=1)
    return Packets(
        keys=runs.keys[:, :2].repeat_interleave(runs.count, dim=0),
        position=runs.origin.repeat_interleave(runs.count, dim=0) + offset,
        opacity=packet >> OPACITY_SHIFT & 0xFFF,
        colour=colour,
    )
