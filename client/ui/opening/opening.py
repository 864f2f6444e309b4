"""Opens another volume in the place of the one that is shown, or the first. What is shown is drawn on until then."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from os.path import normpath
from pathlib import Path
from typing import NamedTuple

from volsplat.client.scene.resized import sized
from volsplat.client.session.session import Session
from volsplat.client.ui.opening.kept_look import with_look_of, with_tables_of
from volsplat.client.ui.opening.phantom_files import GivenUp, PhantomFiles
from volsplat.client.ui.opening.shown_volume import ShownVolume
from volsplat.client.ui.viewing.restart import Restart
from volsplat.client.ui.viewing.viewing import Feed, Viewing
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.volume_name import VolumeName, volume_name
from volsplat.protocol.messages.folder_messages import FolderEntry, FolderListed
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.text.errors import BadInput, PeerLost

MOST_RECENT = 10
SERVERS_FOLDER = "the servers' folder"  # in which they were started, or their --data-root

Say = Callable[[str], None]
# Of a volume, and of servers that read nothing outside of a folder, if one is given; with what to do with words for
# what takes time.
OpenSession = Callable[[str, str | None, Say], Session]
MakeViewing = Callable[[Session, Scene | None], Viewing]  # of a scene, or of the one that suits the volume


class Keep(StrEnum):
    """What the next volume has of the one before."""

    NOTHING = "nothing"
    TABLES = "its tables"
    LOOK = "all of its scene, if it is of the same series"


class Place(NamedTuple):
    """A volume below the root: the way to its folder, its name there ("" for the folder itself), and the part meant.

    Or a phantom, by its name.
    """

    folder: str
    name: str
    part: str = ""
    is_phantom: bool = False

    def __str__(self) -> str:
        if self.is_phantom:
            return f"phantom {self.name}"
        return str(VolumeName("/".join(filter(None, (self.folder, self.name))) or ".", self.part))


class Dropped(NamedTuple):
    """What a browser tells of a file or folder that is dropped on its page: not where it lies. A folder has 0 bytes."""

    name: str
    bytes: int
    is_folder: bool


@dataclass(frozen=True)
class News:
    """What is being opened, "" for nothing, and a line of how it goes."""

    opening: str
    line: str


class Opening:
    """Any tab may list folders below `root` and open what lies there, one volume at a time.

    `root` and names are as the servers see them. `first` is the volume that is shown already, if one is. Servers that
    serve one session at a time, `alone`, leave what is shown before they open another one, and come back to it if that
    fails. `phantoms` can be opened as well, by servers that see this machine's files.
    """

    def __init__(
        self,
        shown: ShownVolume,
        root: str,
        first: str | None,
        open_session: OpenSession,
        make_viewing: MakeViewing,
        alone: bool = False,
        phantoms: PhantomFiles | None = None,
    ) -> None:
        self._shown = shown
        self._root = root
        self._open_session = open_session
        self._make_viewing = make_viewing
        self._alone = alone
        self._phantoms = phantoms
        self._telling = threading.Lock()  # guards what is told now
        self.news: Feed[News] = Feed()
        self.now = News("", "")
        self.recent: list[Place] = []  # newest first
        self._left: dict[Place, Scene] = {}  # how volumes looked when others were opened
        self._cancelled = False
        self._place = None if first is None else place_below(root, first)
        self._note(self._place)

    @property
    def root_name(self) -> str:
        return Path(self._root).name or (SERVERS_FOLDER if self._root == "." else self._root)

    @property
    def waits_for_servers(self) -> bool:
        """Whether nobody is there yet who can tell what lies in folders."""
        return all(server.role is not Role.MAPSHADE_SERVER or server.lost for server in self._shown.session.servers)

    @property
    def first_folder(self) -> str:
        """The folder to begin with: that of the volume that is shown."""
        return "" if self._place is None else self._place.folder

    @property
    def phantoms(self) -> list[str]:
        """The names of those that can be opened."""
        return self._phantoms.names if self._phantoms is not None else []

    def listed(self, folder: str, words: str) -> FolderListed:
        """What lies there; waits for a server. Raises BadInput and PeerLost."""
        return self._shown.session.list_folder(self._root, folder, words)

    def parts(self, place: Place) -> FolderListed:
        """The parts that a volume has, none where nothing can be chosen. As `listed`, and raises what opening would."""
        return self.listed(str(place), "")

    @property
    def may_step(self) -> bool:
        """Whether it is known what stands beside the volume that is shown."""
        return self._place is not None and not self._place.is_phantom

    def beside(self, further: int) -> Place | str:
        """The volume so much further on than what is shown, among the parts of its file or else in its folder.

        Or a line that says that there is none. Waits for a server. Raises BadInput where no order is known, and
        PeerLost.
        """
        place = self._place
        if place is None or place.is_phantom:
            raise BadInput("no folder is known in which a next volume could be; choose one (O)")
        listed = self.parts(place._replace(part="")) if place.part else self.listed(place.folder, "")
        places = _volumes_around(place, listed)
        known = f"only the first {len(listed.entries)} names here are known" if listed.left_out else ""
        if place not in places:
            raise BadInput(f"{place}: {known or 'nothing tells what comes next'}; choose a volume (O)")
        at = places.index(place) + further
        if 0 <= at < len(places):
            return places[at]
        if further > 0 and known:
            return f"{known}, and this is the last volume of these; choose the next one (O)"
        return f"this is the {'first' if further < 0 else 'last'} volume here"

    def place_named(self, folder: str, typed: str) -> Place | str:
        """The volume at the end of a way from a folder, or from the root, or the folder there.

        The last name may be a part of the only one that has it. Raises BadInput, also if several have.
        """
        name = volume_name(typed, lambda place: self._is_there(folder, place))
        below = self._place_at(folder, name.place)
        if below is None:
            raise BadInput(f"{typed}: is not below {self.root_name}; choose another one")
        if below.name and not name.part:
            there = self.listed(below.folder, below.name)
            entry = next((one for one in there.entries if one.name == below.name), None)
            entry = entry or self._completed(below, there, ", or choose one" if below.folder == folder else "")
            if entry is not None and entry.is_folder and not entry.is_volume:
                return "/".join(filter(None, (below.folder, entry.name)))
            return below if entry is None else Place(below.folder, entry.name, entry.part)
        return below._replace(part=name.part)

    def _place_at(self, folder: str, way: str) -> Place | None:
        return _place_by(normpath(self._root), normpath(Path(self._root, folder, way)))

    def _is_there(self, folder: str, way: str) -> bool:
        """Whether the servers see something of this very name."""
        if (place := self._place_at(folder, way)) is None:
            return False
        try:
            there = self.listed(place.folder, place.name)
        except BadInput:  # it would lie in what is no folder
            return False
        return any(one.name == place.name for one in there.entries)

    def _completed(self, typed: Place, there: FolderListed, choose: str) -> FolderEntry | None:
        """The only entry that begins so or, if none does, has this in it; None where nothing has."""
        begun = [one for one in there.entries if one.name.casefold().startswith(typed.name.casefold())]
        alike = begun or there.entries
        if not alike:
            return None
        if len(alike) == 1 and not there.left_out:
            return alike[0]
        count = f"{len(alike)}{' or more' if there.left_out else ''}"
        alike_in = "begin with it" if begun else "have it in their names"
        raise BadInput(f"{typed.name}: {count} {alike_in}; type more of it{choose}")

    @property
    def folders_known(self) -> list[str]:
        """The first folder, the root, and those of recent volumes."""
        return list(dict.fromkeys([self.first_folder, "", *(one.folder for one in self.recent if not one.is_phantom)]))

    def alike(self, dropped: Dropped) -> list[tuple[Place, FolderEntry]]:
        """What bears the name of a dropped file or folder, in the folders known. As `listed`."""
        return [
            (Place(folder, entry.name), entry)
            for folder in self.folders_known
            for entry in self.listed(folder, dropped.name).entries
            if entry.name == dropped.name and entry.is_folder >= dropped.is_folder
        ]

    async def open(self, place: Place, keep: Keep) -> None:
        """Show this volume, in all tabs, once it can be drawn; returns then.

        Raises BadInput and PeerLost if it cannot be; then all is as before.
        """
        if self.now.opening:
            raise BadInput(f"{self.now.opening} is being opened; wait for it, or cancel that")
        viewing = self._shown.viewing
        if viewing is not None and viewing.jobs:
            raise BadInput("a movie is being made of the volume that is shown; wait for it, or cancel it")
        self.news.attach(asyncio.get_running_loop())
        self._cancelled = False
        self._tell(News(str(place), "starting"))
        try:
            opened = await asyncio.to_thread(self._opened, place, viewing, keep)
            if self._cancelled:
                await asyncio.to_thread(self._let_go, opened)
                raise GivenUp
            self._show(opened, place)
        finally:
            self._shown.expect(None)
            self._tell(News("", ""))

    def cancel(self) -> None:
        """Give up what is being opened, if anything is."""
        self._cancelled = True
        self._shown.give_up(another=self._alone)

    def _let_go(self, opened: Viewing) -> None:
        """It was given up when it was there."""
        opened.session.close(another=self._alone)
        if self._alone:
            self._shown.come_back()

    def _show(self, opened: Viewing, place: Place) -> None:
        """In the event loop's thread, in which nothing else happens meanwhile."""
        before, (volume, held_to) = self._shown.viewing, self._name_of(place)
        if self._place is not None and before is not None:
            self._left[self._place] = before.model.scene
        restart = Restart(opened, lambda say: self._open_session(volume, held_to, say))
        self._place = place
        self._note(place)
        self._shown.take(opened, restart)

    def _opened(self, place: Place, before: Viewing | None, keep: Keep) -> Viewing:
        self._check(place)
        if self._alone:
            self._shown.leave()
        try:
            return self._made(place, before, keep)
        except BaseException:
            if self._alone:
                self._shown.come_back()
            raise

    def _made(self, place: Place, before: Viewing | None, keep: Keep) -> Viewing:
        session = self._open_session(*self._name_of(place), self._say)
        try:
            self._shown.expect(session)
            if self._cancelled:
                raise GivenUp
            session.volume.check_has_values()
            viewing = self._make_viewing(session, self._left.get(place))
            if before is not None:
                _look_as(viewing, before, keep, self._place is not None and place[:2] == self._place[:2])
            return viewing
        except BaseException as error:
            session.close(another=self._alone)
            if self._cancelled and isinstance(error, PeerLost):
                raise GivenUp from error
            raise

    def _check(self, place: Place) -> None:
        """Raises BadInput where the servers see no such volume below the root."""
        if place.is_phantom:
            return
        there = self.listed(place.folder, place.name)
        if place.name and all(entry.name != place.name for entry in there.entries):
            raise BadInput(f"{place}: is not there, or not below {self.root_name}; choose another one")

    def _name_of(self, place: Place) -> tuple[str, str | None]:
        """The volume's name, and the folder that servers are held to.

        A phantom is made for that. It lies elsewhere than what is listed next, and names no other file.
        """
        if place.is_phantom and self._phantoms is not None:
            return self._phantoms.made(place.name, lambda: self._cancelled), None
        return str(VolumeName("/".join(filter(None, (self._root, place.folder, place.name))), place.part)), self._root

    def _note(self, place: Place | None) -> None:
        if place is not None:
            self.recent = [place, *(one for one in self.recent if one != place)][:MOST_RECENT]

    def _say(self, line: str) -> None:
        """While it is being opened: the session goes on to tell what takes time, as each frame does."""
        with self._telling:
            if self.now.opening:
                self.now = News(self.now.opening, line)
                self.news.tell(self.now)

    def _tell(self, news: News) -> None:
        with self._telling:
            self.now = news
            self.news.tell(news)


