"""The handshake: who is let in, who is not, what each side is told, and that its table is the whole of it."""

from itertools import product

import pytest
from hypothesis import given
from hypothesis import strategies as st

from support.checkout import ROOT
from support.generated_docs import remade
from support.messages.message_samples import SAMPLES
from support.messages.protocol_pictures import PICTURES
from volsplat.protocol.messages import greetings
from volsplat.protocol.messages.greetings import Challenge, Hello, Proof, Rejected, Welcome
from volsplat.protocol.messages.messages import Message
from volsplat.protocol.messages.roles import DIALLED, Role, Way
from volsplat.protocol.messages.versions import VersionRange
from volsplat.protocol.text.errors import BadInput, LocalProtocolError, RemoteProtocolError, TooEarly, TurnedAway
from volsplat.protocol.wire.framing import encode
from volsplat.protocol.wire.handshake import (
    BEGIN,
    TRANSITIONS,
    AccepterHandshake,
    DiallerHandshake,
    Does,
    Side,
    State,
    new_hello,
)
from volsplat.protocol.wire.tokens import Token, new_token

TOKEN = new_token()
FIRST = VersionRange(1, 1)


def pair(
    token: Token = TOKEN,
    other_token: Token = TOKEN,
    way: Way = DIALLED[0],
    versions: VersionRange = FIRST,
    other_versions: VersionRange = FIRST,
) -> tuple[DiallerHandshake, AccepterHandshake]:
    dialler = DiallerHandshake(token, new_hello(way.sender, versions=versions), way.receiver)
    return dialler, AccepterHandshake(other_token, way.receiver, other_versions)


def run(dialler: DiallerHandshake, accepter: AccepterHandshake, server: int = 5) -> list[Message]:
    """Carry messages until the connection is open or the accepter rejects; all that was said."""
    said: list[Message] = [dialler.start()]
    while dialler.state is not State.OPEN:
        answer = accepter.receive(said[-1])
        said.append(answer if answer is not None else accepter.welcome(server))
        if isinstance(said[-1], Rejected):
            break
        proof = dialler.receive(said[-1])
        if proof is not None:
            said.append(proof)
    return said


@pytest.mark.parametrize("way", DIALLED, ids=str)
def test_both_sides_open_with_the_same_token(way: Way) -> None:
    dialler, accepter = pair(way=way)
    said = run(dialler, accepter)
    assert [type(message) for message in said] == [Hello, Challenge, Proof, Welcome]
    assert dialler.state is accepter.state is State.OPEN
    assert dialler.id == 5 and dialler.version == accepter.version == 1


def test_the_token_is_never_sent() -> None:
    said = run(*pair()) + run(*pair(other_token=new_token()))
    stream = b"".join(bytes(buffer) for message in said for buffer in encode(message))
    assert TOKEN.key not in stream
    assert TOKEN.key.decode() not in repr(TOKEN) + str(TOKEN)


def test_another_token_is_told_to_both_sides_in_one_line() -> None:
    dialler, accepter = pair(other_token=new_token())
    rejected = run(dialler, accepter)[-1]
    assert accepter.state is State.REJECTED and "another session token" in accepter.rejection
    with pytest.raises(BadInput, match="another session token.*VOLSPLAT_TOKEN") as caught:
        dialler.receive(rejected)
    assert dialler.state is State.REJECTED
    assert "\n" not in str(caught.value) + accepter.rejection


def test_a_data_link_must_know_its_workers_key_and_neither_it_nor_the_token_is_sent() -> None:
    key, way = bytes(range(32)), Way(Role.DATA_LINK, Role.SPLAT_SERVER)
    keys = {5: TOKEN.bound_to(key)}
    stream = b""
    for known, opens in ((TOKEN.bound_to(key), True), (TOKEN, False), (TOKEN.bound_to(bytes(32)), False)):
        dialler = DiallerHandshake(known, new_hello(way.sender, server=5, versions=FIRST), way.receiver)
        accepter = AccepterHandshake(TOKEN, way.receiver, FIRST, token_of=lambda hello: keys[hello.server])
        said = run(dialler, accepter)
        assert (accepter.state is State.OPEN) is opens
        assert opens or "does not know the key that the client gave to worker 5" in accepter.rejection
        stream += b"".join(bytes(buffer) for message in said for buffer in encode(message))
    assert not any(secret in stream for secret in (key, TOKEN.key, keys[5].key))


