"""The front door: what `import volsplat` offers to scripts and notebooks, each name imported when it is asked for.

import volsplat as vs

vs.plot("head.nrrd")
vs.render(array, rotation="front").save("front.png")
"""

import concurrent.futures.thread  # noqa: F401  what torch and zarr import, too: no thread can once the main one has ended
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from volsplat.client.figure.figure import Figure as Figure
    from volsplat.client.memory.array_volume import OrientationUnknown as OrientationUnknown
    from volsplat.client.memory.array_volume import Volume as Volume
    from volsplat.client.scene.colour_maps import colormap as colormap
    from volsplat.client.scene.presets import PRESETS as presets
    from volsplat.client.script.plotting import EmptyImage as EmptyImage
    from volsplat.client.script.plotting import MissingLabel as MissingLabel
    from volsplat.client.script.plotting import UnsuitedPreset as UnsuitedPreset
    from volsplat.client.script.plotting import VolumeNote as VolumeNote
    from volsplat.client.script.plotting import export as export
    from volsplat.client.script.plotting import plot as plot
    from volsplat.client.script.plotting import render as render
    from volsplat.client.script.plotting import view as view
    from volsplat.client.script.rendered_image import RenderedFigure as RenderedFigure
    from volsplat.client.script.rendered_image import RenderedImage as RenderedImage
    from volsplat.client.session.asked_frames import FrameGivenUp as FrameGivenUp
    from volsplat.client.session.session import Session as Session
    from volsplat.client.session.session import Session as open
    from volsplat.protocol.description.refinement_steps import Step as Step
    from volsplat.protocol.description.scene import Scene as Scene
    from volsplat.protocol.text.errors import BadInput as BadInput
    from volsplat.protocol.text.errors import VolsplatError as VolsplatError

    __version__: str

_ROOMS = {
    "BadInput": "volsplat.protocol.text.errors",
    "EmptyImage": "volsplat.client.script.plotting",
    "Figure": "volsplat.client.figure.figure",
    "FrameGivenUp": "volsplat.client.session.asked_frames",
    "MissingLabel": "volsplat.client.script.plotting",
    "OrientationUnknown": "volsplat.client.memory.array_volume",
    "RenderedFigure": "volsplat.client.script.rendered_image",
    "RenderedImage": "volsplat.client.script.rendered_image",
    "Scene": "volsplat.protocol.description.scene",
    "Session": "volsplat.client.session.session",
    "Step": "volsplat.protocol.description.refinement_steps",
    "UnsuitedPreset": "volsplat.client.script.plotting",
    "Volume": "volsplat.client.memory.array_volume",
    "VolsplatError": "volsplat.protocol.text.errors",
    "VolumeNote": "volsplat.client.script.plotting",
    "colormap": "volsplat.client.scene.colour_maps",
    "export": "volsplat.client.script.plotting",
    "open": "volsplat.client.session.session",
    "plot": "volsplat.client.script.plotting",
    "presets": "volsplat.client.scene.presets",
    "render": "volsplat.client.script.plotting",
    "view": "volsplat.client.script.plotting",
}
_OTHERWISE = {"open": "Session", "presets": "PRESETS"}  # as they are called at home

__all__ = [
    "__version__",
    "BadInput",
    "EmptyImage",
    "Figure",
    "FrameGivenUp",
    "MissingLabel",
    "OrientationUnknown",
    "RenderedFigure",
    "RenderedImage",
    "Scene",
    "Session",
    "Step",
    "UnsuitedPreset",
    "VolsplatError",
    "Volume",
    "VolumeNote",
    "colormap",
    "export",
    "open",
    "plot",
    "presets",
    "render",
    "view",
]


if not TYPE_CHECKING:  # to checkers it would give any name whatever, misspelt ones included

    def __getattr__(name: str) -> object:
        if name == "__version__":
            from importlib.metadata import version

            return version("volsplat")
        if name not in _ROOMS:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        from importlib import import_module

        return getattr(import_module(_ROOMS[name]), _OTHERWISE.get(name, name))


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
