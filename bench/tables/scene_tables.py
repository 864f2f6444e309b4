"""The tables of the benchmarks, which other renderers can be given as well: by density alone, nothing modulated."""

from collections.abc import Callable
from enum import StrEnum

from volsplat.client.histogram.density_histogram import DensityHistogram, ct_scale
from volsplat.client.phantoms import shells_tables
from volsplat.client.scene.table_makers import KEY_LIGHT
from volsplat.protocol.description.colours import Colour
from volsplat.protocol.description.scene import Scene, Shading
from volsplat.protocol.description.shading_tables import ColourTable, ScalarTable, Tables

SKIN: Colour = (0.95, 0.77, 0.64)
BONE: Colour = (0.92, 0.88, 0.78)
EMITTED, REFLECTED = 0.3, 0.35  # shares of a tissue's colour: with diffuse and specular light no channel exceeds 1
SPECULAR_POWER = 20.0

SHELL_HU = (-830.0, -500.0, -80.0, -20.0)  # where the thin shell begins, is most opaque, and ends
BONE_HU = ((150.0, 0.0), (450.0, 0.7), (1000.0, 0.9))  # and the opacity there
NO_AIR_HU = -750.0  # where the opaque tissue begins
SKIN_OPACITY = 0.6


class TableName(StrEnum):
    """What the benchmarks show."""

    SHELLS = "shells"  # of the phantom
    SKIN = "skin"  # of a CT: a smooth thin shell where air meets tissue, 11 to 14 % of the voxels
    OPAQUE = "opaque"  # of a CT: all tissue, of which nearly all is hidden
    BONE = "bone"  # of a CT: the skull, from spongy to dense
    PRESET = "preset"  # what --preset, --scene or the data choose


def benchmark_scene(name: TableName, histogram: DensityHistogram) -> Scene:
    """A scene with the tables `name`, which is not PRESET, for a volume of this histogram."""
    return Scene(
        tables=_TABLES[name](histogram),
        shading=Shading(modulation=False, specular_power=SPECULAR_POWER),
        light=KEY_LIGHT,
    )


def _skin(histogram: DensityHistogram) -> Tables:
    at = ct_scale(histogram).position
    begins, rises, falls, ends = map(at, SHELL_HU)
    opac = ((begins, 0.0), (rises, SKIN_OPACITY), (falls, SKIN_OPACITY), (ends, 0.0))
    return _tinted(SKIN, ScalarTable(points=opac))


def _bone(histogram: DensityHistogram) -> Tables:
    at = ct_scale(histogram).position
    return _tinted(BONE, ScalarTable(points=tuple((at(hu), opacity) for hu, opacity in BONE_HU)))


def _opaque(histogram: DensityHistogram) -> Tables:
    at = ct_scale(histogram).position
    return _tinted(SKIN, ScalarTable(points=((at(NO_AIR_HU), 0.0), (at(NO_AIR_HU), 1.0))))


def _tinted(colour: Colour, opac: ScalarTable) -> Tables:
    """One colour, emitted and reflected."""
    emit, refl = (tuple(channel * share for channel in colour) for share in (EMITTED, REFLECTED))
    return Tables(emit=_constant(emit), refl=_constant(refl), opac=opac)


def _constant(colour: tuple[float, ...]) -> ColourTable:
    return ColourTable(points=((0.0, (colour[0], colour[1], colour[2])),))


_TABLES: dict[TableName, Callable[[DensityHistogram], Tables]] = {
    TableName.SHELLS: lambda histogram: shells_tables(),
    TableName.SKIN: _skin,
    TableName.OPAQUE: _opaque,
    TableName.BONE: _bone,
}
