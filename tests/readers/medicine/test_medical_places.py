"""What MetaImage and NIfTI headers say of the place beside what is followed: noted if it contradicts, never lost."""

import itertools
from pathlib import Path

import numpy as np
import pytest
import SimpleITK as sitk

from support.files.opened import described
from support.files.volume_files import values_of, written
from volsplat.mapshade_server.readers.reading.volume_reader import Voxels
from volsplat.protocol.description.volume import VolumeDescription

VALUES = values_of("uint8", (4, 3, 2))


def metaimage(folder: Path, fields: str) -> VolumeDescription:
    path = folder / "volume.mha"
    head = f"ObjectType = Image\nNDims = 3\nBinaryData = True\n{fields}\nDimSize = 4 3 2\nElementType = MET_UCHAR\n"
    path.write_bytes(f"{head}ElementDataFile = LOCAL\n".encode() + VALUES.tobytes())
    return described(path)


@pytest.mark.parametrize("matrix", ["TransformMatrix", "Orientation", "Rotation"])
@pytest.mark.parametrize("origin", ["Offset", "Origin", "Position"])
@pytest.mark.parametrize("spacing", ["ElementSpacing", "ElementSize"])
def test_a_metaimage_lies_where_it_says_by_whatever_name(
    matrix: str, origin: str, spacing: str, tmp_path: Path
) -> None:
    """Rows of the matrix are where i, j and k lead; here it is left-handed."""
    told = metaimage(tmp_path, f"{spacing} = 1 2 3\n{matrix} = 0 1 0 1 0 0 0 0 1\n{origin} = 4 5 6")
    assert told.geometry.index_to_physical == ((0, 2, 0), (1, 0, 0), (0, 0, 3))
    assert told.geometry.origin == (4, 5, 6) and told.warnings == ()


def test_the_unit_of_a_metaimage_is_kept(tmp_path: Path) -> None:
    assert metaimage(tmp_path, "DistanceUnits = um\nElementSpacing = 1 2 3").unit == "µm"
    assert metaimage(tmp_path, "ElementSpacing = 1 2 3").unit == ""
    assert metaimage(tmp_path, "ElementSpacing = 1 2 3\nAnatomicalOrientation = RAI").unit == "mm"


SIGNED_ORDERS = list(itertools.product(itertools.permutations(range(3)), itertools.product((1, -1), repeat=3)))


def test_an_orientation_as_itk_writes_it_contradicts_nothing(tmp_path: Path) -> None:
    for order, signs in SIGNED_ORDERS:
        image = sitk.GetImageFromArray(VALUES)
        image.SetDirection((np.eye(3)[list(order)] * signs).ravel().tolist())
        sitk.WriteImage(image, str(tmp_path / "v.mha"))
        assert described(tmp_path / "v.mha").warnings == ()


@pytest.mark.parametrize("letters", ["RAS", "LAI", "PSL"])
def test_an_orientation_that_contradicts_the_matrix_is_told(letters: str, tmp_path: Path) -> None:
    told = metaimage(tmp_path, f"ElementSpacing = 1 2 3\nAnatomicalOrientation = {letters}")
    assert told.warnings == (f"AnatomicalOrientation {letters} contradicts the TransformMatrix, which is followed",)
    for fitting in ("LPS", "RAI", "???"):
        assert metaimage(tmp_path, f"ElementSpacing = 1 2 3\nAnatomicalOrientation = {fitting}").warnings == ()


def test_a_centre_of_rotation_is_told_to_be_left_out(tmp_path: Path) -> None:
    turned = "ElementSpacing = 1 2 3\nTransformMatrix = 0 1 0 -1 0 0 0 0 1"
    assert "CenterOfRotation is left out" in metaimage(tmp_path, f"{turned}\nCenterOfRotation = 1 0 0").warnings[0]
    assert metaimage(tmp_path, f"{turned}\nCenterOfRotation = 0 0 0").warnings == ()


def nifti(path: Path, qform: int, sform: int, values: Voxels = VALUES, mirrored: bool = False) -> VolumeDescription:
    """With an sform whose first column is turned round if it is mirrored."""
    written(path, values)
    raw = bytearray(path.read_bytes())
    raw[252:256] = np.array([qform, sform], "<i2").tobytes()
    rows = np.frombuffer(raw, "<f4", 12, 280).reshape(3, 4).copy()
    if mirrored:
        rows[:, 0] *= -1
    raw[280:328] = rows.tobytes()
    path.write_bytes(raw)
    return described(path)


def test_a_nifti_without_a_place_tells_that_sides_are_unknown(tmp_path: Path) -> None:
    told = nifti(tmp_path / "v.nii", 0, 0)
    assert told.warnings == ("the file states neither sform nor qform: left and right cannot be told",)
    assert not told.anatomical


@pytest.mark.parametrize(("codes", "unit"), [((1, 0), "mm"), ((0, 1), "mm"), ((0, 0), "")])
def test_a_nifti_in_a_scanners_space_without_a_unit_is_in_mm(codes: tuple[int, int], unit: str, tmp_path: Path) -> None:
    path = tmp_path / "v.nii"
    nifti(path, *codes)
    raw = bytearray(path.read_bytes())
    raw[123] = 0
    path.write_bytes(raw)
    told = described(path)
    assert told.unit == unit and ("states no unit of length" in str(told.warnings)) == (unit == "mm")


def test_an_sform_goes_before_a_qform_and_another_hand_is_told(tmp_path: Path) -> None:
    by_qform = nifti(tmp_path / "q.nii", 1, 0, mirrored=True)
    by_sform = nifti(tmp_path / "s.nii", 0, 1, mirrored=True)
    both = nifti(tmp_path / "b.nii", 1, 1, mirrored=True)
    assert both.geometry == by_sform.geometry != by_qform.geometry
    assert both.warnings == ("its sform and qform disagree on what is left and what is right; the sform is followed",)
    assert by_qform.warnings == by_sform.warnings == nifti(tmp_path / "n.nii", 1, 1).warnings == ()
