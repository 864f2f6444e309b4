"""Several numbers a voxel, in VTK's files, NRRD, MetaImage and NIfTI: components and magnitude, named alike in each."""

import functools
import gzip
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import nibabel
import numpy as np
import pytest
import SimpleITK as sitk

from support.files.counted_bytes import bytes_read
from support.files.opened import described, read_whole, refused
from volsplat.mapshade_server.readers import open_volume
from volsplat.mapshade_server.readers.open_volume import parts_of
from volsplat.mapshade_server.readers.reading.part_options import index_in
from volsplat.mapshade_server.readers.reading.parts import PartNeeded
from volsplat.mapshade_server.readers.reading.volume_reader import BYTES_BESIDE, Voxels
from volsplat.protocol.description.volume import Box
from volsplat.protocol.text.errors import BadInput

vtk_xml = pytest.importorskip("vtkmodules.vtkIOXML")
vtk_legacy = pytest.importorskip("vtkmodules.vtkIOLegacy")

FLOWS = np.random.default_rng(1).normal(0, 100, (4, 5, 6, 7, 9))  # frame, k, j, i, component
BOX = Box((1, 2, 1), (5, 5, 4))
IN_BOX = (slice(1, 4), slice(2, 5), slice(1, 5))


def flow(count: int = 3, scalar_type: str = "float32") -> Voxels:
    """So many numbers a voxel; floats hold NaN and infinities."""
    values = np.ascontiguousarray(FLOWS[0, ..., :count]).astype(scalar_type)
    if values.dtype.kind == "f":
        values[1, 2, 3, 1], values[4, 5, 6, 0], values[0, 0, 0, :2] = np.nan, np.inf, (np.inf, np.nan)
    return values


def magnitude(values: Voxels) -> Voxels:
    squares = functools.reduce(np.add, [values[..., n].astype(np.float64) ** 2 for n in range(values.shape[-1])])
    return np.sqrt(squares).astype(np.result_type(values.dtype, np.float32))


def with_array(grid: Any, values: Voxels, name: str = "velocity") -> Any:
    from vtkmodules.util.numpy_support import numpy_to_vtk

    array = numpy_to_vtk(values.reshape(-1, values.shape[-1]), deep=True)
    array.SetName(name)
    grid.GetPointData().AddArray(array)
    return grid


def image(values: Voxels) -> Any:
    from vtkmodules.vtkCommonDataModel import vtkImageData

    grid = vtkImageData()
    grid.SetDimensions(*values.shape[2::-1])
    return with_array(grid, values)


def rectilinear(values: Voxels) -> Any:
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonDataModel import vtkRectilinearGrid

    grid = vtkRectilinearGrid()
    grid.SetDimensions(*values.shape[2::-1])
    for name, planes in zip("XYZ", values.shape[2::-1], strict=True):
        getattr(grid, f"Set{name}Coordinates")(numpy_to_vtk(np.arange(float(planes)), deep=True))
    return with_array(grid, values)


def by_vtk(path: Path, grid: Any, **settings: int) -> Path:
    """`settings` are setters of VTK's writer, without their Set."""
    images = grid.IsA("vtkImageData")
    if path.suffix == ".vtk":
        writer = getattr(vtk_legacy, f"vtk{'StructuredPoints' if images else 'RectilinearGrid'}Writer")()
    else:
        writer = getattr(vtk_xml, f"vtkXML{'ImageData' if images else 'RectilinearGrid'}Writer")()
    for name, value in settings.items():
        getattr(writer, f"Set{name}")(value)
    writer.SetInputData(grid)
    writer.SetFileName(str(path))
    assert writer.Write() == 1
    return path


def by_simple_itk(path: Path, values: Voxels, compressed: bool = False) -> Path:
    sitk.WriteImage(sitk.GetImageFromArray(values, isVector=True), str(path), compressed)
    return path


