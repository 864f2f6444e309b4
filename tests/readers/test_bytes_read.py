"""How much of a file is read: by all servers together hardly more than it has, by `info` in little memory."""

from __future__ import annotations

import subprocess
import sys
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from support.files.counted_bytes import bytes_read
from support.files.prepared import Told
from support.patience import PATIENCE
from support.programs.programs import VOLSPLAT
from volsplat.client.coordinator.shares.sub_cubes import divided
from volsplat.client.session.session import Session
from volsplat.client.session.single import SingleProcess
from volsplat.mapshade_server.held.sheet_reader import SheetReader
from volsplat.mapshade_server.held.sub_cube import SubCube
from volsplat.mapshade_server.prepare import Options, prepare
from volsplat.mapshade_server.prepare.executor import Threads
from volsplat.mapshade_server.prepare.layout import PROGRAM_BYTES, Layout
from volsplat.mapshade_server.prepare.survey import survey_volume
from volsplat.mapshade_server.readers import open_volume
from volsplat.protocol.description.volume import Geometry, VolumeDescription

MOST_READ = 1.2  # times what the file has
DIMS = (128, 128, 128)


def raw(folder: Path) -> Path:
    path = folder / "v_128x128x128_uint16.raw"
    np.random.default_rng(4).integers(0, 4000, 128**3, np.uint16).tofile(path)
    return path


def hdf5(folder: Path) -> Path:
    path = folder / "v.h5"
    with h5py.File(path, "w") as file:
        file["v"] = np.random.default_rng(4).integers(0, 4000, DIMS, np.uint16)
    return path


def sheets_of_columns(folder: Path) -> Path:
    path = folder / "v.npy"
    np.save(path, np.asfortranarray(np.random.default_rng(4).integers(0, 4000, DIMS, np.uint16)))
    return path


@pytest.mark.parametrize("make", [raw, hdf5, sheets_of_columns])
@pytest.mark.parametrize("workers", [1, 4, 8])
def test_servers_together_read_hardly_more_than_the_file(
    make: Callable[[Path], Path], workers: int, tmp_path: Path
) -> None:
    path = make(tmp_path)
    reader = open_volume(str(path))
    description = reader.description
    boxes = divided(description.geometry, workers, description.chunk)
    reader.read(boxes[0])  # imports
    before = bytes_read()
    for box in boxes:
        SubCube(description.geometry, box).read(reader)
    assert bytes_read() - before < MOST_READ * path.stat().st_size
    assert len(boxes) == workers and len({box.voxels for box in boxes}) == 1


INFO = """
import resource, subprocess, sys
done = subprocess.run(sys.argv[1:], capture_output=True, encoding="utf-8")
print(done.stdout, done.stderr, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss >> 10, sep="\\n")
"""


@pytest.mark.skipif(sys.platform != "linux", reason="other systems count ru_maxrss otherwise")
def test_info_takes_little_memory_whatever_the_size(tmp_path: Path) -> None:
    """A sparse file, 512 MiB of which hardly any lies on the disk."""
    path = tmp_path / "v_512x512x256_float64.raw"
    with path.open("wb") as file:
        file.seek(8 * (100 * 512 * 512 + 77 * 512 + 50))
        file.write(np.float64(-3.5).tobytes())
        file.truncate(8 * 512 * 512 * 256)
    command = [sys.executable, "-c", INFO, str(VOLSPLAT), "info", str(path)]
    told = subprocess.run(command, capture_output=True, encoding="utf-8", timeout=PATIENCE).stdout
    *text, most = told.strip().splitlines()
    assert any("-3.5 to 0" in line for line in text), told
    assert int(most) < 280, told  # MiB, of any process; the interpreter and the client's libraries included


def test_what_is_only_surveyed_is_surveyed_the_same_and_can_be_drawn(tmp_path: Path) -> None:
    path = tmp_path / "v_40x30x20_float32.raw"
    np.random.default_rng(5).normal(size=(20, 30, 40)).astype(np.float32).tofile(path)
    with SingleProcess(path) as single, Session(path, workers=2, held=False) as session:
        for what in ("survey", "density_counts", "strength_counts", "extremes"):
            assert getattr(session.volume, what) == getattr(single.volume, what)
        scene = single.volume.default_scene()
        assert (session.render(scene) == single.render(scene)).all()


def test_prepare_reads_a_file_in_rows_three_times(tmp_path: Path) -> None:
    """With memory for one block of whole rows, but not for two."""
    layout = Layout(brick=16, shard=32, coarsest=16**3)
    taken = []
    for size in ((16, 16, 16), (200, 96, 96)):  # the first one for the imports
        path = tmp_path / f"v_{size[0]}x{size[1]}x{size[2]}_uint16.raw"
        voxels = np.arange(size[0] * size[1] * size[2]) // (size[0] * size[1])  # little to tell of what means stand for
        voxels.astype(np.uint16).tofile(path)
        before = bytes_read()
        options = Options(memory=PROGRAM_BYTES + 20224 * 1024, verify=False, layout=layout)
        prepare(str(path), path.with_suffix(".zarr"), options, Told())
        taken.append((bytes_read() - before) / path.stat().st_size)
    # Of the levels' float32 values and gradients, and of buffers for many small files; along j and k, of the last pass.
    means, halo = 1.2, 2 / layout.shard
    looks = 2.0  # at all of so small a file, before and after, for its identity
    assert 3.0 < taken[1] - looks < 3.0 + means + 2 * halo


def test_a_survey_keeps_no_sheets() -> None:
    """Fewer at a time than a brick has: of most of them no voxel is looked at for the background.

    They are wide and few, since what is known of the volume's blocks is traced anew with each.
    """
    geometry = Geometry((512, 512, 128))
    reader = SheetReader(
        geometry, "uint8", (512, 1, 1), lambda box: np.zeros(box.size[::-1], np.uint8), bytes_at_once=8 * 512 * 512
    )
    told = VolumeDescription(name="zeros", format="raw", geometry=geometry, scalar_type="uint8")
    tracemalloc.start()
    try:
        survey_volume(reader, told, 64, Threads(0), 1, Told())
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert most < geometry.box.voxels // 2
