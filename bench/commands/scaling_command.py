"""`volsplat bench scaling`: how a frame's time grows, and what limits it."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any

import click

from volsplat.bench.clusters.cluster_sizes import MeasuredCluster, groups_of
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
    check_threads_are_seen,
    shares_of_threads,
    thread_figures,
    threads_table,
)
from volsplat.bench.subject import shares, subject_of, subject_options, volume_file, volume_words
from volsplat.bench.tables.outputs import Outputs, output_options
from volsplat.bench.tables.record import record
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
from volsplat.program.plain_console import PlainConsole
from volsplat.program.this_machine import usable_cores
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.volume import Geometry
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
def scaling(
    volume: str | None,
    phantom: str | None,
    tables: str | None,
    scene: Path | None,
    preset: str | None,
    workers: str | None,
    cluster: Path | None,
    threads: str | None,
    predict: str | None,
    sizes: str,
    images: str,
    repeats: int,
    json: Path | None,
    markdown: Path | None,
    plot: Path | None,
    **settings: Any,
) -> None:
    """Measure how a frame's time grows with servers, pixels, voxels and visible voxels, and name what limits it.

    With --cluster it measures the first machine of a cluster file, the first two and so on, each brought up for its
    turn. With --listen it measures servers that are already up: --workers is then the number of map/shade servers. With
    either, the single process is measured as well if this machine sees the volume. With --threads it also counts what
    each thread of the single process takes of a frame, in the largest image.
    """
    if cluster is not None and (settings["listen"] is not None or settings["spawn"] is not None):
        raise BadInput("--cluster says where the servers are; leave out --listen and --spawn")
    joins = joined_by_hand(settings)
    spawns = cluster is None and not joins
    subject = subject_of(volume, phantom, tables, scene, preset, here=spawns)
    drawers = drawers_from_options(cluster, workers, USUAL_WORKERS)
    shares_drawn, sides = fractions("--sizes", sizes), whole_numbers("--images", images)
    if joins and (workers is None or isinstance(drawers, MeasuredCluster) or len(drawers) != 1):
        raise BadInput(f"--workers {workers}: a cluster has one number of map/shade servers; give it")
    thread_counts = whole_numbers("--threads", threads, most=256) if threads else []
    if thread_counts and not spawns:
        raise BadInput("--threads measures the single process of this machine; leave it out with a cluster")
    if thread_counts:
        check_threads_are_seen()
    predicted_counts = whole_numbers("--predict", predict, most=4096) if predict else []
    if predicted_counts and not spawns:
        raise BadInput("--predict goes by what is measured on this machine; leave it out with a cluster")
    outputs = Outputs(json, markdown, plot)
    outputs.check()
    console = SideConsole()
    with console.status("starting") as status, volume_file(subject, status.update) as path:
        middle = sides[len(sides) // 2]
        cases, taken, found = list[Case](), list[Taken](), ""
        if joins:
            assert isinstance(drawers, list)
            servers = Servers.of(settings | {"workers": drawers[0], "threads": usable_cores()})
            status.stop()
            source = joined(path, servers, console)
        else:
            source = groups_of(drawers, path, settings["memory"], status.update)
        with closing(source) as groups:
            for rows in groups:
                status.stop()
                known = rows[0].renderer.volume
                shown, geometry = subject.scene_of(known), known.description.geometry
                cases = cases or cases_of(shown, geometry, shares_drawn, sides, repeats)
                found = found or str(shares(rows[0].renderer, cases[0].scenes[0]))
                taken += frames_of(rows, cases)
        by_threads = shares_of_threads(path, thread_counts, cases[len(sides) - 1].scenes)
    at_middle = [one for one in taken if one.case.group == "pixels" and one.case.value == middle * middle / 1e6]
    tables_shown = [servers_table(at_middle, middle), growth_table(taken)]
    if spawns:
        tables_shown.append(model_table(taken))
    if predicted_counts:
        tables_shown.append(predictions_table(taken, predicted_counts))
    if by_threads:
        tables_shown.append(threads_table(by_threads, sides[-1]))
    by_servers = [one for one in at_middle if one.row.workers]
    if cluster is not None:
        tables_shown += [cluster_table(by_servers, f"{middle} x {middle}"), links_table(by_servers)]
    facts = {
        "volume": volume_words(known),
        "tables": subject.tables.value,
        "views": f"{repeats} of each setting, {middle} x {middle} pixels where nothing else is said",
        "shares": found,
        "packed voxels": f"{PACKED_VOXEL_BYTES * geometry.box.voxels / 1e6:.3g} MB",
        **{f"what limits {one.row.name}": str(bottleneck(one.usual)) for one in at_middle},
        **{f"machines of {one.row.name}": "; ".join(where_they_run(one)) for one in by_servers},
        **{f"link of {one.row.name}": link_words(one) for one in by_servers},
    }
    figures = [*figures_of(taken), *thread_figures(by_threads)]
    outputs.deliver(record("scaling", facts, figures), tables_shown, panels(taken, at_middle))


def cases_of(
    shown: Scene, geometry: Geometry, shares_drawn: Sequence[float], sides: Sequence[int], repeats: int
) -> list[Case]:
    """Those of the images' sides first."""
    middle, rotations = sides[len(sides) // 2], around(repeats)

    def views(changed: Scene, side: int = middle) -> list[Scene]:
        return [seen(changed, geometry, turned, (side, side)) for turned in rotations]

    return [
        *(Case("pixels", side * side / 1e6, views(shown, side)) for side in sides),
        *voxel_cases(shown, geometry, shares_drawn, views),
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
