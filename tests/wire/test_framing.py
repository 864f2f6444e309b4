"""Framing and every message against lawful, cut, lying and hostile bytes."""

from functools import partial

import pytest
from fuzz.stream_invariant import MOST_ALLOCATED, WAYS, check_handshakes, check_stranger, check_stream, outcome
from hypothesis import given, settings
from hypothesis import strategies as st

from support.messages.decoded import decoded
from support.messages.message_samples import SAMPLES, STRATEGIES, framed, lawful_kinds, sample_bytes, speech_for
from support.thoroughness import examples
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import LARGEST_EXTENT
from volsplat.protocol.messages import greetings, messages
from volsplat.protocol.messages.control_part import encode_control
from volsplat.protocol.messages.message import Message
from volsplat.protocol.messages.roles import (
    CLIENT_TO_MAPSHADE,
    CLIENT_TO_SPLAT,
    DATA_LINK_TO_SPLAT,
    MAPSHADE_TO_CLIENT,
    SPLAT_TO_CLIENT,
    Way,
)
from volsplat.protocol.messages.speech import Speech
from volsplat.protocol.rules.packet_layout import ROW_RUN_BYTES, SHADED_PACKET_BYTES
from volsplat.protocol.text.errors import LocalProtocolError, RemoteProtocolError
from volsplat.protocol.wire.framing import (
    HEADER,
    LARGEST_CONTROL,
    LARGEST_GREETING,
    LARGEST_PAYLOAD,
    MAGIC,
    Decoder,
    encode,
)

EACH_BYTE = 2048  # of a message's beginning, which takes in header and control part, and of its end
FUZZ_EXAMPLES = 500  # a millisecond each

kinds = pytest.mark.parametrize("kind", SAMPLES, ids=lambda kind: kind.__name__)


def refusal(data: bytes, speech: Speech) -> str:
    """How a decoder refuses `data`; nothing may have been allocated for it."""

    def allocate(message: Message, nbytes: int) -> bytearray:
        raise AssertionError(f"{nbytes} bytes were allocated")

    with pytest.raises(RemoteProtocolError) as caught:
        list(decoded(Decoder(speech, allocate), data))
    return str(caught.value)


@kinds
def test_a_message_survives_whole_and_byte_by_byte(kind: type[Message]) -> None:
    way = speech_for(kind).way
    twice = sample_bytes(kind) * 2
    for chunk in (1, 3, 1 << 20) if len(twice) < 4 * EACH_BYTE else (1021, 1 << 20):
        assert outcome(twice, way, chunk)[0][0] == SAMPLES[kind]


@kinds
def test_a_message_cut_anywhere_asks_for_more(kind: type[Message]) -> None:
    data = sample_bytes(kind)
    near_the_ends = {*range(1, min(EACH_BYTE, len(data))), *range(max(1, len(data) - EACH_BYTE), len(data))}
    for cut in sorted(near_the_ends | {*range(1, len(data), 4099)}):
        decoder = Decoder(speech_for(kind))
        assert list(decoded(decoder, data[:cut])) == []
        assert not decoder.between_messages
        assert len(list(decoded(decoder, data[cut:]))) == 1
        assert decoder.between_messages


@kinds
def test_a_wrong_payload_length_is_refused_before_anything_is_allocated(kind: type[Message]) -> None:
    message, payload = SAMPLES[kind]
    control = encode_control(message)
    for wrong in {0, len(payload) - 1, len(payload) + 1, LARGEST_PAYLOAD, 2**64 - 1} - {len(payload), -1}:
        line = refusal(framed(control, payload, payload_bytes=wrong), speech_for(kind))
        assert f"payload_bytes is {wrong}" in line


@kinds
def test_a_wrong_control_length_is_refused(kind: type[Message]) -> None:
    message, payload = SAMPLES[kind]
    control = encode_control(message)
    for wrong in (len(control) - 1, len(control) + 1):
        with pytest.raises(RemoteProtocolError):
            list(decoded(Decoder(speech_for(kind)), framed(control, payload + b"\0", control_bytes=wrong)))


@pytest.mark.parametrize("way", WAYS)
def test_hostile_lengths_are_refused_before_anything_is_allocated(way: Way | None) -> None:
    limit = LARGEST_GREETING if way is None else LARGEST_CONTROL
    for control_bytes in (0, limit + 1, 2**31, 2**32 - 1):
        line = refusal(HEADER.pack(MAGIC, control_bytes, 0), Speech(way))
        assert f"control_bytes is {control_bytes}" in line and str(limit) in line
    for payload_bytes in (LARGEST_PAYLOAD + 1, 2**63, 2**64 - 1):
        assert f"payload_bytes is {payload_bytes}" in refusal(HEADER.pack(MAGIC, 10, payload_bytes), Speech(way))


def test_a_stranger_may_send_no_payload() -> None:
    assert "payload_bytes is 1, but at most 0" in refusal(HEADER.pack(MAGIC, 10, 1), Speech())


