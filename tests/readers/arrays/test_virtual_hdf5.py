"""Virtual HDF5 datasets: how many others one may take its values from, and how often these are looked at."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from support.files.opened import described, read_whole
from volsplat.mapshade_server.readers import open_volume
from volsplat.mapshade_server.readers.arrays import hdf5_sources
from volsplat.protocol.text.errors import BadInput

h5py = pytest.importorskip("h5py")

SHAPE = (8, 8, 8)
VALUES = np.arange(np.prod(SHAPE), dtype=np.uint16).reshape(SHAPE)


def sheets(layout: Any, source: Any) -> None:
    for n in range(len(VALUES)):
        layout[n] = source[n]


def overlapping(layout: Any, source: Any) -> None:
    for n in range(len(VALUES)):
        layout[: 8 - n // 2] = source[: 8 - n // 2]


def levels(path: Path, count: int, take: Callable[[Any, Any], None]) -> str:
    """Each level takes its values from the one below in eight parts, so that 8 ** count ways lead to the last one."""
    with h5py.File(path, "w", libver="latest") as file:
        file.create_dataset(f"level{count}", data=VALUES, chunks=(4, 8, 8), compression="gzip")
        for level in reversed(range(count)):
            layout = h5py.VirtualLayout(SHAPE, VALUES.dtype)
            take(layout, h5py.VirtualSource(".", f"level{level + 1}", SHAPE))
            file.create_virtual_dataset(f"level{level}", layout)
    return f"{path}#level0"


@contextmanager
def counted_files(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[Path]]:
    """Those that are opened meanwhile, as often as they are."""
    opened, real = list[Path](), h5py.File

    def counting(place: Path, *settings: Any, **more: Any) -> Any:
        opened.append(place)
        return real(place, *settings, **more)

    with monkeypatch.context() as patched:
        patched.setattr(h5py, "File", counting)
        yield opened


@pytest.mark.parametrize("take", [sheets, overlapping])
def test_by_however_many_ways_values_come_they_are_looked_at_once(
    take: Callable[[Any, Any], None], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    volume = open_volume(levels(tmp_path / "v.h5", 5, take))
    with counted_files(monkeypatch) as opened:
        values = volume.read(volume.description.geometry.box)
    assert np.array_equal(values, VALUES)
    assert len(opened) <= 6  # one for each level


def looks(monkeypatch: pytest.MonkeyPatch, name: str, volume: str) -> int:
    """How often a file of this name is asked after while the volume is opened."""
    looked, real = list[Path](), Path.stat

    def counting(place: Path, **more: Any) -> Any:
        looked.append(place)
        return real(place, **more)

    with monkeypatch.context() as patched:
        patched.setattr(Path, "stat", counting)
        described(volume)
    return sum(place.name == name for place in looked)


def whole(layout: Any, source: Any) -> None:
    layout[...] = source


def test_a_file_is_looked_for_as_often_however_many_sheets_come_from_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with h5py.File(tmp_path / "source.h5", "w") as file:
        file["v"] = VALUES
    for take in (whole, sheets):
        layout = h5py.VirtualLayout(SHAPE, VALUES.dtype)
        take(layout, h5py.VirtualSource("source.h5", "v", SHAPE))
        with h5py.File(tmp_path / f"{take.__name__}.h5", "w", libver="latest") as file:
            file.create_virtual_dataset("v", layout)
    once, in_sheets = (looks(monkeypatch, "source.h5", f"{tmp_path / name}.h5") for name in ("whole", "sheets"))
    assert 0 < in_sheets == once


def test_a_file_is_opened_as_often_however_many_datasets_come_from_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened = []
    for count in (1, 8):
        layout, parts = h5py.VirtualLayout(SHAPE, VALUES.dtype), np.split(VALUES, count)
        with h5py.File(tmp_path / f"source{count}.h5", "w") as file:
            for n, part in enumerate(parts):
                file[f"part{n}"] = part
                layout[n * len(part) : (n + 1) * len(part)] = h5py.VirtualSource(file[f"part{n}"])
        with h5py.File(tmp_path / f"v{count}.h5", "w", libver="latest") as file:
            file.create_virtual_dataset("v", layout)
        with counted_files(monkeypatch) as places:
            assert np.array_equal(read_whole(f"{tmp_path / f'v{count}.h5'}"), VALUES)
        opened.append([place.name for place in places].count(f"source{count}.h5"))
    assert 0 < opened[1] == opened[0]


def test_opening_goes_once_to_each_file_that_values_come_from(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    layout = h5py.VirtualLayout((3, *SHAPE[1:]), VALUES.dtype)
    for n in range(3):
        with h5py.File(tmp_path / f"source{n}.h5", "w") as file:
            file["v"] = VALUES
        layout[n] = h5py.VirtualSource(f"source{n}.h5", "v", SHAPE)[n]
    with h5py.File(tmp_path / "v.h5", "w", libver="latest") as file:
        file.create_virtual_dataset("v", layout)
    (tmp_path / "source2.h5").write_bytes(b"no HDF5")
    with counted_files(monkeypatch) as places:
        (told,) = described(f"{tmp_path / 'v.h5'}").warnings
    assert "1 of 3 files" in told and "(source2.h5)" in told
    assert sorted(place.name for place in places if place.name.startswith("source")) == ["source0.h5", "source1.h5"]


@pytest.mark.parametrize(("count", "most"), [(1, 1), (2, 64), (3, 64 + 512)])
def test_ways_are_counted_only_from_the_second_virtual_dataset_on(
    count: int, most: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Those of the first one are as many as its file holds, and HDF5 does not multiply them."""
    named = levels(tmp_path / "v.h5", count, sheets)
    monkeypatch.setattr(hdf5_sources, "MOST_WAYS", most)
    assert np.array_equal(read_whole(named), VALUES)
    if count > 1:
        monkeypatch.setattr(hdf5_sources, "MOST_WAYS", most - 1)
        with pytest.raises(BadInput, match=f"by more than {most - 1} ways"):
            described(named)


