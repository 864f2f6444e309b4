"""An asymmetric phantom stored in all 48 flips and orders of its axes gives the same picture."""

import itertools

import pytest
from torch import Tensor

from support.scenes.phantoms import shaded_scene, shells
from support.scenes.rendering import rendered
from tolerances import HANDEDNESS
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Order, View
from volsplat.protocol.description.volume import Geometry, Index
from volsplat.protocol.geometry import matrices
from volsplat.protocol.geometry.matrices import Matrix, Vector

SKEWED: Matrix = ((1.0, 0.1, 0.0), (0.0, 0.8, 0.3), (0.05, 0.0, 1.3))
SIZE = 18
VIEW = View(rotation=(0.31, -0.17, 0.43, 0.75), zoom=1.9)


def phantom() -> Tensor:
    return shells(SIZE)[1:, :-2, :]  # no two sides alike


def stored(order: Index, flips: tuple[bool, bool, bool]) -> tuple[Tensor, Geometry]:
    """The phantom with its new axis n running along the old axis order[n], backwards where flipped."""
    values = phantom()
    dims = (values.shape[2], values.shape[1], values.shape[0])
    kept = values.permute(2, 1, 0).permute(order)
    kept = kept.flip([axis for axis in range(3) if flips[axis]]).permute(2, 1, 0).contiguous()
    columns: list[Vector] = []
    origin: Vector = (7.0, -3.0, 11.0)
    for axis, flipped in zip(order, flips, strict=True):
        step = matrices.column(SKEWED, axis)
        if flipped:
            origin = matrices.plus(origin, matrices.scaled(step, dims[axis] - 1))
        columns.append(matrices.scaled(step, -1.0 if flipped else 1.0))
    matrix = matrices.transposed((columns[0], columns[1], columns[2]))
    return kept, Geometry((kept.shape[2], kept.shape[1], kept.shape[0]), matrix, origin)


@pytest.mark.parametrize("flips", list(itertools.product((False, True), repeat=3)))
@pytest.mark.parametrize("order", list(itertools.permutations(range(3))))
def test_picture_is_the_same_however_the_axes_are_stored(order: Index, flips: tuple[bool, bool, bool]) -> None:
    values, geometry = stored(order, flips)
    as_it_was, original = stored((0, 1, 2), (False, False, False))
    for step, combining in (
        (Step.C, Order.FRONT_TO_BACK),
        (Step.D, Order.FRONT_TO_BACK),
        (Step.F, Order.BACK_TO_FRONT),
        (Step.G, Order.FRONT_TO_BACK),
    ):
        scene = shaded_scene(VIEW, (48, 48), combining)
        expected = rendered(as_it_was, original, scene, step)
        assert expected[..., 3].max() > 0.9
        assert (rendered(values, geometry, scene, step) - expected).abs().max() <= HANDEDNESS


def test_the_phantom_has_no_symmetry_that_could_hide_a_mirror() -> None:
    values, geometry = stored((0, 1, 2), (False, False, False))
    scene = shaded_scene(VIEW, (48, 48))
    image = rendered(values, geometry, scene, Step.F)
    for mirrored in (image.flip(0), image.flip(1), image.flip((0, 1)), image.transpose(0, 1)):
        assert (image - mirrored).abs().max() > 25 * HANDEDNESS
    for axis in range(3):
        other = rendered(values.flip(axis).contiguous(), geometry, scene, Step.F)
        assert (image - other).abs().max() > 25 * HANDEDNESS
