"""What a slab can depend on: all voxels whose kernels reach it are held to be, and not many more."""

import itertools
import math
import random

from hypothesis import example, given
from hypothesis import strategies as st

from support.scenes.arbitrary import plain_scene, turns
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Reconstruction, SlabKernel, View
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.geometry import matrices
from volsplat.protocol.geometry.matrices import IDENTITY, Vector
from volsplat.protocol.rules.frame_plan import plan_frame
from volsplat.protocol.rules.packet_layout import DEPTH_BITS, SUBPIXEL_BITS
from volsplat.protocol.rules.slab_kernels import INNER_RADIUS
from volsplat.protocol.rules.slab_needs import Neighbourhood
from volsplat.protocol.rules.slab_shape import SlabShape

SKEWED = ((0.8, 0.1, 0.0), (0.0, 0.9, 0.0), (0.05, 0.0, 1.6))
TRIES = 300


def shape_of(
    rotation: tuple[float, float, float, float], zoom: float, slab: float, kernel: SlabKernel, geometry: Geometry
) -> SlabShape:
    scene = plain_scene(
        view=View(rotation=rotation, zoom=zoom), reconstruction=Reconstruction(slab=slab, slab_kernel=kernel)
    )
    slabs = plan_frame(scene, geometry, Step.G).slabs
    assert slabs is not None
    return slabs


def holds(neighbourhood: Neighbourhood, offset: Vector) -> bool:
    i, j, k = (max(abs(round(along)) - more, 0) for along, more in zip(offset, neighbourhood.box, strict=True))
    shape = neighbourhood.shape
    return k < len(shape) and j < len(shape[k]) and i <= shape[k][j]


@given(
    turns,
    st.floats(0.2, 5.0),
    st.floats(0.25, 2.0),
    st.sampled_from(SlabKernel),
    st.sampled_from([IDENTITY, SKEWED]),
    st.integers(0, 1 << 30),
)
@example((0.0, 0.0, 0.0, 1.0), 1.9, 1.0, SlabKernel.KAISER_BESSEL, IDENTITY, 0)
@example((0.3, 0.1, 0.2, 0.9), 0.25, 1.0, SlabKernel.GAUSSIAN, SKEWED, 0)
@example((0.3, 0.1, 0.2, 0.9), 1.9, 1.0, SlabKernel.BALANCED, SKEWED, 1)
def test_every_voxel_that_reaches_a_slab_is_held_to_be_needed(
    rotation: tuple[float, float, float, float],
    zoom: float,
    slab: float,
    kernel: SlabKernel,
    axes: matrices.Matrix,
    seed: int,
) -> None:
    shape = shape_of(rotation, zoom, slab, kernel, Geometry((9, 8, 7), axes))
    _, across, down, behind = shape.grid
    to_screen = matrices.inverse(matrices.transposed((across, down, behind)))
    rounded = 2.0 ** -(shape.offset_bits + 1) + 2.0 ** -(SUBPIXEL_BITS + 1), 1 / (2 << DEPTH_BITS)
    drawn = random.Random(seed)
    for _ in range(TRIES):
        middle: Vector = (drawn.uniform(-0.5, 0.5), drawn.uniform(-0.5, 0.5), drawn.uniform(-0.5, 0.5))
        on_plane = drawn.choice([-0.5, 0.5, -1.5, 1.5])  # gradients look at the planes in front and behind, too
        asides = [(0, 0), (0, 0), (shape.baseline, 0), (-shape.baseline, 0), (0, shape.baseline)]
        aside = drawn.choice(asides if abs(on_plane) < 1 else [(0, 0)])
        moved = [drawn.uniform(-rounded[0], rounded[0]) for _ in range(2)], drawn.uniform(-rounded[1], rounded[1])
        off: Vector = (aside[0] + moved[0][0], aside[1] + moved[0][1], on_plane + moved[1])
        # Somewhere within reach, and the voxel there
        reach: Vector = tuple(drawn.uniform(-extent, extent) for extent in shape.half_extents)  # type: ignore[assignment]
        place = matrices.plus(
            middle, matrices.applied(matrices.transposed((across, down, behind)), matrices.plus(off, reach))
        )
        voxel: Vector = (float(round(place[0])), float(round(place[1])), float(round(place[2])))
        from_plane = matrices.minus(matrices.applied(to_screen, matrices.minus(voxel, middle)), off)
        square = matrices.dot(from_plane, matrices.applied(shape.form, from_plane))
        if square >= shape.radius**2:
            continue
        assert holds(shape.needs, voxel)
        if aside == (0, 0) and abs(on_plane) < 1:
            assert holds(shape.looks, voxel)
            assert holds(shape.inner, voxel) or square >= INNER_RADIUS[kernel] ** 2


def test_no_more_is_looked_at_than_balls_hold_and_it_is_the_same_from_every_side() -> None:
    """Voxels are cubes: within the radius, half a slab and half a voxel's diagonal."""
    from_the_front = shape_of((0.0, 0.0, 0.0, 1.0), 2.0, 1.0, SlabKernel.KAISER_BESSEL, Geometry((9, 9, 9)))
    aslant = shape_of((0.3, 0.1, 0.2, 0.9), 2.0, 1.0, SlabKernel.KAISER_BESSEL, Geometry((9, 9, 9)))
    assert (from_the_front.looks, from_the_front.needs) == (aslant.looks, aslant.needs)
    farthest = from_the_front.radius + 0.5 + math.sqrt(3) / 2 + 0.1
    for offset in itertools.product(range(-4, 5), repeat=3):
        if math.hypot(*offset) > farthest:
            assert not holds(from_the_front.looks, (float(offset[0]), float(offset[1]), float(offset[2])))
