"""How much of each block of a volume can be seen under a scene's tables and bounds.

Of a block the least and the greatest value are known (protocol/description/block_extremes.py): what the densities
between them show in the mean is what it shows.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from volsplat.client.volume.clearest_entries import clearest_entries
from volsplat.protocol.description.block_extremes import BlockExtremes, block_dims, block_size
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.shading_tables import TABLE_ENTRIES, Field
from volsplat.protocol.description.volume import Box, Index
from volsplat.protocol.rules.index_rules import Quantisation


class BlockShares(NamedTuple):
    """Of the blocks that some bounds reach."""

    first: Index  # block along i, j, k
    shares: NDArray[np.float64]  # of what each may show, as `seen` counts it, shaped (k, j, i)


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


def block_shares(
    seen: Sequence[float], dims: Index, bounds: Box, quantisation: Quantisation, extremes: BlockExtremes
) -> BlockShares:
    """Of the blocks that the bounds reach. `seen` tells of each density byte how much it is, or whether."""
    low, scale = quantisation.window[0], quantisation.density_scale
    size = block_size(dims)
    reached = tuple(slice(a // step, -(-b // step)) for a, b, step in zip(*bounds, size, strict=True))
    least, greatest = (np.array(values).reshape(block_dims(dims)[::-1])[reached[::-1]] for values in extremes)
    empty = least > greatest

    @np.errstate(over="ignore")  # some files fill with the greatest numbers that there are
    def entries(values: NDArray[np.float64]) -> NDArray[np.intp]:
        bytes_ = np.clip((np.where(empty, low, values) - low) * scale, 0.0, TABLE_ENTRIES - 1)
        return (bytes_ + 0.5).astype(np.intp)

    first, last = entries(least), entries(greatest)
    up_to = np.concatenate(([0.0], np.cumsum(seen, dtype=np.float64)))
    shares = (up_to[last + 1] - up_to[first]) / (last + 1 - first)
    return BlockShares((reached[0].start, reached[1].start, reached[2].start), np.where(empty, 0.0, shares))
