"""The time line of a frame as SVG: one lane for each server, its stages as bars on one axis.

Servers count the seconds of their stages, not when each began; stages that take turns stand here as one bar each,
in the order in which a frame meets them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from html import escape

from volsplat.client.session.frame_report import SLAB_STAGES, slab_stages
from volsplat.client.session.renderer import StepOutcome
from volsplat.protocol.messages.messages import MapShadeStats, SplatStats

STAGES = ("planning", "map/shade", "merge", "splat", "sending", "waiting")
"""All that a bar can be, in the legend's order; CSS classes are vs-stage-… of these, "/" left out."""

STAGES_OF_SLABS = tuple(one for stage in STAGES for one in (SLAB_STAGES if stage == "splat" else (stage,)))
"""Likewise in step G, whose splatting has stages of its own."""

LANE_HEIGHT = 1.6  # times the font's size, as all that follow
BAR_HEIGHT = 1.0
AXIS_HEIGHT = 1.5
NAMES_WIDTH = 8.5
END_WIDTH = 2.0  # for half of the last tick's label
MOST_TICKS = 8
LEAST_SECONDS = 1e-6  # of an axis, so that it has a scale


@dataclass(frozen=True)
class Bar:
    stage: str  # one of stages_shown
    begin: float  # seconds from the frame's beginning
    end: float


@dataclass(frozen=True)
class Lane:
    name: str
    bars: tuple[Bar, ...]


def lanes_of(outcome: StepOutcome, names: Mapping[int, str]) -> list[Lane]:
    """A lane for each map/shade server, by number, and one for each splat server. `names` are the servers'."""
    map_shade, splat = sorted(outcome.servers.map_shade.items()), sorted(outcome.servers.splat.items())
    lanes = [Lane(names.get(server, f"map/shade {server}"), _in_turn(stages_of(stats))) for server, stats in map_shade]
    return [
        *lanes,
        *(Lane(names.get(server, f"splat server {server}"), _with_image(stats, outcome)) for server, stats in splat),
    ]


def _with_image(stats: SplatStats, outcome: StepOutcome) -> tuple[Bar, ...]:
    """A splat server's stages, and the sending of its part of the image."""
    bars = _in_turn(stages_of(stats))
    image_began = max(bars[-1].end if bars else 0.0, outcome.wall_seconds - outcome.image_seconds)
    return (*bars, Bar("sending", image_began, outcome.wall_seconds)) if image_began < outcome.wall_seconds else bars


def stages_of(stats: MapShadeStats | SplatStats) -> list[tuple[str, float]]:
    """A server's stages and their seconds, in the order in which a frame meets them."""
    if isinstance(stats, MapShadeStats):
        sending = stats.coding_seconds + max(0.0, stats.sending_seconds - stats.waiting_seconds)
        return [
            ("planning", stats.planning_seconds),
            ("map/shade", stats.map_shade_seconds),
            ("sending", sending),
            ("waiting", stats.waiting_seconds),
        ]
    return [
        ("planning", stats.planning_seconds),
        ("waiting", stats.waiting_seconds),
        ("merge", stats.merge_seconds),
        *(slab_stages(stats) or [("splat", stats.splat_seconds)]),
    ]


def stages_shown(outcome: StepOutcome | None) -> tuple[str, ...]:
    """Those of a frame, in the legend's order."""
    slabs = outcome is not None and any(stats.slabs is not None for stats in outcome.servers.splat.values())
    return STAGES_OF_SLABS if slabs else STAGES


def _in_turn(stages: list[tuple[str, float]]) -> tuple[Bar, ...]:
    bars = []
    at = 0.0
    for stage, seconds in stages:
        if seconds > 0:
            bars.append(Bar(stage, at, at + seconds))
            at += seconds
    return tuple(bars)


def axis_seconds(lanes: Iterable[Lane], wall_seconds: float) -> float:
    """How long the axis is: the frame, and longer only if a lane is."""
    return max([LEAST_SECONDS, wall_seconds, *(bar.end for lane in lanes for bar in lane.bars)])


def ticks(seconds: float) -> list[float]:
    """Round times from 0 to `seconds`, at most MOST_TICKS of them."""
    rough = seconds / (MOST_TICKS - 1)
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(factor * power for factor in (1, 2, 5, 10, 20) if factor * power >= rough)
    return [n * step for n in range(math.floor(seconds / step) + 1)]


def timeline_svg(lanes: list[Lane], wall_seconds: float) -> str:
    """The lanes as an SVG element that is as wide as its parent; colours are the style sheet's."""
    seconds = axis_seconds(lanes, wall_seconds)
    height = LANE_HEIGHT * len(lanes)
    marks = "".join(_tick(at, seconds, height) for at in ticks(seconds))
    bars = "".join(_bar(lane, bar, row, seconds) for row, lane in enumerate(lanes) for bar in lane.bars)
    names = "".join(
        f'<text x="0" y="{LANE_HEIGHT * (row + 0.5):.2f}em" dominant-baseline="central">{escape(lane.name)}</text>'
        for row, lane in enumerate(lanes)
    )
    return (
        f'<svg class="vs-timeline" role="img" aria-label="time line of the last frame" width="100%" '
        f'height="{height + AXIS_HEIGHT:.2f}em">{names}'
        f'<svg x="{NAMES_WIDTH}em" style="width: calc(100% - {NAMES_WIDTH + END_WIDTH}em)" overflow="visible">'
        f"{marks}{bars}</svg></svg>"
    )


def _bar(lane: Lane, bar: Bar, row: int, seconds: float) -> str:
    x, width = 100 * bar.begin / seconds, 100 * (bar.end - bar.begin) / seconds
    y = LANE_HEIGHT * row + (LANE_HEIGHT - BAR_HEIGHT) / 2
    title = f"{lane.name}: {bar.stage} {time_text(bar.end - bar.begin)}"
    return (
        f'<rect class="{stage_class(bar.stage)}" x="{x:.4f}%" y="{y:.2f}em" width="{min(width, 100 - x):.4f}%" '
        f'height="{BAR_HEIGHT}em"><title>{escape(title)}</title></rect>'
    )


def _tick(at: float, seconds: float, height: float) -> str:
    x = f"{100 * at / seconds:.4f}%"
    return (
        f'<line class="vs-tick" x1="{x}" x2="{x}" y1="0" y2="{height:.2f}em"/>'
        f'<text class="vs-tick-text" x="{x}" y="{height + AXIS_HEIGHT - 0.4:.2f}em" text-anchor="middle">'
        f"{time_text(at)}</text>"
    )


def stage_class(stage: str) -> str:
    return "vs-stage-" + stage.replace("/", "")


def time_text(seconds: float) -> str:
    """Milliseconds below a second, with their unit."""
    if seconds == 0:
        return "0"
    return f"{seconds:.3g} s" if seconds >= 1 else f"{1000 * seconds:.3g} ms"
