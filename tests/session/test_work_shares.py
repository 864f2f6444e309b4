"""Sub-cubes change hands by what frames measure: when, how often, and what happens if that is refused or cut short."""

from __future__ import annotations

from dataclasses import dataclass

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from support.messages.coordinated import (
    DESCRIPTION,
    FIRST,
    JOINED,
    MAP_STATS,
    SECOND,
    SPLAT,
    SPLAT_STATS,
    CheckedCoordinator,
    joins,
    said,
    sent,
)
from support.messages.coordinated import SCENE as DRAWN
from support.messages.message_samples import IDENTITY
from volsplat.client.coordinator.events.events import FrameAsked, MessageReceived, ServerJoined, ServerLost, VolumeAsked
from volsplat.client.coordinator.events.instructions import EndFrame, Instruction, PublishImage, ReportProgress, Send
from volsplat.client.coordinator.shares.block_work import VOXELS_OF_A_PACKET
from volsplat.protocol.description.block_extremes import BlockExtremes
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Image, Quantise, Scene
from volsplat.protocol.description.shading_tables import ScalarTable
from volsplat.protocol.description.volume import Box, Geometry, VolumeDescription
from volsplat.protocol.messages import messages
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.rules.index_rules import HISTOGRAM_BINS, Survey
from volsplat.protocol.wire.addresses import Address

SIDE = 16  # blocks of one voxel
GEOMETRY = Geometry((SIDE, SIDE, SIDE))
CUBE = msgspec.structs.replace(DESCRIPTION, geometry=GEOMETRY)
SEEN = msgspec.structs.replace(DRAWN.tables, opac=ScalarTable(points=((0.5, 0.0), (0.5, 1.0))))
SCENE = Scene(tables=SEEN, image=Image(width=1, height=1), quantise=Quantise(window=(0.0, 1.0)))
THIRD, FOURTH = 4, 5
MORE = [
    ServerJoined(n, Role.MAPSHADE_SERVER, f"map/shade server {n}", f"node{n}", Address("", 0))
    for n in range(THIRD, THIRD + 6)
]
FRAME_SECONDS = 0.1  # from one to the next
VOXELS_A_SECOND = 1e4  # read and packed
PACKETS_A_SECOND = 1e2  # so few that every share of a frame tells how fast its server is


