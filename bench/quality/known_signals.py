"""Likeness to what is known exactly: the Marschner-Lobb signal as a thin surface, and a soft ball as a check.

The ball is so smooth that all must draw it alike: it shows that light, tables, camera and pixels are the same.
"""

from collections.abc import Mapping, Sequence

import torch
from torch import Tensor

from volsplat.bench.peers.contenders import VTK
from volsplat.bench.quality.density_fields import SplineField, ball_field, marschner_lobb_field
from volsplat.bench.quality.findings import Findings, Goal, Row, findings
from volsplat.bench.quality.lit_scenes import ball_scene, signal_view, viewed
from volsplat.bench.quality.side_by_side import STEP_G, opened_phantom, opened_values
from volsplat.bench.ssim import luminance, ssim
from volsplat.bench.tables.plot import Panel
from volsplat.bench.tables.progress import shown_progress
from volsplat.client.phantoms.centred_grid import centred_geometry
from volsplat.protocol.description.view_rotation import rotation_from_angles

SSIM = "SSIM"
SPLINE = "cubic spline"
SAMPLE, SPLINE_SAMPLE, BALL_SAMPLE = 1 / 64, 1 / 32, 1 / 16  # voxels between two of a ray
DEFAULT_GOAL, INTERPOLATING_GOAL = 0.85, 0.95

BALL_SIZE, BALL_RADIUS, BALL_EDGE = (64, 64, 64), 18.0, 20.0  # voxels
BALL_ANGLES, BALL_ZOOM, BALL_SIDE = (30.0, 20.0, 10.0), 2.5, 160
BALL_GOAL = 0.99


def signal_findings(zooms: Sequence[float], distances: Sequence[float]) -> Findings:
    """SSIM of every contender with the signal's own image."""
    rows = []
    with opened_phantom("marschner-lobb", None) as opened:
        spline = SplineField(opened.values)
        with shown_progress("Marschner-Lobb", len(zooms)) as step:
            for zoom in zooms:
                scene = opened.settled(signal_view(zoom))
                exact = opened.rays_through(marschner_lobb_field(opened.geometry), scene, SAMPLE)
                found = likeness(exact, opened.pictures(scene, distances, variants=True))
                found |= likeness(exact, {SPLINE: opened.rays_through(spline, scene, SPLINE_SAMPLE)})
                rows.append(Row(f"zoom {zoom:g}", found, signal_goal(found)))
                step()
    caption = (
        "41 x 41 x 41 voxels, the surface at 0.5, against rays through the signal itself, a sample every 1/64 voxel. "
        f"{SPLINE}: rays through an interpolating cubic spline of the voxels. Goal: the default kernel {DEFAULT_GOAL}, "
        f"the best one {INTERPOLATING_GOAL}, each above VTK's."
    )
    return findings("Marschner-Lobb", SSIM, "", rows, caption, [likeness_panel(rows, zooms)])


def signal_goal(found: Mapping[str, float]) -> Goal:
    best = max(value for name, value in found.items() if name.startswith(STEP_G))
    peers = max((value for name, value in found.items() if name.startswith(VTK)), default=0.0)
    reached = found[STEP_G] >= max(DEFAULT_GOAL, peers) and best >= INTERPOLATING_GOAL
    return Goal(f"{DEFAULT_GOAL}, {INTERPOLATING_GOAL}, VTK", reached)


def likeness(exact: Tensor, pictures: Mapping[str, Tensor]) -> dict[str, float]:
    """SSIM of the luminance of each picture with the exact one's."""
    return {name: ssim(luminance(exact), luminance(picture)) for name, picture in pictures.items()}


def likeness_panel(rows: Sequence[Row], zooms: Sequence[float]) -> Panel:
    names = list(rows[0].values)
    lines = {name: [(zoom, row.values[name]) for zoom, row in zip(zooms, rows, strict=True)] for name in names}
    return Panel("Marschner-Lobb surface", "zoom, pixels a voxel", SSIM, lines, faint=(SPLINE,))


def ball_findings(distances: Sequence[float]) -> Findings:
    """That everybody draws a smooth solid alike."""
    geometry = centred_geometry(BALL_SIZE, (1.0, 1.0, 1.0))
    field = ball_field(geometry, BALL_RADIUS, BALL_EDGE)
    k, j, i = torch.meshgrid(*(torch.arange(count).double() for count in BALL_SIZE[::-1]), indexing="ij")
    values = field.density(torch.stack((i, j, k), dim=-1).reshape(-1, 3)).reshape(k.shape).float()
    with opened_values(values, geometry) as opened:
        turned = viewed(ball_scene(), rotation_from_angles(*BALL_ANGLES), BALL_ZOOM, (BALL_SIDE, BALL_SIDE))
        scene = opened.settled(turned)
        found = likeness(opened.rays_through(field, scene, BALL_SAMPLE), opened.pictures(scene, distances))
    goal = Goal(f"above {BALL_GOAL}", min(found.values()) > BALL_GOAL)
    caption = "A soft ball, which no reconstruction blurs: it shows that all have the same light, tables and camera."
    return findings("Check", SSIM, "", [Row("soft ball", found, goal)], caption)
