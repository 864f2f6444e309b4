"""Sub-cubes change hands between real processes: the same picture, and nothing is read but what changes hands."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import msgspec
import numpy as np
import psutil
import pytest
import torch

from support.files.counted_bytes import bytes_read
from support.files.prepared import Told
from support.patience import wait_until
from support.programs.server_processes import is_server
from volsplat.client import Session
from volsplat.client.coordinator import work_shares
from volsplat.client.coordinator.server_states import ServerState
from volsplat.client.coordinator.shares.moving_costs import MovingCosts
from volsplat.client.session.single import SingleProcess
from volsplat.mapshade_server.held.wanted_reader import GivenUp
from volsplat.mapshade_server.held_volume import HeldVolume
from volsplat.mapshade_server.prepare import Options, prepare
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Image, Scene, View
from volsplat.protocol.description.shading_tables import ScalarTable
from volsplat.protocol.description.volume import Box
from volsplat.protocol.messages import messages
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.rules.index_rules import Quantisation
from volsplat.protocol.text.errors import BadInput

SIDE = 96
LINE = "sharing out the volume by what there is to do"
FIRST, SECOND = Box((0, 0, 0), (SIDE, SIDE // 2, SIDE)), Box((0, SIDE // 2, 0), (SIDE, SIDE, SIDE))
MOVED = Box((0, 0, 0), (SIDE, SIDE // 4, SIDE)), Box((0, SIDE // 4, 0), (SIDE, SIDE, SIDE))
WITH_HALO = 1.1  # times what changes hands
LOOKED_AT = 1 << 20  # bytes, to tell the volume before and after


@pytest.fixture(scope="module")
def volume(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """All that is visible lies in one corner."""
    path = tmp_path_factory.mktemp("volumes") / f"corner_{SIDE}x{SIDE}x{SIDE}_float64.raw"
    values = np.random.default_rng(1).random((SIDE,) * 3)
    third = SIDE // 3
    values[:third, :third, :third] += 2.0
    values.tofile(path)
    return path


@pytest.fixture(scope="module")
def store(volume: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("stores") / "corner.zarr"
    prepare(str(volume), path, Options(), Told())
    return path


def scene(renderer: Session | SingleProcess) -> Scene:
    """Small, so that splat servers wait for map/shade servers."""
    shown = renderer.volume.default_scene()
    tables = msgspec.structs.replace(shown.tables, opac=ScalarTable(points=((0.5, 0.0), (0.5, 0.01))))
    return Scene(tables=tables, image=Image(width=96, height=96), view=View(zoom=1.0))


@contextmanager
def eager() -> Iterator[None]:
    """However slow this machine is, what frames could save adds up, and pays (test_work_shares has when it does)."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(work_shares, "HORIZON", 600.0)
        patch.setattr(work_shares, "JUDGED_EVERY", 0.0)
        patch.setattr(MovingCosts, "seconds", lambda *_: 0.0)
        yield


def holders(session: Session) -> list[ServerState]:
    return [server for server in session.servers if server.role == Role.MAPSHADE_SERVER]


def boxes(session: Session) -> list[Box]:
    return [box for server in holders(session) for box in server.boxes]


@pytest.mark.parametrize("prepared", [False, True])
@pytest.mark.parametrize("workers", [2, 3])
def test_the_picture_is_the_same_before_and_after(workers: int, prepared: bool, volume: Path, store: Path) -> None:
    path = store if prepared else volume
    lines: list[str] = []
    with SingleProcess(path) as single, Session(path, workers=workers, on_progress=lines.append) as session:
        shown = scene(session)
        # Of a store another level is then read for C, with all libraries there: so its reading is timed.
        session.render(shown, Step.A)
        before, expected = boxes(session), single.render(shown, Step.C)
        assert torch.equal(session.render(shown, Step.C), expected)
        with eager():
            wait_until(lambda: session.render(shown, Step.C) is not None and LINE in lines, "do sub-cubes change hands")
        after = session.finish(shown, Step.C)
        assert boxes(session) != before
        assert sum(box.voxels for box in boxes(session)) == SIDE**3
        assert torch.equal(after.image, expected)
        assert torch.equal(session.render(shown, Step.F), single.render(shown, Step.F))
        assert after.outcome is not None
        assert after.outcome.servers.voxels == {server.id: server.voxels for server in holders(session)}


def test_a_server_killed_in_the_middle_is_lost_like_any_other(volume: Path) -> None:
    killed: list[int] = []

    def watch(line: str) -> None:
        if line == LINE and not killed:
            servers = [psutil.Process(pid) for pid in session.server_processes]
            worker = next(s for s in servers if is_server(s, "mapshade_server"))
            killed.append(worker.pid)
            worker.send_signal(signal.SIGKILL)

    with SingleProcess(volume) as single, Session(volume, workers=3, on_progress=watch) as session:
        shown = scene(session)
        expected = single.render(shown, Step.C)

        def lost_and_whole() -> bool:
            whole = torch.equal(session.render(shown, Step.C), expected)
            return whole and any(server.lost for server in session.servers)

        with eager():
            wait_until(lost_and_whole, "is a server lost")
        assert torch.equal(session.render(shown, Step.C), expected)
        (lost,) = [server for server in session.servers if server.lost]
        assert lost.handed_over, "a whole frame was asked for after the loss"
        assert sum(server.voxels for server in holders(session) if not server.lost) == SIDE**3


