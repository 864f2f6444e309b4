"""A slice as a picture: grey by density, and over it the colours of what the tables show."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from volsplat.client.slices.volume_slice import VolumeSlice

OPAQUE = 255
MISSING = (178, 106, 0)  # stripes where no server holds anything
STRIPE = 8  # samples from one to the next


def slice_picture(part: VolumeSlice, coloured: bool) -> NDArray[np.uint8]:
    """(rows, columns, 4), red, green, blue and whether there are data, 0 or 255; missing parts are striped."""
    grey = (part.packets & 255).astype(np.uint8)[..., None]
    picture = np.empty((*grey.shape[:2], 4), np.uint8)
    picture[..., :3] = _over(part.colours, grey) if coloured else grey
    picture[..., 3] = np.where(part.has_data, OPAQUE, 0)
    if not part.held.all():
        rows, columns = np.indices(part.held.shape)
        striped = ~part.held & ((rows + columns) % STRIPE < STRIPE // 2)
        picture[striped] = (*MISSING, OPAQUE)
    return picture


def _over(colours: NDArray[np.uint8], grey: NDArray[np.uint8]) -> NDArray[np.uint8]:
    opacity = colours[..., 3:].astype(np.uint16)
    mixed = colours[..., :3] * opacity + grey * (OPAQUE - opacity) + OPAQUE // 2
    levels: NDArray[np.uint8] = (mixed // OPAQUE).astype(np.uint8)
    return levels
