"""Ways into DICOM: folders further down, the directory of a disc, and one slice, which stands for its series."""

import gc
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydicom.data import get_testdata_file
from pydicom.fileset import FileSet

from support.files.dicom_files import numbered, series, slice_file
from support.files.opened import described, read_whole, refused

pytestmark = pytest.mark.filterwarnings("ignore:Implicitly cleaning up:ResourceWarning")
VALUES = numbered(5)


def disc(folder: Path) -> Path:
    """A disc as pydicom lays it out: PT000000/ST000000/SE000000/IM000000 and so on beside a DICOMDIR."""
    loose = folder.with_name("loose")
    tags: dict[str, Any] = {
        "PatientID": "7",
        "PatientName": "A^B",
        "StudyDate": "20200101",
        "StudyTime": "101010",
        "StudyID": "1",
    }
    series(loose, VALUES, SeriesInstanceUID="1.2.40", SeriesNumber=4, InstanceNumber=1, **tags)
    series(loose, VALUES[:3] + 500, SeriesInstanceUID="1.2.50", SeriesNumber=5, InstanceNumber=1, **tags)
    files = FileSet()
    for path in loose.iterdir():
        files.add(path)
    files.write(folder)
    del files
    gc.collect()  # its own temporary folder is cleaned up with it, and pydicom leaves that to chance
    shutil.rmtree(loose)
    return folder


def test_a_disc_is_opened_by_its_folder_or_by_its_directory(tmp_path: Path) -> None:
    folder = disc(tmp_path / "disc")
    for way_in in (folder, folder / "DICOMDIR"):
        assert "holds 2 series" in refused(way_in)
        np.testing.assert_array_equal(read_whole(f"{way_in}#4"), VALUES)
        np.testing.assert_array_equal(read_whole(f"{way_in}#5"), VALUES[:3] + 500)


@pytest.mark.parametrize("depth", [1, 2, 3, 4])
def test_images_are_found_further_down_without_a_directory(depth: int, tmp_path: Path) -> None:
    inner = tmp_path.joinpath("disc", *[f"F{n}" for n in range(depth)])
    series(inner, VALUES)
    (tmp_path / "disc" / "README.TXT").write_text("a viewer for Windows")
    np.testing.assert_array_equal(read_whole(tmp_path / "disc"), VALUES)


def test_images_too_far_down_are_not_searched_for(tmp_path: Path) -> None:
    series(tmp_path.joinpath("disc", *"abcde"), VALUES)
    assert "none within 4 folders further down" in refused(tmp_path / "disc")


def test_a_directory_in_other_letters_finds_its_files(tmp_path: Path) -> None:
    """As discs are mounted: names in lower case, the directory still in upper case."""
    folder = disc(tmp_path / "disc")
    for path in sorted(folder.rglob("*"), key=lambda path: -len(path.parts)):
        if path.name != "DICOMDIR":
            path.rename(path.with_name(path.name.lower()))
    np.testing.assert_array_equal(read_whole(f"{folder}#4"), VALUES)


def test_a_directory_leads_to_its_own_files_only(tmp_path: Path) -> None:
    folder = disc(tmp_path / "disc")
    series(folder / "other", VALUES, SeriesInstanceUID="1.2.60", SeriesNumber=6)
    assert "holds 2 series" in refused(folder)
    for path in folder.glob("PT*"):
        shutil.rmtree(path)
    np.testing.assert_array_equal(read_whole(folder), VALUES)  # what it lists is not there


def test_a_real_directory_lists_its_studies() -> None:
    path = Path(str(get_testdata_file("DICOMDIR")))
    text = refused(path)
    assert "SmartScore" in text and "700 “ANGIO Projected from   C”, 7 slices" in text
    assert described(f"{path}#SmartScore - Gated 0.5 sec").geometry.dims == (16, 16, 5)


def test_one_slice_opens_its_series_and_says_so(tmp_path: Path) -> None:
    series(tmp_path / "scans", VALUES, SeriesInstanceUID="1.2.40", SeriesNumber=4)
    series(tmp_path / "scans", VALUES[:3] + 500, SeriesInstanceUID="1.2.50", SeriesNumber=5)
    one = next((tmp_path / "scans").glob("1.2.40_*"))
    np.testing.assert_array_equal(read_whole(one), VALUES)
    assert described(one).warnings == (
        f"{one.name} is one slice of the series that is drawn; {one.name}#slice draws it alone",
    )
    assert f"{one}#slice draws it alone" in refused(f"{one}#5")


def test_one_slice_opens_the_volume_of_its_series_that_it_is_in(tmp_path: Path) -> None:
    for echo in (1, 2):
        for n, plane in enumerate(VALUES):
            slice_file(tmp_path / f"e{echo}_{n}", plane + 100 * echo, (0, 0, 3 * n), EchoNumbers=echo)
    np.testing.assert_array_equal(read_whole(tmp_path / "e2_3"), VALUES + 200)
    np.testing.assert_array_equal(read_whole(f"{tmp_path / 'e2_3'}#echo=1"), VALUES + 100)


def test_one_slice_can_be_drawn_alone(tmp_path: Path) -> None:
    series(tmp_path / "scans", VALUES, SliceThickness=2.5)
    one = next((tmp_path / "scans").glob("*_2"))
    told = described(f"{one}#slice")
    assert told.geometry.dims == (7, 6, 1) and told.geometry.spacing == (0.5, 0.75, 2.5)
    assert told.geometry.origin == (-10, 20, 6) and told.anatomical and told.warnings == ()
    np.testing.assert_array_equal(read_whole(f"{one}#slice"), VALUES[2:3])


def test_a_slice_without_others_says_how_to_draw_it(tmp_path: Path) -> None:
    one = slice_file(tmp_path / "a.dcm", VALUES[0], (0, 0, 0))
    assert f"no other of its series lies beside it; give the folder of the whole series, or {one}#slice" in refused(one)
    np.testing.assert_array_equal(read_whole(f"{one}#slice"), VALUES[:1])
