"""Closed shells one voxel thin let no ray through in the steps that take nearest pixels."""

import torch
from hypothesis import assume, example, given
from hypothesis import strategies as st
from torch import Tensor

from support.scenes.arbitrary import plain_scene, quaternions
from support.scenes.rendering import rendered
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import TRAVERSAL_ORDERS, Order, View
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.rules.frame_plan import Reach, plan_frame

SIZE = 22
DEEP = 2  # voxels inside the shell
ZOOMS = st.one_of(st.floats(0.25, 0.55), st.floats(1.0, 7.0))  # one pixel holds all of a voxel's outline, or cells


def eroded(solid: Tensor, voxels: int) -> Tensor:
    """Without what lies so near to the outside, diagonals included."""
    outside = (~solid)[None, None].float()
    return torch.nn.functional.max_pool3d(outside, 2 * voxels + 1, stride=1, padding=voxels)[0, 0] == 0


def skin_of(solid: Tensor) -> Tensor:
    """The voxels that share a side with one outside."""
    skin = torch.zeros_like(solid)
    for axis in range(3):
        for way in (1, -1):
            skin |= solid & ~solid.roll(way, dims=axis)
    return skin


def lobes(seed: int) -> Tensor:
    """A smooth body well within its grid, bool (k, j, i)."""
    chance = torch.Generator().manual_seed(seed)
    grid = torch.stack(torch.meshgrid(*(torch.arange(float(SIZE)),) * 3, indexing="ij"), dim=-1)
    field = torch.zeros((SIZE,) * 3)
    for _ in range(3):
        middle = SIZE / 2 - 0.5 + 3.0 * (2 * torch.rand(3, generator=chance) - 1)
        field += torch.exp(-((grid - middle) ** 2).sum(-1) / (2 * 3.6**2))
    body = field > 0.35
    edge = torch.ones_like(body)
    edge[2:-2, 2:-2, 2:-2] = False
    return body & ~edge


@given(st.integers(0, 1000), quaternions, ZOOMS, st.sampled_from(TRAVERSAL_ORDERS), st.floats(0.5, 2.0))
@example(1, (0.1, 0.25, 0.0, 1.0), 2.3, Order.BACK_TO_FRONT, 1.0)
def test_a_closed_shell_has_no_holes_from_any_side_at_any_zoom(
    seed: int, rotation: tuple[float, float, float, float], zoom: float, order: Order, slices: float
) -> None:
    solid = lobes(seed)
    inside = eroded(solid, DEEP)
    assume(bool(inside.any()))
    geometry = Geometry((SIZE,) * 3, ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, slices)))
    scene = plain_scene(view=View(rotation=rotation, zoom=zoom), size=(72, 72), order=order)
    assume(zoom >= 1 or plan_frame(scene, geometry, Step.C).reach == Reach.PIXEL)
    shell, deep = (rendered(255.0 * voxels, geometry, scene, Step.C)[..., 3] for voxels in (skin_of(solid), inside))
    assert deep.any()
    assert (shell[deep > 0] == 1).all()


def test_such_a_shell_is_no_thicker_than_that() -> None:
    """Two of its voxels touch in a corner only, and what lies around that corner is not of the shell."""
    skin = skin_of(lobes(1))
    near, far = skin[:-1, :-1, :-1] & skin[1:, 1:, 1:], ~skin[:-1, 1:, :-1] & ~skin[1:, :-1, 1:]
    assert (near & far).any()
