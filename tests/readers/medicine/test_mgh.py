"""FreeSurfer's volumes lie where nibabel, which writes them here, has them."""

import gzip
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tolerances
from support.files.counted_bytes import bytes_read
from support.files.opened import described, read_whole
from support.files.volume_files import DIMS, values_of, written
from volsplat.mapshade_server.readers import open_volume
from volsplat.mapshade_server.readers.reading.volume_reader import Voxels
from volsplat.protocol.description.volume import Box
from volsplat.protocol.geometry.matrices import Matrix
from volsplat.protocol.text.errors import BadInput

nibabel = pytest.importorskip("nibabel")

# In right, anterior, superior; turned, of unequal steps, and left-handed.
TURNED = np.array([[0.0, -1.25, 0.0, 10.0], [0.3, 0.0, 2.4, -20.5], [0.4, 0.0, -1.8, 30.25], [0, 0, 0, 1]])
TO_LPS = np.diag([-1.0, -1.0, 1.0])


def mgh(path: Path, values: Voxels, affine: Any = TURNED) -> Path:
    """`values` as (k, j, i), or (frame, k, j, i)."""
    nibabel.save(nibabel.MGHImage(values.T, affine), path)
    return path


@pytest.mark.parametrize("extension", [".mgh", ".mgz"])
@pytest.mark.parametrize("scalar_type", ["uint8", "int16", "int32", "float32"])
def test_every_type_comes_back(scalar_type: str, extension: str, tmp_path: Path) -> None:
    values = values_of(scalar_type)
    path = mgh(tmp_path / f"volume{extension}", values)
    told = described(path)
    assert told.scalar_type == scalar_type and told.reads_sub_cubes == (extension == ".mgh")
    got = read_whole(path)
    assert got.dtype == values.dtype and got.dtype.isnative and got.flags.c_contiguous
    np.testing.assert_array_equal(got, values)
    np.testing.assert_array_equal(open_volume(str(path)).read(Box((1, 2, 0), (5, 4, 3))), values[0:3, 2:4, 1:5])


def test_a_volume_lies_where_nibabel_and_the_same_nrrd_have_it(tmp_path: Path) -> None:
    values = values_of("int16")
    told = described(mgh(tmp_path / "volume.mgz", values))
    assert told.anatomical and told.unit == "mm" and told.geometry.dims == DIMS
    affine = nibabel.load(tmp_path / "volume.mgz").affine
    for index in ((0, 0, 0), (6, 0, 0), (0, 5, 0), (1, 2, 4)):
        x, y, z, _ = affine @ (*index, 1)
        assert told.geometry.physical(index) == pytest.approx((-x, -y, z), rel=tolerances.GEOMETRY_FLOAT32)
    matrix: Matrix = tuple(map(tuple, (TO_LPS @ TURNED[:3, :3]).tolist()))  # type: ignore[assignment]
    same = described(written(tmp_path / "volume.nrrd", values, matrix))
    np.testing.assert_allclose(
        told.geometry.index_to_physical, same.geometry.index_to_physical, atol=tolerances.GEOMETRY_FLOAT32
    )


def test_a_frame_is_chosen(tmp_path: Path) -> None:
    frames = np.stack([values_of("int16"), values_of("int16") // 2])
    for path in (mgh(tmp_path / "volume.mgh", frames), mgh(tmp_path / "volume.mgz", frames)):
        np.testing.assert_array_equal(read_whole(f"{path}#1"), frames[1])
        with pytest.raises(BadInput, match="a series of 2 volumes"):
            open_volume(str(path))


def test_without_a_place_free_surfers_own_is_taken_and_told(tmp_path: Path) -> None:
    path = mgh(tmp_path / "volume.mgh", values_of("int16"))
    raw = path.read_bytes()
    path.write_bytes(raw[:28] + bytes(2) + raw[30:])
    told = described(path)
    # i leads to the left, j down, k to the front, of which LPS has left, back and up.
    assert told.geometry.index_to_physical == ((1, 0, 0), (0, 0, -1), (0, -1, 0))
    assert told.geometry.physical((3.5, 3, 2.5)) == (0, 0, 0)
    assert "states no place" in told.warnings[0]


def test_only_the_rows_of_a_box_are_read(tmp_path: Path) -> None:
    path = mgh(tmp_path / "volume.mgh", np.zeros((128, 128, 128), np.int16))
    reader = open_volume(str(path))
    before = bytes_read()
    reader.read(Box((0, 32, 64), (128, 96, 72)))
    assert bytes_read() - before < 128 * 64 * 8 * 2 + 65536


def changed(path: Path, at: int, new: bytes) -> Path:
    raw = path.read_bytes()
    path.write_bytes(raw[:at] + new + raw[at + len(new) :])
    return path


REFUSALS: dict[str, tuple[Callable[[Path], Path], str]] = {
    "truncated": (lambda p: changed(p, 4, b"\0\0\0\xff"), "promises"),
    "another version": (lambda p: changed(p, 0, b"\0\0\0\7"), "is no volume of FreeSurfer's"),
    "no voxels": (lambda p: changed(p, 4, bytes(4)), "is no volume of FreeSurfer's"),
    "tensors": (lambda p: changed(p, 20, b"\0\0\0\5"), "FreeSurfer's type 5"),
    "no spacing": (lambda p: changed(p, 30, bytes(12)), "do not span space"),
    "only a header": (lambda p: p if p.write_bytes(p.read_bytes()[:200]) else p, "header is truncated"),
}


@pytest.mark.parametrize("case", REFUSALS)
def test_bad_input_is_refused_in_one_line(case: str, tmp_path: Path) -> None:
    change, cause = REFUSALS[case]
    path = change(mgh(tmp_path / "volume.mgh", values_of("int16")))
    with pytest.raises(BadInput) as refusal:
        read_whole(path)
    assert cause in str(refusal.value) and "\n" not in str(refusal.value)


def test_a_truncated_gzip_is_refused(tmp_path: Path) -> None:
    noise = np.random.default_rng(0).integers(0, 30000, (20, 30, 40)).astype(np.int16)
    path = mgh(tmp_path / "volume.mgz", noise)
    path.write_bytes(gzip.compress(gzip.decompress(path.read_bytes())[:-40]))  # 20 are a footer
    with pytest.raises(BadInput, match="truncated"):
        read_whole(path)
