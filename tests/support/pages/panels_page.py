"""A program that serves panels of the page, with a volume and its servers behind them, for tests in a browser.

    python -m support.pages.panels_page VOLUME

It prints its address. `/` holds the panels; `/state` tells the session's scene as JSON, whether it is settled, which
step of it is finished, and how often it was changed; `/again` makes the scene what it was at the beginning
and tells its revision, which the panels show as soon as they show that scene.
"""

from __future__ import annotations

import asyncio
import socket
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import msgspec
import uvicorn
from fastapi import FastAPI
from nicegui import context, ui
from starlette.responses import Response
from starlette.staticfiles import StaticFiles

from volsplat.client.session.session import Session
from volsplat.client.ui.doors.static_files import STATIC
from volsplat.client.ui.panels.scene_panels import scene_panels
from volsplat.client.ui.panels.servers.servers_panel import ServersPanel
from volsplat.client.ui.panels.steps_bar import steps_bar
from volsplat.client.ui.viewing.opened_viewing import opened_viewing
from volsplat.client.ui.viewing.running_step import progress
from volsplat.client.ui.viewing.scene_model import SceneState
from volsplat.client.ui.viewing.viewing import Viewing
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Image, Scene

UNUSED_SECONDS = 3600  # a connection; who asks again just when it is closed gets no answer

UNSEEN = Image(width=64, height=48)  # small, so that servers are soon done with what no panel shows


class State(msgspec.Struct):
    scene: Scene
    settled: bool
    finished: Step | None
    revision: int
    unsettled: list[str]  # panels that a person has dragged in


def page(viewing: Viewing) -> None:
    """The panels where the page has them."""
    for sheet in ("theme.css", "page.css"):
        ui.add_head_html(f'<link rel="stylesheet" href="/volsplat/static/{sheet}">')
    with ui.element("main").classes("vs-page"):
        with ui.element("header").classes("vs-head"):
            steps_bar(viewing)
            revision = ui.label().props('data-revision=""')
        with ui.element("aside").classes("vs-left"):
            scene_panels(viewing)
        with ui.element("footer").classes("vs-foot"):
            ServersPanel(viewing)

    def show_revision(now: SceneState) -> None:
        revision.set_text(str(now.revision))

    context.client.on_delete(viewing.model.subscribe(show_revision))


def application(viewing: Viewing) -> FastAPI:
    @asynccontextmanager
    async def lifespan(_: FastAPI) -> AsyncIterator[None]:
        viewing.pictures.attach(asyncio.get_running_loop())
        viewing.loop.start()
        yield
        await asyncio.to_thread(viewing.loop.close)

    async def state() -> Response:
        now = viewing.model.now
        done = progress(viewing.pictures.newest, now, viewing.loop.pacing.moving.step).finished
        return Response(msgspec.json.encode(State(now.scene, now.settled, done, now.revision, sorted(unsettled))))

    async def again() -> int:
        viewing.image_size.follows_window = True
        viewing.model.change(lambda _: at_first)
        unsettled.clear()
        return viewing.model.now.revision

    at_first = viewing.model.now.scene
    unsettled: set[str] = set()  # who changed the scene without settling it, since the beginning
    viewing.model.subscribe(lambda now: None if now.settled else unsettled.add(now.by.split()[0]))
    served = FastAPI(lifespan=lifespan)
    served.mount("/volsplat/static", StaticFiles(directory=STATIC))
    served.add_api_route("/state", state)
    served.add_api_route("/again", again)
    ui.page("/")(lambda: page(viewing))
    ui.run_with(served, dark=None, tailwind=False, show_welcome_message=False, reconnect_timeout=60)
    return served


def main(volume: str) -> None:
    with Session(volume, workers=2) as session, socket.create_server(("127.0.0.1", 0)) as listener:
        url = f"http://127.0.0.1:{listener.getsockname()[1]}"
        scene = msgspec.structs.replace(session.default_scene(), image=UNSEEN)
        viewing = opened_viewing(session, scene)
        server = uvicorn.Server(
            uvicorn.Config(application(viewing), log_level="warning", timeout_keep_alive=UNUSED_SECONDS)
        )
        print(url, flush=True)
        server.run(sockets=[listener])


if __name__ == "__main__":
    main(sys.argv[1])
