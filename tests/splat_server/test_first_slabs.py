"""The first slabs of step G are seen while voxels are still being sent, and an image without any is not shown."""

import math
from pathlib import Path

import pytest
import torch

from support.files.head_volume import head, skin
from support.files.trace_file import Trace
from volsplat.bench.hosts.cluster import cluster_of_hosts
from volsplat.bench.hosts.namespaces import why_no_lab
from volsplat.client.session.published_image import PublishedImage
from volsplat.client.session.renderer import SOONER, PartialPace
from volsplat.client.session.single import SingleProcess
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.rules.regions import Rectangle

__all__ = ["head"]

WHY_NOT = why_no_lab()
SLOW = 1e6  # bits a second: voxels and image take seconds, within which even a busy machine looks at it

EMPTY, DOT = (PublishedImage.of(torch.full((2, 3, 4), alpha).numpy()) for alpha in (0.0, 0.1))


@pytest.mark.skipif(bool(WHY_NOT), reason=WHY_NOT)
def test_slabs_are_seen_before_the_last_voxels_are_sent(head: Path, tmp_path: Path) -> None:
    with cluster_of_hosts(str(head), 1, 1, SLOW, lambda _: None, trace=tmp_path / "trace.json") as session:
        scene = skin(session)
        first, *_, finished = session.refine(scene, Step.G, partial_interval=0.01, first=Step.G)
    assert not first.complete and first.published.pixels[..., 3].any()
    with SingleProcess(head) as single:
        assert torch.equal(finished.image, single.render(scene, Step.G))
    trace = Trace(tmp_path / "trace.json")
    seen = min(
        span["ts"] + span["dur"] for span in trace.of("client", "from splat server", 1) if span["name"] == "ImageRead"
    )
    sent = [span["ts"] for span in trace.of("map/shade", "walker", 1) if span["name"].startswith("send to")]
    assert seen + trace.error("map/shade") < max(sent)


def test_step_g_is_looked_at_sooner_until_it_shows_anything() -> None:
    pace = PartialPace(Step.G, 1.0)
    assert pace.patience == SOONER and not pace.shows(EMPTY)
    assert pace.patience == SOONER and pace.shows(DOT)
    assert pace.patience == 1.0 and pace.shows(EMPTY)


def test_what_is_lost_is_shown_at_once() -> None:
    assert PartialPace(Step.G, 1.0).shows(EMPTY, (Rectangle(0, 0, 1, 1),))


@pytest.mark.parametrize("step", [Step.A, Step.F])
def test_other_steps_are_looked_at_as_often_as_is_wished(step: Step) -> None:
    pace = PartialPace(step, 1.0)
    assert pace.patience == 1.0 and pace.shows(EMPTY)
    assert PartialPace(step, math.inf).patience == math.inf
