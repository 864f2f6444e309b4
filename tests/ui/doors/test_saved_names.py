"""Names of the files that a browser saves: typed by a person, or made of the volume's."""

import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from volsplat.client.ui.doors.saved_names import LONGEST_ENDING, LONGEST_NAME, saved_name, stem_of
from volsplat.client.ui.panels import movie_dialog
from volsplat.client.ui.viewing import saving
from volsplat.protocol.text.errors import BadInput

ENDINGS = (*movie_dialog.KINDS, *saving.FIGURE_KINDS, saving.SCENE_FILE, ".exr")


def test_a_file_can_have_any_name_that_is_taken(tmp_path: Path) -> None:
    for stem in ("head", "my head", " head", "頭" * 83 + "ab", "😀" * 62):
        (tmp_path / saved_name(stem, ".mp4")).touch()
    with pytest.raises(OSError, match="too long"):
        (tmp_path / ("😀" * 63 + ".mp4")).touch()


@pytest.mark.parametrize(
    "stem",
    ["", " ", "\u3000\xa0\t", ".head", "..", "a/b", "a\\b", "a\0", "a\n", "a\ud83d", "\udc00", "😀" * 63, "a" * 252],
)
def test_what_names_no_file_is_refused_in_one_line(stem: str) -> None:
    with pytest.raises(BadInput, match="^name: ") as raised:
        saved_name(stem, ".mp4")
    assert str(raised.value).isprintable()


@given(st.text() | st.text("aß頭😀.-").map(lambda text: 100 * text))
def test_every_kind_of_file_can_be_named_by_any_volume(volume: str) -> None:
    stem = stem_of(volume)
    assert stem and len(saved_name(stem, max(ENDINGS, key=len)).encode()) <= LONGEST_NAME
    whole = re.sub(r"\W+", "-", volume.split(".")[0]).strip("-") or "volume"
    assert whole.startswith(stem) and (whole == stem or len(whole.encode()) > LONGEST_NAME - LONGEST_ENDING)


def test_there_is_room_for_every_ending() -> None:
    assert max(map(len, ENDINGS)) == LONGEST_ENDING
