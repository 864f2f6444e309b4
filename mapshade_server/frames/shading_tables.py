"""The tables that a scene is shaded through, kept from frame to frame while what they are made of stays the same."""

import math
from functools import lru_cache
from typing import NamedTuple

from volsplat.mapshade_server import _kernels
from volsplat.protocol.description.patches import Patches, colourless
from volsplat.protocol.description.scene import TABLE_ENTRIES, ColourTable, Field, ScalarTable
from volsplat.protocol.geometry import matrices
from volsplat.protocol.geometry.matrices import Matrix
from volsplat.protocol.rules.index_rules import ROUGHNESS_COSINES, DirectionCode, grid_index_bytes
from volsplat.protocol.rules.shading_rule import ONE, Lighting, ShadingRule

# The blocks of A and B come in up to 27 sizes, and a scene is turned through A to F again and again.
KEPT_OPACITY_TABLES = 96  # of 128 KiB
KEPT_LIGHT_TABLES = 8
KEPT_TABLES = 16
KEPT_PLANES = 4  # of 2.5 MiB

PACKET_SCALARS = (Field.DENSITY, Field.STRENGTH)


@lru_cache(KEPT_TABLES)
def scalar_entries(table: ScalarTable) -> tuple[float, ...]:
    return tuple(table.entries())


@lru_cache(KEPT_TABLES)
def colours(table: ColourTable) -> "_kernels.Array":
    """Red, green, blue and 0 of each entry: float32 (256, 4)."""
    return _kernels.colour_table(table.entries())


class OpacityRule(NamedTuple):
    """What makes a voxel's opacity: opac and modu, and the fields that index them."""

    opac: ScalarTable
    modu: ScalarTable
    opac_field: Field
    modu_field: Field
    density_spread: float  # see ShadingRule
    patches: Patches = ()  # without colours: they take the place of the two tables

    @property
    def by_packet(self) -> bool:
        """Whether density and strength alone decide; by patches they do."""
        return self.opac_field in PACKET_SCALARS and self.modu_field in PACKET_SCALARS


def opacity_rule(shading: ShadingRule) -> OpacityRule:
    cross_bar = shading.cross_bar
    return OpacityRule(
        shading.opac, shading.modu, cross_bar.opac, cross_bar.modu, shading.density_spread, colourless(shading.patches)
    )


@lru_cache(KEPT_PLANES)
def plane(patches: Patches, density_spread: float) -> "_kernels.PatchTable":
    """What patches give at each density and strength."""
    return _kernels.PatchTable([patch.numbers for patch in patches], density_spread)


class FrameColours(NamedTuple):
    """Emitted and reflected, with red, green, blue and 0 of each entry in float32.

    Of a plane the entries are at density | strength << 8, else at the byte of the field that the cross-bar names.
    """

    emit: "_kernels.Array"
    refl: "_kernels.Array"
    of_plane: bool


def frame_colours(shading: ShadingRule) -> FrameColours:
    if shading.patches:
        table = plane(shading.patches, shading.density_spread)
        return FrameColours(table.emit, table.refl, True)
    return FrameColours(colours(shading.emit), colours(shading.refl), False)


def opacity_fields(rule: OpacityRule) -> tuple[Field, Field]:
    """What indexes the two axes of `opacity_codes`: density and strength if they alone decide."""
    return PACKET_SCALARS if rule.by_packet else (rule.opac_field, rule.modu_field)


@lru_cache(KEPT_OPACITY_TABLES)
def opacity_codes(rule: OpacityRule, exponent: float) -> "_kernels.Array":
    """12-bit codes of samples of this opacity exponent, uint16 (65536,).

    The place in the table is the byte of the first of `opacity_fields` plus 256 times that of the second.
    """
    if rule.patches:
        return _kernels.plane_opacity_codes(plane(rule.patches, rule.density_spread).opacity, exponent)
    if rule.by_packet:
        by_density, by_strength = (_factors(rule, field) for field in PACKET_SCALARS)
        return _kernels.opacity_table(by_density, by_strength, exponent, rule.density_spread)
    return _kernels.opacity_table(scalar_entries(rule.opac), scalar_entries(rule.modu), exponent, 0.0)


@lru_cache(KEPT_TABLES)
def visibility(rule: OpacityRule) -> bytes:
    """A bit for each density, then one for each strength, lowest first: 64 bytes.

    A voxel whose two bits are not both set is transparent whatever its other fields and its opacity exponent are.
    """
    seen = _seen_of_plane(rule) if rule.patches else _seen_of_tables(rule)
    bits = [sum(1 << n for n in numbers) for numbers in seen]
    return b"".join(number.to_bytes(TABLE_ENTRIES // 8, "little") for number in bits)


def _seen_of_plane(rule: OpacityRule) -> tuple[list[int], list[int]]:
    return plane(rule.patches, rule.density_spread).seen()


def _seen_of_tables(rule: OpacityRule) -> list[list[int]]:
    others = [table for table, field in _tables_of(rule) if field not in PACKET_SCALARS]
    visible = all(max(scalar_entries(table)) > 0.0 for table in others)
    seen = [[n for n, a in enumerate(_factors(rule, field)) if visible and a > 0.0] for field in PACKET_SCALARS]
    if rule.by_packet and all(seen):
        seen[0] = _within(seen[0], math.ceil(rule.density_spread * max(seen[1])))
    return seen


def _within(bytes_seen: list[int], distance: int) -> list[int]:
    """The bytes that are no further than this from one of these; less than a byte away is a byte."""
    if distance == 0:
        return bytes_seen
    return [n for n in range(TABLE_ENTRIES) if any(abs(n - seen) <= distance for seen in bytes_seen)]


def _tables_of(rule: OpacityRule) -> tuple[tuple[ScalarTable, Field], ...]:
    return (rule.opac, rule.opac_field), (rule.modu, rule.modu_field)


@lru_cache(KEPT_TABLES)
def _factors(rule: OpacityRule, field: Field) -> tuple[float, ...]:
    """What each byte of a field contributes to the opacity."""
    entries = [scalar_entries(table) for table, indexed_by in _tables_of(rule) if indexed_by == field]
    return tuple(map(math.prod, zip(*entries, strict=True))) if entries else scalar_entries(ONE)


@lru_cache(KEPT_TABLES)
def grid_bytes(size: int, factor: int) -> bytes:
    """The byte of each grid index of an axis of `size` voxels, at a level where `factor` of them are one."""
    return bytes(grid_index_bytes(size, factor))


@lru_cache(KEPT_LIGHT_TABLES)
def light_of_directions(lighting: Lighting, directions: DirectionCode) -> "_kernels.Array":
    """What multiplies the reflected colour, by direction code: float32 (32768,)."""
    return _kernels.light_table(
        directions,
        ROUGHNESS_COSINES,
        lighting.light,
        lighting.half_way,
        lighting.diffuse,
        lighting.specular,
        lighting.two_sided,
        lighting.specular_power,
    )


@lru_cache(KEPT_TABLES)
def gradient_bytes(directions: DirectionCode, index_to_physical: Matrix) -> "_kernels.Array":
    """The bytes of the fields gradient i, j, k by direction code: uint8 (3, 32768)."""
    axes = [matrices.normalised(matrices.column(index_to_physical, axis)) for axis in range(3)]
    return _kernels.gradient_bytes(directions, axes)
