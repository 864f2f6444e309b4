"""VTK's older files (.vtk), rectilinear grids (.vtr) and values of cells: as VTK writes them, where VTK has them."""

import itertools
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import SimpleITK as sitk

import tolerances
from support.files.counted_bytes import bytes_read
from support.files.opened import described, read_whole, refused
from support.files.refusals import assert_refused_in_one_line
from support.files.volume_files import ALL_TYPES, DIMS, values_of
from volsplat.mapshade_server.readers import open_volume
from volsplat.mapshade_server.readers.reading.volume_reader import Voxels
from volsplat.protocol.description.volume import Box
from volsplat.protocol.text.errors import BadInput

vtk_legacy = pytest.importorskip("vtkmodules.vtkIOLegacy")
vtk_xml = pytest.importorskip("vtkmodules.vtkIOXML")

EVEN = tuple(np.arange(n) * step + first for n, step, first in zip(DIMS, (0.5, 1.25, 3), (10, -20, 30), strict=True))
UNEVEN = (np.array([0, 1, 2, 4, 8, 9, 10.0]), EVEN[1], np.array([5, 4.5, 4, 3, 2.0]))
CELLS = np.arange(6 * 5 * 4, dtype=np.float32).reshape(4, 5, 6)


def with_arrays(grid: Any, values: Voxels) -> Any:
    """The grid with scalars and vectors of its points and scalars of its cells."""
    from vtkmodules.util.numpy_support import numpy_to_vtk

    velocity = np.zeros((values.size, 3), np.float32)
    for data, name, numbers in (
        (grid.GetPointData(), "velocity", velocity),
        (grid.GetPointData(), "a density", values.ravel()),
        (grid.GetPointData(), "other", values.ravel()),
        (grid.GetCellData(), "mass", CELLS.ravel()),
        (grid.GetFieldData(), "said before", np.arange(5.0)),
    ):
        array = numpy_to_vtk(numbers, deep=True)
        array.SetName(name)
        data.AddArray(array)
    grid.GetPointData().SetActiveScalars("a density")
    return grid


def image(values: Voxels) -> Any:
    from vtkmodules.vtkCommonDataModel import vtkImageData

    grid = vtkImageData()
    grid.SetDimensions(*DIMS)
    grid.SetSpacing(0.5, 1.25, 3)
    grid.SetOrigin(10, -20, 30)
    return with_arrays(grid, values)


def rectilinear(values: Voxels, places: Any = EVEN) -> Any:
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonDataModel import vtkRectilinearGrid

    grid = vtkRectilinearGrid()
    grid.SetDimensions(*DIMS)
    for set_, one in zip((grid.SetXCoordinates, grid.SetYCoordinates, grid.SetZCoordinates), places, strict=True):
        set_(numpy_to_vtk(np.ascontiguousarray(one), deep=True))
    return with_arrays(grid, values)


def legacy(path: Path, grid: Any, binary: bool = True) -> Path:
    kind = "StructuredPoints" if grid.IsA("vtkImageData") else "RectilinearGrid"
    writer = getattr(vtk_legacy, f"vtk{kind}Writer")()
    writer.SetFileType(2 if binary else 1)
    return written(path, grid, writer)


def xml(path: Path, grid: Any, mode: int = 2, compressor: bool = True) -> Path:
    """`mode` is 0 for text, 1 for base64, 2 for appended raw numbers."""
    kind = "ImageData" if grid.IsA("vtkImageData") else "RectilinearGrid"
    writer = getattr(vtk_xml, f"vtkXML{kind}Writer")()
    writer.SetDataMode(mode)
    writer.SetEncodeAppendedData(0)
    if not compressor:
        writer.SetCompressor(None)
    return written(path, grid, writer)


def written(path: Path, grid: Any, writer: Any) -> Path:
    writer.SetInputData(grid)
    writer.SetFileName(str(path))
    assert writer.Write() == 1
    return path


