"""How bright a uniform slab is from many sides: the optical depth of all its pixels is that of its voxels."""

from collections.abc import Sequence

import torch
from torch import Tensor

from volsplat.bench.quality.findings import Findings, Goal, Row, findings
from volsplat.bench.quality.lit_scenes import grey_scene
from volsplat.bench.quality.side_by_side import STEP_G, opened_values
from volsplat.bench.tables.progress import shown_progress
from volsplat.client.phantoms import make_phantom
from volsplat.client.scene.table_makers import scalars
from volsplat.protocol.description.scene import Quantise
from volsplat.protocol.description.shading_tables import TABLE_ENTRIES
from volsplat.protocol.description.view_rotation import Quaternion

OPACITY = 0.02  # at the greatest density: the slab lets light through from every side
ZOOM, SIDE = 2.3, 160
GOAL = 0.005
SEED = 3


def slab_findings(views: int, distances: Sequence[float]) -> Findings:
    """The spread of the slab's brightness over so many directions, and how far its mean is from the truth."""
    scene = grey_scene(scalars((0.0, 0.0), (1.0, OPACITY)), Quantise(window=(0.0, TABLE_ENTRIES - 1.0)))
    scene = scene.with_(zoom=ZOOM, size=SIDE)
    brightness: dict[str, list[float]] = {}
    values, geometry = make_phantom("slab")
    with opened_values(values, geometry) as opened:
        contenders = opened.contenders(scene, distances)
        with shown_progress("slab", views) as step:
            for rotation in directions(views):
                turned = opened.settled(scene.with_(rotation=rotation))
                for contender in contenders:
                    contender.draw(turned)
                    brightness.setdefault(contender.name, []).append(absorbed(contender.picture()))
                step()
    truth = ZOOM**2 * float(-torch.log1p(-values.double() / (TABLE_ENTRIES - 1) * OPACITY).sum())
    spread = {name: (max(found) - min(found)) / truth for name, found in brightness.items()}
    mean = {name: sum(found) / len(found) / truth for name, found in brightness.items()}
    rows = [
        Row("greatest less least", spread, Goal(f"G within {GOAL:g}", spread[STEP_G] <= GOAL)),
        Row("mean", mean),
    ]
    caption = (
        f"From {views} directions: the optical depth over the whole image, as a share of that of the phantom `slab`."
    )
    return findings("Uniform slab", "brightness", "", rows, caption)


def absorbed(picture: Tensor) -> float:
    """The optical depths of all pixels, added up."""
    return float(-torch.log1p(-picture[..., 3].double()).sum())


def directions(views: int) -> list[Quaternion]:
    """The same ones in every run, spread evenly by chance."""
    drawn = torch.randn((views, 4), generator=torch.Generator().manual_seed(SEED), dtype=torch.float64)
    return [(x, y, z, w) for x, y, z, w in drawn.tolist()]
