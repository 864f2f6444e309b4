"""What is seen of opaque, missing and cut voxels."""

import itertools
import math

import msgspec
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from support.scenes.arbitrary import plain_scene, quaternion_to
from support.scenes.rays import OBLIQUE, constant, pixels_per_index
from support.scenes.rendering import rendered
from tolerances import ROUNDED_COLOUR
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import TRAVERSAL_ORDERS, Bounds, Order, View
from volsplat.protocol.description.shading_tables import ColourTable
from volsplat.protocol.description.volume import Geometry


@pytest.mark.parametrize("order", TRAVERSAL_ORDERS)
@pytest.mark.parametrize("signs", list(itertools.product((1, -1), repeat=3)))
@pytest.mark.parametrize("axes", list(itertools.permutations(range(3))))
def test_of_an_opaque_cube_the_nearest_voxels_show_in_all_48_traversals(
    axes: tuple[int, int, int], signs: tuple[int, int, int], order: Order
) -> None:
    dims = (5, 6, 7)
    toward = [0.0, 0.0, 0.0]
    for axis, sign, size in zip(axes, signs, (1.0, 0.1, 0.01), strict=True):
        toward[axis] = sign * size
    geometry = Geometry(dims)
    values = 20 + torch.arange(5 * 6 * 7).reshape(7, 6, 5).double()
    grey = ColourTable(points=((0.0, (0.0, 0.0, 0.0)), (1.0, (1.0, 1.0, 1.0))))
    view = View(rotation=quaternion_to((toward[0], toward[1], toward[2])), zoom=6.0)
    scene = plain_scene(view=view, size=(64, 64), order=order)
    scene = msgspec.structs.replace(scene, tables=msgspec.structs.replace(scene.tables, emit=grey))
    image = rendered(values, geometry, scene, Step.C)

    middle = (torch.tensor(dims).double() - 1) / 2
    every = torch.cartesian_prod(*(torch.arange(n) for n in dims))
    screen = (every - middle) @ pixels_per_index(geometry, scene).T
    nearest_sheet = 0 if signs[0] < 0 else dims[axes[0]] - 1
    front = every[:, axes[0]] == nearest_sheet
    for (i, j, k), (x, y, _) in zip(every[front].tolist(), screen[front].tolist(), strict=True):
        pixel = image[round(31.5 + y), round(31.5 + x)]
        assert (pixel[:3] - float(values[k, j, i]) / 255).abs().max() <= ROUNDED_COLOUR
        assert pixel[3] == 1


def test_nan_is_transparent() -> None:
    geometry = Geometry((9, 9, 9))
    values = constant(geometry.dims)
    values[:, :, 5:] = math.nan
    without = constant(geometry.dims)
    without[:, :, 5:] = 0.0
    for step in Step:
        scene = plain_scene(0.5, view=View(rotation=OBLIQUE, zoom=2.0), size=(32, 32))
        image = rendered(values, geometry, scene, step)
        assert not image.isnan().any()
        assert image[..., 3].max() > 0.3
        # Neither light nor modulation is at work before E, so that the NaN could as well be transparent zeros.
        if step < Step.E:
            assert torch.equal(image, rendered(without, geometry, scene, step))
    nothing = constant(geometry.dims, math.nan)
    assert not rendered(nothing, geometry, plain_scene(view=View(zoom=2.0)), Step.F).any()


@given(st.integers(1, 4), st.integers(1, 6))
def test_bounds_show_what_a_volume_cut_to_them_would(low: int, size: int) -> None:
    geometry = Geometry((12, 12, 12))
    values = constant(geometry.dims)
    bounded = msgspec.structs.replace(
        plain_scene(0.5, view=View(zoom=3.0), size=(48, 48)),
        bounds=Bounds(low=(low, 0, 0), high=(low + size, -1, -1)),
    )
    zeroed = torch.zeros_like(values)
    zeroed[:, :, low : low + size] = 255.0
    whole = msgspec.structs.replace(bounded, bounds=plain_scene().bounds)
    for step in (Step.C, Step.D):
        assert torch.equal(rendered(values, geometry, bounded, step), rendered(zeroed, geometry, whole, step))
