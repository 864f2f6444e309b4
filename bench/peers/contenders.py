"""Who draws the same picture: volsplat in its forms, and VTK at its sample distances."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

import torch
from torch import Tensor

from volsplat.bench.renderers import local_session
from volsplat.client.session.renderer import Renderer
from volsplat.client.session.single import SingleProcess
from volsplat.client.volume.surveyed_volume import SurveyedVolume
from volsplat.mapshade_server.readers import open_volume
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Scene

SINGLE, SERVERS, VTK = "volsplat, 1 process", "volsplat, servers", "VTK"


@dataclass(frozen=True)
class Contender:
    """`draw` returns when the image lies in memory; `picture` is what it drew last, (H, W, 4) float32."""

    name: str
    threads: int
    draw: Callable[[Scene], None]
    picture: Callable[[], Tensor]


def own_contender(
    name: str,
    threads: int,
    renderer: Renderer,
    step: Step = Step.F,
    changed: Callable[[Scene], Scene] = lambda scene: scene,
) -> Contender:
    """A renderer of ours, which draws scenes as `changed`."""
    drawn: list[Tensor] = []

    def draw(scene: Scene) -> None:
        drawn[:] = [renderer.render(changed(scene), step)]

    return Contender(name, threads, draw, lambda: drawn[0])


def vtk_contenders(
    volume: SurveyedVolume, values: Tensor, scene: Scene, threads: Sequence[int], distances: Sequence[float]
) -> Iterator[Contender]:
    """VTK with the voxels of a volume, for views of a scene. Raises BadInput for what it cannot draw."""
    from volsplat.bench.peers.vtk_scene import VtkScene, placed

    there, quantisation = placed(values, volume.description.geometry), volume.quantisation(scene.quantise)
    for count, distance in itertools.product(threads, distances):
        vtk = VtkScene(there, scene, quantisation, distance, count)
        yield Contender(vtk_name(distance), count, vtk.draw, vtk.picture)


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
    with ExitStack() as stack:
        ours: list[Contender] = []
        first: Renderer | None = None
        for count in threads:
            single = stack.enter_context(SingleProcess(path, threads=count, on_progress=say))
            first = first or single
            ours.append(own_contender(SINGLE, count, single))
            if count > 1:
                ours.append(own_contender(SERVERS, count, stack.enter_context(local_session(path, count, say))))
        assert first is not None
        scene = scene_of(first)
        say("giving the volume to VTK")
        values = torch.as_tensor(open_volume(path).read(first.volume.description.geometry.box))
        yield first, scene, [*ours, *vtk_contenders(first.volume, values, scene, threads, distances)]
