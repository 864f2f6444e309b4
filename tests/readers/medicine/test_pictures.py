"""Folders of PNG, JPEG and BMP slices, written by Pillow."""

import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from support.files.opened import described, read_whole, refused
from support.files.volume_files import values_of
from volsplat.mapshade_server.readers import open_volume
from volsplat.mapshade_server.readers.reading.volume_reader import Voxels
from volsplat.protocol.description.volume import Box
from volsplat.protocol.text.errors import BadInput

VALUES = values_of("uint8", (7, 6, 12))
LOSSY = 3  # levels that JPEG may change in a smooth picture


def folder_of(folder: Path, pictures: Voxels, extension: str = ".png", begin: str = "slice") -> Path:
    """Names whose order is not that of their numbers."""
    folder.mkdir(exist_ok=True)
    for n, picture in enumerate(pictures):
        quality: dict[str, Any] = {"quality": 100} if extension.startswith(".jp") else {}
        Image.fromarray(picture).save(folder / f"{begin}{n + 1}{extension}", **quality)
    return folder


@pytest.mark.parametrize("extension", [".png", ".PNG", ".bmp"])
def test_slices_come_back_in_the_order_of_their_numbers(extension: str, tmp_path: Path) -> None:
    folder = folder_of(tmp_path / "slices", VALUES, extension)
    (folder / ".DS_Store").write_bytes(b"hidden")
    told = described(folder)
    assert told.geometry.dims == (7, 6, 12) and told.scalar_type == "uint8"
    assert told.format == f"folder of 12 {extension[1:].upper()} pictures"
    np.testing.assert_array_equal(read_whole(folder), VALUES)
    part = open_volume(str(folder)).read(Box((1, 2, 3), (5, 4, 11)))
    assert part.flags.c_contiguous
    np.testing.assert_array_equal(part, VALUES[3:11, 2:4, 1:5])


def test_sixteen_bits_are_kept(tmp_path: Path) -> None:
    values = values_of("uint16", (7, 6, 3)) * 100
    np.testing.assert_array_equal(read_whole(folder_of(tmp_path / "s", values)), values)


def test_jpegs_come_back_but_for_what_they_lose(tmp_path: Path) -> None:
    smooth = (np.arange(16)[:, None] * 4 + np.arange(24) * 3 + np.arange(3)[:, None, None] * 20).astype(np.uint8)
    got = read_whole(folder_of(tmp_path / "s", smooth, ".jpeg"))
    assert np.abs(got.astype(int) - smooth).max() <= LOSSY


def test_sizes_are_told_to_be_unknown_until_they_are_said(tmp_path: Path) -> None:
    folder = folder_of(tmp_path / "s", VALUES)
    (warning,) = described(folder).warnings
    assert "pictures state no size of their voxels" in warning
    told = described(f"{folder}#spacing=0.5x0.5x2,unit=mm")
    assert told.geometry.spacing == (0.5, 0.5, 2) and told.unit == "mm" and told.warnings == ()
    assert "“gap=2” is not an option here" in refused(f"{folder}#gap=2")


def test_names_that_begin_differently_are_chosen_between(tmp_path: Path) -> None:
    folder = folder_of(tmp_path / "s", VALUES, begin="left_")
    folder_of(folder, VALUES[::-1], begin="right_")
    assert "picture files of several kinds" in refused(folder)
    np.testing.assert_array_equal(read_whole(f"{folder}#right_,spacing=1x1x2"), VALUES[::-1])


def test_grey_pictures_stored_as_colour_are_grey(tmp_path: Path) -> None:
    folder = folder_of(tmp_path / "s", np.repeat(VALUES[..., None], 3, 3))
    np.testing.assert_array_equal(read_whole(folder), VALUES)


def test_a_colour_is_asked_for_also_where_only_one_picture_has_any(tmp_path: Path) -> None:
    coloured = np.repeat(VALUES[..., None], 3, 3)
    coloured[9, 3, 3] = 200, 10, 10
    folder = folder_of(tmp_path / "s", coloured)
    text = refused(f"{folder}#spacing=1x1x2")
    assert "are in colour (R, G, B; slice10.png for one), volsplat needs one number a voxel; choose" in text
    assert text.endswith("spacing=1x1x2,channel=R")
    for n, name in enumerate("RGB"):
        np.testing.assert_array_equal(read_whole(f"{folder}#channel={name}"), coloured[..., n])
    assert "“channel=K” names no channel; there are R, G, B" in refused(f"{folder}#channel=K")


