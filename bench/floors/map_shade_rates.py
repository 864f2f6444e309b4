"""Voxels a second on one core through map/shade, beside a bare loop over the same packets, measured in turns."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.utils.dlpack import from_dlpack

from volsplat.bench import _kernels as floors
from volsplat.bench.floors.cpu_paths import kernels_on
from volsplat.bench.timing import interleaved, thread_seconds
from volsplat.mapshade_server import _kernels
from volsplat.mapshade_server.frames.frame_walk import DEFAULT_PACKETS, DEFAULT_VOXELS, FrameWalk
from volsplat.mapshade_server.held.sub_cube import SubCube
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Image, Order, Scene, View
from volsplat.protocol.description.shading_tables import ColourTable, ScalarTable, Tables
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.messages.drawing import Drawing
from volsplat.protocol.rules.frame_plan import plan_frame
from volsplat.protocol.rules.index_rules import Quantisation

QUANTISATION = Quantisation(window=(0.0, 1.0), strength_scale=100.0)
VISIBLE = 0.065  # of the voxels, as in the figure that the floor was measured at
VISIBLE_SHARES = (0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.35, 0.5)
OPACITY_CODE = 1500
OTHER_TABLES = 3  # so many in turns, by which other voxels are visible
FLOOR = "bare loop"

# Views whose innermost axis is i, j and k.
VIEWS = {"i": (0.12, 0.05, 0.02, 1.0), "j": (0.05, 0.12, 0.02, 1.0), "k": (0.05, 0.66, 0.05, 0.7)}


@dataclass(frozen=True)
class WalkRates:
    """Voxels a second, round by round, of the walks along each axis and of the floor."""

    volume: str
    path: str
    every_voxel: dict[str, list[float]]  # new tables in every frame, so that all packets are looked up
    steady: dict[str, list[float]]  # the frames after
    floor: list[float]


@dataclass(frozen=True)
class ShareTime:
    """Seconds of a steady frame at a share of visible voxels."""

    visible: float
    seconds: list[float]


class PackedVolume:
    """A cube of voxel packets whose densities are spread evenly, so that an opacity's first density is a share."""

    def __init__(self, name: str, side: int) -> None:
        self.name = name
        self.geometry = Geometry((side, side, side))
        self.sub_cube = SubCube.of_volume(self.geometry, _VOLUMES[name](side))
        self.sub_cube.pack(QUANTISATION)
        self.packets = from_dlpack(self.sub_cube.packets).reshape(-1)
        densities = torch.bincount((self.packets.to(torch.int64) & 255), minlength=256)
        self.from_density = densities.flip(0).cumsum(0).flip(0)  # voxels of a density or more

    @property
    def voxels(self) -> int:
        return self.geometry.box.voxels

    def first_density(self, share: float) -> int:
        """The density from which on about `share` of the voxels lie."""
        return int((self.from_density.double() / self.voxels - share).abs().argmin())

    def scene(self, view: str, first: int) -> Scene:
        """Densities from `first` on are visible."""
        step = (first - 0.5) / 255
        return Scene(
            tables=Tables(
                emit=ColourTable(points=((0.0, (0.0, 0.1, 0.2)), (1.0, (0.5, 0.4, 0.3)))),
                refl=ColourTable(points=((0.0, (1.0, 1.0, 1.0)),)),
                opac=ScalarTable(points=((0.0, 0.0), (step, 0.0), (step, 0.1), (1.0, 0.6))),
                modu=ScalarTable(points=((0.0, 0.5), (1.0, 1.0))),
            ),
            view=View(rotation=VIEWS[view]),
            image=Image(width=1024, height=1024),
            order=Order.BACK_TO_FRONT,
        )

    def walk(self, scene: Scene) -> int:
        """Map and shade one frame; the packets that it sent."""
        plan = plan_frame(scene, self.geometry, Step.F)
        [walker] = FrameWalk([self.sub_cube], Drawing.of(scene, plan, self.geometry, QUANTISATION)).walkers
        sent, last = 0, False
        while not last:
            batch = walker.next_batch(DEFAULT_PACKETS, DEFAULT_VOXELS)
            sent, last = sent + batch.packet_count, batch.last
        return sent


