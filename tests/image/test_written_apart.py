"""What is written beside and over the files of a volume: let through unless the volume would be another one."""

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Literal
from unittest.mock import Mock

import numpy
import pytest
import tifffile

from volsplat.client.image.written_apart import check_written_apart
from volsplat.mapshade_server.readers.open_volume import folder_formats
from volsplat.protocol.text.errors import BadInput


def numbered(kind: str, count: int) -> list[str]:
    return [f"slice-{number}{kind}" for number in range(count)]


def folder_of(place: Path, names: Sequence[str]) -> Path:
    place.mkdir()
    for name in names:
        (place / name).touch()
    return place


def refused(volume: Path | str, *written: Path, records: Sequence[Path] = ()) -> bool:
    try:
        check_written_apart(str(volume), *written, records=records)
    except BadInput as error:
        assert str(error).startswith(tuple(f"{path}: " for path in (*written, *records)))
        return True
    return False


@pytest.mark.parametrize(
    ("there", "written", "is_refused"),
    [
        ([], ["head.png"], True),  # of a study in subfolders
        ([], ["head.exr"], False),
        (numbered(".dcm", 3) + numbered(".png", 2), ["head.png"], True),
        (numbered(".dcm", 3) + numbered(".png", 1), ["head.png"], False),
        (numbered(".dcm", 5), [f"step-{step}.png" for step in "ABCDEF"], True),
        (numbered(".dcm", 5), [".head.png"], False),
        (numbered(".tif", 3) + numbered(".png", 3), ["head.png"], True),
        (numbered(".tif", 4) + numbered(".png", 3), ["head.png"], False),
        (numbered(".tif", 3) + numbered(".png", 3), ["slice-0.png"], False),
        (numbered(".bmp", 4), ["head.png"], True),
        (numbered(".png", 2) + numbered(".txt", 2), ["head.exr"], True),
        (numbered(".png", 2) + numbered(".txt", 1), ["head.exr"], False),
    ],
)
def test_no_image_changes_what_volume_a_folder_is(
    tmp_path: Path, there: list[str], written: list[str], is_refused: bool
) -> None:
    study = folder_of(tmp_path / "study", there)
    (study / "series").mkdir()
    before = format_of(study)
    assert refused(study, *(study / name for name in written)) == is_refused
    for name in written:
        (study / name).touch()
    assert is_refused or format_of(study) == before


def test_a_volume_that_a_url_names_is_as_safe(tmp_path: Path) -> None:
    study = folder_of(tmp_path / "a study", numbered(".png", 3))
    url = f"file://{tmp_path}/a%20study"
    assert refused(url, study / "head.png") and refused(f"{url}/slice-1.png", study / "slice-1.png")
    assert not refused(url, tmp_path / "head.png")


def format_of(folder: Path) -> str:
    """By which the map/shade server would open it."""
    return next(one.name for one in folder_formats() if one.recognises(folder))


def test_a_part_lets_images_through_only_where_it_says_how_names_begin(tmp_path: Path) -> None:
    pages = folder_of(tmp_path / "pages", numbered(".png", 4))
    assert refused(f"{pages}#slice-", pages / "slice-9.png") and not refused(f"{pages}#slice-", pages / "beside.png")
    study = folder_of(tmp_path / "study", [])
    assert refused(f"{study}#1.2.840", study / "head.png")


def test_a_folder_is_looked_over_once_and_its_files_are_not_asked_for_one_by_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = folder_of(tmp_path / "study", numbered(".dcm", 100))
    stat, scandir = Mock(wraps=os.stat), Mock(wraps=os.scandir)
    monkeypatch.setattr(os, "stat", stat)
    monkeypatch.setattr(os, "scandir", scandir)
    assert not refused(study, *(study / f"step-{step}.png" for step in "ABCDEF"))
    assert scandir.call_count == 1 and stat.call_count < 50


def detached(header: Path, names: str) -> Path:
    header.write_text(f"NRRD0004\ntype: uchar\ncontent: r\ndata file: {names}\n")
    return header


