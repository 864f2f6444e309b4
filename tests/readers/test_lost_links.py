"""Links that lead nowhere, as git-annex and DataLad leave what was not fetched: told, never left out in silence."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pydicom
import pytest
import tifffile
import zarr
from PIL import Image

from support.files.dicom_files import series
from support.files.opened import read_whole, refused
from support.files.volume_files import values_of, written

TARGET = "../.git/annex/objects/x1/MD5E-s1--0"
VALUES = values_of("uint8")


def tiffs(folder: Path) -> Path:
    for n, plane in enumerate(VALUES):
        tifffile.imwrite(folder / f"s{n}.tif", plane)
    return folder / "s4.tif"


def pictures(folder: Path) -> Path:
    for n, plane in enumerate(VALUES):
        Image.fromarray(plane).save(folder / f"s{n}.png")
    return folder / "s4.png"


def dicom(folder: Path) -> Path:
    return sorted(series(folder, VALUES.astype(np.int16)).iterdir())[-1]


def dicom_further_down(folder: Path) -> Path:
    return dicom(folder / "patient" / "study")


FOLDERS = (tiffs, pictures, dicom, dicom_further_down)


def lost(path: Path) -> Path:
    path.unlink()
    path.symlink_to(TARGET)
    return path


@pytest.mark.parametrize("make", FOLDERS)
@pytest.mark.parametrize("every", [False, True], ids=["one", "all"])
def test_a_folder_with_lost_slices_is_refused_by_the_links_name(
    every: bool, make: Callable[[Path], Path], tmp_path: Path
) -> None:
    last = make(tmp_path)
    for path in sorted(last.parent.iterdir()) if every else [last]:
        lost(path)
    told = refused(tmp_path)
    assert f"is a link to {TARGET}, which is not there; fetch it" in told
    assert told.startswith(f"{last.parent}/") and (every or told.startswith(f"{last}: "))


def test_a_lost_file_that_is_named_is_told_as_one(tmp_path: Path) -> None:
    path = lost(written(tmp_path / "v.nii", VALUES))
    assert refused(path).startswith(f"{path}: is a link to {TARGET}, which is not there; fetch it (git annex get v.nii")
    assert "there is no such file" in refused(tmp_path / "w.nii")


def test_a_slice_of_a_series_tells_of_lost_ones_beside_it(tmp_path: Path) -> None:
    path = lost(dicom(tmp_path))
    assert refused(min(tmp_path.iterdir())).startswith(f"{path}: is a link to")


@pytest.mark.parametrize("name", ["zarr.json", "c/1/0/0"])
def test_a_lost_file_of_zarr_is_no_fill_value(name: str, tmp_path: Path) -> None:
    zarr.create_array(tmp_path / "v.zarr", data=VALUES, chunks=(2, 6, 7), zarr_format=3)
    path = lost(tmp_path / "v.zarr" / name)
    assert refused(tmp_path / "v.zarr").startswith(f"{path}: is a link to")


@pytest.mark.parametrize("make", FOLDERS)
def test_other_lost_links_are_no_slices(make: Callable[[Path], Path], tmp_path: Path) -> None:
    folder = make(tmp_path).parent
    expected = read_whole(tmp_path)
    (folder / ".hidden").symlink_to(TARGET)
    if not pydicom.misc.is_dicom(min(path for path in folder.iterdir() if path.is_file())):
        (folder / "notes.txt").symlink_to(TARGET)
    np.testing.assert_array_equal(read_whole(tmp_path), expected)


def test_a_lost_link_above_folders_of_images_is_none_of_them(tmp_path: Path) -> None:
    dicom_further_down(tmp_path)
    expected = read_whole(tmp_path)
    (tmp_path / "latest").symlink_to(TARGET)
    np.testing.assert_array_equal(read_whole(tmp_path), expected)
