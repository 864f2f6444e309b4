"""A scene of ours as VTK's volume property, camera and light."""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor
from vtkmodules.vtkCommonDataModel import vtkPiecewiseFunction
from vtkmodules.vtkRenderingCore import vtkCamera, vtkColorTransferFunction, vtkVolumeProperty

from volsplat.bench.peers.vtk_ray_caster import PlacesCamera, RayCaster, image_data
from volsplat.bench.ssim import LUMINANCE
from volsplat.protocol.description.colours import Colour
from volsplat.protocol.description.scene import Bounds, Scene
from volsplat.protocol.description.shading_tables import CrossBar, Tables
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.geometry import matrices
from volsplat.protocol.geometry.matrices import Matrix, Vector
from volsplat.protocol.rules.index_rules import Quantisation
from volsplat.protocol.rules.resolved_view import resolved_center, resolved_zoom, screen_rotation
from volsplat.protocol.text.errors import BadInput

LAST = 255
ORTHOGONAL = 1e-4  # how far a grid's axes may be from right angles
NARROW = 1e-3  # of a table's entry: a step is a slope of this width


@dataclass(frozen=True)
class Placed:
    """A volume as VTK holds it: voxels (k, j, i) on an upright grid of `spacing`, turned into physical space.

    `axes` has the physical directions of VTK's x, y and z as columns; a left-handed grid is held with k reversed.
    """

    values: Tensor
    spacing: Vector
    axes: Matrix
    reversed_k: bool
    geometry: Geometry

    def at(self, index: Vector) -> Vector:
        """Where VTK has a grid point."""
        i, j, k = index
        k = self.geometry.dims[2] - 1 - k if self.reversed_k else k
        return (i * self.spacing[0], j * self.spacing[1], k * self.spacing[2])


def placed(values: Tensor, geometry: Geometry) -> Placed:
    """Raises BadInput for a skewed grid, which VTK's mapper does not draw."""
    spacing = geometry.spacing
    columns = [matrices.scaled(matrices.column(geometry.index_to_physical, n), 1 / spacing[n]) for n in range(3)]
    for a, b in ((0, 1), (0, 2), (1, 2)):
        if abs(matrices.dot(columns[a], columns[b])) > ORTHOGONAL:
            raise BadInput("VTK's CPU ray caster draws no skewed grids; choose a volume with right angles")
    left_handed = matrices.determinant(geometry.index_to_physical) < 0
    if left_handed:
        columns[2] = matrices.scaled(columns[2], -1.0)
        values = values.flip(0)
    rows = tuple((columns[0][n], columns[1][n], columns[2][n]) for n in range(3))
    return Placed(values, spacing, (rows[0], rows[1], rows[2]), left_handed, geometry)


class VtkScene:
    """A scene drawn by VTK, frame after frame in other views."""

    def __init__(
        self, volume: Placed, scene: Scene, quantisation: Quantisation, sample_distance: float, threads: int
    ) -> None:
        """`sample_distance` in voxels. Raises BadInput for a scene that VTK cannot show."""
        self._placed = volume
        looks = volume_property(scene, quantisation, volume.geometry)
        step = sample_distance * volume.geometry.reference_spacing
        self._caster = RayCaster(image_data(volume.values, volume.spacing), looks, step, threads)

    def draw(self, scene: Scene) -> None:
        """A frame in the scene's view, with its light; everything else stays as it was."""
        to_screen = matrices.product(screen_rotation(scene.view), self._placed.axes)
        frame = self._placed.axes if scene.light.fixed_to == "grid" else to_screen
        self._caster.light(matrices.applied(matrices.transposed(frame), scene.light.direction), scene.shading.two_sided)
        size = (scene.image.width, scene.image.height)
        self._caster.cast(camera(scene, self._placed, to_screen), size)

    def picture(self) -> Tensor:
        """The frame drawn last: (H, W, 4) float32, associated alpha."""
        return self._caster.picture()