def nrrd(path: Path, values: Voxels, kind: str, at_end: bool = False, encoding: str = "raw") -> Path:
    """The components are along the first axis, of this kind, or one after the other along the last."""
    stored = np.moveaxis(values, -1, 0) if at_end else values
    number = {"f": "float", "i": "int", "u": "uint"}[values.dtype.kind] + str(8 * values.dtype.itemsize)
    fields = {
        "type": {"float32": "float", "float64": "double"}.get(number, number),
        "dimension": "4",
        "sizes": " ".join(str(size) for size in stored.shape[::-1]),
        "kinds": f"space space space {kind}" if at_end else f"{kind} space space space",
        "endian": "little",
        "encoding": encoding,
    }
    head = "".join(f"{name}: {field}\n" for name, field in fields.items())
    packed = gzip.compress(stored.tobytes()) if encoding == "gzip" else stored.tobytes()
    path.write_bytes(f"NRRD0004\n{head}\n".encode() + packed)
    return path


def by_nibabel(path: Path, frames: Voxels, intent: str | int = "vector") -> Path:
    """`frames` are shaped (frame, k, j, i, component)."""
    written = nibabel.Nifti1Image(frames.transpose(3, 2, 1, 0, 4), np.eye(4))
    written.header.set_intent(intent, allow_unknown=True)
    nibabel.save(written, str(path))
    return path


FILES: dict[str, Callable[[Path, Voxels], Path]] = {
    "VTK image": lambda d, v: by_vtk(d / "v.vti", image(v)),
    "VTK image, raw": lambda d, v: by_vtk(d / "v.vti", image(v), DataMode=2, EncodeAppendedData=0, CompressorType=0),
    "VTK image, blocks": lambda d, v: by_vtk(d / "v.vti", image(v), DataMode=2, EncodeAppendedData=0, BlockSize=96),
    "VTK grid": lambda d, v: by_vtk(d / "v.vtr", rectilinear(v)),
    "VTK's older image": lambda d, v: by_vtk(d / "v.vtk", image(v), FileType=2),
    "VTK's older grid": lambda d, v: by_vtk(d / "v.vtk", rectilinear(v), FileType=2),
    "MetaImage": lambda d, v: by_simple_itk(d / "v.mha", v),
    "MetaImage, zlib": lambda d, v: by_simple_itk(d / "v.mhd", v, compressed=True),
    "NRRD": lambda d, v: by_simple_itk(d / "v.nrrd", v),
    "NRRD, gzip": lambda d, v: by_simple_itk(d / "v.nrrd", v, compressed=True),
    "NRRD, components last": lambda d, v: nrrd(d / "v.nrrd", v, "vector", at_end=True),
    "NIfTI": lambda d, v: by_nibabel(d / "v.nii", v[None]),
    "NIfTI, gzip": lambda d, v: by_nibabel(d / "v.nii.gz", v[None]),
}


def before(case: str) -> str:
    """What a component's name has in front of it, and what its values' name has."""
    return "velocity," if "VTK" in case else ""


@pytest.mark.parametrize("case", FILES)
@pytest.mark.parametrize("scalar_type", ["float32", "float64", "int16", "int32"])
def test_a_vector_is_its_magnitude_or_a_component(case: str, scalar_type: str, tmp_path: Path) -> None:
    values = flow(3, scalar_type)
    path = FILES[case](tmp_path, values)
    wanted = {"": magnitude(values), f"#{before(case)}magnitude": magnitude(values)}
    wanted |= {f"#{before(case)}{name}": values[..., n] for n, name in enumerate("xyz")}
    for name, numbers in wanted.items():
        got = read_whole(f"{path}{name}")
        assert got.dtype == numbers.dtype == described(f"{path}{name}").scalar_type
        assert got.flags.c_contiguous
        np.testing.assert_array_equal(got, numbers)
        reader = open_volume(f"{path}{name}")
        np.testing.assert_array_equal(reader.read(BOX), numbers[IN_BOX])


@pytest.mark.parametrize("case", FILES)
def test_values_are_called_what_they_are_of_the_array(case: str, tmp_path: Path) -> None:
    path = FILES[case](tmp_path, flow(3))
    array = "velocity, " if "VTK" in case else ""
    assert described(path).density_name == f"{array}magnitude"
    assert described(f"{path}#{before(case)}y").density_name == f"{array}component y"


@pytest.mark.parametrize("case", FILES)
def test_the_components_are_listed_and_each_can_be_opened(case: str, tmp_path: Path) -> None:
    values = flow(2)
    path = FILES[case](tmp_path, values)
    parts = [one.part for one in parts_of(str(path))]
    assert [part.rpartition(",")[2] for part in parts] == ["magnitude", "x", "y"]
    for part, numbers in zip(parts, (magnitude(values), values[..., 0], values[..., 1]), strict=True):
        np.testing.assert_array_equal(read_whole(f"{path}#{part}"), numbers)
        assert not parts_of(f"{path}#{part}")