def test_a_peer_whose_own_token_is_not_known_yet_is_in_the_same_state_still() -> None:
    def unknown(hello: Hello) -> Token:
        raise TooEarly(hello.name)

    way = Way(Role.DATA_LINK, Role.SPLAT_SERVER)
    accepter = AccepterHandshake(TOKEN, way.receiver, FIRST, token_of=unknown)
    with pytest.raises(TooEarly):
        run(DiallerHandshake(TOKEN, new_hello(way.sender, server=5, versions=FIRST), way.receiver), accepter)
    assert accepter.state is State.CHALLENGE_SENT


@given(st.lists(st.integers(1, 9), min_size=4, max_size=4))
def test_the_newest_shared_version_is_agreed_on_or_both_sides_hear_both_ranges(ends: list[int]) -> None:
    ours, theirs = VersionRange(*sorted(ends[:2])), VersionRange(*sorted(ends[2:]))
    dialler, accepter = pair(versions=ours, other_versions=theirs)
    last = run(dialler, accepter)[-1]
    shared = set(range(ours.oldest, ours.newest + 1)) & set(range(theirs.oldest, theirs.newest + 1))
    if shared:
        assert dialler.version == accepter.version == max(shared)
        return
    with pytest.raises(BadInput) as caught:
        dialler.receive(last)
    for told in (str(caught.value), accepter.rejection):
        assert str(ours) in told and str(theirs) in told


def test_a_dialler_checks_versions_itself() -> None:
    dialler, _ = pair()
    dialler.start()
    with pytest.raises(BadInput, match="version 1.*versions 2 to 3"):
        dialler.receive(Challenge(Role.CLIENT, 2, 3, bytes(32)))


@pytest.mark.parametrize("way", [Way(a, b) for a, b in product(Role, Role) if Way(a, b) not in DIALLED], ids=str)
def test_a_role_that_does_not_dial_another_is_rejected(way: Way) -> None:
    dialler, accepter = pair(way=way)
    with pytest.raises(BadInput, match="check host and port"):
        dialler.receive(run(dialler, accepter)[-1])
    assert str(way.sender) in accepter.rejection and str(way.receiver) in accepter.rejection


def test_a_dialler_refuses_the_wrong_kind_of_accepter() -> None:
    dialler = DiallerHandshake(TOKEN, new_hello(Role.MAPSHADE_SERVER), Role.CLIENT)
    dialler.start()
    with pytest.raises(BadInput, match="it is a splat server, not a client"):
        dialler.receive(Challenge(Role.SPLAT_SERVER, 1, 1, bytes(32)))


def test_an_accepter_without_the_token_is_found_out() -> None:
    dialler, _ = pair()
    dialler.start()
    proof = dialler.receive(Challenge(Role.CLIENT, 1, 1, bytes(32)))
    assert isinstance(proof, Proof)
    for forged in (bytes(32), proof.proof):  # a guess, and the dialler's own proof sent back
        with pytest.raises(BadInput, match="does not know the session token"):
            dialler.receive(Welcome(1, forged))
        assert dialler.state is State.PROOF_SENT


def test_a_nonce_sent_back_is_refused() -> None:
    dialler, _ = pair()
    hello = dialler.start()
    with pytest.raises(RemoteProtocolError, match="nonce"):
        dialler.receive(Challenge(Role.CLIENT, 1, 1, hello.nonce))


def test_a_proof_is_of_no_use_in_another_handshake() -> None:
    dialler, accepter = pair()
    said = run(dialler, accepter)
    replayed = AccepterHandshake(TOKEN, Role.CLIENT, FIRST)
    replayed.receive(said[0])
    assert isinstance(replayed.receive(said[2]), Rejected)
    again = DiallerHandshake(TOKEN, new_hello(Role.MAPSHADE_SERVER, versions=FIRST), Role.CLIENT)
    again.start()
    again.receive(said[1])
    with pytest.raises(BadInput):
        again.receive(said[3])


def test_a_welcome_cannot_be_given_another_id() -> None:
    dialler, accepter = pair()
    accepter.receive(dialler.start())
    proof = dialler.receive(accepter.challenge)
    assert proof is not None
    accepter.receive(proof)
    with pytest.raises(BadInput):
        dialler.receive(Welcome(6, accepter.welcome(5).proof))


