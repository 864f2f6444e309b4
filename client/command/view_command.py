"""`volsplat view`: a volume in the browser, with every control of the scene."""

from __future__ import annotations

import errno
import socket
from contextlib import closing, nullcontext
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import msgspec

from volsplat.client.caller.interrupts import interrupts_held
from volsplat.client.command.help_page import SERVERS, headed, helped, volume_argument
from volsplat.client.command.opened_volume import (
    Servers,
    check_found,
    ignored,
    memory_option,
    opened,
    server_options,
    servers_from_options,
    session_of,
    trace_option,
)
from volsplat.client.command.render_options import SceneOptions, scene_options
from volsplat.client.command.terminal_watch import ended_with_its_reader
from volsplat.client.session.session import Session
from volsplat.client.ui.doors.admission import Admission
from volsplat.client.ui.doors.browser_tab import BrowserTab
from volsplat.client.ui.doors.page_address import PageAddress
from volsplat.client.ui.doors.port_holder import port_holder
from volsplat.client.ui.doors.public_address import PublicAddress
from volsplat.program.extras import need
from volsplat.program.plain_console import PlainConsole
from volsplat.program.server_process import checked_metrics, metrics_of, metrics_options
from volsplat.protocol.description.scene import PaperStep, Refine
from volsplat.protocol.description.volume_name import volume_name
from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.wire.addresses import LOOPBACK, Address

if TYPE_CHECKING:
    from volsplat.client.ui.viewing.restart import Restart
    from volsplat.client.ui.viewing.viewing import Viewing

GRACE_SECONDS = 600
PAGE = tuple(f"volsplat.client.ui.{module}" for module in ("lean_nicegui", "application", "page"))  # takes a while
LIT_FROM = PaperStep.C  # shading by tables costs nothing, so that the page need not wait for light until E


@helped(
    "volsplat view head.nrrd",
    "ssh -t -L 8123:localhost:8123 machine volsplat view /data/head.nrrd --no-browser --port 8123",
)
@volume_argument
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
        "--grace",
        type=click.FloatRange(min=0),
        default=GRACE_SECONDS,
        metavar="SECONDS",
        help="End when no page has been open for so long (600).",
    ),
)
@scene_options
@trace_option
@server_options
@memory_option
@headed(
    SERVERS,
    metrics_options,
    click.option("--listen", metavar="HOST:PORT", help="Wait here for servers started by hand, and start none."),
    click.option(
        "--token-file", type=click.Path(path_type=Path), help="The servers' token; made with --listen if missing."
    ),
)
def view(
    volume: str,
    workers: int,
    splat_servers: int,
    threads: int,
    silence: float,
    tls: bool | None,
    cluster: Path | None,
    port: int,
    no_browser: bool,
    behind: str | None,
    grace: float,
    memory: str | None,
    trace: Path | None,
    metrics: Address | None,
    metrics_token: Path | None,
    listen: str | None,
    token_file: Path | None,
    **settings: Any,
) -> None:
    """Show VOLUME in the browser: turn, cut and re-colour it while it refines.

    The page is served to this machine alone, and to nobody without the token of the address that is printed. From
    elsewhere, forward its port: ssh -t -L PORT:localhost:PORT machine volsplat view VOLUME --no-browser --port PORT.
    Behind JupyterHub's or another proxy, say --port and --behind. Ctrl-C ends everything, and so does the end of the
    terminal.
    """
    for package in ("nicegui", "PIL"):
        need(package, "the page", "ui")
    door = checked_metrics(metrics, metrics_token)
    options = SceneOptions.of(settings)
    options.scene_of(None)
    public = None if behind is None else PublicAddress.of(behind)
    check_found(volume, listen is None, cluster)
    servers = servers_from_options(
        workers,
        splat_servers,
        threads,
        listen,
        token_file,
        memory=memory,
        cluster=cluster,
        silence=silence,
        tls=tls,
        trace=trace,
    )
    console = PlainConsole(stderr=True)
    with ended_with_its_reader(), _bound(port) as bound:
        address = PageAddress(bound, Admission(behind=public))
        with nullcontext() if no_browser else BrowserTab(address, volume_name(volume).place) as tab:
            with opened(volume, servers, listen is None, console, tab.say if tab else ignored, PAGE) as session:
                assert isinstance(session, Session)
                options.tell_unsuited(session.volume, console)
                viewing = _viewing_of(session, options, by_hand=listen is not None)
                restart = None if listen else _restart_of(viewing, volume, servers)
                with closing(viewing), metrics_of(lambda: viewing.session.counts, metrics, door):
                    _serve(viewing, restart, address, grace, tab, console)


def _viewing_of(session: Session, options: SceneOptions, by_hand: bool) -> Viewing:
    with interrupts_held():
        from volsplat.client.ui.viewing.opened_viewing import opened_viewing
        from volsplat.client.ui.viewing.trouble import BY_BUTTON, BY_HAND

    first = options.scene_of(session.volume)
    if options.scene is None:
        first = msgspec.structs.replace(first, refine=Refine(lit_from=LIT_FROM))
    return opened_viewing(session, first, cure=BY_HAND if by_hand else BY_BUTTON)


def _restart_of(viewing: Viewing, volume: str, servers: Servers) -> Restart:
    """What starts the servers again; the trace stays that of the first ones, whose place it would take."""
    from volsplat.client.ui.viewing.restart import Restart

    untraced = replace(servers, trace=None)
    return Restart(viewing, lambda say: session_of(volume, untraced, True, say))


def _serve(
    viewing: Viewing,
    restart: Restart | None,
    address: PageAddress,
    grace: float,
    tab: BrowserTab | None,
    console: PlainConsole,
) -> None:
    with interrupts_held():
        from volsplat.client.ui.application import Application
        from volsplat.client.ui.page import page

    application = Application(viewing, partial(page, restart=restart), address, grace)

    def ready() -> None:
        for line in (f"{viewing.volume.description.name} is at", "", f"    {address.url}", ""):
            console.say(line)
        if tab is not None:
            tab.open()

    if tab is not None:
        tab.make_room()
    application.run(ready)
    if application.ended_by_grace:
        console.say(f"no page was open for {grace:g} s: everything has ended")


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
