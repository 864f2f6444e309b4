"""What a viewport and the client's process say to each other, as JSON (docs/how_it_works/page.md).

static/viewport/viewport_messages.d.ts has the same for the page, made from this file.
"""

from typing import Annotated

import msgspec

from volsplat.client.image.empty_image import why_empty
from volsplat.client.scene.resized import sized
from volsplat.client.scene.view_sides import sides
from volsplat.client.ui.viewing.pacing import Pacing, Rung
from volsplat.client.ui.viewing.picture import Picture
from volsplat.client.ui.viewing.scene_model import SceneState
from volsplat.client.ui.viewport.message_base import Said, framed
from volsplat.client.ui.viewport.slice_messages import SlicesAsked, SliceShown, SliceValueTold, VoxelAsked, VoxelTold
from volsplat.client.volume.file_voxel import FileVoxel
from volsplat.client.volume.scales import Scale, scales_of
from volsplat.client.volume.surveyed_volume import SurveyedVolume
from volsplat.client.volume.value_certainty import Certainty, density_certainty, strength_certainty
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import LARGEST_EXTENT, Scene
from volsplat.protocol.description.volume import Box, Geometry, GridAxis, Index, VolumeDescription
from volsplat.protocol.geometry import matrices
from volsplat.protocol.geometry.matrices import Matrix
from volsplat.protocol.geometry.upright import Up, upright
from volsplat.protocol.messages.frame_messages import ProbedVoxel
from volsplat.protocol.rules.refinement import finer, finest_step
from volsplat.protocol.rules.regions import Rectangle
from volsplat.protocol.rules.resolved_view import resolved_bounds, resolved_center, resolved_zoom

Extent = Annotated[int, msgspec.Meta(ge=1, le=LARGEST_EXTENT)]  # of an image, in pixels


# -- by the page


class Size(Said, tag="size"):
    """The image that is wanted, in the display's pixels; `again` if it was wanted before the line was cut."""

    width: Extent
    height: Extent
    again: bool = False


class ViewTurned(Said, tag="view"):
    """The whole view, of an image of this size; `event` counts the tab's pointer events."""

    rotation: tuple[float, float, float, float]
    zoom: float
    center: tuple[float, float, float]
    width: Extent
    height: Extent
    settled: bool
    event: int


class BoundsMoved(Said, tag="bounds"):
    """Half-open grid ranges."""

    low: Index
    high: Index
    settled: bool
    event: int


class ProbeAsked(Said, tag="probe"):
    """What lies under this pixel? If it was `picked` that is to be told wherever the pointer has gone since."""

    x: float
    y: float
    picked: bool = False


class CenterAsked(Said, tag="center"):
    """What lies under this pixel becomes the centre."""

    x: float
    y: float


class UndoAsked(Said, tag="undo"):
    """Take the last change back."""


class RedoAsked(Said, tag="redo"):
    """Make it again."""


class PictureShown(Said, tag="shown"):
    """The picture of this number is on the canvas, or dropped."""

    number: int


PageMessage = (
    Size
    | ViewTurned
    | BoundsMoved
    | ProbeAsked
    | CenterAsked
    | UndoAsked
    | RedoAsked
    | PictureShown
    | SlicesAsked
    | SliceShown
    | VoxelAsked
)
_decoder = msgspec.json.Decoder(PageMessage)


def page_message(text: str) -> PageMessage:
    """What the page said. Raises msgspec.ValidationError or DecodeError."""
    message: PageMessage = _decoder.decode(text)
    return message


# -- by the process


class VolumeTold(Said, tag="volume"):
    """The volume as it stands: its grid in upright axes, and what lies on its six sides."""

    name: str
    dims: Index
    index_to_upright: Matrix
    reference_spacing: float
    unit: str
    sides: dict[str, str]  # a mark for each, by the name of the view from there
    density_name: str
    strength_name: str
    value_unit: str
    axes: tuple[GridAxis, GridAxis, GridAxis] | None
    scales: tuple[Scale, ...]


class ViewShown(msgspec.Struct):
    """A view in numbers."""

    rotation: tuple[float, float, float, float]
    zoom: float
    center: tuple[float, float, float]


class Fit(msgspec.Struct):
    """Zoom and centre at which what is visible fits."""

    zoom: float
    center: tuple[float, float, float]


class BoundsShown(msgspec.Struct):
    """Bounds in numbers."""

    low: Index
    high: Index


class SceneTold(Said, tag="scene"):
    """View and bounds in numbers, and once the scene is settled its fit."""

    revision: int
    by: str
    settled: bool
    view: ViewShown
    fit: Fit | None  # None: as told before
    bounds: BoundsShown
    edges: bool
    width: int
    height: int