def test_another_protocol_is_told_by_its_magic() -> None:
    assert "magic is 0x20544547" in refusal(b"GET / HTTP/1.1\r\n\r\n", Speech())


def test_a_batch_beyond_its_limit_is_refused_before_anything_is_allocated() -> None:
    packets = messages.Batch.largest_payload // SHADED_PACKET_BYTES
    batch = messages.Batch(1, 2, 0, 0, 0, [messages.BatchPart(1, packets)], 0, 0, False)
    size = ROW_RUN_BYTES + packets * SHADED_PACKET_BYTES
    line = refusal(framed(encode_control(batch), payload_bytes=size), Speech(DATA_LINK_TO_SPLAT))
    assert str(size) in line and str(messages.Batch.largest_payload) in line


def test_the_largest_image_is_allowed_and_is_asked_for_once_it_is_announced() -> None:
    side = LARGEST_EXTENT
    image = messages.ImageRead(1, Step.F, True, 0, 0, side, side, messages.RawPixels())
    data = framed(encode_control(image), payload_bytes=messages.ImageRead.largest_payload)
    assert messages.ImageRead.largest_payload > MOST_ALLOCATED
    assert outcome(data, SPLAT_TO_CLIENT, len(data)) == ([], "declined")


def test_an_image_larger_than_a_scene_may_ask_for_is_refused() -> None:
    image = messages.ImageRead(1, Step.F, True, 0, 0, LARGEST_EXTENT + 1, 1, messages.RawPixels())
    line = refusal(framed(encode_control(image)), Speech(SPLAT_TO_CLIENT))
    assert "$.width" in line and "16385" in line and "16384" in line


def test_a_coded_batch_is_refused_if_uncoded_it_would_be_beyond_the_limit() -> None:
    packets = messages.Batch.largest_payload // SHADED_PACKET_BYTES
    batch = messages.Batch(1, 2, 0, 0, 10, [messages.BatchPart(1, packets)], 0, 0, False)
    line = refusal(framed(encode_control(batch), bytes(10)), Speech(DATA_LINK_TO_SPLAT))
    assert "coded" in line and str(messages.Batch.largest_payload) in line


def test_a_batch_of_another_worker_is_refused() -> None:
    control = encode_control(messages.Batch(1, 2, 0, 0, 0, [messages.BatchPart(0, 0)], 0, 0, True))
    assert "worker is 2" in refusal(framed(control), Speech(DATA_LINK_TO_SPLAT, server=3))
    assert len(list(decoded(Decoder(Speech(DATA_LINK_TO_SPLAT, server=2)), framed(control)))) == 1


def test_deep_nesting_is_refused() -> None:
    for deep in (b"\x91" * LARGEST_CONTROL, b"\x81\xa7message" * 100_000):
        refusal(framed(deep), Speech(CLIENT_TO_MAPSHADE))


def test_lists_that_promise_more_than_they_hold_are_refused() -> None:
    control = encode_control(messages.ConnectedToSplatServers([5]))
    assert control.endswith(b"\x91\x05")
    refusal(framed(control[:-2] + b"\xdd\xff\xff\xff\xff\x05"), Speech(MAPSHADE_TO_CLIENT))


def test_a_broken_stream_stays_broken() -> None:
    decoder = Decoder()
    with pytest.raises(RemoteProtocolError, match="magic"):
        list(decoded(decoder, bytes(16)))
    for again in (decoder.wanted, lambda: decoder.advance(1)):
        with pytest.raises(RemoteProtocolError, match="magic"):
            again()


def test_a_payload_goes_straight_to_the_memory_that_was_given() -> None:
    data = sample_bytes(messages.Batch)
    memory = bytearray(1000)
    decoder = Decoder(Speech(DATA_LINK_TO_SPLAT), lambda message, nbytes: memory)
    (received,) = decoded(decoder, data)
    assert received.payload.obj is memory
    assert received.payload == SAMPLES[messages.Batch][1] == memory[: len(received.payload)]


def test_a_payload_is_sent_from_its_own_memory() -> None:
    message, payload = SAMPLES[messages.Batch]
    runs, packets = bytearray(payload[:ROW_RUN_BYTES]), bytearray(payload[ROW_RUN_BYTES:])
    buffers = encode(message, runs, packets, speech=Speech(DATA_LINK_TO_SPLAT))
    assert buffers[1].obj is runs and buffers[2].obj is packets
    assert b"".join(buffers) == sample_bytes(messages.Batch)


def _given(memory: memoryview, message: Message, nbytes: int) -> memoryview:
    return memory


def test_memory_that_cannot_take_the_payload_is_our_mistake() -> None:
    for bad in (memoryview(bytearray(3)), memoryview(bytes(1000))):
        decoder = Decoder(Speech(DATA_LINK_TO_SPLAT), partial(_given, bad))
        with pytest.raises(LocalProtocolError, match="writable"):
            list(decoded(decoder, sample_bytes(messages.Batch)))


def test_advancing_by_what_was_not_wanted_is_our_mistake() -> None:
    for wrong in (-1, 0, HEADER.size + 1):
        with pytest.raises(LocalProtocolError):
            Decoder().advance(wrong)


