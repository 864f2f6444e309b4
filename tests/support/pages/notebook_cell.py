"""A cell of a notebook in a browser's tab: Jupyter's part, which shows a widget and carries what its halves say."""

from __future__ import annotations

import asyncio
import base64
import queue
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from support.patience import PATIENCE, wait_until
from volsplat.client import Session
from volsplat.client.ui.notebook_widget import VolumeWidget

if TYPE_CHECKING:
    from playwright.sync_api import Page

ADDRESS = "http://hub.example/"  # not by HTTPS, as many a hub
_RENDER = """async ([source, traits, css, inShadow, hasKernel]) => {
  const listeners = { "msg:custom": [], comm_live_update: [] };
  window.fromKernel = (content, buffers) => {
    const views = buffers.map((text) => new DataView(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer));
    for (const listener of listeners["msg:custom"]) listener(content, views);
  };
  let toKernel = hasKernel ? window.toKernel : () => {};
  window.endKernel = (isTold) => {
    toKernel = () => { throw new Error("Cannot send"); };
    if (isTold) for (const listener of listeners.comm_live_update) listener();
  };
  const model = {
    get: (name) => traits[name],
    send: (content) => toKernel(content),
    on: (name, listener) => listeners[name].push(listener),
    off: (name, listener) => listeners[name].splice(listeners[name].indexOf(listener), 1),
  };
  const module = await import(URL.createObjectURL(new Blob([source], { type: "text/javascript" })));
  const cell = document.getElementById("cell"), root = inShadow ? cell.attachShadow({ mode: "open" }) : cell;
  root.append(Object.assign(document.createElement("style"), { textContent: css }));
  const el = root.appendChild(document.createElement("div"));
  window.endView = await module.default.render({ model, el });
  for (const name of ["height", "min-height", "width", "display", "overflow"])
    el.style.removeProperty(name); // the widget's layout, which says nothing of them, is the last to style it
}"""


class NotebookCell:
    """One view of a widget, whose Python half runs in an event loop of a thread, as in a kernel.

    `in_shadow`: below a root of its own, as marimo has its cells. Without `has_kernel` it is a page that was made of a
    notebook.
    """

    def __init__(
        self, page: Page, session: Session, in_shadow: bool = False, has_kernel: bool = True, **options: Any
    ) -> None:
        self.page = page
        self._restarted = False
        self._said: queue.SimpleQueue[tuple[Any, list[str]]] = queue.SimpleQueue()
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name="kernel", daemon=True)
        self._thread.start()
        self.widget = self.kernel(lambda: self._made(session, options))
        page.expose_function("toKernel", self._heard)
        html = '<!doctype html><meta charset="utf-8"><div id="cell" style="width: 1200px"></div>'
        page.route("**/*", lambda route: route.fulfill(body=html, content_type="text/html"))
        page.goto(ADDRESS)
        self.bundle: dict[str, str] = self.kernel(self.widget._repr_mimebundle_)[0]
        traits = {name: getattr(self.widget, name) for name in ("modules", "controls", "height", "still")}
        page.evaluate(_RENDER, [self.widget._esm, traits, self.widget._css, in_shadow, has_kernel])

    def kernel(self, act: Callable[[], Any]) -> Any:
        """What comes of it in the kernel."""

        async def acting() -> Any:
            return act()

        return asyncio.run_coroutine_threadsafe(acting(), self._loop).result()

    def until(self, condition: Callable[[], bool]) -> None:
        """Carry messages until it holds."""

        def carried() -> bool:
            while not self._said.empty():
                self.page.evaluate("([content, buffers]) => window.fromKernel(content, buffers)", self._said.get())
            return condition()

        wait_until(carried, "shown in the notebook")

    def restart_kernel(self, is_told: bool) -> None:
        """From here on nobody hears the view, and Jupyter tells it of that or not."""
        self._restarted = True
        self.page.evaluate("(isTold) => window.endKernel(isTold)", is_told)

    def close(self) -> None:
        self.page.evaluate("() => window.endView()")
        if not self._restarted:
            wait_until(lambda: self.kernel(lambda: self.widget._views == {}), "closed in the kernel as well")
        self.kernel(self.widget.close)
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(PATIENCE)
        self._loop.close()

    def _made(self, session: Session, options: dict[str, Any]) -> VolumeWidget:
        said = self._said

        class Spoken(VolumeWidget):
            def send(self, content: Any, buffers: list[bytes] | None = None) -> None:
                said.put((content, [base64.b64encode(one).decode() for one in buffers or []]))

        return Spoken(session, **options)

    def _heard(self, content: dict[str, Any]) -> None:
        self._loop.call_soon_threadsafe(self.widget._handle_custom_msg, content, [])


@contextmanager
def notebook_cell(
    page: Page, session: Session, in_shadow: bool = False, has_kernel: bool = True, **options: Any
) -> Iterator[NotebookCell]:
    cell = NotebookCell(page, session, in_shadow, has_kernel, **options)
    try:
        yield cell
    finally:
        cell.close()
        page.close()  # a function that is exposed to it stays
