"""What the render command takes on its command line, read into scenes and numbers."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import click
import msgspec

from volsplat.client.image.image_formats import DEPTHS
from volsplat.client.scene.presets import preset_scene
from volsplat.client.scene.scene_file import read_scene_file
from volsplat.client.scene.view_rotation import rotation_from_option
from volsplat.client.volume.surveyed_volume import SurveyedVolume
from volsplat.protocol.description.scene import LARGEST_EXTENT, Bounds, Order, Scene
from volsplat.protocol.geometry.upright import UPS, Up
from volsplat.protocol.text.errors import BadInput

up_option = click.option(
    "--up",
    type=click.Choice(UPS),
    help="The axis of the volume's space that is up (as its file tells, or by a guess; see volsplat info).",
)

Number = TypeVar("Number", int, float)


@dataclass(frozen=True)
class SceneOptions:
    """Where the scene comes from, and what the command line changes in it. None: not given."""

    scene: Path | None = None
    preset: str | None = None
    size: tuple[int, int] | None = None
    order: Order | None = None
    rotate: str | None = None
    up: Up | None = None
    zoom: float | None = None
    center: tuple[float, float, float] | None = None
    bounds: Bounds | None = None
    edges: bool | None = None

    def scene_of(self, volume: SurveyedVolume | None) -> Scene:
        """The scene to draw: preset or default, under the scene file, under the options. Raises BadInput.

        Without a volume the preset's own numbers stand in for what the data would decide: good for checking a
        scene file before anything is started.
        """
        return self._changed(self._under_options(volume))

    def key_scenes(self, volume: SurveyedVolume | None, keys: Sequence[Path]) -> list[Scene]:
        """As `scene_of`, with each of these scene files in its turn over the scene, and under the options."""
        under = self._under_options(volume)
        return [self._changed(_scene_in(key, under)) for key in keys]

    def _under_options(self, volume: SurveyedVolume | None) -> Scene:
        base = self._base(volume)
        return base if self.scene is None else _scene_in(self.scene, base)

    def _base(self, volume: SurveyedVolume | None) -> Scene:
        if volume is None:
            return preset_scene(self.preset or "ct-skin")
        if self.preset is None:
            return volume.default_scene()
        return preset_scene(self.preset, volume.subject())

    def _changed(self, scene: Scene) -> Scene:
        view, image = scene.view, scene.image
        try:
            if self.rotate is not None:
                view = msgspec.structs.replace(view, rotation=rotation_from_option(self.rotate))
            if self.up is not None:
                view = msgspec.structs.replace(view, up=self.up)
            if self.zoom is not None:
                view = msgspec.structs.replace(view, zoom=self.zoom)
            if self.center is not None:
                view = msgspec.structs.replace(view, center=self.center)
            if self.size is not None:
                image = msgspec.structs.replace(image, width=self.size[0], height=self.size[1])
            if self.edges is not None:
                image = msgspec.structs.replace(image, edges=self.edges)
        except ValueError as error:
            raise BadInput(str(error)) from error
        return msgspec.structs.replace(
            scene,
            view=view,
            image=image,
            bounds=self.bounds or scene.bounds,
            order=self.order or scene.order,
        )


def _scene_in(path: Path, base: Scene) -> Scene:
    """The scene of a TOML file over `base`, or the whole one that an image stores."""
    return _stored_scene(path) if path.suffix.lower() in DEPTHS else read_scene_file(path, base)


def _stored_scene(image: Path) -> Scene:
    from volsplat.client.image.image_file import read_scene  # takes time to import, which only this case needs

    return read_scene(image)


def size_from_option(text: str) -> tuple[int, int]:
    """Width and height from WxH. Raises BadInput."""
    match = re.fullmatch(r"(\d{1,5})x(\d{1,5})", text)
    if match is None or not all(1 <= int(number) <= LARGEST_EXTENT for number in match.groups()):
        raise BadInput(f"--size {text}: give WIDTHxHEIGHT in pixels, each 1 to {LARGEST_EXTENT}, as in 512x512")
    return int(match[1]), int(match[2])


def up_from_option(text: str | None) -> Up | None:
    """What --up, which is one of UPS, says."""
    return next((up for up in UPS if up == text), None)


def triple_from_option(option: str, text: str, kind: Callable[[str], Number]) -> tuple[Number, Number, Number]:
    """Three numbers from I,J,K. Raises BadInput."""
    try:
        i, j, k = (kind(part) for part in text.split(","))
    except ValueError as error:
        raise BadInput(f"{option} {text}: give three numbers I,J,K, as in 48,64,56") from error
    return i, j, k


def bounds_from_option(text: str) -> Bounds:
    """Half-open bounds from I0:I1,J0:J1,K0:K1; an empty side reaches to the volume's face. Raises BadInput."""
    match = re.fullmatch(r"(\d*):(\d*),(\d*):(\d*),(\d*):(\d*)", text)
    if match is None:
        raise BadInput(f"--bounds {text}: give LOW:HIGH for i, j and k, as in 0:48,:,10:100; HIGH is left out")
    low = [int(match[n] or 0) for n in (1, 3, 5)]
    high = [int(match[n] or -1) for n in (2, 4, 6)]
    return Bounds(low=(low[0], low[1], low[2]), high=(high[0], high[1], high[2]))
