"""NumPy's .npy and .npz: what is saved comes back, no more is read than is wanted, and nothing else is loaded."""

import gzip
import math
import pickle
import zipfile
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from support.files.opened import read_whole
from support.files.refusals import assert_refused_in_one_line
from support.files.volume_files import ALL_TYPES, values_of
from volsplat.mapshade_server.readers import open_volume
from volsplat.mapshade_server.readers.arrays import array_file
from volsplat.mapshade_server.readers.reading.volume_reader import Voxels
from volsplat.protocol.description.volume import Box
from volsplat.protocol.text.errors import BadInput


def saved(path: Path, values: Voxels) -> Path:
    np.save(path, values)
    return path


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("endian", ["<", ">"])
@pytest.mark.parametrize("scalar_type", ALL_TYPES)
def test_every_type_comes_back(
    scalar_type: str, endian: Literal["<", ">"], order: Literal["C", "F"], tmp_path: Path
) -> None:
    values = values_of(scalar_type)
    stored = np.array(values, values.dtype.newbyteorder(endian), order=order)
    path = saved(tmp_path / "volume.npy", stored)
    got = read_whole(path)
    assert got.dtype == values.dtype and got.dtype.isnative and got.flags.c_contiguous
    np.testing.assert_array_equal(got, values)
    part = open_volume(str(path)).read(Box((1, 2, 0), (5, 4, 3)))
    assert part.flags.c_contiguous and (part.base is None or part.base.nbytes == part.nbytes)
    np.testing.assert_array_equal(part, values[0:3, 2:4, 1:5])


def test_types_that_volumes_lack_become_the_next_larger(tmp_path: Path) -> None:
    halves = values_of("float32").astype(np.float16)
    for values, scalar_type in ((halves, "float32"), (values_of("uint8") > 50, "uint8")):
        path = saved(tmp_path / "volume.npy", values)
        assert open_volume(str(path)).description.scalar_type == scalar_type
        np.testing.assert_array_equal(read_whole(path), values.astype(scalar_type))


def test_the_part_tells_spacing_order_of_axes_and_index(tmp_path: Path) -> None:
    frames = np.arange(2 * 3 * 4 * 5, dtype=np.int16).reshape(2, 3, 4, 5)
    path = saved(tmp_path / "volume.npy", frames)
    np.testing.assert_array_equal(read_whole(f"{path}#axis0=1"), frames[1])
    np.testing.assert_array_equal(read_whole(f"{path}#axis3=4"), frames[..., 4])
    name = f"{path}#axes=tzyx,t=1,spacing=1,1,2,unit=mm"
    description = open_volume(name).description
    assert description.geometry.spacing == (1, 1, 2) and description.unit == "mm"
    np.testing.assert_array_equal(read_whole(name), frames[1])
    with pytest.raises(BadInput, match="choose an index of axis0, as in .*volume.npy#axis0=0"):
        open_volume(str(path))


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("name", ["volume.npy", "volume.npz"])
def test_only_the_rows_of_the_sub_cube_are_read(name: str, order: Literal["C", "F"], tmp_path: Path) -> None:
    values = np.zeros((256, 256, 256), np.uint16, order)
    path = tmp_path / name
    (np.save if name.endswith("npy") else np.savez)(path, values)
    reader = open_volume(str(path))
    assert reader.description.reads_sub_cubes
    box = Box((0, 0, 64), (256, 256, 72)) if order == "C" else Box((64, 0, 0), (72, 256, 256))
    before = read_bytes()
    reader.read(box)
    assert 2 * box.voxels <= read_bytes() - before <= 2 * box.voxels + 65536


def read_bytes() -> int:
    """How much this process has read so far."""
    counters = Path("/proc/self/io")
    if not counters.is_file():
        pytest.skip("this system does not tell what is read")
    return int(counters.read_text(encoding="utf-8").split()[1])