@pytest.mark.parametrize("case", FILES)
def test_of_more_numbers_one_must_be_chosen(case: str, tmp_path: Path) -> None:
    values = flow(6)
    path = FILES[case](tmp_path, values)
    with pytest.raises(PartNeeded, match=f"has 6 components a voxel.*choose one, as in .*#{before(case)}0") as needed:
        open_volume(str(path))
    assert [one.part for one in needed.value.parts] == [f"{before(case)}{n}" for n in range(6)]
    np.testing.assert_array_equal(read_whole(f"{path}#{before(case)}4"), values[..., 4])
    assert described(f"{path}#{before(case)}4").density_name.endswith("component 4")


@pytest.mark.parametrize("case", FILES)
def test_a_wrong_name_is_refused_with_those_that_there_are(case: str, tmp_path: Path) -> None:
    path, of = FILES[case](tmp_path, flow(3)), before(case)
    for wrong in ("w", "0", "X", "-1", "9" * 3000):
        assert f"it has {of}magnitude, {of}x, {of}y, {of}z" in refused(f"{path}#{of}{wrong}")


@pytest.mark.parametrize("case", [case for case in FILES if before(case)])
def test_a_comma_without_a_component_is_refused(case: str, tmp_path: Path) -> None:
    path = FILES[case](tmp_path, flow(3))
    assert "has no component “velocity,”; it has velocity,magnitude" in refused(f"{path}#velocity,")


@pytest.mark.parametrize("case", FILES)
def test_a_huge_count_is_refused(case: str, tmp_path: Path) -> None:
    path = FILES[case](tmp_path, np.zeros((1, 2, 2, 1500), np.int16))
    named = f"{path}#velocity" if before(case) else path
    assert "1500 components a voxel, 0 to 1499, volsplat reads no more than 1024" in refused(named)
    assert "1500 components" in refused(path)


@pytest.mark.parametrize("case", FILES)
@pytest.mark.parametrize("count", [3, 4])
def test_bytes_are_colours(case: str, count: int, tmp_path: Path) -> None:
    path = FILES[case](tmp_path, np.zeros((5, 6, 7, count), np.uint8))
    line = refused(path)
    assert "volsplat needs one number a voxel" in line and f"{count} c" in line


@pytest.mark.parametrize("kind", ["vector", "covariant-vector", "normal", "3-vector", "3-gradient", "3-normal"])
def test_every_kind_of_vector_in_nrrd_is_one(kind: str, tmp_path: Path) -> None:
    path = nrrd(tmp_path / "v.nrrd", flow(3), kind)
    np.testing.assert_array_equal(read_whole(path), magnitude(flow(3)))
    np.testing.assert_array_equal(read_whole(f"{path}#z"), flow(3)[..., 2])


def test_components_that_are_packed_one_after_the_other_are_unpacked_once_each(tmp_path: Path) -> None:
    values = np.random.default_rng(1).random((64, 32, 32, 3), np.float32)
    path = nrrd(tmp_path / "v.nrrd", values, "vector", at_end=True, encoding="gzip")
    reader = open_volume(str(path))
    box, before = reader.description.geometry.box, bytes_read()
    np.testing.assert_array_equal(reader.read(box), magnitude(values))
    assert bytes_read() - before < 3 * path.stat().st_size


def test_one_of_many_components_is_taken_without_all_of_them_in_memory(tmp_path: Path) -> None:
    """However thin the sheets are."""
    values = np.random.default_rng(1).integers(0, 99, (1000, 4, 4, 256)).astype(np.float32)
    reader = open_volume(f"{nrrd(tmp_path / 'v.nrrd', values, 'list')}#200")
    tracemalloc.start()
    try:
        voxels = reader.read(reader.description.geometry.box)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    np.testing.assert_array_equal(voxels, values[..., 200])
    assert peak < voxels.nbytes + 2 * BYTES_BESIDE < values.nbytes / 3


