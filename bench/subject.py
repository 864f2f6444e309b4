"""What a benchmark draws: a volume, given or made, and the scene that it is shown with."""

import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self, TypeVar

import click
import msgspec

from volsplat.bench.tables.scene_tables import TableName, benchmark_scene
from volsplat.client.command.choices import Words
from volsplat.client.command.render_options import SceneOptions
from volsplat.client.phantoms import PHANTOMS
from volsplat.client.scene.presets import PRESETS
from volsplat.client.session.renderer import Renderer
from volsplat.client.volume.surveyed_volume import SurveyedVolume
from volsplat.program.command_lines import PATH
from volsplat.protocol.description.scene import Order, Scene
from volsplat.protocol.description.volume import Index
from volsplat.protocol.description.volume_name import check_is_there
from volsplat.protocol.text.errors import BadInput

Command = TypeVar("Command", bound=Callable[..., Any])


@dataclass(frozen=True)
class Phantom:
    name: str
    size: Index


@dataclass(frozen=True)
class Subject:
    """As the command line gives it."""

    volume: str | None
    phantom: Phantom | None
    tables: TableName
    options: SceneOptions

    @classmethod
    def of(cls, given: Mapping[str, Any], here: bool = True) -> Self:
        """What a command was given for `subject_options`, whichever of them it has.

        Raises BadInput, also if the volume should be `here` and is not.
        """
        volume, phantom, tables = (given.get(name) for name in ("volume", "phantom", "tables"))
        options = SceneOptions(scene=given.get("scene"), preset=given.get("preset"))
        has_scene = options.scene is not None or options.preset is not None
        if (volume is None) == (phantom is None):
            raise BadInput("give a VOLUME, or --phantom NAME:SIZE in its place")
        if volume is not None and here:
            check_is_there(volume)
        if tables not in (None, TableName.PRESET) and has_scene:
            raise BadInput(f"--tables {tables} is a scene of its own; leave out --scene and --preset")
        made = None if phantom is None else phantom_of(phantom)
        usual = TableName.SHELLS if made is not None and made.name == "shells" and not has_scene else TableName.PRESET
        options.scene_of(None)  # a bad scene file is reported before anything is started
        return cls(volume, made, TableName(tables) if tables else usual, options)

    def scene_of(self, volume: SurveyedVolume) -> Scene:
        """Raises BadInput."""
        if self.tables != TableName.PRESET:
            return benchmark_scene(self.tables, volume.density_histogram())
        return self.options.scene_of(volume)


def subject_options(command: Command) -> Command:
    """VOLUME, --phantom, --tables, --scene and --preset; what they give `Subject.of` reads."""
    for option in (
        click.option("--preset", type=Words(sorted(PRESETS)), help="Show it with this scene."),
        click.option("--scene", type=PATH, help="Show it with this scene TOML."),
        click.option(
            "--tables",
            type=Words(TableName),
            help="Tables of the benchmarks (shells for the phantom; else what --preset, --scene or the data choose).",
        ),
        click.option(
            "--phantom", metavar="NAME:SIZE", help="In place of VOLUME: shells:256 is 256 x 256 x 256 voxels."
        ),
        click.argument("volume", required=False),
    ):
        command = option(command)
    return command


def phantom_of(text: str) -> Phantom:
    """NAME:SIZE, as in shells:256. Raises BadInput."""
    name, _, size = text.partition(":")
    sides = size.split("x") if "x" in size else [size] * 3
    if name not in PHANTOMS or len(sides) != 3 or not all(side.isdecimal() and 0 < int(side) < 5000 for side in sides):
        raise BadInput(f"--phantom {text}: give NAME:SIZE as in shells:256; names are {', '.join(sorted(PHANTOMS))}")
    return Phantom(name, (int(sides[0]), int(sides[1]), int(sides[2])))


@contextmanager
def volume_file(subject: Subject, say: Callable[[str], None]) -> Iterator[str]:
    """The path of the volume; a phantom is made and written for as long as it is needed."""
    if subject.phantom is None:
        assert subject.volume is not None
        yield subject.volume
        return
    from volsplat.client.phantoms import make_phantom
    from volsplat.client.phantoms.volume_writer import write_volume

    with tempfile.TemporaryDirectory(prefix="volsplat-bench-") as folder:
        say(f"making the phantom {subject.phantom.name}")
        path = Path(folder) / f"{subject.phantom.name}-{'x'.join(map(str, subject.phantom.size))}.nrrd"
        write_volume(path, *make_phantom(subject.phantom.name, size=subject.phantom.size))
        yield str(path)


@dataclass(frozen=True)
class Shares:
    """Of a volume's voxels, in one view: those that are not transparent, and how many of these change no pixel."""

    visible: float
    hidden: float  # of the visible ones

    def __str__(self) -> str:
        return f"{self.visible:.1%} of the voxels are visible, {self.hidden:.0%} of these hidden"


def shares(renderer: Renderer, scene: Scene) -> Shares:
    """Counted by drawing: back to front every visible sample is sent, front to back the hidden ones are reported."""
    voxels = renderer.volume.description.geometry.box.voxels
    sent = {}
    for order in (Order.BACK_TO_FRONT, Order.FRONT_TO_BACK):
        outcome = renderer.finish(msgspec.structs.replace(scene, order=order)).outcome
        assert outcome is not None
        sent[order] = sum(splat.packets - splat.hidden_packets for splat in outcome.servers.splat.values())
    visible = sent[Order.BACK_TO_FRONT]
    return Shares(visible / voxels, 1 - sent[Order.FRONT_TO_BACK] / visible if visible else 0.0)


def volume_words(volume: SurveyedVolume) -> str:
    i, j, k = volume.description.geometry.dims
    return f"{volume.description.name}, {i} x {j} x {k} voxels, {volume.description.scalar_type}"
