"""Ready-made scenes, each after an image or a remark in the paper, placed by the volume's own histogram."""

from collections.abc import Callable
from dataclasses import dataclass

import msgspec

from volsplat.client.histogram.density_histogram import CtScale, DensityHistogram, ct_scale, landmarks, zero_position
from volsplat.client.histogram.subject import Subject
from volsplat.client.scene.class_scenes import CPK, classes_scene
from volsplat.client.scene.glow_scenes import spectral_scene, structure_factors_scene
from volsplat.client.scene.seismic_scene import seismic_scene
from volsplat.client.scene.table_makers import GLOW, KEY_LIGHT, REFLECTION, both_sides, colours, dimmed, scalars
from volsplat.protocol.description.kind import Kind
from volsplat.protocol.description.scene import CrossBar, Field, Scene, Shading, Tables, View
from volsplat.protocol.description.view_rotation import named_view, rotation_from_angles
from volsplat.protocol.text.errors import BadInput

SPECTRUM_ANGLES = (30.0, 20.0)  # azimuth and elevation: in front, the spectral axis leads straight away


@dataclass(frozen=True)
class Preset:
    description: str  # one line
    source: str  # what the paper says of it
    build: Callable[[Subject | None], Scene]
    kinds: tuple[Kind, ...] = ()  # that it is made for


def preset_scene(name: str, subject: Subject | None = None) -> Scene:
    """The scene of a preset, for a volume or, without one, for a CT of HU + 1024 in a window 0..2550.

    It starts with the view of every scene of the volume. Raises BadInput for no such name.
    """
    preset = PRESETS.get(name)
    if preset is None:
        raise BadInput(f"--preset {name}: no such preset; choose one of {', '.join(PRESETS)}")
    return msgspec.structs.replace(preset.build(subject), view=start_view(subject))


def start_view(subject: Subject | None) -> View:
    """The view that every scene starts with, preset or not: the front; of a spectral cube, turned; a slice's face."""
    if subject is not None and subject.kind is Kind.SPECTRAL_CUBE:
        return View(rotation=rotation_from_angles(*SPECTRUM_ANGLES))
    return View(rotation=named_view(subject.face if subject is not None and subject.face is not None else "front"))


def fits(name: str, subject: Subject) -> bool:
    """Whether the data is of a kind that the preset is made for: as stated, else as far as the histogram tells."""
    kinds = PRESETS[name].kinds
    if subject.kind is not Kind.UNKNOWN:
        return subject.kind in kinds
    if subject.ct is not None:
        return Kind.CT in kinds
    return zero_position(subject.histogram) is not None and bool({Kind.WAVE_FUNCTION, Kind.SEISMIC} & set(kinds))


def _ct(subject: Subject | None) -> CtScale:
    """Hounsfield units on a table, as the volume has them or, if it tells nothing of them, as a CT would."""
    return subject and subject.ct or ct_scale(_histogram(subject))


def _histogram(subject: Subject | None) -> DensityHistogram | None:
    return subject.histogram if subject else None


def _ct_skin(subject: Subject | None) -> Scene:
    at = _ct(subject).position
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


def _ct_bone(subject: Subject | None) -> Scene:
    at = _ct(subject).position
    return Scene(
        tables=Tables(
            emit=colours((at(150), "#241f17"), (at(1500), "#7d7660")),
            refl=colours((at(150), "#1f6a2c"), (at(1500), "#46b257")),
            opac=scalars((at(150), 0.0), (at(450), 0.7), (at(1000), 0.9)),
        ),
        shading=Shading(modulation=False, specular_power=20.0),
        light=KEY_LIGHT,
    )


def _surfaces(subject: Subject | None) -> Scene:
    """Every boundary at once; the colour tells what lies behind it. Clip with `bounds` to look inside."""
    at = _ct(subject).position
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


def _depth_cue(subject: Subject | None) -> Scene:
    """What is far from the viewer fades into the background."""
    at = landmarks(_histogram(subject))
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


def _molecules(subject: Subject | None) -> Scene:
    """Emitted light by gradient strength brings out the atoms' boundaries, reflected light tells the density."""
    at = landmarks(_histogram(subject))
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