@given(
    st.lists(st.integers(1, 6), min_size=3, max_size=5),
    st.sampled_from(["C", "F"]),
    st.sampled_from(["<i2", ">f4", "|u1"]),
    st.sampled_from([0, 10, 1 << 20]),
    st.data(),
)
def test_what_is_picked_is_what_indexing_gives(
    shape: list[int], order: Literal["C", "F"], dtype: str, largest: int, data: st.DataObject
) -> None:
    """Whatever is read through, and however little of it at once."""
    values = np.arange(math.prod(shape)).reshape(shape).astype(dtype, order)
    selection: list[int | slice] = []
    for length in shape:
        low = data.draw(st.integers(0, length - 1))
        selection.append(low if data.draw(st.booleans()) else slice(low, data.draw(st.integers(low + 1, length))))
    with TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patched:
        path = Path(folder) / "numbers"
        path.write_bytes(b"head" + values.tobytes(order))
        patched.setattr(array_file, "READ_THROUGH_BYTES", data.draw(st.sampled_from([0, 8, 1 << 14])))
        patched.setattr(array_file, "LARGEST_READ_THROUGH", largest)
        file = array_file.ArrayFile(path, 4, np.dtype(dtype), tuple(shape), order)
        picked = file.pick(tuple(selection))
    np.testing.assert_array_equal(picked, values[tuple(selection)])
    assert picked.dtype.isnative


@pytest.mark.parametrize("name", ["volume.npy", "volume.npz"])
def test_a_file_that_is_cut_short_after_it_was_opened_is_one_clear_line(name: str, tmp_path: Path) -> None:
    """Were it mapped, this process would end by SIGBUS."""
    path = tmp_path / name
    (np.save if name.endswith("npy") else np.savez)(path, np.ones((64, 64, 64), np.uint16))
    reader = open_volume(str(path))
    with path.open("r+b") as file:
        file.truncate(100_000)
    with pytest.raises(
        BadInput, match=r"volume.np.*: it was cut short while it was read; fetch or save the array again"
    ):
        reader.read(reader.description.geometry.box)
    path.unlink()
    with pytest.raises(BadInput, match=r"cannot be read \(No such file or directory\)"):
        reader.read(reader.description.geometry.box)


def test_an_npz_gives_the_array_that_is_named(tmp_path: Path) -> None:
    values = values_of("int16")
    path = tmp_path / "arrays.npz"
    for save in (np.savez, np.savez_compressed):
        save(path, flat=values[0], one=values, other=values * 2)
        np.testing.assert_array_equal(read_whole(f"{path}#other"), values * 2)
        assert open_volume(f"{path}#one").description.reads_sub_cubes == (save is np.savez)
        with pytest.raises(BadInput, match=r"holds one \(5 x 6 x 7\), other \(5 x 6 x 7\); choose one, as .*npz#one"):
            open_volume(str(path))
        with pytest.raises(BadInput, match="has no array “two”; it holds flat, one, other"):
            open_volume(f"{path}#two")
        save(path, flat=values[0], one=values)
        np.testing.assert_array_equal(read_whole(path), values)
        like_options: dict[str, Any] = {"a": values, "a,t=1": values * 2}
        save(path, **like_options)
        np.testing.assert_array_equal(read_whole(f"{path}#a,t=1,axes=zyx"), values * 2)


def cut(path: Path, share: float) -> Path:
    raw = path.read_bytes()
    path.write_bytes(raw[: int(len(raw) * share)])
    return path


def zipped(path: Path) -> Path:
    path.write_bytes(gzip.compress(path.read_bytes()))
    return path


def with_header(path: Path, header: str, data: bytes = bytes(64)) -> Path:
    text = header.encode().ljust(117) + b"\n"
    path.write_bytes(b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text + data)
    return path


def bomb(path: Path) -> Path:
    """An .npz whose header promises more than its compressed bytes could become."""
    inner = with_header(path.with_suffix(".inner"), "{'descr': '<f8', 'fortran_order': False, 'shape': (90000,9000,9)}")
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.write(inner, "bomb.npy")
    raw = bytearray(path.read_bytes())
    size = len(inner.read_bytes()).to_bytes(4, "little")
    path.write_bytes(raw.replace(size, (0xFFFFFFF0).to_bytes(4, "little")))
    return path


