"""The tables that a scene is shaded through, kept from frame to frame while what they are made of stays the same."""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from volsplat.mapshade_server import _kernels
from volsplat.mapshade_server.frames.level_light import Look, SeenLevel, eye_along_axes, reflected_in_steps
from volsplat.mapshade_server.held.level_mixture import LevelMixture
from volsplat.protocol.description.patches import PLANE_ENTRIES, Patches, colourless
from volsplat.protocol.description.shading_tables import TABLE_ENTRIES, ColourTable, Field, ScalarTable
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.geometry import matrices
from volsplat.protocol.geometry.matrices import Matrix, Vector
from volsplat.protocol.messages.drawing import Drawing
from volsplat.protocol.rules.index_rules import ROUGHNESS_COSINES, DirectionCode, grid_index_bytes
from volsplat.protocol.rules.shading_rule import ONE, Lighting, ShadingRule

# The blocks of A and B come in up to 27 sizes, and a scene is turned through A to F again and again.
KEPT_OPACITY_TABLES = 96  # of 128 KiB
KEPT_LIGHT_TABLES = 8
KEPT_TABLES = 16
KEPT_PLANES = 8  # of 2.5 MiB, for the levels that the steps of a frame take

PACKET_SCALARS = (Field.DENSITY, Field.STRENGTH)

Numbers = NDArray[np.float64]


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
    patches: Patches = ()  # without colours: they take the place of the two tables
    mixture: LevelMixture | None = None  # of voxels that are not the volume's own

    @property
    def by_packet(self) -> bool:
        """Whether density and strength alone decide; by patches they do."""
        return self.opac_field in PACKET_SCALARS and self.modu_field in PACKET_SCALARS

    @property
    def is_mixed(self) -> bool:
        """Whether a voxel is as opaque as those that it stands for are on the mean. What else indexes tables, as a
        place, is the voxel's own."""
        return self.mixture is not None and self.by_packet


def opacity_rule(shading: ShadingRule, mixture: LevelMixture | None = None) -> OpacityRule:
    cross_bar = shading.cross_bar
    return OpacityRule(shading.opac, shading.modu, cross_bar.opac, cross_bar.modu, colourless(shading.patches), mixture)


@lru_cache(KEPT_PLANES)
def plane(patches: Patches) -> "_kernels.PatchTable":
    """What patches give at each density and strength."""
    return _kernels.PatchTable([patch.numbers for patch in patches])


@lru_cache(KEPT_PLANES)
def mixed_opacity(rule: OpacityRule) -> Numbers:
    """Of a level's voxels, at density | strength << 8: (65536,)."""
    assert rule.mixture is not None
    means = rule.mixture.means(_own_opacity(rule)[:, None])
    return np.ascontiguousarray(np.minimum(means[:, 0], 1.0))


def _own_opacity(rule: OpacityRule) -> Numbers:
    """Of the volume's own voxels."""
    if rule.patches:
        return np.asarray(plane(rule.patches).opacity)
    by_density, by_strength = (_factors(rule, field) for field in PACKET_SCALARS)
    return np.outer(by_strength, by_density).reshape(-1)


class ColourRule(NamedTuple):
    """What makes a voxel's colour before light where density and strength alone decide."""

    emit: ColourTable
    refl: ColourTable
    emit_field: Field
    refl_field: Field
    patches: Patches
    opacity: OpacityRule

    @property
    def by_packet(self) -> bool:
        """Whether density and strength alone decide; by patches they do."""
        return {self.emit_field, self.refl_field} <= set(PACKET_SCALARS)

    @property
    def is_mixed(self) -> bool:
        """Whether a voxel's colours are the means of those that it stands for, by their opacity."""
        return self.opacity.is_mixed and self.by_packet


class FrameColours(NamedTuple):
    """Emitted and reflected, with red, green, blue and 0 of each entry in float32.

    Of a plane the entries are at density | strength << 8, else at the byte of the field that the cross-bar names.
    """

    emit: "_kernels.Array"
    refl: "_kernels.Array"
    of_plane: bool


def frame_colours(
    shading: ShadingRule, mixture: LevelMixture | None = None, geometry: Geometry | None = None
) -> FrameColours:
    """`geometry` is the volume's; without it a level emits what it does on the mean over all sides, and not what the
    viewer sees."""
    rule = _colour_rule(shading, mixture)
    if rule.is_mixed:
        eye = None if geometry is None else _eye(shading.lighting, geometry)
        return _mixed_colours(rule, _emission(rule, eye))
    if rule.patches:
        table = plane(rule.patches)
        return FrameColours(table.emit, table.refl, True)
    return FrameColours(colours(rule.emit), colours(rule.refl), False)