@pytest.mark.parametrize(
    "changed",
    [{"newest": 1}, {"role": Role.SPLAT_SERVER}, {"server": 9}, {"data_port": 7}, {"nonce": bytes(32)}],
    ids=lambda changed: next(iter(changed)),
)
def test_a_hello_changed_on_its_way_is_found_out(changed: dict[str, object]) -> None:
    dialler, accepter = pair(versions=VersionRange(1, 2), other_versions=VersionRange(1, 2))
    hello = dialler.start()
    names = ("role", "oldest", "newest", "nonce", "server", "data_host", "data_port", "name")
    fields = {name: getattr(hello, name) for name in names}
    accepter.receive(Hello(**{**fields, **changed}))
    proof = dialler.receive(accepter.challenge)
    assert proof is not None
    assert isinstance(accepter.receive(proof), Rejected)


def test_a_rejection_cannot_steer_the_terminal() -> None:
    dialler, _ = pair()
    dialler.start()
    with pytest.raises(BadInput) as caught:
        dialler.receive(Rejected("\x1b[2Jfine\n"))
    assert str(caught.value).isprintable()


@pytest.mark.parametrize(("passing", "error"), [(False, BadInput), (True, TurnedAway)])
def test_a_rejection_says_whether_another_try_may_help(passing: bool, error: type[Exception]) -> None:
    dialler, _ = pair()
    dialler.start()
    with pytest.raises(error, match="no room"):
        dialler.receive(Rejected("no room", passing))


def at(side: Side, state: State) -> DiallerHandshake | AccepterHandshake:
    """A handshake that has been brought to `state` by lawful events."""
    dialler, accepter = pair()
    if side is Side.DIALLER:
        dialler.state = state
        dialler.challenge = accepter.challenge
        return dialler
    accepter.state = state
    accepter.hello = dialler.hello
    return accepter


@pytest.mark.parametrize(("side", "state"), [(side, state) for side in Side for state in TRANSITIONS[side]])
def test_an_illegal_message_raises_and_leaves_the_state_as_it_was(side: Side, state: State) -> None:
    for kind in SAMPLES:
        if (Does.RECEIVES, kind) in TRANSITIONS[side][state]:
            continue
        handshake = at(side, state)
        with pytest.raises(RemoteProtocolError, match=f"{kind.__name__} is out of place.*{state.value}"):
            handshake.receive(SAMPLES[kind][0])
        assert handshake.state is state


def test_sending_out_of_turn_is_our_mistake() -> None:
    for state in TRANSITIONS[Side.ACCEPTER]:
        accepter = at(Side.ACCEPTER, state)
        assert isinstance(accepter, AccepterHandshake)
        if state is not State.PROVEN:
            with pytest.raises(LocalProtocolError, match="Welcome is out of place"):
                accepter.welcome(1)
        if (Does.SENDS, Rejected) not in TRANSITIONS[Side.ACCEPTER][state]:
            with pytest.raises(LocalProtocolError, match="Rejected is out of place"):
                accepter.reject("no")
        assert accepter.state is state
    dialler, _ = pair()
    dialler.start()
    with pytest.raises(LocalProtocolError, match="Hello is out of place"):
        dialler.start()


@pytest.mark.parametrize("side", Side)
def test_every_state_of_the_table_is_reached_and_every_state_leads_on_or_ends(side: Side) -> None:
    table = TRANSITIONS[side]
    reached, fresh = {BEGIN[side]}, [BEGIN[side]]
    while fresh:
        for after in table[fresh.pop()].values():
            if after not in reached:
                reached.add(after)
                fresh.append(after)
    assert reached == set(table)
    assert {state for state, leads in table.items() if not leads} == {State.OPEN, State.REJECTED}


def test_what_one_side_sends_the_other_receives() -> None:
    def spoken(side: Side, does: Does) -> set[type[Message]]:
        return {kind for leads in TRANSITIONS[side].values() for what, kind in leads if what is does}

    assert spoken(Side.DIALLER, Does.SENDS) == spoken(Side.ACCEPTER, Does.RECEIVES)
    assert spoken(Side.ACCEPTER, Does.SENDS) == spoken(Side.DIALLER, Does.RECEIVES)
    everything = spoken(Side.DIALLER, Does.SENDS) | spoken(Side.ACCEPTER, Does.SENDS)
    assert everything == set(greetings.GREETINGS)


def test_the_page_shows_the_tables_as_they_are() -> None:
    page = (ROOT / "docs" / "how_it_works" / "protocol.md").read_text(encoding="utf-8")
    assert remade(page, PICTURES) == page, (
        "run: python -m support.messages.protocol_pictures ../docs/how_it_works/protocol.md"
    )
    for picture in PICTURES.values():
        assert picture() in page