def test_colours_in_all_pictures_are_refused_before_any_is_drawn(tmp_path: Path) -> None:
    folder = folder_of(tmp_path / "s", np.stack([VALUES, VALUES[::-1], VALUES], 3))
    with pytest.raises(BadInput, match="are in colour"):
        open_volume(str(folder))


def test_transparency_does_not_darken_values(tmp_path: Path) -> None:
    pictures = np.stack([VALUES, np.full_like(VALUES, 100)], 3)
    np.testing.assert_array_equal(read_whole(folder_of(tmp_path / "s", pictures)), VALUES)


def cut(path: Path, share: float) -> None:
    raw = path.read_bytes()
    path.write_bytes(raw[: int(len(raw) * share)])


def noise(folder: Path, extension: str) -> Path:
    pictures = np.random.default_rng(0).integers(0, 255, (3, 40, 40)).astype(np.uint8)
    return folder_of(folder, pictures, extension)


def broken(folder: Path, extension: str, share: float = 0.6) -> Path:
    cut(noise(folder, extension) / f"slice2{extension}", share)
    return folder


def missing(folder: Path) -> Path:
    (folder_of(folder, VALUES) / "slice4.png").unlink()
    return folder


def another_size(folder: Path) -> Path:
    folder_of(folder, VALUES)
    Image.fromarray(np.zeros((9, 9), np.uint8)).save(folder / "slice13.png")
    return folder


def turned(folder: Path) -> Path:
    picture = Image.fromarray(VALUES[0])
    exif = Image.Exif()
    exif[274] = 6
    folder_of(folder, VALUES, ".jpg")
    picture.save(folder / "slice1.jpg", exif=exif)
    return folder


REFUSALS: dict[str, tuple[Callable[[Path], Path], str]] = {
    "truncated PNG": (lambda d: broken(d, ".png"), "slice2.png: is truncated, it ends before"),
    "truncated JPEG": (lambda d: broken(d, ".jpg"), "slice2.jpg: is truncated"),
    "truncated BMP": (lambda d: broken(d, ".bmp"), "slice2.bmp: is truncated or damaged"),
    "a header alone": (lambda d: broken(d, ".png", 0.001), "slice2.png: is truncated, it ends before"),
    "a missing slice": (missing, "slices are missing: after number 3 comes 5"),
    "another size": (another_size, "slice13.png differs from slice1.png in size"),
    "one picture": (lambda d: folder_of(d, VALUES[:1]), "a 2-D image"),
    "turned": (turned, "slice1.jpg: is stored turned"),
}


@pytest.mark.parametrize("case", REFUSALS)
def test_bad_input_is_refused_in_one_line(case: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    make, cause = REFUSALS[case]
    assert cause in refused(make(tmp_path / "slices"))
    assert capfd.readouterr() == ("", "")


def test_a_picture_that_promises_more_than_it_can_hold_is_refused(tmp_path: Path) -> None:
    folder = folder_of(tmp_path / "s", VALUES[:2])
    for path in folder.iterdir():
        raw = path.read_bytes()
        head = raw[12:16] + (30000).to_bytes(4, "big") * 2 + raw[24:29]
        path.write_bytes(raw[:12] + head + zlib.crc32(head).to_bytes(4, "big") + raw[33:])
    assert "promises 900000000 bytes of pixels" in refused(folder)


def test_a_slice_that_is_replaced_while_it_is_open_is_told(tmp_path: Path) -> None:
    folder = folder_of(tmp_path / "s", VALUES)
    reader = open_volume(str(folder))
    Image.fromarray(np.zeros((9, 9), np.uint8)).save(folder / "slice3.png")
    with pytest.raises(BadInput, match="slice3.png: has changed while it was open"):
        reader.read(reader.description.geometry.box)
