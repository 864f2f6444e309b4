"""The coordinator's instructions: what the session is to do."""

from dataclasses import dataclass, field

from volsplat.client.histogram.plane_counts import PlaneCounts
from volsplat.client.slices.volume_slice import VolumeSlice
from volsplat.client.volume.file_voxel import FileVoxel
from volsplat.client.volume.surveyed_volume import SurveyedVolume
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.volume import Box
from volsplat.protocol.messages import messages
from volsplat.protocol.rules.regions import Rectangle
from volsplat.protocol.text.errors import VolsplatError


@dataclass(frozen=True)
class Send:
    server: int
    message: messages.Message
    payload: memoryview = memoryview(b"")


@dataclass(frozen=True)
class CutOff:
    """Close the connection to a server that says what cannot be; it counts as lost."""

    server: int
    cause: str


@dataclass(frozen=True)
class ReportProgress:
    """Tell the person what is going on."""

    text: str


@dataclass(frozen=True)
class ReportLoss:
    """Tell the person, to stay, that a server is not there, or has no part, and who does its work."""

    text: str


@dataclass(frozen=True)
class PublishVolume:
    """The volume is described and surveyed; scenes can be made for it."""

    volume: SurveyedVolume


@dataclass(frozen=True)
class ImagePart:
    """What one splat server has drawn of an image."""

    server: int
    rectangle: Rectangle
    pixels: memoryview  # float32 RGBA, associated
    read: messages.ImageRead  # how it came


@dataclass(frozen=True)
class FrameOutcome:
    """What the servers report of a finished frame, and the parts of the volume that no server holds any more.

    `voxels` are how many of the volume each map/shade server holds: they change when sub-cubes change hands.
    Of a prepared volume also which level was drawn, and why the finest step draws the one that it does.
    """

    map_shade: dict[int, messages.MapShadeStats]
    splat: dict[int, messages.SplatStats]
    missing: tuple[Box, ...] = ()
    healing: bool = False  # others will take over what is missing, and then all can be drawn
    level: int = 0
    why_level: str = ""
    voxels: dict[int, int] = field(default_factory=dict)


@dataclass(frozen=True)
class PublishImage:
    """An image of `frame` arrived; `complete` where the frame is done, and then statistics come with it.

    What is not in its `parts` is `missing`, lost with a splat server; that is drawn by others in another frame.
    `drawn_at` is when the news came that the frame was done, as in MessageReceived.
    """

    frame: int
    step: Step
    width: int
    height: int
    parts: tuple[ImagePart, ...]
    complete: bool
    missing: tuple[Rectangle, ...] = ()
    outcome: FrameOutcome | None = None
    drawn_at: float = 0.0


@dataclass(frozen=True)
class EndFrame:
    """`frame` ends without an image: aborted (no error) or failed."""

    frame: int
    error: VolsplatError | None = None


Found = messages.ProbedVoxel | VolumeSlice | PlaneCounts | FileVoxel | messages.FolderListed | None


@dataclass(frozen=True)
class GiveAnswer:
    """What was asked for, or the reason why it is not known.

    None is an answer as well: nothing is seen there, or nobody tells soon what the file has there.
    """

    question: int
    found: Found = None
    error: VolsplatError | None = None


@dataclass(frozen=True)
class FailSession:
    """Nothing can be drawn any more."""

    error: VolsplatError


Instruction = (
    Send | CutOff | ReportProgress | ReportLoss | PublishVolume | PublishImage | EndFrame | GiveAnswer | FailSession
)
