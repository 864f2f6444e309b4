"""TIFF stacks, OME-TIFF, ImageJ's and folders of slices, written by tifffile, SimpleITK and OpenImageIO."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import SimpleITK as sitk
import tifffile
from hypothesis import given
from hypothesis import strategies as st

from support.files.counted_bytes import bytes_read
from support.files.opened import described, read_whole, refused
from support.files.volume_files import DIMS, values_of
from volsplat.mapshade_server.readers import open_volume
from volsplat.mapshade_server.readers.reading.volume_reader import Voxels
from volsplat.protocol.description.volume import Box
from volsplat.protocol.text.errors import BadInput

VALUES = values_of("uint16", (40, 33, 6))
GREY = {"photometric": "minisblack", "metadata": None}


def saved(path: Path, values: Voxels = VALUES, **options: Any) -> Path:
    tifffile.imwrite(path, values, **(GREY | options))
    return path


def by_simple_itk(path: Path, values: Voxels, compressor: str) -> Path:
    writer = sitk.ImageFileWriter()
    writer.SetImageIO("TIFFImageIO")
    writer.UseCompressionOn()
    writer.SetCompressor(compressor)
    writer.SetFileName(str(path))
    writer.Execute(sitk.GetImageFromArray(values))
    return path


STORED: dict[str, Callable[[Path], Path]] = {
    "plain": saved,
    "big endian": lambda p: saved(p, byteorder=">"),
    "BigTIFF": lambda p: saved(p, bigtiff=True),
    "tiled": lambda p: saved(p, tile=(16, 32)),
    "strips": lambda p: saved(p, rowsperstrip=7),
    "deflate": lambda p: saved(p, compression="zlib", rowsperstrip=7),
    "deflate, predictor": lambda p: saved(p, compression="zlib", predictor=True),
    "deflate, predictor, big endian": lambda p: saved(p, compression="zlib", predictor=True, byteorder=">"),
    "deflate, tiled": lambda p: saved(p, compression="zlib", tile=(16, 16)),
    "LZMA": lambda p: saved(p, compression="lzma"),
    "LZW": lambda p: by_simple_itk(p, VALUES, "LZW"),
    "PackBits": lambda p: by_simple_itk(p, VALUES, "PackBits"),
    "SimpleITK's deflate": lambda p: by_simple_itk(p, VALUES, "Deflate"),
    "with tifffile's own metadata": lambda p: saved(p, metadata={}),
}


@pytest.mark.parametrize("case", STORED)
@given(data=st.data())
def test_every_way_of_packing_comes_back(
    case: str, data: st.DataObject, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = STORED[case](tmp_path_factory.mktemp("tiff") / "stack.tif")
    reader = open_volume(str(path))
    description = reader.description
    assert description.geometry.dims == (40, 33, 6) and description.scalar_type == "uint16"
    corners = [sorted(data.draw(st.sets(st.integers(0, n), min_size=2, max_size=2))) for n in (40, 33, 6)]
    (i0, i1), (j0, j1), (k0, k1) = corners
    got = reader.read(Box((i0, j0, k0), (i1, j1, k1)))
    assert got.flags.c_contiguous and got.dtype == np.uint16 and got.dtype.isnative
    np.testing.assert_array_equal(got, VALUES[k0:k1, j0:j1, i0:i1])


@pytest.mark.parametrize("compression", [None, "zlib"])
@pytest.mark.parametrize("scalar_type", ["uint8", "int8", "int16", "uint32", "int32", "float32", "float64"])
def test_every_scalar_type_comes_back(scalar_type: str, compression: str | None, tmp_path: Path) -> None:
    values = values_of(scalar_type)
    path = saved(tmp_path / "stack.tif", values, compression=compression)
    assert described(path).scalar_type == scalar_type
    np.testing.assert_array_equal(read_whole(path), values)


@pytest.mark.parametrize("compression", [None, "zlib", "lzw"])
@pytest.mark.parametrize("scalar_type", ["uint8", "uint16"])
@pytest.mark.parametrize("imagecodecs", [True, False], ids=["imagecodecs", "OpenImageIO"])
def test_values_that_count_from_white_are_as_stored_and_told(
    imagecodecs: bool, scalar_type: str, compression: str | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    values = values_of(scalar_type, (16, 17, 4))
    path = saved(tmp_path / "v.tif", values, photometric="miniswhite", compression=compression)
    (tmp_path / "slices").mkdir()
    for n, plane in enumerate(values):
        saved(tmp_path / "slices" / f"{n}.tif", plane, photometric="miniswhite", compression=compression)
    if not imagecodecs:
        monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    for name in (path, tmp_path / "slices"):
        np.testing.assert_array_equal(read_whole(name), values)
        (told,) = (one for one in described(name).warnings if "photometric" in one)
        assert "as they are stored" in told
    assert not any("photometric" in one for one in described(saved(tmp_path / "b.tif")).warnings)


def test_bits_and_half_floats_become_the_next_type(tmp_path: Path) -> None:
    bits = saved(tmp_path / "bits.tif", VALUES % 2 == 0)
    assert described(bits).scalar_type == "uint8"
    np.testing.assert_array_equal(read_whole(bits), VALUES % 2 == 0)
    half = saved(tmp_path / "half.tif", values_of("float32").astype(np.float16))
    assert described(half).scalar_type == "float32"
    np.testing.assert_array_equal(read_whole(half), values_of("float32").astype(np.float16))


@pytest.mark.parametrize("orientation", range(1, 9))
def test_pixels_lie_where_the_orientation_has_them(orientation: int, tmp_path: Path) -> None:
    upright = VALUES[:2]  # as it should be seen: x to the right, y down
    flips: dict[int, Voxels] = {1: upright, 2: upright[:, :, ::-1], 3: upright[:, ::-1, ::-1], 4: upright[:, ::-1]}
    stored = flips.get(orientation)
    if stored is None:  # the first row is the left edge or, at 6 and 7, the right one
        stored = np.swapaxes({5: upright, 6: flips[2], 7: flips[3], 8: flips[4]}[orientation], 1, 2)
    path = saved(tmp_path / "stack.tif", np.ascontiguousarray(stored), extratags=[(274, 3, 1, orientation, True)])
    reader = open_volume(str(path))
    geometry = reader.description.geometry
    got = reader.read(geometry.box)
    for i, j in ((0, 0), (geometry.dims[0] - 1, 0), (3, 5)):
        x, y, z = geometry.physical((float(i), float(j), 1.0))
        assert got[1, j, i] == upright[int(z), int(y), int(x)]


def ome(path: Path, shape: tuple[int, ...], axes: str, **metadata: Any) -> Voxels:
    values = np.arange(math.prod(shape), dtype=np.uint16).reshape(shape)
    tifffile.imwrite(path, values, ome=True, photometric="minisblack", metadata={"axes": axes, **metadata})
    return values


def test_ome_steps_are_turned_to_one_unit(tmp_path: Path) -> None:
    path = tmp_path / "cell.ome.tif"
    sizes = {"PhysicalSizeX": 200.0, "PhysicalSizeXUnit": "nm", "PhysicalSizeY": 0.3, "PhysicalSizeZ": 1.5}
    values = ome(path, (5, 6, 7), "ZYX", **sizes)
    description = described(path)
    assert description.unit == "nm" and description.format == "OME-TIFF" and not description.warnings
    assert description.geometry.spacing == pytest.approx((200, 300, 1500))
    np.testing.assert_array_equal(read_whole(path), values)


@pytest.mark.parametrize("axes", ["TCZYX", "CTZYX", "TZCYX", "ZTCYX", "CZTYX", "ZCTYX"])
def test_channel_and_time_are_chosen_whatever_the_order(axes: str, tmp_path: Path) -> None:
    path = tmp_path / "cell.ome.tif"
    sizes = {"T": 3, "C": 2, "Z": 5, "Y": 6, "X": 7}
    values = ome(path, tuple(sizes[axis] for axis in axes), axes, Channel={"Name": ["DAPI", "GFP"]})
    by_name = values.transpose([axes.index(axis) for axis in "TCZYX"])
    with pytest.raises(BadInput) as refusal:
        open_volume(str(path))
    for told in ("2 channels (c=0 “DAPI”, c=1 “GFP”)", "3 times (t=0 to 2)", f"choose, as in {path}#"):
        assert told in str(refusal.value)
    with pytest.raises(BadInput, match="has 3 times"):
        open_volume(f"{path}#c=1")
    for c in range(2):
        for t in range(3):
            np.testing.assert_array_equal(read_whole(f"{path}#c={c},t={t}"), by_name[t, c])
    description = described(f"{path}#t=2,c=1")
    assert description.density_name == "GFP"
    for part, cause in (("t=3,c=0", "numbered 0 to 2; “3”"), ("GFP", "“GFP” names nothing"), ("z=1", "choose by z")):
        with pytest.raises(BadInput, match=cause):
            open_volume(f"{path}#{part}")


def two_images(path: Path, second: Voxels) -> Path:
    with tifffile.TiffWriter(path, ome=True) as writer:
        for name, values, step in (("overview", VALUES[:4], 2.0), ("detail", second, 0.5)):
            writer.write(
                values, photometric="minisblack", metadata={"axes": "ZYX", "Name": name, "PhysicalSizeX": step}
            )
    return path


def test_one_of_several_images_is_chosen(tmp_path: Path) -> None:
    path = two_images(tmp_path / "cell.ome.tif", VALUES[:, :20])
    with pytest.raises(BadInput, match="2 images: 0 “overview” 40 x 33 x 4; 1 “detail” 40 x 20 x 6; choose one.*=0"):
        open_volume(str(path))
    assert described(f"{path}#series=0").geometry.spacing == (2, 2, 2)
    description = described(f"{path}#series=1")
    assert description.geometry.spacing == (0.5, 0.5, 0.5) and "no distance of its slices" in description.warnings[0]
    np.testing.assert_array_equal(read_whole(f"{path}#series=1"), VALUES[:, :20])
    with pytest.raises(BadInput, match="numbered 0 to 1"):
        open_volume(f"{path}#series=2")


def test_the_only_volume_beside_a_flat_image_is_taken(tmp_path: Path) -> None:
    path = two_images(tmp_path / "cell.ome.tif", VALUES[:1])
    assert described(path).geometry.dims == (40, 33, 4)


def several_files(folder: Path) -> tuple[Path, Voxels]:
    """An OME-TIFF whose planes lie in two files."""
    values = VALUES[:4]
    names = ("a.ome.tif", "b.ome.tif")
    planes = "".join(
        f'<TiffData FirstZ="{z}" IFD="{z % 2}" PlaneCount="1"><UUID FileName="{names[z // 2]}">urn:uuid:{z // 2}</UUID>'
        "</TiffData>"
        for z in range(4)
    )
    for n, name in enumerate(names):
        xml = (
            '<?xml version="1.0"?><OME xmlns="http://www.openmicroscopy.org/Schemas/OME/2016-06" '
            f'UUID="urn:uuid:{n}"><Image ID="Image:0" Name="set"><Pixels ID="Pixels:0" DimensionOrder="XYZCT" '
            'Type="uint16" SizeX="40" SizeY="33" SizeZ="4" SizeC="1" SizeT="1" PhysicalSizeX="2" PhysicalSizeY="2" '
            f'PhysicalSizeZ="3"><Channel ID="C:0" SamplesPerPixel="1"/>{planes}</Pixels></Image></OME>'
        )
        saved(folder / name, values[2 * n : 2 * n + 2], description=xml)
    return folder / names[0], values


def test_planes_come_from_all_files_of_a_set(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path, values = several_files(tmp_path)
    assert described(path).format == "OME-TIFF of 2 files"
    assert described(path).geometry.spacing == (2, 2, 3)
    np.testing.assert_array_equal(read_whole(path), values)
    path = path.rename(tmp_path / "renamed.ome.tif")
    np.testing.assert_array_equal(read_whole(path), values)
    (tmp_path / "b.ome.tif").unlink()
    with pytest.raises(BadInput, match="plane 2 should be in a.ome.tif or b.ome.tif, which is not beside"):
        open_volume(str(path))
    assert capfd.readouterr() == ("", "")


def test_an_imagej_hyperstack_has_its_spacing_and_unit(tmp_path: Path) -> None:
    path = tmp_path / "stack.tif"
    values = np.arange(2 * 5 * 3 * 6 * 7, dtype=np.uint16).reshape(2, 5, 3, 6, 7)
    metadata = {"axes": "TZCYX", "spacing": 0.7, "unit": "um"}
    tifffile.imwrite(path, values, imagej=True, resolution=(5.0, 2.5), metadata=metadata)
    with pytest.raises(BadInput, match="2 times .* and 3 channels"):
        open_volume(str(path))
    description = described(f"{path}#t=1,c=2")
    assert description.unit == "µm" and description.format == "ImageJ TIFF stack"
    assert description.geometry.spacing == pytest.approx((0.2, 0.4, 0.7))
    np.testing.assert_array_equal(read_whole(f"{path}#t=1,c=2"), values[1, :, 2])


def test_times_are_slices_where_there_are_no_others(tmp_path: Path) -> None:
    path = tmp_path / "stack.tif"
    tifffile.imwrite(path, VALUES, imagej=True, metadata={"axes": "TYX"})
    assert "its 6 times are taken as slices" in described(path).warnings[0]
    np.testing.assert_array_equal(read_whole(path), VALUES)


def test_many_channels_are_slices_where_there_are_no_others(tmp_path: Path) -> None:
    """ImageJ calls the pages of a file without axes channels."""
    path = tmp_path / "stack.tif"
    tifffile.imwrite(path, VALUES, imagej=True, metadata={"axes": "CYX"})
    assert "its 6 channels are taken as slices" in described(path).warnings[0]
    np.testing.assert_array_equal(read_whole(path), VALUES)
    tifffile.imwrite(path, VALUES[:4], imagej=True, metadata={"axes": "CYX"})
    assert "a 2-D image of 4 channels of 40 x 33, no slices" in refused(path)
    assert "a 2-D image of 4 channels of 40 x 33, no slices" in refused(f"{path}#c=2")


@pytest.mark.parametrize("part", ["", "#c=2"])
@pytest.mark.parametrize(
    "metadata",
    [
        {"ome": True, "metadata": {"axes": "CYX", "Channel": {"Name": ["DAPI", "CD3", "CD8", "CD20", "CK", "Ki67"]}}},
        {"ome": True, "metadata": {"axes": "CYX"}},
        {"metadata": {"axes": "CYX"}},
        {"imagej": True, "metadata": {"axes": "CYX", "mode": "composite"}},
        {"imagej": True, "metadata": {"axes": "CYX", "Labels": ["DAPI", "CD3", "CD8", "CD20", "CK", "Ki67"]}},
    ],
)
def test_channels_that_are_stated_are_no_slices(metadata: dict[str, Any], part: str, tmp_path: Path) -> None:
    path = tmp_path / "cells.tif"
    tifffile.imwrite(path, VALUES, photometric="minisblack", **metadata)
    assert "a 2-D image of 6 channels of 40 x 33, no slices" in refused(f"{path}{part}")


@pytest.mark.parametrize("compression", [None, "zlib", "lzw"])
def test_a_palette_is_told_to_be_left_out(compression: str | None, tmp_path: Path) -> None:
    colours = np.arange(3 * 256, dtype=np.uint16).reshape(3, 256)
    values = values_of("uint8")
    how: dict[str, Any] = {"photometric": "palette", "colormap": colours, "compression": compression}
    path = saved(tmp_path / "v.tif", values, **how)
    (tmp_path / "slices").mkdir()
    for n, plane in enumerate(values):
        saved(tmp_path / "slices" / f"{n}.tif", plane, **how)
    for name in (path, tmp_path / "slices"):
        np.testing.assert_array_equal(read_whole(name), values)
        assert any("palette of colours is left out" in one for one in described(name).warnings)


def test_a_palette_that_only_openimageio_unpacks_is_refused_lest_colours_are_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    colours = np.arange(3 * 256, dtype=np.uint16).reshape(3, 256)
    path = saved(tmp_path / "v.tif", values_of("uint8"), photometric="palette", colormap=colours, compression="lzw")
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert "pip install imagecodecs" in refused(path)


def test_imagej_writes_one_page_for_a_large_stack(tmp_path: Path) -> None:
    path = tmp_path / "stack.tif"
    head = f"ImageJ=1.53\nimages={len(VALUES)}\nslices={len(VALUES)}\nspacing=2.0\nunit=mm\n"
    saved(path, VALUES[0], description=head, byteorder=">", software=False)
    with tifffile.TiffFile(path) as file:
        assert file.pages[0].dataoffsets[0] + VALUES[0].nbytes == path.stat().st_size
    with path.open("ab") as opened:
        opened.write(VALUES[1:].astype(">u2").tobytes())
    np.testing.assert_array_equal(read_whole(path), VALUES)


def test_resolutions_of_a_scanner_count_and_those_of_a_printer_do_not(tmp_path: Path) -> None:
    scanned = saved(tmp_path / "scan.tif", resolution=(400.0, 200.0), resolutionunit="CENTIMETER")
    description = described(scanned)
    assert description.unit == "mm" and description.geometry.spacing == pytest.approx((0.025, 0.05, 0.025))
    assert "no distance of its slices" in description.warnings[0]
    printed = described(saved(tmp_path / "print.tif", resolution=(300.0, 300.0), resolutionunit="INCH"))
    assert printed.unit == "" and printed.geometry.spacing == (1, 1, 1) and not printed.warnings


def test_only_rows_or_segments_of_the_sub_cube_are_read(tmp_path: Path) -> None:
    values = np.random.default_rng(0).integers(0, 60000, (64, 128, 128)).astype(np.uint16)
    box = Box((32, 64, 16), (64, 96, 32))
    for path, most in (
        (saved(tmp_path / "raw.tif", values), 16 * 32 * 128 * 2),
        (saved(tmp_path / "tiled.tif", values, tile=(32, 32)), 16 * 32 * 32 * 2),
        (saved(tmp_path / "packed.tif", values, tile=(32, 32), compression="zlib"), 16 * 32 * 32 * 2),
        (saved(tmp_path / "strips.tif", values, rowsperstrip=32, compression="zlib"), 16 * 32 * 128 * 2),
    ):
        read_whole(path)  # imports what the format needs
        reader = open_volume(str(path))
        before = bytes_read()
        np.testing.assert_array_equal(reader.read(box), values[16:32, 64:96, 32:64])
        # Python's file objects read ahead: a buffer's worth for each piece of the file.
        assert bytes_read() - before < 1.1 * most + 16 * 8192, path.name


def slices(folder: Path, values: Voxels = VALUES, name: str = "slice_{}.tif", first: int = 8) -> Path:
    folder.mkdir(exist_ok=True)
    for n, plane in enumerate(values):
        saved(folder / name.format(n + first), plane)
    return folder


def test_a_folder_of_slices_is_a_volume_in_the_order_of_its_numbers(tmp_path: Path) -> None:
    folder = slices(tmp_path / "scan")
    (folder / "notes.txt").write_text("nothing")
    assert sorted(path.name for path in folder.glob("*.tif"))[0] == "slice_10.tif"
    assert described(folder).name == "scan"
    np.testing.assert_array_equal(read_whole(folder), VALUES)


def test_a_folder_of_several_kinds_is_chosen_from(tmp_path: Path) -> None:
    folder = slices(tmp_path / "scan", VALUES, "bone_c0_{}.tif")
    slices(folder, VALUES[:4] + 1, "bone_c1_{}.tif")
    with pytest.raises(BadInput, match="count by 2 numbers, as in bone_c0_8.tif; .*#bone_c0_"):
        open_volume(str(folder))
    np.testing.assert_array_equal(read_whole(f"{folder}#bone_c1"), VALUES[:4] + 1)
    slices(folder, VALUES, "mask_{}.tif")
    with pytest.raises(BadInput, match="6 mask_#.tif"):
        open_volume(str(folder))
    np.testing.assert_array_equal(read_whole(f"{folder}#mask"), VALUES)
    with pytest.raises(BadInput, match="begins with “nerve”"):
        open_volume(f"{folder}#nerve")


def without(folder: Path, *names: str) -> Path:
    for name in names:
        (folder / name).unlink()
    return folder


def with_file(folder: Path, name: str, values: Voxels, **options: Any) -> Path:
    saved(folder / name, values, **options)
    return folder


def cut(path: Path, share: float) -> Path:
    raw = path.read_bytes()
    path.write_bytes(raw[: int(len(raw) * share)])
    return path


def edited(path: Path, tag: int, value: int, pages: int = 1) -> Path:
    """The file with another number in a tag of its first pages, in place."""
    with tifffile.TiffFile(path, mode="r+") as file:
        for page in file.pages[:pages]:
            assert isinstance(page, tifffile.TiffPage)
            page.tags[tag].overwrite(value)
    return path


NOISE = np.random.default_rng(0).integers(0, 60000, VALUES.shape).astype(np.uint16)
REFUSALS: dict[str, tuple[Callable[[Path], Path], str]] = {
    "colour": (lambda d: saved(d / "v.tif", np.zeros((5, 6, 7, 3), np.uint8), photometric="rgb"), "3 samples a pixel"),
    "complex": (lambda d: saved(d / "v.tif", np.zeros((5, 6, 7), np.complex64)), "pixels of type complex64"),
    "tiles of several slices": (
        lambda d: saved(d / "v.tif", np.zeros((16, 16, 16), np.uint8), volumetric=True, tile=(16, 16, 16)),
        "pages of several slices each",
    ),
    "one page": (lambda d: saved(d / "v.tif", VALUES[0]), "a 2-D image"),
    "one page with channels": (
        lambda d: (ome(d / "v.ome.tif", (2, 6, 7), "CYX"), d / "v.ome.tif")[1],
        "a 2-D image",
    ),
    "five axes without names": (
        lambda d: saved(d / "v.tif", np.zeros((2, 3, 6, 7), np.uint16), metadata={}),
        "needs one volume",
    ),
    "truncated": (lambda d: cut(saved(d / "v.tif", NOISE), 0.8), "truncated"),
    "truncated, deflate": (lambda d: cut(saved(d / "v.tif", NOISE, compression="zlib"), 0.8), "truncated"),
    "truncated in the first page": (lambda d: cut(saved(d / "v.tif", NOISE), 0.002), "truncated"),
    "a lying width": (lambda d: edited(saved(d / "v.tif", VALUES[:1].repeat(2, 0)), 256, 4000), "differs from"),
    "lying heights": (lambda d: edited(saved(d / "v.tif"), 257, 60000, pages=6), "promises more pixels"),
    "a bomb": (lambda d: edited(saved(d / "v.tif", compression="zlib"), 257, 10**9, pages=6), "promises more pixels"),
    "a missing number": (lambda d: without(slices(d / "s"), "slice_10.tif"), "after number 9 comes 11"),
    "a number twice": (lambda d: with_file(slices(d / "s"), "slice_09.tif", VALUES[0]), "bear the number 9"),
    "another size": (
        lambda d: with_file(slices(d / "s"), "slice_14.tif", VALUES[0, :9]),
        "slice_14.tif differs from slice_8.tif",
    ),
    "a stack among slices": (lambda d: with_file(slices(d / "s"), "slice_14.tif", VALUES), "6 pages among"),
    "one slice": (lambda d: slices(d / "s", VALUES[:1]), "a 2-D image"),
    "a colour slice": (
        lambda d: with_file(slices(d / "s"), "slice_14.tif", np.zeros((6, 7, 3), np.uint8), photometric="rgb"),
        "3 samples a pixel",
    ),
    "a truncated slice": (lambda d: (cut(slices(d / "s") / "slice_9.tif", 0.5), d / "s")[1], "truncated"),
}


@pytest.mark.parametrize("case", REFUSALS)
def test_what_is_wrong_is_told_in_one_line(case: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    make, cause = REFUSALS[case]
    path = make(tmp_path)
    text = refused(path)
    assert cause in text and str(tmp_path) in text
    assert capfd.readouterr() == ("", "")


def test_a_damaged_strip_is_told(tmp_path: Path) -> None:
    path = saved(tmp_path / "v.tif", NOISE, compression="zlib")
    with tifffile.TiffFile(path) as file:
        start = file.pages[3].dataoffsets[0]
    raw = bytearray(path.read_bytes())
    raw[start + 100 : start + 200] = bytes(100)
    path.write_bytes(raw)
    reader = open_volume(str(path))
    reader.read(Box((0, 0, 0), (40, 33, 3)))
    with pytest.raises(BadInput, match="page 3 is damaged"):
        reader.read(Box((0, 0, 3), (40, 33, 4)))


def test_metadata_in_another_file_is_told(tmp_path: Path) -> None:
    xml = (
        '<?xml version="1.0"?><OME xmlns="http://www.openmicroscopy.org/Schemas/OME/2016-06" UUID="urn:uuid:1">'
        '<BinaryOnly MetadataFile="set.companion.ome" UUID="urn:uuid:2"/></OME>'
    )
    path = saved(tmp_path / "v.ome.tif", description=xml)
    assert "set.companion.ome" in described(path).warnings[0]
    np.testing.assert_array_equal(read_whole(path), VALUES)


@given(data=st.data())
def test_damaged_tags_are_read_or_refused(data: st.DataObject, tmp_path_factory: pytest.TempPathFactory) -> None:
    path = tmp_path_factory.mktemp("tiff") / "v.tif"
    raw = bytearray(saved(path, values_of("uint16")).read_bytes())
    end = raw.index(values_of("uint16").tobytes()[:64])
    for _ in range(data.draw(st.integers(1, 4))):
        raw[data.draw(st.integers(4, end - 1))] = data.draw(st.integers(0, 255))
    path.write_bytes(raw)
    try:
        reader = open_volume(str(path))
        box = reader.description.geometry.box
        if math.prod(box.high) <= 8 * math.prod(DIMS):
            assert reader.read(box).shape == box.high[::-1]
    except BadInput as refusal:
        assert "\n" not in str(refusal)