def _atoms(subject: Subject | None) -> Scene:
    """The elements by the bands that the volume states; of a map, bands of density, whose peaks rise from carbon over
    nitrogen and oxygen to sulphur."""
    if subject is not None and subject.kind is Kind.ELEMENTS and (scene := classes_scene(subject)) is not None:
        return scene
    at = landmarks(_histogram(subject))
    carbon, nitrogen, oxygen, sulphur = (at.object + (at.core - at.object) * n / 3 for n in range(4))
    edges = ((carbon + nitrogen) / 2, (nitrogen + oxygen) / 2, (oxygen + sulphur) / 2)
    bands = tuple(CPK[element] for element in ("C", "N", "O", "S"))
    points = [(0.0, bands[0])]
    for edge, below, above in zip(edges, bands[:-1], bands[1:], strict=True):
        points += [(edge, below), (edge, above)]
    return Scene(
        tables=Tables(
            emit=dimmed(colours(*points), GLOW),
            refl=dimmed(colours(*points), REFLECTION),
            opac=scalars((at.background, 0.0), (at.object, 0.2), (at.core, 0.8)),
        ),
        shading=Shading(modulation=False, specular_power=40.0),
        light=KEY_LIGHT,
    )


def _orbital(subject: Subject | None) -> Scene:
    """Soft lobes; of a signed wave function, each sign in its own colour."""
    zero = zero_position(_histogram(subject))
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
    at = landmarks(_histogram(subject))
    return Scene(
        tables=Tables(
            emit=colours((at.background, "#101c50"), (at.object, "#3050a8"), (at.core, "#d8e4f0")),
            refl=colours((0.0, "#506890")),
            opac=scalars((at.background, 0.0), (at.object, 0.03), (at.core, 0.5)),
        ),
        shading=Shading(modulation=False, specular_power=10.0),
        light=KEY_LIGHT,
    )


PRESETS: dict[str, Preset] = {
    "ct-skin": Preset(
        "the skin of a CT: a thin shell where air meets tissue",
        'colour plates 1 and 2: "shading tables, chosen to bring out the skin surface"',
        _ct_skin,
        (Kind.CT,),
    ),
    "ct-bone": Preset(
        "the bone of a CT, in green reflected light",
        'colour plate 2: "tables that were chosen to display bone", "the reflection table was loaded with green"',
        _ct_bone,
        (Kind.CT,),
    ),
    "surfaces": Preset(
        "all boundaries of a CT: opacity grows with gradient strength",
        'colour plate 2: "tables that emphasize surfaces by using the opacity modulation table"',
        _surfaces,
        (Kind.CT,),
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
        (Kind.CRYSTAL_MAP, Kind.EM_MAP, Kind.ATOM_DENSITY),
    ),
    "atoms": Preset(
        "molecules by atom type: grey carbon, blue nitrogen, red oxygen, yellow sulphur",
        'colour plate 3: "color the density by atom type"',
        _atoms,
        (Kind.ELEMENTS, Kind.ATOM_DENSITY),
    ),
    "orbital": Preset(
        "orbitals: soft lobes, the two signs of a wave function in two colours",
        'colour plate 3: "Note the soft bonding between the lobes"',
        _orbital,
        (Kind.WAVE_FUNCTION, Kind.ELECTRON_DENSITY),
    ),
    "structure-factors": Preset(
        "structure factors: colour by phase, opacity by amplitude",
        'colour plate 3: "colored by phase angle and the opacity depends the intensity"',
        structure_factors_scene,
        (Kind.STRUCTURE_FACTORS,),
    ),
    "galaxy": Preset(
        "a spectral cube of a galaxy: colour by wavelength, glowing",
        "colour plate 4: a Fabry-Perot map of a galaxy",
        spectral_scene,
        (Kind.SPECTRAL_CUBE,),
    ),
    "seismic": Preset(
        "a seismic study: strong reflections, negative blue and positive red",
        "colour plate 4: a synthetic seismic study",
        seismic_scene,
        (Kind.SEISMIC,),
    ),
}
