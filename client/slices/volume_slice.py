"""A slice of the volume as the servers hold it: what is missing is known as missing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from volsplat.client.caller.whole_torch import load_torch
from volsplat.protocol.description.volume import Index
from volsplat.protocol.messages.frame_messages import ProbedVoxel
from volsplat.protocol.rules.index_rules import Quantisation
from volsplat.protocol.rules.packet_layout import NO_DATA_BIT, VOXEL_PACKET_BYTES
from volsplat.protocol.rules.regions import Rectangle
from volsplat.protocol.rules.slice_plane import SAMPLE_BYTES, SlicePlane
from volsplat.protocol.text.errors import PeerLost, RemoteProtocolError

if TYPE_CHECKING:
    import numpy as np  # a session must not wait for it before it starts its servers
    from numpy.typing import NDArray
    from torch import Tensor


@dataclass(frozen=True)
class VolumeSlice:
    """Arrays are shaped (rows, columns): the earlier of the other two axes runs along a row, as in memory."""

    plane: SlicePlane  # of the grid of the level that is held
    factors: Index  # voxels of the volume for each of that grid
    quantisation: Quantisation
    packets: NDArray[np.uint32]
    colours: NDArray[np.uint8]  # (rows, columns, 4): as drawn in some light, and opacity
    held: NDArray[np.bool_]  # by a server that is there

    @classmethod
    def empty(cls, plane: SlicePlane, factors: Index, quantisation: Quantisation) -> VolumeSlice:
        """Nothing of it has come yet."""
        import numpy as np

        shape = (plane.height, plane.width)
        packets, colours = np.zeros(shape, np.uint32), np.zeros((*shape, 4), np.uint8)
        return cls(plane, factors, quantisation, packets, colours, np.zeros(shape, np.bool_))

    def take(self, parts: Sequence[Rectangle], payload: bytes | memoryview) -> None:
        """Put in what a server holds of it. Raises RemoteProtocolError for what is no part of the slice."""
        import numpy as np

        begin = 0
        for part in parts:
            if not self.plane.holds(part):
                raise RemoteProtocolError(f"it sent {part} of a slice of {self.plane.width} x {self.plane.height}")
            left, top, width, height = part
            here = np.s_[top : top + height, left : left + width]
            middle, end = begin + VOXEL_PACKET_BYTES * width * height, begin + SAMPLE_BYTES * width * height
            self.packets[here] = np.frombuffer(payload[begin:middle], "<u4").reshape(height, width)
            self.colours[here] = np.frombuffer(payload[middle:end], np.uint8).reshape(height, width, 4)
            self.held[here] = True
            begin = end

    @property
    def has_data(self) -> NDArray[np.bool_]:
        data: NDArray[np.bool_] = self.packets >> NO_DATA_BIT == 0
        return self.held & data

    @property
    def densities(self) -> NDArray[np.float32]:
        """In the data's units, as they are drawn; NaN where there are none."""
        import numpy as np

        values = np.array([self.quantisation.density_of_byte(byte) for byte in range(256)], np.float32)
        return np.where(self.has_data, values[self.packets & 255], np.float32(np.nan))

    @property
    def tensor(self) -> Tensor:
        """The densities. Raises PeerLost if a part is missing, BadInput without the extra [torch]."""
        load_torch("a slice as a tensor")
        import torch

        if not self.held.all():
            raise PeerLost("a map/shade server was lost, and with it a part of this slice")
        return torch.from_numpy(self.densities)

    def voxel(self, index: Index) -> ProbedVoxel | None:
        """What is shown of a voxel of the volume; None without data, or if the slice does not hold it."""
        plane = self.plane
        at = [n // factor for n, factor in zip(index, self.factors, strict=True)]
        column, row = (at[axis] // plane.every for axis in plane.sides)
        inside = 0 <= column < plane.width and 0 <= row < plane.height
        if at[plane.axis] != plane.index or not inside or not self.has_data[row, column]:
            return None
        packet, rules = int(self.packets[row, column]), self.quantisation
        return ProbedVoxel(index, rules.density_of_byte(packet & 255), rules.strength_of_byte(packet >> 8 & 255))
