"""One volume: no picture is drawn from two files of one name, nor from one that was changed while it is open."""

import os
import shutil
from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import h5py
import msgspec
import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from support.files.head_volume import SIZE, skin
from support.files.loopback_files import served
from support.files.prepared import prepare_small
from support.patience import PATIENCE
from support.programs.hand_started import free_port, joined_by_hand
from support.programs.programs import Person
from support.scenes.phantoms import QUANTISATION
from volsplat.client import Session
from volsplat.client.phantoms import make_phantom
from volsplat.client.phantoms.volume_writer import write_volume
from volsplat.client.session.single import SingleProcess
from volsplat.mapshade_server.held import volume_identity
from volsplat.mapshade_server.held.volume_identity import (
    BLOCK_BYTES,
    WHOLE_BYTES,
    identified_store,
    identified_volume,
    identity_of,
)
from volsplat.mapshade_server.held_volume import HeldVolume
from volsplat.mapshade_server.readers import open_volume
from volsplat.mapshade_server.readers.reading.volume_files import VolumeFile, disk_files
from volsplat.mapshade_server.readers.reading.volume_reader import OpenedVolume
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Quantise, Scene
from volsplat.protocol.description.volume import Geometry, VolumeDescription
from volsplat.protocol.messages import messages
from volsplat.protocol.text.errors import BadInput

NAME = "head.nrrd"
DESCRIPTION = VolumeDescription(
    name="head", format="test", geometry=Geometry(dims=(256, 256, 256)), scalar_type="uint8"
)
LONG_AGO = 10**18  # nanoseconds since 1970


class Files(NamedTuple):
    files: Sequence[VolumeFile]
    description: VolumeDescription


def written(path: Path, size: tuple[int, int, int] = SIZE, kind: str = "head") -> Path:
    path.parent.mkdir(exist_ok=True)
    write_volume(path, *make_phantom(kind, size=size))
    return path


@pytest.fixture
def here(tmp_path: Path) -> Path:
    return written(tmp_path / "here" / NAME)


def one_voxel_more(path: Path, other: Path) -> None:
    """Another file, like the first but for one byte in each block that is looked at."""
    content = bytearray(path.read_bytes())
    content[2000::BLOCK_BYTES] = bytes(byte ^ 1 for byte in content[2000::BLOCK_BYTES])
    other.parent.mkdir(exist_ok=True)
    other.write_bytes(content)


def turned(path: Path, other: Path) -> None:
    """The same voxels on another grid."""
    content = path.read_bytes()
    assert b"sizes: 32 40 36" in content
    other.parent.mkdir(exist_ok=True)
    other.write_bytes(content.replace(b"sizes: 32 40 36", b"sizes: 40 32 36"))


@given(st.integers(0, WHOLE_BYTES - 1), st.integers(1, 3))
@settings(max_examples=15)
def test_any_byte_tells_two_small_volumes_apart(at: int, size: int) -> None:
    """In whichever of its files it lies."""
    with TemporaryDirectory() as folder:
        files = [Path(folder, f"{n}.raw") for n in range(size)]
        contents = np.arange(WHOLE_BYTES, dtype=np.uint32).astype(np.uint8)
        seen = set()
        for _ in range(2):
            for file, part in zip(files, np.array_split(contents, size), strict=True):
                file.write_bytes(part.tobytes())
            seen.add(identity_of("a volume", Files(disk_files(files), DESCRIPTION)).contents)
            contents[at] ^= 1
        assert len(seen) == 2


# -- two servers


OTHERS: dict[str, tuple[Callable[[Path, Path], object], str]] = {
    "another size": (lambda here, other: written(other, (32, 40, 20)), "bytes, not"),
    "another grid": (turned, "header differs"),
    "other contents": (one_voxel_more, "contents differ"),
}


