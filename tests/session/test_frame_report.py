"""The report: the servers' counts added up, written whole, and shown beside the paper's figures."""

import io
import os
from pathlib import Path

import msgspec
import pytest
from rich.console import Console

from volsplat.client.coordinator.events.instructions import FrameOutcome
from volsplat.client.scene.lit_from import lit_from
from volsplat.client.scene.presets import preset_scene
from volsplat.client.session.frame_report import PAPER_SECONDS, FrameReport, report_of, step_table, write_report
from volsplat.client.session.renderer import StepOutcome
from volsplat.client.volume.surveyed_volume import SurveyedVolume
from volsplat.program import peak_memory
from volsplat.program.this_machine import this_machine
from volsplat.protocol.description.block_extremes import BlockExtremes
from volsplat.protocol.description.refinement_steps import PaperStep, Step
from volsplat.protocol.description.volume import Geometry, VolumeDescription
from volsplat.protocol.messages.messages import ImageRead, LinkStats, MapShadeStats, RawPixels, SlabStages, SplatStats
from volsplat.protocol.rules.index_rules import Survey
from volsplat.protocol.rules.refinement import PAPER_STEPS
from volsplat.protocol.text.errors import BadInput

SCENE = preset_scene("ct-skin")
VOLUME = SurveyedVolume(
    description=VolumeDescription(
        name="head.nrrd", format="NRRD", geometry=Geometry(dims=(96, 128, 113)), scalar_type="uint8"
    ),
    survey=Survey(low=0, high=255, max_gradient=1, voxels=1, no_data=0),
    density_counts=[1],
    strength_counts=[1],
    extremes=BlockExtremes.nothing((96, 128, 113)),
)


def worker_stats(times: int) -> MapShadeStats:
    return MapShadeStats(
        voxels_visited=1000 * times,
        packets=100 * times,
        batches=10 * times,
        raw_bytes=800 * times,
        bytes=400 * times,
        planning_seconds=0.125 * times,
        map_shade_seconds=0.5 * times,
        coding_seconds=0.0625 * times,
        sending_seconds=0.375 * times,
        waiting_seconds=0.25 * times,
        peak_memory_bytes=10_000_000 * times,
        machine=this_machine(),
        links={1: LinkStats(800 * times, 400 * times, 0.75 * times, 0.5 * times)},
    )


def outcome(step: Step) -> StepOutcome:
    splat = SplatStats(
        packets=300,
        hidden_packets=40,
        bytes=2400,
        frame_seconds=1.125,
        planning_seconds=0.0625,
        merge_seconds=0.125,
        splat_seconds=0.75,
        waiting_seconds=0.0625,
        held_back_seconds={2: 0.5, 3: 0.25},
        decoding_seconds=0.125,
        work=[],
        peak_memory_bytes=40_000_000,
        machine=this_machine(),
        slabs=SlabStages(0.25, 0.125, 0.1875, 0.0625) if step == Step.G else None,
    )
    servers = FrameOutcome({2: worker_stats(1), 3: worker_stats(2)}, {1: splat})
    image = ImageRead(7, step, True, 0, 0, 4, 2, RawPixels())
    return StepOutcome(step, 1.5, 0.25, servers, image_reads={1: image})


def report(*steps: Step) -> FrameReport:
    return report_of(VOLUME, SCENE, [outcome(step) for step in steps])


def test_each_link_has_its_bytes_and_waits() -> None:
    one, two, image = report(Step.F).steps[0].links
    assert (one.sender, one.receiver) == ("map/shade server 2", "splat server 1")
    assert (one.bytes, one.bytes_uncoded, one.sending_seconds, one.waiting_seconds) == (400, 800, 0.75, 0.5)
    assert (one.held_back_seconds, two.held_back_seconds) == (0.5, 0.25)
    assert (two.sender, two.bytes, two.waiting_seconds) == ("map/shade server 3", 800, 1.0)
    assert (image.sender, image.receiver, image.bytes) == ("splat server 1", "client", 128)


