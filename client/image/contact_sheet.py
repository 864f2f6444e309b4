"""The six images of successive refinement in one sheet, each with what it shows and how long it took."""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from volsplat.client.image.image_file import write_pixels
from volsplat.client.image.picture_sheet import SheetPicture, picture_sheet
from volsplat.protocol.description.refinement_steps import Step

COLUMNS = 3

CAPTIONS = {
    Step.A: "every 4th sample",
    Step.B: "every 2nd sample",
    Step.C: "all samples",
    Step.D: "footprints",
    Step.E: "diffuse light",
    Step.F: "specular light",
    Step.G: "lit after reconstruction",
}


class StepPicture(NamedTuple):
    step: Step
    image: NDArray[np.float32]  # (H, W, 4) float32, associated alpha; all of one size
    seconds: float


def write_contact_sheet(path: Path, pictures: Sequence[StepPicture], title: str) -> None:
    """Write the pictures, three to a row, with captions. Raises BadInput if the file cannot be written."""
    write_pixels(path, contact_sheet(pictures, title))


def contact_sheet(pictures: Sequence[StepPicture], title: str) -> NDArray[np.float32]:
    """The sheet as (H, W, 3) float32, 0..1, with the pictures over black."""
    shown = [
        SheetPicture(
            picture.image[..., :3],  # over black
            mark=picture.step.value,
            caption=CAPTIONS[picture.step],
            aside=_seconds(picture.seconds),
        )
        for picture in pictures
    ]
    return picture_sheet(shown, COLUMNS, title)


def _seconds(seconds: float) -> str:
    return f"{seconds * 1000:.0f} ms" if seconds < 1 else f"{seconds:.1f} s"
