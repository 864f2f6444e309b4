"""What a single process did for a frame, in its trace file."""

from collections.abc import Callable

from volsplat.client.trace.frame_tracer import FrameTracer
from volsplat.program.frame_spans import FrameSpans
from volsplat.protocol.description.refinement_steps import Step


def note_frame(
    tracer: FrameTracer,
    frame: int,
    step: Step,
    moments: tuple[float, float, float, float],
    note_owners: Callable[[FrameSpans, float], None],
) -> None:
    """Of a frame that began, was planned, was drawn, and was published at these moments.

    `note_owners` gets spans for what the threads did, and when they were planned.
    """
    began, planned, drawn, published = moments
    tracer.note(frame, "caller", f"frame {frame}, step {step}", began, published)
    for name, start, end in (("plan", began, planned), ("draw", planned, drawn), ("publish", drawn, published)):
        tracer.note(frame, "caller", name, start, end)
    spans = FrameSpans(frame, wanted=True)
    note_owners(spans, planned)
    for span in spans.traced():
        tracer.note(frame, span.row, span.name, span.began, span.ended)
    tracer.finish(frame)
