"""How many voxels have each density together with each strength: the 2-D histogram of a volume."""

from __future__ import annotations

import operator
from array import array
from dataclasses import dataclass, field

from volsplat.protocol.description.patches import PLANE_ENTRIES
from volsplat.protocol.text.errors import RemoteProtocolError


@dataclass(frozen=True)
class PlaneCounts:
    """Of the voxels that servers hold, which of a prepared volume are those of a level."""

    counts: array[int] = field(default_factory=lambda: array("Q", bytes(8 * PLANE_ENTRIES)))
    """At density | strength << 8."""

    def plus(self, payload: memoryview) -> PlaneCounts:
        """With those of another server, uint64 each. Raises RemoteProtocolError for more than any volume has."""
        try:
            return PlaneCounts(array("Q", map(operator.add, self.counts, payload.cast("B").cast("Q"))))
        except OverflowError:
            raise RemoteProtocolError("it counted more voxels than there can be") from None

    @property
    def voxels(self) -> int:
        return sum(self.counts)
