"""Bit-identical images: for any partition, batches, arrival, regions, threads, walkers and mix of CPU paths."""

from collections.abc import Iterator
from random import Random

import msgspec
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from support.scenes.arbitrary import bounds_within, index_to_physical, plain_scene, quaternions
from support.scenes.partitions import cut, handed_out
from support.scenes.phantoms import shaded_scene, shells
from support.scenes.rendering import rendered
from tolerances import BETWEEN_CPU_PATHS, ONE_LEVEL
from volsplat.mapshade_server import _kernels as mapshade_kernels
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import TRAVERSAL_ORDERS, Bounds, Order, Reconstruction, Scene, SlabKernel, View
from volsplat.protocol.description.volume import Box, Geometry, Index
from volsplat.protocol.geometry.matrices import IDENTITY, Matrix
from volsplat.protocol.rules.closed_tiles import FROZEN_ALPHA
from volsplat.splat_server import _kernels as splat_kernels

SIZE = 14
VALUES = shells(SIZE)
VALUES[3:5, 7, :4] = torch.nan
DIMS: Index = (SIZE, SIZE, SIZE)


@pytest.fixture
def restored_cpu_paths() -> Iterator[None]:
    before = mapshade_kernels.cpu_path(), splat_kernels.cpu_path()
    yield
    mapshade_kernels.set_cpu_path(before[0])
    splat_kernels.set_cpu_path(before[1])


@given(
    seed=st.integers(0, 2**32),
    workers=st.integers(1, 8),
    cuts=st.integers(0, 12),
    max_packets=st.sampled_from((1, 7, 100, 1 << 15)),
    max_voxels=st.sampled_from((1, 50, 1 << 20)),
    rotation=quaternions,
    zoom=st.sampled_from((0.3, 0.8, 1.0, 2.01, 5.0)),
    matrix=st.one_of(st.just(IDENTITY), index_to_physical()),
    bounds=st.one_of(st.just(Bounds()), bounds_within(DIMS)),
    order=st.sampled_from(TRAVERSAL_ORDERS),
    step=st.sampled_from((Step.A, Step.B, Step.C, Step.F, Step.G)),
    threads=st.sampled_from((1, 2, 5)),
    walkers=st.sampled_from((1, 3, None)),
    shadows=st.sampled_from((0.0, 0.8)),
    slab_kernel=st.sampled_from((SlabKernel.BALANCED, SlabKernel.KAISER_BESSEL, SlabKernel.QUASI_INTERPOLATING)),
)
def test_image_is_the_same_for_any_partition_batches_arrival_regions_and_threads(
    seed: int,
    workers: int,
    cuts: int,
    max_packets: int,
    max_voxels: int,
    rotation: tuple[float, float, float, float],
    zoom: float,
    matrix: Matrix,
    bounds: Bounds,
    order: Order,
    step: Step,
    threads: int,
    walkers: int | None,
    shadows: float,
    slab_kernel: SlabKernel,
) -> None:
    random = Random(seed)
    geometry = Geometry(DIMS, matrix)
    scene = shaded_scene(View(rotation=rotation, zoom=zoom), (24, 30), order)
    light = msgspec.structs.replace(scene.light, shadows=shadows, occlusion=shadows)
    reconstruction = Reconstruction(slab_kernel=slab_kernel)
    scene = msgspec.structs.replace(scene, bounds=bounds, light=light, reconstruction=reconstruction)
    expected = rendered(VALUES, geometry, scene, step)
    holdings = handed_out(cut(geometry.box, random, cuts), workers, random)
    image = rendered(
        VALUES,
        geometry,
        scene,
        step,
        workers=holdings,
        max_packets=max_packets,
        max_voxels=max_voxels,
        threads=threads,
        walkers=walkers,
        arrival=random,
    )
    assert torch.equal(image, expected)


