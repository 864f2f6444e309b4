"""What a figure shows beside its picture, and how large it is printed; each option is declared once, here."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Annotated, Any, Literal

import msgspec

from volsplat.protocol.description.colours import Colour, colour_from_text
from volsplat.protocol.description.scene import Image
from volsplat.protocol.description.scene_key import (
    UNIT_INTERVAL,
    Declared,
    Key,
    Limits,
    Part,
    PartOf,
    Swatch,
    Switch,
    declarations,
)
from volsplat.protocol.description.scene_keys import SceneKey
from volsplat.protocol.geometry.matrices import Vector
from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.text.printable import printable

BLACK: Colour = (0.0, 0.0, 0.0)
WHITE: Colour = (1.0, 1.0, 1.0)
CM_PER_INCH = 2.54
CENTIMETRES = {"cm": 1.0, "mm": 0.1, "in": CM_PER_INCH}
POINTS_PER_INCH = 72
DPI = Limits(20.0, 2400.0)
PRINTED_DPI, PRINTED_TEXT = 300.0, 7.0  # what journals ask for
LINES = 36  # of words beside one another that a picture nobody prints is as wide and high as
LEAST_EM, MOST_EM = 10, 60  # pixels that words of such a picture have
PRINTED = ("width", "height")


class Figure(Part, frozen=True):
    """The options of a figure. `labels` are words and the grid point (i, j, k) that they point at."""

    scale_bar: Annotated[
        bool, Key("A bar of a round length, in the data's units; one for each kind of axis.", Switch("scale bar"))
    ] = True
    colour_bar: Annotated[
        bool,
        Key("The colours and opacities of the tables over the data's values; the names of classes.", Switch("colours")),
    ] = True
    sides: Annotated[
        bool,
        Key(
            "What lies to the right, left, top and bottom: R, L, A, P, S, I of a patient, else the ends of the"
            " file's axes.",
            Switch("sides"),
        ),
    ] = True
    title: Annotated[str, Key("A line above the picture.", PartOf("title"), allowed="a text")] = ""
    labels: Annotated[
        tuple[tuple[str, Vector], ...],
        Key("Words that point at voxels.", PartOf("labels"), allowed="[[text, [i, j, k]], ...]"),
    ] = ()
    width: Annotated[
        float | Literal["auto"],
        Key(
            "How wide the figure is printed; auto leaves the picture as many pixels as the scene says.",
            PartOf("width"),
            Limits(0.5, 200.0),
            "cm",
        ),
    ] = "auto"
    height: Annotated[
        float | Literal["auto"],
        Key(
            "How high it is printed, all in all; auto leaves the picture its shape.",
            PartOf("height"),
            Limits(0.5, 200.0),
            "cm",
        ),
    ] = "auto"
    dpi: Annotated[
        float | Literal["auto"],
        Key(
            f"Pixels of the picture per inch of print; auto is {PRINTED_DPI:g}.",
            PartOf("dpi"),
            DPI,
            "pixels per inch",
        ),
    ] = "auto"
    text_size: Annotated[
        float | Literal["auto"],
        Key(
            f"How large the words are; auto is {PRINTED_TEXT:g} points where width or dpi tell how large the figure is"
            " printed, else what suits the picture's pixels.",
            PartOf("words"),
            Limits(3.0, 72.0),
            "points",
        ),
    ] = "auto"
    ink: Annotated[
        Colour | Literal["auto"],
        Key(
            "The colour of words and lines; auto is black or white, whichever the background makes legible.",
            Swatch("ink"),
            UNIT_INTERVAL,
            allowed='"#rrggbb", a name of CSS or [r, g, b], each 0 to 1, or "auto"',
        ),
    ] = "auto"
    transparent: Annotated[
        bool, Key("Leave the background out: PNG, TIFF, SVG and PDF are clear there.", Switch("transparent"))
    ] = False

    def __post_init__(self) -> None:
        """Numbers may be numpy's, labels a mapping, the ink a name of CSS. Raises BadInput."""
        for declared in declarations(Figure):
            msgspec.structs.force_setattr(self, declared.name, _option(declared, getattr(self, declared.name)))
        try:
            super().__post_init__()
        except ValueError as error:
            raise BadInput(f"figure: {printable(str(error))}") from None
        msgspec.structs.force_setattr(self, "title", printable(self.title))
        msgspec.structs.force_setattr(self, "labels", tuple((printable(text), at) for text, at in self.labels))

    @property
    def resolution(self) -> float:
        """Pixels per inch."""
        return PRINTED_DPI if self.dpi == "auto" else self.dpi

    def em_on(self, image: Image) -> int:
        """The size of words about a picture, in pixels: as large in print as asked for, else in proportion to it."""
        if self.text_size == self.dpi == self.width == "auto":
            return min(max(round(min(image.width, image.height) / LINES), LEAST_EM), MOST_EM)
        points = PRINTED_TEXT if self.text_size == "auto" else self.text_size
        return max(round(points * self.resolution / POINTS_PER_INCH), 1)

    def pixels(self, centimetres: float) -> int:
        return max(math.floor(centimetres / CM_PER_INCH * self.resolution + 0.5), 1)

    def ink_on(self, background: Colour) -> tuple[Colour, Colour]:
        """The colour of words, and the one that sets them off where they lie over the picture."""
        ink = self.ink
        if ink == "auto":
            ink = BLACK if self.transparent or _bright(background) else WHITE
        if self.transparent:
            return ink, BLACK if _bright(ink) else WHITE
        return ink, background


