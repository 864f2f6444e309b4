"""The viewport in a notebook: what its two halves are given, and the scene as its trait."""

from __future__ import annotations

import asyncio
import base64
import gc
import json
import re
import weakref
from collections.abc import Awaitable, Callable
from io import BytesIO
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
import traitlets
from PIL import Image, ImageColor

from volsplat.client import Session
from volsplat.client.memory.array_volume import Volume
from volsplat.client.phantoms import make_phantom
from volsplat.client.phantoms.volume_writer import write_volume
from volsplat.client.ui.notebook_widget import VolumeWidget, modules_from
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.text.errors import BadInput

VIEW = "a view"
WAIT = 60.0  # seconds


class Notebook:
    """Plays the notebook's part for one widget."""

    def __init__(self, session: Session) -> None:
        heard = self.heard = asyncio.Queue[tuple[dict[str, Any], list[bytes]]]()

        class Spoken(VolumeWidget):
            def send(self, content: dict[str, Any], buffers: list[bytes] | None = None) -> None:
                heard.put_nowait((content, buffers or []))

        self.widget = Spoken(session)

    def says(self, message: dict[str, Any] | None) -> None:
        text = None if message is None else json.dumps(message)
        self.widget._handle_custom_msg({"view": VIEW, "text": text}, [])

    async def picture(self, wanted: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        """The header of the first picture of that kind; all are acknowledged."""
        while True:
            content, buffers = await asyncio.wait_for(self.heard.get(), WAIT)
            assert content["view"] == VIEW
            if content["text"] is None:
                length = int.from_bytes(buffers[0][:4], "little")
                header: dict[str, Any] = json.loads(buffers[0][4 : 4 + length])
                self.says({"type": "shown", "number": header["number"]})
                if wanted(header):
                    return header


def in_notebook(tmp_path: Path, use: Callable[[Notebook], Awaitable[None]]) -> None:
    path = tmp_path / "shells.nrrd"
    write_volume(path, *make_phantom("shells", (16, 16, 16)))

    async def run() -> None:
        with Session(path, workers=1) as session:
            notebook = Notebook(session)
            notebook.says(None)
            notebook.says({"type": "size", "width": 40, "height": 30})
            await use(notebook)
            notebook.widget.close()

    asyncio.run(run())


def test_a_widget_without_a_notebook_is_refused_and_leaves_nothing(tmp_path: Path) -> None:
    write_volume(tmp_path / "shells.nrrd", *make_phantom("shells", (16, 16, 16)))
    with Session(tmp_path / "shells.nrrd", workers=1) as session:
        with pytest.raises(BadInput, match=r"no event loop runs here; volsplat\.view\(session\) opens the page"):
            session.widget()
        gc.collect()  # which ends the widget; what it raises then fails the test


def test_a_widget_may_be_closed_more_than_once(tmp_path: Path) -> None:
    async def use(notebook: Notebook) -> None:
        notebook.widget.close()

    in_notebook(tmp_path, use)


def test_what_a_closed_widget_showed_is_let_go_though_a_notebook_keeps_its_output(tmp_path: Path) -> None:
    async def use(notebook: Notebook) -> None:
        await notebook.picture(lambda header: bool(header["last"]) and header["width"] == 40)
        viewing = weakref.ref(notebook.widget._viewing)
        assert viewing() is not None
        notebook.widget.close()
        notebook.says({"type": "size", "width": 50, "height": 30})
        notebook.widget.scene = notebook.widget.scene.with_(zoom=3.0)
        assert notebook.widget._still() is None
        gc.collect()
        assert viewing() is None

    in_notebook(tmp_path, use)


def test_a_closed_widget_that_nobody_keeps_is_gone(tmp_path: Path) -> None:
    write_volume(tmp_path / "shells.nrrd", *make_phantom("shells", (16, 16, 16)))

    async def run() -> None:
        with Session(tmp_path / "shells.nrrd", workers=1) as session:
            widget = session.widget()
            gone = weakref.ref(widget)
            widget.close()
            del widget
            gc.collect()
            assert gone() is None

    asyncio.run(run())


def test_a_closed_session_gives_its_array_back(tmp_path: Path) -> None:
    session = Session(Volume(np.zeros((8, 8, 8), np.uint8), spacing=(1, 1, 1)), workers=1)
    shared = weakref.ref(session._in_memory)
    session.close()
    gc.collect()
    assert shared() is None and "closed" in repr(session)


def test_the_hand_moves_the_trait_and_the_trait_the_picture(tmp_path: Path) -> None:
    async def use(notebook: Notebook) -> None:
        await notebook.picture(lambda header: bool(header["last"]) and header["width"] == 40)
        turned = {"rotation": [0.6, 0.0, 0.0, 0.8], "zoom": 2.0, "center": [8, 8, 8], "settled": True, "event": 1}
        turned |= {"width": 40, "height": 30}
        notebook.says({"type": "view", **turned})
        await notebook.picture(lambda header: header["event"] == 1)
        assert notebook.widget.scene.view.rotation == (0.6, 0.0, 0.0, 0.8)
        view = msgspec.structs.replace(notebook.widget.scene.view, zoom=3.0)
        notebook.widget.scene = msgspec.structs.replace(notebook.widget.scene, view=view)
        await notebook.picture(lambda header: bool(header["last"]) and header["view"]["zoom"] == 3.0)

    in_notebook(tmp_path, use)


def test_a_saved_notebook_has_a_still_picture_of_the_scene(tmp_path: Path) -> None:
    async def use(notebook: Notebook) -> None:
        for colour, pixel in (("white", (255, 255, 255)), ("#000080", (0, 0, 128))):
            notebook.widget.scene = notebook.widget.scene.with_(background=colour, size=(40, 30))
            bundle, _ = notebook.widget._repr_mimebundle_()
            still = Image.open(BytesIO(base64.b64decode(bundle["image/png"])))
            assert still.size == (40, 30) and still.getpixel((0, 0)) == pixel
            assert len(set(still.get_flattened_data())) > 10
            assert "application/vnd.jupyter.widget-view+json" in bundle

    in_notebook(tmp_path, use)


def test_no_still_picture_is_of_another_scene(tmp_path: Path) -> None:
    async def use(notebook: Notebook) -> None:
        other = VolumeWidget(notebook.widget._viewing.session)  # type: ignore[union-attr]
        widgets = {widget: colour for widget, colour in ((notebook.widget, "#ff0000"), (other, "#00ff00"))}
        for widget, colour in widgets.items():
            widget.scene = widget.scene.with_(background=colour, size=(40, 30))
        for widget, colour in widgets.items():
            still = widget._still()
            assert still is not None
            assert Image.open(BytesIO(still)).getpixel((0, 0)) == ImageColor.getrgb(colour)
        other.scene = other.scene.with_(bounds=((5, 5, 5), (99, 99, 99)))
        assert other._still() is None
        other.close()

    in_notebook(tmp_path, use)


def test_a_view_that_is_closed_is_told_nothing_more(tmp_path: Path) -> None:
    async def use(notebook: Notebook) -> None:
        await notebook.picture(lambda header: bool(header["last"]))
        notebook.widget._handle_custom_msg({"view": VIEW, "closed": True}, [])
        while not notebook.heard.empty():
            notebook.heard.get_nowait()
        notebook.widget.scene = notebook.widget.scene.with_(background="white")
        notebook.says({"type": "undo"})  # of one that was closed
        assert notebook.heard.empty()
        notebook.says(None)
        notebook.says({"type": "size", "width": 40, "height": 30})
        await notebook.picture(lambda header: bool(header["last"]))

    in_notebook(tmp_path, use)


def test_the_trait_takes_scenes_only(tmp_path: Path) -> None:
    async def use(notebook: Notebook) -> None:
        before: Scene = notebook.widget.scene
        with pytest.raises(traitlets.TraitError):
            notebook.widget.set_trait("scene", {"order": "btf"})
        with pytest.raises(BadInput, match="zoom"):
            notebook.widget.scene = with_zoom(before, "near")
        assert notebook.widget.scene == before
        notebook.widget.scene = with_zoom(before, np.float64(3.0))
        assert type(notebook.widget.scene.view.zoom) is float

    in_notebook(tmp_path, use)


def with_zoom(scene: Scene, zoom: Any) -> Scene:
    return msgspec.structs.replace(scene, view=msgspec.structs.replace(scene.view, zoom=zoom))


def test_each_module_comes_after_all_that_it_imports() -> None:
    seen: set[str] = set()
    for name, source in modules_from("viewport/viewport.js").items():
        assert set(re.findall(r"""from\s+["']\./([\w./]+)["']""", source)) <= seen
        seen.add(name)
    assert name == "viewport/viewport.js"
