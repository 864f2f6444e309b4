"""What a frame makes of voxels, in numbers: the bytes that index tables, opacity and colour."""

from dataclasses import dataclass

import msgspec
import numpy as np
from numpy.typing import NDArray

from volsplat.mapshade_server.frames import shading_tables
from volsplat.mapshade_server.held.level_mixture import LevelMixture
from volsplat.protocol.description.shading_tables import GRADIENT_FIELDS, GRID_FIELDS, SCREEN_FIELDS, Field
from volsplat.protocol.messages.drawing import Drawing
from volsplat.protocol.rules.grid_on_screen import FRACTION_BITS
from volsplat.protocol.rules.packet_layout import DIRECTION_SHIFT, OPACITY_CODES, opacity_of_code
from volsplat.protocol.rules.shading_rule import Lighting

OPACITIES = np.array([opacity_of_code(code) for code in range(OPACITY_CODES)], dtype=np.float32)
PLANE_BITS = np.uint32(0xFFFF)  # of a packet: density and strength, by which 2-D tables are indexed

Bytes = NDArray[np.uint8]
Indices = NDArray[np.int64]  # (n, 3) i, j, k, of the level that the plan draws
Packets = NDArray[np.uint32]  # (n,)
Colours = NDArray[np.float32]  # (n, 3), 0 to 1, before light


@dataclass(frozen=True)
class VoxelFields:
    """What a frame makes of many voxels at once."""

    drawing: Drawing
    mixture: LevelMixture | None = None  # of the level that is drawn

    @property
    def uses_index(self) -> bool:
        """Whether opacity depends on where a voxel lies."""
        return not self._opacity_rule.by_packet

    @property
    def _opacity_rule(self) -> shading_tables.OpacityRule:
        return shading_tables.opacity_rule(self.drawing.shading, self.mixture)

    def opacity(self, index: Indices, packets: Packets, thickness: float) -> NDArray[np.float32]:
        """Of cells so thick, in reference spacings of the volume."""
        opacities: NDArray[np.float32] = OPACITIES[self.opacity_codes(index, packets, thickness)]
        return opacities

    def opacity_codes(self, index: Indices, packets: Packets, thickness: float) -> NDArray[np.uint16]:
        """Likewise. Where the index is not used it may be left empty."""
        rule = self._opacity_rule
        codes = np.asarray(memoryview(shading_tables.opacity_codes(rule, thickness)))
        if rule.by_packet:
            by_packet: NDArray[np.uint16] = codes[packets & PLANE_BITS]
            return by_packet
        low, high = (
            self.bytes_of(field, index, packets).astype(np.int64) for field in shading_tables.opacity_fields(rule)
        )
        by_fields: NDArray[np.uint16] = codes[low | high << 8]
        return by_fields

    def colours(self, index: Indices, packets: Packets) -> tuple[Colours, Colours]:
        """Emitted and reflected."""
        shading = self.drawing.shading
        tables, cross_bar = shading_tables.frame_colours(shading, self.mixture), shading.cross_bar
        emitted, reflected = (
            np.asarray(table, dtype=np.float32)[self._entries(field, index, packets, tables.of_plane), :3]
            for table, field in ((tables.emit, cross_bar.emit), (tables.refl, cross_bar.refl))
        )
        return emitted, reflected

    def light(self, lighting: Lighting) -> NDArray[np.float32]:
        """What multiplies the reflected colour, by the direction's code."""
        shading = msgspec.structs.replace(self.drawing.shading, lighting=lighting)
        drawing = msgspec.structs.replace(self.drawing, shading=shading)
        light = shading_tables.frame_light(drawing, self.mixture)
        return np.asarray(light, dtype=np.float32)

    def _entries(self, field: Field, index: Indices, packets: Packets, of_plane: bool) -> Packets | Bytes:
        return packets & PLANE_BITS if of_plane else self.bytes_of(field, index, packets)

    def bytes_of(self, field: Field, index: Indices, packets: Packets) -> Bytes:
        geometry, plan = self.drawing.geometry, self.drawing.plan
        if field == Field.DENSITY:
            return (packets & 255).astype(np.uint8)
        if field == Field.STRENGTH:
            return (packets >> 8 & 255).astype(np.uint8)
        if field in GRADIENT_FIELDS:
            directions = np.asarray(shading_tables.gradient_bytes(self.drawing.directions, geometry.index_to_physical))
            of_codes: Bytes = directions[GRADIENT_FIELDS.index(field), packets >> DIRECTION_SHIFT & 0x7FFF]
            return of_codes
        if field in SCREEN_FIELDS:
            dda = plan.screen_index[SCREEN_FIELDS.index(field)]
            place = dda.origin + 2 * index @ np.array(dda.half_steps, dtype=np.int64)
            of_screen: Bytes = np.clip(place >> FRACTION_BITS, 0, 255).astype(np.uint8)
            return of_screen
        axis = GRID_FIELDS.index(field)
        grid = np.frombuffer(shading_tables.grid_bytes(geometry.dims[axis], plan.factors[axis]), np.uint8)
        of_axis: Bytes = grid[index[:, axis]]
        return of_axis