def camera(scene: Scene, volume: Placed, to_screen: Matrix) -> PlacesCamera:
    """The scene's view; rows of `to_screen` are the screen's x, y and z in VTK's axes."""
    geometry = volume.geometry
    target = volume.at(resolved_center(scene, geometry))
    far = 4 * sum(n * step for n, step in zip(geometry.dims, volume.spacing, strict=True))
    pixel = geometry.reference_spacing / resolved_zoom(scene, geometry)

    def place(view: vtkCamera) -> None:
        view.SetParallelScale(scene.image.height * pixel / 2)
        view.SetFocalPoint(*target)
        view.SetPosition(*matrices.plus(target, matrices.scaled(to_screen[2], far)))
        view.SetViewUp(*to_screen[1])
        view.SetClippingRange(far / 2, far * 2)

    return place


def volume_property(scene: Scene, quantisation: Quantisation, geometry: Geometry) -> vtkVolumeProperty:
    """Tables over density as functions of the data's values; the reflected colour is VTK's colour.

    What VTK has as numbers and we as tables, emitted light and the strength of highlights, is matched in the mean
    over the visible entries. Raises BadInput if a table is looked up by another field.
    """
    _check_convertible(scene)
    tables, shading = scene.tables, scene.shading
    looks = vtkVolumeProperty()
    looks.SetInterpolationTypeToLinear()
    looks.SetScalarOpacity(_function(tables.opac.entries(), *quantisation.window))
    looks.SetScalarOpacityUnitDistance(geometry.reference_spacing)
    lit = shading.diffuse or shading.specular
    colours = tables.refl.entries() if lit and _mean_luminance(tables, tables.refl.entries()) else tables.emit.entries()
    looks.SetColor(_colours(colours, *quantisation.window))
    if shading.modulation:
        steepest = LAST / quantisation.strength_scale * sum(geometry.spacing) / 3
        looks.SetGradientOpacity(_function(tables.modu.entries(), 0.0, steepest))
    looks.SetDisableGradientOpacity(not shading.modulation)
    if not lit:
        looks.ShadeOff()
        return looks
    reflected = _mean_luminance(tables, tables.refl.entries())
    looks.ShadeOn()
    emitted = _mean_luminance(tables, tables.emit.entries()) if shading.emitted else 0.0
    looks.SetAmbient(emitted / reflected if reflected else 1.0)
    looks.SetDiffuse(1.0 if shading.diffuse and reflected else 0.0)
    looks.SetSpecular(reflected if shading.specular else 0.0)
    looks.SetSpecularPower(shading.specular_power)
    return looks


def _check_convertible(scene: Scene) -> None:
    wanted = CrossBar()
    for name in ("emit", "refl", "opac", "modu"):
        field, usual = getattr(scene.cross_bar, name), getattr(wanted, name)
        if field != usual and (name != "modu" or scene.shading.modulation):
            raise BadInput(f"VTK cannot look {name} up by {field}, only by {usual}; choose other --tables or --preset")
    if scene.bounds != Bounds():
        raise BadInput("peers are compared on whole volumes; leave bounds out of the scene")


def _function(entries: Sequence[float], low: float, high: float) -> vtkPiecewiseFunction:
    """A table over low..high, joined by straight lines between the middles of its entries."""
    function = vtkPiecewiseFunction()
    for n, value in enumerate(entries):
        function.AddPoint(low + (high - low) * n / LAST, value)
    return function


def _colours(entries: Sequence[Colour], low: float, high: float) -> vtkColorTransferFunction:
    function = vtkColorTransferFunction()
    for n, colour in enumerate(entries):
        function.AddRGBPoint(low + (high - low) * n / LAST, *colour)
    return function


def _mean_luminance(tables: Tables, entries: Sequence[Colour]) -> float:
    """Of a table of colours, over the entries that are not transparent, by their opacity."""
    opacity = torch.tensor(tables.opac.entries(), dtype=torch.float64)
    values = torch.tensor(entries, dtype=torch.float64) @ torch.tensor(LUMINANCE, dtype=torch.float64)
    total = float(opacity.sum())
    return float((values * opacity).sum()) / total if total else 0.0
