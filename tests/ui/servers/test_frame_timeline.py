"""The time line of a frame: as many lanes as servers, bars on its axis, one after the other, and good SVG."""

import math
from xml.etree import ElementTree

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tolerances import ROUNDING
from volsplat.client.coordinator.events.instructions import FrameOutcome
from volsplat.client.session.renderer import StepOutcome
from volsplat.client.ui.panels.servers.frame_timeline import (
    MOST_TICKS,
    STAGES,
    STAGES_OF_SLABS,
    Lane,
    axis_seconds,
    lanes_of,
    stage_class,
    stages_of,
    stages_shown,
    ticks,
    timeline_svg,
)
from volsplat.program.this_machine import this_machine
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.messages.messages import MapShadeStats, SlabStages, SplatStats

seconds = st.just(0.0) | st.floats(1e-9, 1e5)
counts = st.integers(0, 2**40)
map_shade_stats = st.builds(
    MapShadeStats,
    voxels_visited=counts,
    packets=counts,
    batches=counts,
    raw_bytes=counts,
    bytes=counts,
    planning_seconds=seconds,
    map_shade_seconds=seconds,
    coding_seconds=seconds,
    sending_seconds=seconds,
    waiting_seconds=seconds,
    peak_memory_bytes=counts,
    machine=st.just(this_machine()),
)
splat_stats = st.builds(
    SplatStats,
    packets=counts,
    hidden_packets=counts,
    bytes=counts,
    frame_seconds=seconds,
    planning_seconds=seconds,
    merge_seconds=seconds,
    splat_seconds=seconds,
    waiting_seconds=seconds,
    held_back_seconds=st.just({}),
    decoding_seconds=seconds,
    peak_memory_bytes=counts,
    machine=st.just(this_machine()),
    slabs=st.none() | st.builds(SlabStages, *[seconds] * 4),
)
outcomes = st.builds(
    StepOutcome,
    step=st.sampled_from(Step),
    wall_seconds=seconds,
    image_seconds=seconds,
    servers=st.builds(
        FrameOutcome,
        map_shade=st.dictionaries(st.integers(1, 99), map_shade_stats, max_size=8),
        splat=st.dictionaries(st.integers(100, 199), splat_stats, min_size=1, max_size=4),
    ),
)
names = st.dictionaries(st.integers(1, 99), st.text(st.characters(codec="utf-8", exclude_categories=["C"])))


@given(outcomes)
def test_each_server_has_a_lane_with_its_stages_in_turn(outcome: StepOutcome) -> None:
    lanes = lanes_of(outcome, {})
    workers, splat_servers = sorted(outcome.servers.map_shade), sorted(outcome.servers.splat)
    assert [lane.name for lane in lanes] == [
        *(f"map/shade {n}" for n in workers),
        *(f"splat server {n}" for n in splat_servers),
    ]
    for lane in lanes:
        at = 0.0
        for bar in lane.bars:
            assert bar.stage in stages_shown(outcome) + STAGES and at <= bar.begin < bar.end
            at = bar.end


@given(map_shade_stats | splat_stats)
def test_a_bar_is_as_long_as_its_stage_took(stats: MapShadeStats | SplatStats) -> None:
    outcome = StepOutcome(Step.A, 0.0, 0.0, _servers(stats))
    lane = lanes_of(outcome, {})[0 if isinstance(stats, MapShadeStats) else -1]
    took = [(stage, length) for stage, length in stages_of(stats) if length > 0]
    assert [bar.stage for bar in lane.bars] == [stage for stage, _ in took]
    total = sum(length for _, length in took)
    for bar, (_, length) in zip(lane.bars, took, strict=True):
        assert bar.end - bar.begin == pytest.approx(length, abs=ROUNDING * max(1.0, total))


def _servers(stats: MapShadeStats | SplatStats) -> FrameOutcome:
    nothing = SplatStats(0, 0, 0, 0.0, 0.0, 0.0, 0.0, 0.0, {}, 0.0, [], 0, this_machine())
    return FrameOutcome({7: stats}, {8: nothing}) if isinstance(stats, MapShadeStats) else FrameOutcome({}, {8: stats})


def test_splatting_is_one_stage_but_in_step_g() -> None:
    plain = SplatStats(0, 0, 0, 4.0, 0.5, 0.25, 3.0, 0.25, {}, 0.0, [], 0, this_machine())
    slabs = msgspec.structs.replace(plain, slabs=SlabStages(1.0, 0.5, 0.75, 0.25))
    assert dict(stages_of(plain))["splat"] == 3.0
    assert stages_shown(StepOutcome(Step.F, 4.0, 0.0, _servers(plain))) == stages_shown(None) == STAGES
    assert stages_shown(StepOutcome(Step.G, 4.0, 0.0, _servers(slabs))) == STAGES_OF_SLABS
    found = dict(stages_of(slabs))
    parts = ("adding", "densities", "shading", "compositing", "publishing")
    assert [found[part] for part in parts] == [1.0, 0.5, 0.75, 0.25, 0.5] and "splat" not in found


@given(outcomes, names)
def test_every_bar_lies_on_the_axis_and_nothing_is_nan(outcome: StepOutcome, names: dict[int, str]) -> None:
    lanes = lanes_of(outcome, names)
    text = timeline_svg(lanes, outcome.wall_seconds)
    root = ElementTree.fromstring(text)
    bars = list(root.iter("rect"))
    assert len(bars) == sum(len(lane.bars) for lane in lanes)
    for bar in bars:
        x, width = (float(bar.attrib[name].removesuffix("%")) for name in ("x", "width"))
        assert math.isfinite(x) and math.isfinite(width)
        assert x >= 0 and width >= 0 and x + width <= 100.0002  # four digits each
        assert bar.attrib["class"] in {stage_class(stage) for stage in stages_shown(outcome) + STAGES}
    assert [element.text or "" for element in root.findall("text")] == [lane.name for lane in lanes]


@given(st.floats(1e-6, 1e6))
def test_ticks_are_few_even_and_within_the_axis(length: float) -> None:
    marks = ticks(length)
    assert 2 <= len(marks) <= MOST_TICKS and marks[0] == 0.0 and marks[-1] <= length * (1 + ROUNDING)
    step = marks[1]
    assert marks == pytest.approx([n * step for n in range(len(marks))])
    assert length - marks[-1] < step * (1 + ROUNDING)


def test_the_axis_is_the_frame_and_an_empty_frame_has_one() -> None:
    lanes = [Lane("splat server", ())]
    assert axis_seconds(lanes, 0.25) == 0.25
    assert axis_seconds(lanes, 0.0) > 0
    ElementTree.fromstring(timeline_svg(lanes, 0.0))
