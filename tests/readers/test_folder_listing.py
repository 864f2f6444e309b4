"""What a server tells of folders: volumes by their content, series by their names, and nothing outside of the root."""

import gzip
import os
from pathlib import Path
from typing import Any

import h5py
import nibabel
import numpy as np
import pytest
import zarr
from astropy.io import fits

from support.files.counted_bytes import bytes_read
from support.files.dicom_files import numbered, series, without_preambles
from support.files.reflection_files import mtz
from volsplat.client.phantoms import make_phantom
from volsplat.client.phantoms.volume_writer import write_volume
from volsplat.mapshade_server.readers import open_volume
from volsplat.mapshade_server.readers.folder_listing import listed
from volsplat.protocol.messages.folder_messages import MOST_ENTRIES, FolderEntry, FolderListed, ListFolder
from volsplat.protocol.text.errors import BadInput


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """Beside it lies another folder, with a secret."""
    inside, outside = tmp_path / "root", tmp_path / "root of others"
    inside.mkdir()
    outside.mkdir()
    np.save(outside / "secret.npy", np.zeros((4, 4, 4), np.uint8))
    return inside


def look(root: Path, folder: str = "", words: str = "") -> FolderListed:
    return listed(ListFolder(1, str(root), folder, words))


def volume(name: str, kind: str, size: int) -> FolderEntry:
    return FolderEntry(name, "", kind, size, is_folder=kind != "raw voxels", is_volume=True)


def test_volumes_are_told_by_their_content_with_kind_and_size_and_nothing_else_is(root: Path) -> None:
    write_volume(root / "Head.nrrd", *make_phantom("head", (8, 8, 8)))
    (root / "b.nii.gz").write_bytes(gzip.compress(b"no volume"))
    (root / "notes.txt").write_text("no volume", encoding="ascii")
    (root / "pair.raw").write_bytes(bytes(64))  # nobody says what is in it
    (root / "plain_4x4x4_uint8.raw").write_bytes(bytes(64))
    (root / ".hidden.npy").write_bytes(b"\x93NUMPY")
    np.save(root / "array.bin", np.zeros((4, 4, 4), np.uint8))
    (root / "array.bin.npy").rename(root / "an array")
    (root / "brain.zarr").mkdir()
    (root / "zebra").mkdir()
    os.mkfifo(root / "waits for ever.npy")
    told = look(root)
    assert told.left_out == 0 and told.entries == [
        FolderEntry("brain.zarr", "", "Zarr", 0, is_folder=True, is_volume=True),
        FolderEntry("zebra", "", "folder", 0, is_folder=True, is_volume=False),
        volume("an array", "NumPy array", (root / "an array").stat().st_size),
        volume("Head.nrrd", "NRRD", (root / "Head.nrrd").stat().st_size),
        volume("plain_4x4x4_uint8.raw", "raw voxels", 64),
    ]
    assert [entry.name for entry in look(root, words="HEAD").entries] == ["Head.nrrd"]


def test_each_series_of_a_folder_is_told_by_its_description_and_opens_by_its_name(root: Path) -> None:
    folder = root / "study"
    for number, (described, count) in enumerate((("T1 AX", 5), ("T2, fat=sat", 4), ("scout", 1)), start=3):
        tags: dict[str, Any] = {"SeriesNumber": str(number), "SeriesDescription": described}
        tags["SeriesInstanceUID"] = f"1.2.{number}"
        for slice_ in series(root / f"of {number}", numbered(count), **tags).iterdir():
            folder.mkdir(exist_ok=True)
            slice_.rename(folder / f"{number}-{slice_.name}")
    (folder / "damaged.dcm").write_bytes(next(folder.iterdir()).read_bytes()[:300])
    told = look(root, "study").entries
    assert [(one.name, one.part, one.is_volume) for one in told] == [("", "3", True), ("", "4", True)]
    assert "“T1 AX”, 5 slices of " in told[0].kind and "“T2, fat=sat”, 4 slices of " in told[1].kind
    (folder / "damaged.dcm").unlink()
    for one, count in zip(told, (5, 4), strict=True):
        assert open_volume(f"{folder}#{one.part}").description.geometry.dims[2] == count
    assert [one.part for one in look(root, "study", "t2").entries] == ["4"]