@pytest.mark.parametrize("kind", ["RGB-color", "HSV-color", "point", "list"])
def test_what_is_no_vector_in_nrrd_goes_by_numbers(kind: str, tmp_path: Path) -> None:
    values = flow(3)
    path = nrrd(tmp_path / "v.nrrd", values, kind)
    with pytest.raises(PartNeeded, match="choose one, as in .*#0") as needed:
        open_volume(str(path))
    assert [one.part for one in needed.value.parts] == ["0", "1", "2"]
    np.testing.assert_array_equal(read_whole(f"{path}#1"), values[..., 1])
    assert described(f"{path}#1").density_name == ("value" if kind == "list" else "component 1")
    assert "are numbered 0 to 2" in refused(f"{path}#x")


def test_a_frame_and_a_component_are_named_together(tmp_path: Path) -> None:
    frames = FLOWS[..., :3].astype(np.int16)
    path = by_nibabel(tmp_path / "v.nii", frames)
    with pytest.raises(PartNeeded, match="series of 4 volumes"):
        open_volume(str(path))
    np.testing.assert_array_equal(read_whole(f"{path}#2"), magnitude(frames[2]))
    np.testing.assert_array_equal(read_whole(f"{path}#2,y"), frames[2, ..., 1])
    assert "no component “2,w”; it has 2,magnitude, 2,x" in refused(f"{path}#2,w")
    assert "no component “2,”; it has 2,magnitude, 2,x" in refused(f"{path}#2,")
    assert [one.part for one in parts_of(f"{path}#2")] == ["2,magnitude", "2,x", "2,y", "2,z"]
    assert not parts_of(f"{path}#2,y")


@pytest.mark.parametrize("said", ["4", "9" * 3000, "-1", "2x"])
def test_a_frame_that_is_none_is_refused(said: str, tmp_path: Path) -> None:
    for count in (1, 3):
        path = by_nibabel(tmp_path / "v.nii", FLOWS[..., :count].astype(np.int16))
        assert f"its volumes are numbered 0 to 3; “{said}” is none of them" in refused(f"{path}#{said}")


def test_the_number_of_a_frame_may_begin_with_zeros(tmp_path: Path) -> None:
    for count in (1, 3):
        path = by_nibabel(tmp_path / "v.nii", FLOWS[..., :count].astype(np.int16))
        np.testing.assert_array_equal(read_whole(f"{path}#002"), read_whole(f"{path}#2"))


def test_digits_that_python_refuses_to_read_are_no_number() -> None:
    with pytest.raises(BadInput, match="is none of them"):
        index_in(Path("v.nii"), "9" * 5000, 4, "volumes")


@pytest.mark.parametrize("extension", ["mha", "nii", "nrrd"])
@pytest.mark.parametrize("compressed", [False, True])
def test_a_series_of_vectors_that_itk_joins_is_taken_apart(extension: str, compressed: bool, tmp_path: Path) -> None:
    frames = FLOWS[..., :3].astype(np.int16)
    path = tmp_path / f"v.{extension}"
    series = sitk.JoinSeries([sitk.GetImageFromArray(frame, isVector=True) for frame in frames])
    sitk.WriteImage(series, str(path), compressed)
    with pytest.raises(PartNeeded, match="series of 4 volumes"):
        open_volume(str(path))
    assert [one.part for one in parts_of(f"{path}#2")] == ["2,magnitude", "2,x", "2,y", "2,z"]
    np.testing.assert_array_equal(open_volume(f"{path}#2,x").read(BOX), frames[2, ..., 0][IN_BOX])
    np.testing.assert_array_equal(read_whole(f"{path}#3"), magnitude(frames[3]))
    np.testing.assert_array_equal(read_whole(f"{path}#1,z"), frames[1, ..., 2])


@pytest.mark.parametrize(("scalar_type", "kind"), [(np.uint8, b"vector"), (np.int16, b"3D-matrix")])
def test_a_series_in_nrrd_of_what_is_no_vector_is_refused(scalar_type: type, kind: bytes, tmp_path: Path) -> None:
    path = tmp_path / "v.nrrd"
    series = sitk.JoinSeries([sitk.GetImageFromArray(np.zeros((5, 6, 7, 3), scalar_type), isVector=True)] * 4)
    sitk.WriteImage(series, str(path))
    path.write_bytes(path.read_bytes().replace(b"kinds: vector", b"kinds: " + kind))
    for part in ("", "#0", "#0,x"):
        assert "axes of 3 and 4 values that are not axes of space" in refused(f"{path}{part}")


