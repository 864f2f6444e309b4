"""VTK's XML images: what VTK writes in each of its ways comes back where VTK has it, and bombs are refused."""

import gzip
import itertools
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import tolerances
from support.files.counted_bytes import bytes_read
from support.files.opened import read_whole
from support.files.refusals import assert_refused_in_one_line
from support.files.volume_files import ALL_TYPES, values_of
from volsplat.mapshade_server.readers import open_volume
from volsplat.mapshade_server.readers.reading.volume_reader import Voxels
from volsplat.protocol.description.volume import Box
from volsplat.protocol.text.errors import BadInput

vtk_io = pytest.importorskip("vtkmodules.vtkIOXML")
vtk_compressors = pytest.importorskip("vtkmodules.vtkIOCore")

ASCII, BINARY, APPENDED = 0, 1, 2
EXTENT_LOW = (2, -1, 3)
TURNED = (0, 1, 0, -1, 0, 0, 0, 0, 1)


def image_of(**arrays: Voxels) -> Any:
    """A vtkImageData of these arrays of points; the first is the active one, vectors have four axes."""
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonDataModel import vtkImageData

    image = vtkImageData()
    first = next(iter(arrays.values()))
    nk, nj, ni = first.shape[:3]
    i, j, k = EXTENT_LOW
    image.SetExtent(i, i + ni - 1, j, j + nj - 1, k, k + nk - 1)
    image.SetSpacing(0.5, 1.25, 3)
    image.SetOrigin(10, -20.5, 30)
    image.SetDirectionMatrix(*TURNED)
    for name, values in arrays.items():
        array = numpy_to_vtk(values.reshape(ni * nj * nk, -1), deep=True)
        array.SetName(name)
        image.GetPointData().AddArray(array)
    image.GetPointData().SetActiveScalars(next(iter(arrays)))
    return image


def written(path: Path, image: Any, mode: int = APPENDED, compressor: str = "", **settings: int) -> Path:
    """`settings` are setters of VTK's writer, without their Set."""
    writer = vtk_io.vtkXMLImageDataWriter()
    writer.SetInputData(image)
    writer.SetDataMode(mode)
    writer.SetCompressor(getattr(vtk_compressors, f"vtk{compressor}DataCompressor")() if compressor else None)
    for name, value in settings.items():
        getattr(writer, f"Set{name}")(value)
    writer.SetFileName(str(path))
    assert writer.Write() == 1
    return path


RAW = {"EncodeAppendedData": 0}
WAYS: dict[str, tuple[int, str, dict[str, int]]] = {
    "text": (ASCII, "", {}),
    "base64": (BINARY, "", {}),
    "compressed base64": (BINARY, "ZLib", {}),
    "small blocks in base64": (BINARY, "ZLib", {"BlockSize": 64}),
    "appended base64": (APPENDED, "", {}),
    "appended compressed base64": (APPENDED, "ZLib", {"BlockSize": 64}),
    "appended raw": (APPENDED, "", RAW),
    "appended raw with long lengths": (APPENDED, "", {**RAW, "HeaderType": 64}),
    "appended compressed": (APPENDED, "ZLib", RAW),
    "appended small blocks": (APPENDED, "ZLib", {**RAW, "BlockSize": 64, "HeaderType": 64}),
    "appended LZMA": (APPENDED, "LZMA", {**RAW, "BlockSize": 128}),
    "appended LZ4": (APPENDED, "LZ4", RAW),
    "big endian text": (ASCII, "", {"ByteOrder": 0}),
    "big endian base64": (BINARY, "ZLib", {"ByteOrder": 0, "BlockSize": 64}),
    "big endian raw": (APPENDED, "", {**RAW, "ByteOrder": 0}),
    "big endian raw blocks": (APPENDED, "ZLib", {**RAW, "ByteOrder": 0, "BlockSize": 64}),
}


def finite(values: Voxels) -> Voxels:
    """VTK writes NaN as text that it cannot read itself."""
    return np.nan_to_num(values, nan=0.0, posinf=1.0, neginf=2.0) if values.dtype.kind == "f" else values


