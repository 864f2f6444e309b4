"""The screen from first principles, for tests of known pictures: where rays meet a grid, and how far they run in it."""

import torch
from torch import Tensor

from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.geometry.matrices import IDENTITY, Matrix
from volsplat.protocol.rules.resolved_view import screen_rotation

MATRICES: dict[str, Matrix] = {
    "cubic": IDENTITY,
    "anisotropic": ((1.0, 0.0, 0.0), (0.0, 2.0, 0.0), (0.0, 0.0, 3.0)),
    "five-to-one": ((0.4, 0.0, 0.0), (0.0, 0.4, 0.0), (0.0, 0.0, 2.0)),
    "tilted-gantry": ((1.0, 0.0, 0.0), (0.0, 1.0, -0.9), (0.0, 0.0, 2.2)),
    "skewed-and-mirrored": ((-1.0, 0.3, 0.2), (0.1, 1.2, -0.4), (0.0, 0.2, 1.1)),
}
OBLIQUE = (0.21, -0.33, 0.47, 0.79)
SQUARE = (0.0, 0.0, 0.0, 1.0)


def pixels_per_index(geometry: Geometry, scene: Scene) -> Tensor:
    """(3, 3) float64: columns are a step of i, j, k in pixels, x right, y DOWN, z to the viewer."""
    matrix = torch.tensor(geometry.index_to_physical, dtype=torch.float64)
    rotation = torch.tensor(screen_rotation(scene.view), dtype=torch.float64)
    zoom = scene.view.zoom
    assert zoom != "fit"
    upright = rotation @ matrix * (zoom / float(torch.linalg.det(matrix).abs()) ** (1 / 3))
    upside_down: Tensor = upright * torch.tensor([[1.0], [-1.0], [1.0]], dtype=torch.float64)
    return upside_down


def pixel_offsets(scene: Scene) -> tuple[Tensor, Tensor]:
    """x and y (H, W) of the pixel centres from the image's centre."""
    height, width = scene.image.height, scene.image.width
    y, x = torch.meshgrid(torch.arange(height).double(), torch.arange(width).double(), indexing="ij")
    return x - (width - 1) / 2, y - (height - 1) / 2


def rays(geometry: Geometry, scene: Scene) -> tuple[Tensor, Tensor]:
    """Grid points (H, W, 3) in the plane of the screen's centre, and what a pixel of depth adds to i, j, k (3,)."""
    back = torch.linalg.inv(pixels_per_index(geometry, scene))
    x, y = pixel_offsets(scene)
    middle = (torch.tensor(geometry.dims).double() - 1) / 2
    start: Tensor = middle + torch.stack((x, y, torch.zeros_like(x)), dim=-1) @ back.T
    return start, back[:, 2]


def crossing(geometry: Geometry, scene: Scene, margin: float) -> tuple[Tensor, Tensor]:
    """Pixels (H, W) whose rays enter and leave through two opposite faces, and their path in reference spacings.

    They stay `margin` voxels away from the other faces, and from their ends for `margin` voxels beyond the two.
    """
    start, ray = rays(geometry, scene)
    sizes = torch.tensor(geometry.dims).double()
    clear = torch.zeros(start.shape[:2], dtype=torch.bool)
    path = torch.zeros(start.shape[:2], dtype=torch.float64)
    zoom = scene.view.zoom
    assert zoom != "fit"
    for axis in range(3):
        if abs(ray[axis]) < 1e-9:
            continue
        inside = torch.ones_like(clear)
        for face in (-0.5 - margin, float(sizes[axis]) - 0.5 + margin):
            point = start + ((face - start[..., axis]) / ray[axis])[..., None] * ray
            for other in {0, 1, 2} - {axis}:
                inside &= (point[..., other] > margin - 0.5) & (point[..., other] < sizes[other] - 0.5 - margin)
        clear |= inside
        path = torch.where(inside, sizes[axis] / ray[axis].abs() / zoom, path)
    return clear, path


def constant(dims: tuple[int, int, int], value: float = 255.0) -> Tensor:
    return torch.full((dims[2], dims[1], dims[0]), value, dtype=torch.float64)
