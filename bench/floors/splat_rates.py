"""Splats a second on one core, beside a bare loop over the same pixels, measured in turns."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import Enum

import torch
from torch import Tensor

from volsplat.bench import _kernels as floors
from volsplat.bench.floors.cpu_paths import kernels_on
from volsplat.bench.timing import interleaved, ratios, thread_seconds
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import TRAVERSAL_ORDERS, Image, Order, Scene, View
from volsplat.protocol.description.shading_tables import ColourTable, ScalarTable, Tables
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.rules.footprint_shape import footprint_shape
from volsplat.protocol.rules.frame_plan import FramePlan, plan_frame
from volsplat.protocol.rules.grid_on_screen import grid_on_screen
from volsplat.protocol.rules.packet_layout import (
    COLOUR_SHIFT,
    OPACITY_SHIFT,
    POSITION_BITS,
    ROW_RUN,
    ROW_RUN_BYTES,
    SUBPIXEL_BITS,
    opacity_of_code,
)
from volsplat.protocol.rules.rounding import TO_NEAREST
from volsplat.splat_server import _kernels
from volsplat.splat_server.footprint_table import footprint_table

SIDES = (4, 8, 12, 16)  # pixels of a footprint
SIZE = 512  # pixels of the image
PITCH = SIZE + 20  # of the floor's image: the rows of a footprint do not fall into the same cache set
PIXELS_A_VOXEL = 4  # of a footprint: the default kernel's support
OPACITY_CODE = 1500  # so thin that nothing is frozen
COLOUR = (200, 100, 50)
WITHIN = 0.1  # relative, of the block's opacity: sheets' weights w A vary over a pixel
FLOOR = "bare loop"


class Rows(Enum):
    """How the block's rows lie on the screen; each is a view's rotation."""

    LEVEL = (0.1, 0.0, 0.0, 1.0)  # as without roll: neighbours share their rows of pixels
    LEAN = (0.1, 0.06, 0.05, 1.0)  # by a tenth: half of the neighbours do not


@dataclass(frozen=True)
class SplatRates:
    """Splats a second, round by round: of each order, and of the floor."""

    side: int
    rows: Rows
    path: str
    rates: dict[str, list[float]]

    def over_floor(self) -> dict[str, list[float]]:
        """Each order's rates over the floor's of the same round."""
        return {order.value: ratios(self.rates[order.value], self.rates[FLOOR]) for order in TRAVERSAL_ORDERS}


def splat_rates(splats: int, rounds: int, on_round: Callable[[], None]) -> Iterator[SplatRates]:
    """For each footprint size, lie of the rows and CPU path. Also checks each image."""
    for side, rows in itertools.product(SIDES, Rows):
        block = Block(side, rows, splats)
        for path in floors.cpu_paths():
            with kernels_on(_kernels, path), kernels_on(floors, path):
                yield SplatRates(side, rows, path, block.measured(rounds, on_round))


class Block:
    """A block of equal samples in the middle of the image, whose footprints are `side` pixels wide."""

    def __init__(self, side: int, rows: Rows, splats: int) -> None:
        zoom = side / PIXELS_A_VOXEL
        scene = _scene(rows, zoom)
        runs, packets, positions, self._counts = _sheets(scene, zoom, splats)
        self._packets = len(packets)
        self._news = _kernels.Bell()
        parts, budget = [(len(runs) // ROW_RUN_BYTES, len(packets))], _kernels.ReadBudget(1, self._news)
        self._batch = _kernels.BatchMemory(runs + packets.numpy().tobytes(), parts, budget)
        self._table = footprint_table(
            footprint_shape(grid_on_screen(scene, Geometry((8, 8, 8))), 1, scene.reconstruction)
        )
        assert (self._table.width, self._table.height) == (side, side)
        self._owners = _kernels.Owners(1)
        self._floor = _floor(side, positions)

    def measured(self, rounds: int, on_round: Callable[[], None]) -> dict[str, list[float]]:
        """Splats a second of each order and of the floor."""

        contenders: dict[str, Callable[[int], float]] = {
            order.value: (lambda n, order=order: self._splat(order).seconds[0].splat)  # type: ignore[misc]
            for order in TRAVERSAL_ORDERS
        }
        contenders[FLOOR] = lambda n: thread_seconds(lambda: self._floor.run())
        self._check(self._splat(Order.BACK_TO_FRONT))
        seconds = interleaved(contenders, range(rounds), lambda n: on_round())
        return {name: [self._packets / taken for taken in values] for name, values in seconds.items()}

    def _splat(self, order: Order) -> _kernels.SplatFrame:
        """All of the block, by one owner."""
        self._owners.clear(SIZE, SIZE, False)
        frame = self._owners.begin(
            regions=[(0, SIZE)],
            reach=self._table,
            front_to_back=order == Order.FRONT_TO_BACK,
            thresholds=TO_NEAREST,
            counts=self._counts,
            sources=1,
            portion=self._packets,
            edges=None,
            walks=(),
            news=self._news,
            all_wait=self._news,
        )
        frame.push(0, self._batch, 0, 0, True)
        heard = self._news.rung
        while not frame.complete:
            heard = self._news.wait(heard, 1.0)
        return frame

    def _check(self, frame: _kernels.SplatFrame) -> None:
        """In the middle of the block every pixel has the opacity of its sheets, one reference spacing each."""
        middle = slice(SIZE // 2 - 20, SIZE // 2 + 20)
        pixels = torch.frombuffer(bytearray(self._owners.published(frame)), dtype=torch.float32).reshape(SIZE, SIZE, 4)
        expected = 1 - math.exp(-self._counts[0] * opacity_of_code(OPACITY_CODE))
        worst = float((pixels[middle, middle, 3] / expected - 1).abs().max())
        assert worst < WITHIN, f"the block's opacity is off by {worst:.1%}"


def _scene(rows: Rows, zoom: float) -> Scene:
    tables = Tables(
        emit=ColourTable(points=((0.0, (1.0, 1.0, 1.0)),)),
        refl=ColourTable(points=((0.0, (0.0, 0.0, 0.0)),)),
        opac=ScalarTable(points=((0.0, 1.0),)),
    )
    return Scene(tables=tables, view=View(rotation=rows.value, zoom=zoom), image=Image(width=SIZE, height=SIZE))


def _sheets(scene: Scene, zoom: float, splats: int) -> tuple[bytes, Tensor, Tensor, tuple[int, int, int]]:
    """Of whole sheets that cover the middle of the image: row runs, packets, positions (n, 2) x, y, and counts."""
    side = int(SIZE * 0.6 / zoom)
    deep = max(1, splats // side**2)
    plan = plan_frame(scene, Geometry((side, side, deep)), Step.F)
    along_row = min(side, int(200 / zoom))
    runs, packets, positions = [], [], []
    for sheet in range(deep):
        for row in range(side):
            x, y = _positions(plan, sheet, row, side)
            positions.append(torch.stack((x, y), dim=1))
            for first in range(0, side, along_row):
                px, py = x[first : first + along_row], y[first : first + along_row]
                x0, y0 = int(px.min()), int(py.min())
                runs.append(ROW_RUN.pack(sheet, row, first, len(px), x0, y0))
                packets.append(px - x0 | py - y0 << POSITION_BITS)
    colour = (COLOUR[0] | COLOUR[1] << 8 | COLOUR[2] << 16) << COLOUR_SHIFT | OPACITY_CODE << OPACITY_SHIFT
    return b"".join(runs), torch.cat(packets) | colour, torch.cat(positions), (deep, side, side)


def _positions(plan: FramePlan, sheet: int, row: int, samples: int) -> tuple[Tensor, Tensor]:
    """x and y of a row's samples, 1/64 pixel."""
    sample = torch.arange(samples)
    x, y = (
        (
            dda.origin
            + 2 * (sample * dda.half_steps[0] + row * dda.half_steps[1] + sheet * dda.half_steps[2])
            + (1 << 25)
        )
        >> 26
        for dda in (plan.x, plan.y)
    )
    return x, y


def _floor(side: int, positions: Tensor) -> floors.BareSplat:
    """The boxes of pixels around these positions (n, 2), 1/64 pixel, in the same order, moved into the image."""
    image = torch.zeros((SIZE, PITCH, 4))
    corners = ((positions - 32 * side >> SUBPIXEL_BITS) + 1).clamp(0, SIZE - side).int().contiguous()
    weights = torch.full((side, side, 4), 0.01)
    return floors.BareSplat(image, corners, weights, torch.tensor([*(channel / 255 for channel in COLOUR), 1.0]))