def centimetres_from_text(text: str) -> float | str:
    """How many centimetres 8.5cm, 85mm or 3.3in are; the text itself if it is none of these."""
    lengths = lengths_from_text(text)
    return lengths[0] if len(lengths) == 1 else text


def lengths_from_text(text: str) -> tuple[float, ...]:
    """In centimetres the one length of 8.5cm, or both of 8.5x12cm; none if it is neither."""
    match = re.fullmatch(r"(\d*\.?\d+)(?:x(\d*\.?\d+))? ?(cm|mm|in)", text.strip())
    if match is None:
        return ()
    *numbers, unit = match.groups()
    return tuple(float(number) * CENTIMETRES[unit] for number in numbers if number is not None)


def label_from_text(text: str) -> tuple[str, Vector]:
    """Words and the voxel that they point at, from TEXT@I,J,K. Raises ValueError."""
    words, _, place = text.rpartition("@")
    numbers = [float(part) for part in place.split(",")]
    if not words.strip() or len(numbers) != 3:
        raise ValueError("no TEXT@I,J,K")
    return words.strip(), (numbers[0], numbers[1], numbers[2])


def _bright(colour: Colour) -> bool:
    return 0.2126 * colour[0] + 0.7152 * colour[1] + 0.0722 * colour[2] > 0.5


def figure_with(figure: Figure, options: Mapping[str, Any]) -> Figure:
    """The figure with other options. Raises BadInput."""
    names = [declared.name for declared in declarations(Figure)]
    for name in options:
        if name not in names:
            raise BadInput(f"a figure has no {name}; it has {', '.join(names)}")
    return msgspec.structs.replace(figure, **options)


def check_figure(figure: object) -> None:
    """Raises BadInput for what is no figure."""
    if not isinstance(figure, Figure):
        raise BadInput(f"figure must be a volsplat.Figure, as Figure(width=8.5), not {printable(repr(figure)[:60])}")


def _option(declared: Declared, given: Any) -> Any:
    """Of its type. Raises BadInput."""
    value = given.tolist() if hasattr(given, "tolist") else given
    try:
        if isinstance(value, Mapping):
            value = list(value.items())
        if declared.name in PRINTED and isinstance(value, str):
            value = centimetres_from_text(value)
        if declared.name == "ink" and isinstance(value, str) and value != "auto":
            value = colour_from_text(value)
        return msgspec.convert(value, declared.kind)
    except ValueError as error:
        assert isinstance(declared.key, Key)
        allowed = SceneKey(declared.name, declared, declared.key).allowed
        told = f"{declared.name}={given!r:.60}: {error}; allowed: {allowed}"
        raise BadInput(f"figure: {printable(told)}") from None


BARE = Figure(scale_bar=False, colour_bar=False, sides=False)
"""A picture alone."""
