"""The packet store as it is read: boxes, bricks, and what is refused."""

import errno
import json
import os
import shutil
import sys
import zlib
from collections.abc import Callable
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import msgspec
import numpy as np
import pytest
import torch
import zarr
from hypothesis import given
from hypothesis import strategies as st

from support.files.prepared import ODD_DIMS, SMALL, packed_whole, prepare_small, store_of, values_of, written
from volsplat.client.scene.default_scene import default_scene
from volsplat.client.session.single import SingleProcess
from volsplat.mapshade_server.held.level_columns import DIRECTIONS, Slant
from volsplat.mapshade_server.held.packet_store import STORED, PacketStore, is_store, open_store
from volsplat.mapshade_server.held.volume_identity import identified_store
from volsplat.mapshade_server.prepare import Options
from volsplat.mapshade_server.prepare.layout import Layout
from volsplat.mapshade_server.readers import open_volume
from volsplat.protocol.description.scene import Refine
from volsplat.protocol.description.volume import Box
from volsplat.protocol.text.errors import BadInput

NO_DATA = 1 << 31


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("store")
    store_of(folder, values_of("float32"))
    return folder / "volume.zarr"


@pytest.fixture(scope="module")
def store(place: Path) -> PacketStore:
    return open_store(str(place))


@pytest.mark.parametrize("host", ["", "localhost"])
def test_a_store_may_be_named_by_a_url(host: str, place: Path) -> None:
    url = f"file://{host}{place}"
    assert identified_store(url)[1] == identified_store(str(place))[1]
    with SingleProcess(url) as drawn, SingleProcess(str(place)) as by_path:
        scene = default_scene(by_path.volume.subject())
        assert drawn.volume.prepared is not None and torch.equal(drawn.render(scene), by_path.render(scene))


def ranges(length: int) -> st.SearchStrategy[tuple[int, int]]:
    return st.tuples(st.integers(0, length), st.integers(0, length)).map(lambda ends: (min(ends), max(ends)))


@given(data=st.data())
def test_any_box_holds_its_packets(data: st.DataObject, store: PacketStore) -> None:
    level = data.draw(st.integers(0, len(store.levels) - 1))
    dims = store.levels[level].dims
    (i0, i1), (j0, j1), (k0, k1) = (data.draw(ranges(length)) for length in dims)
    whole = store.read(level, Box((0, 0, 0), dims))
    part = store.read(level, Box((i0, j0, k0), (i1, j1, k1)))
    assert part.dtype == np.uint32 and part.flags.c_contiguous and part.shape == (k1 - k0, j1 - j0, i1 - i0)
    assert (part == whole[k0:k1, j0:j1, i0:i1]).all()


def test_level_0_is_the_volume_packed_as_one(store: PacketStore) -> None:
    geometry = store.description.geometry
    assert geometry.dims == ODD_DIMS and store.levels[0] == geometry
    packed = packed_whole(geometry, values_of("float32"), store.quantisation)
    assert (store.read(0, geometry.box) == packed).all()


