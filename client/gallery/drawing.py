"""Draws the plates' images, each volume opened once, and lays them on their sheets."""

import os
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from volsplat.client.gallery.plates import IMAGES, PLATES, DataSet, Plate, PlateImage, scene_path, step_of
from volsplat.client.image.image_file import over_background, write_image, write_pixels
from volsplat.client.image.image_formats import check_writable
from volsplat.client.image.image_properties import image_properties
from volsplat.client.image.phase_wheel import phase_legend, wheel_colours
from volsplat.client.image.picture_sheet import SheetPicture, picture_sheet
from volsplat.client.phantoms import streamed_phantom
from volsplat.client.phantoms.volume_writer import write_phantom
from volsplat.client.scene.scene_file import read_scene_file
from volsplat.client.session.renderer import Renderer
from volsplat.program.temporary_folder import temporary_folder
from volsplat.protocol.description.colours import Colour
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.volume import Index
from volsplat.protocol.rules.refinement import PAPER_STEPS
from volsplat.protocol.text.errors import BadInput

COLUMNS = 2

Opened = Callable[[str], AbstractContextManager[Renderer]]  # by the volume's name


@dataclass(frozen=True)
class Drawn:
    """A finished image over its background, (H, W, 3), and what it was made of."""

    pixels: NDArray[np.float32]
    label: str
    phases: tuple[Colour, ...] | None = None  # the colours of equal sectors of phase, if it is coloured by phase


def sheet_path(folder: Path, plate: Plate) -> Path:
    return folder / f"plate-{plate.number}.png"


def image_path(folder: Path, image: PlateImage) -> Path:
    return folder / f"{image.name}.png"


@contextmanager
def gallery_folder(folder: Path, data: Path | None) -> Iterator[None]:
    """Make the folder; what was made of it is gone again if it holds nothing in the end.

    Raises BadInput if it, an image in it or the folder of data cannot be used.
    """
    absent = [place for place in (folder, *folder.parents) if not os.path.exists(place)]
    try:
        _check_places(folder, data)
        yield
    finally:
        with suppress(OSError):  # one holds something
            for place in absent:
                place.rmdir()


def _check_places(folder: Path, data: Path | None) -> None:
    if data is not None and not data.is_dir():
        raise BadInput(f"{data}: there is no such folder; --data names the one with the measured volumes")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInput(f"{folder}: cannot make this folder: {error.strerror}; name another") from error
    for path in (*(image_path(folder, image) for image in IMAGES), *(sheet_path(folder, plate) for plate in PLATES)):
        check_writable(path)


def draw_gallery(
    folder: Path,
    data: Path | None,
    pixels: int,
    opened: Opened,
    say: Callable[[str], None],
    done: Callable[[int], None],
    last: Step,
) -> None:
    """Write the sixteen images, square with so many pixels aside, and the four sheets.

    `last`: what stands in the place of step F, where the volume has a picture of it.
    """
    drawn: dict[str, Drawn] = {}
    for data_set in dict.fromkeys(image.data for image in IMAGES):
        for name, image in _drawn(data_set, folder, data, pixels, opened, say, last):
            drawn[name] = image
            say(name)
            done(len(drawn))
    for plate in PLATES:
        write_pixels(sheet_path(folder, plate), plate_sheet(plate, drawn))


def plate_sheet(plate: Plate, drawn: dict[str, Drawn]) -> NDArray[np.float32]:
    """The sheet of a plate as (H, W, 3) float32; `drawn` has its images by name."""
    shown = [_sheet_picture(image, drawn[image.name]) for image in plate.images]
    return picture_sheet(shown, COLUMNS, f"Plate {plate.number}: {plate.title}")


def _sheet_picture(image: PlateImage, drawn: Drawn) -> SheetPicture:
    phases = drawn.phases
    legend = None if phases is None else lambda side, paper: phase_legend(phases, side, paper=paper)
    return SheetPicture(drawn.pixels, image.mark, image.caption, note=drawn.label, legend=legend)


def _drawn(
    data_set: DataSet,
    folder: Path,
    data: Path | None,
    pixels: int,
    opened: Opened,
    say: Callable[[str], None],
    last: Step,
) -> Iterator[tuple[str, Drawn]]:
    """Draws and writes all images of a volume, and gives each by its name."""
    measured = data is not None and bool(data_set.measured) and (data / data_set.measured).exists()
    with _volume(data_set, data if measured else None, say) as volume, opened(volume) as renderer:
        for image in IMAGES:
            if image.data != data_set:
                continue
            scene = sized(read_scene_file(scene_path(image, measured), renderer.volume.default_scene()), pixels)
            step = step_of(image, measured, last, renderer.volume.has)
            finished = renderer.finish(scene, step).published.pixels
            properties = image_properties(renderer.volume.description, renderer.volume.settled(scene))
            write_image(image_path(folder, image), finished, scene, properties)
            pixels_shown = over_background(finished, scene.image.background)
            description = renderer.volume.description
            below = label(data_set, measured, description.geometry.dims)
            below += f", step {step}" if step not in PAPER_STEPS else ""
            yield image.name, Drawn(pixels_shown, below, wheel_colours(description, scene))


def label(data_set: DataSet, measured: bool, dims: Index) -> str:
    """What stands below an image: which volume it shows, and its size."""
    named = data_set.measured_label if measured else data_set.phantom_label
    return f"{named}, {' x '.join(map(str, dims))}"


@contextmanager
def _volume(data_set: DataSet, data: Path | None, say: Callable[[str], None]) -> Iterator[str]:
    """The name of the measured volume in the folder of data, or of the phantom, which is there for the time being."""
    if data is not None:
        yield f"{data / data_set.measured}" + (f"#{data_set.part}" if data_set.part else "")
        return
    say(f"making the phantom {data_set.phantom}")
    with temporary_folder() as place:
        volume = place / f"{data_set.phantom}.nrrd"
        write_phantom(volume, streamed_phantom(data_set.phantom))
        yield str(volume)


def sized(scene: Scene, pixels: int) -> Scene:
    """The scene in a square image, seen as large in proportion as in its own."""
    own = scene.image
    view = scene.view
    if view.zoom != "fit":
        view = msgspec.structs.replace(view, zoom=view.zoom * pixels / min(own.width, own.height))
    image = msgspec.structs.replace(own, width=pixels, height=pixels)
    return msgspec.structs.replace(scene, view=view, image=image)
