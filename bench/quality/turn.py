"""How smoothly the picture changes while the head turns, also where the order of its sheets does."""

from collections.abc import Sequence
from statistics import median

from torch import Tensor

from volsplat.bench.quality.findings import Findings, Goal, Row, findings
from volsplat.bench.quality.side_by_side import STEP_G, SideBySide, opened_phantom
from volsplat.bench.ssim import luminance
from volsplat.bench.tables.plot import Panel
from volsplat.bench.tables.progress import shown_progress
from volsplat.bench.views import ELEVATION, seen
from volsplat.client.scene.presets import preset_scene
from volsplat.protocol.description.view_rotation import rotation_from_angles
from volsplat.protocol.description.volume import Index

PRESETS = ("ct-skin", "ct-bone")
DEGREES = 0.5
MIDDLE = 45.0  # where i and j change places as the axis that leads away
GOAL = 1.05


def turn_findings(views: int, size: Index | None, side: int) -> Findings:
    """Of so many views, half a degree apart, about the one at 45 degrees."""
    azimuths = [MIDDLE + DEGREES * (n - (views - 1) / 2) for n in range(views)]
    rows, panels = [], []
    with opened_phantom("head", size) as opened:
        for preset in PRESETS:
            changes = _changes(opened, preset, azimuths, side)
            jumps = {name: greatest_jump(found) for name, found in changes.items()}
            rows.append(
                Row(f"{preset}: greatest by its neighbours", jumps, Goal(f"G at most {GOAL}", jumps[STEP_G] <= GOAL))
            )
            rows.append(Row(f"{preset}: greatest by the median", {n: max(c) / median(c) for n, c in changes.items()}))
            panels.append(_panel(preset, azimuths, changes))
    caption = f"{views} views {DEGREES:g} degrees apart; the mean difference of a frame from the one before it."
    return findings("Turn", "change of a frame", "", rows, caption, panels)


def _changes(opened: SideBySide, preset: str, azimuths: Sequence[float], side: int) -> dict[str, list[float]]:
    scene = preset_scene(preset, opened.renderer.volume.subject())
    changes: dict[str, list[float]] = {}
    before: dict[str, Tensor] = {}
    contenders = opened.contenders(scene, ())
    with shown_progress(f"turn, {preset}", len(azimuths)) as step:
        for azimuth in azimuths:
            view = opened.settled(seen(scene, opened.geometry, rotation_from_angles(azimuth, ELEVATION), (side, side)))
            for contender in contenders:
                contender.draw(view)
                now = luminance(contender.picture())
                if contender.name in before:
                    change = float((now - before[contender.name]).abs().mean())
                    changes.setdefault(contender.name, []).append(change)
                before[contender.name] = now
            step()
    return changes


def greatest_jump(changes: Sequence[float]) -> float:
    """The greatest ratio of a change to the mean of the one before and the one after it."""
    return max(
        2 * now / (before + after) for before, now, after in zip(changes, changes[1:], changes[2:], strict=False)
    )


def _panel(preset: str, azimuths: Sequence[float], changes: dict[str, list[float]]) -> Panel:
    lines = {name: list(zip(azimuths[1:], found, strict=True)) for name, found in changes.items()}
    return Panel(f"a turn of the head, {preset}", "degrees", "mean change of luminance from the view before", lines)
