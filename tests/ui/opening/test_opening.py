"""Opening another volume without a page: who is asked what lies in folders, what is refused, and what stays then."""

import asyncio
import gc
import weakref
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import nibabel
import numpy as np
import pytest
from nicegui import Client, ui
from starlette.requests import Request

from support.files.dicom_files import numbered, series
from support.messages.coordinated import (
    FIRST,
    JOINED,
    SECOND,
    SPLAT,
    CheckedCoordinator,
    drawing,
    joins,
    said,
    sent,
    surveyed,
)
from support.patience import wait_until
from volsplat.client import Session
from volsplat.client.coordinator.events.events import FolderAsked, NobodyJoined, ServerLost, ServerProcessEnded
from volsplat.client.coordinator.events.instructions import GiveAnswer
from volsplat.client.coordinator.folder_listings import MOST_WAITING
from volsplat.client.phantoms import make_phantom
from volsplat.client.phantoms.volume_writer import write_volume
from volsplat.client.ui.opening.kept_look import with_look_of
from volsplat.client.ui.opening.opening import Keep, Opening, Place, place_below
from volsplat.client.ui.opening.shown_volume import ShownVolume
from volsplat.client.ui.page import page
from volsplat.client.ui.viewing.opened_viewing import opened_viewing
from volsplat.client.ui.viewing.restart import Restart
from volsplat.client.ui.viewing.viewing import Viewing
from volsplat.protocol.description.kind import Band, Kind
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.shading_tables import ScalarTable
from volsplat.protocol.description.volume_name import LONGEST_VOLUME_NAME, MOST_SIGNS
from volsplat.protocol.messages import messages
from volsplat.protocol.messages.folder_messages import MOST_ENTRIES
from volsplat.protocol.text.errors import BadInput, PeerLost

ASKED = FolderAsked(3, "/data", "scans", "t2")
LISTED = messages.FolderListed(3, [], 0)


# -- who is asked


def test_a_server_is_asked_whatever_else_goes_on_and_its_answer_is_given_once() -> None:
    for coordinator in (surveyed(), drawing()):
        assert sent(coordinator.handle(ASKED)) == [(FIRST, messages.ListFolder)]
        assert coordinator.handle(said(FIRST, LISTED)) == [GiveAnswer(3, LISTED)]
        assert coordinator.handle(said(FIRST, LISTED)) == []


def test_a_refusal_ends_one_question_and_a_loss_all_that_this_server_was_to_tell() -> None:
    coordinator = drawing()
    for number in range(MOST_WAITING):
        coordinator.handle(replace(ASKED, question=number + 1))
    (busy,) = coordinator.handle(replace(ASKED, question=99))
    assert isinstance(busy, GiveAnswer) and "still busy" in str(busy.error)
    (refused,) = coordinator.handle(said(FIRST, messages.Refused("ListFolder", "no folder", question=1)))
    assert isinstance(refused, GiveAnswer) and isinstance(refused.error, BadInput) and refused.question == 1
    ended = [one for one in coordinator.handle(ServerLost(FIRST, "gone")) if isinstance(one, GiveAnswer)]
    assert [one.question for one in ended] == list(range(2, MOST_WAITING + 1))
    assert all(isinstance(one.error, PeerLost) for one in ended)
    assert sent(coordinator.handle(ASKED)) == [(SECOND, messages.ListFolder)]


def test_while_servers_are_waited_for_questions_wait_for_the_first_that_can_answer() -> None:
    coordinator = CheckedCoordinator()
    assert coordinator.handle(ASKED) == []
    told = [one for event in joins(*JOINED) for one in sent(coordinator.handle(event))]
    assert told.count((FIRST, messages.ListFolder)) == 1 and (SECOND, messages.ListFolder) not in told
    assert coordinator.handle(said(FIRST, LISTED)) == [GiveAnswer(3, LISTED)]
    alone = CheckedCoordinator()
    alone.handle(ASKED)
    told_of = alone.handle(ServerProcessEnded("nothing starts here"))
    (ended,) = (one for one in told_of if isinstance(one, GiveAnswer))
    assert isinstance(ended.error, PeerLost)


def test_a_failed_session_ends_all_questions() -> None:
    coordinator = drawing()
    coordinator.handle(ASKED)
    coordinator.handle(ServerLost(SPLAT, "the splat server is gone"))
    told = coordinator.handle(NobodyJoined("no other has joined"))
    (ended,) = (one for one in told if isinstance(one, GiveAnswer))
    assert isinstance(ended.error, PeerLost) and coordinator.handle(ASKED) == [ended]


