"""The table of formats: each has a sample that it alone recognises, refuses half of it, and stands in the docs."""

import re
from pathlib import Path

import numpy as np
import pytest

from support.checkout import ROOT
from support.files.opened import described, read_whole
from support.files.refusals import assert_refused_in_one_line
from support.files.samples import FOLDER_SAMPLES, SAMPLES
from volsplat.mapshade_server.answers.file_voxels import FileVoxels
from volsplat.mapshade_server.held.volume_identity import identified_volume
from volsplat.mapshade_server.readers.open_volume import file_formats, folder_formats, format_of
from volsplat.mapshade_server.readers.reading.volume_reader import VolumeFormat
from volsplat.protocol.messages.value_messages import ReadVoxel, VoxelRead

# Of these a part is a volume too, or a file without its end.
WHOLE_WHEN_CUT = ("DICOM series (a folder)", "PDB or PQR coordinates (.pdb, .pqr)", "mmCIF (.cif)")


def test_every_format_has_a_sample() -> None:
    """A new line in the table needs one in support/files/samples.py: the tests below are made of it."""
    assert set(SAMPLES) == {one.name for one in file_formats()}
    assert set(FOLDER_SAMPLES) == {one.name for one in folder_formats()}


@pytest.mark.parametrize("one", [*file_formats()], ids=lambda one: one.name)
def test_a_sample_is_taken_by_its_own_format_and_read(one: VolumeFormat, tmp_path: Path) -> None:
    path = SAMPLES[one.name](tmp_path)
    assert format_of(path, path.read_bytes()) is one
    assert_read_whole_and_by_voxels(path)


@pytest.mark.parametrize("one", [b" ", b"\n", b"\t\r\n", b"#\n", b" # \n", b"#"])
def test_no_format_takes_blank_text_for_its_own_however_much_there_is(one: bytes) -> None:
    for head in (one * 100_000, one * 100_000 + b"data_"):
        assert format_of(Path("file"), head) is None


def test_a_format_may_begin_after_comments_and_blank_lines() -> None:
    for before in (b"", b" \n", b"# data_none\n", b"\n #\n\t# told\n  " * 10_000):
        found = format_of(Path("file"), before + b"data_made\n")
        assert found is not None and found.name == "mmCIF (.cif)"


@pytest.mark.parametrize("name", FOLDER_SAMPLES)
def test_a_folder_is_taken_by_its_own_format_and_read(name: str, tmp_path: Path) -> None:
    path = FOLDER_SAMPLES[name](tmp_path)
    assert next(one.name for one in folder_formats() if one.recognises(path)) == name
    assert_read_whole_and_by_voxels(path)


def assert_read_whole_and_by_voxels(path: Path) -> None:
    values, dims, identity = read_whole(path), described(path).geometry.dims, identified_volume(str(path))[1]
    assert values.shape == dims[::-1]
    voxels, choose = FileVoxels(), np.random.default_rng(19)
    for i, j, k in ([int(choose.integers(size)) for size in dims] for _ in range(5)):
        told, (own, *_) = voxels.read(ReadVoxel(1, str(path), identity, (i, j, k)))
        assert isinstance(told, VoxelRead) and told.scalar_types[0] == values.dtype.name
        assert bytes(own) == values[k, j, i].tobytes()


@pytest.mark.parametrize("name", [name for name in SAMPLES if name not in WHOLE_WHEN_CUT])
def test_half_a_file_is_refused_in_one_line(name: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path = SAMPLES[name](tmp_path)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    assert_refused_in_one_line(read_whole, path.with_suffix("") if name.startswith("Analyze") else path, "", capfd)


@pytest.mark.parametrize("one", [*file_formats()], ids=lambda one: one.name)
def test_the_docs_name_the_format(one: VolumeFormat) -> None:
    tables = [
        line
        for line in (ROOT / "docs/reference/formats.md").read_text(encoding="utf-8").splitlines()
        if line[:2] == "| "
    ]
    formats = "\n".join(line.split("|")[1] for line in tables)
    for extension in re.findall(r"\.[\w.]+(?=[,)])", one.name):
        assert extension in formats, f"docs/reference/formats.md has no {extension} in the first column of its tables"
