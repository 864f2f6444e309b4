"""The real volumes open with the dimensions, spacing and range that their own table states."""

from pathlib import Path

import numpy as np
import pytest
import SimpleITK as sitk

import tolerances
from support.files.opened import read_whole
from volsplat.mapshade_server.readers import open_volume
from volsplat.protocol.text.errors import BadInput

PYNRRD_BALLS = (
    "BallBinary30x30x30.nhdr",
    "BallBinary30x30x30_byteskip_minus_one.nhdr",
    "BallBinary30x30x30_bz2.nrrd",
    "BallBinary30x30x30_gz.nrrd",
    "BallBinary30x30x30_gz_byteskip_minus_one.nrrd",
    "BallBinary30x30x30_gz_lineskip.nrrd",
)

EMRI = ("emri_small", "emri_small_big_endian", "emri_small_RLE", "emri_small_jpeg_2k_lossless")

# path: (dimensions, spacing, scalar type, least and greatest value)
VOLUMES = {
    "ct_head/cthead_256x256x113.nrrd": ((256, 256, 113), (1, 1, 2), "uint16", (0, 3272)),
    "ct_head/ct_head_96x128x113.nrrd": ((96, 128, 113), (1, 1, 1), "uint8", (0, 255)),
    "sod/sod_density_97x97x116.nhdr": ((97, 97, 116), (1, 1, 1), "uint8", (0, 255)),
    "orbital/hydrogen_3d_64x64x64.nrrd": ((64, 64, 64), (1, 1, 1), "float32", (0, 1)),
    "volvis/neghip_64x64x64_uint8.nhdr": ((64, 64, 64), (1, 1, 1), "uint8", (0, 255)),
    "volvis/tooth_103x94x161_uint8.nhdr": ((103, 94, 161), (1, 1, 1), "uint8", (0, 255)),
    "volvis/nucleon_41x41x41_uint8.nhdr": ((41, 41, 41), (1, 1, 1), "uint8", (0, 249)),
    "dicom_ct_phantom": ((512, 512, 28), (0.451171875, 0.451171875, 5), "int16", (-1024, 782)),
    **{f"dicom_multiframe/{name}.dcm": ((64, 64, 10), (1, 1, 1.2), "uint16", (0, 467)) for name in EMRI},
    "nifti/CT_pitch.nii.gz": ((175, 248, 58), (0.8125, 0.8125, 2.397), "uint8", (0, 255)),
    "nifti/avg152T1_LR_nifti.nii.gz": ((91, 109, 91), (2, 2, 2), "uint8", (0, 255)),
    "nifti/big.nii.gz": ((64, 64, 21), (4, 4, 6), "float32", (-8.71, 18.58)),
    "nifti/little.nii.gz": ((64, 64, 21), (4, 4, 6), "float32", (-8.71, 18.58)),
    "nrrd/template_T2.nrrd": ((117, 159, 126), (0.859375, 0.859375, 0.859375), "float32", (0, 710.7)),
    "metaimage/HeadMRVolume.mhd": ((48, 62, 42), (4, 4, 4), "uint8", (0, 255)),
    "metaimage/frogtissue.mhd": ((500, 470, 136), (1, 1, 1.5), "uint8", (0, 29)),
    "odd/slab_bigendian_u16.nrrd": ((256, 256, 8), (1, 1, 2), "uint16", (0, 3272)),
    "odd/slab_multifile.nhdr": ((256, 256, 8), (1, 1, 2), "uint16", (0, 3272)),
    "odd/slab_compressed_s16.mha": ((256, 256, 8), (1, 1, 2), "int16", (0, 3272)),
    "odd/slab_msb_s16.mha": ((256, 256, 8), (1, 1, 2), "int16", (0, 3272)),
    "odd/slab_skip512.mhd": ((256, 256, 8), (1, 1, 2), "uint16", (0, 3272)),
    "odd/slab_u16_bigendian.tif": ((256, 256, 8), (1, 1, 1), "uint16", (0, 3272)),
    "odd/slab_u16_deflate.tif": ((256, 256, 8), (1, 1, 1), "uint16", (0, 3272)),
    "odd/slab_sform_shear_slope.nii.gz": ((256, 256, 8), (0.91378, 1.15758, 1.84662), "float32", (-100, 1536)),
    "odd/neghip_64x64x64_stack.tif": ((64, 64, 64), (1, 1, 1), "uint8", (0, 255)),
    **{f"nrrd/pynrrd/{name}": ((30, 30, 30), (1, 1, 1), "int16", (0, 257)) for name in PYNRRD_BALLS},
}

