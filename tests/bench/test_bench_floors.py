"""The bare loops do the work that they stand for, on every CPU path."""

import pytest
import torch

from tolerances import SUM_OF_WEIGHTED_ADDS
from volsplat.bench import _kernels
from volsplat.bench.floors.cpu_paths import kernels_on

PATHS = _kernels.cpu_paths()


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("side", [4, 8, 12, 16])
def test_the_bare_splat_adds_weighted_samples_to_boxes_back_to_front(path: str, side: int) -> None:
    chance = torch.Generator().manual_seed(side)
    image = torch.rand((40, 50, 4), generator=chance)
    corners = torch.stack(
        (
            torch.randint(0, 50 - side + 1, (30,), generator=chance),
            torch.randint(0, 40 - side + 1, (30,), generator=chance),
        ),
        dim=1,
    ).int()
    weights = torch.rand((side, side, 1), generator=chance).expand(-1, -1, 4).contiguous()
    sample = torch.tensor([0.2, 0.4, 0.6, 1.0])
    expected = image.double()
    for x, y in corners.tolist():
        box = expected[y : y + side, x : x + side]
        box += weights * (sample - box)
    with kernels_on(_kernels, path):
        _kernels.BareSplat(image, corners, weights, sample).run()
    assert torch.allclose(image.double(), expected, rtol=0, atol=SUM_OF_WEIGHTED_ADDS)


def test_a_box_that_leaves_the_image_is_refused() -> None:
    image, weights, sample = torch.zeros((20, 20, 4)), torch.ones((8, 8, 4)), torch.ones(4)
    for corner in ((-1, 0), (0, -1), (13, 0), (0, 13)):
        with pytest.raises(ValueError, match="leaves the image"):
            _kernels.BareSplat(image, torch.tensor([corner], dtype=torch.int32), weights, sample)
    with pytest.raises(ValueError, match="4, 8, 12 or 16"):
        _kernels.BareSplat(image, torch.zeros((1, 2), dtype=torch.int32), torch.ones((6, 6, 4)), sample)


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("count", [0, 1, 1023, 1024, 5000])
def test_the_bare_map_shade_shades_the_visible_packets_in_their_order(path: str, count: int) -> None:
    chance = torch.Generator().manual_seed(count)
    packets = torch.randint(0, 1 << 31, (count,), generator=chance)
    opacity = torch.randint(0, 4096, (1 << 16,), generator=chance)
    opacity[torch.rand(1 << 16, generator=chance) < 0.9] = 0
    emit, refl = (200 * torch.rand((256, 4), generator=chance) for _ in range(2))
    light = torch.rand(1 << 15, generator=chance)
    shaded = torch.zeros(count, dtype=torch.uint64)
    with kernels_on(_kernels, path):
        sent = _kernels.bare_shade(packets.to(torch.uint32), opacity.to(torch.uint16), emit, refl, light, shaded)
    codes = opacity[packets & 0xFFFF]
    visible = packets[codes > 0]
    density = visible & 255
    colours = (emit[density] + refl[density] * light[visible >> 16 & 0x7FFF, None]).clamp(max=255)
    assert sent == len(visible)
    found = shaded[:sent].view(torch.int64)
    assert torch.equal(found >> 28 & 0xFFF, codes[codes > 0])
    for channel in range(3):
        level = found >> (40 + 8 * channel) & 255
        assert bool(((level - colours[:, channel]).abs() <= 1).all())