def _eye(lighting: Lighting, geometry: Geometry) -> Vector:
    return eye_along_axes(lighting.light, lighting.half_way, geometry)


def _colour_rule(shading: ShadingRule, mixture: LevelMixture | None) -> ColourRule:
    cross_bar, opacity = shading.cross_bar, opacity_rule(shading, mixture)
    return ColourRule(shading.emit, shading.refl, cross_bar.emit, cross_bar.refl, shading.patches, opacity)


@lru_cache(KEPT_PLANES)
def _mixed_colours(rule: ColourRule, emission: float) -> FrameColours:
    emit, refl = _mean_entries(rule)
    emitted = emit * np.float32(emission)
    np.minimum(emitted, np.float32(1.0), out=emitted)
    return FrameColours(emitted.data, refl.data, True)


@lru_cache(KEPT_PLANES)
def _mean_entries(rule: ColourRule) -> NDArray[np.float32]:
    """Emitted and reflected, as in `FrameColours`."""
    entries = np.zeros((2, PLANE_ENTRIES, 4), np.float32)
    entries[..., :3] = _mean_colours(rule)
    return entries


@lru_cache(KEPT_PLANES)
def _mean_colours(rule: ColourRule) -> tuple[Numbers, Numbers]:
    """Emitted and reflected by a level's voxels, the means by opacity: (65536, 3)."""
    assert rule.opacity.mixture is not None
    own = _own_opacity(rule.opacity)[:, None] * np.concatenate(_own_colours(rule), axis=1)
    opacity = mixed_opacity(rule.opacity)[:, None]
    seen = opacity > 0.0
    means = np.where(seen, rule.opacity.mixture.means(own) / np.where(seen, opacity, 1.0), 0.0)
    emit, refl = np.split(np.minimum(means, 1.0), 2, axis=1)
    return emit, refl


def _own_colours(rule: ColourRule) -> tuple[Numbers, Numbers]:
    """Emitted and reflected by the volume's own voxels: (65536, 3). White where something else says what they are."""
    if rule.patches:
        table = plane(rule.patches)
        return np.asarray(table.emit)[:, :3], np.asarray(table.refl)[:, :3]
    return _on_plane(rule.emit, rule.emit_field), _on_plane(rule.refl, rule.refl_field)


def _on_plane(table: ColourTable, field: Field) -> Numbers:
    entries = np.array(table.entries())
    if field == Field.DENSITY:
        return np.tile(entries, (TABLE_ENTRIES, 1))
    if field == Field.STRENGTH:
        return np.repeat(entries, TABLE_ENTRIES, axis=0)
    return np.ones((PLANE_ENTRIES, 3))


@lru_cache(KEPT_PLANES)
def _seen_level(rule: ColourRule) -> SeenLevel | None:
    """The level against the one before; None where it is as bright as it is."""
    mixture = rule.opacity.mixture
    if mixture is None or mixture.columns is None or not rule.opacity.is_mixed:
        return None
    return SeenLevel(mixture.columns, _look(_of_finer(rule)), _look(rule))


def _of_finer(rule: ColourRule) -> ColourRule:
    assert rule.opacity.mixture is not None
    return rule._replace(opacity=rule.opacity._replace(mixture=rule.opacity.mixture.finer))


def _look(rule: ColourRule) -> Look:
    opacity = mixed_opacity(rule.opacity) if rule.opacity.is_mixed else _own_opacity(rule.opacity)
    emit, refl = _mean_colours(rule) if rule.is_mixed else _own_colours(rule)
    room = 1.0 - emit if rule.by_packet else np.full_like(emit, np.inf)  # nothing is cut off of what is not known
    return Look(opacity, emit.mean(axis=1), reflected_in_steps(refl, room))


def _emission(rule: ColourRule, eye: Vector | None) -> float:
    """What multiplies what a level emits."""
    seen = _seen_level(rule)
    return 1.0 if seen is None else seen.emission(eye) * _emission(_of_finer(rule), eye)


def frame_light(drawing: Drawing, mixture: LevelMixture | None) -> "_kernels.Array":
    """What multiplies the reflected colour, by direction code: float32 (32768,)."""
    codes, own_codes = drawing.directions, drawing.quantisation.directions
    rule, lighting = _colour_rule(drawing.shading, mixture), drawing.shading.lighting
    return _frame_light(rule, lighting, drawing.geometry, codes, own_codes)


