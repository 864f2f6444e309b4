"""The viewport in a notebook, with the scene as its trait (`Session.widget()`; extra `[notebook]`)."""

from __future__ import annotations

import asyncio
import base64
import posixpath
import re
from dataclasses import dataclass
from typing import Any

import anywidget
import msgspec
import traitlets

from volsplat.client.caller.arguments import checked_scene
from volsplat.client.scene.lit_from import lit_from
from volsplat.client.session.session import Session
from volsplat.client.ui.doors.static_files import STATIC
from volsplat.client.ui.notebook_controls import ControlsTalk
from volsplat.client.ui.viewing.opened_viewing import opened_viewing
from volsplat.client.ui.viewing.saving import image_bytes
from volsplat.client.ui.viewing.scene_model import SceneState
from volsplat.client.ui.viewing.viewing import Viewing
from volsplat.client.ui.viewport.viewport_talk import ViewportTalk
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.text.errors import BadInput

START = "viewport/viewport.js"
CONTROLS = "notebook/notebook_controls.js"
STYLES = ("theme.css", "viewport/viewport.css", "notebook/notebook.css")
CONTROLS_STYLES = ("controls/step_chips.css", "tables/table_editor.css")
HEIGHT = 512  # CSS pixels
LARGEST_STILL = 1 << 21  # letters of base64: a notebook that keeps the state of widgets has them twice
_IMPORTED = re.compile(r"""from\s+["'](\.{1,2}/[\w./]+)["']""")


def modules_from(*starts: str) -> dict[str, str]:
    """The modules that `starts` need, and these: each after all that it imports, and naming them as here."""
    ordered: dict[str, str] = {}

    def add(name: str) -> None:
        def named(imported: str) -> str:
            return posixpath.normpath(posixpath.join(posixpath.dirname(name), imported))

        if name not in ordered:
            source = (STATIC / name).read_text(encoding="utf-8")
            for imported in _IMPORTED.findall(source):
                add(named(imported))
            ordered[name] = _IMPORTED.sub(lambda found: f'from "./{named(found[1])}"', source)

    for start in starts:
        add(start)
    return ordered


class VolumeWidget(anywidget.AnyWidget):
    """One viewport of a session. `scene` follows the hand, and may be set."""

    # No Path, which anywidget would watch, and keep each widget for that.
    _esm = (STATIC / "notebook" / "notebook.js").read_text("utf-8")
    _css = "".join((STATIC / name).read_text("utf-8") for name in (*STYLES, *CONTROLS_STYLES))
    modules = traitlets.Dict(help="sources by name, in the order in which they are to be loaded").tag(sync=True)
    height = traitlets.Int(HEIGHT, help="CSS pixels").tag(sync=True)
    controls = traitlets.Bool(False, help="whether steps and tables are beside it").tag(sync=True)
    still = traitlets.Unicode(help="PNG in base64, for pages without a kernel; empty if too large").tag(sync=True)
    scene = traitlets.Instance(Scene, help="what is shown; set it, and it is drawn; BadInput for what is no scene")

    _viewing: Viewing | None = None  # before it is opened, and once it is closed

    def __init__(
        self, session: Session, scene: Scene | None = None, controls: bool = False, height: int = HEIGHT
    ) -> None:
        """Raises BadInput outside an event loop; a notebook has one."""
        event_loop = _event_loop()
        first = lit_from(session.default_scene()) if scene is None else checked_scene(scene)
        modules = modules_from(START, CONTROLS) if controls else modules_from(START)
        super().__init__(modules=modules, controls=controls, height=height, scene=first)
        self._viewing = opened_viewing(session, first)
        self._viewing.pictures.attach(event_loop)
        self._viewing.troubles.attach(event_loop)
        self._views: dict[str, _View] = {}  # a notebook may show several
        self._viewing.model.subscribe(self._on_scene)
        self.observe(self._on_scene_set, names="scene")
        self.on_msg(self._heard)
        self._viewing.loop.start()

    @traitlets.validate("scene")
    def _checked_scene(self, proposal: Any) -> Scene:
        return checked_scene(proposal["value"])

    def _repr_mimebundle_(self, **kwargs: Any) -> Any:
        """As any widget's, with a still picture for where no kernel runs: in a saved notebook, on pages of it."""
        bundle = super()._repr_mimebundle_(**kwargs)
        if bundle is not None and (still := self._still()) is not None:
            encoded = base64.b64encode(still).decode()
            bundle[0]["image/png"] = encoded
            self.still = encoded if len(encoded) <= LARGEST_STILL else ""
        return bundle

    def _still(self) -> bytes | None:
        """The scene's finished picture as PNG, while a hand moves it the last one; None if it cannot be drawn."""
        viewing = self._viewing
        if viewing is None:
            return None
        loop, now = viewing.loop, viewing.model.now
        if now.settled:  # else what settles it is heard only after this
            loop.wait_until_drawn()
        picture = loop.shown
        if picture is None or (now.settled and picture.state.scene != now.scene):
            return None
        pixels, scene = picture.published_in_full_size.pixels, picture.state.scene
        return image_bytes(pixels, scene, "png", viewing.volume.description)

    def close(self) -> None:
        """End the drawing; the session goes on. A notebook may hold on to its outputs: pictures are let go of here."""
        if self._viewing is None:  # this is called once more when nobody has it any longer
            return
        self._viewing.loop.close()
        while self._views:
            self._views.popitem()[1].end()
        super().close()
        self._viewing = None
        self.still = ""

    def _heard(self, widget: VolumeWidget, content: dict[str, Any], buffers: list[bytes]) -> None:
        if self._viewing is None:
            return
        name = content["view"]
        opened = content.get("text", "") is None  # anew perhaps
        if (opened or content.get("closed", False)) and name in self._views:
            self._views.pop(name).end()
        if opened:
            self._views[name] = self._view(self._viewing, name)
            self._views[name].begin()
        elif name in self._views:
            self._views[name].heard(content)

    def _view(self, viewing: Viewing, name: str) -> _View:
        viewport = ViewportTalk(viewing, name, lambda message: self._tell(name, message))
        if not self.controls:
            return _View(viewport)
        return _View(
            viewport,
            ControlsTalk(viewing, name, lambda content: self.send({"view": name, "controls": content})),
        )

    def _tell(self, view: str, message: str | bytes) -> None:
        if isinstance(message, str):
            self.send({"view": view, "text": message})
        else:
            self.send({"view": view, "text": None}, [message])

    def _on_scene(self, state: SceneState) -> None:
        self.scene = state.scene

    def _on_scene_set(self, change: dict[str, Any]) -> None:
        scene: Scene = change["new"]
        if self._viewing is not None and scene != self._viewing.model.scene:
            self._viewing.model.change(lambda _: msgspec.structs.replace(scene), by="notebook")


def _event_loop() -> asyncio.AbstractEventLoop:
    try:
        return asyncio.get_running_loop()
    except RuntimeError:
        raise BadInput(
            "a widget lives in a notebook, and no event loop runs here; volsplat.view(session) opens the page instead"
        ) from None


@dataclass(frozen=True)
class _View:
    """One place where a notebook shows the widget."""

    viewport: ViewportTalk
    controls: ControlsTalk | None = None

    def begin(self) -> None:
        self.viewport.begin()
        if self.controls is not None:
            self.controls.begin()

    def heard(self, content: dict[str, Any]) -> None:
        if "controls" not in content:
            self.viewport.heard(content["text"])
        elif self.controls is not None:
            self.controls.heard(content["controls"])

    def end(self) -> None:
        self.viewport.end()
        if self.controls is not None:
            self.controls.end()