def finite(values: Voxels) -> Voxels:
    """VTK writes NaN as text that it cannot read itself."""
    return np.nan_to_num(values, nan=0.0, posinf=1.0, neginf=2.0) if values.dtype.kind == "f" else values


WAYS: dict[str, tuple[str, Callable[[Voxels], Any], Callable[[Path, Any], Path]]] = {
    "legacy image": ("v.vtk", image, legacy),
    "legacy image as text": ("v.vtk", image, lambda path, grid: legacy(path, grid, binary=False)),
    "legacy rectilinear": ("v.vtk", rectilinear, legacy),
    "legacy rectilinear as text": ("v.vtk", rectilinear, lambda path, grid: legacy(path, grid, binary=False)),
    "rectilinear as text": ("v.vtr", rectilinear, lambda path, grid: xml(path, grid, 0)),
    "rectilinear in base64": ("v.vtr", rectilinear, lambda path, grid: xml(path, grid, 1)),
    "rectilinear, raw": ("v.vtr", rectilinear, lambda path, grid: xml(path, grid, 2, compressor=False)),
    "rectilinear, compressed": ("v.vtr", rectilinear, xml),
    "image": ("v.vti", image, xml),
}


def written_as(way: str, folder: Path, values: Voxels, changed_by: Callable[[Any], Any] = lambda grid: grid) -> Path:
    name, make, write = WAYS[way]
    return write(folder / name, changed_by(make(values)))


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("scalar_type", ALL_TYPES)
def test_every_type_comes_back_where_vtk_has_it(scalar_type: str, way: str, tmp_path: Path) -> None:
    values = finite(values_of(scalar_type))
    path = written_as(way, tmp_path, values)
    reader = open_volume(str(path))
    told = reader.description
    assert (told.scalar_type, told.density_name, told.warnings) == (scalar_type, "a density", ())
    assert told.geometry.index_to_physical == ((0.5, 0, 0), (0, 1.25, 0), (0, 0, 3))
    assert told.geometry.origin == (10, -20, 30)
    got = read_whole(path)
    assert got.dtype == told.scalar_type and got.dtype.isnative and got.flags.c_contiguous
    np.testing.assert_allclose(got, values, rtol=tolerances.SIX_DIGITS if "text" in way else 0)
    for low, high in itertools.product(((0, 0, 0), (2, 1, 3)), ((7, 6, 5), (5, 2, 4))):
        part = reader.read(Box(low, high))
        assert part.flags.c_contiguous
        np.testing.assert_array_equal(part, got[low[2] : high[2], low[1] : high[1], low[0] : high[0]])


@pytest.mark.parametrize("way", WAYS)
def test_cells_lie_between_the_points(way: str, tmp_path: Path) -> None:
    path = written_as(way, tmp_path, values_of("int16"))
    for part in ("mass", "CellData/mass"):
        told = described(f"{path}#{part}")
        assert told.geometry.dims == (6, 5, 4) and told.geometry.origin == (10.25, -19.375, 31.5)
        assert told.geometry.index_to_physical == ((0.5, 0, 0), (0, 1.25, 0), (0, 0, 3))
        assert told.format.endswith("values of cells")
        np.testing.assert_array_equal(read_whole(f"{path}#{part}"), CELLS)


def test_cells_alone_need_no_name_and_flat_ones_lie_on_the_points(tmp_path: Path) -> None:
    grid = image(values_of("int16"))
    grid.SetDimensions(7, 6, 1)
    for name in ("velocity", "a density", "other"):
        grid.GetPointData().RemoveArray(name)
    grid.GetCellData().GetArray("mass").SetNumberOfTuples(30)
    for path in (xml(tmp_path / "v.vti", grid), legacy(tmp_path / "v.vtk", grid)):
        told = described(path)
        assert told.geometry.dims == (6, 5, 1) and told.geometry.origin == (10.25, -19.375, 30)
        np.testing.assert_array_equal(read_whole(path), CELLS[:1])


