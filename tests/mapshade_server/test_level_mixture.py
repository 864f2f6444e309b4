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
from support.scenes.level_packets import FACTORS, SIZES, as_packets, drawn_packets, halves
from volsplat.mapshade_server._kernels import MixtureEntries, mixture_of
from volsplat.mapshade_server.frames import shading_tables
from volsplat.mapshade_server.held.level_mixture import LevelMixture
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.shading_tables import CrossBar, Field
from volsplat.protocol.rules.packet_layout import BIN_BITS, NO_DATA_BIN, STRENGTH_BINS, strength_bin
from volsplat.protocol.rules.shading_rule import ShadingRule, shading_rule

EXACT = 1e-12


def made(finer: Tensor, coarser: Tensor) -> MixtureEntries:
    return mixture_of(as_packets(finer).data, as_packets(coarser).data)


def level_mixture(finer: LevelMixture | None, entries: MixtureEntries) -> LevelMixture:
    return LevelMixture(finer, np.asarray(entries.keys), np.asarray(entries.counts))


def rows_of(mixture: MixtureEntries) -> Tensor:
    keys, counts = (torch.from_numpy(np.asarray(each).astype(np.int64)) for each in (mixture.keys, mixture.counts))
    return torch.stack((keys >> BIN_BITS, keys & (1 << BIN_BITS) - 1, counts), dim=1)


def test_bins_of_strength_rise_by_one_and_are_narrow_where_it_is_low() -> None:
    bins = [strength_bin(strength) for strength in range(256)]
    assert bins[:9] == [0, 1, 2, 3, 4, 5, 6, 7, 8] and bins[-1] == STRENGTH_BINS - 1
    assert all(here - before in (0, 1) for before, here in zip(bins, bins[1:], strict=False))
    assert all(bins.count(n) <= max(bins.index(n) / 4, 1) for n in range(STRENGTH_BINS))


@given(dims=SIZES, factors=FACTORS, seed=st.integers(0, 1000))
def test_voxels_are_counted_as_by_the_reference(dims: tuple[int, ...], factors: tuple[int, ...], seed: int) -> None:
    finer, coarser = drawn_packets(dims, seed), drawn_packets(halves(dims, factors), seed + 1)
    assert torch.equal(rows_of(made(finer, coarser)), level_mixtures.mixture(finer, coarser))


def no_entries() -> MixtureEntries:
    return MixtureEntries(np.empty(0, np.uint32).data, np.empty(0, np.uint64).data, 0)


@given(seed=st.integers(0, 1000), at=st.sampled_from([2, 4, 6]), axis=st.integers(0, 2))
def test_parts_that_are_counted_apart_add_up(seed: int, at: int, axis: int) -> None:
    finer, coarser = drawn_packets((8, 7, 9), seed, 3), drawn_packets((4, 4, 5), seed + 1, 3)
    total = no_entries()
    for begin, end in ((0, at), (at, finer.shape[axis])):
        part = finer.narrow(axis, begin, end - begin)
        means = coarser.narrow(axis, begin // 2, (end + 1) // 2 - begin // 2)
        total.add(made(part, means))
    assert torch.equal(rows_of(total), rows_of(made(finer, coarser)))


def noise(seed: int, coarse: range, count: int) -> MixtureEntries:
    """One voxel for each of so many keys, of these bins of the coarser level."""
    random = np.random.default_rng(seed)
    bins = random.integers(coarse.start, coarse.stop, count), random.integers(0, NO_DATA_BIN + 1, count)
    keys = np.unique(bins[0] << BIN_BITS | bins[1]).astype(np.uint32)
    return MixtureEntries(keys.data, np.ones(len(keys), np.uint64).data, 0)


def test_of_noise_as_much_is_left_open_as_memory_asks_whatever_is_added_first() -> None:
    parts = [noise(seed, range(300 * seed, 300 * seed + 400), 600_000) for seed in range(4)]
    one_way, other_way = no_entries(), no_entries()
    for part, part_from_the_end in zip(parts, reversed(parts), strict=True):
        one_way.add(part)
        other_way.add(part_from_the_end)
    assert one_way.left_open == other_way.left_open > 0
    rows = rows_of(one_way)
    assert torch.equal(rows, rows_of(other_way)) and len(rows) <= 1 << 20
    assert int(rows[:, 2].sum()) == sum(int(rows_of(part)[:, 2].sum()) for part in parts)
    finer = rows[:, 1][rows[:, 1] != NO_DATA_BIN]
    half = 1 << one_way.left_open - 1
    assert bool((finer % (2 * half) == half).all()) and bool((rows[:, 1] == NO_DATA_BIN).any())


def test_noise_that_is_counted_apart_adds_up_to_what_is_counted_at_once() -> None:
    finer, coarser = drawn_packets((128, 128, 128), 1), drawn_packets((64, 64, 64), 2)
    whole = made(finer, coarser)
    total = made(finer[:32], coarser[:16])
    total.add(made(finer[32:], coarser[16:]))
    assert whole.left_open == total.left_open > 0 and torch.equal(rows_of(whole), rows_of(total))


@given(seed=st.integers(0, 1000), channels=st.integers(1, 3))
def test_tables_are_the_means_of_the_reference(seed: int, channels: int) -> None:
    levels = [drawn_packets(dims, seed + n, 5) for n, dims in enumerate([(9, 8, 5), (5, 4, 3), (3, 2, 2)])]
    table = torch.rand((65536, channels), dtype=torch.float64, generator=torch.Generator().manual_seed(seed))
    pairs = list(zip(levels, levels[1:], strict=False))
    mixture = None
    for finer, coarser in pairs:
        mixture = level_mixture(mixture, made(finer, coarser))
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
    return level_mixture(None, made(finer, torch.tensor([[[100]]])))


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