def _look_as(viewing: Viewing, before: Viewing, keep: Keep, in_one_file: bool) -> None:
    """Show a volume in the size of the one before, and with what is kept of its scene. Nothing can be undone."""
    kept, volumes = before.model.scene, (before.volume, viewing.session.volume)
    if keep is Keep.TABLES:
        viewing.model.change(lambda scene: with_tables_of(kept, scene, *volumes))
    elif keep is Keep.LOOK:
        viewing.model.change(lambda scene: with_look_of(kept, scene, *volumes, in_one_file))
    size = kept.image
    viewing.image_size.follows_window = before.image_size.follows_window
    viewing.model.change(lambda scene: sized(scene, width=size.width, height=size.height))
    viewing.model.forget()


def _volumes_around(place: Place, listed: FolderListed) -> list[Place]:
    """The places of the volumes among what lies beside this one: of a part, whatever its file or folder has."""
    whole = place._replace(part="")
    folder = "/".join(filter(None, whole[:2])) if place.part else place.folder
    return [
        Place(folder, one.name, one.part) if one.name or not place.part else whole._replace(part=one.part)
        for one in listed.entries
        if one.is_volume
    ]


def place_below(root: str, volume: str) -> Place | None:
    """Where a volume lies that was opened by its name, None if that is not below the root."""
    name = volume_name(volume)
    place = None if name.is_url else _place_by(root, name.place)
    return None if place is None else place._replace(part=name.part)


def _place_by(root: str, path: str) -> Place | None:
    try:
        way = Path(path).absolute().relative_to(Path(root).absolute())
    except ValueError:
        return None
    folder = way.parent.as_posix()
    return Place("" if folder == "." else folder, way.name)
