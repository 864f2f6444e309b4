"""Colours as people write them: "#rrggbb" or a name of CSS beside three numbers 0..1, display-referred sRGB."""

import re

from volsplat.protocol.description.css_colours import CSS_COLOURS

Colour = tuple[float, float, float]

COLOUR_ALLOWED = '"#rrggbb", a name of CSS or [r, g, b], each 0 to 1'  # where a person gives one
_HEX = re.compile(r"#[0-9a-fA-F]{6}")


def colour_from_text(text: str) -> Colour:
    """The colour of "#rrggbb", each channel a multiple of 1/255, or of CSS's name. Raises ValueError for others."""
    return colour_from_hex(CSS_COLOURS.get(text.strip().lower(), text))


def colour_from_hex(text: str) -> Colour:
    """The colour of "#rrggbb", each channel a multiple of 1/255. Raises ValueError for anything else."""
    if not _HEX.fullmatch(text):
        raise ValueError(f'{text!r} is not a colour; write "#rrggbb", a name of CSS or [r, g, b] with numbers 0 to 1')
    return (int(text[1:3], 16) / 255, int(text[3:5], 16) / 255, int(text[5:7], 16) / 255)


def nearest_hex(colour: Colour) -> str:
    """ "#rrggbb" of the nearest such colour."""
    return "#" + "".join(f"{round(255 * channel):02x}" for channel in colour)


def hex_of_colour(colour: Colour) -> str | None:
    """ "#rrggbb" if that is exactly this colour, otherwise None."""
    text = nearest_hex(colour)
    return text if colour_from_hex(text) == colour else None
