"""What went wrong, for the person at the page."""

from __future__ import annotations

from dataclasses import dataclass

from volsplat.protocol.text.errors import PeerLost, VolsplatError

BY_HAND = "nothing can be drawn any more; save the scene, and start volsplat again"
BY_BUTTON = "nothing can be drawn until it is started again"


@dataclass(frozen=True)
class Trouble:
    """A line for the person. What is lasting is told until another such is, in tabs that are opened later as well."""

    text: str
    lasting: bool = False


OVER = Trouble("", lasting=True)
"""Takes away what lasted."""


def trouble_of(error: VolsplatError, cure: str) -> Trouble:
    """What to tell of an error that ended a picture: without the servers that were lost there will be none."""
    return Trouble(f"{error}; {cure}", lasting=True) if isinstance(error, PeerLost) else Trouble(str(error))
