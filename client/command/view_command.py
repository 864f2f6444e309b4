"""`volsplat view`: a volume in the browser, with every control of the scene."""

from __future__ import annotations

import errno
import socket
from collections.abc import Callable
from contextlib import closing, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from volsplat.client.caller.interrupts import interrupts_held
from volsplat.client.command.help_page import SERVERS, complete_files, headed, helped
from volsplat.client.command.opened_volume import ignored
from volsplat.client.command.render_options import SceneOptions, scene_options
from volsplat.client.command.server_options import Servers, listen_options, memory_option, server_options, trace_option
from volsplat.client.command.terminal_watch import ended_with_its_reader
from volsplat.client.command.view_beginning import ViewBeginning
from volsplat.client.ui.doors.admission import Admission
from volsplat.client.ui.doors.browser_tab import BrowserTab
from volsplat.client.ui.doors.page_address import PageAddress
from volsplat.client.ui.doors.port_holder import port_holder
from volsplat.client.ui.doors.public_address import PublicAddress
from volsplat.program.command_lines import Seconds
from volsplat.program.extras import need
from volsplat.program.many_imports import many_imports
from volsplat.program.plain_console import PlainConsole
from volsplat.program.server_process import Metrics, metrics_of, metrics_options
from volsplat.protocol.description.volume_name import volume_name
from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.wire.addresses import LOOPBACK

if TYPE_CHECKING:
    from volsplat.client.ui.opening.opening import Opening
    from volsplat.client.ui.opening.shown_volume import ShownVolume
    from volsplat.client.ui.viewing.restart import Restart

GRACE_SECONDS = 600


@helped(
    "volsplat view",
    "volsplat view head.nrrd",
    "ssh -t -L 8123:localhost:8123 machine volsplat view /data/head.nrrd --no-browser --port 8123",
)
@click.argument("volume", shell_complete=complete_files, required=False)
@headed(
    "The page",
    click.option("--port", type=click.IntRange(0, 65535), default=0, help="Its port on this machine (any free)."),
    click.option("--no-browser", is_flag=True, help="Print its address only."),
    click.option(
        "--behind",
        metavar="URL",
        help="Its address in the browser if a proxy shows it there: https://hub.example.org/user/me/proxy/8123/.",
    ),
    click.option(
        "--root",
        metavar="FOLDER",
        help="The page opens volumes below this folder only (that of VOLUME, or this one).",
    ),
    click.option(
        "--grace",
        type=Seconds(0),
        default=GRACE_SECONDS,
        metavar="SECONDS",
        help="End after so many seconds without an open page (600).",
    ),
)
@scene_options
@trace_option
@server_options
@memory_option
@headed(SERVERS, metrics_options)
@listen_options
def view(
    volume: str | None,
    port: int,
    no_browser: bool,
    behind: str | None,
    root: str | None,
    grace: float,
    **settings: Any,
) -> None:
    """Show VOLUME in the browser: turn, cut and re-colour it while it refines.

    Without a VOLUME the page asks which one to open, below --root, as the servers see it.

    The page is served to this machine only, and only with the token in the printed address. From
    elsewhere, forward its port: ssh -t -L PORT:localhost:PORT machine volsplat view VOLUME --no-browser --port PORT.
    Behind JupyterHub's or another proxy, say --port and --behind. Ctrl-C ends everything, and so does closing the
    terminal.
    """
    for package in ("nicegui", "PIL"):
        need(package, "the page", "ui")
    metrics = Metrics.of(settings)
    options = SceneOptions.of(settings)
    options.scene_of(None)
    public = None if behind is None else PublicAddress.of(behind)
    servers = Servers.of(settings)
    check_there(volume, root, servers)
    console = PlainConsole(stderr=True)
    beginning = ViewBeginning(servers, options, root, console)
    with ended_with_its_reader(), _bound(port) as bound, beginning.phantoms():
        address = PageAddress(bound, Admission(behind=public))
        title = "volsplat" if volume is None else volume_name(volume).place
        with nullcontext() if no_browser else BrowserTab(address, title) as tab:
            with beginning.begun(volume, tab.say if tab else ignored) as (shown, opening), closing(shown):
                with metrics_of(lambda: shown.session.counts, metrics):
                    _serve(shown, opening, beginning.restart(shown), address, grace, tab, console)


def check_there(volume: str | None, root: str | None, servers: Servers) -> None:
    """Raises BadInput for a volume or --root that is not there, where that is seen from here."""
    if volume is not None:
        servers.check_sees(volume)
    if root is not None and servers.here and not Path(root).is_dir():
        raise BadInput(f"--root {root}: is no folder; name one that volumes lie below")


def _serve(
    shown: ShownVolume,
    opening: Opening | None,
    restart: Callable[[], Restart | None],
    address: PageAddress,
    grace: float,
    tab: BrowserTab | None,
    console: PlainConsole,
) -> None:
    with interrupts_held(), many_imports():
        from volsplat.client.ui.application import Application
        from volsplat.client.ui.opening.start_page import start_page
        from volsplat.client.ui.page import page
        from volsplat.client.ui.viewport.early_picture import show_first

    if shown.viewing is not None:
        if tab is not None:
            show_first(shown.viewing, tab.show)
        shown.viewing.loop.start()

    def build() -> None:
        if shown.viewing is not None:
            page(shown.viewing, restart(), opening)
        elif opening is not None:
            start_page(shown, opening)

    application = Application(shown, build, address, grace)
    if tab is not None:
        tab.make_room()
    application.run(lambda: _tell_address(shown, address, console))
    if application.ended_by_grace:
        console.say(f"no page was open for {grace:g} s: everything has ended")


def _tell_address(shown: ShownVolume, address: PageAddress, console: PlainConsole) -> None:
    console.end_status()
    what = "volsplat" if shown.viewing is None else shown.viewing.volume.description.name
    for line in (f"{what} is at", "", f"    {address.url}", ""):
        console.say(line)


def _bound(port: int) -> socket.socket:
    """A socket at the port, or at any free one for 0; nobody is answered yet. Raises BadInput if it is taken."""
    bound = socket.socket()
    bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        bound.bind((LOOPBACK, port))
    except OSError as error:
        bound.close()
        why = port_holder(port) if error.errno == errno.EADDRINUSE else error.strerror
        raise BadInput(f"--port {port}: {why}; or choose another port, or leave it out") from error
    return bound