def ramp(places: Any) -> Voxels:
    """Linear along each axis, so that interpolation gives it exactly."""
    x, y, z = places
    values: Voxels = (2 * x + 3 * y[:, None] - z[:, None, None] + 100).astype(np.float64)
    return values


@pytest.mark.parametrize("write", [legacy, xml])
def test_uneven_planes_are_resampled_and_that_is_told(write: Callable[..., Path], tmp_path: Path) -> None:
    path = write(tmp_path / "v.vtk", rectilinear(ramp(UNEVEN), UNEVEN))
    told = described(path)
    assert told.warnings == (
        "x is unevenly spaced (1 to 4): resampled to 1",
        "z is unevenly spaced (0.5 to 1): resampled to 0.5",
    )
    assert told.geometry.dims == (11, 6, 7) and told.geometry.origin == (0, -20, 5)
    assert told.geometry.index_to_physical == ((1, 0, 0), (0, 1.25, 0), (0, 0, -0.5))  # z goes down: not mirrored
    even = (np.arange(11.0), EVEN[1], 5 - 0.5 * np.arange(7))
    whole = read_whole(path)
    np.testing.assert_allclose(whole, ramp(even))
    part = open_volume(str(path)).read(Box((3, 2, 1), (8, 5, 6)))
    np.testing.assert_array_equal(part, whole[1:6, 2:5, 3:8])


def test_uneven_cells_are_resampled_between_their_middles(tmp_path: Path) -> None:
    told = described(f"{legacy(tmp_path / 'v.vtk', rectilinear(ramp(UNEVEN), UNEVEN))}#mass")
    assert told.geometry.origin == (0.5, -19.375, 4.75) and told.geometry.spacing[0] == 1
    assert told.geometry.dims[0] == 10


def test_planes_are_not_multiplied_without_bound(tmp_path: Path) -> None:
    stretched = (np.array([0, 1e-6, 1, 2, 3, 4, 5.0]), EVEN[1], EVEN[2])
    told = described(legacy(tmp_path / "v.vtk", rectilinear(values_of("int16"), stretched)))
    assert told.geometry.dims[0] <= 4 * DIMS[0] + 1 and "1e-06 to 1" in told.warnings[0]


def test_nan_reaches_no_further_than_its_neighbours(tmp_path: Path) -> None:
    values = ramp(UNEVEN)
    values[2, 2, 2] = np.nan
    whole = read_whole(legacy(tmp_path / "v.vtk", rectilinear(values, UNEVEN)))
    assert np.argwhere(np.isnan(whole)).tolist() == [[k, 2, i] for k in (2, 3) for i in (2, 3)]


def test_coordinates_in_single_precision_are_even(tmp_path: Path) -> None:
    places = tuple((1000 + 0.1 * np.arange(n)).astype(np.float32) for n in DIMS)
    assert described(legacy(tmp_path / "v.vtk", rectilinear(values_of("uint8"), places))).warnings == ()


TEXTS = ("short", "", "two words", "of\ntwo lines", "x" * 63, "x" * 64, "y" * 20_000)


@pytest.mark.parametrize("binary", [True, False], ids=["binary", "text"])
def test_numbers_behind_texts_are_found(binary: bool, tmp_path: Path) -> None:
    from vtkmodules.vtkCommonCore import vtkStringArray

    values = values_of("int16")
    grid = image(values)
    for data, count in ((grid.GetFieldData(), len(TEXTS)), (grid.GetPointData(), values.size)):
        texts = vtkStringArray()
        texts.SetName("texts")
        for n in range(count):
            texts.InsertNextValue(TEXTS[n % len(TEXTS)])
        data.AddArray(texts)
    path = legacy(tmp_path / "v.vtk", grid, binary)
    np.testing.assert_array_equal(read_whole(path), values)
    np.testing.assert_array_equal(read_whole(f"{path}#mass"), CELLS)
    assert "texts" not in str(open_volume(str(path)).parts)
    path.write_bytes(path.read_bytes()[:9000])
    assert "truncated or damaged" in refused(path)


