"""The messages' declarations agree: struct, ways, docstring, recorded bytes; bad fields are named."""

from itertools import count
from typing import Annotated, Any

import msgspec
import pytest

from support.messages import protocol_schema
from support.messages.decoded import decoded
from support.messages.message_samples import RECORDED, SAMPLES, SCHEMA, STRATEGIES, framed, speech_for
from support.messages.protocol_schema import schema_hash
from volsplat.protocol.messages import greetings, messages
from volsplat.protocol.messages.control_part import decode_control, encode_control
from volsplat.protocol.messages.message import Message
from volsplat.protocol.messages.roles import DATA_LINK_TO_SPLAT, Way
from volsplat.protocol.messages.versions import SPOKEN
from volsplat.protocol.messages.vocabulary import MESSAGES
from volsplat.protocol.text.errors import LocalProtocolError, RemoteProtocolError
from volsplat.protocol.wire.framing import Decoder

kinds = pytest.mark.parametrize("kind", SAMPLES, ids=lambda kind: kind.__name__)


def test_every_message_has_a_sample_and_a_strategy() -> None:
    assert set(SAMPLES) == set(STRATEGIES) == {*greetings.GREETINGS, *MESSAGES}


@kinds
def test_a_docstring_begins_with_who_sends_it_to_whom(kind: type[Message]) -> None:
    if kind is greetings.Rejected or kind.of_connection:
        begin = "Either way"
    elif kind in greetings.GREETINGS:
        begin = "Dialler to accepter" if issubclass(kind, greetings.Hello | greetings.Proof) else "Accepter to dialler"
    else:
        begin = _said_together(kind.ways)
    assert (kind.__doc__ or "").startswith(f"{begin}: ")


def _said_together(ways: tuple[Way, ...]) -> str:
    senders = list(dict.fromkeys(str(way.sender) for way in ways))
    receivers = list(dict.fromkeys(str(way.receiver) for way in ways))
    text = f"{' or '.join(senders)} to {' and '.join(receivers)}"
    return text[0].upper() + text[1:]


@kinds
def test_recorded_bytes_of_this_version_decode_for_ever(kind: type[Message]) -> None:
    path = RECORDED / f"{kind.__name__}.bin"
    (received,) = decoded(Decoder(speech_for(kind)), path.read_bytes())
    assert (received.message, bytes(received.payload)) == SAMPLES[kind]


def test_another_schema_has_another_version() -> None:
    recorded = SCHEMA.read_text(encoding="ascii").strip()
    assert schema_hash() == recorded, (
        f"messages or scenes are not those of version {SPOKEN.newest}: raise the version in protocol's versions.py "
        f"and record it (see message_samples); if it was not released yet, remove {SCHEMA.name} and record that anew"
    )


def test_the_schema_knows_fields_and_limits_but_no_prose(monkeypatch: pytest.MonkeyPatch) -> None:
    def hash_with(**fields: Any) -> str:
        kind = msgspec.defstruct("Limited", list(fields.items()), bases=(Message,))
        kind.__doc__ = next(prose)
        monkeypatch.setattr(protocol_schema, "MESSAGES", (*MESSAGES, kind))
        return schema_hash()

    prose = (f"Said in words {n}." for n in count())
    hashes = [
        hash_with(size=Annotated[int, msgspec.Meta(le=limit)], **more)
        for limit, more in ((9, {}), (9, {}), (8, {}), (9, {"name": str}), (9, {"description": str}))
    ]
    assert hashes[0] == hashes[1] and len(set(hashes)) == len(hashes) - 1


@kinds
def test_an_unknown_field_is_refused_by_name(kind: type[Message]) -> None:
    fields = msgspec.msgpack.decode(encode_control(SAMPLES[kind][0]))
    control = msgspec.msgpack.encode({**fields, "surprise": 1})
    with pytest.raises(RemoteProtocolError, match="unknown field `surprise`; if .* install the same one on all"):
        list(decoded(Decoder(speech_for(kind)), framed(control)))


@kinds
def test_an_unknown_field_within_a_field_is_refused_by_place(kind: type[Message]) -> None:
    fields: dict[str, Any] = msgspec.msgpack.decode(encode_control(SAMPLES[kind][0]))
    for name, value in fields.items():
        if isinstance(value, dict) and all(isinstance(key, str) for key in value):  # others are keyed by ids
            control = msgspec.msgpack.encode({**fields, name: {**value, "surprise": 1}})
            with pytest.raises(RemoteProtocolError, match=rf"unknown field `surprise` - at `\$\.{name}`"):
                list(decoded(Decoder(speech_for(kind)), framed(control)))