def test_turns_without_end_are_one_way_if_they_are_not_numbered(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two datasets whose sheets follow each other in turn, as many as they have."""
    endless, half = h5py.h5s.UNLIMITED, len(VALUES) // 2
    creation = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    with h5py.File(tmp_path / "v.h5", "w", libver="latest") as file:
        for first in range(2):
            file.create_dataset(f"half{first}", data=VALUES[first::2], maxshape=(None, 8, 8))
            into = h5py.h5s.create_simple(SHAPE, (endless, 8, 8))
            of = h5py.h5s.create_simple((half, 8, 8), (endless, 8, 8))
            into.select_hyperslab((first, 0, 0), (endless, 1, 1), (2, 1, 1), (1, 8, 8))
            of.select_hyperslab((0, 0, 0), (endless, 1, 1), (1, 1, 1), (1, 8, 8))
            creation.set_virtual(into, b".", f"half{first}".encode(), of)
        extent = h5py.h5s.create_simple(SHAPE, (endless, 8, 8))
        h5py.h5d.create(file.id, b"v", h5py.h5t.NATIVE_UINT16, extent, creation)
    monkeypatch.setattr(hdf5_sources, "MOST_WAYS", 2)
    assert np.array_equal(read_whole(f"{tmp_path / 'v.h5'}#v"), VALUES)


@pytest.mark.parametrize("take", [sheets, overlapping])
def test_more_ways_than_hdf5_can_go_are_refused(take: Callable[[Any, Any], None], tmp_path: Path) -> None:
    """It goes them all when it closes the dataset, however little was read."""
    with pytest.raises(BadInput, match="takes its values from other datasets by more than 100000 ways"):
        open_volume(levels(tmp_path / "v.h5", 12, take))


def test_so_are_those_of_coordinates(tmp_path: Path) -> None:
    path = tmp_path / "v.h5"
    with h5py.File(path, "w", libver="latest") as file:
        file["level12"] = np.arange(8.0)
        for level in reversed(range(12)):
            layout = h5py.VirtualLayout((8,), np.float64)
            sheets(layout, h5py.VirtualSource(".", f"level{level + 1}", (8,)))
            file.create_virtual_dataset(f"level{level}", layout)
        file["v"] = VALUES
        file["level0"].make_scale("x")
        file["v"].dims[2].attach_scale(file["level0"])
    with pytest.raises(BadInput, match="by more than 100000 ways"):
        open_volume(f"{path}#v")


def test_a_dataset_that_takes_from_itself_is_refused_though_no_part_does(tmp_path: Path) -> None:
    """HDF5 reads it, and crashes when it closes what takes its values from that."""
    with h5py.File(tmp_path / "v.h5", "w", libver="latest") as file:
        file["half"] = VALUES[:4]
        layout = h5py.VirtualLayout(SHAPE, VALUES.dtype)
        layout[:4] = h5py.VirtualSource(".", "half", (4, 8, 8))
        layout[4:] = h5py.VirtualSource(".", "both", SHAPE)[:4]
        file.create_virtual_dataset("both", layout)
        layout = h5py.VirtualLayout(SHAPE, VALUES.dtype)
        layout[...] = h5py.VirtualSource(".", "both", SHAPE)
        file.create_virtual_dataset("top", layout)
    with pytest.raises(BadInput, match="take theirs from others, without end"):
        open_volume(f"{tmp_path / 'v.h5'}#top")


def numbered(path: Path, most: int) -> str:
    """Sheets in files that are numbered without end, so many by its extent, of which only the first is there."""
    with h5py.File(path.parent / "0.h5", "w", libver="latest") as file:
        file["v"] = np.ones((1, 2, 2), np.uint8)
    endless = h5py.h5s.UNLIMITED
    creation, sheet = h5py.h5p.create(h5py.h5p.DATASET_CREATE), h5py.h5s.create_simple((1, 2, 2))
    for first, count, name in ((0, endless, b"%b.h5"), (most - 1, 1, b"0.h5")):
        space = h5py.h5s.create_simple((most, 2, 2), (endless, 2, 2))
        space.select_hyperslab((first, 0, 0), (count, 1, 1), (1, 1, 1), (1, 2, 2))
        creation.set_virtual(space, name, b"v", sheet)
    with h5py.File(path, "w", libver="latest") as file:
        extent = h5py.h5s.create_simple((most, 2, 2), (endless, 2, 2))
        h5py.h5d.create(file.id, b"v", h5py.h5t.NATIVE_UINT8, extent, creation)
    return str(path)


def test_files_numbered_without_end_are_looked_for_only_if_they_are_few(tmp_path: Path) -> None:
    assert read_whole(numbered(tmp_path / "few.h5", 20))[:, 0, 0].tolist() == [1, *[0] * 18, 1]
    with pytest.raises(BadInput, match="by more than 100000 ways, numbered"):
        described(numbered(tmp_path / "many.h5", (1 << 31) - 1))


@pytest.mark.parametrize("settings", [{}, {"compression": "gzip"}], ids=["plain", "deflated"])
def test_a_small_crop_of_a_great_chunk_is_read(settings: dict[str, str], tmp_path: Path) -> None:
    shape = (65, 1024, 1024)  # more than 64 MiB
    with h5py.File(tmp_path / "whole.h5", "w") as file:
        made = file.create_dataset("v", shape, np.uint8, chunks=shape, **settings)
        made[30:34, 100:105, 200:206] = 7
    layout = h5py.VirtualLayout((4, 5, 6), np.uint8)
    layout[...] = h5py.VirtualSource("whole.h5", "v", shape)[30:34, 100:105, 200:206]
    with h5py.File(tmp_path / "crop.h5", "w", libver="latest") as file:
        file.create_virtual_dataset("v", layout)
    assert np.array_equal(read_whole(str(tmp_path / "crop.h5")), np.full((4, 5, 6), 7))
