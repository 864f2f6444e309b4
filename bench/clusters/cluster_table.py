"""What a cluster's sizes took of a frame, on which machines, over which links, and what limits each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from volsplat.bench.scaling.scaling_cases import Taken
from volsplat.bench.scaling.scaling_tables import where_they_run
from volsplat.bench.tables.text_table import TextTable, give_or_take, significant
from volsplat.client.session.bottleneck import bottleneck
from volsplat.client.session.frame_links import LinkReport
from volsplat.client.session.frame_report import PAPER_SECONDS, StepReport
from volsplat.protocol.description.machine import Machine
from volsplat.protocol.description.refinement_steps import Step

MEGA = 1e6
CAPTION = (
    "Machines are those of the map/shade servers, cores all of theirs. Efficiency: the share reached of as many times "
    "the speed of the first column as there are more cores. Bytes are those of the frame of median time, as they were "
    "sent; none go over memory that processes of one machine share."
)


def cluster_table(taken: Sequence[Taken], side: str) -> TextTable:
    """A column for each size of the cluster, and the paper's four machines beside them."""
    table = TextTable(
        f"Cluster, step F, {side} pixels", ("", "1989, 4 over 1 Sun-4", *(one.row.name for one in taken)), CAPTION
    )
    one, four = (PAPER_SECONDS[name][list(Step).index(Step.F)] for name in ("1 Sun-4", "4 Sun-4"))
    table.add("machines", "4", *(str(len(hosts_of(one.usual))) for one in taken))
    table.add("cores", "4", *(str(cores_of(one.usual)) for one in taken))
    table.add(
        "milliseconds a frame", significant(four * 1e3), *(significant(one.seconds.median * 1e3) for one in taken)
    )
    table.add("", "", *(give_or_take(one.seconds) for one in taken))
    gains = [gain(taken[0], one) for one in taken]
    table.add("speed-up", significant(one / four), *(significant(gain.speed_up) for gain in gains))
    table.add("efficiency", significant(one / four / 4), *(significant(gain.efficiency) for gain in gains))
    table.add("MB to splat servers", "", *(significant(one.usual.bytes_sent / MEGA) for one in taken))
    table.add("MB of image", "", *(significant(one.usual.image_bytes / MEGA) for one in taken))
    table.add("limited by", "", *(limit_words(one.usual) for one in taken))
    return table


def cluster_facts(taken: Sequence[Taken]) -> dict[str, str]:
    """For the record."""
    return {
        **{f"machines of {one.row.name}": "; ".join(where_they_run(one)) for one in taken},
        **{f"what limits {one.row.name}": limit_words(one.usual) for one in taken},
        **{f"links of {one.row.name}": "; ".join(_links(one.usual)) for one in taken},
    }


@dataclass(frozen=True)
class Gain:
    speed_up: float
    efficiency: float


def gain(first: Taken, taken: Taken) -> Gain:
    """Over the first size."""
    speed_up = first.seconds.median / taken.seconds.median
    return Gain(speed_up, speed_up * cores_of(first.usual) / cores_of(taken.usual))


def hosts_of(report: StepReport) -> dict[str, Machine]:
    """The machines of the map/shade servers, by name."""
    return {worker.machine.host: worker.machine for worker in report.workers.values()}


def cores_of(report: StepReport) -> int:
    return sum(machine.cores for machine in hosts_of(report).values())


def limit_words(report: StepReport) -> str:
    """What more of would shorten the frame most, and where that is."""
    limit = bottleneck(report)
    return f"{limit}{_where(limit.name, report)}"


def _where(name: str, report: StepReport) -> str:
    if name.endswith("slowest map/shade"):
        slowest = max(report.workers.values(), key=lambda worker: worker.map_shade_seconds)
        return f" on {slowest.machine.host}"
    if name.endswith("splat server"):
        return f" on {report.slowest_splat_server.machine.host}"
    if name == "links" and report.links:
        link = max(report.links, key=lambda link: link.waiting_seconds)
        return f": {link_words(link, _places(report))}"
    return ""


def links_table(taken: Sequence[Taken]) -> TextTable:
    """Each link of each size."""
    table = TextTable(
        "Links of the cluster, one frame",
        ("n", "from", "to", "MB", "MB uncoded", "MB/s", "ms waited"),
        "n: map/shade servers. MB/s: while it was handed to the system, whose buffers may be faster than the link. "
        "Waited: of that, for room at the receiver or on the link.",
    )
    for one in taken:
        places = _places(one.usual)
        for link in one.usual.links:
            timed = bool(link.sending_seconds)  # images are not: their way is part of the frame's seconds
            rate = significant(link.bytes / link.sending_seconds / MEGA) if link.bytes and timed else ""
            waited = significant(link.waiting_seconds * 1e3) if timed else ""
            ends = (_told(link.sender, places), _told(link.receiver, places))
            sizes = (significant(link.bytes / MEGA), significant(link.bytes_uncoded / MEGA))
            table.add(str(one.row.workers), *ends, *sizes, rate, waited)
    return table


def _links(report: StepReport) -> list[str]:
    return [link_words(link, _places(report)) for link in report.links]


def link_words(link: LinkReport, places: Mapping[str, str]) -> str:
    return f"{_told(link.sender, places)} to {_told(link.receiver, places)}, {link.bytes / MEGA:.3g} MB"


def _places(report: StepReport) -> dict[str, str]:
    """The host of each server, by how links name it."""
    return {
        **{f"map/shade server {number}": worker.machine.host for number, worker in report.workers.items()},
        **{f"splat server {number}": splat.machine.host for number, splat in report.splat_servers.items()},
    }


def _told(end: str, places: Mapping[str, str]) -> str:
    return f"{end} on {places[end]}" if end in places else end
