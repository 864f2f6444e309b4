"""How fast the link to a server is: there and back for nothing, and by many bytes either way."""

import time
from collections.abc import Iterator

from volsplat.deploy.cluster.state import KnownServer
from volsplat.deploy.doctor.finding import Finding
from volsplat.deploy.doctor.meeting import Meeting
from volsplat.protocol.messages.link_messages import LARGEST_MEASURE, LinkMeasured, MeasureLink
from volsplat.protocol.text.errors import PeerLost, VolsplatError
from volsplat.protocol.wire.connection import PATH_CURE, Connection

ROUNDS = 5  # of which the fastest counts: what else runs only makes them slower
ENOUGH_SECONDS = 1.0  # for one way of a slow link, after its first round
BITS = 8


def link_speed(one: KnownServer, server: Connection, meeting: Meeting) -> tuple[Finding, float | None]:
    """Also in bits a second, of its slower way; None where it could not be measured."""
    name = one.started.name
    try:
        nothing = min(_rounds(server, meeting, 0, 0))
    except VolsplatError as error:
        return Finding(name, "speed", right=False, line=str(error)), None
    try:
        there = min(_rounds(server, meeting, LARGEST_MEASURE, 0)) - nothing
        back = min(_rounds(server, meeting, 0, LARGEST_MEASURE)) - nothing
    except PeerLost as error:
        line = f"small messages get through, and large ones do not, {LARGEST_MEASURE >> 20} MiB either way: {error}"
        return Finding(name, "speed", right=False, line=line if PATH_CURE in line else f"{line}; {PATH_CURE}"), None
    except VolsplatError as error:
        return Finding(name, "speed", right=False, line=str(error)), None
    line = f"{nothing * 1e3:.2g} ms there and back, {_rate(there)} to it, {_rate(back)} from it"
    return Finding(name, "speed", right=True, line=line), _bits(max(there, back))


def _rounds(server: Connection, meeting: Meeting, sent: int, wanted: int) -> Iterator[float]:
    """Seconds that each took."""
    payload, began = bytes(sent), time.perf_counter()
    for _ in range(ROUNDS):
        asked = time.perf_counter()
        meeting.ask(server, MeasureLink(sent=sent, wanted=wanted), LinkMeasured, payload)
        yield time.perf_counter() - asked
        if time.perf_counter() - began > ENOUGH_SECONDS:
            return


def _bits(seconds: float) -> float:
    """A second, of so many seconds for the largest measure."""
    return BITS * LARGEST_MEASURE / max(seconds, 1e-9)


def _rate(seconds: float) -> str:
    bits = _bits(seconds)
    return f"{bits / 1e9:.2g} Gbit/s" if bits >= 1e9 else f"{bits / 1e6:.3g} Mbit/s"
