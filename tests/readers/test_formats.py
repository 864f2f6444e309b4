"""The table of formats: each has a sample that it alone recognises, refuses half of it, and stands in the docs."""

import re
from pathlib import Path

import pytest

from support.checkout import ROOT
from support.files.opened import described, read_whole
from support.files.refusals import assert_refused_in_one_line
from support.files.samples import FOLDER_SAMPLES, SAMPLES
from volsplat.mapshade_server.readers.open_volume import FOLDER_FORMATS, FORMATS, VolumeFormat, format_of

# Of these a part is a volume too, or a file without its end.
WHOLE_WHEN_CUT = ("DICOM series (a folder)", "PDB or PQR coordinates (.pdb, .pqr)", "mmCIF (.cif)")


def test_every_format_has_a_sample() -> None:
    """A new line in the table needs one in support/files/samples.py: the tests below are made of it."""
    assert set(SAMPLES) == {one.name for one in FORMATS}
    assert set(FOLDER_SAMPLES) == {one.name for one in FOLDER_FORMATS}


@pytest.mark.parametrize("one", FORMATS, ids=lambda one: one.name)
def test_a_sample_is_taken_by_its_own_format_and_read(one: VolumeFormat, tmp_path: Path) -> None:
    path = SAMPLES[one.name](tmp_path)
    assert format_of(path, path.read_bytes()) is one
    assert read_whole(path).shape == described(path).geometry.dims[::-1]


@pytest.mark.parametrize("name", FOLDER_SAMPLES)
def test_a_folder_is_taken_by_its_own_format_and_read(name: str, tmp_path: Path) -> None:
    path = FOLDER_SAMPLES[name](tmp_path)
    assert next(one.name for one in FOLDER_FORMATS if one.recognises(path)) == name
    assert read_whole(path).shape == described(path).geometry.dims[::-1]


@pytest.mark.parametrize("name", [name for name in SAMPLES if name not in WHOLE_WHEN_CUT])
def test_half_a_file_is_refused_in_one_line(name: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    path = SAMPLES[name](tmp_path)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    assert_refused_in_one_line(read_whole, path.with_suffix("") if name.startswith("Analyze") else path, "", capfd)


@pytest.mark.parametrize("one", FORMATS, ids=lambda one: one.name)
def test_the_docs_name_the_format(one: VolumeFormat) -> None:
    tables = [
        line
        for line in (ROOT / "docs/reference/formats.md").read_text(encoding="utf-8").splitlines()
        if line[:2] == "| "
    ]
    formats = "\n".join(line.split("|")[1] for line in tables)
    for extension in re.findall(r"\.[\w.]+(?=[,)])", one.name):
        assert extension in formats, f"docs/reference/formats.md has no {extension} in the first column of its tables"
