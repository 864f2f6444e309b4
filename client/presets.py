"""Ready-made scenes, each after an image or a remark in the paper, placed by the volume's own histogram."""

from collections.abc import Callable
from dataclasses import dataclass

import msgspec

from volsplat.client.colours import colour_from_hex
from volsplat.client.density_histogram import (
    DensityHistogram,
    ct_scale,
    landmarks,
    recognised_ct,
    zero_position,
)
from volsplat.client.view_rotation import Quaternion, named_view
from volsplat.protocol.errors import BadInput
from volsplat.protocol.scene import ColourTable, CrossBar, Field, Light, ScalarTable, Scene, Shading, Tables, View

KEY_LIGHT = Light(direction=(0.35, 0.45, 1.0))  # a little from the right and above, so that form casts shade


@dataclass(frozen=True)
class Preset:
    description: str  # one line
    source: str  # what the paper says of it
    build: Callable[[DensityHistogram | None], Scene]
    patient: bool = False  # a scan of a head: the front is where the nose is
    signed: bool = False  # made for data on both sides of zero


def preset_scene(name: str, histogram: DensityHistogram | None = None, anatomical: bool = True) -> Scene:
    """The scene of a preset, for a volume's histogram or, without one, for a CT of HU + 1024 in a window 0..2550.

    It is seen as start_rotation tells. Raises BadInput for no such name.
    """
    preset = PRESETS.get(name)
    if preset is None:
        raise BadInput(f"--preset {name}: no such preset; choose one of {', '.join(PRESETS)}")
    rotation = start_rotation(histogram, anatomical, preset.patient)
    return msgspec.structs.replace(preset.build(histogram), view=View(rotation=rotation))


def fits(name: str, histogram: DensityHistogram) -> bool:
    """Whether the data is of the kind that the preset is made for, as far as a histogram can tell."""
    preset = PRESETS[name]
    if recognised_ct(histogram) is not None:
        return preset.patient
    return preset.signed and zero_position(histogram) is not None


def start_rotation(histogram: DensityHistogram | None, anatomical: bool, patient: bool = False) -> Quaternion:
    """The view that every scene starts with, preset or not: the front.

    Where a patient's scan does not tell its orientation, its slices are taken to count from the top of the head down
    and its rows from the nose backwards, as in the paper's. A CT is known by its histogram, or where `patient` says so.
    """
    stacked = not anatomical and (patient or recognised_ct(histogram) is not None)
    return named_view("stack" if stacked else "front")


def colours(*points: tuple[float, str]) -> ColourTable:
    return ColourTable(points=tuple((position, colour_from_hex(colour)) for position, colour in points))


def scalars(*points: tuple[float, float]) -> ScalarTable:
    return ScalarTable(points=points)


def dimmed(table: ColourTable, factor: float) -> ColourTable:
    return ColourTable(
        points=tuple((position, (r * factor, g * factor, b * factor)) for position, (r, g, b) in table.points)
    )


def both_sides(zero: float, clear: float, strongest: float) -> ScalarTable:
    """Opacity that grows with the distance from `zero` on both sides, beyond the share `clear` of it."""
    below, above = zero * (1 - clear), zero + (1 - zero) * clear
    return scalars((0.0, strongest), (below, 0.0), (above, 0.0), (1.0, strongest))


def _ct_skin(histogram: DensityHistogram | None) -> Scene:
    at = ct_scale(histogram).position
    return Scene(
        tables=Tables(
            emit=colours((0.40, "#2a1811"), (0.78, "#966450")),
            refl=colours((0.0, "#6e4a3a")),
            opac=scalars((at(-550), 0.0), (at(-200), 1.0), (at(80), 1.0), (at(220), 0.0)),
            modu=scalars((0.03, 0.0), (0.12, 1.0)),  # inside the head nothing changes as much as at the skin
        ),
        cross_bar=CrossBar(emit=Field.SCREEN_Z),
        shading=Shading(specular_power=25.0),
        light=KEY_LIGHT,
    )


def _ct_bone(histogram: DensityHistogram | None) -> Scene:
    at = ct_scale(histogram).position
    return Scene(
        tables=Tables(
            emit=colours((at(150), "#241f17"), (at(1500), "#7d7660")),
            refl=colours((at(150), "#1f6a2c"), (at(1500), "#46b257")),
            opac=scalars((at(150), 0.0), (at(450), 0.7), (at(1000), 0.9)),
        ),
        shading=Shading(modulation=False, specular_power=20.0),
        light=KEY_LIGHT,
    )


