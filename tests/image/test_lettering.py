"""Words on pictures: the fonts are found, or it is said that there are none."""

import os
import subprocess
import sys

import pytest

from volsplat.client.image.lettering import BOLD_FONT, FONT, extent
from volsplat.protocol.text.errors import VolsplatError


@pytest.mark.parametrize("font", [FONT, BOLD_FONT])
def test_fonts_are_found_though_the_environment_names_another_installation_of_the_library(font: str) -> None:
    script = f"from volsplat.client.image.lettering import extent; print(extent('10 cm', 16, {font!r}))"
    said = subprocess.run(
        [sys.executable, "-c", script],
        env=os.environ | {"OpenImageIO_ROOT": os.devnull},
        capture_output=True,
        text=True,
        check=True,
    )
    assert int(said.stdout) == extent("10 cm", 16, font)


def test_a_font_that_is_nowhere_is_told_in_one_line_with_the_cure() -> None:
    with pytest.raises(VolsplatError, match="no font Lost; install OpenImageIO again") as told:
        extent("10 cm", 16, "Lost")
    assert "\n" not in str(told.value)
