"""The volume writer: refuses early, leaves no half-written file. What it writes is read in test_readers."""

import os
import resource
import stat
from pathlib import Path

import numpy as np
import pytest
import torch

from support.files.small_disks import small_disk
from volsplat.client.phantoms.volume_writer import COMPRESSED, write_volume, written_at
from volsplat.mapshade_server.readers import open_volume
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.text.errors import BadInput

__all__ = ["small_disk"]

VALUES = torch.arange(120, dtype=torch.int16).reshape(4, 5, 6)
GEOMETRY = Geometry(dims=(6, 5, 4))
SKEWED = Geometry(dims=(6, 5, 4), index_to_physical=((1.0, 0.3, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)))


@pytest.mark.parametrize("name", ["volume.xyz", "volume", ".nrrd", "volume.gz"])
def test_an_unknown_extension_is_refused_before_any_work(name: str, tmp_path: Path) -> None:
    with pytest.raises(BadInput, match=".nrrd, .nhdr"):
        written_at(tmp_path / name)
    with pytest.raises(BadInput):
        write_volume(tmp_path / name, VALUES, GEOMETRY)
    assert not list(tmp_path.iterdir())


def test_a_missing_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="make it first"):
        written_at(tmp_path / "nowhere" / "volume.nrrd")


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write everywhere")
def test_a_folder_without_permission_is_refused(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(BadInput, match="permissions"):
        written_at(tmp_path / "volume.nrrd")


@pytest.mark.parametrize("extension", [".nii", ".nii.gz", ".tif"])
def test_shear_that_a_format_cannot_hold_is_refused(extension: str, tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="lose the volume's shear"):
        write_volume(tmp_path / f"volume{extension}", VALUES, SKEWED)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("extension", [".tif", ".tiff"])
def test_a_single_slice_that_would_be_read_as_an_image_is_refused(extension: str, tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="would be read as an image; write .nrrd or .mha"):
        write_volume(tmp_path / f"volume{extension}", VALUES[:1], Geometry(dims=(6, 5, 1)))
    assert not list(tmp_path.iterdir())


def test_a_type_that_a_format_cannot_hold_leaves_the_old_file(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "volume.tif"
    path.write_text("what was there before")
    with pytest.raises(BadInput) as refusal:
        write_volume(path, VALUES.to(torch.int64), GEOMETRY)
    assert "\n" not in str(refusal.value)
    assert path.read_text(encoding="utf-8") == "what was there before"
    assert list(tmp_path.iterdir()) == [path]
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("name", "files"), [("v.nhdr", {"v.nhdr", "v.raw"}), ("v.mhd", {"v.mhd", "v.raw"}), ("v.mha", {"v.mha"})]
)
def test_only_the_volume_s_own_files_remain(name: str, files: set[str], tmp_path: Path) -> None:
    write_volume(tmp_path / name, VALUES, GEOMETRY)
    write_volume(tmp_path / name, VALUES, GEOMETRY)
    assert {path.name for path in tmp_path.iterdir()} == files


@pytest.mark.parametrize("extension", [".nrrd", ".nhdr", ".mha", ".nii.gz"])
def test_a_name_may_be_as_long_as_the_system_allows(tmp_path: Path, extension: str) -> None:
    path = tmp_path / f"{'n' * (255 - len(extension))}{extension}"
    write_volume(path, VALUES, GEOMETRY)
    assert path.is_file()


@pytest.mark.parametrize("name", ["v.nrrd", "v.nii"])
def test_whom_an_old_volume_was_hidden_from_does_not_see_the_new_one(tmp_path: Path, name: str) -> None:
    (tmp_path / name).touch()
    (tmp_path / name).chmod(0o600)
    write_volume(tmp_path / name, VALUES, GEOMETRY)
    assert stat.S_IMODE((tmp_path / name).stat().st_mode) == 0o600


@pytest.mark.parametrize("name", ["v.nrrd", "v.mha", "v.nii.gz"])
def test_a_link_stays_one_and_the_volume_lies_where_it_leads(name: str, tmp_path: Path) -> None:
    stored, plain = tmp_path / "stored", tmp_path / "plain"
    stored.mkdir()
    plain.mkdir()
    (tmp_path / name).symlink_to(stored / name)
    write_volume(tmp_path / name, VALUES, GEOMETRY)
    write_volume(plain / name, VALUES, GEOMETRY)
    assert (tmp_path / name).is_symlink()
    assert {path.name: path.read_bytes() for path in stored.iterdir()} == {
        path.name: path.read_bytes() for path in plain.iterdir()
    }


@pytest.mark.parametrize("name", sorted(COMPRESSED))
@pytest.mark.parametrize("there", [False, True], ids=["dangling", "leading to a file"])
def test_what_is_written_to_a_link_is_read_by_its_name(name: str, there: bool, tmp_path: Path) -> None:
    link, stored = tmp_path / f"v{name}", tmp_path / "stored" / f"v{name}"
    stored.parent.mkdir()
    if there:
        write_volume(stored, VALUES[:2], Geometry(dims=(6, 5, 2)))
    link.symlink_to(stored)
    write_volume(link, VALUES, GEOMETRY)
    assert np.array_equal(open_volume(str(link)).read(GEOMETRY.box), VALUES.numpy())


@pytest.mark.parametrize("other", ["v.mha", "blob"])
def test_a_link_to_a_file_of_another_format_is_refused(other: str, tmp_path: Path) -> None:
    (tmp_path / "v.nrrd").symlink_to(tmp_path / other)
    with pytest.raises(BadInput, match=f"v.nrrd: leads to .*{other}, which is not named .nrrd"):
        write_volume(tmp_path / "v.nrrd", VALUES, GEOMETRY)


def test_a_pipe_is_refused_and_stays_one(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "v.nrrd")
    with pytest.raises(BadInput, match="v.nrrd: no volume is written into a pipe or a device; name a file"):
        write_volume(tmp_path / "v.nrrd", VALUES, GEOMETRY)
    assert (tmp_path / "v.nrrd").is_fifo()


@pytest.mark.parametrize("name", ["v.nrrd", "v.nhdr", "v.mha", "v.nii", "v.nii.gz", "v.tif"])
def test_a_full_disk_is_told_and_leaves_nothing(name: str, tmp_path: Path) -> None:
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    values, geometry = torch.randint(0, 255, (40, 40, 40), dtype=torch.uint8), Geometry(dims=(40, 40, 40))
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, before[1]))
    try:
        with pytest.raises(BadInput, match=f"{name}: "):
            write_volume(tmp_path / name, values, geometry)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["head.nii", "head.nhdr", "head.nii.gz", "head.mha", "head.tif", "head.nrrd"])
def test_no_space_left_is_said_in_the_system_s_words(small_disk: Path, name: str) -> None:
    values = torch.randint(0, 255, (40, 50, 60), dtype=torch.uint8)
    with pytest.raises(BadInput, match=f"{name}: .*No space left on device"):
        write_volume(small_disk / name, values, Geometry(dims=(60, 50, 40)))
    assert list(small_disk.iterdir()) == []
