"""The pictures themselves, side by side on one labelled sheet: a row for each subject, a column for each contender."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from torch import Tensor

from volsplat.bench.quality.ct_head import ANGLES
from volsplat.bench.quality.lit_scenes import SIGNAL_ANGLES, grey_scene, signal_scene
from volsplat.bench.quality.side_by_side import SideBySide, opened_phantom
from volsplat.bench.tables.progress import shown_progress
from volsplat.bench.tables.scene_tables import TableName, benchmark_scene
from volsplat.client.histogram.density_histogram import landmarks
from volsplat.client.image.image_file import over_background, write_pixels
from volsplat.client.image.picture_sheet import SheetPicture, picture_sheet
from volsplat.client.scene.table_makers import scalars
from volsplat.protocol.description.scene import Quantise, Scene
from volsplat.protocol.description.view_rotation import rotation_from_angles

SIDE = 320  # pixels of a picture
ZOOMS = (2.0, 6.0)
JPEG_QUALITY = 80

Subject = tuple[str, str, Callable[[SideBySide], Scene]]  # words, phantom, scene


def _by_tables(tables: TableName) -> Callable[[SideBySide], Scene]:
    def scene(opened: SideBySide) -> Scene:
        shown = benchmark_scene(tables, opened.renderer.volume.density_histogram())
        return shown.with_(rotation=rotation_from_angles(*ANGLES))

    return scene


def _signal(opened: SideBySide) -> Scene:
    return signal_scene().with_(rotation=rotation_from_angles(*SIGNAL_ANGLES))


def _grey(between: float, solid: float) -> Callable[[SideBySide], Scene]:
    """Nothing of the background; the opacities where objects begin, and in their cores."""

    def scene(opened: SideBySide) -> Scene:
        at = landmarks(opened.renderer.volume.density_histogram())
        shown = grey_scene(scalars((at.background, 0.0), (at.object, between), (at.core, solid)), Quantise())
        return shown.with_(rotation=rotation_from_angles(*ANGLES))

    return scene


SUBJECTS: Sequence[Subject] = (
    ("head, skin", "head", _by_tables(TableName.SKIN)),
    ("head, bone", "head", _by_tables(TableName.BONE)),
    ("tRNA", "rna", _grey(0.3, 0.9)),
    ("Marschner-Lobb", "marschner-lobb", _signal),
    ("galaxy", "galaxy", _grey(0.05, 0.3)),
    ("shells", "shells", _by_tables(TableName.SHELLS)),
)


def write_sheet(path: Path, subjects: Sequence[Subject], distances: Sequence[float]) -> None:
    """Raises BadInput if the file cannot be written."""
    rows = [row for subject in subjects for row in _rows(subject, distances)]
    cells = [picture for row in rows for picture in row]
    write_pixels(path, picture_sheet(cells, len(rows[0])), jpeg_quality=JPEG_QUALITY)


def _rows(subject: Subject, distances: Sequence[float]) -> Iterator[list[SheetPicture]]:
    words, phantom, scene_of = subject
    with opened_phantom(phantom, None) as opened, shown_progress(f"pictures, {words}", len(ZOOMS)) as step:
        for zoom in ZOOMS:
            scene = opened.settled(scene_of(opened).with_(zoom=zoom, size=SIDE))
            aside = f"{words}, {zoom:g} x"
            yield [_labelled(picture, name, aside) for name, picture in opened.pictures(scene, distances).items()]
            step()


def _labelled(picture: Tensor, name: str, aside: str) -> SheetPicture:
    return SheetPicture(over_background(picture.numpy(), (0.0, 0.0, 0.0)), "", name, aside)