def walk_rates(volume: PackedVolume, rounds: int, on_round: Callable[[], None]) -> Iterator[WalkRates]:
    """For each CPU path. Also checks how many packets are sent."""
    first = volume.first_density(VISIBLE)
    floor = _Floor(volume, first)
    for path in floors.cpu_paths():
        with kernels_on(_kernels, path), kernels_on(floors, path):

            def walk(view: str, first: int) -> float:
                sent = 0

                def work() -> None:
                    nonlocal sent
                    sent = volume.walk(volume.scene(view, first))

                seconds = thread_seconds(work)
                assert sent == volume.from_density[first], f"{sent} packets were sent of other visible voxels"
                return seconds

            def new_tables(view: str, n: int) -> float:
                return walk(view, first + 1 + n % OTHER_TABLES)

            def steady(view: str) -> float:
                walk(view, first)
                return walk(view, first)

            def bare() -> float:
                seconds = thread_seconds(floor.run)
                assert floor.shaded == volume.from_density[first]
                return seconds

            contenders: dict[tuple[str, str], Callable[[int], float]] = {}
            for view in VIEWS:
                contenders["every voxel", view] = lambda n, view=view: new_tables(view, n)  # type: ignore[misc]
                contenders["steady", view] = lambda n, view=view: steady(view)  # type: ignore[misc]
            contenders[FLOOR, ""] = lambda n, bare=bare: bare()  # type: ignore[misc]
            seconds = interleaved(contenders, range(rounds), lambda n: on_round())
            rates = {key: [volume.voxels / taken for taken in values] for key, values in seconds.items()}
            yield WalkRates(
                volume.name,
                path,
                {view: rates["every voxel", view] for view in VIEWS},
                {view: rates["steady", view] for view in VIEWS},
                rates[FLOOR, ""],
            )


def share_times(volume: PackedVolume, rounds: int, on_round: Callable[[], None]) -> list[ShareTime]:
    """Steady frames along i over the share of visible voxels, on the CPU path in use."""
    firsts = sorted({volume.first_density(share) for share in VISIBLE_SHARES}, reverse=True)

    def seconds(first: int) -> float:
        scene = volume.scene("i", first)
        volume.walk(scene)
        return thread_seconds(lambda: volume.walk(scene))

    contenders: dict[int, Callable[[int], float]] = {
        first: (lambda n, first=first: seconds(first))  # type: ignore[misc]
        for first in firsts
    }
    found = interleaved(contenders, range(rounds), lambda n: on_round())
    return [ShareTime(float(volume.from_density[first]) / volume.voxels, found[first]) for first in firsts]


class _Floor:
    """The bare loop with tables of its own, by which the same voxels are visible."""

    def __init__(self, volume: PackedVolume, first: int) -> None:
        tables = volume.scene("i", first).tables
        self.shaded = 0
        self._packets = volume.packets
        visible = (torch.arange(1 << 16) & 255) >= first
        self._opacity = (visible * OPACITY_CODE).to(torch.uint16)
        self._emit, self._refl = _levels(tables.emit.entries()), _levels(tables.refl.entries())
        self._light = torch.rand(1 << 15, generator=torch.Generator().manual_seed(2))
        self._out = torch.empty(volume.voxels, dtype=torch.uint64)

    def run(self) -> None:
        tables = (self._opacity, self._emit, self._refl, self._light)
        self.shaded = floors.bare_shade(self._packets, *tables, self._out)


def _levels(colours: Sequence[tuple[float, float, float]]) -> Tensor:
    """(256, 4) float32, in levels of 8 bits."""
    return torch.tensor([[*(channel * 255 for channel in colour), 0.0] for colour in colours])


def _noise(side: int) -> Tensor:
    return torch.rand((side, side, side), generator=torch.Generator().manual_seed(1))


def _shells(side: int) -> Tensor:
    """Nested spheres, so that what is visible lies together."""
    axis = torch.linspace(-1, 1, side)
    radius = (axis[:, None, None] ** 2 + axis[:, None] ** 2 + axis**2).sqrt()
    return (0.49 + 0.49 * torch.cos(radius * 25)) * (radius < 1) + 0.02 * _noise(side)


_VOLUMES: dict[str, Callable[[int], Tensor]] = {"noise": _noise, "shells": _shells}