def _surfaces(histogram: DensityHistogram | None) -> Scene:
    """Every boundary at once; the colour tells what lies behind it. Clip with `bounds` to look inside."""
    at = ct_scale(histogram).position
    return Scene(
        tables=Tables(
            emit=colours((at(-700), "#0c1418"), (at(0), "#2e1d16"), (at(100), "#3a251c"), (at(600), "#5c5644")),
            refl=colours((at(-700), "#506878"), (at(-100), "#9a6c55"), (at(100), "#a87a5e"), (at(600), "#b0a88c")),
            opac=scalars((at(-700), 0.0), (at(-300), 0.5), (at(1000), 0.9)),
            modu=scalars((0.06, 0.0), (0.8, 1.0)),
        ),
        shading=Shading(two_sided=True),
        light=KEY_LIGHT,
    )


def _depth_cue(histogram: DensityHistogram | None) -> Scene:
    """What is far from the viewer fades into the background."""
    at = landmarks(histogram)
    return Scene(
        tables=Tables(
            emit=colours((at.object, "#2b3440"), (at.core, "#7c8794")),
            refl=colours((0.0, "#8a857a")),
            opac=scalars((at.background, 0.0), (at.object, 0.25), (at.core, 0.8)),
            modu=scalars((0.15, 0.0), (0.85, 1.0)),
        ),
        cross_bar=CrossBar(modu=Field.SCREEN_Z),
        light=KEY_LIGHT,
    )


def _molecules(histogram: DensityHistogram | None) -> Scene:
    """Emitted light by gradient strength brings out the atoms' boundaries, reflected light tells the density."""
    at = landmarks(histogram)
    return Scene(
        tables=Tables(
            emit=colours((0.0, "#040a1e"), (0.25, "#0c2a58"), (0.6, "#5a2a68"), (1.0, "#a0562c")),
            refl=colours((at.object, "#2456a8"), (at.middle, "#3a9a78"), (at.core, "#c8a23c"), (1.0, "#d8d0c0")),
            opac=scalars((at.background, 0.0), (at.object, 0.12), (at.core, 0.6)),
        ),
        cross_bar=CrossBar(emit=Field.STRENGTH),
        shading=Shading(modulation=False, specular_power=30.0),
        light=KEY_LIGHT,
    )


def _atoms(histogram: DensityHistogram | None) -> Scene:
    """Bands of density, for a map whose peaks rise from carbon over nitrogen and oxygen to sulphur."""
    at = landmarks(histogram)
    carbon, nitrogen, oxygen, sulphur = (at.object + (at.core - at.object) * n / 3 for n in range(4))
    edges = ((carbon + nitrogen) / 2, (nitrogen + oxygen) / 2, (oxygen + sulphur) / 2)
    bands = ("#2f9e44", "#2f6fe0", "#d8342c", "#e8cc30")
    points = [(0.0, bands[0])]
    for edge, below, above in zip(edges, bands[:-1], bands[1:], strict=True):
        points += [(edge, below), (edge, above)]
    return Scene(
        tables=Tables(
            emit=dimmed(colours(*points), 0.35),
            refl=dimmed(colours(*points), 0.75),
            opac=scalars((at.background, 0.0), (at.object, 0.2), (at.core, 0.8)),
        ),
        shading=Shading(modulation=False, specular_power=40.0),
        light=KEY_LIGHT,
    )


def _orbital(histogram: DensityHistogram | None) -> Scene:
    """Soft lobes; of a signed wave function, each sign in its own colour."""
    zero = zero_position(histogram)
    if zero is not None:
        return Scene(
            tables=Tables(
                emit=colours((0.0, "#2c6ccc"), (zero, "#0a0a10"), (1.0, "#cc7a2c")),
                refl=colours((zero, "#2c5890"), (zero, "#90602c")),
                opac=both_sides(zero, 0.06, 0.45),
            ),
            shading=Shading(modulation=False),
            light=KEY_LIGHT,
        )
    at = landmarks(histogram)
    return Scene(
        tables=Tables(
            emit=colours((at.background, "#101c50"), (at.object, "#3050a8"), (at.core, "#d8e4f0")),
            refl=colours((0.0, "#506890")),
            opac=scalars((at.background, 0.0), (at.object, 0.03), (at.core, 0.5)),
        ),
        shading=Shading(modulation=False, specular_power=10.0),
        light=KEY_LIGHT,
    )


