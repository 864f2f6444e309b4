"""Ready-made scenes, of the paper's images and of what each field looks at, placed by the volume's own values."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import msgspec

from volsplat.client.histogram.density_histogram import landmarks, zero_position
from volsplat.client.histogram.subject import FRONT, OBLIQUE, Subject, histogram_of
from volsplat.client.scene.ct_scenes import (
    ct_angio_scene,
    ct_bone_scene,
    ct_lung_scene,
    ct_skin_scene,
    ct_soft_tissue_scene,
    surfaces_scene,
)
from volsplat.client.scene.glow_scenes import spectral_scene, structure_factors_scene
from volsplat.client.scene.kind_scenes import scene_as
from volsplat.client.scene.molecule_scenes import atoms_scene, molecules_scene, orbital_scene
from volsplat.client.scene.mr_scenes import mr_angio_scene, mr_t1_scene, mr_t2_scene
from volsplat.client.scene.seismic_scene import seismic_scene
from volsplat.client.scene.table_makers import KEY_LIGHT, colours, scalars
from volsplat.protocol.description.kind import Kind
from volsplat.protocol.description.scene import Scene, View
from volsplat.protocol.description.shading_tables import CrossBar, Field, Tables
from volsplat.protocol.description.view_rotation import named_view, rotation_from_angles
from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.text.meant import meant

OBLIQUE_ANGLES = (-30.0, 20.0)  # azimuth and elevation, in degrees


@dataclass(frozen=True)
class Preset:
    description: str  # one line
    source: str  # what the paper says of it, or whose custom it follows
    build: Callable[[Subject | None], Scene]
    kinds: tuple[Kind, ...] = ()  # that it is made for


class Presets(dict[str, Preset]):
    """Found by their names, whatever the case."""

    def __missing__(self, name: str) -> Preset:
        """Raises BadInput for a name that none has."""
        known = {one.lower(): one for one in self}.get(str(name).lower())
        if known is None:
            raise BadInput(f"there is no preset {name} ({meant(str(name), list(self))})")
        return self[known]

    def name_of(self, preset: Preset) -> str:
        return next(name for name, one in self.items() if one is preset)


def preset_scene(name: str, subject: Subject | None = None) -> Scene:
    """The scene of a preset, for a volume or, without one, for a CT of HU + 1024 in a window 0..2550.

    It starts with the view of every scene of the volume. Raises BadInput for no such name.
    """
    return msgspec.structs.replace(PRESETS[name].build(subject), view=start_view(subject))


def start_view(subject: Subject | None) -> View:
    """The view that every scene starts with, preset or not.

    A spectral cube's front is the sky as it is seen: its spectral axis leads straight away.
    """
    name = FRONT if subject is None else subject.first_view
    return View(rotation=rotation_from_angles(*OBLIQUE_ANGLES) if name == OBLIQUE else named_view(name))


def fits(name: str, subject: Subject) -> bool:
    """Whether the data is of a kind that the preset is made for: as stated, else as far as the histogram tells."""
    kinds = PRESETS[name].kinds
    if subject.kind is not Kind.UNKNOWN:
        return subject.kind in kinds
    if subject.ct is not None:
        return Kind.CT in kinds
    return zero_position(subject.histogram) is not None and bool({Kind.WAVE_FUNCTION, Kind.SEISMIC} & set(kinds))


def _depth_cue(subject: Subject | None) -> Scene:
    """What is far from the viewer fades into the background."""
    at = landmarks(histogram_of(subject))
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


PRESETS = Presets(
    {
        "ct-skin": Preset(
            "the skin of a CT: a thin shell where air meets tissue",
            'colour plates 1 and 2: "shading tables, chosen to bring out the skin surface"',
            ct_skin_scene,
            (Kind.CT,),
        ),
        "ct-bone": Preset(
            "the bone of a CT, in ivory",
            'colour plate 2: "tables that were chosen to display bone", "the reflection table was loaded with green"',
            ct_bone_scene,
            (Kind.CT,),
        ),
        "surfaces": Preset(
            "all boundaries of a CT: opacity grows with gradient strength",
            'colour plate 2: "tables that emphasize surfaces by using the opacity modulation table"',
            surfaces_scene,
            (Kind.CT,),
        ),
        "ct-soft-tissue": Preset(
            "the muscles and organs of a CT under a veil of fat, bone in ivory",
            "radiology: fat about -100 HU, muscle and organs 20 to 90 HU",
            ct_soft_tissue_scene,
            (Kind.CT,),
        ),
        "ct-lung": Preset(
            "the lungs of a CT: a cloud, and in it the walls of its vessels, from -950 to -150 HU",
            "radiology: aerated lung lies between -950 and -500 HU",
            ct_lung_scene,
            (Kind.CT,),
        ),
        "ct-angio": Preset(
            "CT angiography: vessels filled with contrast agent in red, bone in ivory",
            "radiology: contrast agent in arteries reaches 200 to 500 HU",
            ct_angio_scene,
            (Kind.CT,),
        ),
        "mr-t1": Preset(
            "T1-weighted MR: the head's or brain's surface, from dark to bright tissue",
            "radiology: fat and white matter are bright, fluid is dark",
            mr_t1_scene,
            (Kind.MR,),
        ),
        "mr-t2": Preset(
            "T2-weighted MR: fluid, which is brightest, in blue through a veil of tissue",
            "radiology: fluid is bright, white matter is dark",
            mr_t2_scene,
            (Kind.MR,),
        ),
        "mr-angio": Preset(
            "MR angiography: flowing blood, the brightest 1.5 % of the voxels, in red",
            "radiology: time of flight shows flowing blood brightest",
            mr_angio_scene,
            (Kind.MR,),
        ),
        "xray-map": Preset(
            "X-ray density: a surface at 1.5 sigma above the mean",
            "crystallography: Coot's first contour of a 2Fo-Fc map",
            partial(scene_as, Kind.CRYSTAL_MAP),
            (Kind.CRYSTAL_MAP,),
        ),
        "em-map": Preset(
            "cryo-EM density: a surface at 3 sigma above the mean, or fewer in a box cut close",
            "electron microscopy: maps are contoured at about 3 sigma",
            partial(scene_as, Kind.EM_MAP),
            (Kind.EM_MAP,),
        ),
        "difference-map": Preset(
            "a difference map: green above 3 sigma, red below -3 sigma",
            "crystallography: Coot's colours of an Fo-Fc map",
            partial(scene_as, Kind.DIFFERENCE_MAP),
            (Kind.DIFFERENCE_MAP,),
        ),
        "labels": Preset(
            "labels: each whole number above 0 solid in a colour of its own, or in its file's",
            "segmentation: 0 is the background",
            partial(scene_as, Kind.LABELS),
            (Kind.LABELS,),
        ),
        "depth-cue": Preset(
            "any volume: opacity fades with the distance from the viewer",
            'Shading: "index the opacity modulation table with the packet\'s z value for pseudo depth queuing"',
            _depth_cue,
        ),
        "molecules": Preset(
            "electron density: emitted light by gradient strength, reflected light by density",
            'Shading: "emitted light based on gradient strength and reflected light based on density"; colour plate 3',
            molecules_scene,
            (Kind.CRYSTAL_MAP, Kind.EM_MAP, Kind.ATOM_DENSITY),
        ),
        "atoms": Preset(
            "molecules by atom type: grey carbon, blue nitrogen, red oxygen, yellow sulphur",
            'colour plate 3: "color the density by atom type"',
            atoms_scene,
            (Kind.ELEMENTS, Kind.ATOM_DENSITY),
        ),
        "orbital": Preset(
            "orbitals: soft lobes, the two signs of a wave function in two colours",
            'colour plate 3: "Note the soft bonding between the lobes"',
            orbital_scene,
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
)
