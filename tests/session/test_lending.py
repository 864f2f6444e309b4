"""A volume that only comes whole: one map/shade server reads it, and the others get theirs from it."""

import gzip
import shutil
from pathlib import Path

import msgspec
import numpy as np
import psutil
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from support.files.head_volume import SIZE, skin
from support.patience import wait_until
from support.programs.hand_started import joined_by_hand
from support.programs.server_processes import is_server
from volsplat.client import Session
from volsplat.client.coordinator.holding.lending import parts_of
from volsplat.client.phantoms import make_phantom
from volsplat.client.phantoms.volume_writer import write_volume
from volsplat.client.session.single import SingleProcess
from volsplat.mapshade_server.held.lent_volume import AwaitedParts, lent
from volsplat.mapshade_server.readers.reading.volume_reader import Voxels
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.volume import HALO, Box, Geometry, VolumeDescription
from volsplat.protocol.messages.messages import AwaitParts, VolumePart
from volsplat.protocol.text.errors import BadInput, VolsplatError

WORKERS = 3
NAME = "head.nrrd"


@pytest.fixture(scope="module")
def zipped(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The head as a gzip NRRD, alone in its folder."""
    folder = tmp_path_factory.mktemp("zipped")
    values, geometry = make_phantom("head", size=SIZE)
    plain = folder / "plain.nrrd"
    write_volume(plain, values, geometry)
    header, _, voxels = plain.read_bytes().partition(b"\n\n")
    assert b"encoding: raw" in header
    path = folder / NAME
    path.write_bytes(header.replace(b"encoding: raw", b"encoding: gzip") + b"\n\n" + gzip.compress(voxels))
    plain.unlink()
    return path


def test_the_file_need_only_be_where_the_first_server_is(zipped: Path, tmp_path: Path) -> None:
    with SingleProcess(zipped) as single, joined_by_hand([zipped.parent, tmp_path, tmp_path], NAME) as session:
        scene = skin(session)
        assert session.volume == single.volume
        assert torch.equal(session.render(scene), single.render(scene))
        other = msgspec.structs.replace(scene, quantise=msgspec.structs.replace(scene.quantise, directions="paper"))
        assert torch.equal(session.render(other), single.render(other))


@pytest.mark.parametrize("victim", range(WORKERS))
def test_whoever_is_lost_while_it_is_read_again_the_others_hold_all_of_it(zipped: Path, victim: int) -> None:
    """One of the victims is the lender: another one reads the file then."""
    lines: list[str] = []
    with SingleProcess(zipped) as single, Session(zipped, workers=WORKERS, on_progress=lines.append) as session:
        scene = skin(session)
        session.render(scene)
        processes = [psutil.Process(pid) for pid in session.server_processes]
        workers = [process for process in processes if is_server(process, "mapshade_server")]

        def die(text: str) -> None:
            if text.endswith("by one server for all") and workers[victim].is_running():
                workers[victim].kill()

        session._coordination._on_progress = die
        other = msgspec.structs.replace(scene, quantise=msgspec.structs.replace(scene.quantise, directions="paper"))
        *_, last = [refinement for refinement in session.refine(other) if refinement.complete]
        assert last.outcome is not None
        (lost,) = [server for server in session.servers if server.lost]
        assert lost.handed_over and last.outcome.servers.missing == ()
        assert torch.equal(last.image, single.render(other))


def test_no_image_is_whole_without_what_nobody_can_read_again(zipped: Path, tmp_path: Path) -> None:
    volume, away = tmp_path / NAME, tmp_path / "away"
    shutil.copy(zipped, volume)
    with Session(volume, workers=WORKERS) as session:
        scene = skin(session)
        whole = session.render(scene)
        processes = [psutil.Process(pid) for pid in session.server_processes]
        volume.rename(away)
        next(process for process in processes if is_server(process, "mapshade_server")).kill()
        wait_until(lambda: any(server.lost for server in session.servers), "is the loss known")
        for _ in range(3):
            with pytest.raises(VolsplatError, match="no such file|are missing"):
                session.render(scene)
        away.rename(volume)
        wait_until(lambda: image_of(session, scene) is not None, "is it drawn again")
        assert torch.equal(session.render(scene), whole)


def image_of(session: Session, scene: Scene) -> torch.Tensor | None:
    try:
        return session.render(scene)
    except VolsplatError:
        return None


# -- the parts


class TwoScalars:
    """A reader in memory."""

    def __init__(self, values: Voxels, second: Voxels) -> None:
        self._values = {0: values, 1: second}
        nk, nj, ni = values.shape
        self.description = VolumeDescription(
            name="two", format="memory", geometry=Geometry((ni, nj, nk)), scalar_type="int16", second_scalar=(0.0, 9.0)
        )

    def read(self, box: Box) -> Voxels:
        return _cut(self._values[0], box)

    def read_second(self, box: Box) -> Voxels:
        return _cut(self._values[1], box)


def _cut(values: Voxels, box: Box) -> Voxels:
    (i0, j0, k0), (i1, j1, k1) = box
    return values[k0:k1, j0:j1, i0:i1].copy()


def test_what_comes_in_parts_is_what_is_read_at_once() -> None:
    random = np.random.default_rng(5)
    values = random.integers(-9, 9, (7, 8, 9), dtype=np.int16)
    reader = TwoScalars(values, random.random((7, 8, 9), dtype=np.float32))
    geometry, boxes = reader.description.geometry, [Box((0, 0, 0), (9, 4, 7)), Box((3, 4, 0), (9, 8, 7))]
    loan = lent(reader, assignment=1)
    assert loan.scalar_types == ["int16", "float32"]
    awaited = AwaitedParts(AwaitParts(1, reader.description, boxes))
    for n, box in enumerate(boxes):
        for scalar, of_scalar in enumerate((box.grown(HALO, geometry.dims), box)):
            for place in parts_of(of_scalar, 20):
                part = VolumePart(server=2, sub_cube=n, scalar=scalar, scalar_type=loan.scalar_types[scalar], box=place)
                assert not awaited.complete
                awaited.take(part, memoryview(bytearray(loan.part(part))))
    assert awaited.complete
    for sub_cube, box in zip(awaited.sub_cubes(), boxes, strict=True):
        source, second = sub_cube._source, sub_cube._second
        assert np.array_equal(source, reader.read(box.grown(HALO, geometry.dims)))
        assert np.array_equal(second, reader.read_second(box))


def test_a_part_that_nobody_awaits_is_refused() -> None:
    described = VolumeDescription(name="one", format="memory", geometry=Geometry((9, 8, 7)), scalar_type="uint8")
    awaited = AwaitedParts(AwaitParts(1, described, [Box((0, 0, 0), (9, 4, 7))]))
    for sub_cube, scalar, box in ((1, 0, Box((0, 0, 0), (1, 1, 1))), (0, 1, Box((0, 0, 0), (1, 1, 1))),
                                  (0, 0, Box((0, 5, 0), (1, 6, 1)))):  # fmt: skip
        with pytest.raises(BadInput, match="not awaited"):
            awaited.take(VolumePart(2, sub_cube, scalar, "uint8", box), memoryview(bytearray(1)))


SHEET, TWO_SHEETS, CORNER = Box((0, 0, 0), (9, 5, 1)), Box((0, 0, 0), (9, 5, 2)), Box((0, 0, 1), (2, 2, 3))


@pytest.mark.parametrize(
    "parts",
    [[SHEET, SHEET], [TWO_SHEETS, Box((0, 0, 1), (9, 5, 3))], [Box((0, 0, 1), (9, 5, 2))], [SHEET, CORNER]],
    ids=["twice", "overlapping", "one missing before it", "in several pieces"],
)
def test_no_voxel_is_counted_twice_nor_left_out(parts: list[Box]) -> None:
    """What is drawn before all voxels are there would be whatever lay in memory."""
    described = VolumeDescription(name="one", format="memory", geometry=Geometry((9, 8, 7)), scalar_type="uint8")
    awaited = AwaitedParts(AwaitParts(1, described, [Box((0, 0, 0), (9, 4, 7))]))
    *right, wrong = [VolumePart(2, 0, 0, "uint8", box) for box in parts]
    for part in right:
        awaited.take(part, memoryview(bytearray(part.box.voxels)))
    with pytest.raises(BadInput, match="not the next one|not awaited"):
        awaited.take(wrong, memoryview(bytearray(wrong.box.voxels)))
    assert not awaited.complete


@given(st.tuples(*[st.integers(1, 12)] * 3), st.integers(1, 300))
def test_parts_partition_a_box_and_keep_the_limit(size: tuple[int, int, int], limit: int) -> None:
    box = Box((1, 2, 3), (1 + size[0], 2 + size[1], 3 + size[2]))
    cut = parts_of(box, limit)
    assert sum(part.voxels for part in cut) == box.voxels
    assert all(1 <= part.voxels <= limit for part in cut)
    assert len({part.low for part in cut}) == len(cut)