def test_the_workers_figures_are_added_up_and_the_slowest_named() -> None:
    step = report(Step.F).steps[0]
    assert (step.voxels_visited, step.packets_sent, step.bytes_sent) == (3000, 300, 1200)
    assert (step.bytes_uncoded, step.coding_seconds, step.decoding_seconds) == (2400, 0.1875, 0.125)
    assert (step.map_shade_seconds, step.map_shade_seconds_slowest) == (1.5, 1.0)
    assert (step.map_shade_waiting_seconds, step.map_shade_waiting_seconds_slowest) == (0.75, 0.5)
    assert (step.merge_seconds, step.splat_seconds, step.splat_waiting_seconds) == (0.125, 0.75, 0.0625)
    assert step.held_back_seconds == 0.75
    assert step.hidden_packets == 40


def test_the_stages_that_follow_each_other_account_for_the_wall_time() -> None:
    step = report(Step.F).steps[0]
    assert step.messages_seconds == 0.125
    assert step.accounted_share == (0.0625 + 0.125 + 0.75 + 0.0625 + 0.125 + 0.25) / 1.5


def test_splatting_is_told_stage_by_stage_in_step_g_alone() -> None:
    f, g = report(Step.F, Step.G).steps
    assert (f.slabs, g.slabs) == (None, SlabStages(0.25, 0.125, 0.1875, 0.0625))
    names, *columns = (list(column.cells) for column in step_table(report(Step.F, Step.G), SCENE).columns)
    in_f, in_g = (dict(zip(names, column, strict=True)) for column in columns[-2:])
    stages = ["   adding", "   densities", "   shading", "   compositing", "   publishing"]
    assert [in_g[stage] for stage in stages] == ["0.250", "0.125", "0.188", "0.062", "0.125"]
    assert [in_f[stage] for stage in stages] == [""] * 5 and in_f["  splat"] == in_g["  splat"] == "0.750"
    assert not set(stages) & set(step_table(report(Step.F), SCENE).columns[0].cells)


def test_every_process_tells_its_peak_memory() -> None:
    memory = report(Step.F).steps[0].peak_memory_bytes
    assert set(memory) == {"client", "splat server 1", "map/shade server 2", "map/shade server 3"}
    assert memory["map/shade server 3"] == 20_000_000
    assert memory["client"] > 10_000_000  # a Python process with torch in it, counted in bytes


def test_where_the_system_tells_no_peak_the_resources_do(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(peak_memory, "STATUS", os.devnull)
    assert peak_memory.peak_memory() > 10_000_000


def test_a_written_report_reads_back_equal(tmp_path: Path) -> None:
    path = tmp_path / "report.json"
    written = report(*Step)
    write_report(path, written)
    assert msgspec.json.decode(path.read_bytes(), type=FrameReport) == written
    assert os.listdir(tmp_path) == ["report.json"]


def test_a_report_that_cannot_be_written_is_refused_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="report.json: cannot write the report: No such file"):
        write_report(tmp_path / "absent" / "report.json", report(Step.A))
    (tmp_path / "report.json").mkdir()
    with pytest.raises(BadInput, match="report.json: cannot write the report: Is a directory"):
        write_report(tmp_path / "report.json", report(Step.A))
    assert os.listdir(tmp_path) == ["report.json"]


@pytest.mark.parametrize("steps", [(), (Step.C,), tuple(Step)])
def test_the_table_shows_the_steps_beside_the_papers_figures(steps: tuple[Step, ...]) -> None:
    console = Console(file=io.StringIO(), width=80)
    console.print(step_table(report(*steps), SCENE))
    assert isinstance(console.file, io.StringIO)
    text = console.file.getvalue()
    for machine, seconds in PAPER_SECONDS.items():
        row = next(line for line in text.splitlines() if machine in line)
        assert row.split()[-6:] == [str(value) for value in seconds]  # there is none for G
    assert max(len(line) for line in text.splitlines()) <= 80
    assert text.count("1.500") == len(steps)
    assert text.count("0.003 M") == len(steps)


@pytest.mark.parametrize(
    ("lit", "heads"),
    [
        (PaperStep.E, ["A\n1/4", "B\n1/2", "C\nfull", "D\nkernel", "E\ndiffuse", "F\nspecular"]),
        (PaperStep.C, ["A\n1/4", "B\n1/2", "C\nfull\ndiffuse\nspecular", "D\nkernel", "E", "F"]),
    ],
)
def test_the_table_says_at_which_step_the_scene_is_lit(lit: PaperStep, heads: list[str]) -> None:
    table = step_table(report(*PAPER_STEPS), lit_from(SCENE, lit))
    assert [column.header for column in table.columns[1:]] == heads
