"""Voxels of the file through a session: who is asked, who waits how long, and that the answer is the array's."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from support.files.head_volume import head, skin
from support.messages.coordinated import FIRST, SECOND, SPLAT, WHOLE, drawing, opened_store, said, sent, surveyed
from volsplat.client import Session
from volsplat.client.coordinator.events.events import FileVoxelAsked, NobodyJoined, ServerLost
from volsplat.client.coordinator.events.instructions import GiveAnswer, Instruction
from volsplat.client.coordinator.file_voxel_questions import MOST_WAITING
from volsplat.client.memory.array_volume import Volume
from volsplat.client.session.single import SingleProcess
from volsplat.client.volume.file_voxel import FileVoxel
from volsplat.protocol.description.scene import Quantise, Scene
from volsplat.protocol.description.shading_tables import ScalarTable
from volsplat.protocol.messages import messages
from volsplat.protocol.text.errors import BadInput, PeerLost

__all__ = ["head"]

LOW, HIGH = FileVoxelAsked(3, (1, 2, 0)), FileVoxelAsked(4, (1, 2, 9))  # of the first server and of the second
READ = messages.VoxelRead(3, ["int16"]), (-8882).to_bytes(2, "little", signed=True)
TOLD = GiveAnswer(3, FileVoxel(-8882, None, ("int16",)))


def answers(told: list[Instruction]) -> list[GiveAnswer]:
    return [one for one in told if isinstance(one, GiveAnswer)]


def test_the_server_that_holds_a_voxel_is_asked_for_it_whatever_else_goes_on() -> None:
    for coordinator in (surveyed(), drawing()):
        assert sent(coordinator.handle(LOW)) == [(FIRST, messages.ReadVoxel)]
        assert sent(coordinator.handle(HIGH)) == [(SECOND, messages.ReadVoxel)]
        assert coordinator.handle(said(FIRST, *READ)) == [TOLD]
        assert coordinator.handle(said(SECOND, messages.VoxelRead(4, []))) == [GiveAnswer(4, None)]


def test_of_a_volume_that_only_comes_whole_one_server_reads_all_that_is_asked() -> None:
    coordinator = drawing()
    known = coordinator.holding._known
    assert known is not None
    known.description = WHOLE
    assert sent(coordinator.handle(LOW)) == sent(coordinator.handle(HIGH)) == [(FIRST, messages.ReadVoxel)]


def test_a_prepared_volume_has_no_file() -> None:
    assert opened_store().handle(LOW) == [GiveAnswer(3, None)]


def test_a_slow_server_is_asked_for_no_more_than_some() -> None:
    coordinator = drawing()
    for number in range(MOST_WAITING):
        assert sent(coordinator.handle(replace(LOW, question=number + 1))) == [(FIRST, messages.ReadVoxel)]
    assert coordinator.handle(replace(LOW, question=99)) == [GiveAnswer(99, None)]
    assert sent(coordinator.handle(replace(HIGH, question=100))) == [(SECOND, messages.ReadVoxel)]
    coordinator.handle(said(FIRST, *READ))
    assert sent(coordinator.handle(replace(LOW, question=101))) == [(FIRST, messages.ReadVoxel)]


def test_a_refusal_ends_one_and_a_loss_all_that_this_server_was_to_tell() -> None:
    coordinator = drawing()
    for asked in (LOW, HIGH, replace(LOW, question=5)):
        coordinator.handle(asked)
    (refused,) = coordinator.handle(said(FIRST, messages.Refused("ReadVoxel", "it was changed", question=5)))
    assert isinstance(refused, GiveAnswer) and isinstance(refused.error, BadInput) and refused.question == 5
    assert answers(coordinator.handle(ServerLost(FIRST, "gone"))) == [GiveAnswer(3, None)]
    assert coordinator.handle(said(SECOND, messages.VoxelRead(4, []))) == [GiveAnswer(4, None)]
    assert coordinator.handle(replace(LOW, question=6)) == [GiveAnswer(6, None)], "until others hold it"


def test_a_failed_session_ends_all() -> None:
    coordinator = drawing()
    coordinator.handle(LOW)
    coordinator.handle(ServerLost(SPLAT, "the splat server is gone"))
    (ended,) = answers(coordinator.handle(NobodyJoined("no other has joined")))
    assert isinstance(ended.error, PeerLost)
    assert coordinator.handle(LOW) == [ended]


def values_of(head: Path) -> Any:
    from volsplat.mapshade_server.readers import open_volume

    reader = open_volume(str(head))
    return reader.read(reader.description.geometry.box)


def of_the_brightest(scene: Scene, window: tuple[float, float]) -> Scene:
    """What shows nothing but voxels at the window's end and beyond."""
    tables = msgspec.structs.replace(scene.tables, opac=ScalarTable(points=((0.999, 0.0), (0.999, 1.0))))
    return msgspec.structs.replace(scene, quantise=Quantise(window=window), tables=tables)


def test_servers_and_a_single_process_tell_what_the_file_and_memory_hold(head: Path) -> None:
    values, choose = values_of(head), np.random.default_rng(19)
    ni, nj, nk = values.shape[::-1]
    indices = [(int(choose.integers(ni)), int(choose.integers(nj)), int(choose.integers(nk))) for _ in range(20)]
    expected = [FileVoxel(values[k, j, i].item(), None, (values.dtype.name,)) for i, j, k in indices]
    for volume in (head, Volume(values, spacing=(1, 1, 1))):
        with Session(volume, workers=2) as session, SingleProcess(volume) as single:
            for renderer in (session, single):
                assert [renderer.file_voxel(index) for index in indices] == expected
                seen = renderer.probe(of_the_brightest(skin(single), window=(0.0, 400.0)), 48, 40)
                assert seen is not None and seen.density == 400.0
                own = renderer.file_voxel(seen.index)
                assert own is not None and own.density == values[seen.index[::-1]] > 400, "beyond the window"
            assert session.file_voxel(indices[0], within=0.0) in (None, expected[0]), "it is not waited for"


def test_what_was_changed_since_is_refused_and_the_session_draws_on(head: Path, tmp_path: Path) -> None:
    path = tmp_path / "changing.mha"
    path.write_bytes(head.read_bytes())
    with Session(path, workers=1) as session:
        scene = session.default_scene()
        small = msgspec.structs.replace(scene, image=msgspec.structs.replace(scene.image, width=32, height=32))
        assert session.probe(small, 16, 16) is not None and session.file_voxel((1, 2, 3)) is not None
        path.write_bytes(head.read_bytes()[:-1] + b"\x07")
        with pytest.raises(BadInput, match="was replaced or changed after it was opened"):
            session.file_voxel((1, 2, 3))
        assert session.probe(small, 16, 16) is not None


@pytest.mark.parametrize("renderer", [Session, SingleProcess])
def test_a_volume_of_a_relative_name_is_found_from_another_folder(
    renderer: type[Session | SingleProcess], head: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(head.parent)
    with renderer(head.name) as opened:
        there = opened.file_voxel((1, 2, 3))
        monkeypatch.chdir("/")
        assert there is not None and opened.file_voxel((1, 2, 3)) == there
