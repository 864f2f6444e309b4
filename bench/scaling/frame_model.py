"""A model of a frame's time: from what one thread takes for each voxel, packet and pixel to what a cluster takes.

Walking, splatting and sending overlap, so that a frame takes as long as the slowest of them; what follows is the
image's way to the client, and what every frame costs. The constants are fitted to frames of one thread, and to those of
the fewest servers what servers cost beyond.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from volsplat.client.session.frame_report import StepReport
from volsplat.protocol.rules.closed_tiles import TILE_SIDE
from volsplat.protocol.rules.packet_layout import SHADED_PACKET_BYTES

RUN_SHARE = 0.15  # of a batch's bytes beside its packets: the directory of row runs
BITS = 8


@dataclass(frozen=True)
class Load:
    """What is drawn in a frame."""

    voxels: float  # visited
    packets: float  # sent if there is one region
    pixels: float  # combined
    footprint_lines: float  # that a packet reaches
    lines: float  # of the image that the volume covers
    image_bytes: float  # as they are sent

    @property
    def batch_bytes(self) -> float:
        return self.packets * SHADED_PACKET_BYTES * (1 + RUN_SHARE)

    def twice(self, regions: int) -> float:
        """The part of the packets that reach two regions."""
        return min(1.0, (regions - 1) * self.footprint_lines / self.lines)


@dataclass(frozen=True)
class Rates:
    """Seconds of one thread."""

    voxel: float  # visited
    packet: float  # shaded
    splat: float  # decoded and placed
    pixel: float  # combined
    frame: float  # of every frame, whatever is drawn
    byte: float = 0.0  # of packets, handed over to another process of the machine


@dataclass(frozen=True)
class Cluster:
    """What draws. Without a link everything runs on one machine."""

    workers: int
    walkers: int  # threads of each
    splat_servers: int
    owners: int  # threads of each
    cores: int  # of each machine
    bits_per_second: float | None = None  # of each machine's link; servers have a machine each

    @property
    def regions(self) -> int:
        return self.splat_servers * self.owners


@dataclass(frozen=True)
class Prediction:
    seconds: float
    limit: str  # what takes longest


def predicted(load: Load, rates: Rates, cluster: Cluster) -> Prediction:
    """A frame's time, and what limits it."""
    sent = 1 + load.twice(cluster.regions)
    walking = load.voxels * rates.voxel + load.packets * sent * rates.packet
    splatting = load.packets * sent * rates.splat + load.pixels * rates.pixel
    parts = {
        "walking": walking / (cluster.workers * cluster.walkers),
        "splatting": splatting / cluster.regions,
        **_shared(load, rates, cluster, walking + splatting),
    }
    limit = max(parts, key=lambda part: parts[part])
    image = load.image_bytes * BITS / cluster.bits_per_second if cluster.bits_per_second else 0.0
    seconds = parts[limit] + image + rates.frame
    return Prediction(seconds, "the image's way" if image > parts[limit] else limit)


def _shared(load: Load, rates: Rates, cluster: Cluster, processor: float) -> dict[str, float]:
    """What servers of one machine, or packets on the links, share."""
    if cluster.bits_per_second is None:
        return {"cores": (processor + load.batch_bytes * rates.byte) / cluster.cores}
    on_links = load.batch_bytes * (1 + load.twice(cluster.splat_servers)) * BITS / cluster.bits_per_second
    return {
        "links into splat servers": on_links / cluster.splat_servers,
        "links of workers": on_links / cluster.workers,
    }


def load_of(report: StepReport) -> Load:
    """What a frame drew, by its report."""
    work = [line for splat in report.splat_servers.values() for line in splat.work]
    pixels = float(sum(work))
    return Load(
        voxels=report.voxels_visited,
        packets=report.packets_sent,
        pixels=pixels,
        footprint_lines=math.sqrt(pixels / max(report.packets_sent, 1)),
        lines=max(1, TILE_SIDE * sum(line > 0 for line in work)),
        image_bytes=report.image_bytes,
    )


def fitted(reports: Sequence[StepReport]) -> Rates:
    """The constants of a machine, by frames of one thread that differ in voxels, packets and pixels.

    Differences count by their share of a frame, so that small frames say as much as large ones.
    """
    voxel, packet = _least_squares((r.voxels_visited, r.packets_sent, r.map_shade_seconds) for r in reports)
    splat, pixel = _least_squares(
        (r.packets_sent, load_of(r).pixels, r.merge_seconds + r.splat_seconds) for r in reports
    )
    rest = [r.wall_seconds - r.map_shade_seconds - r.merge_seconds - r.splat_seconds for r in reports]
    return Rates(voxel, packet, splat, pixel, frame=max(0.0, statistics.median(rest)))


def with_servers(rates: Rates, frames: Iterable[tuple[Load, Cluster, float]]) -> Rates:
    """What servers cost beyond: each byte that is handed over, and each frame. Frames come with their seconds."""
    rows = []
    for load, cluster, seconds in frames:
        alone = predicted(load, replace(rates, frame=0.0, byte=0.0), cluster).seconds
        rows.append((load.batch_bytes / cluster.cores, seconds - alone, seconds))
    byte, frame = _least_squares(((handed / over, 1 / over, 1.0) for handed, over, _ in rows if over > 0))
    return replace(rates, byte=byte, frame=frame)


def _least_squares(rows: Iterable[tuple[float, float, float]]) -> tuple[float, float]:
    """The two factors, not below 0, that give each row's last number from the others."""
    drawn = np.array([[a / seconds, b / seconds] for a, b, seconds in rows if seconds > 0])
    ones = np.ones(len(drawn))
    first, second = np.linalg.lstsq(drawn, ones, rcond=None)[0]
    if first >= 0 and second >= 0:
        return float(first), float(second)
    alone = 1 if first < 0 else 0
    factor = float(drawn[:, alone] @ ones / (drawn[:, alone] @ drawn[:, alone]))
    return (0.0, factor) if alone else (factor, 0.0)
