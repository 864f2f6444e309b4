"""What the pictures cost: milliseconds of F, G and VTK, one thread each, in turns within one run.

Goals are judged by processor time: of one thread it is what a quiet machine's clock shows, and other work takes none.
"""

from collections.abc import Callable, Mapping, Sequence

from volsplat.bench.peers.contenders import Contender, vtk_name
from volsplat.bench.quality.ct_head import FINER
from volsplat.bench.quality.findings import Findings, Goal, Row, findings
from volsplat.bench.quality.side_by_side import STEP_F, STEP_G, SideBySide, opened_phantom
from volsplat.bench.tables.progress import shown_progress
from volsplat.bench.tables.scene_tables import TableName, benchmark_scene
from volsplat.bench.timing import interleaved, processor_seconds, wall_seconds
from volsplat.bench.views import around, seen
from volsplat.protocol.description.scene import Scene

VIEWS = 24  # once around, of which the first ones are drawn
MOST_TIMES_F = 3.0


def time_findings(voxels: int, sides: Sequence[int], repeats: int, distances: Sequence[float]) -> Findings:
    """Of the shells phantom with so many voxels a side, in images of several sizes."""
    with opened_phantom("shells", (voxels, voxels, voxels)) as opened:
        finer = [distance for distance in distances if distance == FINER]
        rows = [row for side in sides for row in _rows(opened, side, repeats, finer)]
    caption = (
        f"Shells, {voxels} x {voxels} x {voxels} voxels. The least of {repeats} views, all in turns: by the clock, and "
        "of processor time, which goals are judged by, since other work takes none of it."
    )
    return findings("Time", "milliseconds", "ms", rows, caption)


def _rows(opened: SideBySide, side: int, repeats: int, distances: Sequence[float]) -> list[Row]:
    scene = benchmark_scene(TableName.SHELLS, opened.renderer.volume.density_histogram())
    views = [
        opened.settled(seen(scene, opened.geometry, rotation, (side, side)))
        for rotation in around(VIEWS)[: repeats + 1]
    ]
    before = dict(zip(views[1:], views, strict=False))
    contenders = opened.contenders(scene, distances)
    waited: dict[str, list[float]] = {contender.name: [] for contender in contenders}
    with shown_progress(f"times, {side} x {side} pixels", repeats) as step:
        timed = {c.name: _timed(c, before, waited[c.name]) for c in contenders}
        taken = interleaved(timed, views[1:], lambda done: step())
    least = _least(taken)
    to_f = least[STEP_G] / least[STEP_F]
    words, goal = f"{side} x {side}", Goal(f"G at most {MOST_TIMES_F:g} F: {to_f:.1f}", to_f <= MOST_TIMES_F)
    rows = [Row(words, _least(waited)), Row(f"{words}, processor time", least, goal)]
    if distances:
        to_vtk = least[STEP_G] / least[vtk_name(FINER)]
        rows.append(Row(f"{words}, beside VTK", {}, Goal(f"G at most VTK's: {to_vtk:.2f}", to_vtk <= 1.0)))
    return rows


def _least(seconds: Mapping[str, Sequence[float]]) -> dict[str, float]:
    """In milliseconds."""
    return {name: 1e3 * min(found) for name, found in seconds.items()}


def _timed(contender: Contender, before: dict[Scene, Scene], waited: list[float]) -> Callable[[Scene], float]:
    """A frame among frames: the one before it is drawn first, since another contender has had the caches.

    Its processor seconds; those that passed are added to `waited`.
    """

    def seconds(scene: Scene) -> float:
        contender.draw(before[scene])
        return processor_seconds(lambda: waited.append(wall_seconds(lambda: contender.draw(scene))))

    return seconds