def metaimage(header: Path, names: str) -> Path:
    header.write_text(f"NDims = 3\nComment = r\nElementDataFile = {names}\n")
    return header


@pytest.mark.parametrize("write", [detached, metaimage])
@pytest.mark.parametrize(
    ("names", "written", "is_refused"),
    [
        ("head.png", "head.png", True),
        ("./head.png", "head.png", True),
        ("LIST\nahead.png\nhead.png", "head.png", True),
        ("ahead.png", "head.png", False),
        ("head.png.raw", "head.png", False),
        ("out/head.png", "out/head.png", True),
        ("out/head.png", "head.png", False),
        ("head.png", "out/head.png", False),
        ("a head.png", "a head.png", True),
    ],
)
def test_a_file_belongs_to_the_volume_whose_header_means_it(
    tmp_path: Path, write: Callable[[Path, str], Path], names: str, written: str, is_refused: bool
) -> None:
    (tmp_path / "out").mkdir()
    for name in ("head.png", "out/head.png", "a head.png"):
        (tmp_path / name).touch()
    assert refused(write(tmp_path / "volume", names), tmp_path / written) == is_refused


@pytest.mark.parametrize(
    "begin", [b"NRRD0004\nencoding: raw\n\n", b"NDims = 3\nElementDataFile = LOCAL\n", b"\x93NUMPY"]
)
def test_voxels_name_no_file(tmp_path: Path, begin: bytes) -> None:
    volume, image = tmp_path / "volume", tmp_path / "r.png"
    volume.write_bytes(begin + b"\nr.png\n")
    image.touch()
    assert not refused(volume, image)


def test_a_record_replaces_another_one_whatever_the_volume_holds(tmp_path: Path) -> None:
    volume, record = tmp_path / "head.nrrd", tmp_path / "r"
    volume.write_bytes(b"NRRD0004\nr\n\nr")
    ours = b"", b'{\n  "volsplat": "1"}', b"[", b'[\n{"ph":"M"}\n]\n', b"[\n]\n"
    others = b"\n" * 400, b"notes", b'{"Modality": "MR"}', b"[1, 2]"
    for text, is_refused in (*((text, False) for text in ours), *((text, True) for text in others)):
        record.write_bytes(text)
        assert refused(volume, records=[record]) == is_refused


@pytest.mark.parametrize("bigtiff", [False, True])
@pytest.mark.parametrize("order", ["<", ">"])
def test_every_file_of_a_large_set_belongs_to_it(tmp_path: Path, bigtiff: bool, order: Literal["<", ">"]) -> None:
    named = [f"plane &amp; {number:04}.ome.tif" for number in range(6000)]
    planes = [f'<TiffData><UUID FileName="{name}">urn:uuid:{"0" * 60}</UUID></TiffData>' for name in named]
    xml = f"<OME>{''.join(planes)}</OME>"
    volume = tmp_path / "set.ome.tif"
    voxels = numpy.zeros((2, 64, 64), numpy.uint8)
    tifffile.imwrite(volume, voxels, description=xml, metadata=None, bigtiff=bigtiff, byteorder=order)
    assert volume.stat().st_size > 600_000
    for number in (0, 3000, 5999):
        image = tmp_path / f"plane & {number:04}.ome.tif"
        image.touch()
        assert refused(volume, image)
    other = tmp_path / "3000.ome.tif"
    other.touch()
    assert not refused(volume, other)


@pytest.mark.parametrize("cut", [4, 10, 200])
def test_a_damaged_tiff_is_left_to_whoever_opens_it(tmp_path: Path, cut: int) -> None:
    volume, image = tmp_path / "v.tif", tmp_path / "a.tif"
    tifffile.imwrite(
        volume, numpy.zeros((8, 8), numpy.uint8), description='FileName="a.tif"', metadata=None, bigtiff=True
    )
    image.touch()
    assert refused(volume, image)
    volume.write_bytes(volume.read_bytes()[:cut])
    assert not refused(volume, image)
