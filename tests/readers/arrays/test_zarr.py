"""Zarr of both versions in folders, zip files and on a web server: levels, axes, chunks and what is refused."""

import base64
import json
import shutil
import socket
import struct
import sys
import warnings
import zipfile
from collections.abc import Callable
from http import HTTPStatus
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from support.files.counted_bytes import bytes_read
from support.files.loopback_files import served
from support.files.opened import described, read_whole
from support.files.refusals import assert_refused_in_one_line
from support.files.volume_files import ALL_TYPES, values_of
from volsplat.mapshade_server.readers import open_volume
from volsplat.mapshade_server.readers.reading.volume_reader import Voxels
from volsplat.protocol.description.volume import Box
from volsplat.protocol.description.volume_name import LONGEST_VOLUME_NAME
from volsplat.protocol.text.errors import BadInput

zarr = pytest.importorskip("zarr")

METADATA = {"zarr.json", ".zgroup", ".zarray", ".zattrs", ".zmetadata"}
SPACE = [{"name": name, "type": "space", "unit": "micrometer"} for name in "zyx"]


def array(path: Path, values: Any, **settings: Any) -> Path:
    zarr.create_array(path, data=values, **{"chunks": (2, 3, 4), **settings})
    return path


def scale(*steps: float) -> dict[str, Any]:
    return {"type": "scale", "scale": list(steps)}


def translation(*places: float) -> dict[str, Any]:
    return {"type": "translation", "translation": list(places)}


def image(
    path: Path,
    levels: list[Voxels],
    version: str = "0.5",
    axes: list[Any] | None = None,
    transformations: list[list[dict[str, Any]]] | None = None,
    paths: list[str] | None = None,
    **more: Any,
) -> Path:
    """An OME-Zarr image whose levels are half as fine each; `more` goes beside its multiscales."""
    group = zarr.open_group(path, mode="w", zarr_format=3 if version == "0.5" else 2)
    count, names = levels[0].ndim, paths or [str(n) for n in range(len(levels))]
    for name, values in zip(names, levels, strict=True):
        group.create_array(name, data=values, chunks=(1,) * (count - 3) + (4, 4, 4))
    placed = transformations or [
        [scale(*[1] * (count - 3), 2 * 2**n, 0.5 * 2**n, 0.25 * 2**n)] for n in range(len(levels))
    ]
    datasets = [{"path": name, "coordinateTransformations": one} for name, one in zip(names, placed, strict=True)]
    entry: dict[str, Any] = {"axes": SPACE if axes is None else axes, "datasets": datasets}
    if version == "0.5":
        group.attrs["ome"] = {"version": version, "multiscales": [entry], **more}
    else:
        group.attrs.update({"multiscales": [{"version": version, **entry}], **more})
    return path


def cube(side: int, scalar_type: str = "uint16") -> Voxels:
    return np.arange(side**3, dtype=scalar_type).reshape(side, side, side)


LEVELS = [cube(8), cube(4), cube(2)]


@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("scalar_type", ALL_TYPES)
def test_every_type_comes_back_from_both_versions(scalar_type: str, version: int, tmp_path: Path) -> None:
    values = values_of(scalar_type)
    path = array(tmp_path / "volume.zarr", values, zarr_format=version)
    assert described(path).scalar_type == scalar_type
    got = read_whole(path)
    assert got.dtype == values.dtype and got.dtype.isnative and got.flags.c_contiguous
    np.testing.assert_array_equal(got, values)
    part = open_volume(str(path)).read(Box((1, 2, 0), (5, 4, 3)))
    assert part.flags.c_contiguous
    np.testing.assert_array_equal(part, values[0:3, 2:4, 1:5])


@pytest.mark.parametrize("settings", [{"dtype": ">i2"}, {"order": "F"}, {"dtype": ">f8", "order": "F"}])
def test_odd_storage_of_version_2_comes_back(settings: dict[str, Any], tmp_path: Path) -> None:
    values = values_of("int16")
    stored = zarr.create_array(
        tmp_path / "v.zarr", shape=values.shape, chunks=(2, 3, 4), zarr_format=2, **{"dtype": "i2", **settings}
    )
    stored[:] = values
    got = read_whole(tmp_path / "v.zarr")
    assert got.dtype.isnative and got.flags.c_contiguous
    np.testing.assert_array_equal(got, values)


