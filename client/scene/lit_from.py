"""From which step on a scene is lit that somebody watches being drawn, and that nobody has set."""

import msgspec

from volsplat.protocol.description.refinement_steps import PaperStep
from volsplat.protocol.description.scene import Scene

WATCHED_FROM = PaperStep.C  # shading by tables costs nothing, so that a person need not wait for light until E


def lit_from(scene: Scene, step: PaperStep = WATCHED_FROM) -> Scene:
    """The scene with light from this step on."""
    return msgspec.structs.replace(scene, refine=msgspec.structs.replace(scene.refine, lit_from=step))