def damaged(folder: Path, name: str, values: Voxels) -> Path:
    np.savez_compressed(folder / name, values)
    raw = bytearray((folder / name).read_bytes())
    raw[len(raw) // 2 : len(raw) // 2 + 40] = bytes(40)
    (folder / name).write_bytes(raw)
    return folder / name


NOISE = np.random.default_rng(0).integers(0, 30000, (20, 20, 20)).astype(np.int16)


def objects(path: Path) -> Path:
    np.save(path, np.array([[[{}]]], dtype=object))
    return path


REFUSALS: dict[str, tuple[Callable[[Path], Path], str]] = {
    "truncated": (lambda d: cut(saved(d / "v.npy", NOISE), 0.7), "promises 16000 bytes of numbers, but the file holds"),
    "no header": (lambda d: cut(saved(d / "v.npy", NOISE), 0.002), "header cannot be read"),
    "too large": (
        lambda d: with_header(d / "v.npy", "{'descr':'<f8','fortran_order':False,'shape':(90000,90000,90000)}"),
        "promises 5832000000000000 bytes",
    ),
    "negative": (
        lambda d: with_header(d / "v.npy", "{'descr': '<f8', 'fortran_order': False, 'shape': (-1, -2, 3)}"),
        "has the shape (-1, -2, 3)",
    ),
    "nested": (lambda d: with_header(d / "v.npy", "(" * 110), "header cannot be read"),
    "objects": (lambda d: objects(d / "v.npy"), "pickled Python objects, which are never loaded"),
    "complex": (lambda d: saved(d / "v.npy", NOISE.astype(np.complex64)), "has complex numbers (complex64)"),
    "long double": (lambda d: saved(d / "v.npy", NOISE.astype(np.longdouble)), "save it as float64"),
    "structure": (
        lambda d: saved(d / "v.npy", np.zeros((2, 2, 2), [("r", "u1"), ("g", "u1")])),
        "voxels of several fields (r, g)",
    ),
    "text": (lambda d: saved(d / "v.npy", np.full((2, 2, 2), "a")), "voxels of type str"),
    "gzip": (lambda d: zipped(saved(d / "v.npy", NOISE)), "is a gzip of"),
    "flat": (lambda d: saved(d / "v.npy", NOISE[0]), "a 2-D image, volsplat needs a volume"),
    "colour": (lambda d: saved(d / "v.npy", np.zeros((5, 6, 7, 3), np.uint8)), "choose an index of axis3"),
    "empty": (lambda d: saved(d / "v.npy", np.zeros((5, 0, 7))), "holds no voxels"),
    "truncated npz": (lambda d: cut(damaged(d, "v.npz", NOISE), 0.7), "damaged or truncated"),
    "damaged npz": (lambda d: damaged(d, "v.npz", NOISE), "damaged or truncated"),
    "bomb": (lambda d: bomb(d / "v.npz"), "promises 58320000000 bytes"),
}


@pytest.mark.parametrize("case", REFUSALS)
def test_bad_input_is_refused_in_one_line(case: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    make, cause = REFUSALS[case]
    assert_refused_in_one_line(read_whole, make(tmp_path), cause, capfd)


def test_an_npy_has_no_parts(tmp_path: Path) -> None:
    path = saved(tmp_path / "volume.npy", NOISE)
    with pytest.raises(BadInput, match="holds one array, it has no part “one”; leave out #one"):
        open_volume(f"{path}#one")


class Alarm:
    """What a pickle must not get to do."""

    def __reduce__(self) -> tuple[object, tuple[str]]:
        return (pytest.fail, ("a pickle was loaded",))


def test_pickles_are_not_run(tmp_path: Path) -> None:
    path = with_header(
        tmp_path / "v.npy", "{'descr': '|O', 'fortran_order': False, 'shape': (1, 1, 1)}", pickle.dumps(Alarm())
    )
    with pytest.raises(BadInput, match="never loaded"):
        open_volume(str(path))
