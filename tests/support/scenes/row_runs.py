"""Row runs and batches as a map/shade server sends them, made by hand from positions."""

import struct
from collections.abc import Iterable
from dataclasses import dataclass, field, replace

from torch import Tensor

from volsplat.protocol.rules.packet_layout import COLOUR_SHIFT, OPACITY_SHIFT, POSITION_BITS, ROW_RUN

FARTHEST = (1 << POSITION_BITS) - 1


@dataclass(frozen=True)
class Dot:
    """A sample as a shaded packet holds it."""

    x: int  # 1/64 pixel
    y: int
    opacity: int  # code
    colour: tuple[int, int, int]  # 0..255


@dataclass(frozen=True)
class Run:
    sheet: int
    row: int
    first: int
    dots: tuple[Dot, ...] = field(repr=False)

    @property
    def key(self) -> tuple[int, int, int]:
        return (self.sheet, self.row, self.first)

    def packed(self) -> tuple[bytes, bytes]:
        """The run's 24 bytes, and its packets."""
        x0, y0 = min(dot.x for dot in self.dots), min(dot.y for dot in self.dots)
        packets = [
            dot.x - x0
            | (dot.y - y0) << POSITION_BITS
            | dot.opacity << OPACITY_SHIFT
            | (dot.colour[0] | dot.colour[1] << 8 | dot.colour[2] << 16) << COLOUR_SHIFT
            for dot in self.dots
        ]
        run = ROW_RUN.pack(self.sheet, self.row, self.first, len(self.dots), x0, y0)
        return run, struct.pack(f"<{len(packets)}Q", *packets)


def mirrored(runs: list[Run]) -> list[Run]:
    """With x and y exchanged."""
    return [replace(run, dots=tuple(replace(dot, x=dot.y, y=dot.x) for dot in run.dots)) for run in runs]


def batch_bytes(runs: Iterable[Run]) -> tuple[bytes, bytes]:
    """All runs, all packets."""
    packed = [run.packed() for run in runs]
    return b"".join(run for run, _ in packed), b"".join(packets for _, packets in packed)


def runs_of_samples(ordinals: Tensor, lattice: Tensor, opacity: int, colour: tuple[int, int, int]) -> list[Run]:
    """Runs of samples in traversal order, (n, 3) sheet, row, sample and (n, 2) in 1/64 pixel, split where needed."""
    runs: list[list[tuple[tuple[int, int, int], Dot]]] = []
    for (sheet, row, sample), (x, y) in zip(ordinals.tolist(), lattice.tolist(), strict=True):
        dot = Dot(x, y, opacity, colour)
        if runs and runs[-1][-1][0][:2] == (sheet, row):
            dots = [other for _, other in runs[-1]] + [dot]
            spread = (max(d.x for d in dots) - min(d.x for d in dots), max(d.y for d in dots) - min(d.y for d in dots))
            if max(spread) <= FARTHEST:
                runs[-1].append(((sheet, row, sample), dot))
                continue
        runs.append([((sheet, row, sample), dot)])
    return [Run(*run[0][0], tuple(dot for _, dot in run)) for run in runs]