def test_the_only_series_of_a_folder_goes_by_the_folders_name(root: Path) -> None:
    series(root / "scan", numbered(5), SeriesDescription="HEAD")
    (only,) = look(root, "scan").entries
    assert (only.name, only.part) == ("", "") and "“HEAD”" in only.kind


def test_a_series_whose_files_have_no_preamble_is_told_as_any(root: Path) -> None:
    told = look(root, series(root / "scan", numbered(5), SeriesDescription="HEAD").name).entries
    without_preambles(root / "scan")
    assert look(root, "scan").entries == told != []


def test_nothing_outside_of_the_root_is_told_of_whatever_leads_there(root: Path) -> None:
    outside = root.parent / "root of others"
    (root / "link.npy").symlink_to(outside / "secret.npy")
    (root / "folder").symlink_to(outside)
    (root / "ring").symlink_to(root / "ring")
    (root / "self").symlink_to(root)
    slices = series(outside / "scan", numbered(5), SeriesDescription="SECRET")
    (root / "study").mkdir()
    for slice_ in slices.iterdir():
        (root / "study" / slice_.name).symlink_to(slice_)
    assert [entry.name for entry in look(root).entries] == ["self", "study"]
    assert look(root, "study").entries == []
    refusals = set[str]()
    beyond = (
        "..",
        f"../{outside.name}",
        str(outside),
        "/",
        "folder",
        "ring",
        "study/../..",
        "no\0name",
        "~",
        "nothing",
    )
    for folder in beyond:
        with pytest.raises(BadInput, match="is no folder below the one that volumes are opened from") as refused:
            look(root, folder)
        refusals.add(str(refused.value).removeprefix(folder))
    assert len(refusals) == 1, "one answer, whether something is there or not"
    assert [entry.name for entry in look(root, "self/self").entries] == ["self", "study"]


def test_of_a_large_folder_the_first_are_told_and_a_part_of_a_name_finds_the_rest(root: Path) -> None:
    for number in range(MOST_ENTRIES + 7):
        np.save(root / f"{number:04}.npy", np.zeros((2, 2, 2), np.uint8))
    told = look(root)
    assert len(told.entries) == MOST_ENTRIES and told.left_out == 7
    last = f"{MOST_ENTRIES + 6:04}"
    found = look(root, words=last)
    assert [entry.name for entry in found.entries] == [f"{last}.npy"] and found.left_out == 0


def test_numbers_in_names_are_told_in_the_order_of_numbers(root: Path) -> None:
    in_order = [
        "2x.npy",
        "Step_1.npy",
        "step_2.npy",
        "step_2_1.npy",
        "step_09.npy",
        "step_9.npy",
        "step_10.npy",
        "t.npy",
    ]
    for name in in_order:
        np.save(root / name, np.zeros((2, 2, 2), np.uint8))
    assert [entry.name for entry in look(root).entries] == in_order


def test_files_that_stay_as_they_are_are_looked_into_once(root: Path) -> None:
    """With each letter that somebody types the folder is asked for again."""
    for n in range(50):
        (root / f"{n}.nrrd").write_bytes(b"NRRD0004\n" + bytes(2000))
    series(root, numbered(8))
    told = look(root)
    before = bytes_read()
    assert look(root) == told
    assert [entry.name for entry in look(root, words="49").entries] == ["49.nrrd"]
    assert bytes_read() - before < 50 * 2000


def test_a_file_that_is_changed_or_replaced_is_looked_into_anew(root: Path) -> None:
    path, other = root / "volume", root / ".other"
    np.save(root / "array.npy", np.zeros((4, 4, 4), np.uint8))
    array = (root / "array.npy").read_bytes()
    path.write_bytes(array)
    assert [entry.kind for entry in look(root, words="volume").entries] == ["NumPy array"]
    path.write_bytes(b"NRRD0004\n".ljust(len(array) - 1))
    assert [entry.kind for entry in look(root, words="volume").entries] == ["NRRD"]
    other.write_bytes(array[:-1])
    os.utime(other, ns=(path.stat().st_atime_ns, path.stat().st_mtime_ns))
    other.replace(path)
    assert [entry.kind for entry in look(root, words="volume").entries] == ["NumPy array"]


