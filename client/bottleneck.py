"""What a frame waited for, in words, from its report's own seconds."""

from dataclasses import dataclass

from volsplat.client.frame_report import StepReport

ALL_CORES = 0.85  # of the cores' time: from here on more processes bring nothing


@dataclass(frozen=True)
class Bottleneck:
    name: str
    share: float  # of the frame's seconds

    def __str__(self) -> str:
        return f"{self.name} ({self.share:.0%} of the frame)"


def bottleneck(report: StepReport, cores: int) -> Bottleneck:
    """The part that more of would shorten the frame most.

    Links are slow where the splat server waits while a map/shade server cannot send. Where the map/shade servers and
    the splat server together keep all `cores` of this machine busy, these are named with whatever takes most of them.
    The image is sent after the finished frame. The client has what is left: asking for it, the messages' ways, and
    what nothing accounts for.
    """
    wall = report.wall_seconds
    splat = report.planning_seconds + report.merge_seconds + report.splat_seconds
    splat += report.splat_server.answering_seconds
    parts = {
        "slowest map/shade": report.map_shade_seconds_slowest,
        "splat server": splat,
        "links": min(report.splat_waiting_seconds, report.map_shade_waiting_seconds_slowest),
        "image": report.image_seconds,
        "client": report.messages_seconds + (1 - report.accounted_share) * wall,
    }
    name = max(parts, key=lambda part: parts[part])
    working = report.map_shade_seconds + splat
    if len(report.workers) + 1 > cores and working >= ALL_CORES * cores * wall:
        return Bottleneck(f"all {cores} cores, most by {name}", parts[name] / wall)
    return Bottleneck(name, parts[name] / wall)
