"""What the steps of an image took, in numbers: report.json, and the table beside the paper's."""

from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

import msgspec
from rich import box
from rich.table import Table

from volsplat.client.files.whole_file import whole_file
from volsplat.client.session.frame_links import LinkReport, links_of
from volsplat.client.session.renderer import StepOutcome
from volsplat.client.volume.surveyed_volume import SurveyedVolume
from volsplat.program.peak_memory import peak_memory
from volsplat.program.this_machine import this_machine
from volsplat.protocol.description.machine import Machine
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.volume import Index
from volsplat.protocol.messages.messages import MapShadeStats, SlabStages, SplatStats
from volsplat.protocol.rules.refinement import PAPER_STEPS, active_shading, coarser, same_picture

# Seconds for the steps A to F, from the paper's "Timing Tests": a CT of 96 x 128 x 113 voxels.
PAPER_SECONDS = {
    "TAAC-1": (3, 9, 65, 165, 179, 182),
    "1 Sun-3": (20, 60, 363, 733, 843, 898),
    "4 Sun-3": (3, 21, 141, 172, 205, 223),
    "1 Sun-4": (8, 28, 181, 481, 484, 522),
    "4 Sun-4": (3, 11, 89, 108, 112, 116),
}

# What each step adds, as in the paper, whose light joins at E.
STEP_WORDS = {
    Step.A: "1/4",
    Step.B: "1/2",
    Step.C: "full",
    Step.D: "kernel",
    Step.E: "diffuse",
    Step.F: "specular",
    Step.G: "slabs",
}

SLAB_STAGES = ("adding", "densities", "shading", "compositing", "publishing")
"""What splatting is in step G."""


class VolumeFacts(msgspec.Struct, frozen=True):
    name: str
    dims: Index
    scalar_type: str


class StepReport(msgspec.Struct, frozen=True):
    """One step. Of the workers, seconds are given as their sum and as the slowest one's.

    Of the splat servers they are those of the slowest, whose part of the image was finished last.
    """

    step: Step
    level: int  # that was drawn; 0 is the volume itself
    wall_seconds: float  # from asking to having the image
    voxels_visited: int
    packets_sent: int
    bytes_sent: int
    bytes_uncoded: int  # what these would have been if no batch had been coded
    coding_seconds: float  # over all workers
    decoding_seconds: float  # over all splat servers, beside their other stages
    map_shade_seconds: float
    map_shade_seconds_slowest: float
    map_shade_waiting_seconds: float  # in sends that back-pressure held up
    map_shade_waiting_seconds_slowest: float
    planning_seconds: float  # of the slowest splat server, as the three that follow
    merge_seconds: float
    splat_seconds: float
    slabs: SlabStages | None  # what these went into, in step G
    splat_waiting_seconds: float  # with nothing to splat
    messages_seconds: float  # what is left: of asking for the frame, and of messages on their way
    image_seconds: float  # until the finished image was here
    image_bytes: int  # of the finished image, as splat servers sent it; none by memory that is shared
    image_coding_seconds: float  # of the slowest splat server
    accounted_share: float  # of the wall seconds, by the slowest splat server's stages, the messages and the image
    hidden_packets: int  # of those sent, left out by the splat servers
    held_back_seconds: float  # that connections were not read because their buffers were full, over all of them
    peak_memory_bytes: dict[str, int]  # of each process so far
    voxels_held: dict[int, int]  # of the volume, by map/shade server; others when sub-cubes have changed hands
    links: tuple[LinkReport, ...]  # that carry batches and images
    workers: dict[int, MapShadeStats]
    splat_servers: dict[int, SplatStats]

    @property
    def slowest_splat_server(self) -> SplatStats:
        """Whose part of the image was finished last."""
        return slowest(self.splat_servers)


class FrameReport(msgspec.Struct, frozen=True):
    volsplat: str  # version
    machine: Machine  # the client's
    volume: VolumeFacts
    width: int
    height: int
    order: str
    why_level: str  # which level of a prepared volume the last step shows, and why; else ""
    steps: tuple[StepReport, ...]


