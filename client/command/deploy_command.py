"""`volsplat deploy`: a cluster's servers brought up, asked after and ended, by one file."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path

import click
from rich.table import Table
from rich.text import Text

from volsplat.client.command.render_options import size_from_option
from volsplat.deploy.cluster.running import RunningCluster
from volsplat.deploy.doctor.doctor import Doctor
from volsplat.deploy.doctor.finding import Finding
from volsplat.deploy.doctor.forecast import Size
from volsplat.deploy.launchers.launcher import ServerState
from volsplat.program.plain_console import PlainConsole
from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.text.printable import printable

LOG_LINES = 20
cluster_argument = click.argument("cluster", type=click.Path(path_type=Path))


@click.group()
def deploy() -> None:
    """Bring up the servers of a cluster file, on one machine or many, and end them.

    What stands in a cluster file is in docs/reference/cluster_file.md. Servers that are up are used by every command
    that takes --cluster, one after the other.
    """


@deploy.command()
@cluster_argument
def up(cluster: Path) -> None:
    """Start what is not running of the servers in CLUSTER, a TOML file."""
    running = RunningCluster(cluster)
    console = PlainConsole(stderr=True)
    state = running.up(lines_on(console))
    console.say(f"{running.cluster.name}: {len(state.servers)} servers are up; use them by --cluster {cluster}")


@deploy.command()
@cluster_argument
def status(cluster: Path) -> None:
    """Show how every server is. Status 1 if one does not run."""
    running = RunningCluster(cluster)
    statuses = running.statuses()
    if not statuses:
        raise BadInput(f"the cluster {running.cluster.name} is not up; run: volsplat deploy up {cluster}")
    table = Table("server", "where", "state", "", box=None)
    for one, said in statuses:
        row = (one.started.name, one.started.place, said.state.value, said.reason)
        table.add_row(*(Text(printable(cell)) for cell in row))
    PlainConsole().print(table)
    if any(said.state is ServerState.ENDED for _, said in statuses):
        raise click.exceptions.Exit(1)


@deploy.command()
@cluster_argument
def down(cluster: Path) -> None:
    """End every server, also if some machines do not answer: those are named."""
    running = RunningCluster(cluster)
    console = PlainConsole(stderr=True)
    running.down(lines_on(console))
    console.say(f"{running.cluster.name} is down")


@deploy.command()
@cluster_argument
@click.argument("server", required=False)
@click.option(
    "--lines", type=click.IntRange(1, 10000), default=LOG_LINES, help="Of each server, the last so many (20)."
)
def logs(cluster: Path, server: str | None, lines: int) -> None:
    """Print what SERVER has said lately, or all of them; names are those of `status`."""
    running = RunningCluster(cluster)
    state = running.folder.load()
    if state is None:
        raise BadInput(f"the cluster {running.cluster.name} is not up; run: volsplat deploy up {cluster}")
    chosen = [one for one in state.servers if server in (None, one.started.name)]
    if not chosen:
        names = ", ".join(one.started.name for one in state.servers)
        raise BadInput(f"{server}: there is no such server; choose from {names}")
    console = PlainConsole()
    for one in chosen:
        try:
            said = running.logs(one, lines)
        except BadInput as error:
            said = str(error)
        for line in said.splitlines():
            console.say(f"{one.started.name}: {line}")


@deploy.command()
@cluster_argument
@click.argument("volume", required=False)
@click.option("--size", metavar="WxH", default="512x512", help="Image size of the forecast, in pixels (512x512).")
def doctor(cluster: Path, volume: str | None, size: str) -> None:
    """Look at each hop to the servers of CLUSTER, and say what is wrong and the cure. Status 2 if something is.

    Servers that are not up are started for it, and ended after it. With VOLUME, as `render` takes it, it is also looked
    at on every machine: whether it can be read, and is the same one; and a forecast is made of how fast it is drawn.
    """
    console, progress = PlainConsole(), PlainConsole(stderr=True)
    asked = Size(*size_from_option(size))
    examined = Doctor(cluster, volume, asked, lambda finding: console.say(told(finding)), lines_on(progress))
    examined.examine()
    wrong = sum(not finding.right for finding in examined.findings)
    if wrong:
        raise BadInput(f"{wrong} of {len(examined.findings)} hops are wrong; their lines say how to put them right")
    console.say(f"all {len(examined.findings)} hops are right")


def told(finding: Finding) -> str:
    """One line on a hop."""
    return f"{'ok' if finding.right else 'WRONG':5} {finding.place}: {finding.hop}: {finding.line}"


def lines_on(console: PlainConsole) -> Callable[[str], None]:
    """Says each line, whichever thread brings it."""
    lock = threading.Lock()

    def say(line: str) -> None:
        with lock:
            console.say(line)

    return say
