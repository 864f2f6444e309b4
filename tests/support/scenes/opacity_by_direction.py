"""How far a slab of voxels is equally opaque from every side: thick opacities, and unequal spacings.

Prints the tables of docs/how_it_works/properties.md. Run it in tests/: `python -m support.scenes.opacity_by_direction`.
"""

import itertools
import math

import torch

from support.scenes.arbitrary import directions, plain_scene, quaternion_to
from support.scenes.rays import constant, crossing
from support.scenes.rendering import rendered
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import View
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.geometry.matrices import Matrix

OPACITIES = (0.001, 0.01, 0.05, 0.1, 0.2, 0.5)
RATIOS = (1, 2, 5, 8, 12)
SIDES = directions(20)
REFERENCE_SPACINGS = 10  # of the slab's thickness


def path_per_opacity(geometry: Geometry, toward: tuple[float, float, float], opacity: float, step: Step) -> list[float]:
    """What the picture makes of the path, divided by the path: the optical depth's ratio, over all clear pixels."""
    scene = plain_scene(opacity, view=View(rotation=quaternion_to(toward), zoom=2.0), size=(40, 40))
    clear, path = crossing(geometry, scene, margin=2.0)
    alpha = rendered(constant(geometry.dims), geometry, scene, step)[..., 3].double()
    clear &= alpha < 0.999
    depth = torch.log1p(-alpha) / math.log1p(-opacity)
    return [float(ratio) for ratio in (depth / path)[clear]]


def spread(geometry: Geometry, opacity: float, step: Step) -> str:
    by_side = [path_per_opacity(geometry, toward, opacity, step) for toward in SIDES]
    ratios = list(itertools.chain.from_iterable(by_side))
    seen = sum(1 for side in by_side if side)
    return f"{min(ratios):.3f} to {max(ratios):.3f} ({seen} sides)" if ratios else "opaque"


def slab(ratio: float) -> Geometry:
    """A slab ten reference spacings thick, its slices `ratio` times as far apart as its voxels."""
    matrix: Matrix = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, float(ratio)))
    reference_spacing = ratio ** (1 / 3)
    layers = max(round(REFERENCE_SPACINGS * reference_spacing / ratio), 3)
    across = round(8 * layers * ratio + 40)
    return Geometry((across, across, layers), matrix)


def main() -> None:
    print("| opacity of a voxel | with footprints (D to F) | nearest pixel (C) |")
    print("|---|---|---|")
    for opacity in OPACITIES:
        print(f"| {opacity} | {spread(slab(1), opacity, Step.D)} | {spread(slab(1), opacity, Step.C)} |", flush=True)
    print()
    print("| spacing of slices | with footprints (D to F), opacity 0.005 | opacity 0.1 |")
    print("|---|---|---|")
    for ratio in RATIOS:
        print(f"| {ratio}:1 | {spread(slab(ratio), 0.005, Step.D)} | {spread(slab(ratio), 0.1, Step.D)} |", flush=True)


if __name__ == "__main__":
    main()