def test_types_that_volumes_lack_become_others(tmp_path: Path) -> None:
    halves = np.linspace(-9, 9, 210, dtype=np.float16).reshape(5, 6, 7)
    np.testing.assert_array_equal(read_whole(array(tmp_path / "a.zarr", halves)), halves.astype(np.float32))
    mask = values_of("uint8") > 50
    np.testing.assert_array_equal(read_whole(array(tmp_path / "b.zarr", mask)), mask.astype(np.uint8))


@pytest.mark.parametrize("version", ["0.4", "0.5"])
def test_levels_are_chosen_by_number_or_path(version: str, tmp_path: Path) -> None:
    path = image(tmp_path / "brain.zarr", LEVELS, version)
    for name, level in ((f"{path}", 0), (f"{path}#0", 0), (f"{path}#1", 1), (f"{path}#2", 2), (f"{path}/1", 1)):
        np.testing.assert_array_equal(read_whole(name), LEVELS[level])
        description = described(name)
        assert description.geometry.spacing == (0.25 * 2**level, 0.5 * 2**level, 2.0 * 2**level)
        assert description.unit == "µm" and description.format == f"OME-Zarr {version}, level {level} of 0 to 2"
    with pytest.raises(BadInput, match=r"brain\.zarr: has no “3”; its levels are 0 to 2"):
        open_volume(f"{path}#3")


def test_levels_with_names_are_numbered_too(tmp_path: Path) -> None:
    path = image(tmp_path / "brain.zarr", LEVELS, paths=["scale0/image", "scale1/image", "scale2/image"])
    for name in (f"{path}#1", f"{path}#scale1/image", f"{path}/scale1/image"):
        np.testing.assert_array_equal(read_whole(name), LEVELS[1])
        assert described(name).geometry.spacing == (0.5, 1, 4)


def test_scales_and_translations_apply_in_turn(tmp_path: Path) -> None:
    path = image(tmp_path / "brain.zarr", LEVELS[:1], transformations=[[scale(2, 3, 4), translation(10, 20, 30)]])
    group = zarr.open_group(path, mode="a")
    ome = dict(group.attrs["ome"])
    ome["multiscales"][0]["coordinateTransformations"] = [{"type": "identity"}, scale(0.5, 0.5, 0.5)]
    group.attrs["ome"] = ome
    geometry = described(path).geometry
    assert geometry.spacing == (2, 1.5, 1) and geometry.origin == (15, 10, 5)


def test_axes_in_another_order_and_unit_lie_where_they_are(tmp_path: Path) -> None:
    axes = [{"name": "x", "type": "space", "unit": "nanometer"}, SPACE[1], SPACE[0]]
    path = image(tmp_path / "v.zarr", LEVELS[:1], axes=axes, transformations=[[scale(500, 2, 3)]])
    description = described(path)
    assert description.geometry.index_to_physical == ((0, 0, 0.5), (0, 2, 0), (3, 0, 0)) and description.unit == "µm"


def test_times_and_channels_are_chosen_where_there_are_several(tmp_path: Path) -> None:
    axes = [{"name": "t", "type": "time", "unit": "second"}, {"name": "c", "type": "channel"}, *SPACE]
    frames = np.stack([[cube(4), cube(4) + 64], [cube(4) + 128, cube(4) + 192]])
    omero = {"channels": [{"label": "DAPI"}, {"label": "GFP"}]}
    path = image(tmp_path / "v.zarr", [frames], axes=axes, omero=omero)
    np.testing.assert_array_equal(read_whole(f"{path}#0,t=1,c=0"), frames[1, 0])
    assert described(f"{path}#0,t=0,c=1").density_name == "GFP"
    with pytest.raises(BadInput, match=r"choose an index of t and of c, as in .*v\.zarr#0,t=0,c=0"):
        open_volume(str(path))
    single = image(tmp_path / "single.zarr", [frames[:1, :1]], axes=axes, omero=omero)
    np.testing.assert_array_equal(read_whole(single), frames[0, 0])
    assert described(single).density_name == "DAPI" and described(single).axes is None


