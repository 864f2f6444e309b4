"""A real Firefox, driven by WebDriver BiDi, its own protocol: Playwright drives none but one that it has patched."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from websockets.sync.client import ClientConnection, connect

from support.patience import PATIENCE, wait_until

Place = tuple[float, float]

WINDOW = {"width": 1280, "height": 800}
_LISTENING = re.compile(r"WebDriver BiDi listening on (ws://\S+)\s")
_LEAVING = ("no such frame", "unknown error")  # told of a page that is just going over to another one
_STEPS = 8  # of a drag


def firefox_executable() -> str:
    """Where Firefox lies; without one the test is skipped. One that came as a snap sees no folder of a test."""
    found = (shutil.which(name) for name in ("firefox-esr", "firefox"))
    executable = next((one for one in found if one and "snap" not in Path(one).resolve().parts), None)
    if executable is None:
        pytest.skip("the test needs Firefox: apt install firefox-esr")
    return executable


class BidiError(Exception):
    """Firefox did not do what it was told to."""

    def __init__(self, error: str, message: str) -> None:
        super().__init__(f"{error}: {message}")
        self.error = error


class Firefox:
    """Its only tab, in a window of 1280 x 800."""

    def __init__(self, socket: ClientConnection) -> None:
        self._socket = socket
        self._asked = 0
        self.errors: list[str] = []  # what its console has told of as such, in all pages
        self.does("session.new", capabilities={})
        self.does("session.subscribe", events=["log.entryAdded"])
        self._tab = self.does("browsingContext.getTree")["contexts"][0]["context"]
        self.does("browsingContext.setViewport", context=self._tab, viewport=WINDOW)

    def does(self, method: str, **parameters: Any) -> Any:
        """A command of the protocol, and its result. Raises BidiError."""
        self._asked += 1
        self._socket.send(json.dumps({"id": self._asked, "method": method, "params": parameters}))
        while True:
            told = json.loads(self._socket.recv(PATIENCE))
            if told["type"] == "event":
                self._note(told["params"])
            elif told["type"] == "error":
                raise BidiError(told["error"], told["message"])
            else:
                return told["result"]

    def opens(self, url: str) -> None:
        self.does("browsingContext.navigate", context=self._tab, url=url, wait="interactive")

    def finds(self, function: str) -> Any:
        """What a function of the page gives, which JSON can hold. Fails the test if it throws."""
        there = {"context": self._tab}
        asked = f"(async () => JSON.stringify(await ({function})()))()"
        found = self.does("script.evaluate", expression=asked, target=there, awaitPromise=True)
        assert found["type"] == "success", found["exceptionDetails"]["text"]
        return json.loads(found["result"].get("value", "null"))

    def waits_for(self, function: str, what: str) -> None:
        """Until a function of the page gives something, also after it has gone over to another page."""

        def holds() -> bool:
            try:
                return bool(self.finds(function))
            except BidiError as error:
                if error.error not in _LEAVING:
                    raise
                return False

        wait_until(holds, f"{what}; Firefox told of {self.errors}")

    @contextmanager
    def begins_with(self, function: str) -> Iterator[None]:
        """What is opened meanwhile runs this function before any script of its own."""
        kept = self.does("script.addPreloadScript", functionDeclaration=function)["script"]
        yield
        self.does("script.removePreloadScript", script=kept)

    def middle_of(self, selector: str) -> Place:
        """Of the first element that matches, scrolled to where it is seen."""
        x, y = self.finds(
            f"""() => {{
                const element = document.querySelector({json.dumps(selector)});
                element.scrollIntoView({{ block: "nearest" }});
                const {{ x, y, width, height }} = element.getBoundingClientRect();
                return [x + width / 2, y + height / 2];
            }}"""
        )
        return x, y

    def drags(self, start: Place, end: Place, button: int = 0) -> None:
        """By the mouse; the buttons are left, middle and right."""
        self._acts({"mouse": _drag(start, end, button)}, "mouse")

    def touches(self, *fingers: tuple[Place, Place]) -> None:
        """From where to where each goes, all at once."""
        self._acts({f"finger {n}": _drag(*places, 0) for n, places in enumerate(fingers)}, "touch")

    def wheels(self, at: Place, pixels: int) -> None:
        """Downwards, that is towards the person."""
        turn = {"type": "scroll", **_at(at), "deltaX": 0, "deltaY": pixels}
        self._performs([{"type": "wheel", "id": "wheel", "actions": [turn]}])

    def presses(self, key: str) -> None:
        strokes = [{"type": kind, "value": key} for kind in ("keyDown", "keyUp")]
        self._performs([{"type": "key", "id": "keys", "actions": strokes}])

    def _acts(self, pointers: dict[str, list[dict[str, Any]]], kind: str) -> None:
        how = {"type": "pointer", "parameters": {"pointerType": kind}}
        self._performs([{**how, "id": name, "actions": acts} for name, acts in pointers.items()])

    def _performs(self, actions: Sequence[dict[str, Any]]) -> None:
        self.does("input.performActions", context=self._tab, actions=actions)

    def _note(self, entry: dict[str, Any]) -> None:
        if entry.get("level") == "error":
            self.errors.append(entry["text"])


def _drag(start: Place, end: Place, button: int) -> list[dict[str, Any]]:
    way = [_between(start, end, n / _STEPS) for n in range(1, _STEPS + 1)]
    moves = [{"type": "pointerMove", **_at(place)} for place in (start, *way)]
    press, release = ({"type": kind, "button": button} for kind in ("pointerDown", "pointerUp"))
    return [moves[0], press, *moves[1:], release]


def _between(start: Place, end: Place, share: float) -> Place:
    x, y = (begin + share * (last - begin) for begin, last in zip(start, end, strict=True))
    return x, y


def _at(place: Place) -> dict[str, int]:
    x, y = place
    return {"x": round(x), "y": round(y)}


@contextmanager
def running_firefox(profile: Path) -> Iterator[Firefox]:
    """Headless, with an empty profile in this folder, which is its home as well."""
    log = profile / "log"
    words = [firefox_executable(), "--headless", "--no-remote", "--profile", str(profile), "--remote-debugging-port=0"]
    with (
        log.open("wb") as told,
        subprocess.Popen(words, stdout=told, stderr=told, env={**os.environ, "HOME": str(profile)}) as process,
    ):
        try:
            with connect(f"{_address(log, process)}/session", max_size=None, open_timeout=PATIENCE) as socket:
                firefox = Firefox(socket)
                yield firefox
                firefox.does("browser.close")
            process.wait(PATIENCE)
        finally:
            process.kill()


def _address(log: Path, process: subprocess.Popen[bytes]) -> str:
    found: list[str] = []

    def is_told() -> bool:
        found.extend(_LISTENING.findall(log.read_text(errors="replace")))
        return bool(found) or process.poll() is not None

    wait_until(is_told, "told by Firefox where it listens")
    assert found, f"Firefox ended: {log.read_text(errors='replace')}"
    return found[0]
