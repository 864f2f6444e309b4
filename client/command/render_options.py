"""What commands that draw take on their command line for the scene, read into scenes and numbers."""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property
from pathlib import Path
from typing import Any, NamedTuple, Self, TypeVar

import click
import msgspec

from volsplat.client.command.choices import Words
from volsplat.client.command.help_page import SCENE, headed
from volsplat.client.image.image_formats import SCENE_HOLDERS
from volsplat.client.scene.colour_maps import colormap, lit_and_glowing
from volsplat.client.scene.lit_from import lit_from
from volsplat.client.scene.presets import PRESETS, preset_scene
from volsplat.client.scene.scene_file import scene_file_bytes, scene_from_bytes, scene_from_toml
from volsplat.client.scene.suited import why_unsuited
from volsplat.client.volume.surveyed_volume import SurveyedVolume, asking_for_fit, showing_all
from volsplat.program.command_lines import PATH
from volsplat.program.plain_console import PlainConsole
from volsplat.protocol.description.colours import colour_from_text
from volsplat.protocol.description.refinement_steps import PaperStep
from volsplat.protocol.description.scene import LARGEST_EXTENT, Scene
from volsplat.protocol.description.scene_keys import KEYS
from volsplat.protocol.description.view_rotation import rotation_from_option
from volsplat.protocol.description.volume import LONGEST_AXIS, Index
from volsplat.protocol.geometry.upright import UPS
from volsplat.protocol.text.errors import BadInput

Command = TypeVar("Command", bound=Callable[..., Any])
Number = TypeVar("Number", int, float)
Layer = Callable[[Scene], Scene]  # puts a scene, or a part of one, over another


class SceneOption(NamedTuple):
    """An option that sets keys of the scene. `read` makes their values of its text; without it the key's type does."""

    keys: tuple[str, ...]
    help: str
    metavar: str | None = None
    read: Callable[[str], tuple[Any, ...]] | None = None
    choices: tuple[str, ...] | None = None  # if not all that the key allows


def _scene_option(flag: str) -> Callable[[Command], Command]:
    """The option as a decorator for a command that takes it, and gives it to `scene_changes`."""
    option = SCENE_OPTIONS[flag]
    key = KEYS[option.keys[0]]
    if key.declared.kind is bool:
        return click.option(f"{flag}/--no-{flag[2:]}", default=None, help=option.help)
    kind: click.ParamType[Any] | type = str
    if option.read is None:
        kind = click.FLOAT if float in key.declared.kinds else Words(option.choices or key.declared.words)
    return click.option(flag, type=kind, metavar=option.metavar, help=option.help)


def scene_changes(given: Mapping[str, Any]) -> dict[str, Any]:
    """What a command's scene options, by their names, change: values by the place of their key. Raises BadInput."""
    changes: dict[str, Any] = {}
    for flag, option in SCENE_OPTIONS.items():
        value = given.get(flag[2:])
        if value is not None and option.read is not None:
            changes |= zip(option.keys, option.read(value), strict=True)
        elif value is not None:
            (place,) = option.keys
            changes[place] = msgspec.convert(value, KEYS[place].declared.kind)
    return changes


