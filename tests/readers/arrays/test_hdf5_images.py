"""Images in HDF5 files lie where the programs that wrote them have them: VTK's, ITK's and Imaris'."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import SimpleITK as sitk

import tolerances
from support.files.opened import described, read_whole
from support.files.volume_files import DIMS, values_of, written
from volsplat.mapshade_server.readers import open_volume
from volsplat.mapshade_server.readers.open_volume import parts_of
from volsplat.protocol.description.volume import Box
from volsplat.protocol.text.errors import BadInput

h5py = pytest.importorskip("h5py")
vtk_hdf = pytest.importorskip("vtkmodules.vtkIOHDF")

VALUES = values_of("int16")
STEPS, ORIGIN = (0.5, 1.25, 3.0), (10.0, -20.5, 30.25)
TURNED = np.array([[0.0, -1.0, 0.0], [0.8, 0.0, 0.6], [0.6, 0.0, -0.8]])  # left-handed too: a determinant of -1
LOW = (2, -1, 3)  # of VTK's extent


def vtk_image(directions: Any = TURNED) -> Any:
    """VALUES as points, other values as cells, vectors."""
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonDataModel import vtkImageData

    image = vtkImageData()
    image.SetExtent(*(n for low, size in zip(LOW, DIMS, strict=True) for n in (low, low + size - 1)))
    image.SetSpacing(*STEPS)
    image.SetOrigin(*ORIGIN)
    image.SetDirectionMatrix(*np.asarray(directions).ravel().tolist())
    cells = np.arange(6 * 5 * 4, dtype=np.float32)
    for data, name, values in (
        (image.GetPointData(), "density", VALUES.ravel()),
        (image.GetPointData(), "velocity", np.zeros((VALUES.size, 3), np.float32)),
        (image.GetCellData(), "mass", cells),
    ):
        array = numpy_to_vtk(values, deep=True)
        array.SetName(name)
        data.AddArray(array)
    image.GetPointData().SetActiveScalars("density")
    return image


def vtkhdf(path: Path, image: Any) -> Path:
    writer = vtk_hdf.vtkHDFWriter()
    writer.SetInputData(image)
    writer.SetFileName(str(path))
    assert writer.Write() == 1
    return path


def itk(path: Path) -> Path:
    image = sitk.GetImageFromArray(VALUES)
    image.SetSpacing(STEPS)
    image.SetOrigin(ORIGIN)
    image.SetDirection(TURNED.ravel().tolist())
    sitk.WriteImage(image, str(path), imageIO="HDF5ImageIO")
    return path


def letters(text: object) -> Any:
    """How Imaris writes attributes: an array of single letters."""
    return np.array([letter.encode() for letter in str(text)], "S1")


def imaris(
    path: Path, channels: int = 1, times: int = 1, ends: tuple[float, ...] = (10, 13.5, -20, -14, 5, 20)
) -> Path:
    """Two levels; voxels are padded with 99 to chunks of 4 x 4 x 4."""
    with h5py.File(path, "w") as file:
        image = file.create_group("DataSetInfo/Image").attrs
        for n, axis in enumerate("XYZ"):
            image[axis] = letters(DIMS[n])
            image[f"ExtMin{n}"], image[f"ExtMax{n}"] = letters(ends[2 * n]), letters(ends[2 * n + 1])
        image["Unit"] = letters("um")
        file["Thumbnail/Data"] = np.zeros((64, 64, 4), np.uint8)
        for c in range(channels):
            file.create_group(f"DataSetInfo/Channel {c}").attrs["Name"] = letters(f"stain {c}")
        for level in range(2):
            for t in range(times):
                for c in range(channels):
                    values = (VALUES.astype(np.uint16) + 1000 * c + 100 * t)[:: level + 1, :: level + 1, :: level + 1]
                    group = file.create_group(f"DataSet/ResolutionLevel {level}/TimePoint {t}/Channel {c}")
                    padding = [(0, -size % 4) for size in values.shape]
                    group.create_dataset("Data", data=np.pad(values, padding, constant_values=99), chunks=(4, 4, 4))
                    group["Histogram"] = np.zeros(256, np.uint64)
                    for axis, size in zip("XYZ", values.shape[::-1], strict=True):
                        group.attrs[f"ImageSize{axis}"] = letters(size)
    return path


def test_an_itk_image_lies_where_the_same_nrrd_does(tmp_path: Path) -> None:
    path = itk(tmp_path / "volume.h5")
    nrrd = written(tmp_path / "volume.nrrd", VALUES, tuple(map(tuple, (TURNED * STEPS).tolist())))  # type: ignore[arg-type]
    told, same = described(path), described(nrrd)
    np.testing.assert_allclose(told.geometry.index_to_physical, same.geometry.index_to_physical, atol=1e-12)
    image = sitk.ReadImage(str(path))
    for index in ((0, 0, 0), (6, 0, 0), (0, 5, 0), (1, 2, 4)):
        place = told.geometry.physical(index)
        assert place == pytest.approx(image.TransformIndexToPhysicalPoint(index), rel=tolerances.GEOMETRY_FLOAT64)
    assert told.anatomical and told.unit == "mm" == same.unit
    for name in (path, f"{path}#/ITKImage/0/VoxelData"):
        np.testing.assert_array_equal(read_whole(name), VALUES)


def test_a_vtkhdf_image_lies_where_vtk_has_it(tmp_path: Path) -> None:
    image = vtk_image()
    path = vtkhdf(tmp_path / "volume.vtkhdf", image)
    geometry = described(path).geometry
    assert geometry.dims == DIMS
    for index in ((0, 0, 0), (6, 0, 0), (0, 5, 0), (1, 2, 4)):
        place = [0.0, 0.0, 0.0]
        image.TransformIndexToPhysicalPoint(*(n + low for n, low in zip(index, LOW, strict=True)), place)
        assert geometry.physical(index) == pytest.approx(place, rel=tolerances.GEOMETRY_FLOAT64)
    for name in (path, f"{path}#density", f"{path}#/VTKHDF/PointData/density"):
        assert described(name).density_name == "density"
        np.testing.assert_array_equal(read_whole(name), VALUES)
    box = Box((1, 2, 0), (5, 4, 3))
    np.testing.assert_array_equal(open_volume(str(path)).read(box), VALUES[0:3, 2:4, 1:5])


def test_cells_of_a_vtkhdf_image_lie_between_its_points(tmp_path: Path) -> None:
    path = vtkhdf(tmp_path / "volume.vtkhdf", vtk_image())
    points, cells = described(path).geometry, described(f"{path}#mass").geometry
    assert cells.dims == (6, 5, 4) and cells.index_to_physical == points.index_to_physical
    assert cells.origin == pytest.approx(points.physical((0.5, 0.5, 0.5)))
    np.testing.assert_array_equal(read_whole(f"{path}#mass").ravel(), np.arange(120))


def test_a_moment_of_a_vtkhdf_series_is_chosen(tmp_path: Path) -> None:
    path = vtkhdf(tmp_path / "volume.vtkhdf", vtk_image())
    with h5py.File(path, "a") as file:
        group = file["VTKHDF"]
        group.create_group("Steps").attrs["NSteps"] = 2
        del group["PointData/density"], group["PointData/velocity"], group["CellData"]
        group["PointData/density"] = np.stack([VALUES, VALUES * 2])
    np.testing.assert_array_equal(read_whole(f"{path}#t=1"), VALUES * 2)
    with pytest.raises(BadInput, match=r"holds 2 volumes, t=0 to 1; choose, as in .*#t=0"):
        open_volume(str(path))


def test_what_a_vtkhdf_image_hides_is_no_data(tmp_path: Path) -> None:
    path = vtkhdf(tmp_path / "volume.vtkhdf", vtk_image())
    points, cells = np.ones(VALUES.shape, np.uint8), np.ones((4, 5, 6), np.uint8)
    points.ravel()[::5] |= 2
    cells.ravel()[::3] |= 32
    with h5py.File(path, "a") as file:
        file["VTKHDF/PointData/vtkGhostType"], file["VTKHDF/CellData/vtkGhostType"] = points, cells
    expected = np.where(points & 2, np.nan, VALUES)
    expected[:, :, 0] = np.nan  # whose cells are all hidden
    np.testing.assert_array_equal(read_whole(path), expected)
    assert described(path).scalar_type == "float32"
    np.testing.assert_array_equal(open_volume(str(path)).read(Box((1, 2, 0), (5, 4, 3))), expected[0:3, 2:4, 1:5])
    np.testing.assert_array_equal(read_whole(f"{path}#mass").ravel(), [np.nan if n % 3 == 0 else n for n in range(120)])
    assert "vtkGhostType" not in str(open_volume(str(path)).parts)


@pytest.mark.parametrize("hidden", [None, "PointData", "CellData"])
def test_whole_numbers_of_a_vtkhdf_image_stay_so_unless_some_are_hidden(hidden: str | None, tmp_path: Path) -> None:
    """A single hidden cell in a corner hides the corner's point."""
    path = vtkhdf(tmp_path / "volume.vtkhdf", vtk_image())
    values = np.arange(VALUES.size, dtype=np.uint8).reshape(VALUES.shape)
    ghosts = {"PointData": np.ones(VALUES.shape, np.uint8), "CellData": np.ones((4, 5, 6), np.uint8)}
    if hidden:
        ghosts[hidden][-1, -1, -1] |= {"PointData": 2, "CellData": 32}[hidden]
    with h5py.File(path, "a") as file:
        del file["VTKHDF/PointData/density"]
        file["VTKHDF/PointData/density"] = values
        for name, array in ghosts.items():
            file[f"VTKHDF/{name}/vtkGhostType"] = array
    expected = values.astype(np.float32)
    if hidden:
        expected[-1, -1, -1] = np.nan
    np.testing.assert_array_equal(read_whole(f"{path}#density"), expected)
    assert described(f"{path}#density").scalar_type == ("float32" if hidden else "uint8")