@pytest.mark.parametrize(("make", "told"), OTHERS.values(), ids=OTHERS)
def test_two_servers_with_another_file_of_one_name_are_refused_by_place_and_name(
    here: Path, tmp_path: Path, make: Callable[[Path, Path], object], told: str
) -> None:
    other = tmp_path / "there" / NAME
    make(here, other)
    with joined_by_hand([here.parent, other.parent], NAME) as session:
        with pytest.raises(BadInput, match=told) as refused:
            session.volume  # noqa: B018
    assert str(other) in str(refused.value) and "give every server the same volume" in str(refused.value)
    assert "\n" not in str(refused.value)


def test_a_copy_with_another_time_of_change_is_the_same_volume(here: Path, tmp_path: Path) -> None:
    copy = tmp_path / "there" / NAME
    copy.parent.mkdir()
    shutil.copy(here, copy)
    os.utime(copy, ns=(LONG_AGO, LONG_AGO))
    with SingleProcess(here) as single, joined_by_hand([here.parent, copy.parent], NAME) as session:
        scene = skin(session)
        assert torch.equal(session.render(scene), single.render(scene))


def test_the_command_ends_with_status_2_and_writes_nothing(here: Path, tmp_path: Path) -> None:
    person = Person(tmp_path)
    other = written(tmp_path / "there" / NAME, (32, 40, 20))
    address = f"127.0.0.1:{free_port()}"
    command = person.starts("render", NAME, "-o", "head.png", "--listen", address, "--workers", "2")
    servers = [person.starts("splat-server", "--connect", address)]
    for folder in (here.parent, other.parent):
        person.folder = folder
        servers.append(person.starts("mapshade-server", "--connect", address))
    _, said = command.communicate(timeout=PATIENCE)
    assert command.returncode == 2
    assert "another volume" in said and (str(other) in said or str(here) in said), "whichever has not described it"
    for server in servers:
        server.communicate(timeout=PATIENCE)
    assert [server.returncode for server in servers] == [0, 0, 0]
    assert not (tmp_path / "head.png").exists()


# -- one server, another time


def other_rules(scene: Scene) -> Scene:
    """What the same volume must be read again for."""
    return msgspec.structs.replace(scene, quantise=Quantise(directions="paper"))


CHANGES: dict[str, Callable[[Path], object]] = {
    "replaced by a larger one": lambda path: os.replace(written(path.with_name("new.nrrd"), (32, 40, 38)), path),
    "rewritten in place": lambda path: path.write_bytes(path.read_bytes()[::-1]),
    "one voxel changed": lambda path: change_a_byte(path, -1),
    "touched": lambda path: os.utime(path, ns=(LONG_AGO, LONG_AGO)),
    "gone": lambda path: path.unlink(),
}


def change_a_byte(path: Path, where: int) -> None:
    content = bytearray(path.read_bytes())
    content[where] ^= 255
    path.write_bytes(content)


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES)
def test_a_file_that_is_replaced_in_an_open_session_is_refused_and_the_session_goes_on(
    here: Path, change: Callable[[Path], object]
) -> None:
    before = here.with_name("before")
    shutil.copy2(here, before)
    with Session(here, workers=2) as session:
        scene = skin(session)
        first = session.render(scene)
        change(here)
        assert torch.equal(session.render(scene), first), "what is held is still the volume that was opened"
        for _ in range(2):
            with pytest.raises(BadInput, match=NAME) as refused:
                session.render(other_rules(scene))
            assert "\n" not in str(refused.value)
        assert torch.equal(session.render(scene, Step.F), first), "it is drawn on as it was"
        os.replace(before, here)
        with SingleProcess(here) as single:
            assert torch.equal(session.render(other_rules(scene)), single.render(other_rules(scene)))
        assert not any(server.lost for server in session.servers)


def test_a_single_process_draws_no_replaced_file_either(here: Path) -> None:
    with SingleProcess(here) as single:
        scene = skin(single)
        first = single.render(scene)
        written(here, (32, 40, 38))
        with pytest.raises(BadInput, match="was replaced or changed after it was opened"):
            single.render(other_rules(scene))
        assert torch.equal(single.render(scene), first)


