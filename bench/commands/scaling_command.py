"""`volsplat bench scaling`: how a frame's time grows, and what limits it."""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import click

from volsplat.bench.clusters.cluster_sizes import Drawers, MeasuredCluster, groups_of
from volsplat.bench.clusters.cluster_table import cluster_table, links_table
from volsplat.bench.commands.drawers import cluster_option, drawers_from_options
from volsplat.bench.commands.option_lists import fractions, whole_numbers
from volsplat.bench.renderers import Row, opened_rows
from volsplat.bench.scaling.model_table import model_table
from volsplat.bench.scaling.predictions import predictions_table
from volsplat.bench.scaling.scaling_cases import Case, Taken, frames_of, visible_cases, voxel_cases
from volsplat.bench.scaling.scaling_tables import (
    figures_of,
    growth_table,
    link_words,
    panels,
    servers_table,
    where_they_run,
)
from volsplat.bench.scaling.thread_shares import (
    SharesOfThreads,
    check_threads_are_seen,
    shares_of_threads,
    thread_figures,
    threads_table,
)
from volsplat.bench.subject import Shares, Subject, shares, subject_options, volume_file, volume_words
from volsplat.bench.tables.outputs import Outputs, output_options
from volsplat.bench.tables.record import Figure, record
from volsplat.bench.tables.text_table import TextTable
from volsplat.bench.views import around, seen
from volsplat.client.command.help_page import helped
from volsplat.client.command.opened_volume import opened
from volsplat.client.command.server_options import (
    Servers,
    joined_by_hand,
    listen_options,
    memory_option,
    spawn_option,
)
from volsplat.client.command.side_console import SideConsole
from volsplat.client.session.bottleneck import bottleneck
from volsplat.client.volume.surveyed_volume import SurveyedVolume
from volsplat.program.plain_console import PlainConsole
from volsplat.program.this_machine import usable_cores
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.text.errors import BadInput

PACKED_VOXEL_BYTES = 4
USUAL_WORKERS = "1,2,4,8"


@helped("volsplat bench scaling head.nrrd --workers 1,2,4", "volsplat bench scaling --phantom shells:256 --threads 1,2")
@subject_options
@click.option("--workers", help="Numbers of map/shade servers (1,2,4,8; of a cluster those of 1, 2, 3 … machines).")
@cluster_option
@click.option("--threads", metavar="1,2,4", help="Numbers of threads of the single process, to see what each does.")
@click.option("--predict", metavar="16,64", help="Numbers of map/shade servers whose times the model is to predict.")
@click.option("--sizes", default="0.125,0.25,0.5,1", help="Shares of the volume's voxels, drawn by bounds.")
@click.option("--images", default="256,512,1024", help="Sides of the square images, pixels (256,512,1024).")
@click.option("--repeats", type=click.IntRange(min=1), default=7, help="Views of each setting (7).")
@memory_option
@listen_options
@spawn_option
@output_options(plot=True)
def scaling(**settings: Any) -> None:
    """Measure how a frame's time grows with servers, pixels, voxels and visible voxels, and name what limits it.

    With --cluster it measures the first machine of a cluster file, the first two and so on, each brought up for its
    turn. With --listen it measures servers that are already up: --workers is then the number of map/shade servers. With
    either, the single process is measured as well if this machine sees the volume. With --threads it also counts what
    each thread of the single process takes of a frame, in the largest image.
    """
    outputs = Outputs.of(settings)
    found = measured(Asked.of(settings), SideConsole())
    outputs.deliver(record("scaling", found.facts, found.figures), found.tables, panels(found.taken, found.at_middle))


