"""`volsplat view`: a volume in the browser, with every control of the scene."""

from __future__ import annotations

import errno
import socket
from contextlib import closing, nullcontext
from dataclasses import replace
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
from volsplat.program.confinement import can_confine
from volsplat.program.extras import need
from volsplat.program.plain_console import PlainConsole
from volsplat.program.server_process import checked_metrics, metrics_of, metrics_options
from volsplat.protocol.description.scene import PaperStep, Refine, Scene
from volsplat.protocol.description.volume_name import volume_name
from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.wire.addresses import LOOPBACK, Address

if TYPE_CHECKING:
    from volsplat.client.ui.opening.opening import Opening
    from volsplat.client.ui.opening.shown_volume import ShownVolume
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
        "--root",
        metavar="FOLDER",
        help="Other volumes can be opened on the page from below this folder alone (that of VOLUME).",
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
    root: str | None,
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
    if root is not None and listen is None and cluster is None and not Path(root).is_dir():
        raise BadInput(f"--root {root}: is no folder; name one that volumes lie below")
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
                viewing = _viewing_of(
                    session, options.scene_of(session.volume), options.scene is None, listen is not None
                )
                shown = _shown(viewing, volume, servers, by_hand=listen is not None)
                opening = None if listen else _opening_of(shown, volume, root, servers)
                with closing(shown), metrics_of(lambda: shown.viewing.session.counts, metrics, door):
                    _serve(shown, opening, address, grace, tab, console)


def _viewing_of(session: Session, scene: Scene, lit: bool, by_hand: bool = False) -> Viewing:
    """What is `lit` is so from its first steps on."""
    with interrupts_held():
        from volsplat.client.ui.viewing.opened_viewing import opened_viewing
        from volsplat.client.ui.viewing.trouble import BY_BUTTON, BY_HAND

    first = msgspec.structs.replace(scene, refine=Refine(lit_from=LIT_FROM)) if lit else scene
    return opened_viewing(session, first, cure=BY_HAND if by_hand else BY_BUTTON)


def _shown(viewing: Viewing, volume: str, servers: Servers, by_hand: bool) -> ShownVolume:
    """With what starts the servers again, unless that is done by hand."""
    from volsplat.client.ui.opening.shown_volume import ShownVolume
    from volsplat.client.ui.viewing.restart import Restart

    again = _again(servers)
    return ShownVolume(viewing, None if by_hand else Restart(viewing, lambda say: session_of(volume, again, True, say)))


def _again(servers: Servers) -> Servers:
    """For a later session: the trace stays that of the first one, whose place it would take."""
    return replace(servers, trace=None)


def _opening_of(shown: ShownVolume, volume: str, root: str | None, servers: Servers) -> Opening | None:
    """What opens other volumes below the root; of a volume on the web the root must be given."""
    from volsplat.client.ui.opening.opening import Opening

    if root is None:
        name = volume_name(volume)
        if name.is_url:
            return None
        root = str(Path(name.place).parent if servers.cluster else Path(name.place).absolute().parent)
    here = servers.cluster is None
    later = replace(_again(servers), data_root=root if here and can_confine() else None)

    def made(session: Session, scene: Scene | None) -> Viewing:
        return _viewing_of(session, scene or session.default_scene(), lit=scene is None)

    return Opening(shown, root, volume, lambda name, say: session_of(name, later, True, say), made, not here)


def _serve(
    shown: ShownVolume,
    opening: Opening | None,
    address: PageAddress,
    grace: float,
    tab: BrowserTab | None,
    console: PlainConsole,
) -> None:
    with interrupts_held():
        from volsplat.client.ui.application import Application
        from volsplat.client.ui.page import page

    def build(viewing: Viewing) -> None:
        page(viewing, shown.restart, opening)

    application = Application(shown, build, address, grace)

    def ready() -> None:
        for line in (f"{shown.viewing.volume.description.name} is at", "", f"    {address.url}", ""):
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
