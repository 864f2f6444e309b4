"""Files of voxels that headers of NRRD and MetaImage name: as many and where they can be, and part of the volume."""

import gzip
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from support.files.opened import read_whole, refused
from volsplat.mapshade_server.readers import open_volume
from volsplat.mapshade_server.readers.reading import named_files
from volsplat.mapshade_server.readers.reading.header_numbers import numbered_names
from volsplat.mapshade_server.readers.reading.volume_files import DiskFile, files_of

VALUES = np.arange(64, dtype=np.uint8).reshape(4, 4, 4)
AS_TEXT = " ".join(str(value) for value in VALUES.ravel()) + "\n"


def nrrd(path: Path, encoding: str, fields: str, data: bytes = b"") -> Path:
    head = f"NRRD0004\ntype: uint8\ndimension: 3\nsizes: 4 4 4\nencoding: {encoding}\n{fields}\n\n"
    path.write_bytes(head.encode() + data)
    return path


def metaimage(path: Path, fields: str, data_file: str, data: bytes = b"") -> Path:
    head = f"ObjectType = Image\nNDims = 3\nDimSize = 4 4 4\nElementType = MET_UCHAR\n{fields}"
    path.write_bytes(f"{head}ElementDataFile = {data_file}\n".encode() + data)
    return path


def nrrd_of_text(folder: Path, name: str) -> Path:
    return nrrd(folder / "v.nhdr", "ascii", f"data file: {name}")


def metaimage_of_text(folder: Path, name: str) -> Path:
    return metaimage(folder / "v.mhd", "BinaryData = False\n", name)


OF_TEXT = pytest.mark.parametrize("of_text", [nrrd_of_text, metaimage_of_text])


@OF_TEXT
def test_voxels_written_as_text_beside_a_header_are_part_of_the_volume(
    of_text: Callable[[Path, str], Path], tmp_path: Path
) -> None:
    path, data = of_text(tmp_path, "v.txt"), tmp_path / "v.txt"
    assert "its data file v.txt is missing" in refused(path)
    data.write_text(AS_TEXT)
    np.testing.assert_array_equal(read_whole(path), VALUES)
    assert files_of(open_volume(str(path)), path) == (DiskFile(path), DiskFile(data))


@OF_TEXT
def test_text_outside_of_the_servers_folder_is_refused(
    of_text: Callable[[Path, str], Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    inside = tmp_path / "inside"
    inside.mkdir()
    (tmp_path / "v.txt").write_text(AS_TEXT)
    path = of_text(inside, "../v.txt")
    np.testing.assert_array_equal(read_whole(path), VALUES)
    monkeypatch.setattr(named_files, "_folders", [])  # what follows holds for this test alone
    named_files.hold_names_to(inside.resolve())
    assert "names ../v.txt, which does not lie below this server's --data-root" in refused(path)


def test_a_data_file_may_have_any_name(tmp_path: Path) -> None:
    """Also one by which the line could be taken for a key and its value."""
    (tmp_path / "a:=b.raw").write_bytes(VALUES.tobytes())
    np.testing.assert_array_equal(read_whole(nrrd(tmp_path / "v.nhdr", "raw", "data file: a:=b.raw")), VALUES)


def test_lines_that_are_skipped_end_with_the_file_and_may_be_long(tmp_path: Path) -> None:
    before = b"x" * 100_000 + b"\nshort\n"
    path = nrrd(tmp_path / "v.nrrd", "raw", "line skip: 2", before + VALUES.tobytes())
    np.testing.assert_array_equal(read_whole(path), VALUES)
    beyond = nrrd(tmp_path / "v.nrrd", "raw", "line skip: 999999999999999999", before + VALUES.tobytes())
    assert "holds only 0" in refused(beyond)


ZIPPED = gzip.compress(VALUES.tobytes())
REFUSALS: dict[str, tuple[Callable[[Path], Path], str]] = {
    "bytes skipped backwards": (lambda d: nrrd(d / "v.nrrd", "raw", "byte skip: -8", VALUES.tobytes()), "less than -1"),
    "bytes skipped backwards, gzip": (lambda d: nrrd(d / "v.nrrd", "gzip", "byte skip: -3", ZIPPED), "less than -1"),
    "lines skipped backwards": (
        lambda d: nrrd(d / "v.nrrd", "raw", "line skip: -1", VALUES.tobytes()),
        '"line skip: -1" is less than 0',
    ),
    "bytes skipped backwards, MetaImage": (
        lambda d: metaimage(d / "v.mha", "HeaderSize = -3\n", "LOCAL", VALUES.tobytes()),
        '"HeaderSize = -3" cannot be used',
    ),
    "sizes of thousands of digits": (
        lambda d: metaimage(d / "v.mha", f"DimSize = {'9' * 4000} {'9' * 4000} 4\n", "LOCAL"),
        "cannot be used",
    ),
}
NUMBERS = {
    "s%d.raw 1 1000000000 1": "names 1000000000 files for 4 slices",
    "s%d.raw 4 1 1": "names 0 files for 4 slices",
    "s%d.raw 1 3 1": "names 3 files for 4 slices",
    "s%d.raw 1 4 0": "has a step of 0",
    "s%d.raw 1 x 1": "is not a list of whole numbers",
    "s%d.raw 1 \N{SUPERSCRIPT TWO} 1": "is not a list of whole numbers",
    f"s%d.raw 1 {'9' * 5000} 1": "is not a list of whole numbers",
    "s%d%s.raw 1 4 1": "should have one number in the name",
    "s%0200000000d.raw 1 4 1": "should have one number in the name",
}


@pytest.mark.parametrize("case", REFUSALS)
def test_what_a_header_cannot_mean_is_refused_in_one_line(case: str, tmp_path: Path) -> None:
    make, cause = REFUSALS[case]
    assert cause in refused(make(tmp_path))


@pytest.mark.parametrize("name", NUMBERS)
def test_files_by_numbers_are_as_many_as_there_can_be(name: str, tmp_path: Path) -> None:
    assert NUMBERS[name] in refused(nrrd(tmp_path / "v.nhdr", "raw", f"data file: {name}"))
    told = refused(metaimage(tmp_path / "v.mhd", "", name))
    assert "cannot be used" in told or "files for 4 slices" in told


@given(first=st.integers(-9, 9), step=st.integers(-4, 4).filter(bool), count=st.integers(1, 9), spare=st.integers(0, 9))
def test_names_are_numbered_to_the_last(first: int, step: int, count: int, spare: int) -> None:
    last = first + step * (count - 1)
    names = numbered_names("100%%/s%03d.raw", [str(n) for n in (first, last, step)], count + spare)
    assert names == [f"100%/s{first + step * n:03d}.raw" for n in range(count)]
    if count > 1:
        with pytest.raises(ValueError, match=f"names {count} files for {count - 1} slices"):
            numbered_names("s%d.raw", [str(n) for n in (first, last, step)], count - 1)
