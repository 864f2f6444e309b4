"""A tab of headless Chromium, told what to do by its DevTools protocol, through a pipe.

Libraries for tests have Chromium tell of each frame of each WebSocket, with the pictures in it, which takes processor
time from the page. This asks for nothing but what it is used for.
"""

from __future__ import annotations

import fcntl
import json
import os
import select
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

from volsplat.protocol.text.errors import BadInput, VolsplatError

BROWSERS = "chromium", "google-chrome", "chromium-headless-shell"
# As root it has no sandbox; and without a graphics card, drawing by the plain rasteriser takes half of the time.
OPTIONS = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--mute-audio", "--no-first-run"),
    *("--disable-background-networking", "--disable-component-update", "--disable-renderer-backgrounding"),
    *("--disable-background-timer-throttling", "--disable-backgrounding-occluded-windows", "--remote-debugging-pipe"),
)
WINDOW = 1280, 800
PATIENCE = 60.0  # seconds, for an answer or what the page is waited for
END = b"\0"  # of a message
_LOOK_SECONDS = 0.05  # between looks at the page
_COMMANDS, _ANSWERS = 3, 4  # file descriptors that Chromium takes them from and gives them to
_FREE = 10  # the least of those that neither it nor we know by their number
_MOVED_ON = -32000  # the code of what is asked of a page that goes over to another one

_POINT = "Input.dispatchMouseEvent"

Pointer = Literal["mousePressed", "mouseMoved", "mouseReleased"]
Button = Literal["left", "none"]


class ChromiumTab:
    """The only tab. Its functions raise VolsplatError if Chromium refuses, does not answer, or is gone."""

    def __init__(self, commands: int, answers: int, words: Path) -> None:
        """The file descriptors of the pipes, which stay the caller's, and the file that Chromium's own words go to."""
        self._commands = commands
        self._answers = answers
        self._words = words
        self._asked = 0
        self._unread = b""
        self._bound: dict[str, Callable[[str], None]] = {}
        self._session: str | None = None
        tab = self._ask("Target.createTarget", url="about:blank")["targetId"]
        self._session = self._ask("Target.attachToTarget", targetId=tab, flatten=True)["sessionId"]
        self.window = WINDOW
        self.set_window(*WINDOW)

    def set_window(self, width: int, height: int) -> None:
        """In CSS pixels, of which each is one of the screen's."""
        self.window = width, height
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        self._ask("Emulation.setDeviceMetricsOverride", **size)

    def before_scripts(self, source: str, binding: str, called: Callable[[str], None]) -> None:
        """Have each page run this first, in which a function of that name calls this one, with a text."""
        self._bound[binding] = called
        self._ask("Page.enable")
        self._ask("Runtime.enable")
        self._ask("Runtime.addBinding", name=binding)
        self._ask("Page.addScriptToEvaluateOnNewDocument", source=source)

    def open(self, url: str) -> None:
        failed = self._ask("Page.navigate", url=url).get("errorText")
        if failed:
            raise VolsplatError(f"Chromium does not open {url}: {failed}")

    def evaluate(self, function: str, *arguments: Any) -> Any:
        """What a function of the page gives, or what it promises; it and its arguments are what JSON can hold."""
        call = f"({function})({', '.join(map(json.dumps, arguments))})"
        told = self._ask("Runtime.evaluate", expression=call, returnByValue=True, awaitPromise=True)
        if failed := told.get("exceptionDetails"):
            raise VolsplatError(f"the page: {failed.get('exception', {}).get('description', failed['text'])}")
        return told["result"].get("value")

    def wait_for(self, function: str, *arguments: Any) -> None:
        """Until a function of the page gives something, also if that is on the page which follows it."""
        ends = time.monotonic() + PATIENCE
        while not self._holds(function, *arguments):
            if time.monotonic() > ends:
                raise VolsplatError(f"the page was waited for in vain: {function}")
            self.rest(_LOOK_SECONDS)

    def _holds(self, function: str, *arguments: Any) -> bool:
        try:
            return bool(self.evaluate(function, *arguments))
        except RefusedByChromium as refusal:
            if refusal.code != _MOVED_ON:
                raise
            return False

    def point(self, what: Pointer, x: float, y: float, button: Button = "left") -> None:
        """Have the pointer do this there, and wait until the page has taken it in."""
        self._ask(_POINT, **_pointing(what, x, y, button))

    def move_on(self, x: float, y: float) -> None:
        """Have the pointer move there with its left button held, as a hand does, which does not wait for the page."""
        self._tell(_POINT, **_pointing("mouseMoved", x, y, "left"))

    def rest(self, seconds: float) -> None:
        """Wait for so long, and take in meanwhile what Chromium says."""
        ends = time.monotonic() + seconds
        while (left := ends - time.monotonic()) > 0.0:
            if told := self._next(left):
                self._take_in(told)

    def _ask(self, method: str, **parameters: Any) -> Any:
        number, ends = self._tell(method, **parameters), time.monotonic() + PATIENCE
        while (left := ends - time.monotonic()) > 0.0:
            told = self._next(left)
            if told is None or told.get("id") != number:
                self._take_in(told or {})
            elif "error" in told:
                raise RefusedByChromium(method, **told["error"])
            else:
                return told["result"]
        raise VolsplatError(f"Chromium did not answer {method}")

    def _tell(self, method: str, **parameters: Any) -> int:
        self._asked += 1
        message = {"id": self._asked, "method": method, "params": parameters}
        if self._session is not None:
            message["sessionId"] = self._session
        unsent = json.dumps(message).encode() + END
        try:
            while unsent:
                unsent = unsent[os.write(self._commands, unsent) :]
        except BrokenPipeError:
            raise self._gone() from None
        return self._asked

    def _gone(self) -> VolsplatError:
        said = [line for line in self._words.read_text("utf-8", "replace").splitlines() if line.strip()]
        return VolsplatError(": ".join(["Chromium is gone", *said[-1:]]))

    def _take_in(self, told: dict[str, Any]) -> None:
        if told.get("method") == "Runtime.bindingCalled":
            self._bound[told["params"]["name"]](told["params"]["payload"])

    def _next(self, seconds: float) -> dict[str, Any] | None:
        """The next message; None if none is whole by then, or sooner."""
        if END not in self._unread:
            if not select.select([self._answers], [], [], seconds)[0]:
                return None
            read = os.read(self._answers, 1 << 20)
            if not read:
                raise self._gone()
            self._unread += read
        message, end, rest = self._unread.partition(END)
        if not end:
            return None
        self._unread = rest
        told: dict[str, Any] = json.loads(message)
        return told