@pytest.mark.parametrize("way", [way for way in WAYS if "LZ4" not in way])
@pytest.mark.parametrize("scalar_type", ALL_TYPES)
def test_every_type_comes_back_from_every_way_of_storing(scalar_type: str, way: str, tmp_path: Path) -> None:
    mode, compressor, settings = WAYS[way]
    values = finite(values_of(scalar_type))
    decoy = np.arange(values.size * 3, dtype=np.float64).reshape(*values.shape, 3)
    path = written(tmp_path / "image.vti", image_of(vector=decoy, density=values), mode, compressor, **settings)
    reader = open_volume(str(path))
    assert reader.description.scalar_type == scalar_type
    got = read_whole(path)
    assert got.dtype == values.dtype and got.dtype.isnative and got.flags.c_contiguous
    np.testing.assert_allclose(got, values, rtol=tolerances.GEOMETRY_FLOAT64 if way.endswith("text") else 0)
    for low, high in itertools.product(((0, 0, 0), (2, 1, 3)), ((7, 6, 5), (5, 2, 4))):
        box = Box(low, high)
        part = reader.read(box)
        assert part.flags.c_contiguous
        np.testing.assert_array_equal(part, got[low[2] : high[2], low[1] : high[1], low[0] : high[0]])


def test_the_image_lies_where_vtk_has_it(tmp_path: Path) -> None:
    image = image_of(density=values_of("int16"))
    geometry = open_volume(str(written(tmp_path / "image.vti", image))).description.geometry
    assert geometry.dims == (7, 6, 5)
    for index in ((0, 0, 0), (6, 0, 0), (0, 5, 0), (1, 2, 4)):
        place = [0.0, 0.0, 0.0]
        image.TransformIndexToPhysicalPoint([n + low for n, low in zip(index, EXTENT_LOW, strict=True)], place)
        assert geometry.physical(index) == pytest.approx(place, rel=tolerances.GEOMETRY_FLOAT64)


def test_the_array_is_the_active_or_the_named_one(tmp_path: Path) -> None:
    values = values_of("int16")
    path = written(tmp_path / "image.vti", image_of(first=values, second=values * 2))
    np.testing.assert_array_equal(read_whole(path), values)
    np.testing.assert_array_equal(read_whole(f"{path}#second"), values * 2)
    assert open_volume(f"{path}#second").description.density_name == "second"
    inactive = replaced(path, b' Scalars="first"', b"")
    with pytest.raises(BadInput, match=r"holds first, second; choose one, as in .*image\.vti#first"):
        open_volume(str(inactive))


def test_only_what_the_box_needs_is_read_from_raw_arrays(tmp_path: Path) -> None:
    noise = np.random.default_rng(0).integers(0, 60000, (64, 128, 128)).astype(np.uint16)
    image = image_of(density=noise)
    box = Box((0, 32, 32), (128, 96, 36))
    for name, compressor, blocks in (("plain.vti", "", 0), ("packed.vti", "ZLib", 1 << 15)):
        settings = {**RAW, "BlockSize": blocks} if blocks else RAW
        path = written(tmp_path / name, image, APPENDED, compressor, **settings)
        read_whole(path)
        before = bytes_read()
        reader = open_volume(str(path))
        assert reader.description.reads_sub_cubes
        described = bytes_read() - before
        reader.read(box)
        assert described < noise.nbytes // 16
        assert bytes_read() - before - described <= 2 * box.voxels + box.size[2] * blocks + 4096


def test_what_is_within_the_xml_says_why_it_is_read_whole(tmp_path: Path) -> None:
    image = image_of(density=values_of("int16"))
    for mode, why in ((ASCII, "text"), (BINARY, "base64"), (APPENDED, "base64")):
        description = open_volume(str(written(tmp_path / "image.vti", image, mode))).description
        assert not description.reads_sub_cubes and why in description.why_whole


