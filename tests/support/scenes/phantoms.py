"""Small volumes that tests render, and a scene that shows them with every part of the shader at work."""

import torch
from torch import Tensor

from volsplat.protocol.description.scene import Image, Light, Order, Scene, View
from volsplat.protocol.description.shading_tables import ColourTable, CrossBar, Field, ScalarTable, Tables
from volsplat.protocol.rules.index_rules import Quantisation

# Densities are bytes already; the strength suits edges as steep as those of `shells`.
QUANTISATION = Quantisation(window=(0.0, 255.0), strength_scale=8.0)


def shells(size: int, seed: int = 0) -> Tensor:
    """Two nested, lopsided shells with soft edges and mild noise: values 0..255, (size, size, size) float64.

    No turn or mirror leaves it as it is.
    """
    k, j, i = torch.meshgrid(*(torch.linspace(-1, 1, size, dtype=torch.float64),) * 3, indexing="ij")
    distance = (1.2 * (i - 0.05) ** 2 + 1.7 * (j + 0.1) ** 2 + 2.2 * (k - 0.15) ** 2 + 0.4 * i * j - 0.3 * j * k).sqrt()
    softness = 2.5 / size
    outer = torch.sigmoid((0.85 - distance) / softness) - torch.sigmoid((0.65 - distance) / softness)
    inner = torch.sigmoid((0.4 - distance) / softness)
    noise = torch.rand(distance.shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    values = 110 * outer + 200 * inner * (1 + 0.2 * i) + 12 * noise
    return values.clamp(0, 255)


def shaded_scene(view: View, size: tuple[int, int], order: Order = Order.BACK_TO_FRONT) -> Scene:
    """Thin orange shells around a blue-white core, lit, modulated by strength; noise is transparent."""
    return Scene(
        tables=Tables(
            emit=ColourTable(points=((0.0, (0.31, 0.11, 0.0)), (0.6, (0.51, 0.21, 0.11)), (1.0, (0.23, 0.31, 0.61)))),
            refl=ColourTable(points=((0.0, (0.9, 0.5, 0.3)), (0.6, (0.8, 0.6, 0.4)), (1.0, (0.6, 0.7, 0.9)))),
            opac=ScalarTable(points=((0.0, 0.0), (0.08, 0.0), (0.4, 0.2), (0.7, 0.5), (1.0, 1.0))),
            modu=ScalarTable(points=((0.0, 0.3), (1.0, 1.0))),
        ),
        cross_bar=CrossBar(modu=Field.STRENGTH),
        light=Light(direction=(0.4, 0.6, 0.8)),
        view=view,
        order=order,
        image=Image(width=size[0], height=size[1]),
    )