@dataclass
class Model:
    """Servers that take as long as their work: what they say is worked out from what they hold."""

    seen: list[bool]  # of each voxel, i fastest
    speeds: dict[int, float]  # packets a second, by map/shade server
    waits: float = 1.0  # of the seconds of the busiest, that the splat server waits for it
    volume: VolumeDescription = CUBE

    def __post_init__(self) -> None:
        self.coordinator = CheckedCoordinator()
        self.frame = 0
        workers = [one for one in [*JOINED[1:], *MORE] if one.server in self.speeds]
        for event in [*joins(JOINED[0], *workers), VolumeAsked("/volumes/cube.raw", workers=len(workers))]:
            self.coordinator.handle(event)
        described = messages.VolumeDescribed(self.volume, None, IDENTITY)
        self.coordinator.handle(said(FIRST, described))
        for server in self.boxes:
            self.coordinator.handle(self.read(server))
        for server in self.boxes:
            self.coordinator.handle(self.counted(server))
        self.answer(self.ask())

    @property
    def boxes(self) -> dict[int, Box]:
        return {server: box for server, (box,) in self.held.items()}

    @property
    def held(self) -> dict[int, list[Box]]:
        return self.coordinator.holding.boxes

    def voxels(self, server: int) -> int:
        return sum(box.voxels for box in self.held[server])

    def read(self, server: int) -> MessageReceived:
        voxels = self.boxes[server].voxels
        survey = Survey(low=0.0, high=1.0, max_gradient=1.0, voxels=voxels, no_data=0)
        return said(server, messages.SubCubesRead(1, survey, voxels / VOXELS_A_SECOND))

    def counted(self, server: int) -> MessageReceived:
        counts = bytearray(16 * HISTOGRAM_BINS)
        for at in (0, 8 * HISTOGRAM_BINS):
            counts[at : at + 8] = self.boxes[server].voxels.to_bytes(8, "little")
        values = [float(seen) for seen in self.seen]
        message = messages.HistogramsCounted(1, HISTOGRAM_BINS, len(values))
        return said(server, message, bytes(counts) + BlockExtremes(values, values).as_bytes())

    def visible(self, box: Box) -> int:
        (i0, j0, k0), (i1, j1, k1) = box
        rows = (SIDE * (j + SIDE * k) for k in range(k0, k1) for j in range(j0, j1))
        return sum(sum(self.seen[row + i0 : row + i1]) for row in rows)

    def seconds(self) -> dict[int, float]:
        """Of a frame, by server."""
        work = {n: sum(map(self.visible, held)) + self.voxels(n) / VOXELS_OF_A_PACKET for n, held in self.held.items()}
        return {n: work[n] / self.speeds[n] for n in work}

    def imbalance(self) -> float:
        seconds = self.seconds().values()
        return max(seconds) * sum(self.speeds.values()) / sum(s * self.speeds[n] for n, s in self.seconds().items())

    def ask(self) -> list[Instruction]:
        self.frame += 1
        return self.coordinator.handle(FrameAsked(self.frame, SCENE, Step.F, require_complete=False))

    def drawn(self) -> list[Instruction]:
        """Draw the frame that runs: what the coordinator says at its end."""
        seconds, at = self.seconds(), self.frame * FRAME_SECONDS
        for server, held in self.held.items():
            stats = msgspec.structs.replace(
                MAP_STATS,
                packets=sum(map(self.visible, held)),
                voxels_visited=self.voxels(server),
                map_shade_seconds=seconds[server],
            )
            self.coordinator.handle(said(server, messages.FrameMapped(self.frame, stats, [])))
        splat = msgspec.structs.replace(SPLAT_STATS, waiting_seconds=self.waits * max(seconds.values()))
        finished = messages.FrameFinished(self.frame, True, [], splat)
        self.coordinator.handle(MessageReceived(SPLAT, finished, memoryview(b""), at))
        image = messages.ImageRead(self.frame, Step.F, True, 0, 0, 1, 1, messages.RawPixels())
        return self.coordinator.handle(said(SPLAT, image, bytes(16)))

    def answer(self, told: list[Instruction]) -> list[Instruction]:
        """Have servers hold what they are asked to."""
        last: list[Instruction] = []
        for ask in told:
            match ask:
                case Send(server, messages.PackVoxels() | messages.ChangeSubCubes() as message):
                    last = self.coordinator.handle(self.packed(server, message))
                case Send(server, messages.ReadAhead(reading=reading)):
                    last = self.coordinator.handle(said(server, messages.AheadRead(reading)))
        return last

    def packed(self, server: int, ask: messages.PackVoxels | messages.ChangeSubCubes) -> MessageReceived:
        voxels = self.voxels(server)
        read = 0 if isinstance(ask, messages.PackVoxels) else voxels
        return said(server, messages.VoxelsPacked(ask.assignment, read, voxels / VOXELS_A_SECOND))

    def until_moved(self, frames: int = 40) -> list[Instruction]:
        """Draw so many frames at most: what is said when sub-cubes are to change hands, nothing if they are not."""
        for _ in range(frames):
            told = self.drawn()
            if any(kind is messages.ChangeSubCubes for _, kind in sent(told)):
                return told
            self.ask()
        return []


def corner(part: int = 2) -> list[bool]:
    """All that is visible lies in one corner."""
    edge = SIDE // part
    return [max(i, j, k) < edge for k in range(SIDE) for j in range(SIDE) for i in range(SIDE)]


def alike(servers: int = 2) -> dict[int, float]:
    return dict.fromkeys(range(FIRST, FIRST + servers), PACKETS_A_SECOND)


def test_servers_share_what_is_visible_and_the_next_frame_is_drawn_by_the_new_boxes() -> None:
    model = Model(corner(), alike())
    before = model.boxes
    told = model.until_moved()
    assert [kind for _, kind in sent(told)] == [messages.ChangeSubCubes] * 2
    assert model.boxes != before and model.imbalance() < 1.1
    states = model.coordinator.server_states
    assert {n: states[n].boxes for n in before} == {n: (box,) for n, box in model.boxes.items()}
    assert sent(model.ask()) == [], "it waits until all hold their boxes"
    assert [kind for _, kind in sent(model.answer(told))] == [messages.RenderFrame] * 3


def test_who_joined_later_takes_part_as_well() -> None:
    model = Model(corner(), alike())
    model.drawn()
    model.speeds[THIRD] = model.speeds[FIRST]
    for event in joins(MORE[0]):
        told = model.coordinator.handle(event)
    model.answer(told)
    model.ask()
    assert [kind for _, kind in sent(model.until_moved())] == [messages.ChangeSubCubes] * 3
    assert THIRD in model.boxes and model.imbalance() < 1.1