def replaced(path: Path, old: bytes, new: bytes) -> Path:
    raw = path.read_bytes()
    assert old in raw
    path.write_bytes(raw.replace(old, new, 1))
    return path


def cut(path: Path, share: float) -> Path:
    raw = path.read_bytes()
    path.write_bytes(raw[: int(len(raw) * share)])
    return path


def plain(folder: Path, way: str = "appended base64") -> Path:
    mode, compressor, settings = WAYS[way]
    noise = np.random.default_rng(0).integers(0, 30000, (20, 20, 20)).astype(np.int16)
    return written(folder / "v.vti", image_of(density=noise), mode, compressor, **settings)


def zipped(path: Path) -> Path:
    path.write_bytes(gzip.compress(path.read_bytes()))
    return path


def spacing(folder: Path, text: bytes) -> Path:
    return replaced(plain(folder), b'Spacing="0.5 1.25 3"', b'Spacing="%s"' % text)


def extent(path: Path, text: bytes = b"2 21 -1 18 3 2222222") -> Path:
    """Says in both places that the image has this extent."""
    raw = path.read_bytes()
    assert b"2 21 -1 18 3 22" in raw
    path.write_bytes(raw.replace(b"2 21 -1 18 3 22", text))
    return path


def billion_laughs(folder: Path) -> Path:
    entities = b'<!DOCTYPE VTKFile [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;&a;">]>\n<VTKFile'
    return replaced(plain(folder, "text"), b"<VTKFile", entities)


def colours(folder: Path) -> Path:
    return written(folder / "v.vti", image_of(rgb=np.zeros((3, 4, 5, 3), np.uint8)))


def other_kind(folder: Path) -> Path:
    return replaced(plain(folder), b'type="ImageData"', b'type="StructuredGrid"')


def zip_bomb(folder: Path) -> Path:
    """A block that becomes more than it states."""
    path = written(folder / "v.vti", image_of(density=np.zeros((8, 64, 64), np.uint8)), APPENDED, "ZLib", **RAW)
    raw = path.read_bytes()
    at = raw.index(b" _") + 2
    small = raw.replace(b"2 65 -1 62 3 10", b"2 65 -1 62 3 3 ")
    path.write_bytes(small[: at + 8] + (64 * 64).to_bytes(4, "little") + small[at + 12 :])
    return path


