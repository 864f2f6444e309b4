"""What is no volume is named by the mark that it bears, in one short line, and what is no file never hangs."""

import gzip
import io
import os
import socket
import subprocess
import tarfile
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import SimpleITK as sitk

from support.files.volume_files import values_of, written
from support.patience import PATIENCE
from support.programs.programs import VOLSPLAT
from volsplat.mapshade_server.readers import open_volume
from volsplat.mapshade_server.readers.reading.file_marks import MARKS_OF_FOLDERS, FolderMark
from volsplat.protocol.text.errors import BadInput

LONGEST = 200  # characters behind the path
FLAT = sitk.GetImageFromArray(np.zeros((8, 8), np.uint8))


def picture(path: Path) -> Path:
    sitk.WriteImage(FLAT, str(path))
    return path


def holding(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    return path


def archive(path: Path) -> Path:
    kept = holding(path.with_name("kept.txt"), b"kept")
    if path.suffix == ".pages":
        with zipfile.ZipFile(path, "w") as packed:
            packed.write(kept)
    else:
        with tarfile.open(path, "w:gz" if path.suffix == ".tgz" else "w") as packed_tar:
            packed_tar.add(kept, "kept.txt")
    return path


def zipped_volume(folder: Path, name: str) -> Path:
    return holding(folder / f"{name}.gz", gzip.compress(written(folder / name, values_of("int16")).read_bytes()))


def pickled(path: Path) -> Path:
    kept = io.BytesIO()
    np.save(kept, np.array([{}], object), allow_pickle=True)
    return holding(path, kept.getvalue()[kept.getvalue().index(b"\n") + 1 :])


MARKED: dict[str, tuple[Callable[[Path], Path], str]] = {
    "PNG": (lambda d: picture(d / "one.png"), "is one PNG picture, which is not read; give the folder"),
    "JPEG": (lambda d: picture(d / "one.jpg"), "is one JPEG picture"),
    "BMP": (lambda d: picture(d / "one.bmp"), "is one BMP picture"),
    "ZIP": (lambda d: archive(d / "all.pages"), "is a ZIP archive, which is not read; unpack it"),
    "tar": (lambda d: archive(d / "all.tar"), "is a tar archive"),
    "gzip of tar": (lambda d: archive(d / "all.tgz"), "is a gzip of a tar archive"),
    "gzip of NRRD": (
        lambda d: zipped_volume(d, "v.nrrd"),
        "is a gzip of NRRD (.nrrd, .nhdr), which is not read packed",
    ),
    "gzip of TIFF": (lambda d: zipped_volume(d, "v.tif"), "is a gzip of TIFF stack"),
    "gzip of text": (
        lambda d: holding(d / "a.gz", gzip.compress(b"just text")),
        "is a gzip of no format that is known",
    ),
    "pickle": (lambda d: pickled(d / "a.pkl"), "a Python pickle"),
    "web page": (lambda d: holding(d / "a.nii", b"<!doctype HTML><p>404"), "is a web page, likely of a download"),
    "LFS": (lambda d: holding(d / "a.mha", b"version https://git-lfs.github.com/spec/v1\n"), "git lfs pull"),
    "damaged gzip": (lambda d: holding(d / "a.gz", b"\x1f\x8b\x08 no"), "gzip data is damaged or truncated; fetch"),
    "gzip of gzip": (lambda d: holding(d / "a.gz", gzip.compress(gzip.compress(b"text"))), "is packed by gzip twice"),
    "bytes": (lambda d: holding(d / "a.dat", b"\1\2\3\xff" * 9), "it begins with 01 02 03 ff 01 02 03 ff; raw voxels"),
}


@pytest.mark.parametrize("case", MARKED)
def test_what_is_not_read_is_named_in_one_short_line(case: str, tmp_path: Path) -> None:
    make, cause = MARKED[case]
    path = make(tmp_path)
    with pytest.raises(BadInput) as refusal:
        open_volume(str(path))
    text = str(refusal.value)
    assert cause in text and text.startswith(f"{path}: ")
    assert "\n" not in text and len(text) - len(str(path)) < LONGEST


def read_folder(folder: Path, file: str, content: str) -> str:
    (folder / file).write_text(content, encoding="utf-8")
    with pytest.raises(BadInput) as refusal:
        open_volume(str(folder))
    return str(refusal.value)


@pytest.mark.parametrize("mark", MARKS_OF_FOLDERS)
def test_folders_that_are_not_read_are_named_by_a_file_of_theirs(mark: FolderMark, tmp_path: Path) -> None:
    assert f": is {mark.what}, which is not read" in read_folder(tmp_path, mark.file, f"{{{mark.mark.decode()}: 1}}")
    assert "a folder without DICOM images" in read_folder(tmp_path, mark.file, "what a person wrote")


def test_raw_voxels_may_begin_like_anything(tmp_path: Path) -> None:
    path = holding(tmp_path / "a.dat", b"BM" + bytes(22))
    assert open_volume(f"{path}#dims=2x3x4,type=uint8").description.geometry.dims == (2, 3, 4)


@pytest.mark.parametrize("command", ["info", "prepare"])
def test_a_fifo_is_refused_at_once(command: str, tmp_path: Path) -> None:
    fifo = tmp_path / "volume.nrrd"
    os.mkfifo(fifo)
    words = [command, str(fifo), *([str(tmp_path / "store.zarr")] if command == "prepare" else [])]
    ended = subprocess.run([VOLSPLAT, *words], capture_output=True, text=True, timeout=PATIENCE)
    assert ended.returncode == 2
    assert (
        ended.stderr
        == f"volsplat: {fifo}: is a FIFO, which cannot be read in parts; copy it into a file and give that\n"
    )


def test_sockets_and_devices_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # a socket's path must be short
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind("v.nrrd")
        with pytest.raises(BadInput, match="is a socket"):
            open_volume(str(tmp_path / "v.nrrd"))
    (tmp_path / "v.nii").symlink_to("/dev/zero")
    with pytest.raises(BadInput, match="is a device"):
        open_volume(str(tmp_path / "v.nii"))


def test_a_fifo_beside_a_header_is_no_data(tmp_path: Path) -> None:
    path = written(tmp_path / "v.nhdr", values_of("int16"))
    (tmp_path / "v.raw").unlink()
    os.mkfifo(tmp_path / "v.raw")
    with pytest.raises(BadInput, match=r"its data file v\.raw is missing"):
        open_volume(str(path))
