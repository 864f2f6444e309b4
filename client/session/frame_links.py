"""What went over each link for a frame, and who waited there."""

from collections.abc import Iterator

import msgspec

from volsplat.client.session.renderer import StepOutcome


class LinkReport(msgspec.Struct, frozen=True):
    """What went one way between two processes; the seconds are those of all threads that sent."""

    sender: str
    receiver: str
    bytes: int  # through memory that both see as well
    bytes_uncoded: int
    sending_seconds: float
    waiting_seconds: float  # of these, for the receiver or the network
    held_back_seconds: float  # that the receiver did not read a socket, because its buffers were full


def links_of(outcome: StepOutcome) -> Iterator[LinkReport]:
    """Each link that batches went over, then those that images came by."""
    for worker, stats in sorted(outcome.servers.map_shade.items()):
        for splat, link in sorted(stats.links.items()):
            yield LinkReport(
                sender=f"map/shade server {worker}",
                receiver=f"splat server {splat}",
                bytes=link.bytes,
                bytes_uncoded=link.raw_bytes,
                sending_seconds=link.sending_seconds,
                waiting_seconds=link.waiting_seconds,
                held_back_seconds=_held_back(outcome, splat, worker),
            )
    for splat, image in sorted(outcome.image_reads.items()):
        yield LinkReport(f"splat server {splat}", "client", image.payload_bytes(), image.raw_bytes, 0.0, 0.0, 0.0)


def _held_back(outcome: StepOutcome, splat: int, worker: int) -> float:
    stats = outcome.servers.splat.get(splat)
    return stats.held_back_seconds.get(worker, 0.0) if stats is not None else 0.0