class ProbeAnswered(Said, tag="probe"):
    """What lies under the pixel that was asked about, and how its values stand to the file's."""

    x: float
    y: float
    found: ProbedVoxel | None
    density_is: Certainty
    strength_is: Certainty


class FileValueTold(Said, tag="value"):
    """What the file has where the voxel lies that was found under this pixel, in all its digits."""

    x: float
    y: float
    density: str
    strength: str | None  # None: the file has no second number


class TroubleTold(Said, tag="trouble"):
    """A line for the person."""

    text: str
    lasting: bool = False


ProcessMessage = VolumeTold | SceneTold | ProbeAnswered | FileValueTold | VoxelTold | SliceValueTold | TroubleTold


class NextStep(msgspec.Struct):
    """What is drawn while the picture is looked at."""

    step: Step
    expected: float | None  # seconds


class PictureHeader(msgspec.Struct):
    """What goes before a picture: JPEG while things move or refine, PNG for the last."""

    number: int
    revision: int
    event: int  # the tab's last that is in it
    step: Step
    one_in: int  # of so many of the step's voxels one was drawn
    complete: bool
    last: bool
    seconds: float | None
    next: NextStep | None
    width: int
    height: int
    view: ViewShown
    notice: str  # why there is nothing to be seen
    missing: tuple[Box, ...]
    undrawn: tuple[Rectangle, ...]


def volume_told(description: VolumeDescription, up: Up) -> VolumeTold:
    """The volume as it stands with this physical axis up."""
    geometry = description.geometry
    return VolumeTold(
        name=description.name,
        dims=geometry.dims,
        index_to_upright=matrices.product(upright(up), geometry.index_to_physical),
        reference_spacing=geometry.reference_spacing,
        unit=description.unit,
        sides={name: side.mark for name, side in sides(description, up).items()},
        density_name=description.density_name,
        strength_name=description.strength_name,
        value_unit=description.value_unit,
        axes=description.axes,
        scales=scales_of(description),
    )


def scene_told(state: SceneState, geometry: Geometry, fit: Fit | None) -> SceneTold:
    """Raises ValueError for bounds or a centre that the volume does not have."""
    scene = state.scene
    bounds = resolved_bounds(scene, geometry)
    return SceneTold(
        revision=state.revision,
        by=state.by,
        settled=state.settled,
        view=_view(scene, geometry),
        fit=fit,
        bounds=BoundsShown(bounds.low, bounds.high),
        edges=scene.image.edges,
        width=scene.image.width,
        height=scene.image.height,
    )


def probe_answered(
    x: float, y: float, found: ProbedVoxel | None, scene: Scene, volume: SurveyedVolume
) -> ProbeAnswered:
    """The answer to a probe of this scene."""
    if found is None:
        return ProbeAnswered(x, y, None, Certainty.EXACT, Certainty.EXACT)
    return ProbeAnswered(
        x, y, found, density_certainty(found, volume, scene.quantise), strength_certainty(found, volume)
    )


def file_value_told(x: float, y: float, voxel: FileVoxel) -> FileValueTold:
    density, *second = voxel.digits
    return FileValueTold(x, y, density, second[0] if second else None)


def picture_message(picture: Picture, tab: str, geometry: Geometry, pacing: Pacing) -> bytes:
    """A picture for one tab: its header's length, its header, its image."""
    following = _following(picture)
    width, height = picture.published.width, picture.published.height
    header = PictureHeader(
        number=picture.number,
        revision=picture.state.revision,
        event=picture.state.events.get(tab, 0),
        step=picture.step,
        one_in=picture.one_in,
        complete=picture.complete,
        last=picture.last,
        seconds=picture.outcome.wall_seconds if picture.outcome else None,
        next=NextStep(following, pacing.expected(Rung(following))) if following else None,
        width=width,
        height=height,
        view=_view(sized(picture.state.scene, width=width, height=height), geometry),
        notice=why_empty(picture.published.pixels, picture.state.scene) if picture.last else "",
        missing=tuple(picture.outcome.servers.missing) if picture.outcome else (),
        undrawn=picture.undrawn,
    )
    return framed(header, picture.data)


def _following(picture: Picture) -> Step | None:
    """The step that is drawn while this picture is looked at."""
    if not picture.complete:
        return picture.step
    return finer(picture.step, finest_step(picture.state.scene)) if picture.state.settled else None


def _view(scene: Scene, geometry: Geometry) -> ViewShown:
    return ViewShown(scene.view.rotation, resolved_zoom(scene, geometry), resolved_center(scene, geometry))
