"""The coordinator's events: what happens to a session, or is asked of it."""

import secrets
from dataclasses import dataclass, field

from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.description.volume import Index
from volsplat.protocol.messages import messages
from volsplat.protocol.messages.roles import Role
from volsplat.protocol.rules.levels import ALL_VOXELS, Thinning
from volsplat.protocol.wire.addresses import Address


@dataclass(frozen=True)
class ServerJoined:
    server: int
    role: Role
    name: str  # for a person: role, number and address
    host: str  # where it dials from
    data: Address  # where a splat server takes data links
    elsewhere: bool = False  # on another machine, so that its errors must name it
    data_anywhere: bool = False  # data links are taken on every address of its machine
    client_host: str = ""  # the client's address, as this server reaches it
    process: str = ""  # as it names itself, the same for each of its clients
    by_hand: bool = False  # if it ends, nobody but a person may start another one in its place
    key: bytes = field(  # a worker's, which proves its data links: the splat server and it alone are told
        default_factory=lambda: secrets.token_bytes(messages.WORKER_KEY_BYTES), repr=False
    )


@dataclass(frozen=True)
class ServerLost:
    server: int
    cause: str


@dataclass(frozen=True)
class ServerProcessEnded:
    """A server that the client or its cluster started has ended, or does not come."""

    cause: str
    process: str = ""
    replaced: bool = False  # another one was started in its place


@dataclass(frozen=True)
class ServersMissing:
    """Servers of a cluster do not come: others draw without them. They may join later."""

    cause: str
    given_up: bool = False  # nobody waits for them any more, even if no others can draw


@dataclass(frozen=True)
class NobodyJoined:
    """A server was lost that people started, and for a while no other of its kind has joined."""

    cause: str


@dataclass(frozen=True)
class ServingFailed:
    """By an error of the client's own, nobody hears a server any more, or nothing more is sent to it."""

    server: int
    cause: str


@dataclass(frozen=True)
class MessageReceived:
    server: int
    message: messages.Message
    payload: memoryview
    at: float  # seconds, time.perf_counter()


@dataclass(frozen=True)
class VolumeAsked:
    path: str
    workers: int
    splat_servers: int = 1
    memory: int | None = None  # bytes that each map/shade server may hold of a prepared volume; None: as it sees fit
    held: bool = True  # else only surveyed, until a frame is wanted


@dataclass(frozen=True)
class FrameAsked:
    """An image is wanted; if `require_complete`, only one that shows the whole volume.

    One that need not be `exact` is only looked at: where the link is slow it may come with 8 bits a channel.
    `thinning` says which of its step's voxels are left out.
    """

    frame: int  # rises with every request
    scene: Scene
    step: Step
    require_complete: bool
    exact: bool = True  # the finished image
    thinning: Thinning = ALL_VOXELS


@dataclass(frozen=True)
class PartialImageAsked:
    frame: int


@dataclass(frozen=True)
class ProgressAsked:
    frame: int


@dataclass(frozen=True)
class AbortAsked:
    frame: int


@dataclass(frozen=True)
class PointAsked:
    """The voxel is wanted that is seen at this point of the scene's image; see line_of_sight."""

    question: int  # rises with every one, of whatever kind
    scene: Scene
    x: float
    y: float


@dataclass(frozen=True)
class FileVoxelAsked:
    """The numbers are wanted that the volume's file has for a voxel."""

    question: int
    index: Index


@dataclass(frozen=True)
class FolderAsked:
    """What lies in a folder of a map/shade server is wanted; see ListFolder."""

    question: int
    root: str
    folder: str
    words: str


@dataclass(frozen=True)
class SliceAsked:
    """A slice of the volume is wanted, with at most `longest` samples along a side, and in this scene's colours."""

    question: int
    scene: Scene
    axis: int
    index: int
    longest: int
    as_packed: bool = False  # in whatever window packets are held


@dataclass(frozen=True)
class PlaneAsked:
    """How many voxels have each density with each strength, in this scene's window."""

    question: int
    scene: Scene


Question = PointAsked | SliceAsked | PlaneAsked | FileVoxelAsked | FolderAsked
Event = (
    ServerJoined
    | ServerLost
    | ServerProcessEnded
    | ServersMissing
    | NobodyJoined
    | ServingFailed
    | MessageReceived
    | VolumeAsked
    | FrameAsked
    | PartialImageAsked
    | ProgressAsked
    | AbortAsked
    | Question
)