GHOSTS = "vtkGhostType"


def hiding(grid: Any) -> Any:
    """The grid with every fifth point, and every third cell, hidden; others are only of two pieces, as VTK has it."""
    from vtkmodules.util.numpy_support import numpy_to_vtk

    for data, every, hidden in ((grid.GetPointData(), 5, 2), (grid.GetCellData(), 3, 32)):
        ghosts = np.ones(data.GetArray(0).GetNumberOfTuples(), np.uint8)
        ghosts[::every] |= hidden
        array = numpy_to_vtk(ghosts, deep=True)
        array.SetName(GHOSTS)
        data.AddArray(array)
    return grid


@pytest.mark.parametrize("scalar_type", ["uint8", "int32", "float32"])
@pytest.mark.parametrize("way", WAYS)
def test_what_the_file_hides_is_no_data(way: str, scalar_type: str, tmp_path: Path) -> None:
    values = finite(values_of(scalar_type))
    drawn = read_whole(written_as(way, tmp_path, values)).astype(np.float64)
    path = written_as(way, tmp_path, values, hiding)
    drawn.ravel()[::5] = np.nan
    drawn[:, :, 0] = np.nan  # whose cells are all hidden
    np.testing.assert_array_equal(read_whole(path), drawn)
    assert described(path).scalar_type == {"int32": "float64"}.get(scalar_type, "float32")
    cells = CELLS.copy()
    cells.ravel()[::3] = np.nan
    np.testing.assert_array_equal(read_whole(f"{path}#mass"), cells)
    box = Box((2, 1, 3), (5, 2, 4))
    np.testing.assert_array_equal(open_volume(str(path)).read(box), drawn[3:4, 1:2, 2:5])


def doubled(grid: Any) -> Any:
    """The grid as ParaView writes a piece: what other pieces hold too is told, and nothing is hidden."""
    hiding(grid)
    for data in (grid.GetPointData(), grid.GetCellData()):
        ghosts = data.GetArray(GHOSTS)
        for n in range(ghosts.GetNumberOfTuples()):
            ghosts.SetValue(n, n % 2)
    return grid


@pytest.mark.parametrize("scalar_type", ["uint8", "int32", "float32"])
@pytest.mark.parametrize("way", WAYS)
def test_ghosts_that_hide_nothing_leave_the_values_as_they_are(way: str, scalar_type: str, tmp_path: Path) -> None:
    values = finite(values_of(scalar_type))
    plain = written_as(way, tmp_path, values)
    drawn = read_whole(plain)
    path = written_as(way, tmp_path, values, doubled)
    np.testing.assert_array_equal(read_whole(path), drawn)
    assert described(path).scalar_type == scalar_type


def test_what_is_hidden_is_no_array_to_choose(tmp_path: Path) -> None:
    grid = hiding(image(values_of("int16")))
    for name in ("velocity", "a density"):
        grid.GetPointData().RemoveArray(name)
    for path in (xml(tmp_path / "v.vti", grid), legacy(tmp_path / "v.vtk", grid)):
        assert described(path).density_name == "other"
        assert {part.part for part in open_volume(str(path)).parts} == {"PointData/other", "CellData/mass"}


def test_simple_itk_writes_what_is_read(tmp_path: Path) -> None:
    values = values_of("int16")
    volume = sitk.GetImageFromArray(values)
    volume.SetSpacing((0.5, 1.25, 3))
    volume.SetOrigin((10, -20, 30))
    sitk.WriteImage(volume, str(tmp_path / "v.vtk"))
    assert described(tmp_path / "v.vtk").geometry.origin == (10, -20, 30)
    np.testing.assert_array_equal(read_whole(tmp_path / "v.vtk"), values)