def test_older_versions_name_no_axes(tmp_path: Path) -> None:
    path = image(tmp_path / "v.zarr", [cube(4)[None, None]], "0.2", axes=[])
    attributes = json.loads((path / ".zattrs").read_text(encoding="utf-8"))
    for axes in (None, ["t", "c", "z", "y", "x"]):
        if axes is None:
            del attributes["multiscales"][0]["axes"]
        else:
            attributes["multiscales"][0]["axes"] = axes
        (path / ".zattrs").write_text(json.dumps(attributes))
        np.testing.assert_array_equal(read_whole(path), cube(4))
        assert described(path).geometry.spacing == (0.25, 0.5, 2)


def test_arrays_and_images_in_groups_are_named_by_path(tmp_path: Path) -> None:
    group = zarr.open_group(tmp_path / "v.zarr", mode="w")
    group.create_array("flat", data=cube(4)[0])
    group.create_array("run/density", data=cube(4), chunks=(2, 2, 2))
    np.testing.assert_array_equal(read_whole(tmp_path / "v.zarr"), cube(4))
    assert described(tmp_path / "v.zarr").density_name == "density"
    image(tmp_path / "v.zarr" / "labels", LEVELS)
    for name, values in (("run/density", cube(4)), ("labels", LEVELS[0]), ("labels/1", LEVELS[1]), ("run", cube(4))):
        np.testing.assert_array_equal(read_whole(f"{tmp_path}/v.zarr#{name}"), values)
    with pytest.raises(BadInput) as refusal:
        open_volume(f"{tmp_path}/v.zarr")
    listed = "holds labels (an image), run/density (4 x 4 x 4); choose one, as in"
    assert listed in str(refusal.value) and str(refusal.value).endswith("v.zarr#labels")
    with pytest.raises(BadInput, match=r"has no “none”; it holds labels \(an image\), run/density"):
        open_volume(f"{tmp_path}/v.zarr#none")


def test_arrays_are_chosen_though_their_paths_look_like_options(tmp_path: Path) -> None:
    path = tmp_path / "v.zarr"
    group = zarr.open_group(path, mode="w")
    for name, first in (("a", 0), ("a,axis0=1", 2)):
        group.create_array(name, data=np.stack([cube(4) + first, cube(4) + first + 1]))
    group.create_array("run=1/density", data=cube(4) + 4)
    image(path / "day=2", LEVELS[:2], paths=["fine", "coarse"])
    with served(tmp_path) as web:
        for place in (path, zipped(path), f"{web.url}/v.zarr"):
            for part, more in (("a,axis0=0", 0), ("a,axis0=1,axis0=1", 3), ("run=1/density,unit=mm", 4)):
                np.testing.assert_array_equal(read_whole(f"{place}#{part}"), cube(4) + more)
            for part, level in (("day=2", 0), ("day=2/1", 1), ("day=2/coarse", 1)):
                np.testing.assert_array_equal(read_whole(f"{place}#{part}"), LEVELS[level])
            with pytest.raises(BadInput, match="has no “day=2/7”; its levels are 0 to 1"):
                open_volume(f"{place}#day=2/7")


OPTIONS = ["axis0=0", "axis0=0,unit=mm", "axis0=0,unit=mm,spacing=1x1x2", "axis0=0,unit=mm/3"]


