"""The light of exported Gaussians, as it changes with the viewpoint: spherical harmonics, which viewers evaluate."""

from __future__ import annotations

import math
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from volsplat.protocol.description.scene import Scene, Step
from volsplat.protocol.rules.resolved_view import screen_rotation
from volsplat.protocol.rules.shading_rule import shading_rule

Light = Literal["viewer", "scene", "even"]
LIGHTS: tuple[Light, ...] = ("viewer", "scene", "even")
"""Anew for each viewpoint, as for the scene's view, or the same whichever way a voxel faces."""

HARMONIC = 0.28209479177387814  # of degree 0, and below of degrees 1 and 2
FIRST = 0.4886025119029199
SECOND = (1.0925484305920792, 0.31539156525252005, 0.5462742152960396)
BETWEEN = 30  # degrees between viewpoints that the harmonics are fitted to


def light_harmonics(voxels: Any, scene: Scene, light: Light) -> NDArray[np.float64]:
    """What multiplies the reflected colour: harmonics (codes, 1) or (codes, 9) by the code of a voxel's direction."""
    of_scene: NDArray[np.float64] = voxels.light(shading_rule(scene, Step.F).lighting).astype(np.float64)
    if light == "even":
        return np.ones((len(of_scene), 1)) / HARMONIC
    if light == "scene":
        as_it_is: NDArray[np.float64] = of_scene[:, None] / HARMONIC
        return as_it_is
    lit, towards, weights = [], [], []
    for elevation in range(-90 + BETWEEN // 2, 90, BETWEEN):
        for azimuth in range(0, 360, BETWEEN):
            seen = scene.with_(rotation=(azimuth, elevation))
            lit.append(voxels.light(shading_rule(seen, Step.F).lighting))
            towards.append(-np.array(screen_rotation(seen.view))[2])
            weights.append(math.sqrt(math.cos(math.radians(elevation))))
    weight = np.array(weights)[:, None]
    fitted: NDArray[np.float64] = (np.linalg.pinv(harmonics(np.array(towards)) * weight) @ (np.array(lit) * weight)).T
    return fitted


def harmonics(towards: NDArray[np.float64]) -> NDArray[np.float64]:
    """Those up to degree 2, (n, 9), ordered and signed as by Kerbl et al., of unit vectors (n, 3) from the eye."""
    x, y, z = towards.T
    a, b, c = SECOND
    second = (a * x * y, -a * y * z, b * (2 * z * z - x * x - y * y), -a * x * z, c * (x * x - y * y))
    return np.stack([np.full(len(x), HARMONIC), -FIRST * y, FIRST * z, -FIRST * x, *second], axis=-1)
