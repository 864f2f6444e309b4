"""Likeness of a CT's skin and bone to rays through a cubic spline of the same voxels."""

from collections.abc import Mapping, Sequence

from volsplat.bench.peers.contenders import vtk_name
from volsplat.bench.quality.density_fields import SplineField
from volsplat.bench.quality.findings import Findings, Goal, Row, findings
from volsplat.bench.quality.known_signals import SSIM, likeness
from volsplat.bench.quality.side_by_side import STEP_G, SideBySide, opened_file, opened_phantom
from volsplat.bench.tables.progress import shown_progress
from volsplat.bench.tables.scene_tables import TableName, benchmark_scene
from volsplat.bench.views import seen
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.view_rotation import rotation_from_angles
from volsplat.protocol.description.volume import Index

TISSUES = (TableName.SKIN, TableName.BONE)
ANGLES = (30.0, 12.0)
SAMPLE = 1 / 8  # voxels between two of a ray
FINER = 0.5  # VTK's, of which G is to be above


def head_findings(volume: str | None, size: Index | None, sides: Sequence[int], distances: Sequence[float]) -> Findings:
    """Of the CT at `volume`, or else the head phantom in `size`."""
    with opened_file(volume) if volume else opened_phantom("head", size) as opened:
        field = SplineField(opened.values)
        rows = []
        with shown_progress("head", len(sides) * len(TISSUES)) as step:
            for side in sides:
                for tissue in TISSUES:
                    view = tissue_view(opened, tissue, side)
                    found = likeness(
                        opened.rays_through(field, view, SAMPLE), opened.pictures(view, distances, variants=True)
                    )
                    rows.append(Row(f"{tissue}, {side} x {side}", found, head_goal(found)))
                    step()
    caption = "Against rays through an interpolating cubic spline of the voxels, float64, a sample every 1/8 voxel."
    return findings("CT head", SSIM, "", rows, caption)


def tissue_view(opened: SideBySide, tissue: TableName, side: int) -> Scene:
    scene = benchmark_scene(tissue, opened.renderer.volume.density_histogram())
    return opened.settled(seen(scene, opened.geometry, rotation_from_angles(*ANGLES), (side, side)))


def head_goal(found: Mapping[str, float]) -> Goal | None:
    if vtk_name(FINER) not in found:
        return None
    return Goal(f"above VTK at {FINER:g}", found[STEP_G] > found[vtk_name(FINER)])