def test_bricks_tell_what_their_voxels_hold(store: PacketStore) -> None:
    empty = 0
    for level, geometry in enumerate(store.levels):
        packets = store.read(level, geometry.box)
        bricks = store.bricks(level)
        assert bricks.dtype == np.uint8 and bricks.shape == (*(-(-n // SMALL.brick) for n in packets.shape), 5)
        for place in np.ndindex(*bricks.shape[:3]):
            brick = packets[tuple(slice(n * SMALL.brick, (n + 1) * SMALL.brick) for n in place)]
            drawn = brick[brick < NO_DATA]
            density_low, density_high, strength_low, strength_high, _ = bricks[place].tolist()
            if drawn.size:
                assert (density_low, density_high) == ((drawn & 255).min(), (drawn & 255).max())
                assert (strength_low, strength_high) == ((drawn >> 8 & 255).min(), (drawn >> 8 & 255).max())
            else:
                empty += 1
                assert density_low > density_high and strength_low > strength_high
    assert empty >= 8


def read_so_far() -> int:
    lines = Path("/proc/self/io").read_text(encoding="utf-8").splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("rchar"))


@pytest.mark.skipif(sys.platform != "linux", reason="counts what the system says that it read")
def test_a_box_reads_its_bricks_and_no_more(tmp_path: Path) -> None:
    layout = Layout(brick=16, shard=64, coarsest=16**3)
    volume = written(tmp_path / "noise.nrrd", values_of("int16", (128, 64, 64)))
    prepare_small(volume, tmp_path / "noise.zarr", Options(layout=layout))
    store = open_store(str(tmp_path / "noise.zarr"))
    store.read(0, Box((0, 0, 0), (1, 1, 1)))  # imports
    brick_bytes, index_bytes, buffering = 4 * 16**3, 16 * 64 + 4, 16384
    before = read_so_far()
    store.read(0, Box((18, 18, 18), (46, 30, 30)))  # two bricks of one shard
    took = read_so_far() - before
    assert brick_bytes < took < 2 * brick_bytes + index_bytes + 3 * buffering < 4**3 * brick_bytes / 2


def test_bricks_of_nothing_but_background_are_not_stored(tmp_path: Path) -> None:
    """Background is what most bricks hold: air here, which has a value, beside a corner without data."""
    values = np.full((96, 64, 64), -7, np.float32)
    values[20:28, 20:30, 20:30] = values_of("int16", (10, 10, 8))
    values[-8:] = np.nan
    store = store_of(tmp_path, values)
    packets = store.read(0, store.description.geometry.box)
    assert (packets == packed_whole(store.description.geometry, values, store.quantisation)).all()
    background = packets[60, 60, 60]
    assert background < NO_DATA and background >> 8 & 255 == 0
    stored = store.bricks(0)[..., STORED]
    for place in np.ndindex(*stored.shape):
        brick = packets[tuple(slice(n * SMALL.brick, (n + 1) * SMALL.brick) for n in place)]
        assert stored[place] == (brick != background).any()
    assert 0 < stored.sum() < stored.size // 3
    shards = [path for path in (tmp_path / "volume.zarr" / "0" / "c").rglob("*") if path.is_file()]
    assert len(shards) < 6 * 4 * 4 // 2
    by_zarr = zarr.open_array(tmp_path / "volume.zarr", path="0", mode="r")
    assert (np.asarray(by_zarr[:]) == packets).all()


def test_without_data_most_is_background(tmp_path: Path) -> None:
    values = np.full((40, 40, 40), np.nan, np.float32)
    values[:9, :9, :9] = values_of("int16", (9, 9, 9))
    store = store_of(tmp_path, values)
    assert (store.read(0, Box((16, 16, 16), (40, 40, 40))) == NO_DATA).all()
    assert store.bricks(0)[..., STORED].sum() == 8


def test_prepared_without_background_a_volume_draws_the_same_bits(tmp_path: Path) -> None:
    values = np.zeros((48, 48, 48), np.uint8)
    values[9:30, 10:20, 4:25] = values_of("uint8", (21, 10, 21))
    store_of(tmp_path, values)
    images = []
    for name in ("volume.nrrd", "volume.zarr"):
        with SingleProcess(tmp_path / name) as single:
            scene = msgspec.structs.replace(single.volume.default_scene(), refine=Refine(striding=True))
            images.append(single.render(scene))
    assert images[0].any() and torch.equal(*images)


def test_a_store_is_told_from_other_folders(place: Path, tmp_path: Path) -> None:
    assert is_store(place)
    (tmp_path / "zarr.json").write_text('{"zarr_format": 3, "node_type": "group", "attributes": {}}')
    assert not is_store(tmp_path) and not is_store(tmp_path / "nowhere") and not is_store(tmp_path / "zarr.json")
    with pytest.raises(BadInput, match="is no packet store"):
        open_store(str(tmp_path))
    with pytest.raises(BadInput, match="no packet store can be opened here"):
        open_store(str(tmp_path / "nowhere"))


def test_what_cannot_be_looked_at_is_no_store(tmp_path: Path) -> None:
    too_long = tmp_path / ("x" * 300)
    assert not is_store(too_long)
    with pytest.raises(BadInput, match="no packet store can be opened here"):
        open_store(str(too_long))


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can become another user")
def test_a_folder_that_is_closed_to_its_reader_is_no_store(tmp_path: Path) -> None:
    with TemporaryDirectory() as folder:  # those above tmp_path are closed as well
        Path(folder).chmod(0o700)
        pid = os.fork()
        if not pid:
            os.setuid(65534)  # nobody
            os._exit(int(is_store(Path(folder))))
        assert os.waitpid(pid, 0)[1] == 0


def changed(place: Path, copy: Path, **fields: object) -> str:
    """A copy that tells other things, as if it had been written so."""
    shutil.copytree(place, copy)
    metadata = json.loads((copy / "zarr.json").read_text(encoding="utf-8"))
    told = metadata["attributes"]["volsplat"]
    told.update(fields)
    metadata["attributes"]["volsplat_crc32"] = zlib.crc32(json.dumps(told, sort_keys=True).encode())
    (copy / "zarr.json").write_text(json.dumps(metadata))
    return str(copy)


def test_an_unfinished_store_is_refused(place: Path, tmp_path: Path) -> None:
    copy = changed(place, tmp_path / "copy.zarr", complete=False)
    with pytest.raises(BadInput) as refusal:
        open_store(copy)
    assert (
        str(refusal.value)
        == f"{copy}: was not finished; run the `volsplat prepare` that began it from volume.nrrd once more"
    )


def test_a_store_of_another_format_or_with_damaged_attributes_is_refused(place: Path, tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="of format 5, this version reads format 12; delete it and run"):
        open_store(changed(place, tmp_path / "older.zarr", format=5))
    with pytest.raises(BadInput, match="attributes are damaged"):
        open_store(changed(place, tmp_path / "damaged.zarr", quantisation={"window": "wide"}))
    with pytest.raises(BadInput, match="attributes are damaged"):
        open_store(changed(place, tmp_path / "without.zarr", levels=[]))


def test_damaged_shards_and_missing_arrays_are_refused_in_one_line(place: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy.zarr"
    shutil.copytree(place, copy)
    shard = max(
        (path for path in (copy / "0" / "c").rglob("*") if path.is_file()), key=lambda path: path.stat().st_size
    )
    shard.write_bytes(bytes(100) + shard.read_bytes()[100:-100] + bytes(100))
    store = open_store(str(copy))
    with pytest.raises(BadInput, match=f"its {shard.relative_to(copy)} cannot be read") as refusal:
        store.read(0, store.description.geometry.box)
    assert "\n" not in str(refusal.value)
    shutil.rmtree(copy / "1")
    with pytest.raises(BadInput, match="its 1 is missing"):
        open_store(str(copy))


def test_nobody_is_told_to_delete_a_store_that_is_closed_to_them(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store = open_store(str(place))

    def closed(array: object, selection: object) -> None:
        raise PermissionError(errno.EACCES, "no", "c/0")

    monkeypatch.setattr(zarr.Array, "__getitem__", closed)
    with pytest.raises(BadInput, match=r"cannot be read \(Permission denied\); check its permissions") as refusal:
        store.read(0, store.description.geometry.box)
    assert "delete" not in str(refusal.value) and "damaged" not in str(refusal.value)


def test_what_voxels_cannot_stand_for_is_refused(place: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy.zarr"
    shutil.copytree(place, copy)
    zarr.open_array(copy / "mixtures" / "1", mode="r+")[1, 3] = 0
    zarr.open_array(copy / "mixtures" / "2", mode="r+")[0, 3] = 1 << 40
    store = open_store(str(copy))
    for level in (1, 2):
        with pytest.raises(BadInput, match=f"its mixtures/{min(level, 1)} is not what was written; delete it"):
            store.mixture(level)
    zarr.open_array(copy / "mixtures" / "1", mode="r+")[1, 3] = 1
    with pytest.raises(BadInput, match="its mixtures/2 is not what was written; delete it"):
        store.mixture(2)


def test_columns_of_another_level_are_refused(place: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy.zarr"
    shutil.copytree(place, copy)
    shutil.rmtree(copy / "columns" / "1")
    shutil.copytree(copy / "columns" / "2", copy / "columns" / "1")
    with pytest.raises(BadInput, match=r"its columns/1/0/zarr\.json is not what was written; delete it"):
        open_store(str(copy)).mixture(1)


def a_thousand_times_larger(document: dict[str, Any]) -> None:
    document["shape"] = [1000 * length for length in document["shape"]]
    document["chunk_grid"]["configuration"]["chunk_shape"] = document["shape"]


def in_several_chunks(document: dict[str, Any]) -> None:
    chunks = document["chunk_grid"]["configuration"]["chunk_shape"]
    chunks[0] = max(chunks[0] // 2, 1)
    document["shape"][0] = chunks[0] * 2


def of_another_type(document: dict[str, Any]) -> None:
    document["data_type"] = "float32"


def a_group(document: dict[str, Any]) -> None:
    document.clear()
    document.update(zarr_format=3, node_type="group", attributes={})


@pytest.mark.parametrize("change", [a_thousand_times_larger, in_several_chunks, of_another_type, a_group])
@pytest.mark.parametrize("array", ["histograms/density", "blocks", "bricks/0", "mixtures/1", "columns/1/12", "0", "1"])
def test_what_a_document_says_of_its_array_is_what_the_store_says(
    array: str, change: Callable[[dict[str, Any]], None], place: Path, tmp_path: Path
) -> None:
    """No checksum is over it, and it decides how much memory is taken."""
    copy = tmp_path / "copy.zarr"
    shutil.copytree(place, copy)
    document = json.loads((copy / array / "zarr.json").read_text(encoding="utf-8"))
    change(document)
    (copy / array / "zarr.json").write_text(json.dumps(document))
    with pytest.raises(BadInput, match=f"its {array}(/zarr.json is not what was written| is a group); delete it"):
        read_of(open_store(str(copy)), Path(array))


@pytest.mark.parametrize("level", ["0", "1"])
def test_levels_without_shards_or_of_other_bricks_are_refused(level: str, place: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy.zarr"
    shutil.copytree(place, copy)
    array = zarr.open_group(copy)[level]
    assert isinstance(array, zarr.Array) and array.shards is not None
    for chunks, shards in ((array.chunks, None), ((8, 8, 4), array.shards)):
        zarr.create_array(
            copy / level,
            shape=array.shape,
            chunks=chunks,
            shards=shards,
            dtype="uint32",
            fill_value=array.fill_value,
            overwrite=True,
        )
        with pytest.raises(BadInput, match=rf"its {level}/zarr\.json is not what was written; delete it"):
            open_store(str(copy))


REFLECTED = (np.full((65536, 6), 0.1),) * 2
SPOILT = 12  # places in each file: zstd's checksums are over all bytes, ours to see is that all files have one


def files_of(folder: Path) -> list[Path]:
    return sorted(path.relative_to(folder) for path in folder.rglob("*") if path.is_file())


def read_packets(store: PacketStore, level: int) -> bytes:
    return store.read(level, store.levels[level].box).tobytes()


def read_bricks(store: PacketStore, level: int) -> bytes:
    return store.bricks(level).tobytes()


def what_voxels_stand_for(store: PacketStore, level: int) -> bytes:
    mixture = store.mixture(level)
    assert mixture is not None
    return mixture.means(np.arange(65536.0)[:, None]).tobytes()


def seen_in_columns(store: PacketStore, level: int) -> list[object]:
    mixture = store.mixture(level)
    assert mixture is not None and mixture.columns is not None
    seen = [one for number in range(len(DIRECTIONS)) for one in mixture.columns.seen(number, Slant(), *REFLECTED)]
    return [(*one.emitted, *(part.tobytes() for reflected in one.reflected for part in reflected)) for one in seen]


def readings(store: PacketStore) -> dict[str, Callable[[], object]]:
    """Of each array of a store, what is read of it."""
    found: dict[str, Callable[[], object]] = {
        "histograms/density": lambda: store.density_counts,
        "histograms/strength": lambda: store.strength_counts,
        "blocks": lambda: store.extremes,
    }
    for n in range(len(store.levels)):
        found[str(n)] = partial(read_packets, store, n)
        found[f"bricks/{n}"] = partial(read_bricks, store, n)
        if n:
            found[f"mixtures/{n}"] = partial(what_voxels_stand_for, store, n)
            found[f"columns/{n}"] = partial(seen_in_columns, store, n)
    return found


def read_of(store: PacketStore, array: Path) -> None:
    """What an array is read for."""
    (read,) = (read for name, read in readings(store).items() if array.is_relative_to(name))
    read()


def read_whole(place: str, first: Path = Path()) -> dict[str, object]:
    """All that anybody reads of a store; first the array that a file is of: if it is refused, the rest need not be."""
    store = open_store(place)
    found = readings(store)
    arrays = sorted(found, key=lambda array: not first.is_relative_to(array))
    return {"itself": (store.description, store.quantisation), **{array: found[array]() for array in arrays}}


def test_four_bytes_overwritten_anywhere_are_refused_or_change_nothing(tmp_path: Path) -> None:
    """Nothing that was changed on the disk is ever drawn; a file with bytes that count is named."""
    store = store_of(tmp_path, values_of("int16", (18, 9, 7)), Options(layout=Layout(8, 16, 4**3)))
    assert len(store.levels) == 3
    copy = tmp_path / "volume.zarr"
    as_written, places = read_whole(str(copy)), np.random.default_rng(3)
    refused = 0
    for name in files_of(copy):
        sound = (copy / name).read_bytes()
        for _ in range(SPOILT):
            at = int(places.integers(0, len(sound) - 4))
            spoilt = sound[:at] + bytes(byte ^ 0x55 for byte in sound[at : at + 4]) + sound[at + 4 :]
            (copy / name).write_bytes(spoilt)
            try:
                assert read_whole(str(copy), name) == as_written, (name, at)
            except BadInput as refusal:
                refused += 1
                assert len(str(refusal).splitlines()) == 1
                assert name.name == "zarr.json" or f"its {name} cannot be read" in str(refusal)
        (copy / name).write_bytes(sound)
    assert refused > 100


def test_a_shard_that_vanished_is_not_taken_for_background(place: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy.zarr"
    shutil.copytree(place, copy)
    (copy / "0" / "c" / "1" / "0" / "1").unlink()
    (copy / "histograms" / "density" / "c" / "0").unlink()
    store = open_store(str(copy))
    with pytest.raises(BadInput, match="its histograms/density/c/0 is missing"):
        _ = store.density_counts
    with pytest.raises(BadInput, match="copy.zarr: is damaged: its 0/c/1/0/1 is missing; delete it and run"):
        store.read(0, store.description.geometry.box)
    assert store.read(0, Box((0, 0, 0), (16, 16, 16))).shape == (16, 16, 16)


def test_without_zarr_it_says_what_to_install(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "zarr", None)
    with pytest.raises(BadInput, match=r"needs zarr, which is not installed: pip install 'volsplat\[formats\]'"):
        open_store(str(place))


@pytest.mark.parametrize("part", ["#0", "/0", "/bricks", "#bricks/0"])
def test_what_is_within_a_store_is_no_volume(tmp_path: Path, part: str) -> None:
    """Its numbers are packets, of which a picture could be made."""
    store_of(tmp_path, values_of("uint8"))
    with pytest.raises(BadInput, match="is of a packet store, which `volsplat prepare` has made"):
        open_volume(f"{tmp_path / 'volume.zarr'}{part}")


def test_a_store_is_not_prepared_again(tmp_path: Path) -> None:
    store_of(tmp_path, values_of("uint8"))
    with pytest.raises(BadInput, match="the volume that it was made from"):
        prepare_small(tmp_path / "volume.zarr", tmp_path / "again.zarr")
