"""Several splat servers that draw a frame: what the coordinator tells them, and what they say."""

import msgspec

from support.messages.coordinated import (
    MAP_STATS,
    MORE_SPLAT_SERVERS,
    SCENE,
    SPLAT,
    SPLAT_STATS,
    CheckedCoordinator,
    drawing,
    said,
)
from volsplat.client.coordinator.events.events import Event, MessageReceived
from volsplat.client.coordinator.events.instructions import Instruction, PublishImage, Send
from volsplat.protocol.description.scene import Image
from volsplat.protocol.messages import messages
from volsplat.protocol.rules.closed_tiles import TILE_SIDE
from volsplat.protocol.rules.regions import Rectangle, lines_of, rectangle_of

THREE = [SPLAT, *(one.server for one in MORE_SPLAT_SERVERS)]
_, LOST, LEFT = THREE
SIDE = 18  # pixels; five rows of tiles
BIG = msgspec.structs.replace(SCENE, image=Image(width=SIDE, height=SIDE))
GONE = "splat server 8 is gone"


def drawing_big() -> CheckedCoordinator:
    return drawing(scene=BIG, splat_servers=len(THREE))


def running(coordinator: CheckedCoordinator) -> messages.RenderFrame:
    """The frame that is on its way."""
    frame = coordinator.frames.frame
    assert frame is not None and frame.request is not None
    return frame.request


def rendered(told: list[Instruction]) -> messages.RenderFrame:
    """What all servers of a frame are told, which is the same."""
    (request, *others) = [
        i.message for i in told if isinstance(i, Send) and isinstance(i.message, messages.RenderFrame)
    ]
    assert all(other == request for other in others)
    return request


def rectangles(request: messages.RenderFrame) -> dict[int, Rectangle]:
    servers = {region.server for region in request.regions}
    return {server: rectangle_of(request.drawing.plan, lines_of(request.regions, server)) for server in servers}


def image(request: messages.RenderFrame, server: int, complete: bool) -> MessageReceived:
    part = rectangles(request)[server]
    read = messages.ImageRead(request.frame, request.drawing.plan.step, complete, *part, messages.RawPixels())
    return said(server, read, bytes(16 * part.width * part.height))


def finished(request: messages.RenderFrame, server: int, work: int = 1) -> MessageReceived:
    """It had so much to do in each row of tiles."""
    begin, end = lines_of(request.regions, server)
    stats = msgspec.structs.replace(SPLAT_STATS, work=[work] * (-(-end // TILE_SIDE) - begin // TILE_SIDE))
    return said(server, messages.FrameFinished(request.frame, True, [], stats))


def mapped(request: messages.RenderFrame, worker: int, *lost: int) -> MessageReceived:
    return said(worker, messages.FrameMapped(request.frame, MAP_STATS, [*lost]))


def all_done(request: messages.RenderFrame, work: int = 1) -> list[Event]:
    done = [(finished(request, server, work), image(request, server, True)) for server in rectangles(request)]
    return [*(mapped(request, worker) for worker in request.workers), *(event for pair in done for event in pair)]


def check_whole(shown: PublishImage) -> None:
    """Each pixel is in one part."""
    pixels = [
        (x, y)
        for left, top, width, height in (part.rectangle for part in shown.parts)
        for x in range(left, left + width)
        for y in range(top, top + height)
    ]
    assert sorted(pixels) == [(x, y) for x in range(shown.width) for y in range(shown.height)]
    assert not shown.missing


def published(told: list[Instruction]) -> list[PublishImage]:
    return [i for i in told if isinstance(i, PublishImage)]