@pytest.mark.parametrize("consolidated", [False, True])
@pytest.mark.parametrize("version", [2, 3])
def test_options_cost_one_request_more_at_most(version: int, consolidated: bool, tmp_path: Path) -> None:
    path = tmp_path / "v.zarr"
    group = zarr.open_group(path, mode="w", zarr_format=version)
    group.create_array("a", data=np.stack([cube(4)] * 2))
    group.create_array("b,axis0=1", data=np.stack([cube(4), cube(4) + 1]))
    group.create_array("b", data=np.stack([cube(4) + 2] * 2))
    if consolidated:
        with warnings.catch_warnings(action="ignore"):  # that version 3 has no such thing yet
            zarr.consolidate_metadata(path)
    with served(tmp_path) as web:
        with pytest.raises(BadInput, match="choose an index of axis3"):
            open_volume(f"{web.url}/v.zarr#a")
        without = len(web.asked)
        for options in OPTIONS:
            web.asked.clear()
            open_volume(f"{web.url}/v.zarr#a,{options}")
            of_options = [asked for asked in web.asked if "=" in asked]
            assert len(of_options) <= (0 if consolidated else 1), of_options
            assert len(web.asked) <= without + len(of_options)
        for part in ("b,axis0=1,axis0=1", "/b,axis0=1,axis0=1"):
            np.testing.assert_array_equal(read_whole(f"{web.url}/v.zarr#{part}"), cube(4) + 1)


@pytest.mark.parametrize("version", [2, 3])
def test_options_of_an_array_that_is_the_place_itself_cost_none(version: int, tmp_path: Path) -> None:
    array(tmp_path / "v.zarr", np.stack([cube(4)] * 2), chunks=(1, 4, 4, 4), zarr_format=version)
    with served(tmp_path) as web:
        open_volume(f"{web.url}/v.zarr#axis0=0,unit=mm")
        assert not [asked for asked in web.asked if "=" in asked]


@pytest.mark.parametrize("kind", ["folder", "zip"])
@pytest.mark.parametrize("unit", ["mm/../x", "./m", "//m", "a\0b", "x" * 300, "x/5", f"{'x/' * 2000}0"])
def test_an_option_that_can_be_no_path_is_an_option(unit: str, kind: str, tmp_path: Path) -> None:
    path = tmp_path / "v.zarr"
    zarr.open_group(path, mode="w").create_array("a", data=np.stack([cube(4)] * 2))
    place = path if kind == "folder" else zipped(path)
    if len(f"{place}#a,axis0=1,unit={unit}") <= LONGEST_VOLUME_NAME:
        np.testing.assert_array_equal(read_whole(f"{place}#a,axis0=1,unit={unit}"), cube(4))


@pytest.mark.parametrize("version", [2, 3])
def test_arrays_of_xarray_are_placed_and_unpacked(version: int, tmp_path: Path) -> None:
    stored = np.arange(210, dtype=np.int16).reshape(5, 6, 7)
    group = zarr.open_group(tmp_path / "v.zarr", mode="w", zarr_format=version)
    coordinates = {"depth": np.arange(5) * 10.0, "y": np.arange(6) * 0.25, "x": np.arange(7) * 0.5}

    def add(name: str, values: Voxels, dimensions: list[str], fill: Any = None, **attributes: Any) -> None:
        if version == 3:
            made = group.create_array(name, data=values, dimension_names=dimensions, chunks="auto")
        else:
            made = group.create_array(name, data=values, fill_value=fill, chunks="auto")
            attributes["_ARRAY_DIMENSIONS"] = dimensions
        made.attrs.update(attributes)

    for name, positions in coordinates.items():
        add(name, positions, [name], units="m", positive="down" if name == "depth" else "up")
    packing: dict[str, Any] = {"scale_factor": 0.5, "units": "K", "long_name": "warmth"}
    if version == 3:
        packing["_FillValue"] = 3
    add("data", stored, list(coordinates), fill=3, **packing)
    description = described(tmp_path / "v.zarr")
    assert description.geometry.index_to_physical == ((0.5, 0, 0), (0, 0.25, 0), (0, 0, -10))
    assert (description.unit, description.value_unit, description.density_name) == ("m", "K", "warmth")
    expected = np.where(stored == 3, np.nan, stored * np.float32(0.5))
    np.testing.assert_array_equal(read_whole(tmp_path / "v.zarr"), expected)
    for name in (f"{tmp_path}/v.zarr/data", f"file://{tmp_path}/v.zarr/data"):
        by_itself = described(name)
        assert (by_itself.geometry, by_itself.unit) == (description.geometry, "m")
    with served(tmp_path) as web:
        assert described(f"{web.url}/v.zarr/data").geometry == description.geometry


