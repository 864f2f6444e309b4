"""`volsplat view`: a volume in the browser, with every control of the scene."""

from __future__ import annotations

import errno
import socket
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, nullcontext
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import click
import msgspec

from volsplat.client.caller.interrupts import interrupts_held
from volsplat.client.command.help_page import SERVERS, complete_files, headed, helped
from volsplat.client.command.opened_volume import (
    Servers,
    check_found,
    ignored,
    memory_option,
    opened,
    server_options,
    servers_from_options,
    session_of,
    tell_how_to_join,
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
from volsplat.program.many_imports import many_imports
from volsplat.program.plain_console import PlainConsole
from volsplat.program.server_process import checked_metrics, metrics_of, metrics_options
from volsplat.protocol.description.scene import PaperStep, Refine, Scene
from volsplat.protocol.description.volume_name import volume_name
from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.wire.addresses import LOOPBACK, Address

if TYPE_CHECKING:
    from volsplat.client.ui.opening.opening import Opening, Say
    from volsplat.client.ui.opening.phantom_files import PhantomFiles
    from volsplat.client.ui.opening.shown_volume import ShownVolume
    from volsplat.client.ui.viewing.restart import Restart
    from volsplat.client.ui.viewing.viewing import Viewing

GRACE_SECONDS = 600
PAGE = tuple(f"volsplat.client.ui.{module}" for module in ("lean_nicegui", "application", "page"))  # takes a while
LIT_FROM = PaperStep.C  # shading by tables costs nothing, so that the page need not wait for light until E


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
        type=click.FloatRange(min=0),
        default=GRACE_SECONDS,
        metavar="SECONDS",
        help="End after so many seconds without an open page (600).",
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
    volume: str | None,
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

    Without a VOLUME the page asks which one to open, below --root, as the servers see it.

    The page is served to this machine only, and only with the token in the printed address. From
    elsewhere, forward its port: ssh -t -L PORT:localhost:PORT machine volsplat view VOLUME --no-browser --port PORT.
    Behind JupyterHub's or another proxy, say --port and --behind. Ctrl-C ends everything, and so does closing the
    terminal.
    """
    for package in ("nicegui", "PIL"):
        need(package, "the page", "ui")
    door = checked_metrics(metrics, metrics_token)
    options = SceneOptions.of(settings)
    options.scene_of(None)
    public = None if behind is None else PublicAddress.of(behind)
    if volume is not None:
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
    how = _Page(servers, options, root, by_hand=listen is not None, console=console)
    with ended_with_its_reader(), _bound(port) as bound, how.phantoms():
        address = PageAddress(bound, Admission(behind=public))
        title = "volsplat" if volume is None else volume_name(volume).place
        with nullcontext() if no_browser else BrowserTab(address, title) as tab:
            with how.begun(volume, tab.say if tab else ignored) as (shown, opening), closing(shown):
                with metrics_of(lambda: shown.session.counts, metrics, door):
                    _serve(shown, opening, how.restart(shown), address, grace, tab, console)


class _Page:
    """What is shown first, and what opens the next volume."""

    def __init__(
        self, servers: Servers, options: SceneOptions, root: str | None, by_hand: bool, console: PlainConsole
    ) -> None:
        self._servers = servers
        self._options = options
        self._root = root
        self._by_hand = by_hand
        self._console = console
        self._here = servers.cluster is None and not by_hand
        self._phantoms: PhantomFiles | None = None

    @contextmanager
    def phantoms(self) -> Iterator[None]:
        """A folder for them, where the servers see this machine's files."""
        from volsplat.client.ui.opening.phantom_files import PhantomFiles

        if not self._here:
            yield
            return
        with TemporaryDirectory(prefix="volsplat-", ignore_cleanup_errors=True) as folder:
            self._phantoms = PhantomFiles(Path(folder))
            yield

    @contextmanager
    def begun(self, volume: str | None, say: Callable[[str], None]) -> Iterator[tuple[ShownVolume, Opening | None]]:
        """What is shown at first."""
        if volume is None:
            yield self._begun_without()
            return
        with opened(volume, self._servers, not self._by_hand, self._console, say, PAGE) as session:
            assert isinstance(session, Session)
            self._join_again(session)
            self._options.tell_unsuited(session.volume, self._console)
            shown = self._shown(self._viewing_of(session, first=True), volume)
            yield shown, self._opening_of(shown, volume)

    def restart(self, shown: ShownVolume) -> Callable[[], Restart | None]:
        """What starts the servers again, unless that is done by hand."""
        return lambda: None if self._by_hand else shown.restart

    def _begun_without(self) -> tuple[ShownVolume, Opening]:
        from volsplat.client.ui.opening.no_volume import NoVolume
        from volsplat.client.ui.opening.opening import Opening
        from volsplat.client.ui.opening.shown_volume import ShownVolume

        self._root = root = self._root or (str(Path.cwd()) if self._here else ".")
        few = replace(self._servers, workers=1, splat_servers=1) if self._here else self._servers
        none = NoVolume(lambda: self._session(None, root, ignored, few))
        if self._by_hand:
            tell_how_to_join(none.session, none.session.token, self._servers.token is not None, self._console, few.tls)
            self._join_again(none.session)
        shown = ShownVolume(none=none)
        first = [True]  # until a volume is shown: the command's options are for that one

        def made(session: Session, scene: Scene | None) -> Viewing:
            if first[0]:
                self._options.tell_unsuited(session.volume, self._console)
            viewing = self._viewing_of(session, first=first[0], scene=scene)
            first[0] = False
            return viewing

        return shown, Opening(shown, root, None, self._session, made, not self._here, self._phantoms)

    def _join_again(self, session: Session) -> None:
        """Servers that were started by hand find later sessions where they found this one."""
        if self._by_hand:
            self._servers = replace(self._servers, token=session.token, listen=session.address)

    def _session(self, volume: str | None, held_to: str | None, say: Say, servers: Servers | None = None) -> Session:
        """For a later volume: the trace stays that of the first one, whose place it would take."""
        held = held_to if self._here and can_confine() else None
        later = replace(servers or self._servers, trace=None, data_root=held)
        return session_of(volume, later, not self._by_hand, say)

    def _viewing_of(self, session: Session, first: bool, scene: Scene | None = None) -> Viewing:
        """The `first` looks as the command's options say. What nobody has set is lit from its first steps on."""
        with interrupts_held():
            from volsplat.client.ui.viewing.opened_viewing import opened_viewing
            from volsplat.client.ui.viewing.trouble import BY_BUTTON, BY_HAND

        lit = scene is None and not (first and self._options.scene is not None)
        if scene is None:
            scene = self._options.scene_of(session.volume) if first else session.default_scene()
        if lit:
            scene = msgspec.structs.replace(scene, refine=Refine(lit_from=LIT_FROM))
        return opened_viewing(session, scene, cure=BY_HAND if self._by_hand else BY_BUTTON)

    def _shown(self, viewing: Viewing, volume: str) -> ShownVolume:
        from volsplat.client.ui.opening.shown_volume import ShownVolume
        from volsplat.client.ui.viewing.restart import Restart

        again = replace(self._servers, trace=None)
        return ShownVolume(viewing, Restart(viewing, lambda say: session_of(volume, again, not self._by_hand, say)))

    def _opening_of(self, shown: ShownVolume, volume: str) -> Opening | None:
        """What opens other volumes below the root; of a volume on the web the root must be given."""
        from volsplat.client.ui.opening.opening import Opening

        if self._root is None:
            name = volume_name(volume)
            if name.is_url:
                return None
            place = Path(name.place)
            self._root = str(place.absolute().parent if self._here else place.parent)

        def made(session: Session, scene: Scene | None) -> Viewing:
            return self._viewing_of(session, first=False, scene=scene)

        return Opening(shown, self._root, volume, self._session, made, not self._here, self._phantoms)


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

    def build() -> None:
        if shown.viewing is not None:
            page(shown.viewing, restart(), opening)
        elif opening is not None:
            start_page(shown, opening)

    application = Application(shown, build, address, grace)

    def ready() -> None:
        what = "volsplat" if shown.viewing is None else shown.viewing.volume.description.name
        for line in (f"{what} is at", "", f"    {address.url}", ""):
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
