"""What the volume readers refuse, each in one line that names the cause and the cure, and nothing else printed."""

import errno
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import SimpleITK as sitk

from support.files.opened import refused
from support.files.volume_files import dicom_series, values_of, written

VALUES = values_of("int16", (40, 30, 20))


def cut(path: Path, share: float) -> Path:
    raw = path.read_bytes()
    path.write_bytes(raw[: int(len(raw) * share)])
    return path


def plain(folder: Path, name: str) -> Path:
    return written(folder / name, VALUES)


def noisy(folder: Path, name: str) -> Path:
    """Values that do not compress, so that half a file is not the whole volume."""
    noise = np.random.default_rng(0).integers(0, 30000, VALUES.shape).astype(np.int16)
    return written(folder / name, noise)


def replaced(path: Path, old: bytes, new: bytes) -> Path:
    raw = path.read_bytes()
    assert old in raw
    path.write_bytes(raw.replace(old, new, 1))
    return path


def image(folder: Path, name: str, array: np.ndarray[tuple[int, ...], np.dtype[np.generic]], vector: bool) -> Path:
    sitk.WriteImage(sitk.GetImageFromArray(array, isVector=vector), str(folder / name))
    return folder / name


def without_data(path: Path, data: str) -> Path:
    (path.parent / data).unlink()
    return path


def missing_slice(folder: Path) -> Path:
    return dicom_series(folder / "series", VALUES[:6], heights=[0, 3, 6, 12, 15, 18])


def doubled(folder: Path) -> Path:
    return dicom_series(folder / "series", VALUES[:6], heights=[0, 3, 6, 6, 9, 12])


def truncated_slice(folder: Path) -> Path:
    series = dicom_series(folder / "series", VALUES[:6])
    cut(sorted(series.iterdir())[-1], 0.6)
    return series


def two_sizes(folder: Path) -> Path:
    series = dicom_series(folder / "series", VALUES[:3])
    return dicom_series(series, VALUES[:3, :20], heights=[9, 12, 15], prefix="small")


def empty_folder(folder: Path) -> Path:
    (folder / "nothing").mkdir()
    return folder / "nothing"


def text_file(folder: Path) -> Path:
    (folder / "notes.txt").write_text("no volume at all\n")
    return folder / "notes.txt"


def empty_file(folder: Path) -> Path:
    (folder / "empty.nrrd").touch()
    return folder / "empty.nrrd"


SQUARE = np.zeros((16, 16), np.uint8)
COLOUR = np.zeros((5, 6, 7, 3), np.uint8)
FRAMES = np.zeros((3, 5, 6, 7), np.uint8)

