"""Where an exported file's own origin lies: numbers of float32 cannot tell voxels apart that are far from theirs."""

import math

import numpy as np

from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.geometry.matrices import Vector

FINENESS = 100  # steps of float32 that a voxel's shortest side must have
NOWHERE_ELSE: Vector = (0.0, 0.0, 0.0)


def local_origin(geometry: Geometry) -> Vector:
    """What is taken off all places in the file: the volume's origin where that lies too far away, else nothing."""
    step = max(map(abs, geometry.origin)) * float(np.finfo(np.float32).eps)
    return NOWHERE_ELSE if step * FINENESS <= min(geometry.spacing) else geometry.origin


def origin_text(origin: Vector, spacing: Vector) -> str:
    """To a thousandth of a voxel."""
    digits = max(0, 3 - math.floor(math.log10(min(spacing))))
    return ", ".join(f"{place:.{digits}f}" for place in origin)