@dataclass(frozen=True)
class SceneOptions:
    """Where the scene comes from, and what the command line changes in it: values by the place of their key."""

    scene: Path | None = None
    preset: str | None = None
    changes: Mapping[str, Any] = field(default_factory=dict)
    more: str = ""  # TOML: what --set changes besides
    fit: str | None = None  # all or visible: zoom and centre that the volume decides
    lit_from: PaperStep | None = None  # of presets and the default, in place of their own

    @classmethod
    def of(cls, given: Mapping[str, Any]) -> Self:
        """What `scene_options` gave a command. Raises BadInput."""
        changes, fit = scene_changes(given), given["fit"]
        if fit is not None and changes.keys() & FITTED:
            raise BadInput(f"--fit {fit} decides zoom and centre: leave out --zoom and --center, or --fit")
        return cls(given["scene"], given["preset"], changes, "".join(map(_line_of, given["put"])), fit)

    def scene_of(self, volume: SurveyedVolume | None) -> Scene:
        """The scene to draw: preset or default, under the scene file, under the options. Raises BadInput.

        Without a volume the preset's own numbers stand in for what the data would decide: good for checking a
        scene file before anything is started.
        """
        return self._over(volume, self.scene)

    def tell_unsuited(self, volume: SurveyedVolume, console: PlainConsole) -> None:
        """A line for a person whose preset does not suit the volume, or is not seen under the scene file."""
        if self.preset is not None and self._hides_preset(volume):
            console.say(f"note: {self.scene} decides all that --preset {self.preset} would; leave one of them out")
        elif self.preset is not None and (why := why_unsuited(self.preset, volume.subject())):
            console.say(f"note: {why}")

    def _hides_preset(self, volume: SurveyedVolume) -> bool:
        """Whether the scene file leaves nothing of the preset: it goes over it."""
        if self.scene is None:
            return False
        preset, default, over = volume.begun_scene(self.preset), volume.begun_scene(None), self._layer_of(self.scene)
        return preset != default and over(preset) == over(default)

    def key_scenes(self, volume: SurveyedVolume | None, keys: Sequence[Path]) -> list[Scene]:
        """As `scene_of`, with each of these scene files in its turn over the scene, and under the options."""
        return [self._over(volume, self.scene, key) for key in keys]

    def _over(self, volume: SurveyedVolume | None, *files: Path | None) -> Scene:
        """The preset or default under these files, the later over the earlier, and all under the options.

        Tables are made for the window that these leave; without a volume they are the preset's own.
        """
        layers = [self._layer_of(file) for file in files if file is not None]
        if volume is None:
            return self._changed(_under(layers, preset_scene(self.preset or "ct-skin")), None)
        begun = self._lit(volume.begun_scene(self.preset))
        scene = self._changed(_under(layers, begun), volume)
        if scene.quantise == begun.quantise:
            return scene
        return self._changed(_under(layers, self._lit(volume.begun_scene(self.preset, scene.quantise))), volume)

    @cached_property
    def _layer_of(self) -> Callable[[Path], Layer]:
        """Each file is read once: a pipe can be read no more often."""
        return cache(_layer)

    def _lit(self, scene: Scene) -> Scene:
        return scene if self.lit_from is None else lit_from(scene, self.lit_from)

    def _changed(self, scene: Scene, volume: SurveyedVolume | None) -> Scene:
        try:
            for place, value in self.changes.items():
                scene = KEYS[place].put(scene, value)
        except ValueError as error:
            raise BadInput(str(error)) from error
        if self.more:
            scene = scene_from_toml(self.more, scene, "--set")
        if self.fit == "all" and volume is not None:
            return showing_all(scene, volume.description.geometry)
        return scene if self.fit is None else asking_for_fit(scene)


def _under(layers: Sequence[Layer], base: Scene) -> Scene:
    """`base` with these over it, the later over the earlier."""
    for layer in layers:
        base = layer(base)
    return base


def _layer(path: Path) -> Layer:
    """The scene of a TOML file, or the whole one that an image stores. Raises BadInput, also where it is laid over."""
    if path.suffix.lower() in SCENE_HOLDERS:
        from volsplat.client.image.image_file import read_scene  # takes time to import, which only this case needs

        stored = read_scene(path)
        return lambda base: stored
    content = scene_file_bytes(path)
    return lambda base: scene_from_bytes(content, base, str(path))


def size_from_option(text: str) -> tuple[int, int]:
    """Width and height from WxH, or from one number for both. Raises BadInput."""
    match = re.fullmatch(r"(\d{1,5})(?:x(\d{1,5}))?", text)
    if match is None or not all(1 <= int(number) <= LARGEST_EXTENT for number in match.groups() if number):
        raise BadInput(
            f"--size {text}: give WIDTHxHEIGHT in pixels, each 1 to {LARGEST_EXTENT}, as in 640x480, or 512 for both; "
            "render and movie take a figure's in print, too, as in 8.5cm or 8.5x12cm"
        )
    return int(match[1]), int(match[2] or match[1])


def triple_from_option(option: str, text: str, kind: Callable[[str], Number]) -> tuple[Number, Number, Number]:
    """Three numbers from I,J,K. Raises BadInput."""
    try:
        i, j, k = (kind(part) for part in text.split(","))
    except ValueError as error:
        raise BadInput(f"{option} {text}: give three numbers I,J,K, as in 48,64,56") from error
    return i, j, k


def _bounds_from_option(text: str) -> tuple[Index, Index]:
    """Half-open bounds from I0:I1,J0:J1,K0:K1; an empty side reaches to the volume's face. Raises BadInput."""
    match = re.fullmatch(r"(\d*):(\d*),(\d*):(\d*),(\d*):(\d*)", text)
    if match is None:
        raise BadInput(
            f"--bounds {text}: give LOW:HIGH for i, j and k, whole numbers from 0, as in 0:48,:,10:100; voxel HIGH "
            "itself is not drawn"
        )
    if max(map(len, match.groups(""))) > len(str(LONGEST_AXIS)):
        raise BadInput(f"--bounds {text}: no volume is longer than {LONGEST_AXIS} voxels")
    low = [int(match[n] or 0) for n in (1, 3, 5)]
    high = [int(match[n] or -1) for n in (2, 4, 6)]
    return (low[0], low[1], low[2]), (high[0], high[1], high[2])


