"""A volume's name: the place, and the part of it."""

from pathlib import Path

import numpy as np
import pytest

from support.files.opened import read_whole
from support.files.volume_files import values_of, written
from volsplat.mapshade_server.held.packet_store import names_store
from volsplat.mapshade_server.held.volume_identity import identified_volume
from volsplat.mapshade_server.readers import open_volume
from volsplat.protocol.description.volume_name import (
    MOST_SIGNS,
    absolute_name,
    check_is_there,
    possible_places,
    volume_name,
)
from volsplat.protocol.text.errors import BadInput


def test_what_follows_the_sign_is_the_part() -> None:
    assert volume_name("run.h5#/entry/data") == ("run.h5", "/entry/data")
    assert volume_name("s3://bucket/brain.zarr#2") == ("s3://bucket/brain.zarr", "2")
    assert volume_name("head.nrrd") == ("head.nrrd", "")


def test_a_file_whose_name_has_the_sign_is_taken_whole(tmp_path: Path) -> None:
    path = tmp_path / "run#3.nrrd"
    path.write_bytes(b"x")
    assert volume_name(str(path)) == (str(path), "")


def test_what_is_there_as_it_stands_is_no_part_of_what_lies_beside_it(tmp_path: Path) -> None:
    for folder in ("run", "run#1.zarr", "run#1.zarr/inner"):
        (tmp_path / folder).mkdir()
    run, whole = f"{tmp_path}/run", f"{tmp_path}/run#1.zarr"
    assert volume_name(whole) == (whole, "")
    assert volume_name(f"{whole}#2,t=1") == (whole, "2,t=1")
    assert volume_name(f"{whole}/inner") == (f"{whole}/inner", "")
    assert volume_name(f"{run}#1") == (run, "1")
    assert volume_name(f"{tmp_path}/no#1.zarr#2") == (f"{tmp_path}/no", "1.zarr#2")
    for name in (whole, f"{whole}#2,t=1", f"{run}#1"):
        assert str(volume_name(name)) == name, "which another process takes for the same"
    check_is_there(f"{whole}#2")


@pytest.mark.parametrize("text", ["#" * 4096, "/#" * 2048, "x/../#" * 682, "run.h5#/a" + "#" * MOST_SIGNS])
def test_a_name_has_no_more_places_to_look_at_than_a_few(text: str) -> None:
    assert len(possible_places(text)) == MOST_SIGNS + 1
    looked: list[str] = []

    def is_there(place: str) -> bool:
        looked.append(place)
        return False

    with pytest.raises(
        BadInput, match="^[^\n]*: has [0-9]+ times the sign #, and a volume's name has it 16 times at most; "
    ):
        volume_name(text, is_there)
    assert looked == []
    most = "run.h5#/a" + "#" * (MOST_SIGNS - 1)
    assert volume_name(most, is_there).place == "run.h5"
    assert len(looked) == MOST_SIGNS


def test_of_a_url_s_part_no_sign_is_looked_for() -> None:
    assert volume_name(f"https://host/a.zarr#{'#' * 100}") == ("https://host/a.zarr", "#" * 100)


def test_a_part_may_be_longer_than_the_name_of_any_file(tmp_path: Path) -> None:
    part = "/entry/" + "a" * 300
    for place in (tmp_path / "run.h5", tmp_path):
        assert volume_name(f"{place}#{part}") == (str(place), part)


def test_another_process_is_told_the_whole_way(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert absolute_name("run.h5#/data") == f"{tmp_path}/run.h5#/data"
    assert absolute_name("https://host/a.zarr#1") == "https://host/a.zarr#1"


@pytest.mark.parametrize("place", ["head.nrrd", "https://host/a.zarr"])
def test_an_endless_name_is_refused_before_a_server_is_told_it(place: str) -> None:
    for name in (f"{place}#{'9' * 5000}", place + "a" * 5000):
        for named in (volume_name, absolute_name, check_is_there):
            with pytest.raises(BadInput, match=f"a volume's name of {len(name)} letters is too long; .* at most 4096"):
                named(name)


@pytest.mark.parametrize("place", ["x:/head.nrrd", "x://head.nrrd", "x%3A%2F%2Fhead.nrrd"])
def test_a_url_of_a_file_here_leads_to_it_whatever_its_path_looks_like(tmp_path: Path, place: str) -> None:
    (tmp_path / "x:").mkdir()
    path = written(tmp_path / "x:" / "head.nrrd", values_of("uint8"))
    _, by_path = identified_volume(str(path))
    for begin in ("file://", "file://localhost", "File://LocalHost", "FILE://"):
        url = f"{begin}{tmp_path}/{place}"
        assert not volume_name(url).is_far
        np.testing.assert_array_equal(read_whole(url), read_whole(path))
        assert identified_volume(url)[1] == by_path


def test_a_url_s_scheme_is_the_same_in_capitals() -> None:
    named = volume_name("HTTPS://Host/A.zarr#1")
    assert named == ("HTTPS://Host/A.zarr", "1") and named.is_far
    assert named.plain_place == "https://Host/A.zarr"


@pytest.mark.parametrize("host", ["otherhost", "localhost:80", "localhost.example.org", "data", ".."])
def test_a_url_of_a_file_of_another_machine_is_refused_for_what_it_is(host: str, tmp_path: Path) -> None:
    url = f"file://{host}{tmp_path}/run.h5"
    for named in (volume_name, absolute_name, check_is_there, open_volume, identified_volume, names_store):
        with pytest.raises(BadInput) as refusal:
            named(f"{url}#/entry")
        assert str(refusal.value) == (
            f"{url}: names the machine {host}, and file:// reaches files of this one alone; "
            f"mount its folder here and give the path without file://"
        )


@pytest.mark.parametrize("name", ["head\0.nrrd", "run\0.h5#/entry", "file:///head%00.nrrd"])
def test_a_name_that_no_file_can_have_is_refused_for_what_it_is(name: str) -> None:
    for named in (volume_name, absolute_name, check_is_there, open_volume, identified_volume):
        with pytest.raises(BadInput, match="^[^\0]*: no file's name has a byte of 0; leave it out$"):
            named(name)


def test_a_missing_file_is_told_without_its_part(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match=r"no\.h5: no such file or folder$"):
        check_is_there(str(tmp_path / "no.h5#/data"))
    check_is_there("s3://bucket/brain.zarr")


def test_a_format_without_parts_says_so(tmp_path: Path) -> None:
    path = written(tmp_path / "head.nrrd", values_of("uint8"))
    with pytest.raises(BadInput, match="holds one volume, it has no part “second”; leave out #second"):
        open_volume(f"{path}#second")
