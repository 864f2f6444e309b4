"""Which part of a picture's error each rounding has: switched on one by one in the reference.

Prints a table of docs/how_it_works/properties.md. Run it in tests/: `python -m support.scenes.error_sources`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from unittest.mock import patch

import msgspec
import torch
from torch import Tensor

from reference import combining, mapping, render, voxel_packets
from reference.footprint import footprint_of
from reference.render import EXACT, Rounding
from support.scenes.blobs import SIZE, blobs, scene_of
from support.scenes.phantoms import QUANTISATION
from support.scenes.rendering import TableWeights, rendered
from tolerances import ONE_LEVEL
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Kernel, Order, Reconstruction, Scene
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.rules.frame_plan import plan_frame

GEOMETRY = Geometry((SIZE,) * 3, ((1.28, 0.0, 0.0), (0.0, 1.28, 0.0), (0.0, 0.0, 0.6)))
VIEWS = ("oblique", "from the front", "rolled by 45 degrees")
ZOOMS = (1.73, 4.3)
WIDER = 3.0  # voxels, for a kernel that is cut further out
SEED = 1
PLACES = 128  # in a cell of a sheet's lattice, on each side
AROUND = torch.cartesian_prod(torch.arange(-6, 7), torch.arange(-6, 7)).double()  # rows and samples that may reach it


class EvenWeights:
    """Weights that add up to the same in every pixel, sheet by sheet: those of the kernel, divided by their sum."""

    def __init__(self, scene: Scene, geometry: Geometry) -> None:
        zoom = scene.view.zoom
        assert zoom != "fit"
        down = mapping.steps_on_screen(scene, geometry) * torch.tensor([[1.0], [-1.0], [1.0]])
        self._footprint = footprint_of(mapping.steps_on_screen(scene, geometry), zoom, 1, scene.reconstruction)
        _, row, sample = plan_frame(scene, geometry, Step.F).traversal.axes
        lattice = down[:2, [row, sample]]
        self._back = torch.linalg.inv(lattice)
        side = torch.arange(PLACES) / PLACES
        places = torch.cartesian_prod(side, side).double()
        apart = (places[:, None] - AROUND) @ lattice.T
        sums = self._footprint.weights(*apart.unbind(-1)).sum(dim=1)
        self._to_even = (sums.mean() / sums).reshape(PLACES, PLACES)

    def __call__(self, samples: mapping.Samples, pixel_x: Tensor, pixel_y: Tensor) -> Tensor:
        dx = (pixel_x - samples.exact[:, :1])[:, None, :]
        dy = (pixel_y - samples.exact[:, 1:])[:, :, None]
        row, sample = (((one * dx + other * dy) * PLACES).round().long() % PLACES for one, other in self._back.tolist())
        return self._footprint.weights(dx, dy) * self._to_even[row, sample]


def shared_exactly(weight: Tensor, opacity: Tensor) -> Tensor:
    """1 - (1 - A)^w in place of the paper's w A."""
    return -torch.expm1(weight * torch.log1p(-opacity))


@dataclass(frozen=True)
class Situation:
    """A scene, with its picture of which nothing but the voxel packets is rounded."""

    packets: Tensor
    values: Tensor
    scene: Scene
    exact: Tensor

    def drawn(self, rounding: Rounding = EXACT, table: bool = False, scene: Scene | None = None) -> Tensor:
        """As the reference draws it with some roundings."""
        scene = scene or self.scene
        weights = TableWeights(scene, GEOMETRY, Step.F) if table else None
        return render.render(self.packets, GEOMETRY, QUANTISATION, scene, Step.F, True, weights, rounding)

    def shared_exactly(self) -> Tensor:
        with patch.object(combining, "weighted", shared_exactly):
            return self.drawn()

    def evenly(self) -> Tensor:
        weights = EvenWeights(self.scene, GEOMETRY)
        return render.render(self.packets, GEOMETRY, QUANTISATION, self.scene, Step.F, True, weights, EXACT)

    def with_reconstruction(self, reconstruction: Reconstruction) -> Scene:
        return msgspec.structs.replace(self.scene, reconstruction=reconstruction)

    def in_order(self, order: Order) -> Tensor:
        """Only front to back freezes pixels."""
        return self.drawn(scene=msgspec.structs.replace(self.scene, order=order))


# What is drawn, and from what it differs by one source of errors alone
SOURCES: dict[str, Callable[[Situation], tuple[Tensor, Tensor]]] = {
    "positions of 1/64 pixel": lambda on: (on.drawn(Rounding(positions=True)), on.exact),
    "the table's offsets and positions": lambda on: (on.drawn(Rounding(positions=True), table=True), on.exact),
    "the same, `precise`": lambda on: (
        on.drawn(Rounding(positions=True), True, on.with_reconstruction(Reconstruction(precise=True))),
        on.exact,
    ),
    "8-bit colours": lambda on: (on.drawn(Rounding(colours=True)), on.exact),
    "12-bit opacities": lambda on: (on.drawn(Rounding(opacities=True)), on.exact),
    "frozen pixels": lambda on: (on.in_order(Order.FRONT_TO_BACK), on.in_order(Order.BACK_TO_FRONT)),
    "the program": lambda on: (rendered(on.values, GEOMETRY, on.scene, Step.F).double(), on.exact),
    "the Gaussian's ripple: sums of weights that are not normalised": lambda on: (on.exact, on.evenly()),
    "w A for 1 - (1 - A)^w": lambda on: (on.exact, on.shared_exactly()),
    "the Gaussian's cut, at 2 for 3 voxels": lambda on: (
        on.exact,
        on.drawn(scene=on.with_reconstruction(Reconstruction(radius=WIDER))),
    ),
}


def situations(view: str) -> list[Situation]:
    values = blobs(SEED)
    packets = voxel_packets.pack(values, GEOMETRY, QUANTISATION)
    made = []
    for zoom in ZOOMS:
        scene = scene_of(view, zoom, "thin", Kernel.GAUSSIAN)
        exact = render.render(packets, GEOMETRY, QUANTISATION, scene, Step.F, exact=True)
        made.append(Situation(packets, values, scene, exact))
    return made


def worst(source: str, some: list[Situation]) -> str:
    """The greatest share of pixels that are off by more than 1/255, and the greatest error."""
    errors = [(one - other).abs().amax(dim=2) for one, other in map(SOURCES[source], some)]
    share = max(float((off > ONE_LEVEL).double().mean()) for off in errors)
    return f"{100 * share:.2f} %, {255 * max(float(off.max()) for off in errors):.2f}"


def main() -> None:
    print("| source |", " | ".join(VIEWS), "|")
    print("|---|" + "---|" * len(VIEWS))
    by_view = [situations(view) for view in VIEWS]
    for source in SOURCES:
        print("|", source, "|", " | ".join(worst(source, some) for some in by_view), "|", flush=True)


if __name__ == "__main__":
    main()
