"""Smooth blobs on a small grid, in scenes on which the precision of pictures is measured."""

import math

import msgspec
import torch
from torch import Tensor

from support.scenes.phantoms import shaded_scene
from volsplat.protocol.description.scene import Kernel, Reconstruction, Scene, View
from volsplat.protocol.description.shading_tables import ScalarTable

SIZE, PIXELS = 32, 72
EIGHTH = math.pi / 8
VIEWS = {
    "oblique": (0.1, 0.2, 0.3, 0.9),
    "from the front": (0.0, 0.0, 0.0, 1.0),
    "from a side": (0.5, 0.5, 0.5, 0.5),
    "rolled by 45 degrees": (0.0, 0.0, math.sin(EIGHTH), math.cos(EIGHTH)),
    "nearly from the front": (0.002, 0.001, 0.0, 1.0),
}
TABLES = {
    "thin": ((0.0, 0.0), (0.2, 0.0), (0.3, 0.5), (0.4, 0.0), (1.0, 0.0)),
    "solid": ((0.0, 0.0), (0.2, 0.0), (0.35, 1.0), (1.0, 1.0)),
}


def blobs(seed: int) -> Tensor:
    """Smooth, 0..255, (SIZE, SIZE, SIZE) float64."""
    chance = torch.Generator().manual_seed(seed)
    places = torch.stack(torch.meshgrid(*(torch.linspace(-1, 1, SIZE, dtype=torch.float64),) * 3, indexing="ij"), dim=3)
    values = torch.zeros((SIZE, SIZE, SIZE), dtype=torch.float64)
    for _ in range(4):
        middle = torch.rand(3, generator=chance, dtype=torch.float64) - 0.5
        width = 0.15 + 0.25 * float(torch.rand(1, generator=chance))
        values += 200 * torch.exp(-((places - middle) ** 2).sum(dim=3) / (2 * width * width))
    return values.clamp(0, 255)


def scene_of(view: str, zoom: float, table: str, kernel: Kernel) -> Scene:
    scene = shaded_scene(View(rotation=VIEWS[view], zoom=zoom), (PIXELS, PIXELS))
    tables = msgspec.structs.replace(scene.tables, opac=ScalarTable(points=TABLES[table]))
    return msgspec.structs.replace(scene, tables=tables, reconstruction=Reconstruction(kernel=kernel))
