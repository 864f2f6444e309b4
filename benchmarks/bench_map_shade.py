"""How many voxels a second one core maps and shades, by CPU path and by the axis that samples follow.

The volume is 256^3 with about a tenth visible, once as noise, which no branch predicts, and once as nested shells.
The floor is a bare loop that reads every packet once. Each walk's packet count is checked.
"""

import platform
import time
from collections.abc import Callable

import msgspec
import torch
from torch import Tensor
from torch.utils.dlpack import from_dlpack

from volsplat.mapshade_server import _kernels
from volsplat.mapshade_server.frame_walk import FrameWalk
from volsplat.mapshade_server.sub_cube import SubCube
from volsplat.protocol.frame_plan import plan_frame
from volsplat.protocol.index_rules import Quantisation
from volsplat.protocol.packet_layout import SHADED_PACKET_BYTES
from volsplat.protocol.scene import ColourTable, CrossBar, Field, ScalarTable, Scene, Step, Tables, View
from volsplat.protocol.volume import Geometry

SIDE = 256
REPEATS = 5
VISIBLE_FROM = 230  # density byte
QUANTISATION = Quantisation(window=(0.0, 1.0), strength_scale=100.0)

# Views whose innermost axis is i, j and k.
VIEWS = {"i": (0.12, 0.05, 0.02, 1.0), "j": (0.05, 0.12, 0.02, 1.0), "k": (0.05, 0.66, 0.05, 0.7)}


def scene(view: tuple[float, float, float, float], cross_bar: CrossBar) -> Scene:
    step = VISIBLE_FROM / 255 - 0.5 / 255
    return Scene(
        tables=Tables(
            emit=ColourTable(points=((0.0, (0.0, 0.1, 0.2)), (1.0, (0.5, 0.4, 0.3)))),
            refl=ColourTable(points=((0.0, (1.0, 1.0, 1.0)),)),
            opac=ScalarTable(points=((0.0, 0.0), (step, 0.0), (step, 0.1), (1.0, 0.6))),
            modu=ScalarTable(points=((0.0, 0.5), (1.0, 1.0))),
        ),
        cross_bar=cross_bar,
        view=View(rotation=view),
    )


def noise() -> Tensor:
    return torch.rand((SIDE, SIDE, SIDE), generator=torch.Generator().manual_seed(1))


def shells() -> Tensor:
    """Nested spheres, bright in about a tenth of the cube."""
    axis = torch.linspace(-1, 1, SIDE)
    radius = (axis[:, None, None] ** 2 + axis[:, None] ** 2 + axis**2).sqrt()
    return (0.5 + 0.5 * torch.cos(radius * 25)) * (radius < 1) + 0.02 * noise()


def best(run: Callable[[], int]) -> tuple[float, int]:
    """The shortest of some runs, in seconds of CPU time, and what it returned."""
    seconds, result = [], 0
    for _ in range(REPEATS):
        started = time.thread_time()
        result = run()
        seconds.append(time.thread_time() - started)
    return min(seconds), result


def main() -> None:
    print(f"{platform.processor() or platform.machine()}, one core, {SIDE}^3 voxels; million voxels/s")
    geometry = Geometry((SIDE, SIDE, SIDE))
    depth_cue = msgspec.structs.replace(CrossBar(), modu=Field.SCREEN_Z)
    for name, volume in (("noise", noise()), ("shells", shells())):
        sub_cube = SubCube.of_volume(geometry, volume)
        sub_cube.pack(QUANTISATION)
        packets = from_dlpack(sub_cube.packets)
        expected = int((packets.to(torch.int64) & 255 >= VISIBLE_FROM).sum())
        floor, _ = best(lambda sub_cube=sub_cube: _kernels.bare_loop(sub_cube.packets))  # type: ignore[misc]
        print(f"\n{name}: {expected / SIDE**3:.1%} visible; bare loop {SIDE**3 / floor / 1e6:.0f}")
        print(f"{'path':10}" + "".join(f"{'samples ' + axis:>12}" for axis in VIEWS) + f"{'i, by depth':>14}")
        for path in _kernels.cpu_paths():
            _kernels.set_cpu_path(path)
            figures = []
            for axis, cross_bar in [(axis, CrossBar()) for axis in VIEWS] + [("i", depth_cue)]:
                drawn = scene(VIEWS[axis], cross_bar)
                plan = plan_frame(drawn, geometry, Step.F)
                assert "ijk"[plan.traversal.axes[2]] == axis

                def walk(drawn: Scene = drawn, sub_cube: SubCube = sub_cube) -> int:
                    plan = plan_frame(drawn, geometry, Step.F)
                    frame = FrameWalk([sub_cube], geometry, QUANTISATION, drawn, plan)
                    sent = 0
                    while (batch := frame.next_batch()) is not None:
                        sent += len(batch.packets) // SHADED_PACKET_BYTES
                    return sent

                seconds, sent = best(walk)
                assert sent == expected, f"{sent} packets were sent, but {expected} voxels are visible"
                figures.append(SIDE**3 / seconds / 1e6)
            print(f"{path:10}" + "".join(f"{figure:12.0f}" for figure in figures[:3]) + f"{figures[3]:14.0f}")


if __name__ == "__main__":
    main()
