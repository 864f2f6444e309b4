"""Scenes that a kind of data is first seen with, for a volume that need not say that it is of this kind."""

import math
from dataclasses import replace

from volsplat.client.histogram.density_histogram import LAST, DensityHistogram
from volsplat.client.histogram.subject import Subject
from volsplat.client.scene.class_scenes import classes_scene
from volsplat.client.scene.contour_scenes import both_signs_scene, density_scene
from volsplat.client.scene.histogram_scene import histogram_scene
from volsplat.protocol.description.kind import Kind
from volsplat.protocol.description.scene import Scene

ASSUMED_SIGMAS = 6.0  # on either side of the mean, of a map if there is no volume to ask
ASSUMED_LABELS = 15

_BUILD = {
    Kind.CRYSTAL_MAP: density_scene,
    Kind.EM_MAP: density_scene,
    Kind.DIFFERENCE_MAP: both_signs_scene,
    Kind.LABELS: classes_scene,
}


def scene_as(kind: Kind, subject: Subject | None) -> Scene:
    """As a volume of this kind is shown; by the histogram if nothing of the volume would be seen so."""
    known = replace(subject, kind=kind) if subject is not None else Subject(_assumed(kind), kind)
    return _BUILD[kind](known) or histogram_scene(known)


def _assumed(kind: Kind) -> DensityHistogram:
    """Noise in sigma, or as many voxels of each label."""
    if kind is Kind.LABELS:
        return DensityHistogram((0.0, ASSUMED_LABELS), (1000,) * (LAST + 1))
    sigmas = (ASSUMED_SIGMAS * (2 * byte / LAST - 1) for byte in range(LAST + 1))
    counts = tuple(int(1e6 * math.exp(-0.5 * sigma**2)) + 100 for sigma in sigmas)
    return DensityHistogram((-ASSUMED_SIGMAS, ASSUMED_SIGMAS), counts)