def _pointing(what: Pointer, x: float, y: float, button: Button) -> dict[str, Any]:
    held = int(button == "left")
    return {"type": what, "x": x, "y": y, "button": button, "buttons": held, "clickCount": held}


class RefusedByChromium(VolsplatError):
    """What was asked of it is not done."""

    def __init__(self, method: str, code: int, message: str, data: str = "") -> None:
        super().__init__(f"Chromium refuses {method}: {message} {data}".rstrip())
        self.code = code


@contextmanager
def chromium_tab() -> Iterator[ChromiumTab]:
    """An empty tab. Raises BadInput if there is no Chromium."""
    import psutil

    chromium = next(filter(None, map(shutil.which, BROWSERS)), None)
    if chromium is None:
        raise BadInput("this benchmark needs Chromium: apt install chromium")
    with TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        words = Path(folder, "words")
        number, commands, answers = _started([chromium, *OPTIONS, f"--user-data-dir={folder}/profile"], words)
        process = psutil.Process(number)
        try:
            yield ChromiumTab(commands, answers, words)
        finally:
            os.close(commands)  # with which it ends
            os.close(answers)
            try:
                process.wait(PATIENCE)
            except psutil.TimeoutExpired:
                for one in [*process.children(recursive=True), process]:  # it may be that of a script which starts it
                    one.kill()
                process.wait()


def _started(command: list[str], words: Path) -> tuple[int, int, int]:
    """The process, and our ends of the pipes that it takes commands from and gives answers to. Raises BadInput."""
    (taken, commands), (answers, given) = os.pipe(), os.pipe()
    # Beyond the places that they are to have there
    taken_from, given_to = (fcntl.fcntl(end, fcntl.F_DUPFD_CLOEXEC, _FREE) for end in (taken, given))
    at_their_places = [
        (os.POSIX_SPAWN_DUP2, taken_from, _COMMANDS),
        (os.POSIX_SPAWN_DUP2, given_to, _ANSWERS),
        *((os.POSIX_SPAWN_OPEN, stream, os.devnull, os.O_RDWR, 0) for stream in range(2)),
        (os.POSIX_SPAWN_OPEN, 2, str(words), os.O_WRONLY | os.O_CREAT, 0o600),
    ]
    try:
        # In a session of its own, as a person's browser is: systems may share out a core among sessions first
        number = os.posix_spawn(command[0], command, os.environ, file_actions=at_their_places, setsid=True)
        return number, commands, answers
    except OSError as error:
        os.close(commands)
        os.close(answers)
        raise BadInput(f"{command[0]} does not start: {error.strerror}") from None
    finally:
        for end in (taken, given, taken_from, given_to):
            os.close(end)