def test_what_is_named_exactly_is_told_first_however_many_have_its_name_in_theirs(root: Path) -> None:
    np.save(root / "z.npy", np.zeros((2, 2, 2), np.uint8))
    for number in range(MOST_ENTRIES + 1):
        (root / f"{number}z.npy").symlink_to("z.npy")
        (root / f"{number}z.npy.d").mkdir()
    told = look(root, words="z.npy")
    assert told.entries[0].name == "z.npy" and len(told.entries) == MOST_ENTRIES


def test_a_folder_that_may_not_be_read_is_refused_in_one_line(root: Path) -> None:
    (root / "shut").mkdir(mode=0)
    if os.access(root / "shut", os.R_OK):
        pytest.skip("this user may read everything")
    with pytest.raises(BadInput, match=r"shut: cannot be listed \(Permission denied\); check its permissions"):
        look(root, "shut")


# -- parts


def parts(root: Path, name: str) -> list[tuple[str, str]]:
    return [(one.part, one.kind) for one in look(root, name).entries]


def test_of_a_file_with_several_volumes_each_is_told_as_it_is_named(root: Path) -> None:
    numbers = np.zeros((4, 5, 6), np.uint8)
    np.savez(root / "two.npz", first=numbers, second=numbers[:3])
    np.savez(root / "one.npz", only=numbers)
    np.save(root / "series.npy", np.zeros((2, 4, 5, 6), np.uint8))
    with h5py.File(root / "run.h5", "w") as file:
        file["/scan/raw"], file["/result/map"] = numbers, numbers
        file["/result/moments"] = np.zeros((3, 4, 5, 6), np.float32)
    listed_as = {entry.name: entry for entry in look(root).entries}
    assert listed_as["two.npz"].is_folder and listed_as["two.npz"].is_volume
    assert parts(root, "two.npz") == [("first", "4 x 5 x 6"), ("second", "3 x 5 x 6")]
    assert parts(root, "one.npz") == []
    assert parts(root, "series.npy") == [(f"axis0={n}", f"index along axis0 {n} of 0 to 1") for n in (0, 1)]
    assert [part for part, _ in parts(root, "run.h5")] == ["/result/map", "/result/moments", "/scan/raw"]
    assert [part for part, _ in parts(root, "run.h5#/result/moments")][:2] == [
        "/result/moments,axis0=0",
        "/result/moments,axis0=1",
    ]
    assert parts(root, "run.h5#/scan/raw") == []
    assert [part for part, _ in parts(root, "two.npz#first")] == []


def test_steps_within_a_file_are_told_in_the_order_of_their_numbers(root: Path) -> None:
    steps = [f"step_{number}" for number in (1, 2, 10)]
    group = zarr.open_group(root / "run.zarr", mode="w", zarr_format=2)
    with h5py.File(root / "run.h5", "w") as file:
        for step in steps:
            file[f"{step}/density"] = np.zeros((4, 5, 6), np.uint8)
            group.create_array(f"{step}/density", shape=(4, 5, 6), dtype=np.uint8)
    assert [part for part, _ in parts(root, "run.h5")] == [f"/{step}/density" for step in steps]
    assert [part for part, _ in parts(root, "run.zarr")] == [f"{step}/density" for step in steps]


