"""The pictures of docs/how_it_works/protocol.md, drawn from the tables; in tests/:

    python -m support.messages.protocol_pictures ../docs/how_it_works/protocol.md

They stand in the page between "<!-- picture: name -->" and "<!-- end -->", so that page and code cannot drift.
"""

import sys
from pathlib import Path

from support.generated_docs import Parts, remake
from volsplat.client.coordinator.coordinator import OWNERS
from volsplat.client.coordinator.holding.phase import Phase
from volsplat.protocol.messages.exchanges import EXCHANGES
from volsplat.protocol.messages.handlers import handlers
from volsplat.protocol.messages.vocabulary import MESSAGES
from volsplat.protocol.wire.handshake import BEGIN, TRANSITIONS, Side


def handshake_picture(side: Side) -> str:
    """The transitions of one side as a mermaid state diagram."""
    lines = ["```mermaid", "stateDiagram-v2", f"    [*] --> {BEGIN[side].name}"]
    for state, leads in TRANSITIONS[side].items():
        lines += [
            f"    {state.name} --> {after.name}: {does.value} {kind.__name__}" for (does, kind), after in leads.items()
        ]
        if not leads:
            lines.append(f"    {state.name} --> [*]")
    return "\n".join([*lines, "```"])


def message_table() -> str:
    """All messages of an open connection, who may send them to whom, and the most bytes that may follow."""
    lines = ["| message | from → to | payload, at most |", "|---|---|---|"]
    for kind in MESSAGES:
        ways = "<br>".join(f"{way.sender} → {way.receiver}" for way in kind.ways)
        limit = f"{kind.largest_payload} bytes" if kind.largest_payload else "none"
        lines.append(f"| {kind.__name__} | {ways} | {limit} |")
    return "\n".join(lines)


def exchange_table() -> str:
    """What a server owes for each request, once a connection is open."""
    lines = [
        "| from the client to a | request | named by | may wait | answer |",
        "|---|---|---|---|---|",
    ]
    for way, kinds in EXCHANGES.items():
        for request, kind in kinds.items():
            named_by = " and ".join(kind.named_by).replace("_", " ") or "its place"
            waits = f"the newest {kind.at_once}" if kind.newest else str(kind.at_once)
            answers = ", then ".join(answer.__name__ for answer in kind.answers)
            lines.append(f"| {way.receiver} | {request.__name__} | {named_by} | {waits} | {answers} |")
    return "\n".join(lines)


def phase_table() -> str:
    """What servers may say in each phase of the volume's way into them; the rest cuts them off."""
    states = {
        kind: handler.states or tuple(Phase)
        for owner in OWNERS
        for kind, handler in handlers(owner).items()
        if kind in MESSAGES
    }
    lines = ["| the volume is | a server may say |", "|---|---|"]
    for phase in Phase:
        said = sorted(kind.__name__ for kind, phases in states.items() if phase in phases)
        lines.append(f"| {phase.value} | {', '.join(said)} |")
    return "\n".join(lines)


PICTURES: Parts = {
    "dialler": lambda: handshake_picture(Side.DIALLER),
    "accepter": lambda: handshake_picture(Side.ACCEPTER),
    "messages": message_table,
    "exchanges": exchange_table,
    "phases": phase_table,
}


if __name__ == "__main__":
    remake(map(Path, sys.argv[1:]), PICTURES)