@kinds
def test_a_missing_field_is_refused_by_name(kind: type[Message]) -> None:
    fields = msgspec.msgpack.decode(encode_control(SAMPLES[kind][0]))
    needed = [field.name for field in msgspec.structs.fields(kind) if field.required]
    for name in needed:
        control = msgspec.msgpack.encode({key: value for key, value in fields.items() if key != name})
        with pytest.raises(RemoteProtocolError, match=f"missing required field `{name}`"):
            list(decoded(Decoder(speech_for(kind)), framed(control)))


@kinds
def test_a_field_of_another_type_is_refused_by_name(kind: type[Message]) -> None:
    fields = msgspec.msgpack.decode(encode_control(SAMPLES[kind][0]))
    for field in msgspec.structs.fields(kind):
        control = msgspec.msgpack.encode({**fields, field.name: msgspec.msgpack.Ext(1, b"of no field")})
        with pytest.raises(RemoteProtocolError, match=rf"\$\.{field.name}"):
            list(decoded(Decoder(speech_for(kind)), framed(control)))


@pytest.mark.parametrize(
    ("message", "field", "value", "limit"),
    [
        (messages.AbortFrame(0), "$.frame", "0", "1"),
        (messages.AbortFrame(messages.LARGEST_ID + 1), "$.frame", "2147483648", "2147483647"),
        (greetings.Welcome(-1, bytes(32)), "$.id", "-1", "1"),
        (greetings.Proof(bytes(31)), "$.proof", "x00", "32"),
        (messages.ConnectedToSplatServers([1, 0]), "$.servers[1]", "0", "1"),
        (
            messages.ConnectToSplatServers([messages.Route(1, "here", 65536, bytes(32))]),
            "$.routes[0].port",
            "65536",
            "65535",
        ),
        (messages.HistogramsCounted(1, 65537, 1), "$.bins", "65537", "65536"),
        (messages.Refused("x" * 1001, ""), "$.request", "xxx", "1000"),
        (messages.VoxelsPacked(1, 1, float("nan")), "$.seconds", "nan", "0"),
    ],
)
def test_a_refusal_names_field_value_and_limit(message: Message, field: str, value: str, limit: str) -> None:
    with pytest.raises(RemoteProtocolError) as caught:
        decode_control(encode_control(message), isinstance(message, greetings.Greeting))
    for part in (field, value, limit):
        assert part in str(caught.value)


def test_boxes_without_voxels_are_refused() -> None:
    fields: dict[str, Any] = msgspec.msgpack.decode(encode_control(SAMPLES[messages.ReadSubCubes][0]))
    for box in ([[0, 0, 0], [4, 0, 4]], [[-1, 0, 0], [4, 4, 4]], [[5, 0, 0], [4, 4, 4]]):
        with pytest.raises(RemoteProtocolError, match="low < high"):
            decode_control(msgspec.msgpack.encode({**fields, "boxes": [box]}))


@pytest.mark.parametrize("shape", [(1, 0), (0, 1), (3, 2)])
def test_a_batch_has_a_run_for_each_packet_and_a_packet_in_each_run(shape: tuple[int, int]) -> None:
    fields: dict[str, Any] = msgspec.msgpack.decode(encode_control(SAMPLES[messages.Batch][0]))
    control = msgspec.msgpack.encode({**fields, "parts": [{"run_count": shape[0], "packet_count": shape[1]}]})
    with pytest.raises(RemoteProtocolError, match="each packet is in a run"):
        list(decoded(Decoder(speech_for(messages.Batch)), framed(control)))


def test_an_empty_batch_may_say_that_a_worker_is_done() -> None:
    control = encode_control(messages.Batch(1, 2, 0, 0, 0, [messages.BatchPart(0, 0)], 3, 4, True))
    (received,) = decoded(Decoder(speech_for(messages.Batch)), framed(control))
    assert received.payload.nbytes == 0


def test_a_plan_that_does_not_check_is_refused_with_its_place() -> None:
    fields: dict[str, Any] = msgspec.msgpack.decode(encode_control(SAMPLES[messages.RenderFrame][0]))
    fields["drawing"]["plan"]["width"] = 0
    with pytest.raises(RemoteProtocolError, match=r"width must be 1 to 16384 pixels, not 0.*\$\.drawing\.plan"):
        decode_control(msgspec.msgpack.encode(fields))


def test_a_field_that_cannot_be_encoded_is_our_mistake() -> None:
    with pytest.raises(LocalProtocolError, match="AbortFrame"):
        encode_control(messages.AbortFrame(1 << 70))


def test_only_the_data_link_carries_batches() -> None:
    carried: list[type[Message]] = [messages.ChannelsShared, messages.Batch]
    assert all(kind.ways == (DATA_LINK_TO_SPLAT,) for kind in carried)
    assert [kind for kind in MESSAGES if DATA_LINK_TO_SPLAT in kind.ways] == carried
