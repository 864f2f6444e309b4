"""Analyze 7.5 files, made here byte by byte after its layout, and compared with SimpleITK's reading."""

import gzip
import struct
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
import SimpleITK as sitk

from support.files.counted_bytes import bytes_read
from support.files.volume_files import values_of
from volsplat.mapshade_server.readers import open_volume
from volsplat.mapshade_server.readers.reading.volume_reader import Voxels
from volsplat.protocol.description.volume import Box
from volsplat.protocol.text.errors import BadInput

CODES = {"uint8": 2, "int16": 4, "int32": 8, "float32": 16, "float64": 64}


def analyze(
    path: Path, values: Voxels, order: Literal["<", ">"] = "<", code: int | None = None, step: float = 2.0
) -> Path:
    """The .hdr at `path` and its .img; 4-D values are a series."""
    raw = bytearray(348)
    sizes = [values.ndim, *values.shape[::-1], *[1] * (7 - values.ndim)]
    struct.pack_into(f"{order}i", raw, 0, 348)
    raw[38:39] = b"r"
    struct.pack_into(f"{order}8h4s8s", raw, 40, *sizes, b"mm", b"HU")
    struct.pack_into(f"{order}2h", raw, 70, CODES[values.dtype.name] if code is None else code, values.itemsize * 8)
    struct.pack_into(f"{order}4f", raw, 76, 0.0, 0.5, 0.75, step)
    path.write_bytes(raw)
    path.with_suffix(".img").write_bytes(values.astype(values.dtype.newbyteorder(order)).tobytes())
    return path


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("scalar_type", CODES)
def test_both_byte_orders_of_every_type_come_back(scalar_type: str, order: Literal["<", ">"], tmp_path: Path) -> None:
    values = values_of(scalar_type)
    path = analyze(tmp_path / "head.hdr", values, order)
    for name in (path, path.with_suffix(".img")):
        reader = open_volume(str(name))
        description = reader.description
        assert description.geometry.spacing == (0.5, 0.75, 2.0) and description.unit == "mm"
        assert description.value_unit == "HU" and description.format == "Analyze 7.5"
        assert not description.anatomical and "no orientation" in description.warnings[0]
        got = reader.read(description.geometry.box)
        assert got.dtype == values.dtype and got.dtype.isnative
        np.testing.assert_array_equal(got, values)


def test_it_is_as_simple_itk_has_it(tmp_path: Path) -> None:
    path = analyze(tmp_path / "head.hdr", values_of("int16"))
    image = sitk.ReadImage(str(path))
    reader = open_volume(str(path))
    assert reader.description.geometry.spacing == image.GetSpacing()
    np.testing.assert_array_equal(reader.read(reader.description.geometry.box), sitk.GetArrayFromImage(image))


def test_a_zipped_image_is_found(tmp_path: Path) -> None:
    values = values_of("int16")
    path = analyze(tmp_path / "head.hdr", values)
    image = path.with_suffix(".img")
    image.with_name("head.img.gz").write_bytes(gzip.compress(image.read_bytes()))
    image.unlink()
    reader = open_volume(str(path))
    assert "gzip" in reader.description.why_whole
    np.testing.assert_array_equal(reader.read(Box((0, 0, 2), (7, 6, 4))), values[2:4])


def test_a_frame_of_a_series_is_chosen(tmp_path: Path) -> None:
    values = values_of("int16", (7, 6, 15)).reshape(3, 5, 6, 7)
    path = analyze(tmp_path / "head.hdr", values)
    with pytest.raises(BadInput, match="3 volumes, numbered from 0"):
        open_volume(str(path))
    reader = open_volume(f"{path}#2")
    np.testing.assert_array_equal(reader.read(reader.description.geometry.box), values[2])


def test_the_image_of_a_nifti_pair_opens(tmp_path: Path) -> None:
    values = values_of("int16")
    sitk.WriteImage(sitk.GetImageFromArray(values), str(tmp_path / "head.hdr"))
    reader = open_volume(str(tmp_path / "head.img"))
    assert reader.description.format == "NIfTI-1"
    np.testing.assert_array_equal(reader.read(reader.description.geometry.box), values)


def test_only_the_sub_cube_is_read(tmp_path: Path) -> None:
    path = analyze(tmp_path / "head.hdr", np.zeros((64, 64, 64), np.int16))
    reader = open_volume(str(path))
    before = bytes_read()
    reader.read(Box((0, 0, 8), (64, 64, 16)))
    assert bytes_read() - before < 8 * 64 * 64 * 2 + 4096


def test_what_is_wrong_is_told(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    values = values_of("int16")
    refusals = {
        "a 2-D image": analyze(tmp_path / "flat.hdr", values[0]),
        "type 128, no plain number": analyze(tmp_path / "rgb.hdr", values, code=128),
        "do not span space": analyze(tmp_path / "zero.hdr", values, step=0.0),
        "holds only 10": analyze(tmp_path / "short.hdr", values),
        "its data file lost.img is missing": analyze(tmp_path / "lost.hdr", values),
        "put alone.hdr beside it": tmp_path / "alone.img",
        "makes no sense": analyze(tmp_path / "sizes.hdr", values),
        "no header of Analyze": tmp_path / "odd.img",
    }
    (tmp_path / "short.img").write_bytes(bytes(10))
    (tmp_path / "lost.img").unlink()
    (tmp_path / "alone.img").write_bytes(bytes(10))
    (tmp_path / "odd.img").write_bytes(bytes(10))
    (tmp_path / "odd.hdr").write_text("ENVI\n")
    raw = bytearray((tmp_path / "sizes.hdr").read_bytes())
    raw[42:44] = struct.pack("<h", -7)
    (tmp_path / "sizes.hdr").write_bytes(raw)
    for cause, path in refusals.items():
        with pytest.raises(BadInput, match=cause) as refusal:
            open_volume(str(path))
        assert "\n" not in str(refusal.value)
    assert capfd.readouterr() == ("", "")