REFUSALS: dict[str, tuple[Callable[[Path], Path], str]] = {
    "truncated raw": (
        lambda d: cut(plain(d, "appended raw"), 0.7),
        "16000 bytes of voxels, but the file holds only",
    ),
    "truncated blocks": (lambda d: cut(plain(d, "appended compressed"), 0.7), "compressed bytes, but"),
    "truncated base64": (lambda d: cut(plain(d), 0.7), "the array states"),
    "truncated text": (lambda d: cut(plain(d, "text"), 0.7), "XML is truncated or damaged"),
    "truncated in the XML": (lambda d: cut(plain(d), 0.01), "XML is truncated or damaged"),
    "larger raw": (lambda d: extent(plain(d, "appended raw")), "promises 1777776000"),
    "larger blocks": (lambda d: extent(plain(d, "appended compressed")), "but the array states 16000"),
    "larger base64": (lambda d: extent(plain(d, "base64")), "but the array states 16000"),
    "larger text": (lambda d: extent(plain(d, "text")), "promises 888888000 voxels, but the array has 8000"),
    "no numbers": (
        lambda d: replaced(p := plain(d, "text"), re.findall(rb"\d+ \d+ \d+ \d+ \d+\n", p.read_bytes())[5], b"1 x 2\n"),
        "not all numbers of type int16",
    ),
    "damaged blocks": (
        lambda d: replaced(p := plain(d, "appended compressed"), p.read_bytes()[9000:9100], bytes(100)),
        "block 1 of its compressed voxels cannot be unpacked",
    ),
    "damaged base64": (
        lambda d: replaced(p := plain(d), p.read_bytes()[9000:9008], b"????????"),
        "base64 text is no such text",
    ),
    "zip bomb": (zip_bomb, "cannot be unpacked"),
    "LZ4": (lambda d: plain(d, "appended LZ4"), "compressed by vtkLZ4DataCompressor, which is not read; save it"),
    "gzip": (lambda d: zipped(plain(d)), "is a gzip of"),
    "entities": (billion_laughs, "document type declaration"),
    "zero spacing": (lambda d: spacing(d, b"1 0 1"), "do not span space"),
    "spacing that is no number": (lambda d: spacing(d, b"nan nan nan"), "cannot be used"),
    "two spacings": (lambda d: spacing(d, b"1 1"), "is not 3 numbers"),
    "no voxels": (
        lambda d: extent(plain(d), b"0 -1 0 -1 0 -1"),
        'WholeExtent="0 -1 0 -1 0 -1" holds no voxels',
    ),
    "pieces": (
        lambda d: replaced(plain(d), b'WholeExtent="2 21', b'WholeExtent="1 21'),
        "its grid of 1 21 -1 18 3 22 is in pieces (2 21 -1 18 3 22)",
    ),
    "unknown type": (lambda d: replaced(plain(d), b'type="Int16"', b'type="Bit"'), 'type="Bit" is no type of number'),
    "unknown byte order": (lambda d: replaced(plain(d), b"LittleEndian", b"MiddleEndian"), "neither LittleEndian"),
    "unknown lengths": (lambda d: replaced(plain(d), b'"UInt32"', b'"UInt16"'), "neither UInt32 nor UInt64"),
    "unknown format": (lambda d: replaced(plain(d), b'"appended"', b'"quantum"'), "none of ascii, binary, appended"),
    "no offset": (lambda d: replaced(plain(d), b'offset="0"', b'offset="x"'), "no place in the appended data"),
    "offset beyond": (
        lambda d: replaced(plain(d), b'offset="0"', b'offset="99999999"'),
        "8 bytes, but 0 follow",
    ),
    "colours": (colours, "has only rgb (3 components), volsplat needs one number a voxel"),
    "another data set": (other_kind, "holds VTK's StructuredGrid, volsplat reads ImageData"),
}


@pytest.mark.parametrize("case", REFUSALS)
def test_bad_input_is_refused_in_one_line(case: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    make, cause = REFUSALS[case]
    assert_refused_in_one_line(read_whole, make(tmp_path), cause, capfd)


def test_parts_that_are_no_scalars_are_refused(tmp_path: Path) -> None:
    values = values_of("int16")
    path = written(tmp_path / "v.vti", image_of(density=values, rgb=np.zeros((*values.shape, 3), np.uint8)))
    with pytest.raises(BadInput, match="“rgb” has 3 components"):
        open_volume(f"{path}#rgb")
    with pytest.raises(BadInput, match="has no array “speed”; it has density"):
        open_volume(f"{path}#speed")


def test_the_real_orbital_equals_its_copy(shared_data: Path) -> None:
    orbital = shared_data / "orbital/hydrogen_3d_64x64x64.vti"
    np.testing.assert_array_equal(read_whole(orbital), read_whole(orbital.with_suffix(".nrrd")))
    assert open_volume(str(orbital)).description.density_name == "probability_density"


@given(data=st.data())
def test_a_damaged_file_is_read_or_refused(data: st.DataObject, tmp_path_factory: pytest.TempPathFactory) -> None:
    folder = tmp_path_factory.getbasetemp() / "damaged"
    folder.mkdir(exist_ok=True)
    mode, compressor, settings = WAYS[data.draw(st.sampled_from(("text", "base64", "appended small blocks")))]
    path = written(folder / "v.vti", image_of(density=values_of("int16")), mode, compressor, **settings)
    raw = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        raw[data.draw(st.integers(60, len(raw) - 1))] = data.draw(st.integers(0, 255))
    path.write_bytes(raw)
    try:
        assert read_whole(path).ndim == 3
    except BadInput as refusal:
        assert "\n" not in str(refusal)
