"""Small packet stores, made of values on the spot."""

import hashlib
import os
import signal
from contextlib import closing
from pathlib import Path

import numpy as np
import torch

from support.files import slow_preparing
from support.files.slow_preparing import LITTLE, SMALL
from support.patience import PATIENCE
from support.programs.forked_programs import Begun
from volsplat.client.phantoms.volume_writer import write_volume
from volsplat.mapshade_server.held.packet_store import Packets, PacketStore, open_store
from volsplat.mapshade_server.held.sub_cube import SubCube
from volsplat.mapshade_server.prepare import Options, Prepared, prepare
from volsplat.mapshade_server.readers.reading.volume_reader import Voxels
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.geometry.matrices import Matrix
from volsplat.protocol.rules.index_rules import Quantisation

__all__ = ["LITTLE", "SMALL"]

SKEWED: Matrix = ((0.9, 0.2, 0.1), (-0.1, 1.2, -0.4), (0.05, 0.3, -1.8))
ODD_DIMS = (37, 21, 50)


class Told:
    """A progress that keeps what was reported to it."""

    def __init__(self) -> None:
        self.notes: list[str] = []
        self.stages: dict[str, list[int]] = {}  # the bytes promised, and those done

    def note(self, text: str) -> None:
        self.notes.append(text)

    def begin(self, stage: str, total: int) -> None:
        self.stages[stage] = [total, 0]

    def advance(self, done: int) -> None:
        *_, newest = self.stages.values()
        newest[1] += done

    def check_wanted(self) -> None:
        """It is."""


def values_of(scalar_type: str, dims: tuple[int, int, int] = ODD_DIMS, seed: int = 0) -> Voxels:
    """Noise whose sums are exact in any order; floats have holes, and a whole corner without data."""
    kind = np.dtype(scalar_type)
    numbers = np.random.default_rng(seed).integers(0 if kind.kind == "u" else -100, 120, dims[::-1])
    values = numbers.astype(kind)
    if kind.kind == "f":
        values[numbers % 11 == 0] = np.nan
        values[numbers % 13 == 0] = np.inf
        values[:17, :18, :19] = np.nan
    return values


def written(path: Path, values: Voxels, matrix: Matrix = SKEWED) -> Path:
    geometry = Geometry(tuple(values.shape[::-1]), matrix, (10.0, -20.5, 30.25))
    write_volume(path, torch.from_numpy(values), geometry)
    return path


def prepare_small(volume: Path, out: Path, options: Options | None = None, told: Told | None = None) -> Prepared:
    return prepare(str(volume), out, options or Options(layout=SMALL), told or Told())


def store_of(folder: Path, values: Voxels, options: Options | None = None) -> PacketStore:
    prepare_small(written(folder / "volume.nrrd", values), folder / "volume.zarr", options)
    return open_store(str(folder / "volume.zarr"))


def packed_whole(
    geometry: Geometry,
    values: Voxels,
    quantisation: Quantisation,
    second: Voxels | None = None,
    second_range: tuple[float, float] | None = None,
) -> Packets:
    """The packets as one sub-cube makes them."""
    sub_cube = SubCube(geometry, geometry.box, second_range)
    sub_cube.hold(values, second)
    sub_cube.pack(quantisation)
    return np.asarray(memoryview(sub_cube.packets))


def tree(folder: Path) -> dict[str, str]:
    """The checksum of every file in a folder."""
    files = (path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def killed_after(lines: int, volume: Path, out: Path) -> list[str]:
    """What a run reports until it is killed, or to its end."""
    told: list[str] = []
    words = ["-m", slow_preparing.__name__, str(volume), str(out)]
    with closing(Begun(words, out.parent, os.environ)) as process:
        for line in process.stderr:
            told.append(line.rstrip("\n"))
            if len(told) == lines:
                process.send_signal(signal.SIGKILL)
        assert process.wait(PATIENCE) in (0, -signal.SIGKILL)
    return told
