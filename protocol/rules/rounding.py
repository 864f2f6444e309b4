"""How positions become multiples of 1/64 pixel, and these offsets of the footprint table (ordered dithering).

Where sheets lie one behind the other, as in axis-aligned views, all samples on a ray have the same fraction of a pixel.
Rounded to the nearest they would all be off the same way, and a hundred sheets would add that up to levels that can be
seen. So in frames with footprints each sheet has a threshold of its own, from which on it rounds up: multiples of the
golden ratio, whose errors cancel over any few sheets that follow each other, whatever the view.

A threshold has 32 bits. The lower 26 are added to a position in 2^-32 pixel before it is rounded down to 1/64 pixel;
of the upper ones as many as a footprint table has fewer than 6 bits of offset, as a number, are added to that before it
is rounded down to the table's offset. So both roundings together are one, with one threshold.
"""

from typing import NamedTuple

THRESHOLD_OF_INDEX = 2654435769  # 2^32 divided by the golden ratio, for each further grid index
HALF_THRESHOLD = 2181038080  # 2^31 + 2^25: to the nearest, halves up


class Thresholds(NamedTuple):
    """Those of a frame's sheets; numbers wrap at 2^32."""

    first: int = HALF_THRESHOLD  # of the sheet at ordinal 0 of the traversal
    step: int = 0  # from one sheet to the next

    def of(self, sheet: int) -> int:
        """That of a sheet by its ordinal."""
        return (self.first + sheet * self.step) % (1 << 32)


TO_NEAREST = Thresholds()
DOWN = Thresholds(first=0)  # so that the nearest pixel of a packet is that of the position itself


def thresholds_of(first_index: int, index_step: int) -> Thresholds:
    """Those of sheets at these grid indices, so that neither order nor bounds change a sheet's.

    `first_index` is that of the first sheet in traversal order, `index_step` from one sheet to the next, either sign.
    """
    first = HALF_THRESHOLD + first_index * THRESHOLD_OF_INDEX
    return Thresholds(first % (1 << 32), index_step * THRESHOLD_OF_INDEX % (1 << 32))