@dataclass(frozen=True)
class Asked:
    """What is to be measured."""

    subject: Subject
    drawers: Drawers
    servers: Servers | None  # that join by hand, in place of drawers that are brought up
    memory: int | None  # bytes of a prepared volume that each may hold
    shares: Sequence[float]  # of the volume's voxels
    sides: Sequence[int]  # of the square images, pixels
    repeats: int
    threads: Sequence[int]  # numbers of them, of the single process
    predicted: Sequence[int]  # numbers of map/shade servers

    @classmethod
    def of(cls, given: Mapping[str, Any]) -> Self:
        """What a command was given. Raises BadInput."""
        cluster, workers, by_hand = given["cluster"], given["workers"], joined_by_hand(given)
        if cluster is not None and (given["listen"] is not None or given["spawn"] is not None):
            raise BadInput("--cluster says where the servers are; leave out --listen and --spawn")
        here = cluster is None and not by_hand
        subject = Subject.of(given, here)
        drawers = drawers_from_options(cluster, workers, USUAL_WORKERS)
        shares_drawn, sides = fractions("--sizes", given["sizes"]), whole_numbers("--images", given["images"])
        threads, predicted = _of_this_machine(given["threads"], given["predict"], here)
        servers = None
        if by_hand:
            if workers is None or isinstance(drawers, MeasuredCluster) or len(drawers) != 1:
                raise BadInput(f"--workers {workers}: a cluster has one number of map/shade servers; give it")
            servers = Servers.of({**given, "workers": drawers[0], "threads": usable_cores()})
        repeats, memory = given["repeats"], given["memory"]
        return cls(subject, drawers, servers, memory, shares_drawn, sides, repeats, threads, predicted)

    @property
    def middle(self) -> int:
        """The side of images where nothing else is said."""
        return self.sides[len(self.sides) // 2]


def _of_this_machine(threads: str | None, predict: str | None, here: bool) -> tuple[list[int], list[int]]:
    """Numbers of threads and of predicted servers, which only a measurement `here` can have. Raises BadInput."""
    thread_counts = whole_numbers("--threads", threads, most=256) if threads else []
    if thread_counts and not here:
        raise BadInput("--threads measures the single process of this machine; leave it out with a cluster")
    if thread_counts:
        check_threads_are_seen()
    predicted_counts = whole_numbers("--predict", predict, most=4096) if predict else []
    if predicted_counts and not here:
        raise BadInput("--predict goes by what is measured on this machine; leave it out with a cluster")
    return thread_counts, predicted_counts


@dataclass(frozen=True)
class Found:
    """What was measured."""

    asked: Asked
    volume: SurveyedVolume
    shares: Shares
    taken: Sequence[Taken]
    by_threads: Sequence[SharesOfThreads]

    @property
    def at_middle(self) -> list[Taken]:
        """In images of the middle side."""
        millions = self.asked.middle**2 / 1e6
        return [one for one in self.taken if one.case.group == "pixels" and one.case.value == millions]

    @property
    def by_servers(self) -> list[Taken]:
        return [one for one in self.at_middle if one.row.workers]

    @property
    def tables(self) -> list[TextTable]:
        middle, asked = self.asked.middle, self.asked
        tables = [servers_table(self.at_middle, middle), growth_table(self.taken)]
        if isinstance(asked.drawers, MeasuredCluster):
            tables += [cluster_table(self.by_servers, f"{middle} x {middle}"), links_table(self.by_servers)]
        elif asked.servers is None:
            tables.append(model_table(self.taken))
        if asked.predicted:
            tables.append(predictions_table(self.taken, asked.predicted))
        if self.by_threads:
            tables.append(threads_table(self.by_threads, asked.sides[-1]))
        return tables

    @property
    def facts(self) -> dict[str, str]:
        middle = self.asked.middle
        return {
            "volume": volume_words(self.volume),
            "tables": self.asked.subject.tables.value,
            "views": f"{self.asked.repeats} of each setting, {middle} x {middle} pixels where nothing else is said",
            "shares": str(self.shares),
            "packed voxels": f"{PACKED_VOXEL_BYTES * self.volume.description.geometry.box.voxels / 1e6:.3g} MB",
            **{f"what limits {one.row.name}": str(bottleneck(one.usual)) for one in self.at_middle},
            **{f"machines of {one.row.name}": "; ".join(where_they_run(one)) for one in self.by_servers},
            **{f"link of {one.row.name}": link_words(one) for one in self.by_servers},
        }

    @property
    def figures(self) -> list[Figure]:
        return [*figures_of(self.taken), *thread_figures(self.by_threads)]


def measured(asked: Asked, console: PlainConsole) -> Found:
    """All rows in all cases."""
    cases, taken, seen_shares = list[Case](), list[Taken](), None
    with console.status("starting") as status, volume_file(asked.subject, status.update) as path:
        if asked.servers is not None:
            status.stop()
            source = joined(path, asked.servers, console)
        else:
            source = groups_of(asked.drawers, path, asked.memory, status.update)
        with closing(source) as groups:
            for rows in groups:
                status.stop()
                known = rows[0].renderer.volume
                cases = cases or cases_of(asked, known)
                seen_shares = seen_shares or shares(rows[0].renderer, cases[0].scenes[0])
                taken += frames_of(rows, cases)
        by_threads = shares_of_threads(path, asked.threads, cases[len(asked.sides) - 1].scenes)
    assert seen_shares is not None, "there is one row at least"
    return Found(asked, known, seen_shares, taken, by_threads)


def cases_of(asked: Asked, known: SurveyedVolume) -> list[Case]:
    """Those of the images' sides first."""
    shown, geometry, rotations = asked.subject.scene_of(known), known.description.geometry, around(asked.repeats)

    def views(changed: Scene, side: int = asked.middle) -> list[Scene]:
        return [seen(changed, geometry, turned, (side, side)) for turned in rotations]

    return [
        *(Case("pixels", side * side / 1e6, views(shown, side)) for side in asked.sides),
        *voxel_cases(shown, geometry, asked.shares, views),
        *visible_cases(shown, views),
    ]


def joined(path: str, servers: Servers, console: PlainConsole) -> Generator[list[Row]]:
    """Servers that join; and the single process, if the volume is seen from here."""
    with opened(path, servers, console) as cluster:
        assert cluster.volume, "wait until its servers have read the volume"
        rows = [Row(servers.workers, cluster)]
        if Path(path).exists():
            with opened_rows(path, [], lambda text: None, servers.memory) as single:
                yield [*single, *rows]
        else:
            yield rows