def _structure_factors(histogram: DensityHistogram | None) -> Scene:
    """Points coloured by phase, which such a volume holds in place of gradient strength; opaque by amplitude."""
    at = landmarks(histogram)
    wheel = ("#e03c3c", "#d8b428", "#48b840", "#30b4b4", "#3c5ce0", "#b43cc0", "#e03c3c")
    return Scene(
        tables=Tables(
            emit=colours(*((n / 6, colour) for n, colour in enumerate(wheel))),
            refl=colours((0.0, "#000000")),
            opac=scalars((at.background, 0.0), (at.object, 0.3), (at.core, 1.0)),
        ),
        cross_bar=CrossBar(emit=Field.STRENGTH),
        shading=Shading(diffuse=False, specular=False, modulation=False),
    )


def _galaxy(histogram: DensityHistogram | None) -> Scene:
    """Glowing gas: colour tells the third axis, wavelength, that is speed along the line of sight."""
    at = landmarks(histogram)
    return Scene(
        tables=Tables(
            emit=colours((0.0, "#4060ff"), (0.35, "#58c8e8"), (0.5, "#e8e8d0"), (0.65, "#f0b048"), (1.0, "#f04030")),
            refl=colours((0.0, "#000000")),
            opac=scalars((at.background, 0.0), (at.object, 0.04), (at.core, 0.5)),
        ),
        cross_bar=CrossBar(emit=Field.GRID_K),
        shading=Shading(diffuse=False, specular=False, modulation=False),
    )


def _seismic(histogram: DensityHistogram | None) -> Scene:
    """Strong reflections of either sign; what is near zero is clear."""
    zero = zero_position(histogram)
    zero = 0.5 if zero is None else zero
    return Scene(
        tables=Tables(
            emit=colours((0.0, "#2858d8"), (zero, "#c8c4bc"), (1.0, "#d83828")),
            refl=colours((0.0, "#404040")),
            opac=both_sides(zero, 0.3, 0.6),
        ),
        shading=Shading(modulation=False),
        light=KEY_LIGHT,
    )


PRESETS: dict[str, Preset] = {
    "ct-skin": Preset(
        "the skin of a CT: a thin shell where air meets tissue",
        'colour plates 1 and 2: "shading tables, chosen to bring out the skin surface"',
        _ct_skin,
        patient=True,
    ),
    "ct-bone": Preset(
        "the bone of a CT, in green reflected light",
        'colour plate 2: "tables that were chosen to display bone", "the reflection table was loaded with green"',
        _ct_bone,
        patient=True,
    ),
    "surfaces": Preset(
        "all boundaries of a CT: opacity grows with gradient strength",
        'colour plate 2: "tables that emphasize surfaces by using the opacity modulation table"',
        _surfaces,
        patient=True,
    ),
    "depth-cue": Preset(
        "any volume: opacity fades with the distance from the viewer",
        'Shading: "index the opacity modulation table with the packet\'s z value for pseudo depth queuing"',
        _depth_cue,
    ),
    "molecules": Preset(
        "electron density: emitted light by gradient strength, reflected light by density",
        'Shading: "emitted light based on gradient strength and reflected light based on density"; colour plate 3',
        _molecules,
    ),
    "atoms": Preset(
        "electron density by atom type: green carbon, blue nitrogen, red oxygen, yellow sulphur",
        'colour plate 3: "color the density by atom type"',
        _atoms,
    ),
    "orbital": Preset(
        "orbitals: soft lobes, the two signs of a wave function in two colours",
        'colour plate 3: "Note the soft bonding between the lobes"',
        _orbital,
        signed=True,
    ),
    "structure-factors": Preset(
        "structure factors: colour by phase, opacity by amplitude",
        'colour plate 3: "colored by phase angle and the opacity depends the intensity"',
        _structure_factors,
    ),
    "galaxy": Preset(
        "a spectral cube of a galaxy: colour by wavelength, glowing",
        "colour plate 4: a Fabry-Perot map of a galaxy",
        _galaxy,
    ),
    "seismic": Preset(
        "a seismic study: strong reflections, negative blue and positive red",
        "colour plate 4: a synthetic seismic study",
        _seismic,
        signed=True,
    ),
}