REFUSALS: dict[str, tuple[Callable[[Path], Path], str]] = {
    "missing file": (lambda d: d / "nowhere.nrrd", "no such file"),
    "empty file": (empty_file, "empty"),
    "unknown format": (
        text_file,
        "it begins with “no volume at all”; raw voxels",
    ),
    "empty folder": (empty_folder, "without DICOM"),
    "2-D NRRD": (lambda d: image(d, "flat.nrrd", SQUARE, False), "a 2-D image, volsplat needs a volume"),
    "2-D MetaImage": (lambda d: image(d, "flat.mha", SQUARE, False), "a 2-D image, volsplat needs a volume"),
    "2-D NIfTI": (lambda d: image(d, "flat.nii", SQUARE, False), "a 2-D image, volsplat needs a volume"),
    "2-D TIFF": (lambda d: image(d, "flat.tif", SQUARE, False), "a 2-D image, volsplat needs a volume"),
    "one DICOM slice": (lambda d: next(dicom_series(d / "s", VALUES[:1]).iterdir()), "give the folder"),
    "a series of one slice": (lambda d: dicom_series(d / "s", VALUES[:1]), "a 2-D image, volsplat needs a volume"),
    "colour NRRD": (lambda d: image(d, "rgb.nrrd", COLOUR, True), "one number a voxel"),
    "colour MetaImage": (lambda d: image(d, "rgb.mha", COLOUR, True), "one number a voxel"),
    "colour NIfTI": (lambda d: image(d, "rgb.nii", COLOUR, True), "one number a voxel"),
    "colour TIFF": (lambda d: image(d, "rgb.tif", COLOUR, True), "one number a voxel"),
    "frames in NIfTI": (lambda d: image(d, "four.nii", FRAMES, False), "choose one, as in"),
    "frames in MetaImage": (lambda d: image(d, "four.mha", FRAMES, False), "choose one, as in"),
    "frames in NRRD": (lambda d: image(d, "four.nrrd", FRAMES, False), "choose one, as in"),
    "truncated NRRD": (lambda d: cut(plain(d, "v.nrrd"), 0.7), "truncated"),
    "truncated MetaImage": (lambda d: cut(plain(d, "v.mha"), 0.7), "truncated"),
    "truncated NIfTI": (lambda d: cut(plain(d, "v.nii"), 0.7), "truncated"),
    "truncated gzip NIfTI": (lambda d: cut(noisy(d, "v.nii.gz"), 0.7), "truncated"),
    "damaged gzip NIfTI": (
        lambda d: replaced(p := noisy(d, "v.nii.gz"), p.read_bytes()[9000:9064], bytes(64)),
        "damaged",
    ),
    "truncated TIFF": (lambda d: cut(noisy(d, "v.tif"), 0.7), "truncated"),
    "truncated TIFF within its last page": (lambda d: cut(noisy(d, "v.tif"), 0.99), "truncated"),
    "truncated MetaImage header": (lambda d: cut(plain(d, "v.mhd"), 0.5), "ElementDataFile"),
    "truncated detached data": (lambda d: (plain(d, "v.nhdr"), cut(d / "v.raw", 0.5))[0], "v.raw holds only"),
    "NRRD promises more": (lambda d: replaced(plain(d, "v.nrrd"), b"40 30 20", b"40 30 99"), "promises"),
    "MetaImage promises more": (lambda d: replaced(plain(d, "v.mha"), b"40 30 20", b"40 30 99"), "promises"),
    "compressed data cannot hold so much": (
        lambda d: replaced(
            replaced(plain(d, "v.nrrd"), b"40 30 20", b"40000 30000 20000"), b"encoding: raw", b"encoding: gzip"
        ),
        "promises",
    ),
    "NRRD without data": (lambda d: without_data(plain(d, "v.nhdr"), "v.raw"), "data file v.raw is missing"),
    "MetaImage without data": (lambda d: without_data(plain(d, "v.mhd"), "v.raw"), "data file v.raw is missing"),
    "NRRD of an unknown type": (lambda d: replaced(plain(d, "v.nrrd"), b"short", b"block"), '"type: block"'),
    "NRRD of an unknown encoding": (lambda d: replaced(plain(d, "v.nrrd"), b"raw", b"zip"), '"encoding: zip"'),
    "NRRD without size": (lambda d: replaced(plain(d, "v.nrrd"), b"40 30 20", b"40 x 20"), "whole numbers"),
    "axes that span no space": (lambda d: replaced(plain(d, "v.nrrd"), b"0,0,3", b"0,0,0"), "do not span space"),
    "DICOM with a slice missing": (missing_slice, "a slice is missing"),
    "DICOM with two slices at one place": (doubled, "lie at one position"),
    "DICOM with a truncated slice": (truncated_slice, "is truncated"),
    "DICOM of two sizes": (two_sizes, "differ in size"),
}


@pytest.mark.parametrize("case", REFUSALS)
def test_bad_input_is_refused_in_one_line(case: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    make, cause = REFUSALS[case]
    path = make(tmp_path)
    text = refused(path)
    assert cause in text and str(tmp_path) in text
    assert capfd.readouterr() == ("", "")


def test_a_closed_file_of_a_folder_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    dicom_series(tmp_path / "scan", VALUES)
    closed = sorted((tmp_path / "scan").iterdir())[5]
    opens = Path.open

    def open_unless_closed(path: Path, *how: Any, **more: Any) -> Any:
        if path == closed:
            raise PermissionError(errno.EACCES, "no", str(closed))
        return opens(path, *how, **more)

    monkeypatch.setattr(Path, "open", open_unless_closed)
    assert refused(tmp_path / "scan") == (
        f"{closed}: cannot be read (Permission denied); check its permissions and its disk"
    )


NO_PRIVILEGE = ("setpriv", "--bounding-set=-dac_override,-dac_read_search", "--inh-caps=-dac_override,-dac_read_search")
OPENS = "import sys; from volsplat.mapshade_server.readers.open_volume import open_volume; open_volume(sys.argv[1])"


@pytest.mark.parametrize("mode", [0o000, 0o300, 0o444])
def test_a_closed_folder_is_named_and_no_file_that_is_not_there(tmp_path: Path, mode: int) -> None:
    as_anybody = () if os.geteuid() else NO_PRIVILEGE
    if as_anybody and (shutil.which("setpriv") is None or subprocess.run([*as_anybody, "true"]).returncode):
        pytest.skip("root sees all here: this needs setpriv, or another user")
    folder = tmp_path / "folder"
    folder.mkdir(mode=mode)
    done = subprocess.run([*as_anybody, sys.executable, "-c", OPENS, folder], capture_output=True, encoding="utf-8")
    folder.chmod(0o700)
    assert f"{folder}: cannot be read (Permission denied); check its permissions and its disk" in done.stderr