@lru_cache(KEPT_LIGHT_TABLES)
def _frame_light(
    rule: ColourRule, lighting: Lighting, geometry: Geometry, codes: DirectionCode, own_codes: DirectionCode
) -> "_kernels.Array":
    light = light_of_directions(lighting, codes)
    multiplied = _light_factor(rule, lighting, geometry, own_codes)
    if multiplied == 1.0:
        return light
    return (np.asarray(light) * np.float32(multiplied)).data


def _light_factor(rule: ColourRule, lighting: Lighting, geometry: Geometry, own_codes: DirectionCode) -> float:
    """What multiplies the light on a level."""
    seen = _seen_level(rule)
    if seen is None:
        return 1.0
    finer = _of_finer(rule)
    codes = own_codes if finer.opacity.mixture is None else "rough"
    before = _light_factor(finer, lighting, geometry, own_codes)
    lights = (before * np.asarray(light_of_directions(lighting, code)).astype(np.float64) for code in (codes, "rough"))
    return before * seen.light(_eye(lighting, geometry), *lights)


def opacity_fields(rule: OpacityRule) -> tuple[Field, Field]:
    """What indexes the two axes of `opacity_codes`: density and strength if they alone decide."""
    return PACKET_SCALARS if rule.by_packet else (rule.opac_field, rule.modu_field)


@lru_cache(KEPT_OPACITY_TABLES)
def opacity_codes(rule: OpacityRule, exponent: float) -> "_kernels.Array":
    """12-bit codes of samples of this opacity exponent, uint16 (65536,).

    The place in the table is the byte of the first of `opacity_fields` plus 256 times that of the second.
    """
    if rule.is_mixed:
        return _kernels.plane_opacity_codes(mixed_opacity(rule).data, exponent)
    if rule.patches:
        return _kernels.plane_opacity_codes(plane(rule.patches).opacity, exponent)
    if rule.by_packet:
        by_density, by_strength = (_factors(rule, field) for field in PACKET_SCALARS)
        return _kernels.opacity_table(by_density, by_strength, exponent)
    return _kernels.opacity_table(scalar_entries(rule.opac), scalar_entries(rule.modu), exponent)


@lru_cache(KEPT_TABLES)
def visibility(rule: OpacityRule) -> bytes:
    """A bit for each density, then one for each strength, lowest first: 64 bytes.

    A voxel whose two bits are not both set is transparent whatever its other fields and its opacity exponent are.
    """
    if rule.is_mixed:
        of_plane = mixed_opacity(rule).reshape(TABLE_ENTRIES, TABLE_ENTRIES) > 0.0
        seen = tuple(np.flatnonzero(of_plane.any(axis)).tolist() for axis in (0, 1))
    else:
        seen = plane(rule.patches).seen() if rule.patches else _seen_of_tables(rule)
    bits = [sum(1 << n for n in numbers) for numbers in seen]
    return b"".join(number.to_bytes(TABLE_ENTRIES // 8, "little") for number in bits)


def _seen_of_tables(rule: OpacityRule) -> tuple[list[int], list[int]]:
    others = [table for table, field in _tables_of(rule) if field not in PACKET_SCALARS]
    visible = all(max(scalar_entries(table)) > 0.0 for table in others)
    densities, strengths = (
        [n for n, a in enumerate(_factors(rule, field)) if visible and a > 0.0] for field in PACKET_SCALARS
    )
    return densities, strengths


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
        lighting.light,
        lighting.half_way,
        lighting.diffuse,
        lighting.specular,
        lighting.two_sided,
        lighting.specular_power,
        _rough_light(lighting.two_sided, lighting.specular_power) if directions == "rough" else None,
    )


@lru_cache(KEPT_LIGHT_TABLES)
def _rough_light(two_sided: bool, specular_power: float) -> "_kernels.RoughLight":
    return _kernels.RoughLight(ROUGHNESS_COSINES, two_sided, specular_power)


@lru_cache(KEPT_TABLES)
def gradient_bytes(directions: DirectionCode, index_to_physical: Matrix) -> "_kernels.Array":
    """The bytes of the fields gradient i, j, k by direction code: uint8 (3, 32768)."""
    axes = [matrices.normalised(matrices.column(index_to_physical, axis)) for axis in range(3)]
    return _kernels.gradient_bytes(directions, axes)