class Reading:
    """A map/shade server's volume, and a file that changes in the moment before it is read, if it is to."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.changes = False
        self.held = HeldVolume()
        self.held.superseded = self._about_to_read
        (described,) = self.held.answers(messages.DescribeVolume(str(path)))
        assert isinstance(described.message, messages.VolumeDescribed)
        self.identity = described.message.identity
        self.boxes = [described.message.description.geometry.box]

    def _about_to_read(self, _: int) -> bool:
        if self.changes:
            self.changes = False
            change_a_byte(self.path, -1)
        return False

    def reads(self, assignment: int = 1, held: bool = True) -> messages.ReadSubCubes:
        return messages.ReadSubCubes(assignment, str(self.path), self.boxes, self.identity, held)

    def changed_to(self, assignment: int) -> messages.ChangeSubCubes:
        return messages.ChangeSubCubes(assignment, str(self.path), self.boxes, self.identity, QUANTISATION)

    def reads_ahead(self) -> None:
        self.held.reading_ahead(messages.ReadAhead(1, str(self.path), self.boxes, self.identity, QUANTISATION))()

    def packs_again(self) -> None:
        """What a client before had read, by other rules."""
        self.held.answers(messages.PackVoxels(2, QUANTISATION))

    def packets(self) -> list[bytes]:
        return [bytes(memoryview(cube.packets).cast("B")) for cube in self.held.sub_cubes(0)]


def kept_for_another_client(reading: Reading) -> None:
    other = msgspec.structs.replace(QUANTISATION, directions="paper")
    reading.held.answers(reading.reads())
    reading.held.answers(messages.PackVoxels(1, other))
    reading.held.keep()
    reading.held.answers(reading.reads(2))


def nothing(_: Reading) -> None:
    pass


READINGS: dict[str, tuple[Callable[[Reading], object], Callable[[Reading], object]]] = {
    "read": (nothing, lambda reading: reading.held.answers(reading.reads())),
    "counted": (
        lambda reading: reading.held.answers(reading.reads(held=False)),
        lambda reading: reading.held.answers(messages.CountHistograms(1, 0.0, 255.0, 100.0)),
    ),
    "packed again": (kept_for_another_client, Reading.packs_again),
    "changed": (nothing, lambda reading: reading.held.answers(reading.changed_to(1))),
    "lent": (
        nothing,
        lambda reading: reading.held.answers(messages.LendVolume(1, str(reading.path), reading.identity)),
    ),
    "read ahead": (nothing, Reading.reads_ahead),
}


@pytest.mark.parametrize(("before", "reads"), READINGS.values(), ids=READINGS)
def test_a_file_that_is_replaced_while_it_is_read_is_refused(
    here: Path, before: Callable[[Reading], object], reads: Callable[[Reading], object]
) -> None:
    reading, kept = Reading(here), here.with_name("kept")
    before(reading)
    shutil.copy2(here, kept)
    reading.changes = True
    with pytest.raises(BadInput, match="was replaced or changed"):
        reads(reading)
    assert not reading.changes, "it was read"
    with pytest.raises(BadInput, match="level 0 is not held"):
        reading.held.sub_cubes(0)
    with pytest.raises(BadInput, match="of which nothing is lent"):
        reading.held.answers(messages.ReadPart(1, messages.VolumePart(1, 0, 0, "uint8", reading.boxes[0])))
    os.replace(kept, here)
    reading.held.answers(reading.changed_to(3))
    other = Reading(here)
    other.held.answers(other.changed_to(3))
    assert reading.packets() == other.packets(), "nothing is left of what was read meanwhile"


@pytest.mark.parametrize("scheme", ["", "file://"])
def test_a_file_that_is_changed_while_it_is_opened_is_refused(
    here: Path, scheme: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def opened(volume: str) -> OpenedVolume:
        found = open_volume(volume)
        written(here, (32, 40, 38))
        return found

    monkeypatch.setattr(volume_identity, "open_volume", opened)
    with pytest.raises(BadInput, match="is being changed while it is opened; wait until that is over"):
        identified_volume(f"{scheme}{here}")


# -- the identity itself


def test_files_beside_a_header_belong_to_the_volume(tmp_path: Path) -> None:
    values = np.arange(6 * 7 * 8, dtype=np.int16)
    (tmp_path / "head.raw").write_bytes(values.tobytes())
    header = "NRRD0004\ntype: short\ndimension: 3\nsizes: 8 7 6\nendian: little\nencoding: raw\ndata file: head.raw\n"
    (tmp_path / "head.nhdr").write_text(header + "\n")
    _, before = identified_volume(str(tmp_path / "head.nhdr"))
    change_a_byte(tmp_path / "head.raw", 100)
    _, after = identified_volume(str(tmp_path / "head.nhdr"))
    assert after.difference(before) == "its contents differ"


def raw_with_words_beside(folder: Path, value: int) -> str:
    """The value is in the words, which say how the numbers are to be read."""
    (folder / "head.raw").write_bytes(np.arange(6 * 7 * 8, dtype=np.int16).tobytes())
    (folder / "head.raw.toml").write_text(f'dims = [8, 7, 6]\ntype = "int16"\nendian = "{("big", "little")[value]}"\n')
    return str(folder / "head.raw")


def voxels_behind(folder: Path, value: int) -> None:
    with h5py.File(folder / "data.h5", "w") as file:
        file["voxels"] = np.full((6, 7, 8), value, np.int16)


def linked_hdf5(folder: Path, value: int) -> str:
    voxels_behind(folder, value)
    if not (folder / "master.h5").exists():
        with h5py.File(folder / "master.h5", "w") as file:
            file["entry"] = h5py.ExternalLink("data.h5", "/voxels")
    return f"{folder / 'master.h5'}#/entry"


def virtual_hdf5(folder: Path, value: int) -> str:
    """Through a virtual dataset of a second file."""
    voxels_behind(folder, value)
    for name, of, path in (("between.h5", "data.h5", "voxels"), ("master.h5", "between.h5", "entry")):
        layout = h5py.VirtualLayout((6, 7, 8), np.int16)
        layout[:] = h5py.VirtualSource(of, path, (6, 7, 8))
        if not (folder / name).exists():
            with h5py.File(folder / name, "w") as file:
                file.create_virtual_dataset("entry", layout)
    return f"{folder / 'master.h5'}#/entry"


def linked_on(folder: Path, to: str) -> Any:
    """A source of a virtual dataset in a file that only leads on."""
    with h5py.File(folder / "between.h5", "w") as file:
        file["entry"] = h5py.ExternalLink(to, "/voxels")
    return h5py.VirtualSource("between.h5", "entry", (6, 7, 8))


def linked_twice_hdf5(folder: Path) -> list[str]:
    linked_on(folder, "data.h5")
    with h5py.File(folder / "master.h5", "w") as file:
        file["entry"] = h5py.ExternalLink("between.h5", "/entry")
    return ["between.h5", "data.h5"]


def virtual_hdf5_of_linked(folder: Path) -> list[str]:
    layout = h5py.VirtualLayout((6, 7, 8), np.int16)
    layout[:] = linked_on(folder, "data.h5")
    with h5py.File(folder / "master.h5", "w") as file:
        file.create_virtual_dataset("entry", layout)
    return ["between.h5", "data.h5"]


def virtual_hdf5_of_lost(folder: Path) -> list[str]:
    """Of which one half is there, and the other one may come."""
    layout = h5py.VirtualLayout((12, 7, 8), np.int16)
    layout[:6] = h5py.VirtualSource("data.h5", "voxels", (6, 7, 8))
    layout[6:] = linked_on(folder, "gone.h5")
    with h5py.File(folder / "master.h5", "w") as file:
        file.create_virtual_dataset("entry", layout)
    return ["data.h5", "between.h5"]


@pytest.mark.parametrize("write", [linked_twice_hdf5, virtual_hdf5_of_linked, virtual_hdf5_of_lost])
def test_files_that_only_lead_on_belong_to_the_volume_each_once(
    write: Callable[[Path], list[str]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    voxels_behind(tmp_path, 1)
    names = write(tmp_path)
    monkeypatch.chdir(tmp_path)
    for place in (tmp_path / "master.h5", "master.h5"):
        assert open_volume(f"{place}#/entry").files == disk_files([tmp_path / n for n in ("master.h5", *names)])


@pytest.mark.parametrize("write", [raw_with_words_beside, linked_hdf5, virtual_hdf5])
def test_files_that_the_named_one_leads_to_belong_to_the_volume(
    write: Callable[[Path, int], str], tmp_path: Path
) -> None:
    _, before = identified_volume(write(tmp_path, 0))
    assert identified_volume(write(tmp_path, 0))[1].at_no_place().contents == before.contents
    _, after = identified_volume(write(tmp_path, 1))
    assert after.contents != before.contents


def test_two_servers_to_which_the_same_numbers_are_told_to_be_others_are_refused(tmp_path: Path) -> None:
    folders = [tmp_path / "here", tmp_path / "there"]
    for value, folder in enumerate(folders):
        folder.mkdir()
        raw_with_words_beside(folder, value)
    with joined_by_hand(folders, "head.raw") as session:
        with pytest.raises(BadInput, match="give every server the same volume"):
            session.volume  # noqa: B018


def test_any_change_of_a_small_file_shows_even_at_another_place(here: Path, tmp_path: Path) -> None:
    _, before = identified_volume(str(here))
    copy = tmp_path / NAME
    for where in (3000, 9999, -1):
        shutil.copy2(here, copy)
        assert identified_volume(str(copy))[1].difference(before) == ""
        change_a_byte(copy, where)
        assert identified_volume(str(copy))[1].difference(before) == "its contents differ"


def test_of_a_large_file_little_is_read(tmp_path: Path) -> None:
    path = tmp_path / "large.raw"
    with path.open("wb") as file:
        file.truncate(100 << 30)
    name = f"{path}#dims=8192x4096x3200,type=uint8"
    before = read_bytes()
    _, identity = identified_volume(name)
    assert identity.size == 100 << 30
    assert read_bytes() - before < 4 << 20
    with path.open("r+b") as file:
        file.seek(-1, os.SEEK_END)
        file.write(b"x")
    assert identified_volume(name)[1].difference(identity) == "its contents differ"


def read_bytes() -> int:
    """By this process so far, from the page cache too."""
    lines = Path("/proc/self/io").read_text(encoding="utf-8").splitlines()
    return int(next(line for line in lines if line.startswith("rchar")).split()[1])


def test_a_zarr_s_documents_and_chunks_are_its_identity_on_disk_and_at_a_url(tmp_path: Path) -> None:
    zarr = pytest.importorskip("zarr")
    folder = tmp_path / "head.zarr"
    array = zarr.create_array(folder, shape=(24, 20, 16), chunks=(8, 8, 8), dtype="i2")
    array[:] = np.arange(24 * 20 * 16, dtype=np.int16).reshape(24, 20, 16)
    with served(tmp_path) as files:
        for place in (str(folder), f"{files.url}/head.zarr"):
            _, before = identified_volume(place)
            assert identified_volume(place)[1] == before
            chunk = next(path for path in sorted(folder.rglob("0")) if path.is_file())
            content = chunk.read_bytes()
            chunk.write_bytes(content + b"\0")
            assert identified_volume(place)[1].difference(before) != ""
            chunk.write_bytes(content)
            array.attrs["units"] = f"HU of {place}"
            assert identified_volume(place)[1].difference(before) != ""


def test_a_packet_store_that_was_made_anew_is_another_one(tmp_path: Path) -> None:
    store = tmp_path / "a.zarr"
    prepare_small(written(tmp_path / NAME), store)
    _, before = identified_store(str(store))
    shutil.rmtree(store)
    prepare_small(written(tmp_path / NAME, kind="shells"), store)
    _, after = identified_store(str(store))
    assert after.difference(before) != ""