def test_what_lost_partitions_of_a_vtkhdf_image_held_is_told(tmp_path: Path) -> None:
    """As VTK writes partitions into files of their own."""
    path, sheets = vtkhdf(tmp_path / "volume.vtkhdf", vtk_image()), (2, DIMS[2] - 2)
    layout, begin = h5py.VirtualLayout(VALUES.shape, VALUES.dtype), 0
    for n, count in enumerate(sheets):
        source = h5py.VirtualSource(f"part{n}.h5", "data", (count, *VALUES.shape[1:]))
        layout[begin : begin + count] = source
        with h5py.File(tmp_path / f"part{n}.h5", "w") as part:
            part["data"] = VALUES[begin : begin + count]
        begin += count
    density = f"{path}#density"
    with h5py.File(path, "a") as file:
        del file["VTKHDF/PointData/density"]
        file.create_virtual_dataset("VTKHDF/PointData/density", layout)
    np.testing.assert_array_equal(read_whole(density), VALUES)
    assert not described(density).warnings
    (tmp_path / "part1.h5").unlink()
    assert "1 of 2 files with its voxels are not there, or lack them (part1.h5)" in described(density).warnings[0]
    np.testing.assert_array_equal(read_whole(density)[:2], VALUES[:2])


def test_an_imaris_image_has_its_extents_and_no_padding(tmp_path: Path) -> None:
    path = imaris(tmp_path / "volume.ims")
    told = described(path)
    assert told.geometry.dims == DIMS and told.unit == "µm" and told.density_name == "stain 0"
    assert told.geometry.spacing == (0.5, 1.0, 3.0)
    assert told.geometry.origin == (10.25, -19.5, 6.5)  # extents are the outer faces of voxels
    np.testing.assert_array_equal(read_whole(path), VALUES.astype(np.uint16))
    coarse = described(f"{path}#level=1").geometry
    assert coarse.dims == (4, 3, 3) and coarse.spacing == (0.875, 2.0, 5.0)
    np.testing.assert_array_equal(read_whole(f"{path}#level=1"), VALUES.astype(np.uint16)[::2, ::2, ::2])
    by_path = f"{path}#/DataSet/ResolutionLevel 1/TimePoint 0/Channel 0/Data"
    assert described(by_path).geometry == coarse


