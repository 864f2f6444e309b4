"""Who draws the same picture: volsplat in its forms, and VTK at its sample distances."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

import torch
from torch import Tensor

from volsplat.bench.renderers import local_session
from volsplat.client.session.renderer import Renderer
from volsplat.client.session.single import SingleProcess
from volsplat.mapshade_server.readers import open_volume
from volsplat.protocol.description.scene import Scene, Step

SINGLE, SERVERS, VTK = "volsplat, 1 process", "volsplat, servers", "VTK"


@dataclass(frozen=True)
class Contender:
    """`draw` returns when the image lies in memory; `picture` is what it drew last, (H, W, 4) float32."""

    name: str
    threads: int
    draw: Callable[[Scene], None]
    picture: Callable[[], Tensor]


class Drawing:
    """A renderer of ours and its last picture."""

    def __init__(self, renderer: Renderer, step: Step = Step.F) -> None:
        self.renderer = renderer
        self._step = step
        self._image = torch.zeros((1, 1, 4))

    def draw(self, scene: Scene) -> None:
        self._image = self.renderer.render(scene, self._step)

    def picture(self) -> Tensor:
        return self._image


def vtk_name(distance: float) -> str:
    """With so many voxels between two samples of a ray."""
    return f"{VTK} at {distance:g} voxel"


@contextmanager
def opened_contenders(
    path: str,
    scene_of: Callable[[Renderer], Scene],
    threads: Sequence[int],
    distances: Sequence[float],
    say: Callable[[str], None],
) -> Iterator[tuple[Renderer, Scene, list[Contender]]]:
    """All contenders with the volume at `path` in memory: one thread each, and, for 2 or more, servers as well.

    With n threads there are n map/shade servers beside the splat server.
    """
    from volsplat.bench.peers.vtk_scene import VtkScene, placed

    with ExitStack() as stack:
        ours: list[Contender] = []
        first: Renderer | None = None
        for count in threads:
            single = stack.enter_context(SingleProcess(path, threads=count, on_progress=say))
            first = first or single
            drawing = Drawing(single)
            ours.append(Contender(SINGLE, count, drawing.draw, drawing.picture))
            if count > 1:
                drawing = Drawing(stack.enter_context(local_session(path, count, say)))
                ours.append(Contender(SERVERS, count, drawing.draw, drawing.picture))
        assert first is not None
        scene = scene_of(first)
        say("giving the volume to VTK")
        reader, geometry = open_volume(path), first.volume.description.geometry
        volume = placed(torch.as_tensor(reader.read(geometry.box)), geometry)
        quantisation = first.volume.quantisation(scene.quantise)
        for count in threads:
            for distance in distances:
                vtk = VtkScene(volume, scene, quantisation, distance, count)
                ours.append(Contender(vtk_name(distance), count, vtk.draw, vtk.picture))
        yield first, scene, ours
