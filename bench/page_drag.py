"""A volume turned by the pointer in a real browser, and what the page noted of it."""

from __future__ import annotations

import base64
import bisect
import math
import statistics
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

from volsplat.bench.chromium_tab import ChromiumTab
from volsplat.bench.ssim import luminance, ssim
from volsplat.protocol.text.errors import VolsplatError

if TYPE_CHECKING:
    from torch import Tensor

MOVES_PER_SECOND = 60
MOVES_OF_A_ROUND = 120
PLACES = 120  # on the circle, where the pointer might press
# To the end, and in the size of the window: before the page has told it, another size may be finished.
REFINED = """() => {
    const viewport = window.volsplatViewport, picture = viewport?.log.at(-1);
    return picture?.last && picture.width === viewport.canvas.clientWidth * devicePixelRatio &&
        picture.height === viewport.canvas.clientHeight * devicePixelRatio;
}"""
# Places on a circle about the middle of the picture on which nothing lies, as radians.
_BARE = """(x, y, radius, places) => {
    const angles = [...Array(places).keys()].map((n) => (2 * Math.PI * n) / places);
    const top = (angle) => document.elementFromPoint(x + radius * Math.cos(angle), y + radius * Math.sin(angle));
    return angles.filter((angle) => top(angle) === window.volsplatViewport.canvas);
}"""
_CANVAS = "() => { const c = window.volsplatViewport.canvas; return [c.clientWidth, c.clientHeight]; }"
_PICTURE = """() => {
    const { x, y, width, height } = document.querySelector(".vs-picture").getBoundingClientRect();
    return [x + width / 2, y + height / 2, height / 4];
}"""
_ROTATION = "() => window.volsplatViewport.view.rotation"
_NOTES = """() => ({
    sent: window.volsplatViewport.sent.map(({ event, at }) => [event, at]),
    shown: window.volsplatViewport.log.map(({ number, event, shownAt, step, width, height, one_in, view }) =>
        [number, event, shownAt, step, width, height, one_in, view.rotation, view.center, view.zoom / width]),
})"""
_FORGET = "() => { window.volsplatViewport.log.length = 0; window.volsplatViewport.sent.length = 0; }"
# Width, height, and the bytes of red, green, blue and alpha.
_SEEN = """() => {
    const shown = window.volsplatViewport.canvas, copy = document.createElement("canvas");
    [copy.width, copy.height] = [shown.clientWidth, shown.clientHeight];
    const context = copy.getContext("2d");
    context.drawImage(shown, 0, 0, copy.width, copy.height);
    const bytes = context.getImageData(0, 0, copy.width, copy.height).data;
    return [copy.width, copy.height, btoa(Array.from(bytes, (byte) => String.fromCharCode(byte)).join(""))];
}"""
_STREAMED = "() => window.volsplatViewport?.log.length > 0"
# Milliseconds since 1970: when a page's own image was painted, and when the viewport drew its first picture.
_PAINTED = """new PerformanceObserver((list) => {
    for (const { renderTime } of list.getEntries()) volsplatPainted(String(performance.timeOrigin + renderTime));
}).observe({ type: "element", buffered: true });"""
_STARTED = "() => performance.timeOrigin + window.volsplatViewport.log[0].shownAt"
# What is seen once the last move is, or nothing by then.
_SEEN_AT_THE_END = f"""async (milliseconds) => {{
    const {{ sent, log }} = window.volsplatViewport, ends = performance.now() + milliseconds;
    while (!(log.at(-1)?.event >= sent.at(-1).event)) {{
        if (performance.now() > ends) return null;
        await new Promise(requestAnimationFrame);
    }}
    return ({_SEEN})();
}}"""
_LAST_PICTURE_MILLISECONDS = 30_000


class Start(NamedTuple):
    """Seconds from the command to pictures on the screen."""

    seen: float  # on the page that is waited on, or on the page itself
    streamed: float  # the viewport's first


class ShownPicture(NamedTuple):
    """One picture on the canvas."""

    number: int
    event: int  # the last that it contains
    at: float  # milliseconds of the page's clock
    step: str
    width: int
    height: int
    one_in: int  # of so many voxels one was drawn
    rotation: Sequence[float]
    center: Sequence[float]
    zoom: float  # of an image as wide as 1

    @property
    def way(self) -> str:
        """In words."""
        left_out = "" if self.one_in == 1 else f" with 1 of {self.one_in} voxels"
        return f"{self.step} in {self.width} x {self.height}{left_out}"