def test_an_axis_that_is_not_drawn_is_not_warned_of(tmp_path: Path) -> None:
    group = zarr.open_group(tmp_path / "v.zarr", mode="w")
    axes = ["time", "z", "y", "x"]
    group.create_array("data", data=np.ones((3, 4, 5, 6), np.int16), dimension_names=axes, chunks="auto")
    group.create_array("time", data=np.array([0.0, 1.0, 5.0]), dimension_names=["time"], chunks="auto")
    assert described(f"{tmp_path}/v.zarr/data#time=1").warnings == ()
    assert "time is unevenly spaced" in described(f"{tmp_path}/v.zarr/data#x=1").warnings[0]


def test_an_array_of_xarray_without_its_group_is_read_without_coordinates(tmp_path: Path) -> None:
    (tmp_path / "z").write_text("no array")
    path = array(tmp_path / "data", cube(4), dimension_names=["z", "y", "x"])
    with served(tmp_path) as web:
        for name in (str(path), f"{web.url}/data"):
            assert described(name).geometry.spacing == (1, 1, 1) and described(name).unit == ""


def test_fill_values_of_floats_are_in_base64(tmp_path: Path) -> None:
    path = array(tmp_path / "v.zarr", np.full((2, 2, 2), -9.0, np.float32), chunks=(1, 2, 2))
    zarr.open_array(path, mode="a").attrs["_FillValue"] = base64.b64encode(struct.pack("<d", -9.0)).decode()
    assert np.isnan(read_whole(path)).all()


