"""The constants of the model of a frame's time (deploy/frame_model.py), fitted to frames that were drawn.

Those of a thread to frames of one thread, and to those of the fewest servers what servers cost beyond.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from volsplat.client.session.frame_report import StepReport
from volsplat.deploy.frame_model import Cluster, Load, Rates, predicted
from volsplat.protocol.rules.closed_tiles import TILE_SIDE


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
