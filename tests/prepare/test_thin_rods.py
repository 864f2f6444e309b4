"""Levels of thin rods: little but rim, of which a footprint mixes in what lies beside it before it is seen through."""

import math
from collections.abc import Iterator
from typing import NamedTuple

import pytest
import torch
from torch import Tensor

from support.files.silent_progress import Silent
from support.scenes.level_brightness import ALONG_AXES, AROUND, JUST_ABOVE
from tolerances import ROD_BRIGHTNESS, ROD_JUMP
from volsplat.client.phantoms.volume_writer import write_volume
from volsplat.client.scene.table_makers import colours, opacities
from volsplat.client.session.single import SingleProcess
from volsplat.mapshade_server.prepare import Options, prepare
from volsplat.mapshade_server.prepare.layout import Layout
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Image, Scene, Shading, View
from volsplat.protocol.description.shading_tables import Tables
from volsplat.protocol.description.view_rotation import rotation_from_angles
from volsplat.protocol.description.volume import Geometry

SIZE = 72
RODS, RADIUS = 50, 1.2  # voxels
OPACITY = opacities((0.25, 0.0), (0.45, 0.7), (0.8, 0.9))
TABLES = {
    "emitted": Tables(emit=colours((0.0, "#909090")), refl=colours((0.0, "#000000")), opac=OPACITY),
    "reflected": Tables(emit=colours((0.0, "#000000")), refl=colours((0.0, "#b0b0b0")), opac=OPACITY),
}


def rods() -> Tensor:
    """In all directions, brightest along their middles."""
    random = torch.Generator().manual_seed(0)
    through = torch.rand((RODS, 3), generator=random) * SIZE
    along = torch.nn.functional.normalize(torch.randn((RODS, 3), generator=random))
    axis = torch.arange(SIZE).float()
    voxels = torch.stack(torch.meshgrid(axis, axis, axis, indexing="ij"), -1)
    volume = torch.zeros((SIZE, SIZE, SIZE))
    for point, direction in zip(through, along, strict=True):
        offset = voxels - point
        squared = (offset**2).sum(-1) - (offset @ direction) ** 2
        volume = torch.maximum(volume, torch.exp(-squared / (2 * RADIUS**2)))
    return (250 * volume).to(torch.uint8)


class Drawn(NamedTuple):
    plain: SingleProcess
    levels: SingleProcess

    def light(self, of_levels: bool, tables: Tables, side: tuple[float, float], zoom: float) -> float:
        """All of a picture's."""
        pixels = math.ceil(AROUND * zoom * SIZE)
        scene = Scene(
            tables=tables,
            shading=Shading(modulation=False),
            view=View(rotation=rotation_from_angles(*side), zoom=zoom),
            image=Image(width=pixels, height=pixels),
        )
        renderer = self.levels if of_levels else self.plain
        return float(renderer.render(scene, Step.F)[..., :3].double().sum())


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Drawn]:
    folder = tmp_path_factory.mktemp("rods")
    volume, store = folder / "rods.nrrd", folder / "rods.zarr"
    write_volume(volume, rods(), Geometry((SIZE, SIZE, SIZE)))
    prepare(str(volume), store, Options(layout=Layout(coarsest=(SIZE // 4) ** 3)), Silent())
    with SingleProcess(volume) as plain, SingleProcess(store) as levels:
        yield Drawn(plain, levels)


@pytest.mark.parametrize("level", [1, 2])
@pytest.mark.parametrize("light", ["emitted", "reflected"])
def test_levels_of_thin_rods_are_as_bright_along_the_axes(level: int, light: str, drawn: Drawn) -> None:
    """Rays through single voxels, or through those of one of the level, would say up to 4 % too little or too much."""
    zoom = 0.5**level
    for side in ALONG_AXES:
        here, before = (drawn.light(True, TABLES[light], side, z) for z in (zoom, zoom * JUST_ABOVE))
        assert here == pytest.approx(before, rel=ROD_JUMP)
        assert here == pytest.approx(drawn.light(False, TABLES[light], side, zoom), rel=ROD_BRIGHTNESS)