def answered(held: HeldVolume, request: messages.Message) -> messages.Message:
    return held.answers(request)[-1].message


def test_a_server_reads_only_what_it_gets(volume: Path) -> None:
    held, whole = HeldVolume(), HeldVolume()
    described = answered(held, messages.DescribeVolume(str(volume)))
    assert isinstance(described, messages.VolumeDescribed)
    with SingleProcess(volume) as single:
        rules = single.volume.quantisation(scene(single).quantise)
    for one, box in ((held, SECOND), (whole, MOVED[1])):
        answered(one, messages.ReadSubCubes(1, str(volume), [box], described.identity))
        answered(one, messages.PackVoxels(1, rules))
    before = bytes_read()
    packed = answered(held, messages.ChangeSubCubes(2, str(volume), [MOVED[1]], described.identity, rules))
    news = MOVED[1].voxels - SECOND.voxels
    assert isinstance(packed, messages.VoxelsPacked) and packed.read == news
    assert 8 * news <= bytes_read() - before < WITH_HALO * 8 * news + LOOKED_AT
    assert packets(held) == packets(whole)
    before = bytes_read()
    packed = answered(held, messages.ChangeSubCubes(3, str(volume), [SECOND], described.identity, rules))
    assert isinstance(packed, messages.VoxelsPacked) and packed.read == 0
    assert bytes_read() - before < LOOKED_AT


def test_what_was_read_ahead_is_not_read_again(volume: Path) -> None:
    """Not even if only a part of it is wanted in the end, and whatever else was asked for before."""
    held, whole = HeldVolume(), HeldVolume()
    described = answered(held, messages.DescribeVolume(str(volume)))
    assert isinstance(described, messages.VolumeDescribed)
    with SingleProcess(volume) as single:
        rules = single.volume.quantisation(scene(single).quantise)
    for one, box in ((held, SECOND), (whole, MOVED[1])):
        answered(one, messages.ReadSubCubes(1, str(volume), [box], described.identity))
        answered(one, messages.PackVoxels(1, rules))
    before = bytes_read()
    for number, boxes in enumerate(([SECOND, FIRST], [MOVED[1]]), 1):
        held.reading_ahead(messages.ReadAhead(number, str(volume), boxes, described.identity, rules))()
    assert packets(held) != packets(whole) and bytes_read() - before < WITH_HALO * 8 * FIRST.voxels + 2 * LOOKED_AT
    before = bytes_read()
    packed = answered(held, messages.ChangeSubCubes(2, str(volume), [MOVED[1]], described.identity, rules))
    assert isinstance(packed, messages.VoxelsPacked) and packed.read == 0
    assert bytes_read() - before < LOOKED_AT and packets(held) == packets(whole)


def test_what_is_read_ahead_is_given_up_once_the_volume_is_read_anew(volume: Path) -> None:
    held = HeldVolume()
    described = answered(held, messages.DescribeVolume(str(volume)))
    assert isinstance(described, messages.VolumeDescribed)
    rules = Quantisation(window=(0.0, 3.0), strength_scale=1.0)
    read = held.reading_ahead(messages.ReadAhead(1, str(volume), [FIRST], described.identity, rules))
    answered(held, messages.ReadSubCubes(1, str(volume), [SECOND], described.identity))
    with pytest.raises(GivenUp):
        read()


def test_of_a_store_only_what_is_new_is_read(store: Path) -> None:
    held, whole = HeldVolume(), HeldVolume()
    described = answered(held, messages.DescribeVolume(str(store)))
    assert isinstance(described, messages.VolumeDescribed)

    def opened(one: HeldVolume, assignment: int, box: Box) -> int:
        levels = [messages.LevelBoxes(0, [box])]
        packed = answered(one, messages.OpenPackets(assignment, str(store), levels, described.identity))
        assert isinstance(packed, messages.VoxelsPacked) and one.packed_bytes == 4 * box.voxels
        return packed.read

    assert opened(held, 1, SECOND) == SECOND.voxels
    assert opened(held, 2, MOVED[1]) == MOVED[1].voxels - SECOND.voxels
    assert opened(whole, 1, MOVED[1]) == MOVED[1].voxels
    assert packets(held) == packets(whole)


