"""`volsplat bench hosts`: several splat servers on hosts of their own, over links of a given rate."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import cycle
from typing import Any

import click

from volsplat.bench.commands.option_lists import whole_numbers
from volsplat.bench.hosts.cluster import cluster_of_hosts
from volsplat.bench.scaling.scaling_cases import usual_frame
from volsplat.bench.subject import Subject, subject_options, volume_file, volume_words
from volsplat.bench.tables.outputs import Outputs, output_options
from volsplat.bench.tables.progress import shown_progress
from volsplat.bench.tables.record import Figure, figure, record
from volsplat.bench.tables.text_table import TextTable, give_or_take, significant
from volsplat.bench.views import around, seen
from volsplat.client.command.help_page import helped
from volsplat.client.command.side_console import SideConsole
from volsplat.client.session.bottleneck import bottleneck
from volsplat.client.session.frame_report import StepReport, report_of
from volsplat.client.session.session import Session
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import LARGEST_EXTENT, Scene

VIEWS_OF_A_TURN = 24
FIRST = 2  # views that are not counted: regions are cut by the frame before


@dataclass(frozen=True)
class Taken:
    """The frames of one number of splat servers."""

    splat_servers: int
    reports: Sequence[StepReport]  # of pictures to be looked at, with 8 bits a channel if that is sooner
    exact: Sequence[StepReport]  # of the same views, with every bit

    @property
    def name(self) -> str:
        return f"{self.splat_servers} splat server{'s' if self.splat_servers > 1 else ''}"

    @property
    def seconds(self) -> Figure:
        return figure(f"{self.name}: frame", "s", [report.wall_seconds for report in self.reports])

    @property
    def exact_seconds(self) -> Figure:
        return figure(f"{self.name}: exact frame", "s", [report.wall_seconds for report in self.exact])

    @property
    def usual(self) -> StepReport:
        """The frame of median time."""
        return usual_frame(self.reports)


@helped("volsplat bench hosts --phantom shells:256 --workers 4 --splat-servers 1,2,4 --link 100")
@subject_options
@click.option("--workers", type=click.IntRange(1, 64), default=4, help="Hosts with a map/shade server (4).")
@click.option("--splat-servers", default="1,2,4", help="Numbers of hosts with a splat server (1,2,4).")
@click.option("--link", type=click.FloatRange(1), default=100.0, help="Of every host, Mbit/s in each direction (100).")
@click.option(
    "--image", type=click.IntRange(16, LARGEST_EXTENT), default=512, help="Side of the square image, pixels (512)."
)
@click.option("--repeats", type=click.IntRange(min=1), default=7, help="Views, 15 degrees apart (7).")
@output_options()
def hosts(workers: int, splat_servers: str, link: float, image: int, repeats: int, **settings: Any) -> None:
    """Measure how splat servers on hosts of their own share the links' work. Needs Linux and root.

    The hosts are network namespaces of this machine: each has its own network link of the given rate, all share its
    cores. So it shows what links cost, not what more processors bring.
    """
    subject = Subject.of(settings)
    counts = whole_numbers("--splat-servers", splat_servers, most=64)
    outputs = Outputs.of(settings)
    taken = []
    console = SideConsole()
    with console.status("starting") as status, volume_file(subject, status.update) as path:
        status.stop()
        with shown_progress("frames", len(counts) * 2 * (FIRST + repeats)) as step:
            for count in counts:
                with cluster_of_hosts(path, workers, count, link * 1e6, lambda text: None) as session:
                    known = session.volume
                    shown, geometry = subject.scene_of(known), known.description.geometry
                    turn = cycle(around(VIEWS_OF_A_TURN))
                    scenes = [seen(shown, geometry, next(turn), (image, image)) for _ in range(FIRST + repeats)]
                    taken.append(Taken(count, *(turned(session, scenes, exact, step) for exact in ((), (Step.F,)))))
    facts = {
        "volume": volume_words(known),
        "tables": subject.tables.value,
        "image": f"{image} x {image} pixels, {repeats} views, 15 degrees apart",
        "hosts": f"{workers} with a map/shade server, the client, and those with a splat server, one thread each",
        "links": f"{link:g} Mbit/s in each direction",
        **{f"what limits {one.name}": str(bottleneck(one.usual)) for one in taken},
    }
    figures = [of for one in taken for of in (one.seconds, one.exact_seconds)]
    outputs.deliver(record("hosts", facts, figures), [hosts_table(taken)])


def turned(
    session: Session, scenes: Sequence[Scene], exact: Sequence[Step], step: Callable[[], None]
) -> list[StepReport]:
    """Of all views but the first ones, by which the regions find their places."""
    reports: list[StepReport] = []
    for scene in scenes:
        drawn = [one.outcome for one in session.refine(scene, Step.F, math.inf, Step.F, exact)]
        reports += report_of(session.volume, scene, [outcome for outcome in drawn if outcome is not None]).steps
        step()
    return reports[FIRST:]


def hosts_table(taken: Sequence[Taken]) -> TextTable:
    """A column for each number of splat servers."""
    table = TextTable("Hosts", ("", *(one.name for one in taken)), "Medians, with half the width of their middle half.")
    table.add("milliseconds a frame", *(significant(one.seconds.median * 1e3) for one in taken))
    table.add("", *(give_or_take(one.seconds) for one in taken))
    first = taken[0].seconds.median
    table.add("times the frame rate", *(significant(first / one.seconds.median) for one in taken))
    table.add("milliseconds an exact frame", *(significant(one.exact_seconds.median * 1e3) for one in taken))
    table.add("", *(give_or_take(one.exact_seconds) for one in taken))
    table.add("MB into splat servers", *(significant(one.usual.bytes_sent / 1e6) for one in taken))
    table.add("ms of the image's way", *(significant(one.usual.image_seconds * 1e3) for one in taken))
    return table
