"""Voxels as their file has them: the array's own numbers, from any storage, and never at others' cost."""

import gzip
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import h5py
import nibabel
import numpy as np
import pytest
import torch
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from support.programs.mapshade_bench import Bench, probe, render
from support.scenes.arbitrary import plain_scene
from volsplat.client.phantoms.volume_writer import write_volume
from volsplat.client.volume.file_voxel import FileVoxel
from volsplat.mapshade_server.answers import file_voxels
from volsplat.mapshade_server.answers.file_voxels import FileVoxels
from volsplat.mapshade_server.held.volume_identity import identified_volume
from volsplat.mapshade_server.readers import VolumeReader
from volsplat.mapshade_server.readers.reading.volume_reader import read_scalars
from volsplat.protocol.description.scene import View
from volsplat.protocol.description.volume import SCALAR_BYTES, Box, Geometry, Index
from volsplat.protocol.messages import messages
from volsplat.protocol.text.errors import BadInput

SHAPE = (4, 3, 5)  # k, j, i
SLOPE, INTERCEPT = 0.25, -1024.5


def told(path: Path, *indices: Index, name: str = "", voxels: FileVoxels | None = None) -> list[FileVoxel | None]:
    """What one who has described the volume hears of these voxels."""
    volume = str(path) + name
    identity = identified_volume(volume)[1]
    voxels, heard = voxels or FileVoxels(), []
    for index in indices:
        answer, payload = voxels.read(messages.ReadVoxel(1, volume, identity, index))
        assert isinstance(answer, messages.VoxelRead)
        heard.append(FileVoxel.of_bytes(answer.scalar_types, memoryview(b"".join(payload))) if payload else None)
    return heard


# -- the array's own numbers

Save = Callable[[Path, Any], tuple[str, Any]]  # writes an array (k, j, i); gives the name of its part, and what it is


def as_numpy(path: Path, values: Any) -> tuple[str, Any]:
    np.save(path, values)
    return "", values


def as_fortran_big_endian(path: Path, values: Any) -> tuple[str, Any]:
    np.save(path, np.asfortranarray(values.astype(values.dtype.newbyteorder(">"))))
    return "", values


def as_chunks(path: Path, values: Any) -> tuple[str, Any]:
    with h5py.File(path, "w") as file:
        file.create_dataset("v", data=values, chunks=(2, 3, 2), compression="gzip")
    return "#/v", values


def as_nrrd(path: Path, values: Any, packed: bool = False) -> tuple[str, Any]:
    types = {"float32": "float", "float64": "double"}
    header = f"NRRD0004\ntype: {types.get(values.dtype.name, values.dtype.name)}\ndimension: 3\n"
    header += f"sizes: {' '.join(map(str, values.shape[::-1]))}\nendian: little\n"
    header += f"encoding: {'gzip' if packed else 'raw'}\n\n"
    body = values.astype(values.dtype.newbyteorder("<")).tobytes()
    path.write_bytes(header.encode() + (gzip.compress(body) if packed else body))
    return "", values


def as_gzipped_nrrd(path: Path, values: Any) -> tuple[str, Any]:
    return as_nrrd(path, values, packed=True)


def as_nifti(path: Path, values: Any) -> tuple[str, Any]:
    nibabel.save(nibabel.Nifti1Image(values.T, np.eye(4), dtype=values.dtype), path)
    return "", values


def as_rescaled_nifti(path: Path, values: Any) -> tuple[str, Any]:
    image = nibabel.Nifti1Image(values.T, np.eye(4), dtype=values.dtype)
    image.header.set_slope_inter(1, 0)
    nibabel.save(image, path)
    head = bytearray(path.read_bytes())
    head[112:120] = np.array([SLOPE, INTERCEPT], "<f4").tobytes()  # scl_slope, scl_inter
    path.write_bytes(head)
    scaled_type = "float32" if values.dtype.itemsize <= 2 or values.dtype == "float32" else "float64"
    return "", (values.astype(np.float64) * SLOPE + INTERCEPT).astype(scaled_type)


WAYS: dict[str, tuple[str, Save]] = {
    "numpy": ("a.npy", as_numpy),
    "Fortran order, big-endian": ("f.npy", as_fortran_big_endian),
    "compressed chunks": ("c.h5", as_chunks),
    "NRRD": ("r.nrrd", as_nrrd),
    "gzipped NRRD, which comes whole": ("z.nrrd", as_gzipped_nrrd),
    "NIfTI": ("n.nii", as_nifti),
    "NIfTI with slope and intercept": ("s.nii", as_rescaled_nifti),
}


def any_numbers(dtype: str) -> st.SearchStrategy[Any]:
    """All that the type can hold; not a number only here and there, as no volume is nothing else."""
    return arrays.arrays(dtype, SHAPE, elements=arrays.from_dtype(np.dtype(dtype)))


@pytest.mark.parametrize("way", WAYS)
@given(data=st.data(), dtype=st.sampled_from(sorted(SCALAR_BYTES)))
def test_a_voxel_is_told_as_the_array_has_it(
    way: str, data: st.DataObject, dtype: str, tmp_path_factory: pytest.TempPathFactory
) -> None:
    name, save = WAYS[way]
    if "slope" in way and dtype in ("int64", "uint64"):
        dtype = "int32"  # numbers that float64 has no place for are rounded by whoever scales them
    path = tmp_path_factory.mktemp("volumes") / name
    values = data.draw(any_numbers(dtype))
    part, expected = save(path, values)
    index: Index = (0, 0, 0)
    index = tuple(data.draw(st.integers(0, size - 1)) for size in SHAPE[::-1])  # type: ignore[assignment]
    (voxel,) = told(path, index, name=part)
    assert voxel is not None and voxel.second is None
    own = expected[index[::-1]]
    assert voxel.scalar_types == (own.dtype.name,) and isinstance(voxel.density, int) == (own.dtype.kind in "iu")
    assert np.array_equal(np.asarray(voxel.density, own.dtype), own, equal_nan=own.dtype.kind == "f")