def test_a_payload_that_the_message_does_not_announce_is_our_mistake() -> None:
    with pytest.raises(LocalProtocolError, match="announces 40"):
        encode(SAMPLES[messages.Batch][0], b"short", speech=Speech(DATA_LINK_TO_SPLAT))
    with pytest.raises(LocalProtocolError, match="announces 0"):
        encode(messages.EndSession(), b"x", speech=Speech(CLIENT_TO_SPLAT))


def test_a_control_part_beyond_its_limit_is_our_mistake() -> None:
    with pytest.raises(LocalProtocolError, match=str(LARGEST_GREETING)):
        encode(greetings.Rejected("x" * LARGEST_GREETING))


def test_nothing_follows_the_end_of_the_session() -> None:
    speech = Speech(CLIENT_TO_SPLAT)
    encode(messages.EndSession(), speech=speech)
    with pytest.raises(LocalProtocolError, match="ended"):
        encode(messages.AbortFrame(1), speech=speech)
    data = sample_bytes(messages.EndSession) + sample_bytes(messages.AbortFrame)
    heard, end = outcome(data, CLIENT_TO_SPLAT, 1)
    assert [type(message) for message, _ in heard] == [messages.EndSession]
    assert "AbortFrame" in end and "ended" in end


@kinds
def test_a_message_out_of_place_is_refused_by_both_sides(kind: type[Message]) -> None:
    message, payload = SAMPLES[kind]
    for way in WAYS:
        if kind in lawful_kinds(way):
            encode(message, payload, speech=Speech(way))
            assert outcome(sample_bytes(kind), way, 5)[1] == "end"
        else:
            with pytest.raises(LocalProtocolError):
                encode(message, payload, speech=Speech(way))
            assert refusal(framed(encode_control(message), payload), Speech(way))


@given(st.data())
def test_any_messages_survive(data: st.DataObject) -> None:
    way = data.draw(st.sampled_from([way for way in WAYS if lawful_kinds(way)]))
    speech, stream, said = Speech(way), b"", []
    for _ in range(data.draw(st.integers(1, 3))):
        message = data.draw(st.sampled_from(lawful_kinds(way)).flatmap(STRATEGIES.__getitem__))
        payload = data.draw(st.randoms(use_true_random=False)).randbytes(speech.payload_bytes(message))
        said.append((message, payload))
        stream += b"".join(encode(message, payload, speech=speech))
        if message.ends:
            break
    assert check_stream(stream, way) == said


_lengths = st.sampled_from((0, 1, 15, 16, 255, 4096, 4097, 1 << 20, (1 << 20) + 1, (1 << 32) - 1))
_long_lengths = _lengths | st.sampled_from((1 << 24, LARGEST_PAYLOAD, LARGEST_PAYLOAD + 1, 1 << 63, (1 << 64) - 1))
_headers = st.builds(HEADER.pack, st.just(MAGIC) | st.integers(0, 2**32 - 1), _lengths, _long_lengths)
_samples = st.sampled_from(list(SAMPLES)).map(sample_bytes)
_hostile = st.lists(st.binary(max_size=40) | _headers | _samples, max_size=4).map(b"".join)


@st.composite
def mutated(draw: st.DrawFn) -> bytes:
    """A valid message with some bytes changed, left out or put in."""
    data = bytearray(sample_bytes(draw(st.sampled_from(list(SAMPLES)))))
    for _ in range(draw(st.integers(1, 4))):
        place = draw(st.integers(0, len(data)))
        data[place : place + draw(st.integers(0, 4))] = draw(st.binary(max_size=4))
    return bytes(data)


@st.composite
def remade(draw: st.DrawFn) -> bytes:
    """A mutated control part under a header that fits it, so that the damage reaches the message."""
    message, payload = SAMPLES[draw(st.sampled_from(list(SAMPLES)))]
    control = bytearray(encode_control(message))
    for _ in range(draw(st.integers(1, 3))):
        place = draw(st.integers(0, len(control) - 1))
        control[place : place + draw(st.integers(0, 2))] = draw(st.binary(max_size=9))
    return framed(bytes(control), payload)


@settings(max_examples=examples(FUZZ_EXAMPLES))
@given(_hostile | mutated() | remade(), st.sampled_from(WAYS))
def test_any_bytes_are_a_message_or_a_wait_or_refused(data: bytes, way: Way | None) -> None:
    check_stream(data, way)


@settings(max_examples=examples(FUZZ_EXAMPLES))
@given(_hostile | mutated() | remade())
def test_no_bytes_of_a_stranger_open_a_connection(data: bytes) -> None:
    check_handshakes(data)


@settings(max_examples=examples(FUZZ_EXAMPLES))
@given(st.lists(st.sampled_from(lawful_kinds(None)).flatmap(STRATEGIES.__getitem__), max_size=5))
def test_no_greetings_of_a_stranger_open_a_connection(said: list[Message]) -> None:
    check_stranger(said)
