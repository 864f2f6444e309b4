"""One volume drawn by step F, by step G and, where VTK is installed, by VTK at its sample distances."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import msgspec
import torch
from torch import Tensor

from volsplat.bench.peers.contenders import Contender, own_contender, vtk_contenders
from volsplat.bench.quality.density_fields import DensityField
from volsplat.bench.quality.ray_caster import cast
from volsplat.client.command.side_console import SideConsole
from volsplat.client.phantoms import make_phantom
from volsplat.client.phantoms.volume_writer import write_volume
from volsplat.client.session.single import SingleProcess
from volsplat.mapshade_server.readers import open_volume
from volsplat.program.extras import need
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Reconstruction, Scene, SlabKernel
from volsplat.protocol.description.volume import Geometry, Index
from volsplat.protocol.text.errors import BadInput

STEP_F, STEP_G = "F", "G"
VTK_DISTANCES = (1.0, 0.5)  # voxels between two samples of a ray


def vtk_distances(say: Callable[[str], None]) -> Sequence[float]:
    """Those that are drawn: none without VTK, which is said."""
    try:
        need("vtkmodules", "drawing by VTK", "bench")
    except BadInput as lacking:
        say(f"left out: {lacking}")
        return ()
    return VTK_DISTANCES


class SideBySide:
    """A volume in memory, drawn by one thread of each contender."""

    def __init__(self, path: str, say: Callable[[str], None]) -> None:
        self.renderer = SingleProcess(path, on_progress=say)
        reader = open_volume(path)
        self.values: Tensor = torch.as_tensor(reader.read(self.geometry.box))

    @property
    def geometry(self) -> Geometry:
        return self.renderer.volume.description.geometry

    def settled(self, scene: Scene) -> Scene:
        return self.renderer.volume.settled(scene)

    def window(self, scene: Scene) -> tuple[float, float]:
        """Of the values that become densities 0 to 255."""
        return self.renderer.volume.quantisation(scene.quantise).window

    def rays_through(self, field: DensityField, scene: Scene, sample: float) -> Tensor:
        """The image (H, W, 4) float64 of rays through a field in the place of the voxels."""
        return cast(field, self.geometry, scene, self.window(scene), sample)

    def contenders(self, scene: Scene, distances: Sequence[float], variants: bool = False) -> list[Contender]:
        """For views of a scene. `variants`: step G with every other kernel, and with slabs half as thick, too."""
        by_vtk = vtk_contenders(self.renderer.volume, self.values, scene, [1], distances) if distances else ()
        return [*self._steps(scene, variants), *by_vtk]

    def pictures(self, scene: Scene, distances: Sequence[float], variants: bool = False) -> dict[str, Tensor]:
        """(H, W, 4) float32 with associated alpha, by the contenders' names."""
        found = {}
        for contender in self.contenders(scene, distances, variants):
            contender.draw(scene)
            found[contender.name] = contender.picture()
        return found

    def _steps(self, scene: Scene, variants: bool) -> Iterator[Contender]:
        for name, step in ((STEP_F, Step.F), (STEP_G, Step.G)):
            yield own_contender(name, 1, self.renderer, step)
        for words, reconstruction in _variants(scene.reconstruction) if variants else ():
            changed = partial(msgspec.structs.replace, reconstruction=reconstruction)
            yield own_contender(f"{STEP_G}, {words}", 1, self.renderer, Step.G, changed)


def _variants(usual: Reconstruction) -> Iterator[tuple[str, Reconstruction]]:
    for kernel in SlabKernel:
        if kernel != usual.slab_kernel:
            yield kernel, msgspec.structs.replace(usual, slab_kernel=kernel)
    thin = msgspec.structs.replace(usual, slab=usual.slab / 2)
    yield f"slab {thin.slab:g}", thin
    best = SlabKernel.QUASI_INTERPOLATING
    yield f"{best}, slab {thin.slab:g}", msgspec.structs.replace(thin, slab_kernel=best)


@contextmanager
def opened_file(path: str) -> Iterator[SideBySide]:
    """Raises BadInput."""
    with SideConsole().status("reading the volume") as status:
        side_by_side = SideBySide(path, status.update)
    with side_by_side.renderer:
        yield side_by_side


@contextmanager
def opened_values(values: Tensor, geometry: Geometry) -> Iterator[SideBySide]:
    """Of voxels (k, j, i), which are written to a file for as long as they are needed."""
    with TemporaryDirectory(prefix="volsplat-bench-") as folder:
        path = Path(folder) / "volume.nrrd"
        write_volume(path, values, geometry)
        with opened_file(str(path)) as opened:
            yield opened


@contextmanager
def opened_phantom(name: str, size: Index | None) -> Iterator[SideBySide]:
    with SideConsole().status(f"making the phantom {name}"):
        values, geometry = make_phantom(name, size=size)
    with opened_values(values, geometry) as opened:
        yield opened
