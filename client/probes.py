"""A probe on its way: asked of every map/shade server that holds a sub-cube, answered by the front-most voxel."""

from dataclasses import dataclass, field

from volsplat.protocol.line_of_sight import LineOfSight
from volsplat.protocol.messages import ProbedVoxel
from volsplat.protocol.scene import Scene


@dataclass
class RunningProbe:
    """`line` begins at the point x, y of the scene's image."""

    probe: int
    scene: Scene
    x: float
    y: float
    line: LineOfSight
    pending: set[int] | None = None  # servers that were asked and have not answered; None before
    found: list[ProbedVoxel] = field(default_factory=list)

    @property
    def answered(self) -> bool:
        return self.pending is not None and not self.pending

    @property
    def front_most(self) -> ProbedVoxel | None:
        """Of what the servers found."""
        return min(self.found, key=lambda voxel: self.line.place(voxel.index), default=None)