def test_components_are_scaled_before_their_magnitude_is_taken(tmp_path: Path) -> None:
    stored = flow(3, "int16")
    path = by_nibabel(tmp_path / "v.nii", stored[None])
    raw = bytearray(path.read_bytes())
    raw[112:120] = np.array([0.5, 3], "<f4").tobytes()
    path.write_bytes(raw)
    scaled = (stored * 0.5 + 3).astype(np.float32)
    np.testing.assert_array_equal(read_whole(path), magnitude(scaled))


def test_scalars_go_before_vectors_which_are_listed_with_them(tmp_path: Path) -> None:
    density = np.arange(5 * 6 * 7, dtype=np.int16).reshape(5, 6, 7, 1)
    path = by_vtk(tmp_path / "v.vti", with_array(image(flow(3)), density, "density"))
    np.testing.assert_array_equal(read_whole(path), density[..., 0])
    velocity = [f"PointData/velocity,{name}" for name in ("magnitude", "x", "y", "z")]
    assert sorted(one.part for one in parts_of(str(path))) == ["PointData/density", *velocity]
    np.testing.assert_array_equal(read_whole(f"{path}#velocity"), magnitude(flow(3)))


def test_one_of_several_vectors_must_be_named(tmp_path: Path) -> None:
    path = by_vtk(tmp_path / "v.vti", with_array(image(flow(3)), flow(2), "vorticity"))
    with pytest.raises(PartNeeded, match="velocity.*vorticity") as needed:
        open_volume(str(path))
    names = [f"velocity,{name}" for name in ("magnitude", "x", "y", "z")]
    assert [one.part for one in needed.value.parts] == [*names, *(f"vorticity,{n}" for n in ("magnitude", "x", "y"))]


def test_text_is_taken_apart_too(tmp_path: Path) -> None:
    values = flow(3, "int32")
    for path in (
        by_vtk(tmp_path / "v.vti", image(values), DataMode=0),
        by_vtk(tmp_path / "v.vtk", image(values), FileType=1),
    ):
        np.testing.assert_array_equal(read_whole(path), magnitude(values))
        np.testing.assert_array_equal(read_whole(f"{path}#velocity,y"), values[..., 1])


def test_colours_by_intent_are_no_vector(tmp_path: Path) -> None:
    path = by_nibabel(tmp_path / "v.nii", flow(3)[None], 2003)
    assert "3 components a voxel, which are colours" in refused(path)


@pytest.mark.parametrize("intent", [1006, 1007, 2006])
def test_a_fourth_axis_of_nifti_is_of_components_if_its_intent_says_so(intent: int, tmp_path: Path) -> None:
    path = tmp_path / "warp.nii.gz"
    written = nibabel.Nifti1Image(flow(3).transpose(2, 1, 0, 3), np.eye(4))
    written.header.set_intent(intent, allow_unknown=True)
    nibabel.save(written, str(path))
    np.testing.assert_array_equal(read_whole(path), magnitude(flow(3)))
    np.testing.assert_array_equal(read_whole(f"{path}#y"), flow(3)[..., 1])


def test_a_statistic_with_its_parameters_is_no_vector(tmp_path: Path) -> None:
    path = by_nibabel(tmp_path / "v.nii", flow(2)[None], "t test")
    assert "a statistic with its parameters" in refused(path)


@pytest.mark.parametrize("stated", ["0", "-3", "three", "99999999999999999999"])
def test_a_count_that_makes_no_sense_is_refused(stated: str, tmp_path: Path) -> None:
    path = by_simple_itk(tmp_path / "v.mha", flow(3))
    raw = path.read_bytes()
    path.write_bytes(raw.replace(b"ElementNumberOfChannels = 3", f"ElementNumberOfChannels = {stated}".encode()))
    assert f'"ElementNumberOfChannels = {stated}" cannot be used' in refused(path)


def test_a_vector_that_the_file_cannot_hold_is_refused(tmp_path: Path) -> None:
    path = by_simple_itk(tmp_path / "v.mha", flow(3))
    raw = path.read_bytes()
    path.write_bytes(raw.replace(b"ElementNumberOfChannels = 3", b"ElementNumberOfChannels = 900"))
    assert "promises 756000 bytes" in refused(f"{path}#0")
