"""`volsplat deploy`: a cluster's servers brought up, asked after and ended, by one file."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable
from pathlib import Path

import click
from rich.table import Table
from rich.text import Text

from volsplat.client.command.help_page import HelpedCommand
from volsplat.client.command.render_options import size_from_option
from volsplat.deploy.cluster.running import RunningCluster
from volsplat.deploy.cluster.state import MachinesFailed
from volsplat.deploy.doctor.doctor import Doctor
from volsplat.deploy.doctor.finding import Finding
from volsplat.deploy.doctor.forecast import Size
from volsplat.deploy.launchers.launcher import ServerState
from volsplat.program.command_lines import PATH, examples
from volsplat.program.exit_status import EXIT_FAILED
from volsplat.program.plain_console import PlainConsole
from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.text.printable import printable

LOG_LINES = 20
cluster_argument = click.argument("cluster", type=PATH)


@click.group(epilog=examples("volsplat deploy up lab.toml", "volsplat view head.nrrd --cluster lab.toml"))
def deploy() -> None:
    """Start the servers of a cluster file, on one machine or many, check on them, and end them.

    docs/reference/cluster_file.md describes cluster files. Servers that are up serve every command that is given
    --cluster, one after the other.
    """


@deploy.command(cls=HelpedCommand, epilog=examples("volsplat deploy up lab.toml"))
@cluster_argument
def up(cluster: Path) -> None:
    """Start the servers in CLUSTER, a TOML file, that are not running. Status 1 if it is not known whether some are."""
    running = RunningCluster(cluster)
    console = PlainConsole(stderr=True)
    try:
        state = running.up(lines_on(console))
    except MachinesFailed as error:
        others_up = running.heard_of(error.state)
        if not others_up.can_draw:
            raise
        raise BadInput(
            f"{error}; the other {len(others_up.servers)} servers are up, and used by --cluster {cluster}"
        ) from error
    by_hand, every, heard = running.not_asked(state), len(state.servers), len(running.heard_of(state).servers)
    count = f"{every}" if heard == every else f"{heard} of {every}"
    others = [*running.unheard.values(), *(f"{title}: cannot be asked" for title in by_hand.values())]
    told = "".join(f"; {line}" for line in dict.fromkeys(others))
    console.say(f"{running.cluster.name}: {count} servers are up{told}; use them by --cluster {cluster}")
    if running.unheard:
        sys.exit(EXIT_FAILED)


@deploy.command(cls=HelpedCommand, epilog=examples("volsplat deploy status lab.toml"))
@cluster_argument
def status(cluster: Path) -> None:
    """Show the state of every server.

    Status 1 if one has ended, was not started, is still being started, or does not answer.
    """
    running = RunningCluster(cluster)
    statuses, changes = running.statuses(), running.folder.is_locked
    if changes:
        PlainConsole(stderr=True).say(f"another command brings {running.cluster.name} up or down now")
    if not (statuses or changes):
        raise BadInput(f"the cluster {running.cluster.name} is not up; run: volsplat deploy up {cluster}")
    table = Table("server", "where", "state", "", box=None)
    for one, said in statuses:
        row = (one.started.name, one.started.place, said.state.value, said.reason)
        table.add_row(*(Text(printable(cell)) for cell in row))
    if statuses:
        PlainConsole().print(table)
    state = running.folder.load()
    missing = running.never_started(state) if state is not None else []
    for title, line in missing:
        PlainConsole(stderr=True).say(f"{title}: {line}")
    by_hand = running.not_asked(state) if state is not None else {}
    unheard = any(said.state is ServerState.UNKNOWN and one.started.name not in by_hand for one, said in statuses)
    fewer = state is None or len(statuses) < running.wanted(state)
    states = {said.state for _, said in statuses}
    if fewer or unheard or ServerState.ENDED in states or (changes and states != {ServerState.RUNNING}):
        sys.exit(EXIT_FAILED)


@deploy.command(cls=HelpedCommand, epilog=examples("volsplat deploy down lab.toml"))
@cluster_argument
def down(cluster: Path) -> None:
    """End every server, name the machines that do not answer, and say how to end servers that people have started."""
    running = RunningCluster(cluster)
    console = PlainConsole(stderr=True)
    state = running.folder.load()
    by_hand = running.not_asked(state) if state is not None else {}
    running.down(lines_on(console))
    console.say(f"{running.cluster.name} is down" + (f", but for {len(by_hand)} servers" if by_hand else ""))


@deploy.command(cls=HelpedCommand, epilog=examples("volsplat deploy logs lab.toml"))
@cluster_argument
@click.argument("server", required=False)
@click.option("--lines", type=click.IntRange(1, 10000), default=LOG_LINES, help="How many, of each server (20).")
def logs(cluster: Path, server: str | None, lines: int) -> None:
    """Print the last log lines of SERVER, as `status` names it, or of all servers."""
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


@deploy.command(cls=HelpedCommand, epilog=examples("volsplat deploy doctor lab.toml head.nrrd"))
@cluster_argument
@click.argument("volume", required=False)
@click.option("--size", metavar="WxH", default="512x512", help="Image size of the forecast, in pixels (512x512).")
def doctor(cluster: Path, volume: str | None, size: str) -> None:
    """Check each hop to the servers of CLUSTER, and name each cause and its cure. Status 2 if anything is wrong.

    Servers that are not up are started for it, and ended after it. With VOLUME, as `render` takes it, every machine
    must be able to read it and find the same one, and a forecast says how fast it will be drawn.
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
