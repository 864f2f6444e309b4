"""Where everything of a figure lies: the picture, what is over it, and what is above and below."""

from __future__ import annotations

import msgspec
import numpy as np
from numpy.typing import NDArray

from volsplat.client.figure.colour_bars import INSET, NONE, ColourBars, colour_bars
from volsplat.client.figure.drawing import Anchor, Drawing, Pen, Shape, Words
from volsplat.client.figure.figure import Figure
from volsplat.client.figure.pointing_labels import Ways, pointing_labels
from volsplat.client.figure.room import Room
from volsplat.client.figure.scale_bars import scale_bars
from volsplat.client.figure.side_marks import side_marks
from volsplat.client.figure.type_faces import size_within
from volsplat.client.scene.resized import sized as resized
from volsplat.client.volume.surveyed_volume import SurveyedVolume
from volsplat.protocol.description.scene import LARGEST_EXTENT, Image, Scene
from volsplat.protocol.text.errors import BadInput

TITLE_LINE = 1.9  # ems
TITLE_BASE = 1.35
TITLE_SIZE = 1.15  # of other words
LEAST_TITLE = 0.5  # of that, where a title is longer than the figure is wide
LEAST_PICTURE = 16  # pixels
LEAST_BAR = 0.5  # of a colour bar's length


def sized(figure: Figure, scene: Scene, volume: SurveyedVolume, of_several: bool = False) -> Scene:
    """The scene with as many pixels as give the figure its size in print. Raises BadInput if that cannot be.

    `of_several`: see `colour_bars`.
    """
    if figure.width == "auto":
        if figure.height != "auto":
            raise BadInput("a figure's height needs its width; give both, in cm")
        _check_room(figure, scene.image)
        return scene
    width = figure.pixels(figure.width)
    wide = msgspec.structs.replace(scene.image, width=min(width, LARGEST_EXTENT))
    _check_room(figure, wide)
    if figure.height == "auto":
        height = round(width * scene.image.height / scene.image.width)
    else:
        beside = _beside(figure, msgspec.structs.replace(scene, image=wide), volume, of_several)
        height = figure.pixels(figure.height) - beside
    if min(width, height) < LEAST_PICTURE:
        raise BadInput("a figure of this size has no room for its picture; give a larger size or dpi, or smaller text")
    if max(width, height) > LARGEST_EXTENT:
        raise BadInput(
            f"the figure's picture would have {width}x{height} pixels, more than {LARGEST_EXTENT} on a side; give a "
            "smaller size or dpi"
        )
    return resized(scene, width=width, height=height)


def figure_extent(figure: Figure, scene: Scene, volume: SurveyedVolume, of_several: bool = False) -> tuple[int, int]:
    """Width and height of the whole figure in pixels."""
    return scene.image.width, scene.image.height + _beside(figure, scene, volume, of_several)


def laid_out(
    picture: NDArray[np.float32],
    figure: Figure,
    scene: Scene,
    volume: SurveyedVolume,
    height: int | None = None,
    of_several: bool = False,
    ways: Ways | None = None,
) -> Drawing:
    """The drawing of a finished picture of the scene; of another height if there must be one.

    `of_several`: see `colour_bars`. `ways` are those of the labels in the image before, and then in this one.
    """
    scene, description = volume.settled(scene), volume.description
    pen = Pen(figure.em_on(scene.image), *figure.ink_on(scene.image.background))
    corner = (0, _above(figure, scene.image))
    room = Room(*corner, scene.image.width, scene.image.height)
    shapes: list[Shape] = []
    if figure.title:
        shapes.append(_title(figure, scene.image, pen.ink))
    if figure.scale_bar:
        shapes += scale_bars(scene, description, corner, pen)
        room.take(shapes)
    if figure.sides:
        shapes += side_marks(scene, description, room, corner, pen)
    if figure.labels:
        kept = {} if ways is None else ways
        shapes += pointing_labels(figure.labels, scene, description.geometry, room, corner, pen, kept)
    bars = _bars(figure, scene, volume, of_several)
    shapes += bars.shapes(corner[1] + scene.image.height, scene.image.width, pen.em, pen.ink)
    width, whole = figure_extent(figure, scene, volume, of_several)
    return Drawing(
        width=width,
        height=height or whole,
        dpi=figure.resolution,
        picture=picture,
        corner=corner,
        background=None if figure.transparent else scene.image.background,
        shapes=tuple(shapes),
    )


def _title(figure: Figure, image: Image, ink: tuple[float, float, float]) -> Words:
    size, base = _title_size(figure, image), TITLE_BASE * figure.em_on(image)
    return Words(image.width / 2, base, figure.title, size, ink, None, Anchor.MIDDLE, bold=True)


def _check_room(figure: Figure, image: Image) -> None:
    """Raises BadInput for a title or colour bars that have none."""
    if figure.title:
        _title_size(figure, image)
    if figure.colour_bar and image.width < (2 * INSET + LEAST_BAR) * figure.em_on(image):
        raise BadInput(
            f"a picture of {image.width} pixels is too narrow for colour bars in this text size; make it larger, lower "
            "the dpi or the text size, or leave the bars out"
        )


def _title_size(figure: Figure, image: Image) -> int:
    """Raises BadInput for a title that has no room."""
    em = figure.em_on(image)
    wanted = round(em * TITLE_SIZE)
    size = size_within(figure.title, wanted, image.width - em, bold=True)
    if size < LEAST_TITLE * wanted:
        raise BadInput("the figure's title has no room above its picture; shorten it, or give a smaller text size")
    return size


def _above(figure: Figure, image: Image) -> int:
    return round(TITLE_LINE * figure.em_on(image)) if figure.title else 0


def _beside(figure: Figure, scene: Scene, volume: SurveyedVolume, of_several: bool) -> int:
    """Rows of pixels above and below the picture."""
    bars = _bars(figure, scene, volume, of_several)
    return _above(figure, scene.image) + bars.height(scene.image.width, figure.em_on(scene.image))


def _bars(figure: Figure, scene: Scene, volume: SurveyedVolume, of_several: bool) -> ColourBars:
    return colour_bars(scene, volume, of_several) if figure.colour_bar else NONE
