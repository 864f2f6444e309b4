"""The contact sheet: the six pictures unchanged in their places, each with a caption."""

from pathlib import Path

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from support.files.images import read_image
from volsplat.client.image.contact_sheet import CAPTIONS, StepPicture, contact_sheet, write_contact_sheet
from volsplat.client.image.picture_sheet import LARGEST_SIDE, LEAST_WIDTH, PAPER, SheetPicture, picture_sheet
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.text.errors import BadInput


def flat(height: int, width: int, grey: float) -> NDArray[np.float32]:
    return np.full((height, width, 4), (grey, grey, grey, 1.0), np.float32)


def pictures(height: int, width: int) -> list[StepPicture]:
    return [StepPicture(step, flat(height, width, 0.2 + n / 8), 0.01 * 4**n) for n, step in enumerate(Step)]


def place_of(sheet: NDArray[np.float32], grey: float) -> tuple[int, int, int, int]:
    """Top, left, height and width of the largest area of exactly this grey; captions have no area."""
    same = (sheet == np.float32(grey)).all(axis=2)
    rows, columns = same.sum(axis=1), same.sum(axis=0)
    across, down = np.flatnonzero(rows > rows.max() // 2), np.flatnonzero(columns > columns.max() // 2)
    return int(across[0]), int(down[0]), len(across), len(down)


def test_every_step_has_a_caption() -> None:
    assert list(CAPTIONS) == list(Step)


@pytest.mark.parametrize("size", [(300, 400), (96, 64), (LARGEST_SIDE, LARGEST_SIDE)])
@pytest.mark.parametrize("title", ["", "a head", "a title so long that it has to shrink " * 5])
def test_the_pictures_stand_whole_in_two_rows_of_three(size: tuple[int, int], title: str) -> None:
    sheet = contact_sheet(pictures(*size), title=title)
    places = [place_of(sheet, 0.2 + n / 8) for n in range(6)]
    assert [place[2:] for place in places] == [size] * 6
    tops, lefts = [place[0] for place in places], [place[1] for place in places]
    assert tops[0] == tops[1] == tops[2] < tops[3] == tops[4] == tops[5]
    assert lefts[:3] == lefts[3:] == sorted(set(lefts))


def test_each_picture_has_ink_below_it() -> None:
    sheet = contact_sheet(pictures(300, 400), title="")
    for n in range(6):
        top, left, height, width = place_of(sheet, 0.2 + n / 8)
        strip = sheet[top + height : top + height + 40, left : left + width]
        assert strip.max() > 2 * PAPER


def test_large_pictures_are_reduced_and_keep_their_shape() -> None:
    _, _, height, width = place_of(contact_sheet(pictures(2 * LARGEST_SIDE, LARGEST_SIDE), title=""), 0.2)
    assert (height, width) == (LARGEST_SIDE, LARGEST_SIDE // 2)


@pytest.mark.parametrize("size", [(1000, 1000), (1280, 700), (641, 100), (4 * LARGEST_SIDE, 3)])
def test_a_reduced_picture_has_the_means_of_what_each_pixel_covers(size: tuple[int, int]) -> None:
    picture = torch.rand((*size, 3), generator=torch.Generator().manual_seed(1))
    reduced = picture_sheet([SheetPicture(picture.numpy(), "", "")], columns=1)
    planes = picture.permute(2, 0, 1)
    rows, columns = (max(round(side * (LARGEST_SIDE / max(size))), 1) for side in size)
    expected = torch.nn.functional.adaptive_avg_pool2d(planes, (rows, columns)).permute(1, 2, 0)
    left = (reduced.shape[1] - columns) // 2
    gap = (reduced.shape[1] - max(columns, LEAST_WIDTH)) // 2
    assert torch.equal(torch.from_numpy(reduced[gap:][:rows, left : left + columns]), expected)


def test_a_sheet_is_written_and_a_bad_place_refused(tmp_path: Path) -> None:
    write_contact_sheet(tmp_path / "sheet.png", pictures(96, 96), title="a head")
    assert read_image(tmp_path / "sheet.png").shape == contact_sheet(pictures(96, 96), title="a head").shape
    with pytest.raises(BadInput, match="there is no folder"):
        write_contact_sheet(tmp_path / "absent" / "sheet.png", pictures(96, 96), title="")
