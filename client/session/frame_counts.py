"""What a finished frame adds to the counts of its session."""

from volsplat.client.session.frame_links import links_of
from volsplat.client.session.renderer import StepOutcome
from volsplat.program.counts import Counts


def count_outcome(counts: Counts, outcome: StepOutcome) -> None:
    """Add a finished frame; what servers spent on it they count themselves."""
    counts.add("frames", of="incomplete" if outcome.servers.missing else "finished")
    counts.add("packets", sum(stats.packets for stats in outcome.servers.map_shade.values()))
    counts.add("batches", sum(stats.batches for stats in outcome.servers.map_shade.values()))
    image = outcome.image_seconds
    counts.add_all("frame_seconds", [("drawing", outcome.wall_seconds - image), ("image", image)])
    for link in links_of(outcome):
        name = f"{link.sender} to {link.receiver}"
        counts.add("link_bytes", link.bytes, name)
        counts.add("link_waiting_seconds", link.waiting_seconds, name)
        counts.add("link_held_back_seconds", link.held_back_seconds, name)
