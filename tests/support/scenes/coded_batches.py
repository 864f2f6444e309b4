"""Batches of samples placed by a plan, and their way there and back as coded ones."""

import struct
from collections.abc import Sequence
from dataclasses import dataclass

from support.scenes.row_runs import FARTHEST, Dot, Run, batch_bytes
from volsplat.mapshade_server import _kernels as encoding
from volsplat.mapshade_server.links.shaded_part import ShadedPart
from volsplat.protocol.messages.messages import BatchPart
from volsplat.protocol.rules.frame_plan import FramePlan
from volsplat.protocol.rules.grid_on_screen import FRACTION_BITS, Dda
from volsplat.protocol.rules.packet_layout import ROW_RUN_BYTES, SHADED_PACKET_BYTES, SUBPIXEL_BITS
from volsplat.protocol.rules.sample_lattice import sample_lattice
from volsplat.splat_server import _kernels as decoding

LATTICE_BYTES = 8 * 25


@dataclass(frozen=True)
class Sample:
    ordinals: tuple[int, int, int]  # of sheet, row and sample
    opacity: int
    colour: tuple[int, int, int]


def part_of(runs: bytes, packets: bytes) -> ShadedPart:
    counts = len(runs) // ROW_RUN_BYTES, len(packets) // SHADED_PACKET_BYTES
    return ShadedPart(memoryview(runs), memoryview(packets), *counts)


def placed(samples: Sequence[Sample], plan: FramePlan) -> ShadedPart:
    """A part of the samples, which are in order; a clipped one and one that is too far from the first begin a run."""
    runs: list[Run] = []
    alone = True
    for sample in samples:
        sheet, row, number = sample.ordinals
        dot = Dot(*wire_position(sample.ordinals, plan), sample.opacity, sample.colour)
        clipped = clips(number, plan)
        joins = not (alone or clipped) and (runs[-1].sheet, runs[-1].row) == (sheet, row)
        head = runs[-1].dots[0] if joins else dot
        if joins and max(abs(dot.x - head.x), abs(dot.y - head.y)) <= FARTHEST:
            runs[-1] = Run(sheet, row, runs[-1].first, (*runs[-1].dots, dot))
        else:
            runs.append(Run(sheet, row, number, (dot,)))
        alone = clipped
    return part_of(*batch_bytes(runs))


def wire_position(ordinals: tuple[int, int, int], plan: FramePlan) -> tuple[int, int]:
    doubled = [0, 0, 0]
    for level, ordinal in enumerate(ordinals):
        low, high = plan.visits[plan.traversal.axes[level]].block(grid_ordinal(level, ordinal, plan))
        doubled[plan.traversal.axes[level]] = low + high - 1

    def rounded(on_screen: Dda) -> int:
        unit = 1 << (FRACTION_BITS - SUBPIXEL_BITS)
        added = plan.thresholds.of(ordinals[0]) % unit
        return (on_screen.at_half_indices((doubled[0], doubled[1], doubled[2])) + added) // unit

    return rounded(plan.x), rounded(plan.y)


def grid_ordinal(level: int, ordinal: int, plan: FramePlan) -> int:
    count = plan.visits[plan.traversal.axes[level]].count
    return ordinal if plan.traversal.ascending[level] else count - 1 - ordinal


def clips(number: int, plan: FramePlan) -> bool:
    visits = plan.visits[plan.traversal.axes[2]]
    low, high = visits.block(grid_ordinal(2, number, plan))
    return high - low != visits.stride


def code_of(plan: FramePlan, parts: Sequence[ShadedPart]) -> bytes:
    """What is compressed."""
    encoder = encoding.BatchEncoder(sample_lattice(plan))
    return bytes(encoder.encode([(part.runs, part.packets) for part in parts]))


def bytes_of_code(code: bytes, counts: Sequence[tuple[int, int]]) -> bytes:
    """The payload of a raw batch with so many runs and packets. Raises ValueError."""
    room = bytearray(sum(ROW_RUN_BYTES * runs + SHADED_PACKET_BYTES * packets for runs, packets in counts))
    decoding.decode_batch(code, counts, room)
    return bytes(room)


def raw_bytes(parts: Sequence[ShadedPart]) -> bytes:
    return b"".join(bytes(memory) for part in parts for memory in (part.runs, part.packets))


def counts_of(parts: Sequence[ShadedPart]) -> list[BatchPart]:
    return [BatchPart(part.run_count, part.packet_count) for part in parts]


def number(value: int) -> bytes:
    """As codes have lone numbers: seven bits a byte, the lowest first."""
    more = bytearray()
    while value >= 128:
        more.append(value & 127 | 128)
        value >>= 7
    return bytes(more) + bytes([value])


def written_code(
    lattice: Sequence[int], palette: Sequence[int], opacities: bytes, gaps: bytes, colours: bytes, *numbers: int
) -> bytes:
    """A code by its fields; all numbers stand behind the planes."""
    head = struct.pack(f"<{1 + len(palette)}H", len(palette), *palette) + struct.pack("<25q", *lattice)
    return head + opacities + gaps + colours + b"".join(map(number, numbers))
