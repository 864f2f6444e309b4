"""How much of what walkers send is hidden, by which it is seen whether they should wait for the merge."""

from collections.abc import Mapping

from volsplat.protocol.messages import messages

MUCH_HIDDEN = 0.25  # of the packets that were sent
PACED_FRAMES = 16  # then one that is not paced shows how much is hidden now


class HiddenShare:
    """How much was sent in vain.

    Waiting costs time wherever little is hidden: then several links that could be busy wait for one.
    """

    def __init__(self) -> None:
        self._paced = 0  # frames that still are

    @property
    def much(self) -> bool:
        """Whether it is worth it to wait."""
        return self._paced > 0

    def measured(self, request: messages.RenderFrame, stats: Mapping[int, messages.SplatStats]) -> None:
        """Take what the splat servers of a finished frame report."""
        if request.paced:
            self._paced -= 1
        if request.paced or not request.drawing.plan.hides:
            return
        packets = sum(one.packets for one in stats.values())
        hidden = sum(one.hidden_packets for one in stats.values())
        self._paced = PACED_FRAMES if hidden > MUCH_HIDDEN * packets else 0
