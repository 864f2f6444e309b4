"""What went wrong, for the person at the page."""

from __future__ import annotations

from dataclasses import dataclass

from volsplat.protocol.text.errors import VolsplatError

BY_HAND = "nothing can be drawn any more; save the scene, and start volsplat again"
BY_BUTTON = "nothing can be drawn until it is started again"


@dataclass(frozen=True)
class Trouble:
    """A line for the person. What is lasting is told until another such is, in tabs that are opened later as well."""

    text: str
    lasting: bool = False


OVER = Trouble("", lasting=True)
"""Takes away what lasted."""


def end_of_session(failure: VolsplatError, cure: str) -> Trouble:
    """What to tell of what ended it: there will be no picture until a person has done something."""
    return Trouble(f"{failure}; {cure}", lasting=True)