def report_of(volume: SurveyedVolume, scene: Scene, outcomes: Iterable[StepOutcome]) -> FrameReport:
    """The report of the steps drawn of a volume."""
    from importlib.metadata import version  # brings the library for e-mail, which only reports need

    description, drawn = volume.description, list(outcomes)
    return FrameReport(
        volsplat=version("volsplat"),
        machine=this_machine(),
        volume=VolumeFacts(description.name, description.geometry.dims, description.scalar_type),
        width=scene.image.width,
        height=scene.image.height,
        order=scene.order.value,
        why_level=drawn[-1].servers.why_level if drawn else "",
        steps=tuple(_step_report(outcome) for outcome in drawn),
    )


def write_report(path: Path, report: FrameReport) -> None:
    """Write a report as JSON, whole or not at all. Raises BadInput if the file cannot be written."""
    text = msgspec.json.format(msgspec.json.encode(report), indent=2) + b"\n"
    with whole_file(path, "cannot write the report") as file:
        file.write(text)


def step_words(scene: Scene, step: Step) -> list[str]:
    """What a step adds to the step before, and which light joins there; nothing if it has the same picture."""
    before = coarser(step)
    if before is not None and same_picture(scene, before, step):
        return []
    words = [] if step in (Step.E, Step.F) else [STEP_WORDS[step]]
    return words + _joining_light(scene, before, step)


def _joining_light(scene: Scene, before: Step | None, step: Step) -> list[str]:
    now, then = active_shading(scene, step), None if before is None else active_shading(scene, before)
    diffuse = now.diffuse and not (then is not None and then.diffuse)
    specular = now.specular and not (then is not None and then.specular)
    return ["diffuse"] * diffuse + ["specular"] * specular


def step_table(report: FrameReport, scene: Scene) -> Table:
    """The steps' figures (map/shade of the slowest server, memory of the largest process) over the paper's."""
    steps = {step.step: step for step in report.steps}
    i, j, k = report.volume.dims
    title = f"{report.volume.name}, {i} x {j} x {k} voxels, on {report.machine.cores} x {report.machine.cpu}"
    shown = [step for step in Step if step in steps or step in PAPER_STEPS]
    table = Table(title=title, box=box.SIMPLE_HEAD, caption_justify="left")
    if len(shown) > len(PAPER_STEPS):  # a terminal has 80 columns
        table.padding, table.show_edge = (0, 1, 0, 0), False
    table.caption = "The paper's seconds are for a CT of 96 x 128 x 113 voxels."
    table.add_column("", no_wrap=True)
    for letter in shown:
        table.add_column("\n".join([letter.value, *step_words(scene, letter)]), justify="right", no_wrap=True)
    rows: dict[str, Callable[[StepReport], str]] = {
        "seconds": lambda s: f"{s.wall_seconds:.3f}",
        "  map/shade": lambda s: f"{s.map_shade_seconds_slowest:.3f}",
        "  merge": lambda s: f"{s.merge_seconds:.3f}",
        "  splat": lambda s: f"{s.splat_seconds:.3f}",
        **(_slab_rows() if any(step.slabs for step in report.steps) else {}),
        "  splat waits": lambda s: f"{s.splat_waiting_seconds:.3f}",
        "  planning": lambda s: f"{s.planning_seconds:.3f}",
        "  messages": lambda s: f"{s.messages_seconds:.3f}",
        "  image": lambda s: f"{s.image_seconds:.3f}",
        "accounted for": lambda s: f"{s.accounted_share:.0%}",
        "voxels visited": lambda s: f"{s.voxels_visited / 1e6:.3f} M",
        "packets sent": lambda s: f"{s.packets_sent / 1e6:.3f} M",
        "bytes sent": lambda s: f"{s.bytes_sent / 1e6:.2f} MB",
        "  uncoded": lambda s: f"{s.bytes_uncoded / 1e6:.2f} MB",
        "peak memory": lambda s: f"{max(s.peak_memory_bytes.values(), default=0) / 1e6:.0f} MB",
    }
    for name, figure in rows.items():
        style = "bold" if name == "seconds" else ""
        table.add_row(name, *(figure(steps[letter]) if letter in steps else "" for letter in shown), style=style)
    table.add_section()
    for machine, seconds in PAPER_SECONDS.items():
        table.add_row(f"1989: {machine}", *map(str, seconds))
    return table


