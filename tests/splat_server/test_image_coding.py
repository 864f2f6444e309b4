"""Images that are coded by a splat server are what the client decodes: bit for bit, or by 8 bits a channel."""

import numpy as np
import pytest
import zstandard
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from volsplat.client.session.image_decoder import ImageDecoder
from volsplat.protocol.description.scene import Step
from volsplat.protocol.messages.image_messages import CodedPixels, ImageRead, RawPixels
from volsplat.protocol.rules.image_tiles import IMAGE_TILE_SIDE, image_tiles, tile_bytes
from volsplat.protocol.text.errors import RemoteProtocolError
from volsplat.splat_server.image_coder import ImageCoder

SIZES = st.sampled_from([1, 7, IMAGE_TILE_SIDE, IMAGE_TILE_SIDE + 1, 2 * IMAGE_TILE_SIDE, 75])
LEVEL = np.float32(1 / 255)
ODD = np.array([0.0, -0.0, 1.0, 2**-149, -(2**-140), 3.4e38, 0.5, np.nextafter(np.float32(1), 0)], np.float32)

Pixels = NDArray[np.float32]


def read(width: int, height: int) -> ImageRead:
    return ImageRead(1, Step.F, True, 0, 0, width, height, RawPixels())


def drawn(width: int, height: int, seed: int) -> Pixels:
    """Noise within a box, nothing around it; some of it odd numbers."""
    random = np.random.default_rng(seed)
    pixels = np.zeros((height, width, 4), np.float32)
    left, top = random.integers(0, width), random.integers(0, height)
    box = pixels[top : top + height // 2 + 1, left : left + width // 2 + 1]
    box[...] = random.random(box.shape, np.float32)
    odd = random.random(box.shape) < 0.1
    box[odd] = random.choice(ODD, odd.sum())
    return pixels


class Link:
    """A coder, and the decoder at the other end."""

    def __init__(self) -> None:
        self.coder = ImageCoder()
        self._decoder = ImageDecoder()

    def sends(self, pixels: Pixels, exact: bool) -> tuple[CodedPixels, Pixels]:
        image = read(pixels.shape[1], pixels.shape[0])
        told, payload = self.coder.coded(image, pixels.data.cast("B"), exact)
        joined = b"".join(payload)
        assert len(joined) == told.bytes
        return told, self.decoded(image, told, joined)

    def decoded(self, image: ImageRead, told: CodedPixels, payload: bytes) -> Pixels:
        target = bytearray(image.raw_bytes)
        self._decoder.decode(image, told, memoryview(payload), memoryview(target))
        return np.frombuffer(target, np.float32).reshape(image.height, image.width, 4)


@given(st.lists(st.tuples(SIZES, SIZES, st.integers(0, 3), st.booleans()), min_size=1, max_size=6))
def test_images_in_their_order_are_what_they_were(images: list[tuple[int, int, int, bool]]) -> None:
    link, before = Link(), None
    for width, height, seed, exact in images:
        pixels = drawn(width, height, seed)
        told, shown = link.sends(pixels, exact)
        assert told.exact is exact and told.follows == (before == (width, height, exact))
        before = width, height, exact
        if exact:
            assert (shown.view(np.uint32) == pixels.view(np.uint32)).all()
        else:
            # Half a level, and what float32 adds to it.
            assert np.abs(shown - pixels.clip(0, 1)).max() <= 0.5 * LEVEL + 2**-23


@given(SIZES, SIZES, st.booleans(), st.integers(0, 9))
def test_what_has_not_changed_does_not_travel(width: int, height: int, exact: bool, seed: int) -> None:
    link, pixels = Link(), drawn(width, height, seed)
    rows, columns = image_tiles(width, height)
    nothing = -(-rows * columns // 8) + len(zstandard.compress(b""))
    assert link.sends(np.zeros_like(pixels), exact)[0].bytes <= nothing
    link.sends(pixels, exact)
    told, shown = link.sends(pixels, exact)
    assert told.follows and told.bytes <= nothing
    assert not exact or (shown.view(np.uint32) == pixels.view(np.uint32)).all()


def test_after_an_image_that_went_another_way_a_whole_one_comes() -> None:
    link, pixels = Link(), drawn(40, 40, 1)
    link.sends(pixels, True)
    link.coder.forget()
    told, shown = link.sends(pixels, True)
    assert not told.follows and (shown == pixels).all()


@pytest.mark.parametrize("exact", [False, True])
def test_an_image_that_follows_none_is_refused(exact: bool) -> None:
    coder, pixels = ImageCoder(), drawn(40, 40, 1)
    for _ in range(2):
        told, payload = coder.coded(read(40, 40), pixels.data.cast("B"), exact)
    with pytest.raises(RemoteProtocolError, match=r"^the image of frame 1 follows another one that has not come$"):
        Link().decoded(read(40, 40), told, b"".join(payload))


@pytest.mark.parametrize(
    ("payload", "fault"),
    [
        (b"", "does not say which have changed"),
        (b"\x1f", "does not say which have changed"),
        (b"\x01", "cannot be decompressed|have"),
        (b"\x01no frame of zstd", "cannot be decompressed"),
        (b"\x01" + zstandard.compress(bytes(tile_bytes(False) - 1)), "have 4095 bytes, but 4096 are announced"),
        (b"\x03" + zstandard.compress(bytes(tile_bytes(False))), "have 4096 bytes, but 8192 are announced"),
        (b"\x01" + zstandard.compress(bytes(1 << 26)), "have 67108864 bytes, but 4096 are announced"),
        (
            b"\x01" + zstandard.ZstdCompressor(write_content_size=False).compress(bytes(1 << 26)),
            "have -1 bytes, but 4096 are announced",
        ),
        (b"\x01" + zstandard.compress(bytes(tile_bytes(False))) + b"more", "cannot be decompressed"),
        (b"\x01" + zstandard.compress(bytes(tile_bytes(False)))[:-2], "cannot be decompressed|have"),
    ],
)
def test_a_payload_that_is_no_image_is_refused_in_a_line(payload: bytes, fault: str) -> None:
    with pytest.raises(RemoteProtocolError, match=fault) as refused:
        Link().decoded(read(64, 64), CodedPixels(False, False, len(payload), 0.0), payload)
    assert "\n" not in str(refused.value)


@given(st.binary(max_size=300), st.booleans())
def test_any_payload_is_decoded_or_refused(payload: bytes, exact: bool) -> None:
    try:
        Link().decoded(read(64, 64), CodedPixels(exact, False, len(payload), 0.0), payload)
    except RemoteProtocolError:
        pass


def test_a_coded_image_must_not_be_longer_than_itself() -> None:
    with pytest.raises(ValueError, match="an image of 64 bytes has been coded as 65"):
        read(2, 2).carried_by(CodedPixels(True, False, 65, 0.0)).payload_bytes()