def test_a_volume_is_placed_below_the_root_or_nowhere(tmp_path: Path) -> None:
    root = str(tmp_path)
    assert place_below(root, f"{root}/a/b/c.nrrd") == Place("a/b", "c.nrrd")
    assert place_below(root, f"{root}/scans#4") == Place("", "scans", "4")
    assert place_below(root, f"{root}/../c.nrrd") is None or ".." in str(place_below(root, f"{root}/../c.nrrd"))
    assert place_below(root, "/elsewhere/c.nrrd") is None
    assert place_below(root, "https://example.org/c.zarr") is None


# -- one volume after the other, by real servers


class Opened:
    """Two volumes in a folder, of which the first is shown."""

    def __init__(self, folder: Path, alone: bool = False) -> None:
        self.folder = folder
        self.sessions: list[Session] = []
        for name in ("head", "protein"):
            write_volume(folder / f"{name}.nrrd", *make_phantom(name, (16, 18, 20)))
        first = str(folder / "head.nrrd")
        viewing = opened_viewing(session := self._session(first), session.default_scene())
        self.shown = ShownVolume(viewing, Restart(viewing, lambda say: self._session(first)))
        self.alone = alone
        self.opening = self.opening_at("head.nrrd")

    def opening_at(self, name: str) -> Opening:
        """As if that volume were shown."""
        first = str(self.folder / name)
        return Opening(
            self.shown,
            str(self.folder),
            first,
            lambda name, held_to, say: self._session(name),
            self._viewing_of,
            self.alone,
        )

    def _session(self, name: str) -> Session:
        self.sessions.append(Session(name, workers=1, data_root=None))
        return self.sessions[-1]

    @staticmethod
    def _viewing_of(session: Session, scene: Scene | None) -> Viewing:
        return opened_viewing(session, scene or session.default_scene())

    def within(self, work: Callable[[], Any]) -> None:
        """Do something while what is shown is drawn."""

        async def all_of_it() -> None:
            async with self.shown.drawn():
                await work()

        asyncio.run(all_of_it())

    @property
    def viewing(self) -> Viewing:
        assert self.shown.viewing is not None
        return self.shown.viewing

    @property
    def name(self) -> str:
        return self.viewing.volume.description.name


@pytest.fixture
def opened(tmp_path: Path) -> Iterator[Opened]:
    made = Opened(tmp_path)
    yield made
    for session in made.sessions:
        session.close()


HEAD, PROTEIN = Place("", "head.nrrd"), Place("", "protein.nrrd")
FIRST_HERE, LAST_HERE = "this is the first volume here", "this is the last volume here"
KNOWN = f"only the first {MOST_ENTRIES} names here are known"
EDGE = ScalarTable(points=((0.25, 0.0), (0.75, 1.0)))


def with_edge(scene: Scene) -> Scene:
    return msgspec.structs.replace(scene, tables=msgspec.structs.replace(scene.tables, opac=EDGE))


@pytest.mark.parametrize("typed", ["x" * (LONGEST_VOLUME_NAME + 1), "\ud800"])
def test_what_no_message_can_hold_is_refused_and_costs_no_server(opened: Opened, typed: str) -> None:
    for folder, words in (("", typed), (typed, "")):
        with pytest.raises(BadInput, match="too long|not UTF-8"):
            opened.opening.listed(folder, words)
    assert [entry.name for entry in opened.opening.listed("", "head").entries] == ["head.nrrd"]
    assert not any(server.lost for server in opened.viewing.session.servers)


def test_a_volume_that_is_opened_again_is_as_it_was_left_and_undo_begins_with_it(opened: Opened) -> None:
    async def work() -> None:
        before = opened.viewing
        before.model.change(with_edge)
        left = before.model.scene
        await opened.opening.open(PROTEIN, Keep.NOTHING)
        protein = opened.viewing
        assert opened.name == "protein.nrrd" and protein.number == before.number + 1
        assert protein.model.scene.tables == protein.default_scene.tables != left.tables
        assert not protein.model.can_undo
        await opened.opening.open(HEAD, Keep.NOTHING)
        assert opened.name == "head.nrrd" and opened.viewing.model.scene == left
        assert opened.opening.recent == [HEAD, PROTEIN]

    opened.within(work)