@dataclass(frozen=True)
class Drag:
    """What the page noted: when each event was sent, in milliseconds of its own clock, and each picture shown."""

    sent: list[tuple[int, float]]  # event, at
    shown: list[ShownPicture]
    likeness: float  # of the last moving picture, as large as it was shown, to the finished one of the same view: SSIM

    def latencies(self) -> list[float]:
        """Seconds from each event to the first picture that contains it; events that none contains are left out."""
        events = [picture.event for picture in self.shown]
        found = ((at, bisect.bisect_left(events, event)) for event, at in self.sent)
        return [(self.shown[n].at - at) / 1e3 for at, n in found if n < len(events)]

    def moving(self) -> list[ShownPicture]:
        """Pictures that were shown while events came."""
        begin, end = self.sent[0][1], self.sent[-1][1]
        return [picture for picture in self.shown if begin <= picture.at <= end]

    def images_per_second(self) -> float:
        """While events came."""
        return len(self.moving()) / max((self.sent[-1][1] - self.sent[0][1]) / 1e3, 1e-9)

    def drawn_as(self) -> dict[str, float]:
        """Steps and sizes, with the share of the moving pictures that were drawn so, the most frequent first."""
        ways = Counter(picture.way for picture in self.moving())
        return {way: count / ways.total() for way, count in ways.most_common()}

    def stale(self) -> int:
        """Pictures shown after a newer one."""
        numbers = [picture.number for picture in self.shown]
        return sum(later <= earlier for earlier, later in pairwise(numbers))

    def growth(self) -> float:
        """Seconds by which the last third of the latencies is worse than the first, in the median."""
        late = self.latencies()
        third = max(len(late) // 3, 1)
        return statistics.median(late[-third:]) - statistics.median(late[:third])


def started(tab: ChromiumTab, address: str, began: float) -> Start:
    """How long it took from `began`, by time.time(), to the first pictures of the page at the address, now loaded."""
    painted: list[float] = []
    tab.before_scripts(_PAINTED, "volsplatPainted", lambda at: painted.append(float(at)))
    tab.open(address)
    tab.wait_for(_STREAMED)
    streamed = tab.evaluate(_STARTED)
    return Start(min([*painted, streamed]) / 1e3 - began, streamed / 1e3 - began)


def show_in(tab: ChromiumTab, side: int) -> None:
    """Have the volume refined to the end in a picture of `side` pixels each way, by the size of the window."""
    tab.wait_for(REFINED)
    while (size := tab.evaluate(_CANVAS)) != [side, side]:  # what stands around the picture may still grow
        width, height = tab.window
        tab.set_window(width + side - size[0], height + side - size[1])
        tab.wait_for(f"(...old) => ({_CANVAS})().join() !== old.join()", *size)
        tab.wait_for(REFINED)


def dragged(tab: ChromiumTab, moves: int) -> Drag:
    """Turn the volume with the pointer, evenly, and read what the page noted.

    Raises VolsplatError if what was pressed did something else, or nothing is seen.
    """
    middle_x, middle_y, radius = tab.evaluate(_PICTURE)
    begin = _bare_place(tab, middle_x, middle_y, radius)

    def place(n: int) -> tuple[float, float]:
        angle = begin + 2 * math.pi * n / MOVES_OF_A_ROUND
        return middle_x + radius * math.cos(angle), middle_y + radius * math.sin(angle)

    rotation = tab.evaluate(_ROTATION)
    tab.point("mousePressed", *place(0))
    tab.point("mouseMoved", *place(1))
    if tab.evaluate(_ROTATION) == rotation:
        raise VolsplatError("the pointer that was to turn the volume did not turn it")
    tab.evaluate(_FORGET)
    due = time.monotonic()
    for n in range(2, moves + 2):
        tab.move_on(*place(n))
        due += 1 / MOVES_PER_SECOND
        tab.rest(due - time.monotonic())
    seen = tab.evaluate(_SEEN_AT_THE_END, _LAST_PICTURE_MILLISECONDS)
    if seen is None:
        raise VolsplatError("the page did not show where the pointer came to an end")
    noted, turned = tab.evaluate(_NOTES), tab.evaluate(_ROTATION)
    tab.point("mouseReleased", *place(moves + 1))
    tab.wait_for(REFINED)
    moving, finished = _luminance(*seen), _luminance(*tab.evaluate(_SEEN))
    drag = Drag([tuple(s) for s in noted["sent"]], [ShownPicture(*p) for p in noted["shown"]], ssim(moving, finished))
    check_turned(drag.shown, turned)
    if moving.min() == moving.max():
        raise VolsplatError("nothing is seen of the volume that was to be turned")
    return drag


def check_turned(shown: Sequence[ShownPicture], turned: Sequence[float]) -> None:
    """Raises VolsplatError unless each picture turns the volume, and does nothing else, up to where it was `turned`."""
    first, last = shown[0], shown[-1]
    still = any(
        later.event > earlier.event and later.rotation == earlier.rotation for earlier, later in pairwise(shown)
    )
    if still or list(last.rotation) != list(turned):
        raise VolsplatError("pictures were shown that do not follow the pointer, which was to turn the volume")
    if any(one.center != first.center or not math.isclose(one.zoom, first.zoom) for one in shown):
        raise VolsplatError("the pointer that was to turn the volume moved or zoomed it as well")


def _luminance(width: int, height: int, text: str) -> Tensor:
    """Of what was seen on the canvas, (H, W) 0..1, as large as it is shown."""
    import torch

    colours = torch.frombuffer(bytearray(base64.b64decode(text)), dtype=torch.uint8).reshape(height, width, 4)
    return luminance(colours.double() / 255.0)


def _bare_place(tab: ChromiumTab, x: float, y: float, radius: float) -> float:
    """The angle of a place on the circle that is farthest from handles and all else that lies over the picture."""
    tab.point("mouseMoved", x, y, button="none")  # the handles are there only under a pointer
    bare: list[float] = tab.evaluate(_BARE, x, y, radius, PLACES)
    if not bare:
        raise VolsplatError("no place of the picture is bare")
    runs = [[bare[0]]]
    for angle in bare[1:]:
        if angle - runs[-1][-1] > 1.5 * 2 * math.pi / PLACES:
            runs.append([])
        runs[-1].append(angle)
    longest = max(runs, key=len)
    return longest[len(longest) // 2]
