"""There is never an empty picture without a word."""

from pathlib import Path

import msgspec
import numpy as np
import pytest

from support.programs.programs import Person
from support.scenes.arbitrary import plain_scene
from volsplat.client.image.empty_image import why_empty
from volsplat.protocol.description.shading_tables import ScalarTable

NOTHING = np.zeros((4, 4, 4), np.float32)


def test_an_image_with_anything_on_it_needs_no_words() -> None:
    something = NOTHING.copy()
    something[2, 1, 3] = 1e-3
    assert why_empty(something, plain_scene()) == ""


def test_an_empty_image_is_explained_by_what_makes_it_empty() -> None:
    scene = plain_scene()
    transparent = msgspec.structs.replace(scene.tables, opac=ScalarTable(points=((0.0, 0.0),)))
    assert "reset the view" in why_empty(NOTHING, scene)
    assert "the opacity table is 0" in why_empty(NOTHING, msgspec.structs.replace(scene, tables=transparent))


@pytest.mark.parametrize(
    ("value", "status", "words"),
    [
        (np.nan, 2, "no voxel has a value"),
        (np.inf, 2, "no voxel has a value"),
        (7.0, 0, "note: every voxel has the value 7"),
    ],
)
def test_volumes_without_structure_are_told_of(value: float, status: int, words: str, tmp_path: Path) -> None:
    np.save(tmp_path / "flat.npy", np.full((12, 10, 8), value, np.float32))
    done = Person(tmp_path).runs("render", "flat.npy", "-o", "flat.png", "--workers", "1")
    assert done.returncode == status
    assert words in done.stderr
    assert (tmp_path / "flat.png").exists() == (status == 0)


def test_a_view_past_the_volume_is_told_of(tmp_path: Path) -> None:
    np.save(tmp_path / "ramp.npy", np.arange(8 * 8 * 8, dtype=np.uint16).reshape(8, 8, 8))
    done = Person(tmp_path).runs(
        "render", "ramp.npy", "-o", "past.png", "--single", "--zoom", "9", "--center", "900,4,4"
    )
    assert done.returncode == 0
    assert "note: nothing is visible" in done.stderr and "reset the view" in done.stderr


def test_a_mask_that_a_preset_leaves_transparent_is_told_a_window_that_shows_it(tmp_path: Path) -> None:
    mask = np.zeros((12, 12, 12), np.uint8)
    mask[3:9, 3:9, 3:9] = 1
    np.save(tmp_path / "mask.npy", mask)
    asked = ("render", "mask.npy", "-o", "mask.png", "--single", "--size", "32x32", "--preset", "depth-cue")
    told = Person(tmp_path).runs(*asked)
    assert "nothing is visible" in told.stderr and "of a mask 0 to 1" in told.stderr
    assert "nothing is visible" not in Person(tmp_path).runs(*asked, "--window", "0,1").stderr