def test_nothing_is_kept_of_volumes_that_were_shown_once_their_pages_are_gone(opened: Opened) -> None:
    request = Request({"type": "http", "path": "/", "headers": [], "query_string": b"", "session": {}})
    shown: list[weakref.ref[Viewing]] = []

    def none_is_left() -> bool:
        gc.collect()
        return not any(viewing() for viewing in shown)

    async def open_from_a_page(place: Place) -> None:
        shown.append(weakref.ref(opened.viewing))
        with Client(ui.page("/"), request=request) as client:
            page(opened.viewing, opened.shown.restart, opened.opening)
        await opened.opening.open(place, Keep.NOTHING)
        client.delete()

    async def work() -> None:
        for place in (PROTEIN, HEAD, PROTEIN):
            await open_from_a_page(place)
        await asyncio.to_thread(wait_until, none_is_left, "what was shown before is let go")

    opened.within(work)


def test_tables_are_kept_where_that_is_asked_and_so_is_the_size_of_the_picture(opened: Opened) -> None:
    async def work() -> None:
        model = opened.viewing.model
        image = msgspec.structs.replace(model.scene.image, width=320, height=200)
        model.change(lambda scene: msgspec.structs.replace(with_edge(scene), image=image))
        await opened.opening.open(PROTEIN, Keep.TABLES)
        scene = opened.viewing.model.scene
        assert (scene.tables, scene.cross_bar) == (model.scene.tables, model.scene.cross_bar)
        assert (scene.image.width, scene.image.height) == (320, 200)
        assert not opened.viewing.model.can_undo

    opened.within(work)


def test_the_volume_beside_is_the_next_of_the_folder_and_shown_likewise_on_the_same_grid(opened: Opened) -> None:
    densities, *place = make_phantom("head", (16, 18, 20))
    write_volume(opened.folder / "heated.nrrd", densities * 2, *place)
    write_volume(opened.folder / "zoomed.nrrd", *make_phantom("head", (16, 18, 10)))

    async def beside(further: int) -> Place | str:
        return await asyncio.to_thread(opened.opening.beside, further)

    async def open_beside(further: int) -> None:
        place = await beside(further)
        assert isinstance(place, Place)
        await opened.opening.open(place, Keep.LOOK)

    async def work() -> None:
        before = opened.viewing
        before.model.change(with_edge)
        assert await beside(-1) == FIRST_HERE
        await open_beside(1)
        kept = before.volume.windowed(before.model.scene)
        assert opened.name == "heated.nrrd" and opened.viewing.model.scene == kept
        assert not opened.viewing.model.can_undo
        await open_beside(2)
        assert opened.name == "zoomed.nrrd"
        assert opened.viewing.model.scene.tables == opened.viewing.default_scene.tables != kept.tables
        assert await beside(1) == LAST_HERE

    opened.within(work)


def test_labels_beside_an_image_on_the_same_grid_are_seen_as_suits_them(opened: Opened) -> None:
    image = make_phantom("marschner-lobb", (16, 18, 20))[0].numpy()
    labels = np.zeros_like(image, np.uint8)
    for label in range(1, 6):
        labels[2 * label : 2 * label + 2, 3:15, 3:13] = label
    for name, values in (("t1", image), ("t1_seg", labels)):
        nibabel.save(nibabel.Nifti1Image(values, np.eye(4)), opened.folder / f"{name}.nii")

    async def work() -> None:
        await opened.opening.open(Place("", "t1.nii"), Keep.NOTHING)
        opened.viewing.model.change(with_edge)
        segmented = await asyncio.to_thread(opened.opening.beside, 1)
        assert segmented == Place("", "t1_seg.nii")
        await opened.opening.open(segmented, Keep.LOOK)
        scene, suits = opened.viewing.model.scene, opened.viewing.default_scene
        assert (scene.tables, scene.quantise) == (suits.tables, suits.quantise)

    opened.within(work)


