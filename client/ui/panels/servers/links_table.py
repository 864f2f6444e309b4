"""The links between servers: what went over each for the last frame, and who waited there."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape

from volsplat.client.session.frame_links import LinkReport, links_of
from volsplat.client.session.renderer import StepOutcome
from volsplat.program.counts import Key

HEADS = ("from", "to", "MB", "MB uncoded", "sending, ms", "waiting, ms", "held back, ms")


def links_table(outcome: StepOutcome) -> str:
    """A table in HTML, a row for each link; nothing where there is none."""
    rows = "".join(_row(link) for link in links_of(outcome))
    head = "".join(f"<th>{escape(name)}</th>" for name in HEADS)
    return f"<table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>" if rows else ""


def _row(link: LinkReport) -> str:
    sizes = [f"{nbytes / 1e6:,.3f}" for nbytes in (link.bytes, link.bytes_uncoded)]
    seconds = (link.sending_seconds, link.waiting_seconds, link.held_back_seconds)
    cells = [link.sender, link.receiver, *sizes, *(f"{1000 * one:.1f}" for one in seconds)]
    return f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in cells)}</tr>"


def losses_words(counted: Mapping[Key, float]) -> str:
    """How many servers a session has lost so far; "" for none."""
    lost = [f"{number:g} {of}{'s' if number > 1 else ''}" for (what, of), number in counted.items() if what == "losses"]
    return f"lost since the start: {', '.join(sorted(lost))}" if lost else ""
