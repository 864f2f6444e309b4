"""What a server was at while it drew a frame, noted as it goes if the client wants a trace."""

import time

from volsplat.protocol.messages.trace_messages import MOST_SPANS, FrameTraced, Span

clock = time.perf_counter  # that spans are told by


class FrameSpans:
    """Of one frame. Any thread may note; nothing is kept unless it is `wanted`."""

    def __init__(self, frame: int = 0, wanted: bool = False) -> None:
        self.frame = frame
        self.wanted = wanted
        self._spans: list[Span] = []  # appended to only, which is safe for any thread

    def note(self, row: str, name: str, began: float, ended: float) -> None:
        """By `clock`. What lies within another span of its row must not reach beyond it."""
        if self.wanted:
            self._spans.append(Span(row, name, began, max(began, ended)))

    def traced(self) -> list[Span]:
        """All of them so far."""
        return list(self._spans)

    def told(self, frame: int) -> FrameTraced:
        """The answer to who asks for the spans of a frame: none of any other."""
        spans = self.traced() if frame == self.frame else []
        return FrameTraced(frame, spans[:MOST_SPANS], max(0, len(spans) - MOST_SPANS))


UNTRACED = FrameSpans()
