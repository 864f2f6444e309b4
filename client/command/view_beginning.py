"""What `volsplat view` shows first, as its options say, and what opens the next volume."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from volsplat.client.caller.interrupts import interrupts_held
from volsplat.client.command.opened_volume import ignored, opened, session_of, tell_how_to_join
from volsplat.client.command.render_options import SceneOptions
from volsplat.client.command.server_options import Servers
from volsplat.client.scene.lit_from import WATCHED_FROM, lit_from
from volsplat.client.session.session import Session
from volsplat.program.confinement import can_confine
from volsplat.program.plain_console import PlainConsole
from volsplat.program.temporary_folder import temporary_folder
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.volume_name import volume_name

if TYPE_CHECKING:
    from volsplat.client.ui.opening.opening import Opening, Say
    from volsplat.client.ui.opening.phantom_files import PhantomFiles
    from volsplat.client.ui.opening.shown_volume import ShownVolume
    from volsplat.client.ui.viewing.restart import Restart
    from volsplat.client.ui.viewing.viewing import Viewing

# What takes a while.
PAGE = tuple(
    f"volsplat.client.ui.{module}"
    for module in ("lean_nicegui", "application", "page", "first_uses", "opening.start_page", "viewing.opened_viewing")
)


class ViewBeginning:
    """Of one call of the command."""

    def __init__(self, servers: Servers, options: SceneOptions, root: str | None, console: PlainConsole) -> None:
        self._servers = servers
        self._options = options if options.scene is not None else replace(options, lit_from=WATCHED_FROM)
        self._root = root
        self._console = console
        self._phantoms: PhantomFiles | None = None

    @contextmanager
    def phantoms(self) -> Iterator[None]:
        """A folder for them, where the servers see this machine's files."""
        from volsplat.client.ui.opening.phantom_files import PhantomFiles

        if not self._servers.here:
            yield
            return
        with ExitStack() as later:
            self._phantoms = PhantomFiles(lambda: later.enter_context(temporary_folder()))
            yield

    @contextmanager
    def begun(self, volume: str | None, say: Callable[[str], None]) -> Iterator[tuple[ShownVolume, Opening | None]]:
        """What is shown at first."""
        if volume is None:
            yield self._begun_without()
            return
        with opened(volume, self._servers, self._console, say, PAGE) as session:
            assert isinstance(session, Session)
            self._join_again(session)
            self._options.tell_unsuited(session.volume, self._console)
            shown = self._shown(self._viewing_of(session, first=True), volume)
            yield shown, self._opening_of(shown, volume)

    def restart(self, shown: ShownVolume) -> Callable[[], Restart | None]:
        """What starts the servers again, unless that is done by hand."""
        return lambda: None if self._servers.by_hand else shown.restart

    def _begun_without(self) -> tuple[ShownVolume, Opening]:
        from volsplat.client.ui.opening.no_volume import NoVolume
        from volsplat.client.ui.opening.opening import Opening
        from volsplat.client.ui.opening.shown_volume import ShownVolume

        self._root = root = self._root or (str(Path.cwd()) if self._servers.here else ".")
        few = replace(self._servers, workers=1, splat_servers=1) if self._servers.here else self._servers
        none = NoVolume(lambda: self._session(None, root, ignored, few))
        if self._servers.by_hand:
            tell_how_to_join(none.session, few, self._console)
            self._join_again(none.session)
        shown = ShownVolume(none=none)
        first = [True]  # until a volume is shown: the command's options are for that one

        def made(session: Session, scene: Scene | None) -> Viewing:
            if first[0]:
                self._options.tell_unsuited(session.volume, self._console)
            viewing = self._viewing_of(session, first=first[0], scene=scene)
            first[0] = False
            return viewing

        return shown, Opening(shown, root, None, self._session, made, not self._servers.here, self._phantoms)

    def _join_again(self, session: Session) -> None:
        """Servers that were started by hand find later sessions where they found this one."""
        if self._servers.by_hand:
            self._servers = replace(self._servers, token=session.token, listen=session.address)

    def _session(self, volume: str | None, held_to: str | None, say: Say, servers: Servers | None = None) -> Session:
        """For a later volume: the trace stays that of the first one, whose place it would take."""
        held = held_to if self._servers.here and can_confine() else None
        later = replace(servers or self._servers, trace=None, data_root=held)
        return session_of(volume, later, say, self._console)

    def _viewing_of(self, session: Session, first: bool, scene: Scene | None = None) -> Viewing:
        """The `first` looks as the command's options say. What nobody has set is lit from its first steps on."""
        with interrupts_held():
            from volsplat.client.ui.viewing.opened_viewing import opened_viewing
            from volsplat.client.ui.viewing.trouble import BY_BUTTON, BY_HAND

        if scene is None and first:
            scene = self._options.scene_of(session.volume)
        elif scene is None:
            scene = lit_from(session.default_scene())
        return opened_viewing(session, scene, cure=BY_HAND if self._servers.by_hand else BY_BUTTON)

    def _shown(self, viewing: Viewing, volume: str) -> ShownVolume:
        from volsplat.client.ui.opening.shown_volume import ShownVolume
        from volsplat.client.ui.viewing.restart import Restart

        again = replace(self._servers, trace=None)
        return ShownVolume(viewing, Restart(viewing, lambda say: session_of(volume, again, say, self._console)))

    def _opening_of(self, shown: ShownVolume, volume: str) -> Opening | None:
        """What opens other volumes below the root; of a volume on the web the root must be given."""
        from volsplat.client.ui.opening.opening import Opening

        if self._root is None:
            name = volume_name(volume)
            if name.is_url:
                return None
            place = Path(name.place)
            self._root = str(place.absolute().parent if self._servers.here else place.parent)

        def made(session: Session, scene: Scene | None) -> Viewing:
            return self._viewing_of(session, first=False, scene=scene)

        return Opening(shown, self._root, volume, self._session, made, not self._servers.here, self._phantoms)