def test_time_points_levels_and_cubes_are_parts(root: Path) -> None:
    whole = np.zeros((6, 5, 4, 3), np.float32)
    nibabel.save(nibabel.Nifti1Image(whole, np.eye(4)), root / "bold.nii")
    assert parts(root, "bold.nii")[:2] == [("0", "volume 0 of 0 to 2"), ("1", "volume 1 of 0 to 2")]
    cube, errors = fits.ImageHDU(whole[..., 0], name="DATA"), fits.ImageHDU(whole[..., 0], name="STAT")
    fits.HDUList([fits.PrimaryHDU(), cube, errors]).writeto(root / "muse.fits")
    assert parts(root, "muse.fits") == [("1", "DATA, 4 x 5 x 6"), ("2", "STAT, 4 x 5 x 6")]
    group = zarr.open_group(str(root / "brain.zarr"), mode="w", zarr_format=2)
    for level in (0, 1):
        group.create_array(str(level), data=np.ones((2, 8 >> level, 8, 8), np.uint8), chunks=(1, 4, 4, 4))
    datasets = [{"path": str(level)} for level in (0, 1)]
    axes = [{"name": "c", "type": "channel"}, *({"name": name, "type": "space"} for name in "zyx")]
    group.attrs["multiscales"] = [{"version": "0.4", "axes": axes, "datasets": datasets}]
    assert [part for part, _ in parts(root, "brain.zarr")] == ["0", "1"]
    assert [part for part, _ in parts(root, "brain.zarr#1")] == ["1,c=0", "1,c=1"]
    assert parts(root, "brain.zarr#1,c=0") == []


def test_what_can_be_made_of_reflections_and_atoms_are_parts(root: Path) -> None:
    mtz(root / "refined.mtz", columns="FWT:F PHWT:P DELFWT:F PHDELWT:P I:J")
    made = [part for part, _ in parts(root, "refined.mtz")]
    assert made[:3] == ["map:FWT,PHWT", "map:DELFWT,PHDELWT", "patterson:FWT"] and "amplitude:I" in made
    mtz(root / "intensities.mtz", columns="I:J")  # which nothing can be drawn of without a word
    assert [part for part, _ in parts(root, "intensities.mtz")] == ["patterson:I", "amplitude:I"]
    mtz(root / "unknown.mtz", columns="A:F PA:P B:F PB:P")
    assert [part for part, _ in parts(root, "unknown.mtz") if part.startswith("map")] == [
        "map:A,PA",
        "map:A,PB",
        "map:B,PA",
        "map:B,PB",
    ]
    atom = "ATOM      1  CA  GLY A   1       1.000   2.000   3.000  1.00 10.00           C\n"
    models = "".join(f"MODEL     {number:4}\n{atom}ENDMDL\n" for number in (1, 2))
    (root / "two.pdb").write_text(f"{models}END\n", encoding="ascii")
    assert [part for part, _ in parts(root, "two.pdb")] == ["elements", "density", "frequency", "amplitude", "model=2"]
    for name in ("refined.mtz", "intensities.mtz", "unknown.mtz", "two.pdb"):
        for part, _ in parts(root, name):
            open_volume(f"{root / name}#{part}")
            assert parts(root, f"{name}#{part}") == []


def test_arrays_of_vtk_are_parts_though_one_is_active(root: Path) -> None:
    arrays = "".join(f"SCALARS {name} float 1\nLOOKUP_TABLE default\n{'0 ' * 8}\n" for name in ("a", "b"))
    head = "# vtk DataFile Version 3.0\nmade\nASCII\nDATASET STRUCTURED_POINTS\n"
    grid = "DIMENSIONS 2 2 2\nORIGIN 0 0 0\nSPACING 1 1 1\n"
    (root / "two.vtk").write_text(f"{head}{grid}POINT_DATA 8\n{arrays}", encoding="ascii")
    assert parts(root, "two.vtk") == [("PointData/a", "of points"), ("PointData/b", "of points")]


def test_parts_outside_of_the_root_are_not_told_and_what_is_damaged_is_refused(root: Path) -> None:
    np.savez(root.parent / "secret.npz", first=np.zeros((2, 2, 2)), second=np.zeros((2, 2, 2)))
    (root / "way.npz").symlink_to(root.parent / "secret.npz")
    for name in ("../secret.npz", "way.npz"):
        with pytest.raises(BadInput, match="is no folder below the one that volumes are opened from"):
            look(root, name)
    (root / "damaged.npz").write_bytes(b"PK\3\4")
    with pytest.raises(BadInput, match="damaged"):
        look(root, "damaged.npz")
