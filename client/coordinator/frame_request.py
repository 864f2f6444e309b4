"""What servers are told of a frame: its plan, made once for all of them, its shading rule, and how to go about it."""

from collections.abc import Mapping

from volsplat.client.coordinator.shares.region_shares import RegionShares
from volsplat.protocol.description.scene import Scene, Step
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.messages import messages
from volsplat.protocol.messages.drawing import Drawing
from volsplat.protocol.rules.frame_plan import plan_frame
from volsplat.protocol.rules.index_rules import Quantisation
from volsplat.protocol.rules.levels import Resolution

MUCH_HIDDEN = 0.25  # of the packets that were sent
PACED_FRAMES = 16  # then one that is not paced shows how much is hidden now


class HiddenShare:
    """How much was sent in vain, by which it is seen whether walkers should wait for the merge.

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


def frame_request(
    frame: int,
    assignment: int,
    scene: Scene,
    step: Step,
    geometry: Geometry,
    quantisation: Quantisation,
    resolution: Resolution,
    workers: dict[int, int],
    owners: dict[int, int],
    shares: RegionShares,
    exact: bool = True,
    paced: bool = False,
) -> messages.RenderFrame:
    """`workers` are the map/shade servers with their walkers, `owners` the splat servers with theirs.

    Raises ValueError where the scene does not fit the volume.
    """
    plan = plan_frame(scene, geometry, step, resolution)
    return messages.RenderFrame(
        frame=frame,
        assignment=assignment,
        drawing=Drawing.of(scene, plan, geometry, quantisation, resolution.level),
        workers=workers,
        regions=shares.regions(plan, owners),
        exact=exact,
        paced=paced,
    )
