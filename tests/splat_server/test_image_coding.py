"""Images that are coded by a splat server are what the client decodes: bit for bit, or by 8 bits a channel."""

from collections.abc import Iterator
from contextlib import closing, contextmanager

import msgspec
import numpy as np
import pytest
import zstandard
from hypothesis import example, given
from hypothesis import strategies as st
from numpy.typing import NDArray

from support.patience import PATIENCE
from volsplat.client.session.links.image_decoder import ImageDecoder
from volsplat.client.session.links.image_receiver import ImageReceiver
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.messages.image_messages import CodedPixels, ImageRead, RawPixels, ReadImage, SharedPixels
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.rules.image_tiles import IMAGE_TILE_SIDE, image_tiles, tile_bytes
from volsplat.protocol.text.errors import RemoteProtocolError
from volsplat.protocol.wire.connection import Connection
from volsplat.protocol.wire.dialling import connect
from volsplat.protocol.wire.framing import new_buffer
from volsplat.protocol.wire.handshake import new_hello
from volsplat.protocol.wire.listener import Listener
from volsplat.protocol.wire.tokens import new_token
from volsplat.splat_server.image_coder import ImageCoder
from volsplat.splat_server.image_sender import ImageSender

PLACES = st.tuples(st.integers(0, 2), st.integers(0, 2))
SIZES = st.sampled_from([1, 7, IMAGE_TILE_SIDE, IMAGE_TILE_SIDE + 1, 2 * IMAGE_TILE_SIDE, 75])
LEVEL = np.float32(1 / 255)
ODD = np.array([0.0, -0.0, 1.0, 2**-149, -(2**-140), 3.4e38, 0.5, np.nextafter(np.float32(1), 0)], np.float32)

Pixels = NDArray[np.float32]


def read(width: int, height: int, place: tuple[int, int] = (0, 0)) -> ImageRead:
    return ImageRead(1, Step.F, True, *place, width, height, RawPixels())


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

    def sends(self, pixels: Pixels, exact: bool, place: tuple[int, int] = (0, 0)) -> tuple[CodedPixels, Pixels]:
        image = read(pixels.shape[1], pixels.shape[0], place)
        told, payload = self.coder.coded(image, pixels.data.cast("B"), exact)
        joined = b"".join(payload)
        assert len(joined) == told.bytes
        return told, self.decoded(image, told, joined)

    def decoded(self, image: ImageRead, told: CodedPixels, payload: bytes) -> Pixels:
        target = bytearray(image.raw_bytes)
        self._decoder.decode(image, told, memoryview(payload), memoryview(target))
        return np.frombuffer(target, np.float32).reshape(image.height, image.width, 4)


@given(st.lists(st.tuples(SIZES, SIZES, PLACES, st.integers(0, 3), st.booleans()), min_size=1, max_size=6))
@example([(7, 7, (0, 0), 1, True), (7, 7, (0, 1), 2, True), (7, 7, (1, 1), 3, True)])
def test_images_in_their_order_are_what_they_were(images: list[tuple[int, int, tuple[int, int], int, bool]]) -> None:
    link, before = Link(), None
    for width, height, place, seed, exact in images:
        pixels = drawn(width, height, seed)
        told, shown = link.sends(pixels, exact, place)
        assert told.exact is exact and told.follows == (before == (width, height, place, exact))
        before = width, height, place, exact
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


def test_an_image_after_one_that_went_as_it_is_comes_whole() -> None:
    """Random bits become more by coding, so that they travel uncoded: no image can follow them."""
    before, bits = (
        np.zeros((64, 64, 4), np.uint32),
        np.random.default_rng(1).integers(0, 1 << 32, (64, 64, 4), np.uint32),
    )
    after = bits.copy()
    after[:IMAGE_TILE_SIDE, :IMAGE_TILE_SIDE] = 0
    with linked("127.0.0.2") as (client, server), closing(ImageSender(server)) as sender:  # without shared memory
        receiver, kinds = ImageReceiver(client, new_buffer), list[type]()
        for pixels in (before, bits, after):
            image, payload = exchanged(client, server, sender, read(64, 64), pixels.data.cast("B"))
            kinds.append(type(image.pixels))
            assert bytes(receiver.pixels(image, payload)) == pixels.tobytes()
    assert kinds == [CodedPixels, RawPixels, CodedPixels]


def test_an_image_in_a_memory_that_was_not_shared_is_refused() -> None:
    with linked("127.0.0.1") as (client, server), closing(ImageSender(server)) as sender:
        receiver, image = ImageReceiver(client, new_buffer), read(8, 8)
        pixels = sender.target(image.raw_bytes)
        assert pixels is not None
        pixels[:] = drawn(8, 8, 1).tobytes()
        shown = exchanged(client, server, sender, image, pixels)
        assert bytes(receiver.pixels(*shown)) == bytes(pixels)
        shared = shown[0].pixels
        assert isinstance(shared, SharedPixels)
        other = msgspec.structs.replace(shared, memory=shared.memory + 1, first=False)
        with pytest.raises(RemoteProtocolError, match=f"lies in memory {other.memory}, which is not shared"):
            receiver.pixels(image.carried_by(other), memoryview(b""))


@contextmanager
def linked(host: str) -> Iterator[tuple[Connection, Connection]]:
    """A client's connection to a splat server, and the server's."""
    token = new_token()
    with Listener(Role.CLIENT, token, host=host) as listener:
        server = connect(listener.address, new_hello(Role.SPLAT_SERVER, data_port=1), token, Role.CLIENT)
        client = listener.accept(PATIENCE)
        assert client is not None
        with client, server:
            yield client, server


def exchanged(
    client: Connection, server: Connection, sender: ImageSender, image: ImageRead, pixels: memoryview
) -> tuple[ImageRead, memoryview]:
    """What comes of an image that the client asks for."""
    client.send(ReadImage(image.frame))
    assert server.receive() is not None
    sender.send(image, pixels, exact=True)
    received = client.receive()
    assert received is not None and isinstance(received.message, ImageRead)
    return received.message, received.payload


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
