"""The frames of `volsplat bench scaling`: one thing grows at a time, and every renderer draws each setting in turns."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import msgspec

from volsplat.bench.renderers import Row
from volsplat.bench.tables.progress import shown_progress
from volsplat.bench.tables.record import Figure, figure
from volsplat.bench.tables.text_table import significant
from volsplat.bench.timing import interleaved
from volsplat.client.session.frame_report import StepReport, report_of
from volsplat.protocol.description.scene import Bounds, Scene
from volsplat.protocol.description.shading_tables import ScalarTable, Tables
from volsplat.protocol.description.volume import Geometry

VISIBLE_THRESHOLDS = (0.0, 0.25, 0.5, 0.75)  # of the way from the first visible density to the last


@dataclass(frozen=True, eq=False)
class Case:
    """One setting whose growth is measured, and its views."""

    group: str  # what grows: voxels, visible voxels, pixels, servers
    value: float  # of it, in millions; of servers their number
    scenes: Sequence[Scene]

    @property
    def name(self) -> str:
        return f"{self.group} {significant(self.value)}" + ("" if "above" in self.group else " M")


@dataclass(frozen=True)
class Taken:
    """The frames of a row in a case."""

    case: Case
    row: Row
    reports: Sequence[StepReport]

    @property
    def seconds(self) -> Figure:
        return self.figure("frame", "s", lambda report: report.wall_seconds)

    def figure(self, quantity: str, unit: str, value: Callable[[StepReport], float]) -> Figure:
        """What the reports say of a quantity."""
        name = f"{self.case.name}, {self.row.name}: {quantity}"
        return figure(name, unit, [value(report) for report in self.reports], self.case.name, self.row.workers)

    @property
    def usual(self) -> StepReport:
        """The frame of median time."""
        return usual_frame(self.reports)


def usual_frame(reports: Sequence[StepReport]) -> StepReport:
    """The one of median time."""
    return sorted(reports, key=lambda report: report.wall_seconds)[len(reports) // 2]


def voxel_cases(
    scene: Scene, geometry: Geometry, parts: Sequence[float], views: Callable[[Scene], list[Scene]]
) -> list[Case]:
    """Boxes in the middle of the volume that hold these shares of its voxels."""
    cases = []
    for part in parts:
        sides = [max(1, round(count * part ** (1 / 3))) for count in geometry.dims]
        low = [(count - side) // 2 for count, side in zip(geometry.dims, sides, strict=True)]
        high = [first + side for first, side in zip(low, sides, strict=True)]
        bounds = Bounds(low=(low[0], low[1], low[2]), high=(high[0], high[1], high[2]))
        voxels = sides[0] * sides[1] * sides[2]
        cases.append(Case("voxels", voxels / 1e6, views(msgspec.structs.replace(scene, bounds=bounds))))
    return cases


def visible_cases(scene: Scene, views: Callable[[Scene], list[Scene]]) -> list[Case]:
    """The opacity table cut off at rising densities; the visible voxels are counted when they are drawn."""
    entries = scene.tables.opac.entries()
    visible = [n for n, opacity in enumerate(entries) if opacity > 0]
    cases = []
    for way in VISIBLE_THRESHOLDS:
        first = visible[int(way * (len(visible) - 1))] if visible else 0
        points = tuple((n / 255, opacity if n >= first else 0.0) for n, opacity in enumerate(entries))
        cut: Tables = msgspec.structs.replace(scene.tables, opac=ScalarTable(points=points))
        cases.append(Case("visible above", float(first), views(msgspec.structs.replace(scene, tables=cut))))
    return cases


def frames_of(rows: Sequence[Row], cases: Sequence[Case]) -> list[Taken]:
    """Each case by all rows in turns; the first view of each is drawn once before, so that tables are made."""
    found = []
    with shown_progress("frames", sum(len(case.scenes) for case in cases)) as step:
        for case in cases:
            reports: dict[int, list[StepReport]] = {row.workers: [] for row in rows}
            for row in rows:
                row.renderer.finish(case.scenes[0])
            contenders = {row.workers: _reporting(row, reports[row.workers]) for row in rows}
            interleaved(contenders, case.scenes, lambda scene: step())
            found += [Taken(case, row, reports[row.workers]) for row in rows]
    return found


def _reporting(row: Row, reports: list[StepReport]) -> Callable[[Scene], float]:
    """Draws a scene, adds its report and gives the seconds."""

    def draw(scene: Scene) -> float:
        outcome = row.renderer.finish(scene).outcome
        assert outcome is not None
        reports.extend(report_of(row.renderer.volume, scene, [outcome]).steps)
        return outcome.wall_seconds

    return draw
