"""Raw voxels: described by the part, a sidecar or the name, and never guessed."""

import gzip
from pathlib import Path

import numpy as np
import pytest

from support.files.counted_bytes import bytes_read
from support.files.opened import read_whole
from support.files.volume_files import ALL_TYPES, values_of
from volsplat.mapshade_server.readers import open_volume
from volsplat.mapshade_server.readers.reading.volume_reader import Voxels
from volsplat.protocol.description.volume import Box
from volsplat.protocol.text.errors import BadInput

DESCRIBED = "dims=7x6x5,type=int16,endian=little"


def raw(folder: Path, values: Voxels, name: str = "head.raw", before: bytes = b"") -> Path:
    path = folder / name
    path.write_bytes(before + values.tobytes())
    return path


@pytest.mark.parametrize("endian", ["little", "big"])
@pytest.mark.parametrize("scalar_type", ALL_TYPES)
def test_every_type_comes_back_in_both_byte_orders(scalar_type: str, endian: str, tmp_path: Path) -> None:
    values = values_of(scalar_type)
    stored = values.astype(values.dtype.newbyteorder("<" if endian == "little" else ">"))
    path = raw(tmp_path, stored, before=b"head")
    got = read_whole(f"{path}#dims=7x6x5,type={scalar_type},endian={endian},skip=4")
    assert got.dtype == values.dtype and got.flags.c_contiguous
    np.testing.assert_array_equal(got, values)


def test_the_part_tells_spacing_and_unit(tmp_path: Path) -> None:
    path = raw(tmp_path, values_of("int16"))
    for spacing in ("1x1.5x2e-1", "1,1.5,0.2"):
        description = open_volume(f"{path}#{DESCRIBED},spacing={spacing},unit=mm").description
        assert description.geometry.spacing == (1.0, 1.5, 0.2)
        assert description.unit == "mm" and not description.warnings


def test_a_sidecar_says_the_same(tmp_path: Path) -> None:
    values = values_of("uint16")
    path = raw(tmp_path, values.byteswap(), "head.anything", before=bytes(512))
    (tmp_path / "head.anything.toml").write_text(
        'dims = [7, 6, 5]\ntype = "uint16"\nendian = "big"\nskip = 512\nspacing = [1, 1, 2.5]\n'
    )
    np.testing.assert_array_equal(read_whole(str(path)), values)
    assert open_volume(str(path)).description.geometry.spacing == (1, 1, 2.5)
    assert open_volume(f"{path}#spacing=3x3x3").description.geometry.spacing == (3, 3, 3)


def test_the_name_says_the_same(tmp_path: Path) -> None:
    values = values_of("uint8")
    np.testing.assert_array_equal(read_whole(str(raw(tmp_path, values, "tooth_7x6x5_uint8.raw"))), values)
    packed = tmp_path / "tooth_7x6x5_uint8.raw.gz"
    packed.write_bytes(gzip.compress(values.tobytes()))
    np.testing.assert_array_equal(read_whole(str(packed)), values)
    assert open_volume(str(packed)).description.why_whole


def test_a_byte_order_that_nobody_tells_is_told_to_be_taken(tmp_path: Path) -> None:
    values = values_of("int16")
    path = raw(tmp_path, values, "tooth_7x6x5_int16.raw")
    (warning,) = open_volume(str(path)).description.warnings
    assert "little endian is taken" in warning
    np.testing.assert_array_equal(read_whole(str(path)), values)
    assert not open_volume(f"{path}#endian=little").description.warnings


def test_only_the_sub_cube_is_read(tmp_path: Path) -> None:
    values = np.zeros((128, 128, 128), np.uint16)
    name = f"{raw(tmp_path, values)}#dims=128x128x128,type=uint16,endian=big"
    read_whole(name)
    before = bytes_read()
    reader = open_volume(name)
    reader.read(Box((0, 32, 64), (128, 96, 72)))
    assert bytes_read() - before - 128 * 64 * 8 * 2 < values.nbytes // 64


REFUSALS = {
    "": "raw voxels without a header, of unknown dims and type; say what they are, as in",
    "dims=7x6x5": "of unknown type",
    "7x6x5": "“7x6x5” does not describe raw voxels",
    "dims=7x6,type=int16": "“dims=7x6” needs 3 numbers",
    "dims=7x6x5.5,type=int16": "needs 3 whole numbers",
    "dims=7x6x-5,type=int16": "needs 3 whole numbers",
    "dims=7x6xnan,type=int16": "needs 3 numbers",
    "dims=7x6x0,type=int16": "at least one voxel",
    "dims=7x6x5,type=int12": "“type=int12” is not one of uint8, int8",
    "dims=7x6x5,type=int16,endian=middle": "is not one of little, big",
    "dims=7x6x5,type=int16,order=big": "“order=big” is not an option here; there are dims, type, endian",
    "dims=7x6x5,type=int16,type=int8": "“type” in “dims=7x6x5,type=int16,type=int8” is given twice",
    "dims=7x6x5,type=": "has no value",
    "dims=7x6x5,type=int32": "are 840 bytes, but the file has 420",
    "dims=7x6x5,type=int8": "but the file has 420; correct dims, type or skip; skip=210 would fit",
    "dims=7x6x5,type=int16,skip=1": "420 bytes after 1 skipped, but the file has 420",
    "dims=70000x60000x50000,type=float64": "are 1680000000000000 bytes, but the file has 420",
    f"{DESCRIBED},spacing=1x1x0": "do not span space",
    f"{DESCRIBED},spacing=1x1": "needs 3 numbers, as in 1x2x3",
}