@given(
    servers=st.integers(2, 6),
    data=st.data(),
    spots=st.lists(st.tuples(*[st.integers(0, SIDE - 1)] * 3, st.integers(1, 6)), min_size=1, max_size=4),
)
def test_after_a_move_no_other_one_pays(
    servers: int, data: st.DataObject, spots: list[tuple[int, int, int, int]]
) -> None:
    """Whatever is visible, and however fast each server is, as long as that stays."""
    near = [[abs(at - spot[axis]) <= spot[3] for at in range(SIDE)] for axis in range(3) for spot in spots]
    n = len(spots)
    seen = [
        any(near[s][i] and near[n + s][j] and near[2 * n + s][k] for s in range(n))
        for k in range(SIDE)
        for j in range(SIDE)
        for i in range(SIDE)
    ]
    speeds = {server: PACKETS_A_SECOND * data.draw(st.floats(0.25, 4.0)) for server in alike(servers)}
    model = Model(seen, speeds)
    moves, before = 0, model.imbalance()
    for _ in range(4):
        told = model.until_moved(12)
        if not told:
            break
        moves, after = moves + 1, model.imbalance()
        assert after < before
        before = after
        model.answer(told)
        model.ask()
    assert moves <= 1


@pytest.mark.parametrize(
    ("waits", "seen"), [(0.0, corner()), (1.0, [True] * SIDE**3)], ids=["splatting takes longer", "all is visible"]
)
def test_nothing_moves_where_that_saves_nothing(waits: float, seen: list[bool]) -> None:
    assert Model(seen, alike(), waits).until_moved() == []


def test_what_takes_longer_than_it_saves_in_a_second_is_left(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(f"{__name__}.VOXELS_A_SECOND", 1.0)
    assert Model(corner(), alike()).until_moved() == []


def test_a_frame_that_waits_is_drawn_after_the_move() -> None:
    model = Model(corner(), alike())
    told = model.until_moved()
    model.ask()
    assert model.coordinator.frames.frame is not None
    assert [kind for _, kind in sent(model.answer(told))] == [messages.RenderFrame] * 3


def refusal(server: int, assignment: int, held: int) -> MessageReceived:
    cause = "cube.raw was replaced"
    return said(server, messages.Refused("ChangeSubCubes", cause, assignment=assignment, held=held))


def test_where_all_refuse_the_boxes_stay_and_nobody_asks_again() -> None:
    model = Model(corner(), alike())
    before = model.boxes
    model.until_moved()
    model.ask()
    assert model.coordinator.handle(refusal(FIRST, 2, held=1)) == []
    told, *drawn = model.coordinator.handle(refusal(SECOND, 2, held=1))
    assert isinstance(told, ReportProgress) and "replaced" in told.text and "stay where they are" in told.text
    (request, *_) = [i.message for i in drawn if isinstance(i, Send)]
    assert isinstance(request, messages.RenderFrame) and request.assignment == 1
    assert model.boxes == before
    assert {n: model.coordinator.server_states[n].boxes for n in before} == {n: (box,) for n, box in before.items()}
    assert model.until_moved() == []


def test_where_one_refuses_the_volume_is_read_again_for_the_next_frame() -> None:
    model = Model(corner(), alike())
    told = model.until_moved()
    model.ask()
    model.coordinator.handle(refusal(FIRST, 2, held=1))
    (ask,) = [i.message for i in told if isinstance(i, Send) and i.server == SECOND]
    assert isinstance(ask, messages.ChangeSubCubes)
    again = model.coordinator.handle(model.packed(SECOND, ask))
    assert sent(again) == [(FIRST, messages.ReadSubCubes), (SECOND, messages.ReadSubCubes)]
    assert not any(isinstance(i, EndFrame) for i in again)


@pytest.mark.parametrize("others_first", [True, False])
def test_a_loss_while_sub_cubes_change_hands_is_a_loss_like_any_other(others_first: bool) -> None:
    model = Model(corner(), alike(3))
    told = model.until_moved()
    model.ask()
    rest = [i for i in told if isinstance(i, Send) and i.server != FIRST]
    lost = ServerLost(FIRST, "map/shade server 2 is gone")
    if others_first:
        assert sent(model.answer(list(rest))) == []
    told = model.coordinator.handle(lost)
    assert any(isinstance(i, EndFrame) for i in told)
    if not others_first:
        told = model.answer(list(rest))
    told = model.answer(told)  # what others have read
    assert model.coordinator.servers.missing == ()
    assert FIRST not in model.held
    assert sum(map(model.voxels, model.held)) == SIDE**3
    model.answer(told)
    model.ask()
    published = [i for i in model.drawn() if isinstance(i, PublishImage)]
    assert published[0].outcome is not None and published[0].outcome.missing == ()


def test_a_loss_and_a_refusal_leave_nothing_held_by_two_or_nobody() -> None:
    model = Model(corner(), alike(3))
    model.until_moved()
    model.coordinator.handle(ServerLost(FIRST, "map/shade server 2 is gone"))
    model.coordinator.handle(refusal(SECOND, 2, held=1))
    model.coordinator.handle(refusal(THIRD, 2, held=1))
    assert sent(model.ask()) == [(SECOND, messages.ReadSubCubes), (THIRD, messages.ReadSubCubes)]
