"""The real head's silhouette is that of another renderer, VTK's ray caster, in the same orientation."""

import math
from collections.abc import Iterator, MutableSequence, Sequence
from pathlib import Path

import msgspec
import pytest
import SimpleITK
import torch
from torch import Tensor

from support.scenes.arbitrary import plain_scene
from tolerances import MIRRORED_SILHOUETTE, SAME_SILHOUETTE
from volsplat.client.session.single import SingleProcess
from volsplat.protocol.description.scene import Bounds, Kernel, Quantise, Reconstruction, Scene, Shading, View
from volsplat.protocol.description.shading_tables import ScalarTable
from volsplat.protocol.description.view_rotation import VIEW_NAMES, rotation_from_option
from volsplat.protocol.rules.footprint_shape import DEFAULT_RADIUS

try:
    from vtkmodules.vtkCommonCore import vtkMath
    from vtkmodules.vtkRenderingCore import vtkCamera
except ImportError:
    pytest.skip("VTK is not installed: install the extra [bench]", allow_module_level=True)

from support.scenes.vtk_ray_caster import FAR, OpaqueCast
from volsplat.bench.peers.vtk_ray_caster import PlacesCamera

PAPER_SIZE = "ct_head/ct_head_96x128x113.nrrd"
DIMS = (96, 98, 113)  # without the thin sheets of the head rest, which lie behind the head
THRESHOLD = 50.5  # half-way from air to skin, and between two values, so that no voxel lies on it
WINDOW = (0.0, 255.0)
SIZE = (640, 600)
CENTER = (50.5, 45.5, 58.0)  # not the middle
ZOOM = 3.7
SPECK = 1.1  # voxels: the radius of what is taken for noise

# Where VTK's camera stands, and what is up for it.
STANDS: dict[str, tuple[tuple[float, float, float], tuple[float, float, float]]] = {
    "front": ((0, -1, 0), (0, 0, 1)),
    "back": ((0, 1, 0), (0, 0, 1)),
    "left": ((1, 0, 0), (0, 0, 1)),
    "right": ((-1, 0, 0), (0, 0, 1)),
    "top": ((0, 0, 1), (0, -1, 0)),
    "bottom": ((0, 0, -1), (0, -1, 0)),
}
ANGLES = [(30.0, 20.0, 0.0), (-70.0, 35.0, 0.0), (200.0, -35.0, 50.0), (15.0, 10.0, -120.0)]  # azimuth, elevation, roll
QUATERNIONS = [(0.21, -0.33, 0.47, 0.79), (1.0, 1.0, 1.0, 0.2)]  # x, y, z, w


def standing(name: str) -> PlacesCamera:
    def place(camera: vtkCamera) -> None:
        toward, up = STANDS[name]
        camera.SetPosition(*(FAR * part for part in toward))
        camera.SetViewUp(*up)

    return place


def walking(azimuth: float, elevation: float, roll: float) -> PlacesCamera:
    """The camera's walk around a volume that stays: it goes the other way about the vertical axis."""

    def place(camera: vtkCamera) -> None:
        camera.Azimuth(-azimuth)
        camera.Elevation(elevation)
        camera.OrthogonalizeViewUp()
        camera.Roll(roll)

    return place


def turned_by(x: float, y: float, z: float, w: float) -> PlacesCamera:
    def place(camera: vtkCamera) -> None:
        size = math.hypot(x, y, z, w)
        rows: list[MutableSequence[float]] = [[0.0] * 3 for _ in range(3)]
        vtkMath.QuaternionToMatrix3x3([part / size for part in (w, x, y, z)], rows)
        camera.SetPosition(*(FAR * part for part in rows[2]))  # what becomes the screen's z
        camera.SetViewUp(*rows[1])

    return place


def option(numbers: Sequence[float]) -> str:
    return ",".join(str(number) for number in numbers)


OBLIQUE: dict[str, PlacesCamera] = {
    **{option(angles): walking(*angles) for angles in ANGLES},
    **{option(quaternion): turned_by(*quaternion) for quaternion in QUATERNIONS},
}
VIEWS: dict[str, PlacesCamera] = {**{name: standing(name) for name in STANDS}, **OBLIQUE}


@pytest.fixture(scope="module")
def head(shared_data: Path) -> Iterator[SingleProcess]:
    with SingleProcess(shared_data / PAPER_SIZE) as single:
        yield single