@pytest.mark.parametrize("shards", [None, (32, 64, 64)])
def test_only_the_chunks_of_the_box_are_read(shards: tuple[int, ...] | None, tmp_path: Path) -> None:
    values = np.random.default_rng(0).integers(0, 60000, (64, 64, 64)).astype(np.uint16)
    path = array(tmp_path / "v.zarr", values, chunks=(16, 16, 16), shards=shards, compressors=None)
    read_whole(path)
    before = bytes_read()
    reader = open_volume(str(path))
    assert reader.description.reads_sub_cubes and bytes_read() - before < values.nbytes // 16
    before = bytes_read()
    box = Box((0, 20, 16), (32, 30, 32))
    found = reader.read(box)
    # The box is in two chunks; newer zarr reads the three that lie between them in a shard as well.
    assert bytes_read() - before < (values.nbytes // 8 if shards else 2 * 2 * 16**3 + values.nbytes // 64)
    np.testing.assert_array_equal(found, values[16:32, 20:30, 0:32])


def test_one_chunk_says_why_it_is_read_whole(tmp_path: Path) -> None:
    description = described(array(tmp_path / "v.zarr", values_of("int16"), chunks=(5, 6, 7)))
    assert not description.reads_sub_cubes and description.why_whole == "all its voxels are in one chunk"


def zipped(folder: Path, inside: str = "", compression: int = zipfile.ZIP_STORED) -> Path:
    path = folder.with_name(f"{folder.name}.zip")
    with zipfile.ZipFile(path, "w", compression) as archive:
        for file in sorted(folder.rglob("*")):
            if file.is_file():
                archive.write(file, f"{inside}{file.relative_to(folder)}")
    return path


@pytest.mark.parametrize("inside", ["", "brain.zarr/", "a/b/"])
@pytest.mark.parametrize("version", ["0.4", "0.5"])
def test_zip_files_are_read_as_folders_are(version: str, inside: str, tmp_path: Path) -> None:
    folder = image(tmp_path / "brain.zarr", LEVELS, version)
    path = zipped(folder, inside)
    np.testing.assert_array_equal(read_whole(path), LEVELS[0])
    np.testing.assert_array_equal(read_whole(f"{path}#1"), LEVELS[1])
    assert described(path).geometry.spacing == (0.25, 0.5, 2)
    ozx = path.rename(tmp_path / "brain.ozx")
    np.testing.assert_array_equal(read_whole(ozx), LEVELS[0])


def test_a_store_whose_name_has_the_sign_is_none_of_what_lies_beside_it(tmp_path: Path) -> None:
    image(tmp_path / "run", [cube(4)])
    path = image(tmp_path / "run#1.zarr", LEVELS)
    np.testing.assert_array_equal(read_whole(path), LEVELS[0])
    np.testing.assert_array_equal(read_whole(f"{path}#1"), LEVELS[1])
    np.testing.assert_array_equal(read_whole(tmp_path / "run#0"), cube(4))


def test_urls_of_files_are_paths(tmp_path: Path) -> None:
    path = image(tmp_path / "my brain.zarr", LEVELS)
    np.testing.assert_array_equal(read_whole(f"file://{path}#1"), LEVELS[1])
    np.testing.assert_array_equal(read_whole(f"file://{str(path).replace(' ', '%20')}"), LEVELS[0])


@pytest.mark.parametrize("version", ["0.4", "0.5"])
def test_only_the_chunks_of_the_box_are_requested(version: str, tmp_path: Path) -> None:
    image(tmp_path / "brain.zarr", LEVELS, version)
    separator = "0/c/{}/{}/{}" if version == "0.5" else "0/{}.{}.{}"
    with served(tmp_path) as web:
        reader = open_volume(f"{web.url}/brain.zarr")
        assert reader.description.geometry.spacing == (0.25, 0.5, 2)
        assert {sent.rpartition("/")[2] for sent in web.paths} <= METADATA
        assert web.bytes < 8192
        web.sent.clear()
        box = Box((0, 0, 1), (8, 4, 3))
        np.testing.assert_array_equal(reader.read(box), LEVELS[0][1:3, 0:4, 0:8])
        assert web.paths == {f"brain.zarr/{separator.format(0, 0, i)}" for i in (0, 1)}
        assert web.bytes == sum((tmp_path / name).stat().st_size for name in web.paths)
        np.testing.assert_array_equal(read_whole(f"{web.url}/brain.zarr/#1"), LEVELS[1])
        for url in (web.url, web.url.replace("http", "HTTP")):
            np.testing.assert_array_equal(read_whole(f"{url}/brain.zarr/2"), LEVELS[2])
        assert described(f"{web.url}/brain.zarr/2").geometry.spacing == (1, 2, 8)


def test_only_ranges_of_shards_are_requested(tmp_path: Path) -> None:
    values = cube(64)
    array(tmp_path / "v.zarr", values, chunks=(8, 8, 8), shards=(64, 64, 64), compressors=None)
    with served(tmp_path) as web:
        reader = open_volume(f"{web.url}/v.zarr")
        web.sent.clear()
        np.testing.assert_array_equal(reader.read(Box((8, 0, 0), (16, 8, 8))), values[0:8, 0:8, 8:16])
        assert web.bytes == 2 * 8**3 + 16 * 8**3 + 4  # the chunk, and the shard's index with its checksum


def test_what_the_web_does_not_have_is_told(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    image(tmp_path / "brain.zarr", LEVELS)
    (tmp_path / "head.nrrd").write_text("NRRD0004\n")
    with served(tmp_path) as web:
        for name, cause in (
            ("nowhere.zarr", "there is no Zarr here, none of zarr.json"),
            ("head.nrrd", "download what is not Zarr first"),
            ("brain.zarr#9", "has no “9”; its levels are 0 to 2"),
        ):
            with pytest.raises(BadInput) as refusal:
                open_volume(f"{web.url}/{name}")
            assert cause in str(refusal.value) and web.url in str(refusal.value) and "\n" not in str(refusal.value)
        reader = open_volume(f"{web.url}/brain.zarr")
        web.status = HTTPStatus.FORBIDDEN
        for use in (lambda: open_volume(f"{web.url}/brain.zarr"), lambda: reader.read(Box((0, 0, 0), (1, 1, 1)))):
            with pytest.raises(BadInput, match="403") as refusal:
                use()
            assert "\n" not in str(refusal.value)
    with socket.socket() as nobody:
        nobody.bind(("127.0.0.1", 0))  # and does not listen
        with pytest.raises(BadInput, match="connection refused") as refusal:
            open_volume(f"http://127.0.0.1:{nobody.getsockname()[1]}/brain.zarr")
    assert "\n" not in str(refusal.value)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("name", "cause"),
    [
        ("s3://bucket/brain.zarr", "s3:// needs s3fs, which is not installed: pip install s3fs"),
        ("gs://bucket/brain.zarr", "gs:// needs gcsfs, which is not installed: pip install gcsfs"),
        ("ftps+odd://host/brain.zarr", "nothing is known of ftps+odd://; http, https, s3 and file are read"),
    ],
)
def test_what_a_url_needs_is_named(name: str, cause: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for module in ("s3fs", "gcsfs"):
        monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(BadInput) as refusal:
        open_volume(name)
    assert str(refusal.value) == f"{name}: {cause}"


def test_a_missing_library_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = array(tmp_path / "v.zarr", LEVELS[0])
    monkeypatch.setitem(sys.modules, "zarr", None)
    with pytest.raises(BadInput, match=r"Zarr needs zarr, which is not installed: pip install 'volsplat\[formats\]'"):
        open_volume(str(path))


def replaced(path: Path, file: str, old: str, new: str) -> Path:
    text = (path / file).read_text(encoding="utf-8")
    assert old in text
    (path / file).write_text(text.replace(old, new))
    return path


def edited(path: Path, change: Callable[[Any], object]) -> Path:
    """An image's metadata changed."""
    metadata = json.loads((path / "zarr.json").read_text(encoding="utf-8"))
    change(metadata["attributes"]["ome"])
    (path / "zarr.json").write_text(json.dumps(metadata))
    return path


def damaged_chunk(path: Path) -> Path:
    array(path, LEVELS[0], chunks=(8, 8, 8))
    chunk = path / "c" / "0" / "0" / "0"
    chunk.write_bytes(chunk.read_bytes()[:-9])
    return path


def without_chunks(path: Path) -> Path:
    shutil.rmtree(array(path, LEVELS[0]) / "c")
    return path


def without_level(path: Path) -> Path:
    shutil.rmtree(image(path, LEVELS) / "1")
    return path


def bomb(path: Path) -> Path:
    """A zip file with a chunk that would unpack to far more than its array has."""
    path.mkdir()
    shutil.rmtree(array(path / "inner", LEVELS[0], chunks=(8, 8, 8)) / "c")
    with zipfile.ZipFile(path / "v.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.write(path / "inner" / "zarr.json", "zarr.json")
        with archive.open("c/0/0/0", "w") as member:
            for _ in range(65):
                member.write(bytes(1 << 20))
    return path / "v.zip"


def other_zip(path: Path) -> Path:
    path.mkdir()
    with zipfile.ZipFile(path / "v.zip", "w") as archive:
        archive.writestr("notes.txt", "no volume")
    return path / "v.zip"


def cut(path: Path, share: float) -> Path:
    raw = path.read_bytes()
    path.write_bytes(raw[: int(len(raw) * share)])
    return path


def empty_folder(path: Path) -> Path:
    path.mkdir()
    return path


def group(path: Path) -> Path:
    zarr.open_group(path, mode="w").create_array("flat", data=cube(4)[0])
    return path


REFUSALS: dict[str, tuple[Callable[[Path], Path], str, str]] = {
    "an empty folder": (empty_folder, "", "there is no Zarr here, none of zarr.json, .zgroup, .zarray"),
    "a damaged chunk": (damaged_chunk, "", "cannot be read"),
    "no chunks": (without_chunks, "", "not one of its chunks is there; copy or fetch the whole Zarr again"),
    "a missing level": (without_level, "#1", "its level 1, the array “1”, is missing"),
    "metadata that is no JSON": (
        lambda p: replaced(array(p, LEVELS[0]), "zarr.json", "{", "<"),
        "",
        "there is no Zarr metadata",
    ),
    "an unknown codec": (
        lambda p: replaced(array(p, LEVELS[0]), "zarr.json", '"zstd"', '"rot13"'),
        "",
        "rot13",
    ),
    "a negative shape": (
        lambda p: replaced(array(p, cube(4), chunks=(2, 2, 2)), "zarr.json", "4,\n", "-4,\n"),
        "",
        "cannot be read",
    ),
    "a flat array": (lambda p: array(p, cube(4)[0], chunks=(4, 4)), "", "a 2-D image, volsplat needs a volume"),
    "no volume": (group, "", "no array with three axes is found in this group; name one, as in"),
    "a flat array in a group": (group, "#flat", "a 2-D image"),
    "complex": (lambda p: array(p, cube(4).astype(np.complex64), chunks=(2, 2, 2)), "", "has complex numbers"),
    "colour": (
        lambda p: array(p, np.ones((5, 6, 7, 3), np.uint8), chunks=(5, 6, 7, 3)),
        "",
        "choose an index of axis3, as in",
    ),
    "an index beyond": (
        lambda p: image(p, [cube(4)[None]], axes=["t", "z", "y", "x"]),
        "#0,t=1",
        "whose last index is 0",
    ),
    "no datasets": (
        lambda p: edited(image(p, LEVELS), lambda ome: ome["multiscales"][0]["datasets"].clear()),
        "",
        "its OME-Zarr metadata (multiscales) cannot be used",
    ),
    "multiscales that are none": (
        lambda p: edited(image(p, LEVELS), lambda ome: ome.update(multiscales=7)),
        "",
        "its OME-Zarr metadata (multiscales) cannot be used",
    ),
    "too few axes": (
        lambda p: edited(image(p, LEVELS), lambda ome: ome["multiscales"][0]["axes"].pop()),
        "",
        "its OME-Zarr metadata (axes or coordinateTransformations) cannot be used",
    ),
    "a scale that is no number": (
        lambda p: image(p, LEVELS[:1], transformations=[[{"type": "scale", "scale": ["a", "b", "c"]}]]),
        "",
        "(axes or coordinateTransformations) cannot be used",
    ),
    "an affine transformation": (
        lambda p: image(p, LEVELS[:1], transformations=[[{"type": "affine", "affine": [1]}]]),
        "",
        "a transformation of type “affine”, which volsplat does not know; give the spacing yourself, as in",
    ),
    "zero spacing": (
        lambda p: image(p, LEVELS[:1], transformations=[[scale(0, 1, 1)]]),
        "",
        "its spacing cannot be used",
    ),
    "a zip bomb": (bomb, "", "c/0/0/0 would unpack to 68157440 bytes, too many for what it is"),
    "a zip without Zarr": (other_zip, "", "there is no Zarr here"),
    "a truncated zip": (lambda p: cut(zipped(image(p, LEVELS)), 0.7), "", "cannot be read (File is not a zip file)"),
}


@pytest.mark.parametrize("case", REFUSALS)
def test_bad_input_is_refused_in_one_line(case: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    make, part, cause = REFUSALS[case]
    assert_refused_in_one_line(lambda path: read_whole(f"{path}{part}"), make(tmp_path / "v.zarr"), cause, capfd)


def test_a_transformation_that_is_not_known_can_be_overruled(tmp_path: Path) -> None:
    path = image(tmp_path / "v.zarr", LEVELS[:1], transformations=[[{"type": "affine", "affine": [1]}]])
    assert described(f"{path}#spacing=1x2x3").geometry.spacing == (1, 2, 3)


def test_more_images_than_one_are_told(tmp_path: Path) -> None:
    path = edited(image(tmp_path / "v.zarr", LEVELS), lambda ome: ome["multiscales"].append(ome["multiscales"][0]))
    assert described(path).warnings == ("the first of the 2 images that its metadata describes is taken",)