def slab_stages(splat: SplatStats | StepReport) -> list[tuple[str, float]]:
    """The stages of a frame of slabs that its splatting went into, and their seconds; of other frames none."""
    if splat.slabs is None:
        return []
    seconds = msgspec.structs.astuple(splat.slabs)
    rest = max(0.0, splat.splat_seconds - sum(seconds))
    return list(zip(SLAB_STAGES, (*seconds, rest), strict=True))


def _slab_rows() -> dict[str, Callable[[StepReport], str]]:
    def row(stage: str) -> Callable[[StepReport], str]:
        return lambda step: next((f"{seconds:.3f}" for name, seconds in slab_stages(step) if name == stage), "")

    return {f"   {stage}": row(stage) for stage in SLAB_STAGES}


def _step_report(outcome: StepOutcome) -> StepReport:
    workers, splat_servers = outcome.servers.map_shade, outcome.servers.splat
    stats, splat = list(workers.values()), slowest(splat_servers)
    memory = {f"splat server {server}": one.peak_memory_bytes for server, one in sorted(splat_servers.items())}
    memory |= {f"map/shade server {server}": worker.peak_memory_bytes for server, worker in sorted(workers.items())}
    return StepReport(
        step=outcome.step,
        level=outcome.servers.level,
        wall_seconds=outcome.wall_seconds,
        voxels_visited=sum(worker.voxels_visited for worker in stats),
        packets_sent=sum(worker.packets for worker in stats),
        bytes_sent=sum(worker.bytes for worker in stats),
        bytes_uncoded=sum(worker.raw_bytes for worker in stats),
        coding_seconds=sum(worker.coding_seconds for worker in stats),
        decoding_seconds=sum(one.decoding_seconds for one in splat_servers.values()),
        map_shade_seconds=sum(worker.map_shade_seconds for worker in stats),
        map_shade_seconds_slowest=max((worker.map_shade_seconds for worker in stats), default=0.0),
        map_shade_waiting_seconds=sum(worker.waiting_seconds for worker in stats),
        map_shade_waiting_seconds_slowest=max((worker.waiting_seconds for worker in stats), default=0.0),
        planning_seconds=splat.planning_seconds,
        merge_seconds=splat.merge_seconds,
        splat_seconds=splat.splat_seconds,
        slabs=splat.slabs,
        splat_waiting_seconds=splat.waiting_seconds,
        messages_seconds=_messages_seconds(outcome),
        image_seconds=outcome.image_seconds,
        image_bytes=outcome.image_bytes,
        image_coding_seconds=outcome.image_coding_seconds,
        accounted_share=_accounted_seconds(outcome) / outcome.wall_seconds,
        hidden_packets=sum(one.hidden_packets for one in splat_servers.values()),
        held_back_seconds=sum(seconds for one in splat_servers.values() for seconds in one.held_back_seconds.values()),
        peak_memory_bytes={"client": peak_memory(), **memory},
        voxels_held=outcome.servers.voxels,
        links=tuple(links_of(outcome)),
        workers=workers,
        splat_servers=splat_servers,
    )


def _accounted_seconds(outcome: StepOutcome) -> float:
    """What follows each other: a splat server's stages, waiting included, with the messages before and the image."""
    splat = slowest(outcome.servers.splat)
    stages = (splat.planning_seconds, splat.merge_seconds, splat.splat_seconds, splat.waiting_seconds)
    return sum(stages) + _messages_seconds(outcome) + outcome.image_seconds


def _messages_seconds(outcome: StepOutcome) -> float:
    """When neither a splat server had the frame nor its image was on its way."""
    return max(0.0, outcome.wall_seconds - slowest(outcome.servers.splat).frame_seconds - outcome.image_seconds)


def slowest(splat_servers: Mapping[int, SplatStats]) -> SplatStats:
    """The one that was at its part of the frame for longest."""
    return max(splat_servers.values(), key=lambda splat: splat.frame_seconds)
