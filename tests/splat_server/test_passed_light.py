"""How much light comes through blocks: where what must come is known."""

import math
import struct

import pytest

from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.rules.light_blocks import (
    DEPTH_UNIT,
    SKY,
    LightBlocks,
    light_block_dims,
    light_block_size,
    light_step,
)
from volsplat.splat_server._kernels import PassedLight

CUBE = Geometry(dims=(8, 8, 8))
ONE = (1, 1, 1)


def passed(depths: list[int], dims: tuple[int, int, int], *directions: tuple[float, float, float]) -> PassedLight:
    steps = [light_step(direction, CUBE, ONE, ONE) for direction in directions]
    raw = struct.pack(f"<{len(depths)}H", *depths)
    return PassedLight(raw, DEPTH_UNIT, dims, [(step.step, step.length) for step in steps])


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("way", [1, -1])
def test_along_an_axis_each_block_dims_those_behind_it(axis: int, way: int) -> None:
    direction = [0.0, 0.0, 0.0]
    direction[axis] = 3.0 * way
    light = passed([DEPTH_UNIT // 2] * 125, (5, 5, 5), (direction[0], direction[1], direction[2]))
    for n in range(5):
        at = [2, 2, 2]
        at[axis] = n
        before = 4 - n if way > 0 else n
        assert light.share(*at) == pytest.approx(math.exp(-0.5 * before), rel=1e-6)


def test_a_shadow_lies_away_from_the_light_and_grows_softer() -> None:
    depths = [0] * (9 * 9 * 9)
    depths[(8 * 9 + 4) * 9 + 4] = 65535  # (4, 4, 8)
    light = passed(depths, (9, 9, 9), (0.5, 0.0, 1.0))
    assert light.share(4, 4, 8) == 1.0  # it does not shade itself
    assert light.share(2, 4, 4) < 0.7  # half as far aside as behind
    assert light.share(6, 4, 4) == light.share(2, 7, 4) == 1.0
    darkest = [min(light.share(i, 4, k) for i in range(9)) for k in (6, 4, 2)]
    assert darkest == sorted(darkest)


def test_half_of_the_sky_is_open_on_a_plane_and_what_comes_along_it() -> None:
    depths = [65535 if k == 0 else 0 for k in range(5) for _ in range(625)]
    light = passed(depths, (25, 25, 5), *SKY)
    along = sum(way[2] == 0.0 for way in SKY)
    assert light.share(12, 12, 1) == pytest.approx((20 + along) / 40, abs=1e-3)


def test_the_sky_is_as_bright_from_all_sides() -> None:
    for axis in range(3):
        assert sum(way[axis] for way in SKY) == pytest.approx(0.0)
        assert sum(way[axis] ** 2 for way in SKY) == pytest.approx(len(SKY))
    assert len(SKY) == 20


@pytest.mark.parametrize("depths", [b"", bytes(7), bytes(10)])
def test_other_depths_than_blocks_are_refused(depths: bytes) -> None:
    with pytest.raises(ValueError, match="depths"):
        LightBlocks((1, 1, 1), (2, 2, 1), depths, 0.5, 0.5)
    with pytest.raises(ValueError, match="as many blocks"):
        PassedLight(depths, DEPTH_UNIT, (2, 2, 1), [((1.0, 0.0, 0.0), 1.0)])


@pytest.mark.parametrize("step", [(0.5, 0.5, 0.5), (2.0, 1.0, 0.0), (math.nan, 0.0, 0.0)])
def test_steps_that_miss_slices_are_refused(step: tuple[float, float, float]) -> None:
    with pytest.raises(ValueError, match="slice to slice"):
        PassedLight(bytes(2), DEPTH_UNIT, (1, 1, 1), [(step, 1.0)])


def test_blocks_cover_every_volume() -> None:
    for dims in ((1, 63, 64), (65, 256, 1000), (96, 128, 113)):
        size, blocks = light_block_size(dims), light_block_dims(dims)
        assert all(b <= 64 and (b - 1) * s < d <= b * s for s, b, d in zip(size, blocks, dims, strict=True))