@given(number=st.floats(width=32))
@example(74237232.0)  # of seven digits it is 7.423723e+07
def test_a_number_is_printed_in_as_many_digits_as_it_has(number: float) -> None:
    (text,) = FileVoxel(number, None, ("float32",)).digits
    assert np.array_equal(np.float32(text), np.float32(number), equal_nan=True)
    assert len(text) <= len(f"{number:.9g}")


def test_numbers_are_printed_without_what_their_type_cannot_hold() -> None:
    assert FileVoxel(-8882, None, ("int16",)).digits == ("-8882",)
    assert FileVoxel(2**64 - 1, None, ("uint64",)).digits == ("18446744073709551615",)
    assert FileVoxel(float(np.float32(0.1)), 45.0, ("float32", "float32")).digits == ("0.1", "45")
    assert FileVoxel(0.1, None, ("float64",)).digits == ("0.1",)
    assert FileVoxel(1e300, 2.0, ("float64", "float64")).digits == ("1e+300", "2")


# -- at nobody's cost


@pytest.fixture
def full(tmp_path: Path) -> Path:
    side = 160  # the volume's packets are more than a link holds
    path = tmp_path / "full.mha"
    write_volume(path, torch.full((side,) * 3, 200, dtype=torch.uint8), Geometry((side,) * 3))
    return path


@pytest.fixture
def bench() -> Iterator[Bench]:
    bench = Bench()
    yield bench
    bench.close()


def test_a_read_that_does_not_return_delays_nothing_else(
    bench: Bench, full: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A voxel is asked for beside a frame; then its disk hangs: probes, descriptions and the end wait for nothing."""
    geometry = bench.holds(full, 1)
    bench.connects(0)
    identity = identified_volume(str(full))[1]
    scene = plain_scene(view=View(zoom=1.0), size=(320, 320))
    voxel = messages.ReadVoxel(7, str(full), identity, (1, 2, 3))
    with bench.accepts(0) as link:
        bench.control.send(render(1, geometry, scene))
        bench.control.send(voxel)
        read = bench.control.receive()
        assert read is not None and read.message == messages.VoxelRead(7, ["uint8"]) and bytes(read.payload) == b"\xc8"
        batch: messages.Batch | None = None
        while batch is None or not batch.last:
            received = link.receive()
            assert received is not None and isinstance(received.message, messages.Batch)
            batch = received.message
        bench.hears(messages.FrameMapped)

        begun, never = threading.Event(), threading.Event()

        def hang(*_: object) -> None:
            begun.set()
            never.wait()

        monkeypatch.setattr(FileVoxels, "read", hang)
        bench.control.send(voxel)
        assert begun.wait()
        bench.control.send(probe(geometry, scene))
        bench.hears(messages.VoxelProbed)
        bench.control.send(messages.DescribeVolume(str(full)))
        bench.hears(messages.VolumeDescribed)
        bench.control.send(messages.EndSession())
        bench.control.close()
        bench.ends()
        never.set()


def test_what_is_dear_is_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A plain file costs what one voxel does, a compressed one all of it."""
    values = np.arange(60, dtype=np.int16).reshape(SHAPE)
    plain, packed = tmp_path / "plain.nrrd", tmp_path / "packed.nrrd"
    as_nrrd(plain, values)
    as_gzipped_nrrd(packed, values)
    monkeypatch.setattr(file_voxels, "MOST_BYTES", values.nbytes - 1)
    assert told(plain, (1, 0, 0)) == [FileVoxel(1, None, ("int16",))] and told(packed, (1, 0, 0)) == [None]
    monkeypatch.setattr(file_voxels, "MOST_BYTES", values.nbytes)
    monkeypatch.setattr(file_voxels, "available_memory", lambda: file_voxels.LEAST_LEFT * values.nbytes - 1)
    assert told(packed, (1, 0, 0)) == [None]


def test_a_volume_that_only_comes_whole_is_read_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    values = np.arange(60, dtype=np.int16).reshape(SHAPE)
    path, voxels = tmp_path / "packed.nrrd", FileVoxels()
    as_gzipped_nrrd(path, values)
    boxes: list[Box] = []

    def noted(reader: VolumeReader, box: Box) -> list[Any]:
        boxes.append(box)
        return read_scalars(reader, box)

    monkeypatch.setattr(file_voxels, "read_scalars", noted)
    heard = told(path, (0, 0, 0), (4, 2, 3), (2, 1, 0), voxels=voxels)
    assert [voxel.density for voxel in heard if voxel] == [0, 59, 7]
    assert boxes == [Box((0, 0, 0), SHAPE[::-1])]


def test_no_voxel_is_told_of_another_volume_than_was_described(tmp_path: Path) -> None:
    path, values, voxels = tmp_path / "a.npy", np.arange(60, dtype=np.int16).reshape(SHAPE), FileVoxels()
    np.save(path, values)
    request = messages.ReadVoxel(1, str(path), identified_volume(str(path))[1], (1, 0, 0))
    voxels.read(request)
    np.save(path, values + 1)
    for again in (voxels, FileVoxels()):
        with pytest.raises(BadInput, match="was replaced or changed after it was opened"):
            again.read(request)
    with pytest.raises(BadInput, match="reaches beyond the volume"):
        told(path, (5, 0, 0))
