"""What servers are told of a frame: its plan, made once for all of them, and its shading rule."""

from volsplat.client.coordinator.region_shares import RegionShares
from volsplat.protocol.description.scene import Scene, Step
from volsplat.protocol.description.volume import Geometry
from volsplat.protocol.messages import messages
from volsplat.protocol.rules.frame_plan import plan_frame
from volsplat.protocol.rules.index_rules import Quantisation
from volsplat.protocol.rules.levels import Resolution
from volsplat.protocol.rules.shading_rule import shading_rule


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
) -> messages.RenderFrame:
    """`workers` are the map/shade servers with their walkers, `owners` the splat servers with theirs.

    Raises ValueError where the scene does not fit the volume.
    """
    plan = plan_frame(scene, geometry, step, resolution)
    return messages.RenderFrame(
        frame=frame,
        assignment=assignment,
        plan=plan,
        shading=shading_rule(scene, step),
        geometry=geometry,
        quantisation=quantisation,
        level=resolution.level,
        workers=workers,
        regions=shares.regions(plan, owners),
        exact=exact,
    )
