"""What is drawn of a volume, and how: a part of each message about what pictures show."""

from __future__ import annotations

from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.volume import Geometry, Index
from volsplat.protocol.messages.message import Detail, LevelNumber
from volsplat.protocol.rules.frame_plan import FramePlan, plan_frame
from volsplat.protocol.rules.index_rules import DirectionCode, Quantisation
from volsplat.protocol.rules.levels import Resolution, dims_at_level
from volsplat.protocol.rules.shading_rule import ShadingRule, shading_rule


class Drawing(Detail, frozen=True):
    """Of one of the volume's levels; `geometry` is the volume's."""

    plan: FramePlan
    shading: ShadingRule
    geometry: Geometry
    quantisation: Quantisation
    level: LevelNumber

    @classmethod
    def of(
        cls, scene: Scene, plan: FramePlan, geometry: Geometry, quantisation: Quantisation, level: int = 0
    ) -> Drawing:
        """What a scene shows by its plan."""
        return cls(plan, shading_rule(scene, plan.step), geometry, quantisation, level)

    @classmethod
    def planned(
        cls, scene: Scene, step: Step, geometry: Geometry, quantisation: Quantisation, resolution: Resolution
    ) -> Drawing:
        """What a step of a scene shows. Raises ValueError where the scene does not fit the volume."""
        plan = plan_frame(scene, geometry, step, resolution)
        return cls.of(scene, plan, geometry, quantisation, resolution.level)

    @property
    def dims(self) -> Index:
        """How many voxels the level has along i, j, k."""
        return dims_at_level(self.geometry.dims, self.plan.factors)

    @property
    def directions(self) -> DirectionCode:
        """Which the level's packets have."""
        return self.quantisation.directions_at(self.plan.factors)
