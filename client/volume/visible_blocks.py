"""How much of each block of a volume can be seen under a scene's tables and bounds.

Of a block the least and the greatest value are known (protocol/description/block_extremes.py): the share of the
densities between them that are seen is what it shows.
"""

from collections.abc import Iterator, Sequence
from itertools import accumulate, product
from typing import NamedTuple

from volsplat.client.volume.clearest_entries import clearest_entries
from volsplat.protocol.description.block_extremes import BlockExtremes, block_dims, block_size
from volsplat.protocol.description.scene import TABLE_ENTRIES, Field, Scene
from volsplat.protocol.description.volume import Box, Index
from volsplat.protocol.rules.index_rules import Quantisation


class BlockRow(NamedTuple):
    """Blocks along i."""

    j: int
    k: int
    first: int  # block
    shares: list[float]  # of what each may show, 0 to 1


def opacities(scene: Scene) -> list[float] | None:
    """By density, of a 2-D table the greatest; None if another field indexes them, so that they may be anything."""
    if scene.plane.patches:
        return [entry.opacity for entry in clearest_entries(scene.plane.patches)]
    if scene.cross_bar.opac != Field.DENSITY:
        return None
    entries = scene.tables.opac.entries()
    if scene.shading.modulation and scene.cross_bar.modu == Field.DENSITY:
        entries = [a * b for a, b in zip(entries, scene.tables.modu.entries(), strict=True)]
    return list(entries)


def block_rows(
    seen: Sequence[bool], dims: Index, bounds: Box, quantisation: Quantisation, extremes: BlockExtremes
) -> Iterator[BlockRow]:
    """The blocks that the bounds reach. `seen` tells of each density byte whether it is."""
    ni, nj, _ = block_dims(dims)
    ranges = [range(low // step, -(-high // step)) for low, high, step in zip(*bounds, block_size(dims), strict=True)]
    up_to = list(accumulate(map(int, seen), initial=0))
    low, scale = quantisation.window[0], quantisation.density_scale

    def entry(value: float) -> int:
        return int(min(max((value - low) * scale, 0.0), TABLE_ENTRIES - 1) + 0.5)

    def share(least: float, greatest: float) -> float:
        if least > greatest:
            return 0.0
        first, last = entry(least), entry(greatest)
        return (up_to[last + 1] - up_to[first]) / (last + 1 - first)

    for k, j in product(ranges[2], ranges[1]):
        row = slice(ranges[0].start + ni * (j + nj * k), ranges[0].stop + ni * (j + nj * k))
        yield BlockRow(j, k, ranges[0].start, list(map(share, extremes.least[row], extremes.greatest[row])))
