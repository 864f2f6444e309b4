"""A model of a frame's time: from what one thread takes for each voxel, packet and pixel to what a cluster takes.

Walking, splatting and sending overlap, so that a frame takes as long as the slowest of them. To that are added the
image's way to the client, the client's own work for each server, and what every frame costs. Between machines batches
are coded if that is sooner.
"""

from __future__ import annotations

from dataclasses import dataclass

from volsplat.protocol.rules.packet_layout import SHADED_PACKET_BYTES

RUN_SHARE = 0.15  # of a batch's bytes beside its packets: the directory of row runs
BITS = 8
PIXEL_BYTES = 0.6  # of an image that is only looked at, as it goes over a link

# Seconds of the client for each server of a frame, which it tells one after another, and hears so. Those of the fewest
# are in what every frame costs (docs/how_it_works/performance.md).
TELLING = 0.12e-3
FEWEST_SERVERS = 3

# Of coded batches (docs/how_it_works/performance.md): what is left of the bytes, and a thread's seconds for each.
CODED_SHARE = 0.45
CODING, DECODING = 1e-9, 0.65e-9


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

    @property
    def more_servers(self) -> int:
        """Than the fewest."""
        return max(0, self.workers + self.splat_servers - FEWEST_SERVERS)


@dataclass(frozen=True)
class Prediction:
    seconds: float
    limit: str  # what takes longest


def predicted(load: Load, rates: Rates, cluster: Cluster) -> Prediction:
    """A frame's time, and what limits it."""
    ways = [False] if cluster.bits_per_second is None else [False, True]
    return min((_predicted(load, rates, cluster, coded) for coded in ways), key=lambda way: way.seconds)


def _predicted(load: Load, rates: Rates, cluster: Cluster, coded: bool) -> Prediction:
    sent = 1 + load.twice(cluster.regions)
    walking = load.voxels * rates.voxel + load.packets * sent * rates.packet
    splatting = load.packets * sent * rates.splat + load.pixels * rates.pixel
    if coded:
        walking += load.batch_bytes * sent * CODING
        splatting += load.batch_bytes * sent * DECODING
    parts = {
        "walking": walking / (cluster.workers * cluster.walkers),
        "splatting": splatting / cluster.regions,
        **_shared(load, rates, cluster, walking + splatting, CODED_SHARE if coded else 1.0),
    }
    slowest = max(parts, key=lambda part: parts[part])
    image = load.image_bytes * BITS / cluster.bits_per_second if cluster.bits_per_second else 0.0
    in_turn = {slowest: parts[slowest], "the image's way": image, "the client": cluster.more_servers * TELLING}
    limit = max(in_turn, key=lambda part: in_turn[part])
    return Prediction(sum(in_turn.values()) + rates.frame, limit)


def _shared(load: Load, rates: Rates, cluster: Cluster, processor: float, share: float) -> dict[str, float]:
    """What servers of one machine, or packets on the links, share."""
    if cluster.bits_per_second is None:
        return {"cores": (processor + load.batch_bytes * rates.byte) / cluster.cores}
    on_links = share * load.batch_bytes * (1 + load.twice(cluster.splat_servers)) * BITS / cluster.bits_per_second
    return {
        "links into splat servers": on_links / cluster.splat_servers,
        "links of workers": on_links / cluster.workers,
    }