def asked_of(held: HeldVolume, volume: Path, box: Box, rules: Quantisation) -> list[object]:
    """What a client has a server do before the first frame, and all that it answers but times."""
    held.keep()  # the client before has gone
    described = answered(held, messages.DescribeVolume(str(volume)))
    assert isinstance(described, messages.VolumeDescribed)
    read = answered(held, messages.ReadSubCubes(1, str(volume), [box], described.identity))
    assert isinstance(read, messages.SubCubesRead)
    survey = read.survey
    (counted,) = held.answers(messages.CountHistograms(1, survey.low, survey.high, survey.max_gradient))
    assert isinstance(answered(held, messages.PackVoxels(1, rules)), messages.VoxelsPacked)
    return [survey, counted.message, [bytes(part) for part in counted.payload], packets(held)]


def test_the_next_client_finds_what_the_one_before_has_left(volume: Path) -> None:
    with SingleProcess(volume) as single:
        rules = single.volume.quantisation(scene(single).quantise)
    held = HeldVolume()
    first = asked_of(held, volume, SECOND, rules)
    before = bytes_read()
    assert asked_of(held, volume, SECOND, rules) == first
    assert bytes_read() - before < 2 * LOOKED_AT
    assert asked_of(held, volume, MOVED[1], rules) == asked_of(HeldVolume(), volume, MOVED[1], rules)


def test_a_client_that_goes_while_more_is_read_leaves_what_was_there(volume: Path) -> None:
    with SingleProcess(volume) as single:
        rules = single.volume.quantisation(scene(single).quantise)
    held = HeldVolume()
    asked_of(held, volume, SECOND, rules)
    described = answered(held, messages.DescribeVolume(str(volume)))
    assert isinstance(described, messages.VolumeDescribed)
    answered(held, messages.ChangeSubCubes(2, str(volume), [FIRST], described.identity, rules))
    left = packets(held)
    held.keep()
    answered(held, messages.ReadSubCubes(1, str(volume), [SECOND], described.identity))
    held.superseded = lambda assignment: True
    assert held.answers(messages.PackVoxels(1, rules)) == []
    held.keep()
    assert packets(held) == left


def test_other_rules_and_another_volume_are_not_taken_for_what_is_kept(volume: Path, tmp_path: Path) -> None:
    with SingleProcess(volume) as single:
        rules = single.volume.quantisation(scene(single).quantise)
    low, high = rules.window
    others = msgspec.structs.replace(rules, window=(low, low + (high - low) / 2))
    held = HeldVolume()
    asked_of(held, volume, SECOND, rules)
    assert asked_of(held, volume, SECOND, others) == asked_of(HeldVolume(), volume, SECOND, others)
    copy = tmp_path / volume.name
    data = bytearray(volume.read_bytes())
    data[-8:] = data[-16:-8]
    copy.write_bytes(data)
    assert asked_of(held, copy, SECOND, rules) == asked_of(HeldVolume(), copy, SECOND, rules)


def test_one_that_joins_gets_its_part_whatever_it_had_kept(volume: Path, tmp_path: Path) -> None:
    with SingleProcess(volume) as single:
        rules = single.volume.quantisation(scene(single).quantise)
    copy = tmp_path / volume.name
    data = bytearray(volume.read_bytes())
    data[-16:-8] = data[-32:-24]
    copy.write_bytes(data)
    fresh, kept = HeldVolume(), HeldVolume()
    asked_of(kept, copy, SECOND, rules)
    kept.keep()
    for joiner in (fresh, kept):
        described = answered(joiner, messages.DescribeVolume(str(volume)))
        assert isinstance(described, messages.VolumeDescribed)
        answered(joiner, messages.ChangeSubCubes(1, str(volume), [SECOND], described.identity, rules))
    asked_of(whole := HeldVolume(), volume, SECOND, rules)
    assert packets(fresh) == packets(kept) == packets(whole)
    assert asked_of(kept, copy, SECOND, rules) == asked_of(HeldVolume(), copy, SECOND, rules), "drawn as what it held"


def test_what_is_held_stays_where_a_change_is_refused(volume: Path, tmp_path: Path) -> None:
    copy = tmp_path / volume.name
    copy.write_bytes(volume.read_bytes())
    held = HeldVolume()
    described = answered(held, messages.DescribeVolume(str(copy)))
    assert isinstance(described, messages.VolumeDescribed)
    with SingleProcess(volume) as single:
        rules = single.volume.quantisation(scene(single).quantise)
    answered(held, messages.ReadSubCubes(1, str(copy), [FIRST], described.identity))
    answered(held, messages.PackVoxels(1, rules))
    before = packets(held)
    copy.write_bytes(bytes(8 * SIDE**3))
    with pytest.raises(BadInput, match="was replaced or changed"):
        held.answers(messages.ChangeSubCubes(2, str(copy), [MOVED[0]], described.identity, rules))
    assert (held.assignment, packets(held)) == (1, before)


def packets(held: HeldVolume) -> bytes:
    [cube] = held.sub_cubes(0)
    return bytes(np.asarray(memoryview(cube.packets)))