def _zoom_from_option(text: str) -> tuple[float | str]:
    """A number of pixels, or "fit". Raises BadInput."""
    try:
        return ("fit" if text.strip().lower() == "fit" else float(text),)
    except ValueError as error:
        raise BadInput(f"--zoom {text}: give pixels a voxel, as in 2.5, or fit") from error


def _window_from_option(text: str) -> tuple[tuple[float, float]]:
    """Raises BadInput."""
    try:
        low, high = map(float, text.split(","))
    except ValueError as error:
        raise BadInput(f"--window {text}: give LOW,HIGH in the volume's own units, as in -160,240") from error
    if not low < high:
        raise BadInput(f"--window {text}: LOW must be below HIGH, as in -160,240")
    return ((low, high),)


def _colour_from_option(text: str) -> tuple[Any, ...]:
    """Raises BadInput."""
    try:
        return (colour_from_text(text),)
    except ValueError as error:
        raise BadInput(f'--background {text}: write "#rrggbb" or a name of CSS, as in white') from error


def _map_from_option(name: str) -> tuple[Any, Any]:
    """The points of what glows and of what is lit. Raises BadInput."""
    both = lit_and_glowing(colormap(name))
    return both.emit.points, both.refl.points


def _line_of(text: str) -> str:
    """A line of TOML from KEY=VALUE, whose text needs no quotes. Raises BadInput."""
    place, found, value = (part.strip() for part in text.partition("="))
    if not found or not re.fullmatch(r"[a-z_]+(\.[a-z_]+)*", place):
        raise BadInput(
            f"--set {text}: give KEY=VALUE, as in shading.specular_power=20; docs/reference/scene.md lists the keys"
        )
    try:
        tomllib.loads(f"{place} = {value}")
    except tomllib.TOMLDecodeError:
        value = json.dumps(value, ensure_ascii=False)
    return f"{place} = {value}\n"


FITTED = {"view.zoom", "view.center"}

SCENE_OPTIONS = {
    "--size": SceneOption(
        ("image.width", "image.height"),
        "Image size in pixels (512x512); a printed figure's (render, movie) 8.5cm or 8.5x12cm.",
        "WxH",
        size_from_option,
    ),
    "--order": SceneOption(("order",), "Back-to-front or front-to-back (fastest)."),
    "--rotate": SceneOption(
        ("view.rotation",),
        "x,y,z,w or azimuth,elevation[,roll] or front, back, left, right, top…",
        "VIEW",
        lambda text: (rotation_from_option(text),),
    ),
    "--up": SceneOption(
        ("view.up",),
        "The axis of the volume's space that is up (as its file says, or by a guess; see volsplat info).",
        choices=UPS,
    ),
    "--zoom": SceneOption(
        ("view.zoom",), "Pixels a voxel; else what is visible fits the image.", "PIXELS", _zoom_from_option
    ),
    "--center": SceneOption(
        ("view.center",),
        "Grid point at the image's centre.",
        "I,J,K",
        lambda text: (triple_from_option("--center", text, float),),
    ),
    "--bounds": SceneOption(
        ("bounds.low", "bounds.high"), "Draw only this part of the grid.", "I0:I1,J0:J1,K0:K1", _bounds_from_option
    ),
    "--edges": SceneOption(("image.edges",), "Draw the volume's boundary as white edges."),
    "--background": SceneOption(
        ("image.background",), 'Colour: "#rrggbb" or a name of CSS.', "COLOUR", _colour_from_option
    ),
    "--window": SceneOption(
        ("quantise.window",),
        "Densities that the tables span, in the volume's own units (chosen from the data).",
        "LOW,HIGH",
        _window_from_option,
    ),
    "--colormap": SceneOption(
        ("tables.emit.points", "tables.refl.points"),
        "Colours by name: matplotlib's, cmasher's (cmr.NAME), colorcet's (cet_NAME).",
        "NAME",
        _map_from_option,
    ),
    "--kernel": SceneOption(("reconstruction.kernel",), "Shape of a voxel's footprint."),
}
"""The options that set keys of the scene."""

scene_options = headed(
    SCENE,
    click.option("--scene", type=PATH, help="Scene TOML, or an image that volsplat wrote."),
    click.option("--preset", type=Words(sorted(PRESETS)), help="Start from this scene."),
    *map(_scene_option, SCENE_OPTIONS),
    click.option(
        "--fit",
        type=Words(["all", "visible"]),
        help="Have the whole volume, or what is visible, fill the image, whatever the scene says.",
    ),
    click.option(
        "--set", "put", multiple=True, metavar="KEY=VALUE", help="Any key of the scene, as shading.specular_power=20."
    ),
)
"""For commands that draw a scene; what they are given `SceneOptions.of` reads."""