def test_an_imaris_image_counted_backwards_is_not_mirrored(tmp_path: Path) -> None:
    geometry = described(imaris(tmp_path / "volume.ims", ends=(13.5, 10, -20, -14, 5, 20))).geometry
    assert geometry.index_to_physical[0] == (-0.5, 0, 0) and geometry.origin == (13.25, -19.5, 6.5)


def test_channels_and_moments_of_imaris_are_chosen(tmp_path: Path) -> None:
    path = imaris(tmp_path / "volume.ims", channels=2, times=2)
    np.testing.assert_array_equal(read_whole(f"{path}#t=1,c=1"), VALUES.astype(np.uint16) + 1100)
    with pytest.raises(BadInput, match=r"holds 2 volumes, t=0 to 1; choose, as in .*#t=0"):
        open_volume(str(path))
    with pytest.raises(BadInput, match=r"c=0 “stain 0”, c=1 “stain 1”; choose, as in .*#t=0,c=0"):
        open_volume(f"{path}#t=0")
    with pytest.raises(BadInput, match="“c=2” is beyond the last, c=1"):
        open_volume(f"{path}#t=0,c=2")


def test_channels_moments_and_resolutions_of_imaris_are_parts_one_after_another(tmp_path: Path) -> None:
    path = imaris(tmp_path / "cells.ims", channels=2, times=2)

    def parts(said: str) -> list[tuple[str, str]]:
        return [(one.part, one.told) for one in parts_of(f"{path}{said}")]

    assert [part for part, _ in parts("")] == ["t=0", "t=1"]
    assert parts("#t=1") == [("t=1,c=0", "stain 0"), ("t=1,c=1", "stain 1")]
    resolutions = [("t=1,c=0,level=0", "level 0, 7 x 6 x 5"), ("t=1,c=0,level=1", "level 1, 4 x 3 x 3")]
    assert parts("#t=1,c=0") == resolutions
    assert parts("#t=1,c=0,level=1") == []
    assert described(f"{path}#t=1,c=0,level=1").geometry.dims == (4, 3, 3)


