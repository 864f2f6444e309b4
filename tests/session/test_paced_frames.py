"""Frames whose walkers wait for the merge over slow links: only where much is hidden, with the same bits."""

from pathlib import Path

import msgspec
import pytest

from support.messages.message_samples import SAMPLES
from volsplat.bench.hosts.cluster import cluster_of_hosts
from volsplat.bench.hosts.namespaces import why_no_lab
from volsplat.client.coordinator.hidden_share import PACED_FRAMES, HiddenShare
from volsplat.client.phantoms import make_phantom
from volsplat.client.phantoms.volume_writer import write_volume
from volsplat.client.session.single import SingleProcess
from volsplat.protocol.description.scene import Order
from volsplat.protocol.messages.frame_messages import FrameFinished, RenderFrame, SplatStats
from volsplat.protocol.rules.frame_plan import Reach

WHY_NOT = why_no_lab()
SIDE = 112
SLOW = 20e6  # bits a second
OPAQUE = ((0.0, 0.0), (0.2, 0.0), (0.25, 1.0), (1.0, 1.0))


def request(paced: bool, hides: bool = True) -> RenderFrame:
    sent = SAMPLES[RenderFrame][0]
    assert isinstance(sent, RenderFrame)
    order = Order.FRONT_TO_BACK if hides else Order.BACK_TO_FRONT
    plan = msgspec.structs.replace(sent.drawing.plan, order=order)
    assert plan.reach != Reach.PIXEL and plan.hides == hides
    return msgspec.structs.replace(sent, drawing=msgspec.structs.replace(sent.drawing, plan=plan), paced=paced)


def stats(packets: int, hidden: int) -> dict[int, SplatStats]:
    finished = SAMPLES[FrameFinished][0]
    assert isinstance(finished, FrameFinished)
    return {1: msgspec.structs.replace(finished.stats, packets=packets, hidden_packets=hidden)}


def test_frames_are_paced_while_much_is_hidden_and_one_now_and_then_shows_whether_it_is() -> None:
    share = HiddenShare()
    assert not share.much
    share.measured(request(paced=False), stats(100, 60))
    for _ in range(PACED_FRAMES):
        assert share.much
        share.measured(request(paced=False, hides=False), stats(100, 0))  # says nothing of it
        share.measured(request(paced=True), stats(50, 5))
    assert not share.much
    share.measured(request(paced=False), stats(100, 60))
    assert share.much


def test_frames_of_which_little_is_hidden_are_not_paced() -> None:
    share = HiddenShare()
    share.measured(request(paced=False), stats(100, 10))
    assert not share.much
    share.measured(request(paced=False), stats(0, 0))
    assert not share.much


@pytest.mark.skipif(bool(WHY_NOT), reason=WHY_NOT)
def test_over_slow_links_little_that_is_hidden_is_sent_and_the_bits_are_the_same(tmp_path: Path) -> None:
    path = str(tmp_path / "head.mha")
    write_volume(Path(path), *make_phantom("head", size=(SIDE,) * 3))
    with SingleProcess(path) as single:
        scene = single.volume.default_scene().with_(size=256, opac=OPAQUE)
        image = single.render(scene)
    with cluster_of_hosts(path, 2, 1, SLOW, lambda _: None) as session:
        sent = []
        for _ in range(4):
            drawn = session.finish(scene)
            assert drawn.outcome is not None and (drawn.image == image).all()
            sent.append(sum(worker.packets for worker in drawn.outcome.servers.map_shade.values()))
    assert sent[-1] < 0.8 * sent[0]
