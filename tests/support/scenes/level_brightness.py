"""How bright the levels of a prepared volume are, and how far pictures jump where zooming out takes the next one.

Prints a table of docs/how_it_works/properties.md. Run it in tests/:
`python -m support.scenes.level_brightness VOLUME[:PRESET,PRESET]...`.
"""

import math
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import msgspec

from support.files.silent_progress import Silent
from volsplat.client.scene.presets import PRESETS, fits, preset_scene
from volsplat.client.session.single import SingleProcess
from volsplat.mapshade_server.prepare import Options, prepare
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Image, Scene
from volsplat.protocol.description.view_rotation import rotation_from_angles
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.rules.levels import thickness_of

# Azimuth and elevation.
ALONG_AXES = ((0.0, 0.0), (90.0, 0.0), (180.0, 0.0), (270.0, 0.0), (0.0, 90.0), (0.0, -90.0))
OBLIQUE = (
    *((35.0, 25.0), (35.0, -25.0), (145.0, 25.0), (215.0, -40.0)),
    *((305.0, 40.0), (60.0, -60.0), (250.0, 15.0), (10.0, 10.0)),
)
JUST_ABOVE = 1.0001  # of the zoom at which a level takes over: there the finer one is drawn
AROUND = 1.6  # of the longest side, so that nothing is cut


class Bright(NamedTuple):
    """Of a level's picture, mean over colours and over the pixels that are not empty in the volume's own picture."""

    of_volume: float  # divided by that of the volume itself at the same zoom
    jump: float  # from the finer level's picture, in 1/255


def measured(preset: str, level: int, side: tuple[float, float], plain: SingleProcess, levels: SingleProcess) -> Bright:
    scene = preset_scene(preset, plain.volume.subject())
    grids = levels_of(levels)
    zoom = 1.0 / thickness_of(grids[0], grids[level])
    pixels = math.ceil(AROUND * zoom * max(plain.volume.description.geometry.dims))

    def at(zoom: float) -> Scene:
        view = msgspec.structs.replace(scene.view, rotation=rotation_from_angles(*side), zoom=zoom)
        return msgspec.structs.replace(scene, view=view, image=Image(width=pixels, height=pixels))

    own, here, finer = (
        renderer.render(at(z), Step.F).double()
        for renderer, z in ((plain, zoom), (levels, zoom), (levels, zoom * JUST_ABOVE))
    )
    there = own[..., 3] > 0
    bright, volume, before = (float(image[there][:, :3].mean()) for image in (here, own, finer))
    return Bright(bright / volume, 255 * (bright - before))


def row(preset: str, plain: SingleProcess, levels: SingleProcess) -> str:
    cells = []
    for level in range(1, len(levels_of(levels))):
        for sides in (ALONG_AXES, OBLIQUE):
            by_side = [measured(preset, level, side, plain, levels) for side in sides]
            least, greatest = (end(bright.of_volume for bright in by_side) for end in (min, max))
            cells.append(f"{least:.2f} to {greatest:.2f}")
            cells.append(f"{max((bright.jump for bright in by_side), key=abs):+.1f}")
    return " | ".join(cells)


def levels_of(renderer: SingleProcess) -> tuple[Geometry, ...]:
    prepared = renderer.volume.prepared
    assert prepared is not None
    return prepared.levels


def print_rows(volume: str, presets: Sequence[str]) -> None:
    """Of these presets, or of those that fit if there are none."""
    with tempfile.TemporaryDirectory() as folder, SingleProcess(volume) as plain:
        store = Path(folder) / "levels.zarr"
        prepare(volume, store, Options(), Silent())
        with SingleProcess(store) as levels:
            if len(levels_of(levels)) == 1:
                print(f"| {Path(volume).name} | has no levels beside the volume itself |")
                return
            for preset in presets or [name for name in PRESETS if fits(name, plain.volume.subject())]:
                print(f"| {Path(volume).name} | `{preset}` | {row(preset, plain, levels)} |", flush=True)


def main(volumes: list[str]) -> None:
    """Each may be followed by a colon and presets, with commas between them."""
    print(
        "| volume | preset | level 1, along the axes | jump from 0 | obliquely | jump | level 2, along the axes | … |"
    )
    print("|---|---|---|---|---|---|---|---|")
    for volume in volumes:
        name, _, presets = volume.partition(":")
        print_rows(name, presets.split(",") if presets else [])


if __name__ == "__main__":
    main(sys.argv[1:])
