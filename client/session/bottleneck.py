"""What a frame waited for, in words, from its report's own seconds."""

from collections import defaultdict
from dataclasses import dataclass

from volsplat.client.session.frame_report import StepReport
from volsplat.protocol.description.machine import Machine
from volsplat.protocol.messages.messages import SplatStats

ALL_CORES = 0.85  # of a machine's cores' time: from here on more processes on it bring nothing


@dataclass(frozen=True)
class Bottleneck:
    name: str
    share: float  # of the frame's seconds

    def __str__(self) -> str:
        return f"{self.name} ({self.share:.0%} of the frame)"


def bottleneck(report: StepReport) -> Bottleneck:
    """The part that more of would shorten the frame most.

    Links are slow if the splat server waits while a map/shade server cannot send. If the servers of one machine keep
    all its cores busy, these are named with whatever takes most of the frame. The image is sent after the finished
    frame. The client has what is left: asking for it, the messages' ways, and what nothing accounts for.
    """
    wall, splat = report.wall_seconds, report.slowest_splat_server
    parts = {
        "slowest map/shade": report.map_shade_seconds_slowest,
        "slowest splat server" if len(report.splat_servers) > 1 else "splat server": _splat_seconds(splat),
        "links": min(report.splat_waiting_seconds, report.map_shade_waiting_seconds_slowest),
        "image": report.image_seconds,
        "client": report.messages_seconds + (1 - report.accounted_share) * wall,
    }
    name = max(parts, key=lambda part: parts[part])
    full = next((machine for machine, working in _work(report).items() if _is_full(machine, working, wall)), None)
    if full is None:
        return Bottleneck(name, parts[name] / wall)
    cores = f"all {full.cores} cores of {full.host}" if len(_work(report)) > 1 else f"all {full.cores} cores"
    return Bottleneck(f"{cores}, most by {name}", parts[name] / wall)


def _splat_seconds(splat: SplatStats) -> float:
    return splat.planning_seconds + splat.merge_seconds + splat.splat_seconds


def _work(report: StepReport) -> dict[Machine, list[float]]:
    """The seconds that each server of each machine worked."""
    work = defaultdict(list)
    for splat in report.splat_servers.values():
        work[splat.machine].append(_splat_seconds(splat))
    for worker in report.workers.values():
        work[worker.machine].append(worker.map_shade_seconds)
    return work


def _is_full(machine: Machine, working: list[float], wall: float) -> bool:
    """Whether more servers than cores kept all of them busy."""
    return len(working) > machine.cores and sum(working) >= ALL_CORES * machine.cores * wall