@pytest.mark.parametrize(
    ("other", "in_one_file"),
    [
        ({"kind": Kind.LABELS}, False),
        ({"value_unit": "K"}, False),
        ({"bands": (Band("bone", 300.0, 400.0),)}, False),
        ({"second_scalar": (0.0, 1.0)}, False),
        ({"density_name": "pressure"}, True),
    ],
)
def test_a_look_is_kept_only_for_values_of_the_same_meaning(
    opened: Opened, other: dict[str, Any], in_one_file: bool
) -> None:
    volume, suits = opened.viewing.volume, opened.viewing.default_scene
    kept = with_edge(suits)
    beside = replace(volume, description=msgspec.structs.replace(volume.description, **other))
    assert with_look_of(kept, suits, volume, volume, in_one_file=False) == volume.windowed(kept)
    assert with_look_of(kept, suits, volume, beside, in_one_file=False) == suits
    assert (with_look_of(kept, suits, volume, beside, in_one_file=True) != suits) == in_one_file


def test_steps_are_gone_through_by_their_numbers_and_where_too_many_lie_there_that_is_said(opened: Opened) -> None:
    for number in range(MOST_ENTRIES + 7):
        (opened.folder / f"step_{number}.nrrd").symlink_to("head.nrrd")
    last = MOST_ENTRIES - 3  # head and protein come before
    assert opened.opening_at("step_9.nrrd").beside(1) == Place("", "step_10.nrrd")
    assert opened.opening_at(f"step_{last}.nrrd").beside(-1) == Place("", f"step_{last - 1}.nrrd")
    assert opened.opening.beside(-1) == FIRST_HERE
    told = opened.opening_at(f"step_{last}.nrrd").beside(1)
    assert told == f"{KNOWN}, and this is the last volume of these; choose the next one (O)"
    with pytest.raises(BadInput, match=rf"^step_{last + 1}\.nrrd: {KNOWN}; choose a volume \(O\)$"):
        opened.opening_at(f"step_{last + 1}.nrrd").beside(-1)


def test_beside_a_series_are_the_other_series_of_its_folder_and_the_files_there_but_no_folder(opened: Opened) -> None:
    study = opened.folder / "study"
    (study / "older").mkdir(parents=True)
    for number in (3, 4):
        tags: dict[str, Any] = {"SeriesNumber": str(number), "SeriesInstanceUID": f"1.2.{number}"}
        for slice_ in series(opened.folder / f"of {number}", numbered(4), **tags).iterdir():
            slice_.rename(study / f"{number}-{slice_.name}")
    write_volume(study / "x.nrrd", *make_phantom("head", (4, 4, 4)))
    assert opened.opening_at("study#3").beside(-1) == FIRST_HERE
    assert opened.opening_at("study#3").beside(1) == Place("", "study", "4")
    assert opened.opening_at("study#4").beside(1) == Place("study", "x.nrrd")
    assert opened.opening_at("study#4").beside(2) == LAST_HERE
    assert opened.opening_at("study/x.nrrd").beside(-1) == Place("study", "", "4")


def test_a_volume_whose_name_has_the_sign_of_parts_is_found_where_the_servers_see_it(opened: Opened) -> None:
    whole = opened.folder / "head#1.nrrd"
    (opened.folder / "scans").mkdir()
    write_volume(whole, *make_phantom("head", (4, 4, 4)))
    named = opened.opening.place_named
    assert named("", whole.name) == named("scans", f"../{whole.name}") == Place("", whole.name)
    assert named("", "head#2") == Place("", "head", "2")
    assert named("", f"{whole.name}#0") == Place("", whole.name, "0")
    assert opened.opening_at(whole.name).beside(1) == HEAD

    async def work() -> None:
        await opened.opening.open(Place("", whole.name), Keep.NOTHING)
        assert opened.name == whole.name

    opened.within(work)


