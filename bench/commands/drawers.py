"""What draws in `bench paper` and `bench scaling`: servers of this machine in several numbers, or a cluster's."""

from pathlib import Path

import click

from volsplat.bench.clusters.cluster_sizes import Drawers, measured_cluster
from volsplat.bench.commands.option_lists import whole_numbers
from volsplat.program.command_lines import PATH

cluster_option = click.option(
    "--cluster",
    type=PATH,
    metavar="FILE",
    help="Measure the machines of this cluster file, which must not be up: one, two, three … of them.",
)


def drawers_from_options(cluster: Path | None, workers: str | None, usual: str) -> Drawers:
    """Raises BadInput."""
    if cluster is not None:
        return measured_cluster(cluster, whole_numbers("--workers", workers, most=256) if workers else None)
    return whole_numbers("--workers", workers or usual, most=256)
