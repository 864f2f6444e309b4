"""A FIFO among the files of a volume: opening it would wait for a writer without an end, so it is refused by name."""

import os
import subprocess
import sys
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import h5py
import numpy as np
import pytest
import tifffile
import zarr
from PIL import Image

from support.checkout import ROOT
from support.files.prepared import prepare_small, values_of, written
from support.patience import PATIENCE

CHILD = ROOT / "tests/support/files/unpacking_child.py"
VALUES = (np.arange(16**3) % 251).astype(np.uint8).reshape(16, 16, 16)
OME = "http://www.openmicroscopy.org/Schemas/OME/2016-06"


def fifo(path: Path) -> None:
    path.unlink(missing_ok=True)
    os.mkfifo(path)


def ome_set(folder: Path) -> tuple[Path, Path]:
    planes = "".join(
        f'<TiffData FirstZ="{n}" PlaneCount="1"><UUID FileName="{n}.ome.tif">urn:uuid:{n}</UUID></TiffData>'
        for n in range(2)
    )
    pixels = 'DimensionOrder="XYZCT" Type="uint8" SizeX="16" SizeY="16" SizeZ="2" SizeC="1" SizeT="1"'
    image = f'<Image ID="Image:0"><Pixels ID="Pixels:0" {pixels}>{planes}</Pixels></Image>'
    xml = f'<OME xmlns="{OME}" UUID="urn:uuid:0">{image}</OME>'
    tifffile.imwrite(folder / "0.ome.tif", VALUES[0], description=xml, metadata=None)
    fifo(folder / "1.ome.tif")
    return folder / "0.ome.tif", folder / "1.ome.tif"


def tiff_slices(folder: Path) -> tuple[Path, Path]:
    for n in range(4):
        tifffile.imwrite(folder / f"s{n}.tif", VALUES[n])
    fifo(folder / "s3.tif")
    return folder, folder / "s3.tif"


def pictures(folder: Path) -> tuple[Path, Path]:
    for n in range(4):
        Image.fromarray(VALUES[n]).save(folder / f"s{n}.png")
    fifo(folder / "s3.png")
    return folder, folder / "s3.png"


def zarr_with(name: str, version: int) -> Callable[[Path], tuple[Path, Path]]:
    def make(folder: Path) -> tuple[Path, Path]:
        path = folder / "v.zarr"
        array = zarr.create_array(path, shape=(16, 16, 16), chunks=(8, 8, 8), dtype="uint8", zarr_format=version)  # type: ignore[arg-type]
        array[...] = VALUES
        fifo(path / name)
        return path, path / name

    return make


def virtual_hdf5(folder: Path) -> tuple[Path, Path]:
    layout = h5py.VirtualLayout(VALUES.shape, "u1")
    layout[...] = h5py.VirtualSource("x.h5", "v", VALUES.shape)
    with h5py.File(folder / "v.h5", "w") as file:
        file.create_virtual_dataset("v", layout)
    fifo(folder / "x.h5")
    return folder / "v.h5", folder / "x.h5"


def virtual_of_virtual_hdf5(folder: Path) -> tuple[Path, Path]:
    layout = h5py.VirtualLayout(VALUES.shape, "u1")
    layout[...] = h5py.VirtualSource("v.h5", "v", VALUES.shape)
    with h5py.File(folder / "w.h5", "w") as file:
        file.create_virtual_dataset("w", layout)
    return folder / "w.h5", virtual_hdf5(folder)[1]


def linked_hdf5(*files: str, part: str = "") -> Callable[[Path], tuple[Path, Path]]:
    """Each file's link leads to the next one's, the last one's to the FIFO."""

    def make(folder: Path) -> tuple[Path, Path]:
        for name, following in pairwise([*files, "x.h5"]):
            with h5py.File(folder / name, "w") as file:
                file["v"] = h5py.ExternalLink(following, "/v")
        fifo(folder / "x.h5")
        return folder / f"{files[0]}{part}", folder / "x.h5"

    return make


SETS: dict[str, Callable[[Path], tuple[Path, Path]]] = {
    "OME-TIFF set": ome_set,
    "TIFF slices": tiff_slices,
    "pictures": pictures,
    "Zarr 2, a chunk": zarr_with("0.0.0", 2),
    "Zarr 2, its document": zarr_with(".zarray", 2),
    "Zarr 3, a chunk": zarr_with("c/0/0/0", 3),
    "Zarr 3, its document": zarr_with("zarr.json", 3),
    "virtual HDF5": virtual_hdf5,
    "virtual HDF5 of virtual": virtual_of_virtual_hdf5,
    "linked HDF5": linked_hdf5("v.h5"),
    "linked HDF5, by name": linked_hdf5("v.h5", part="#v"),
    "HDF5, linked twice": linked_hdf5("v.h5", "w.h5"),
}


def test_a_fifo_among_the_files_of_a_volume_is_refused_by_name(tmp_path: Path) -> None:
    volumes, fifos = [], []
    for n, make in enumerate(SETS.values()):
        (tmp_path / str(n)).mkdir()
        volume, a_fifo = make(tmp_path / str(n))
        volumes.append(volume)
        fifos.append(a_fifo)
    done = subprocess.run(
        [sys.executable, CHILD, *volumes], capture_output=True, encoding="utf-8", timeout=PATIENCE, check=True
    )
    assert done.stderr == ""
    for name, a_fifo, line in zip(SETS, fifos, done.stdout.splitlines()[:-1], strict=True):
        assert line.startswith(f"refused: {a_fifo}: is a FIFO, which cannot be read in parts"), (name, line)


@pytest.mark.parametrize("name", ["zarr.json", "0/zarr.json", "0/c/0/0/0"])
def test_a_fifo_in_a_packet_store_is_refused(name: str, tmp_path: Path) -> None:
    prepare_small(written(tmp_path / "v.nrrd", values_of("uint8", (8, 8, 8))), tmp_path / "v.zarr")
    fifo(tmp_path / "v.zarr" / name)
    program = (
        "import sys; from volsplat.mapshade_server.held.packet_store import open_store; s = open_store(sys.argv[1]); "
        "s.read(0, s.levels[0].box)"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, tmp_path / "v.zarr"], capture_output=True, encoding="utf-8", timeout=PATIENCE
    )
    assert done.returncode == 1 and f"BadInput: {tmp_path}" in done.stderr.splitlines()[-1]