HAND_WRITTEN = """# vtk DataFile Version 2.0
made by hand
ascii
DATASET STRUCTURED_POINTS
dimensions 2 2 2
ASPECT_RATIO 1 2 3
ORIGIN 0 0 0

POINT_DATA 8
SCALARS first float
LOOKUP_TABLE mine
0 1 2
3 4 5 6 7
LOOKUP_TABLE mine 2
0 0 0 1 1 1 1 1
VECTORS flow float
0 0 0 0 0 0 0 0 0 0 0 0
0 0 0 0 0 0 0 0 0 0 0 0
SCALARS second int 1
LOOKUP_TABLE default
7 6 5 4 3 2 1 0
"""


def test_what_others_write_by_hand_is_read(tmp_path: Path) -> None:
    path = tmp_path / "v.vtk"
    path.write_text(HAND_WRITTEN)
    np.testing.assert_array_equal(read_whole(path).ravel(), np.arange(8))
    np.testing.assert_array_equal(read_whole(f"{path}#second").ravel(), np.arange(8)[::-1])
    assert described(path).geometry.spacing == (1, 2, 3)


def test_only_the_rows_of_a_box_are_read(tmp_path: Path) -> None:
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonDataModel import vtkImageData

    grid = vtkImageData()
    grid.SetDimensions(128, 128, 128)
    values = numpy_to_vtk(np.zeros(128**3, np.uint16), deep=True)
    values.SetName("density")
    grid.GetPointData().SetScalars(values)
    path = legacy(tmp_path / "v.vtk", grid)
    reader = open_volume(str(path))
    assert reader.description.reads_sub_cubes
    before = bytes_read()
    reader.read(Box((0, 32, 64), (128, 96, 72)))
    assert bytes_read() - before < 128 * 64 * 8 * 2 + 65536


def changed(path: Path, old: bytes, new: bytes) -> Path:
    raw = path.read_bytes()
    assert old in raw
    path.write_bytes(raw.replace(old, new, 1))
    return path


def by_hand(folder: Path, old: str = "", new: str = "") -> Path:
    path = folder / "v.vtk"
    path.write_text(HAND_WRITTEN)
    return changed(path, old.encode(), new.encode()) if old else path


def cut(path: Path, share: float) -> Path:
    raw = path.read_bytes()
    path.write_bytes(raw[: int(len(raw) * share)])
    return path


def listing(folder: Path, kind: str, files: str) -> Path:
    path = folder / "list.xml"
    path.write_text(f'<?xml version="1.0"?><VTKFile type="{kind}" version="0.1"><{kind}>{files}</{kind}></VTKFile>')
    return path


