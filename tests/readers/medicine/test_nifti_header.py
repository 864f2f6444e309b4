"""NIfTI headers that leave something out: what stands in for it is told, and no header is drawn."""

import gzip
import struct
from pathlib import Path

import numpy as np
import pytest

from support.files.opened import described, read_whole, refused
from support.files.volume_files import values_of, written

VALUES = values_of("int16")
SIZE_AT, OFFSET_AT, CODES_AT, SROW_AT = 0, 108, 252, 280  # of NIfTI-1


def changed(path: Path, codes: tuple[int, int] = (1, 0), srow: tuple[float, ...] | None = None) -> bytearray:
    """A NIfTI-1 file as ITK writes it, with other codes of qform and sform and another sform."""
    raw = bytearray(written(path, VALUES).read_bytes())
    struct.pack_into("<2h", raw, CODES_AT, *codes)
    if srow is not None:
        struct.pack_into("<12f", raw, SROW_AT, *srow)
    path.write_bytes(raw)
    return raw


def nifti_2(start: int) -> bytes:
    header = bytearray(544)
    struct.pack_into("<i8sh", header, 0, 540, b"n+2\0\r\n\x1a\n", 4)
    struct.pack_into("<8q", header, 16, 3, *VALUES.shape[::-1], 1, 1, 1, 1)
    struct.pack_into("<8d", header, 104, *[1.0] * 8)
    struct.pack_into("<q", header, 168, start)
    return bytes(header) + VALUES.tobytes()


@pytest.mark.parametrize("start", [0, 347])
@pytest.mark.parametrize("packed", [False, True], ids=["plain", "gzip"])
def test_voxels_do_not_begin_within_the_header(packed: bool, start: int, tmp_path: Path) -> None:
    raw = changed(tmp_path / "v.nii")
    struct.pack_into("<f", raw, OFFSET_AT, start)
    for name, content, at in (("one.nii", bytes(raw), 352), ("two.nii", nifti_2(start), 544)):
        path = tmp_path / (f"{name}.gz" if packed else name)
        path.write_bytes(gzip.compress(content) if packed else content)
        np.testing.assert_array_equal(read_whole(path), VALUES)
        (told,) = (line for line in described(path).warnings if "vox_offset" in line)
        assert f"{start}" in told and f"byte {at}" in told


def test_voxels_in_a_file_of_their_own_begin_where_the_header_says(tmp_path: Path) -> None:
    raw = changed(tmp_path / "v.nii")
    raw[344:348] = b"ni1\0"
    struct.pack_into("<f", raw, OFFSET_AT, 0)
    (tmp_path / "v.hdr").write_bytes(raw[:348])
    (tmp_path / "v.img").write_bytes(VALUES.tobytes())
    np.testing.assert_array_equal(read_whole(tmp_path / "v.hdr"), VALUES)
    assert described(tmp_path / "v.hdr").warnings == ()


FLAT = (1.0, 0, 0, 5, 0, 1, 0, 5, 1, 1, 0, 5)


@pytest.mark.parametrize("srow", [(0.0,) * 12, FLAT, (float("nan"),) * 12], ids=["zeros", "flat", "NaN"])
def test_an_sform_that_spans_no_space_gives_way_to_the_qform(srow: tuple[float, ...], tmp_path: Path) -> None:
    changed(tmp_path / "q.nii", (1, 0))
    changed(tmp_path / "both.nii", (1, 1), srow)
    expected, told = described(tmp_path / "q.nii"), described(tmp_path / "both.nii")
    assert told.geometry == expected.geometry and told.anatomical
    assert expected.warnings == () and told.warnings == ("its sform spans no space; the qform is followed",)


def test_an_sform_that_spans_no_space_is_refused_without_a_qform(tmp_path: Path) -> None:
    changed(tmp_path / "v.nii", (0, 1), (0.0,) * 12)
    assert "its spacing and directions cannot be used" in refused(tmp_path / "v.nii")
