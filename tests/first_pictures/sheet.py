"""Every first picture on one sheet, to be looked at, with the score of each.

cd tests && ../.venv/bin/python -m first_pictures.sheet SHEET.png
"""

import sys
import warnings
from collections.abc import Iterable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
from first_pictures.score import Score, score
from first_pictures.subjects import Subject, heads, phantoms, real_volumes
from numpy.typing import NDArray

from volsplat.client.image.image_file import over_background, write_pixels
from volsplat.client.image.picture_sheet import SheetPicture, picture_sheet
from volsplat.client.session.single import SingleProcess

SHEET_SIDE = 240  # pixels of a picture
COLUMNS = 9


class FirstPicture(NamedTuple):
    subject: Subject
    pixels: NDArray[np.float32]  # (H, W, 3), over the background
    score: Score

    @property
    def faults(self) -> list[str]:
        return self.score.faults(self.subject.block, self.subject.grain)


def first_picture(subject: Subject, folder: Path, side: int) -> FirstPicture:
    """In its default scene, as `volsplat render` draws it without an option."""
    with SingleProcess(subject.make(folder)) as single:
        scene = single.volume.default_scene().with_(size=side)
        pixels = over_background(single.finish(scene).published.pixels, scene.image.background)
        zoom = single.volume.settled(scene).view.zoom
        assert isinstance(zoom, float)
        return FirstPicture(subject, pixels, score(pixels, zoom, scene.image.background))


def first_pictures(drawn: Iterable[Subject], side: int) -> Iterator[FirstPicture]:
    for subject in drawn:
        with TemporaryDirectory() as folder:
            yield first_picture(subject, Path(folder), side)


def sheet(pictures: Iterable[FirstPicture]) -> NDArray[np.float32]:
    return picture_sheet(
        [SheetPicture(p.pixels, "", p.subject.name, note=", ".join(p.faults)) for p in pictures], COLUMNS
    )


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    drawn = []
    for one in first_pictures([*real_volumes(), *phantoms(), *heads()], SHEET_SIDE):
        drawn.append(one)
        measured = " ".join(f"{name} {share:.2f}" for name, share in one.score._asdict().items())
        print(f"{one.subject.name:48} {measured} {', '.join(one.faults)}", flush=True)
    print(f"median of the longer sides: {np.median([one.score.longer_side for one in drawn]):.2f}")
    write_pixels(Path(sys.argv[1]), sheet(drawn))