@pytest.fixture(scope="module")
def caster(shared_data: Path) -> OpaqueCast:
    return OpaqueCast(shared_data / PAPER_SIZE, THRESHOLD, DIMS)


def opaque_scene(rotate: str, reach: float) -> Scene:
    """Every voxel above the threshold is opaque, every other clear; the kernel is cut at `reach` voxels."""
    at = THRESHOLD / (WINDOW[1] - WINDOW[0])
    plain = plain_scene(size=SIZE)
    return msgspec.structs.replace(
        plain,
        tables=msgspec.structs.replace(plain.tables, opac=ScalarTable(points=((at, 0.0), (at, 1.0)))),
        shading=Shading(diffuse=False, specular=False, modulation=False),
        view=View(rotation=rotation_from_option(rotate), up="+z", zoom=ZOOM, center=CENTER),
        bounds=Bounds(high=DIMS),
        reconstruction=Reconstruction(radius=reach),
        quantise=Quantise(window=WINDOW),
    )


def silhouette(alpha: Tensor) -> Tensor:
    """(H, W) bool."""
    return alpha > 0.5


def dilated(mask: Tensor, radius: float) -> Tensor:
    """All pixels at most `radius` pixels from a mask's."""
    image = SimpleITK.GetImageFromArray(mask.byte().numpy())
    squared = SimpleITK.SignedMaurerDistanceMap(image, squaredDistance=True, useImageSpacing=False)
    return torch.from_numpy(SimpleITK.GetArrayFromImage(squared)) <= radius * radius


def opened(mask: Tensor, radius: float) -> Tensor:
    return dilated(~dilated(~mask, radius), radius)


def apart(one: Tensor, other: Tensor, voxels: float) -> int:
    """How many pixels of either silhouette are more than so many voxels from the other.

    What is thinner than a voxel's own picture does not count: single noisy voxels and needles of metal streaks are
    drawn by a splatter, and missed by rays that pass beside their centres.
    """
    speck, radius = SPECK * ZOOM, voxels * ZOOM
    beyond = (opened(one, speck) & ~dilated(other, radius)) | (opened(other, speck) & ~dilated(one, radius))
    return int(beyond.sum())


def drawn(head: SingleProcess, view: str, reach: float = 1.0) -> Tensor:
    return silhouette(head.render(opaque_scene(view, reach))[..., 3])


def cast(caster: OpaqueCast, place: PlacesCamera) -> Tensor:
    return silhouette(caster.alpha(place, SIZE, CENTER, pixel=1 / ZOOM))


def test_every_named_view_is_compared() -> None:
    assert set(STANDS) == set(VIEW_NAMES)


@pytest.mark.parametrize("view", VIEWS)
def test_the_head_s_silhouette_is_within_a_voxel_of_vtk_s_in_the_same_orientation(
    head: SingleProcess, caster: OpaqueCast, view: str
) -> None:
    """With a kernel that reaches one voxel: opaque samples in a row paint as far as their kernel reaches."""
    expected = cast(caster, VIEWS[view])
    assert 0.15 < expected.float().mean() < 0.7
    assert apart(drawn(head, view), expected, SAME_SILHOUETTE) == 0


@pytest.mark.parametrize("view", VIEWS)
def test_the_default_kernel_widens_no_silhouette_by_more_than_its_radius(
    head: SingleProcess, caster: OpaqueCast, view: str
) -> None:
    radius = DEFAULT_RADIUS[Kernel.GAUSSIAN]
    assert apart(drawn(head, view, radius), cast(caster, VIEWS[view]), SAME_SILHOUETTE + radius - 1) == 0


@pytest.mark.parametrize("view", OBLIQUE)
def test_a_mirrored_picture_s_silhouette_is_far_from_vtk_s(head: SingleProcess, caster: OpaqueCast, view: str) -> None:
    assert apart(drawn(head, view).flip(1), cast(caster, VIEWS[view]), MIRRORED_SILHOUETTE) > 0


@pytest.mark.parametrize("axis", range(3))
def test_a_mirrored_volume_s_silhouette_is_far_from_vtk_s(shared_data: Path, head: SingleProcess, axis: int) -> None:
    mirrored = OpaqueCast(shared_data / PAPER_SIZE, THRESHOLD, DIMS, flipped=axis)
    for view, place in OBLIQUE.items():
        assert apart(drawn(head, view), cast(mirrored, place), MIRRORED_SILHOUETTE) > 0