@pytest.mark.parametrize("part", REFUSALS)
def test_what_is_not_described_is_refused_in_one_line(
    part: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = raw(tmp_path, values_of("int16"))
    with pytest.raises(BadInput) as refusal:
        open_volume(f"{path}#{part}")
    text = str(refusal.value)
    assert REFUSALS[part] in text and str(path) in text and "\n" not in text
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("told", ["dims = " + "[" * 20_000, "skip = 0x" + "f" * 5000, "skip = " + "9" * 5000])
def test_a_sidecar_that_is_made_to_do_harm_is_refused_in_one_line(told: str, tmp_path: Path) -> None:
    path = raw(tmp_path, values_of("int16"))
    (tmp_path / "head.raw.toml").write_text(told)
    with pytest.raises(BadInput, match=r"head\.raw\.toml: is not TOML") as refusal:
        open_volume(str(path))
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize("name", ["voxels.zraw", "mole[cule].binary", "7", "voxels.raw", "voxels.raw.gz"])
@pytest.mark.parametrize(
    "header, line",
    [
        ("a.mhd", "ElementDataFile = {}"),
        ("a.mhd", "ElementDataFile = LIST\nfirst.raw\n{}"),
        ("a.nhdr", "data file: ./{}"),
        ("a.nhdr", "datafile: LIST\nparts/first.raw\nparts/{}"),
    ],
)
def test_a_file_whose_name_a_header_beside_it_bears_is_that_header_s(
    name: str, header: str, line: str, tmp_path: Path
) -> None:
    (tmp_path / name).write_bytes(bytes(range(1, 200)))
    (tmp_path / "of_another.mhd").write_text(f"NDims = {name}\nElementDataFile = not{name}\n")
    (tmp_path / "of_another.nhdr").write_text(f"# {name}\ndimension: {name}\ndata file: not{name}\nkey:={name}\n")
    with pytest.raises(BadInput) as refusal:
        open_volume(str(tmp_path / name))
    assert "beside it" not in str(refusal.value)
    (tmp_path / header).write_text(f"of any kind\n{line.format(name)}\n")
    with pytest.raises(BadInput, match=rf"{header} beside it.*instead"):
        open_volume(str(tmp_path / name))


def test_a_header_beside_is_pointed_at(tmp_path: Path) -> None:
    path = raw(tmp_path, values_of("int16"))
    path.with_suffix(".nhdr").write_text("NRRD0004\n")
    with pytest.raises(BadInput, match=r"open head\.nhdr beside it instead"):
        open_volume(str(path))


def test_a_file_of_unknown_format_is_told_of_descriptions(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="raw voxels are described as in .*#dims="):
        open_volume(str(raw(tmp_path, values_of("int16"), "head.binary")))


def test_a_damaged_sidecar_is_refused(tmp_path: Path) -> None:
    path = raw(tmp_path, values_of("int16"))
    for text, cause in (("dims = [7", "is not TOML"), ("depth = 3", "“depth=3” is not an option")):
        (tmp_path / "head.raw.toml").write_text(text)
        with pytest.raises(BadInput, match=cause) as refusal:
            open_volume(str(path))
        assert "\n" not in str(refusal.value)


def test_real_raw_files_equal_those_with_headers(shared_data: Path) -> None:
    for name, header in (
        ("volvis/tooth_103x94x161_uint8.raw", "volvis/tooth_103x94x161_uint8.nhdr"),
        ("volvis/neghip_64x64x64_uint8.raw", "volvis/neghip_64x64x64_uint8.nhdr"),
        ("volvis/nucleon_41x41x41_uint8.raw", "volvis/nucleon_41x41x41_uint8.nhdr"),
        ("sod/molecule97x97x116.binary#dims=97x97x116,type=uint8,skip=12", "sod/sod_density_97x97x116.nhdr"),
    ):
        np.testing.assert_array_equal(
            read_whole(str(shared_data / name)), read_whole(str(shared_data / header)), err_msg=name
        )


def test_a_real_big_endian_slice_equals_the_stack(shared_data: Path) -> None:
    slices = "ct_head/slices_53_to_60/CThead.53#dims=256x256x1,type=uint16,endian=big"
    stack = open_volume(str(shared_data / "ct_head/cthead_256x256x113.nrrd"))
    np.testing.assert_array_equal(read_whole(str(shared_data / slices)), stack.read(Box((0, 0, 52), (256, 256, 53))))