INT = values_of("int32")
REFUSALS: dict[str, tuple[Callable[[Path], Path], str]] = {
    "mesh": (lambda d: by_hand(d, "STRUCTURED_POINTS", "POLYDATA"), "holds VTK's POLYDATA, volsplat reads"),
    "neither text nor binary": (lambda d: by_hand(d, "ascii", "both"), "neither ASCII nor BINARY"),
    "truncated text": (lambda d: by_hand(d, "7 6 5 4 3 2 1 0", "7 6 5"), "second states 8 numbers, but 3 follow"),
    "truncated": (lambda d: cut(legacy(d / "v.vtk", image(INT)), 0.6), "is truncated or damaged"),
    "no word": (lambda d: by_hand(d, "VECTORS", "ARROWS"), "“ARROWS” at byte"),
    "no number": (lambda d: by_hand(d, "2 2 2", "2 x 2"), "has not the numbers that it should"),
    "another count": (lambda d: by_hand(d, "POINT_DATA 8", "POINT_DATA 4"), "no word of this format"),
    "another size": (lambda d: by_hand(d, "2 2 2", "2 2 9"), "first has 8 values for 2 x 2 x 9"),
    "no points": (lambda d: by_hand(d, "2 2 2", "2 0 2"), "or none with points"),
    "absurd size": (
        lambda d: changed(legacy(d / "v.vtk", image(INT)), b"POINT_DATA 210", b"POINT_DATA 2100000000000"),
        "states 2100000000000 values",
    ),
    "text as number": (lambda d: by_hand(d, "3 4 5", "3 four 5"), "are not all numbers of type float32"),
    "a series": (
        lambda d: listing(d, "Collection", '<DataSet timestep="0" file="a.vti"/><DataSet timestep="1" file="b.vti"/>'),
        "holds VTK's Collection, a list of 2 files; give one of them, as ",
    ),
    "an image in pieces": (
        lambda d: listing(d, "PImageData", '<Piece Extent="0 1 0 1 0 1" Source="a_0.vti"/>'),
        "list.xml: holds VTK's PImageData, a list of 1 file; give it: ",
    ),
    "an image in several pieces": (
        lambda d: listing(d, "PImageData", '<Piece Source="a_0.vti"/><Piece Source="a_1.vti"/>'),
        "holds VTK's PImageData, one grid in 2 files; save it as one .vti",
    ),
    "a rectilinear grid in several pieces": (
        lambda d: listing(d, "PRectilinearGrid", '<Piece Source="a_0.vtr"/><Piece Source="a_1.vtr"/>'),
        "one grid in 2 files; save it as one .vtr",
    ),
    "a series of names on two lines": (
        lambda d: listing(d, "Collection", '<DataSet file="a&#10;b.vti"/><DataSet file="b.vti"/>'),
        "a?b.vti",
    ),
    "blocks": (
        lambda d: listing(d, "vtkMultiBlockDataSet", '<DataSet index="0" file="a.vti"/><DataSet file="b.vti"/>'),
        "a list of 2 files; give one of them, as ",
    ),
    "meshes": (
        lambda d: listing(d, "vtkMultiBlockDataSet", '<DataSet index="0" file="a.vtp"/>'),
        "holds VTK's vtkMultiBlockDataSet, volsplat reads ImageData; resample",
    ),
    "planes to and fro": (
        lambda d: legacy(d / "v.vtk", rectilinear(INT, (np.array([0, 1, 2, 3, 2, 5, 6.0]), *EVEN[1:]))),
        "its x coordinates do not go one way",
    ),
    "planes in .vtr": (
        lambda d: xml(d / "v.vtr", rectilinear(INT, (EVEN[0], EVEN[1], np.array([0, 1, np.nan, 3, 4])))),
        "its z coordinates do not go one way",
    ),
    "no planes": (
        lambda d: changed(xml(d / "v.vtr", rectilinear(INT), 1), b"<Coordinates>", b"<FieldData  >"),
        "truncated or damaged",
    ),
}


@pytest.mark.parametrize("case", REFUSALS)
def test_bad_input_is_refused_in_one_line(case: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    make, cause = REFUSALS[case]
    assert_refused_in_one_line(read_whole, make(tmp_path), cause, capfd)


def test_any_truncation_of_a_file_is_refused_or_loses_no_voxel(tmp_path: Path) -> None:
    path = legacy(tmp_path / "v.vtk", rectilinear(INT))
    raw = path.read_bytes()
    for share in range(1, 40):
        path.write_bytes(raw[: len(raw) * share // 40])
        try:
            values = read_whole(f"{path}#a density")
        except BadInput as refusal:
            assert "\n" not in str(refusal)
        else:
            np.testing.assert_array_equal(values, INT)


def test_which_arrays_there_are_is_told(tmp_path: Path) -> None:
    path = legacy(tmp_path / "v.vtk", rectilinear(INT))
    with pytest.raises(BadInput) as refusal:
        open_volume(f"{path}#speed")
    assert re.search(r"has no array “speed”; it has mass \(of cells\), .*a density", str(refusal.value))
    with pytest.raises(BadInput, match="has no component “velocity,w”; it has velocity,magnitude, velocity,x"):
        open_volume(f"{path}#velocity,w")