def changed(path: Path, change: Callable[[Any], object]) -> Path:
    with h5py.File(path, "a") as file:
        change(file)
    return path


def vectors(folder: Path) -> Path:
    image = sitk.Compose(sitk.GetImageFromArray(VALUES), sitk.GetImageFromArray(VALUES))
    sitk.WriteImage(image, str(folder / "v.h5"), imageIO="HDF5ImageIO")
    return folder / "v.h5"


REFUSALS: dict[str, tuple[Callable[[Path], Path], str, str]] = {
    "ITK vectors": (vectors, "", "2 components a voxel"),
    "ITK without spacing": (
        lambda d: changed(itk(d / "v.h5"), lambda file: file["ITKImage/0"].pop("Spacing")),
        "",
        "does not tell where its voxels lie",
    ),
    "VTK mesh": (
        lambda d: changed(vtkhdf(d / "v.h5", vtk_image()), lambda f: f["VTKHDF"].attrs.update(Type=b"PolyData")),
        "",
        "holds VTK's PolyData",
    ),
    "VTK without extent": (
        lambda d: changed(vtkhdf(d / "v.h5", vtk_image()), lambda f: f["VTKHDF"].attrs.pop("WholeExtent")),
        "",
        "does not tell where its voxels lie",
    ),
    "VTK of another size": (
        lambda d: changed(
            vtkhdf(d / "v.h5", vtk_image()), lambda f: f["VTKHDF"].attrs.update(WholeExtent=[0, 1, 0, 1, 0, 1])
        ),
        "",
        "not as its extent has it",
    ),
    "VTK vectors": (lambda d: vtkhdf(d / "v.h5", vtk_image()), "#velocity", "3 components a voxel in /VTKHDF/"),
    "no such VTK array": (lambda d: vtkhdf(d / "v.h5", vtk_image()), "#speed", "PointData/density, CellData/mass"),
    "Imaris sizes": (
        lambda d: changed(
            imaris(d / "v.h5"),
            lambda f: f["DataSet/ResolutionLevel 0/TimePoint 0/Channel 0"].attrs.update(ImageSizeX=letters(9)),
        ),
        "",
        "does not tell where its voxels lie",
    ),
}


@pytest.mark.parametrize("case", REFUSALS)
def test_bad_input_is_refused_in_one_line(case: str, tmp_path: Path) -> None:
    make, part, cause = REFUSALS[case]
    path = make(tmp_path)
    with pytest.raises(BadInput) as refusal:
        read_whole(f"{path}{part}")
    assert cause in str(refusal.value) and str(path) in str(refusal.value) and "\n" not in str(refusal.value)