@pytest.mark.parametrize("workers", [1, 2, 3, 4, 8])
@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("order", TRAVERSAL_ORDERS)
def test_image_is_the_same_for_slices_along_any_axis(workers: int, axis: int, order: Order) -> None:
    geometry = Geometry(DIMS)
    scene = shaded_scene(View(rotation=(0.2, 0.3, 0.1, 0.9), zoom=2.5), (50, 50), order)
    ends = [SIZE * n // workers for n in range(workers + 1)]
    holdings = []
    for start, stop in zip(ends, ends[1:], strict=False):
        low, high = [0, 0, 0], list(DIMS)
        low[axis], high[axis] = start, stop
        holdings.append([Box((low[0], low[1], low[2]), (high[0], high[1], high[2]))])
    for step in Step:
        expected = rendered(VALUES, geometry, scene, step)
        assert expected.any()
        assert torch.equal(rendered(VALUES, geometry, scene, step, workers=holdings, arrival=Random(workers)), expected)


@pytest.mark.parametrize("kernel", [SlabKernel.BALANCED, SlabKernel.KAISER_BESSEL, SlabKernel.QUASI_INTERPOLATING])
@pytest.mark.parametrize("sheets", [0, 1, 2])
def test_the_same_voxels_are_needed_in_a_large_sub_cube_as_in_small_ones(sheets: int, kernel: SlabKernel) -> None:
    """What a server finds some rows at a time; towards other sub-cubes it takes all that may be needed."""
    values = shells(SIZE).repeat(3, 5, 3)[:36, :70, :40]
    values[20, 33, 30:34] = torch.nan
    geometry = Geometry((40, 70, 36))
    rotation = ((0.1, 0.7, 0.1, 0.7), (0.7, 0.1, 0.0, 0.7), (0.05, 0.1, 0.0, 1.0))[sheets]
    scene = shaded_scene(View(rotation=rotation, zoom=1.3), (96, 96), Order.FRONT_TO_BACK)
    scene = msgspec.structs.replace(scene, reconstruction=Reconstruction(slab_kernel=kernel))
    holdings = handed_out(cut(geometry.box, Random(sheets), 9), 2, Random(1))
    cut_up = rendered(values, geometry, scene, Step.G, workers=holdings)
    assert cut_up.any() and torch.equal(rendered(values, geometry, scene, Step.G), cut_up)


@pytest.mark.parametrize("step", [Step.A, Step.C, Step.F, Step.G])
def test_workers_may_run_on_any_cpu_path(step: Step, restored_cpu_paths: None) -> None:
    geometry = Geometry(DIMS)
    scene = shaded_scene(View(rotation=(0.2, 0.3, 0.1, 0.9), zoom=2.5), (50, 50))
    images = []
    for path in mapshade_kernels.cpu_paths():
        mapshade_kernels.set_cpu_path(path)
        images.append(rendered(VALUES, geometry, scene, step))
    assert len(images) >= 1
    assert all(torch.equal(image, images[0]) for image in images)


@pytest.mark.parametrize("order", TRAVERSAL_ORDERS)
@pytest.mark.parametrize("step", [Step.A, Step.C, Step.F, Step.G])
def test_splat_server_s_cpu_paths_agree(step: Step, order: Order, restored_cpu_paths: None) -> None:
    geometry = Geometry(DIMS)
    scene = shaded_scene(View(rotation=(0.2, 0.3, 0.1, 0.9), zoom=2.5), (50, 50), order)
    images = []
    for path in splat_kernels.cpu_paths():
        splat_kernels.set_cpu_path(path)
        images.append(rendered(VALUES, geometry, scene, step))
        assert torch.equal(rendered(VALUES, geometry, scene, step, threads=7), images[-1])
    assert all((image - images[0]).abs().max() <= BETWEEN_CPU_PATHS for image in images)


@given(quaternions, st.floats(0.3, 6.0), st.sampled_from((0.05, 0.3, 0.9)))
def test_splat_server_s_cpu_paths_part_only_where_one_of_them_freezes_a_pixel(
    rotation: tuple[float, float, float, float], zoom: float, opacity: float
) -> None:
    """What comes after that may change the others' by what is left to be seen through it."""
    view = View(rotation=rotation, zoom=zoom)
    scene = plain_scene(opacity, view=view, size=(32, 32), order=Order.FRONT_TO_BACK)
    images = [rendered_on(path, scene) for path in splat_kernels.cpu_paths()]
    for image in images[1:]:
        apart = (image - images[0]).abs().amax(dim=2)
        frozen = torch.minimum(image[..., 3], images[0][..., 3]) >= FROZEN_ALPHA - BETWEEN_CPU_PATHS
        assert apart[~frozen].numel() == 0 or apart[~frozen].max() <= BETWEEN_CPU_PATHS
        assert apart.max() <= 1 - FROZEN_ALPHA + BETWEEN_CPU_PATHS


def rendered_on(path: str, scene: Scene) -> Tensor:
    before = splat_kernels.cpu_path()
    splat_kernels.set_cpu_path(path)
    try:
        return rendered(VALUES, Geometry(DIMS), scene, Step.F)
    finally:
        splat_kernels.set_cpu_path(before)


@given(quaternions, st.sampled_from((0.5, 1.0, 1.73, 4.0)), st.sampled_from(Step), st.sampled_from((1e-3, 0.1, 1.0)))
def test_both_orders_give_one_image(
    rotation: tuple[float, float, float, float], zoom: float, step: Step, opacity: float
) -> None:
    geometry = Geometry(DIMS)
    view = View(rotation=rotation, zoom=zoom)
    for scene in (shaded_scene(view, (32, 32)), plain_scene(opacity, view=view, size=(32, 32))):
        one = rendered(VALUES, geometry, msgspec.structs.replace(scene, order=Order.BACK_TO_FRONT), step)
        two = rendered(VALUES, geometry, msgspec.structs.replace(scene, order=Order.FRONT_TO_BACK), step)
        assert (one - two).abs().max() <= ONE_LEVEL
