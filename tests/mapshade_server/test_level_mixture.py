"""What voxels of coarser levels stand for: the kernel against the reference, and what tables become by it."""

import msgspec
import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from reference import level_mixtures
from support.scenes.arbitrary import plain_scene
from volsplat.mapshade_server import _kernels
from volsplat.mapshade_server.frames import shading_tables
from volsplat.mapshade_server.held.level_mixture import LevelMixture
from volsplat.mapshade_server.prepare.mixture_files import Mixture
from volsplat.protocol.description.scene import CrossBar, Field, Scene, Step
from volsplat.protocol.rules.packet_layout import BIN_BITS, NO_DATA_BIN, NO_DATA_BIT, STRENGTH_BINS, strength_bin
from volsplat.protocol.rules.shading_rule import ShadingRule, shading_rule

EXACT = 1e-12
SIZES = st.tuples(st.integers(1, 9), st.integers(1, 9), st.integers(1, 9))


def drawn_packets(dims: tuple[int, ...], seed: int, densities: int = 256) -> Tensor:
    """Some without data."""
    random = torch.Generator().manual_seed(seed)
    packets = torch.randint(0, 1 << 31, dims, generator=random)
    packets = packets & ~255 | packets % densities
    return packets | (torch.rand(dims, generator=random) < 0.1).long() << NO_DATA_BIT


def halves(dims: tuple[int, ...]) -> tuple[int, ...]:
    return tuple((n + 1) // 2 for n in dims)


def as_packets(packets: Tensor) -> "np.ndarray[tuple[int, ...], np.dtype[np.uint32]]":
    return packets.numpy().astype(np.uint32)


def made(finer: Tensor, coarser: Tensor) -> Mixture:
    return Mixture.of_voxels(as_packets(finer), as_packets(coarser))


def rows_of(mixture: Mixture) -> Tensor:
    keys = torch.from_numpy(mixture.keys.astype(np.int64))
    counts = torch.from_numpy(mixture.counts.astype(np.int64))
    return torch.stack((keys >> BIN_BITS, keys & (1 << BIN_BITS) - 1, counts), dim=1)


def test_bins_of_strength_rise_by_one_and_are_narrow_where_it_is_low() -> None:
    bins = [strength_bin(strength) for strength in range(256)]
    assert bins[:9] == [0, 1, 2, 3, 4, 5, 6, 7, 8] and bins[-1] == STRENGTH_BINS - 1
    assert all(here - before in (0, 1) for before, here in zip(bins, bins[1:], strict=False))
    assert all(bins.count(n) <= max(bins.index(n) / 4, 1) for n in range(STRENGTH_BINS))


@given(dims=SIZES, seed=st.integers(0, 1000))
def test_voxels_are_counted_as_by_the_reference(dims: tuple[int, ...], seed: int) -> None:
    finer, coarser = drawn_packets(dims, seed), drawn_packets(halves(dims), seed + 1)
    assert torch.equal(rows_of(made(finer, coarser)), level_mixtures.mixture(finer, coarser))


@given(seed=st.integers(0, 1000), at=st.sampled_from([2, 4, 6]), axis=st.integers(0, 2))
def test_parts_that_are_counted_apart_add_up(seed: int, at: int, axis: int) -> None:
    finer, coarser = drawn_packets((8, 7, 9), seed, 3), drawn_packets((4, 4, 5), seed + 1, 3)
    total = _kernels.MixtureCounts()
    for begin, end in ((0, at), (at, finer.shape[axis])):
        part = finer.narrow(axis, begin, end - begin)
        means = coarser.narrow(axis, begin // 2, (end + 1) // 2 - begin // 2)
        total.add(*(array.data for array in made(part, means)))
    assert torch.equal(rows_of(Mixture.of_counts(total)), rows_of(made(finer, coarser)))


@given(seed=st.integers(0, 1000), channels=st.integers(1, 3))
def test_tables_are_the_means_of_the_reference(seed: int, channels: int) -> None:
    levels = [drawn_packets(dims, seed + n, 5) for n, dims in enumerate([(9, 8, 5), (5, 4, 3), (3, 2, 2)])]
    table = torch.rand((65536, channels), dtype=torch.float64, generator=torch.Generator().manual_seed(seed))
    pairs = list(zip(levels, levels[1:], strict=False))
    mixture = None
    for finer, coarser in pairs:
        mixture = LevelMixture(mixture, *made(finer, coarser))
    assert mixture is not None
    expected = level_mixtures.level_table(table, [level_mixtures.mixture(*pair) for pair in pairs])
    got = torch.from_numpy(mixture.means(table.numpy()))
    assert (got - expected).abs().max() <= EXACT and got.max() > 0


@pytest.mark.parametrize(
    ("keys", "counts"),
    [
        ([5, 5], [1, 1]),
        ([6, 5], [1, 1]),
        ([5], [0]),
        ([5], [1, 1]),
        ([NO_DATA_BIN << BIN_BITS], [1]),
        ([NO_DATA_BIN + 1], [1]),
        ([(1 << 32) - 1], [1]),
    ],
)
def test_what_is_no_mixture_is_refused(keys: list[int], counts: list[int]) -> None:
    with pytest.raises(ValueError, match=r"mixture|key needs a count"):
        LevelMixture(None, np.array(keys, np.uint32), np.array(counts, np.uint64))


def half_and_half() -> LevelMixture:
    """Voxels of density 100 that stand for as many of 50 as of 150, none of which has a gradient."""
    finer = torch.tensor([50, 150] * 4).reshape(2, 2, 2)
    return LevelMixture(None, *made(finer, torch.tensor([[[100]]])))


def black_and_white() -> Scene:
    return plain_scene().with_(
        opac=[(0.0, 0.0), (0.4, 0.0), (0.41, 0.5), (1.0, 0.5)], refl=[(0.0, "red"), (0.4, "red"), (0.41, "blue")]
    )


def test_a_voxel_is_as_opaque_and_has_the_colour_of_what_it_stands_for() -> None:
    shading, mixture = shading_rule(black_and_white(), Step.F), half_and_half()
    opacity = shading_tables.mixed_opacity(shading_tables.opacity_rule(shading, mixture))
    assert opacity[100] == pytest.approx(0.25)
    colours = shading_tables.frame_colours(shading, mixture)
    assert colours.of_plane and np.asarray(colours.refl)[100].tolist() == pytest.approx([0.0, 0.0, 1.0, 0.0])


def indexed(scene: Scene, **fields: Field) -> ShadingRule:
    return shading_rule(msgspec.structs.replace(scene, cross_bar=CrossBar(**fields)), Step.F)


def test_what_no_table_of_both_bytes_says_is_the_voxel_s_own() -> None:
    """An opacity that a place modulates, and colours of a place."""
    scene, mixture = black_and_white(), half_and_half()
    by_depth = indexed(scene, opac=Field.SCREEN_Z)
    assert not shading_tables.opacity_rule(by_depth, mixture).is_mixed
    by_place = indexed(scene, refl=Field.GRID_K)
    assert shading_tables.opacity_rule(by_place, mixture).is_mixed
    assert not shading_tables.frame_colours(by_place, mixture).of_plane
