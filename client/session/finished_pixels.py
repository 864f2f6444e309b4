"""A finished image by a renderer that others draw with as well."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from volsplat.client.session.asked_frames import FrameGivenUp
from volsplat.client.session.renderer import Finisher
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Scene


def finished_pixels(
    renderer: Finisher, scene: Scene, step: Step, cancelled: Callable[[], bool]
) -> NDArray[np.float32] | None:
    """(H, W, 4), associated; asked for again if something else took its place. None once it is cancelled."""
    while not cancelled():
        try:
            return renderer.finish(scene, step).published.pixels
        except FrameGivenUp:
            continue
    return None