STATED = ("odd/slab_compressed_s16.mha",)  # by its AnatomicalOrientation
ANATOMICAL = ("dicom_ct_phantom", "nifti/", "nrrd/", "odd/slab_sform", *STATED)

SIMPLE_ITK_FAILS = ("_bz2.nrrd", "slab_sform", "dicom_ct_phantom", "emri_small")


@pytest.mark.parametrize("name", VOLUMES)
def test_a_real_volume_is_as_its_table_says(name: str, shared_data: Path, capfd: pytest.CaptureFixture[str]) -> None:
    dims, spacing, scalar_type, limits = VOLUMES[name]
    description = open_volume(str(shared_data / name)).description
    assert description.geometry.dims == dims
    assert description.geometry.spacing == pytest.approx(spacing, rel=tolerances.GEOMETRY_PRINTED)
    assert description.scalar_type == scalar_type
    assert description.anatomical == name.startswith(ANATOMICAL)
    voxels = read_whole(shared_data / name)
    assert (float(voxels.min()), float(voxels.max())) == pytest.approx(limits, rel=tolerances.RANGE_PRINTED)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("name", [name for name in VOLUMES if not any(part in name for part in SIMPLE_ITK_FAILS)])
def test_a_real_volume_lies_where_simple_itk_has_it(name: str, shared_data: Path) -> None:
    image = sitk.ReadImage(str(shared_data / name))
    reader = open_volume(str(shared_data / name))
    geometry = reader.description.geometry
    for index in ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)):
        place = geometry.physical((float(index[0]), float(index[1]), float(index[2])))
        expected = image.TransformContinuousIndexToPhysicalPoint([*index, *[0] * (image.GetDimension() - 3)])[:3]
        assert place == pytest.approx(expected, rel=tolerances.GEOMETRY_FLOAT32, abs=tolerances.GEOMETRY_FLOAT32)
    np.testing.assert_array_equal(reader.read(geometry.box), sitk.GetArrayFromImage(image).reshape(geometry.dims[::-1]))


def test_the_slab_is_the_same_in_every_odd_file(shared_data: Path) -> None:
    expected = read_whole(shared_data / "ct_head/cthead_256x256x113.nrrd")[52:60]
    names = [name for name in VOLUMES if name.startswith("odd/slab_")]
    assert len(names) == 8
    for name in names:
        voxels = read_whole(shared_data / name)
        if "slope" in name:
            voxels = (voxels + 100) * 2
        np.testing.assert_array_equal(voxels, expected, err_msg=name)


def test_the_sheared_slab_keeps_its_sform(shared_data: Path) -> None:
    geometry = open_volume(str(shared_data / "odd/slab_sform_shear_slope.nii.gz")).description.geometry
    expected = [[0.9, -0.2, -0.1], [-0.15, -1.1, 0.4], [0.05, 0.3, 1.8]]  # RAS in the file, LPS here
    for row, wanted in zip(geometry.index_to_physical, expected, strict=True):
        assert row == pytest.approx(wanted, rel=tolerances.GEOMETRY_FLOAT32)
    assert geometry.origin == (-40, 60, 10)


def test_both_byte_orders_of_nifti_are_equal(shared_data: Path) -> None:
    np.testing.assert_array_equal(
        read_whole(shared_data / "nifti/big.nii.gz"), read_whole(shared_data / "nifti/little.nii.gz")
    )


def test_the_stack_of_pages_equals_the_raw_file(shared_data: Path) -> None:
    np.testing.assert_array_equal(
        read_whole(shared_data / "odd/neghip_64x64x64_stack.tif"),
        read_whole(shared_data / "volvis/neghip_64x64x64_uint8.nhdr"),
    )


def test_the_balls_are_equal_in_every_encoding(shared_data: Path) -> None:
    first, *others = (read_whole(shared_data / "nrrd/pynrrd" / name) for name in PYNRRD_BALLS)
    for other in others:
        np.testing.assert_array_equal(other, first)


@pytest.mark.parametrize(
    ("name", "cause"),
    [
        ("nrrd/pynrrd/test2d_ascii.nrrd", "a 2-D image"),
        ("nrrd/pynrrd/test_customFields.nrrd", "a 1-D list"),
        ("dicom_multiframe/CT_small.dcm", "one DICOM slice"),
        ("ct_head/slices_53_to_60", "without DICOM"),
    ],
)
def test_what_is_no_volume_is_refused(
    name: str, cause: str, shared_data: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(BadInput, match=cause) as refusal:
        open_volume(str(shared_data / name))
    assert "\n" not in str(refusal.value)
    assert capfd.readouterr() == ("", "")
