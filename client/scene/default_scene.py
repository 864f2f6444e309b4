"""The scene that a volume is first seen with: as its field looks at its kind; by its histogram if none is known."""

from collections.abc import Callable

import msgspec

from volsplat.client.histogram.density_histogram import zero_position
from volsplat.client.histogram.subject import Subject
from volsplat.client.scene.class_scenes import classes_scene
from volsplat.client.scene.contour_scenes import both_signs_scene, density_scene
from volsplat.client.scene.glow_scenes import spectral_scene, structure_factors_scene
from volsplat.client.scene.histogram_scene import histogram_scene, shows_labels
from volsplat.client.scene.presets import start_view
from volsplat.client.scene.seismic_scene import seismic_scene
from volsplat.client.scene.slice_scene import slice_scene
from volsplat.protocol.description.kind import Kind
from volsplat.protocol.description.scene import Scene


def default_scene(subject: Subject) -> Scene:
    """A scene for a volume, of its kind; by its histogram if that is unknown, or would show nothing.

    A single slice of a kind without a scene of its own is a picture in greys.
    """
    scene = _of_its_kind(subject) or histogram_scene(subject)
    return msgspec.structs.replace(scene, view=start_view(subject))


def is_shown_as_labels(subject: Subject) -> bool:
    """Whether the default scene takes values for labels that nobody states to be any."""
    return shows_labels(subject) and _of_its_kind(subject) is None


def _of_its_kind(subject: Subject) -> Scene | None:
    build = _BY_KIND.get(subject.kind, slice_scene if subject.single_slice else None)
    return build(subject) if build is not None and subject.histogram.voxels else None


def _seismic(subject: Subject) -> Scene | None:
    """None for impedances, velocities and whatever else has one sign."""
    return seismic_scene(subject) if zero_position(subject.histogram) is not None else None


_BY_KIND: dict[Kind, Callable[[Subject], Scene | None]] = {
    Kind.LABELS: classes_scene,
    Kind.ELEMENTS: classes_scene,
    Kind.CRYSTAL_MAP: density_scene,
    Kind.EM_MAP: density_scene,
    Kind.PATTERSON: density_scene,
    Kind.ATOM_DENSITY: density_scene,
    Kind.ELECTRON_DENSITY: density_scene,
    Kind.DIFFERENCE_MAP: both_signs_scene,
    Kind.STATISTIC_MAP: both_signs_scene,
    Kind.WAVE_FUNCTION: both_signs_scene,
    Kind.SPECTRAL_CUBE: spectral_scene,
    Kind.STRUCTURE_FACTORS: structure_factors_scene,
    Kind.SEISMIC: _seismic,
}