def test_servers_are_not_asked_for_each_of_many_signs_of_parts(opened: Opened, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []
    listed = opened.opening.listed

    def counted(folder: str, words: str) -> messages.FolderListed:
        asked.append(words)
        return listed(folder, words)

    monkeypatch.setattr(opened.opening, "listed", counted)
    with pytest.raises(BadInput, match="4090 times the sign #"):
        opened.opening.place_named("", "head" + "#" * 4090)
    assert asked == []
    assert opened.opening.place_named("", f"head.nrrd{'#' * MOST_SIGNS}") == HEAD._replace(part="#" * (MOST_SIGNS - 1))
    assert len(asked) <= MOST_SIGNS + 1


def test_a_part_of_a_name_stands_for_the_only_one_that_has_it_first_of_those_that_begin_so(opened: Opened) -> None:
    (opened.folder / "scans").mkdir()
    named = opened.opening.place_named
    assert named("", "HEA") == named("", "ead") == named("scans", "../he") == HEAD
    assert named("", "p") == PROTEIN and named("", "sc") == "scans"
    assert named("", "nothing") == Place("", "nothing")
    with pytest.raises(BadInput, match="^nrrd: 2 have it in their names; type more of it, or choose one$"):
        named("", "nrrd")
    with pytest.raises(BadInput, match="^nrrd: 2 have it in their names; type more of it$"):
        named("scans", "../nrrd")


def test_what_cannot_be_opened_is_told_and_what_was_shown_stays(opened: Opened) -> None:
    (opened.folder / "damaged.nrrd").write_bytes((opened.folder / "head.nrrd").read_bytes()[:200])
    huge = opened.folder / "huge_12000x12000x12000_uint8.raw"
    with huge.open("wb") as file:
        try:
            file.truncate(12000**3)
        except OSError:
            pytest.skip("this file system has no such large files")
    (opened.folder / "outside").symlink_to("/")
    before = opened.viewing

    async def work() -> None:
        for place, why in (
            (Place("", "damaged.nrrd"), "damaged.nrrd"),
            (Place("", huge.name), "memory|voxels"),
            (Place("", "nothing.nrrd"), "is not there, or not below"),
            (Place("", "outside"), "is not there, or not below"),
            (Place("outside", "etc"), "is no folder below"),
            (Place("../..", "etc"), "is no folder below"),
            (Place("", "../head.nrrd"), "is not there, or not below"),
        ):
            with pytest.raises((BadInput, PeerLost), match=why):
                await opened.opening.open(place, Keep.NOTHING)
            assert opened.viewing is before and before.session.failure is None
            assert opened.opening.now.opening == "" and opened.opening.recent == [HEAD]
        assert before.session.probe(before.model.scene, 1, 1) is None, "it goes on"

    opened.within(work)


def test_one_is_opened_at_a_time_and_none_while_a_movie_is_made(opened: Opened) -> None:
    async def work() -> None:
        opened.viewing.jobs += 1
        with pytest.raises(BadInput, match="a movie is being made"):
            await opened.opening.open(PROTEIN, Keep.NOTHING)
        opened.viewing.jobs -= 1
        first = asyncio.create_task(opened.opening.open(PROTEIN, Keep.NOTHING))
        await asyncio.sleep(0)
        with pytest.raises(BadInput, match=r"protein\.nrrd is being opened; wait for it, or cancel that"):
            await opened.opening.open(HEAD, Keep.NOTHING)
        await first
        assert opened.name == "protein.nrrd"

    opened.within(work)


def test_what_is_given_up_leaves_no_servers_and_what_was_shown_stays(opened: Opened) -> None:
    async def work() -> None:
        for at_once in (True, False):
            sessions = len(opened.sessions)
            task = asyncio.create_task(opened.opening.open(PROTEIN, Keep.NOTHING))
            await asyncio.sleep(0)
            while not (at_once or task.done()) and len(opened.sessions) == sessions:  # its servers are started
                await asyncio.sleep(0.001)
            opened.opening.cancel()
            with pytest.raises(BadInput, match="it was given up"):
                await task
            assert opened.name == "head.nrrd" and opened.opening.now.opening == ""
        assert opened.viewing.session.failure is None

    opened.within(work)
    assert not any(session.server_processes for session in opened.sessions[1:])


def test_servers_of_one_session_come_back_to_what_was_shown_if_another_volume_cannot_be(tmp_path: Path) -> None:
    opened = Opened(tmp_path, alone=True)
    (tmp_path / "damaged.nrrd").write_bytes((tmp_path / "head.nrrd").read_bytes()[:200])

    async def work() -> None:
        scene = opened.viewing.model.scene
        with pytest.raises(BadInput, match=r"damaged\.nrrd"):
            await opened.opening.open(Place("", "damaged.nrrd"), Keep.NOTHING)
        assert opened.name == "head.nrrd" and opened.viewing.session.failure is None
        assert opened.viewing.model.scene == scene
        await opened.opening.open(PROTEIN, Keep.NOTHING)
        assert opened.name == "protein.nrrd"
        assert [session.failure is None for session in opened.sessions] == [False, False, False, True]

    opened.within(work)
    for session in opened.sessions:
        session.close()
