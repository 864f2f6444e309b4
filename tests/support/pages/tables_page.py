"""A program that serves the tables' panel, over made-up histograms and without servers, for tests in a browser.

    python -m support.pages.tables_page

It prints its address. `/anew` begins a session and holds its panel, and a button that begins another in the same page,
beside which it is told how many there were; `/` holds the panel of the newest, whose scene `/state` tells as JSON, and
whether it is settled.
"""

from __future__ import annotations

import math
import socket

import msgspec
import uvicorn
from fastapi import FastAPI
from nicegui import ui
from starlette.responses import Response
from starlette.staticfiles import StaticFiles

from volsplat.client.scene.presets import preset_scene
from volsplat.client.ui.doors.static_files import STATIC
from volsplat.client.ui.tables.tables_panel import TablesPanel
from volsplat.client.ui.viewing.known_pushes import KnownPushes
from volsplat.client.ui.viewing.scene_model import SceneModel
from volsplat.client.volume.surveyed_volume import SurveyedVolume
from volsplat.protocol.description.block_extremes import BlockExtremes
from volsplat.protocol.description.scene import Quantise, Scene
from volsplat.protocol.description.shading_tables import ColourTable, ScalarTable, Tables
from volsplat.protocol.description.volume import Geometry, VolumeDescription
from volsplat.protocol.rules.index_rules import Survey

UNUSED_SECONDS = 3600  # a connection; who asks again just when it is closed gets no answer

WINDOW = (-1000.0, 1550.0)  # ten units for each entry of a table


def peak(middle: float, width: float, height: float) -> list[int]:
    return [round(height * math.exp(-(((n - middle) / width) ** 2))) for n in range(1000)]


VOLUME = SurveyedVolume(
    description=VolumeDescription(
        name="made-up.nrrd", format="NRRD", geometry=Geometry(dims=(64, 64, 64)), scalar_type="int16", unit="mm"
    ),
    survey=Survey(low=-1200.0, high=2000.0, max_gradient=900.0, voxels=262144, no_data=0),
    density_counts=[
        sum(parts) for parts in zip(peak(70, 20, 9e4), peak(390, 15, 2e4), peak(500, 90, 500), strict=True)
    ],
    strength_counts=[round(1e5 * math.exp(-n / 40)) for n in range(1000)],
    extremes=BlockExtremes.nothing((64, 64, 64)),
)
SCENE = Scene(
    tables=Tables(
        emit=ColourTable(points=((0.2, (0.0, 0.0, 0.0)), (0.8, (1.0, 0.6, 0.2)))),
        refl=ColourTable(points=((0.5, (0.6, 0.6, 0.6)),)),
        opac=ScalarTable(points=((0.2, 0.0), (0.4, 0.5), (0.8, 0.5))),
        modu=ScalarTable(points=((0.1, 0.0), (0.5, 1.0))),
    ),
    quantise=Quantise(window=WINDOW),
)


class State(msgspec.Struct):
    scene: Scene
    settled: bool


def application() -> FastAPI:
    models: list[SceneModel] = []
    pushes: list[KnownPushes] = []

    def begin() -> None:
        models.append(SceneModel(SCENE))
        pushes.append(KnownPushes())

    async def state() -> Response:
        now = models[-1].now
        return Response(msgspec.json.encode(State(now.scene, now.settled)))

    def panel() -> None:
        TablesPanel(models[-1], VOLUME, preset_scene("ct-bone", VOLUME.subject()), pushes[-1])

    def page() -> None:
        for style in ("theme.css", "page.css"):
            ui.add_head_html(f'<link rel="stylesheet" href="/volsplat/static/{style}">')
        with ui.element("main").classes("vs-page"), ui.element("aside").classes("vs-right") as place:
            panel()

        def begin_anew() -> None:
            begin()
            place.clear()  # what the old panel still has to say is for nobody
            with place:
                panel()
            begun.set_text(str(len(models)))

        with ui.element("footer").classes("vs-foot").style("position: fixed; left: 0; bottom: 0"):
            ui.button("begin anew", on_click=begin_anew)
            begun = ui.label(str(len(models))).props('data-begun=""')

    def anew() -> None:
        begin()
        page()

    served = FastAPI()
    served.mount("/volsplat/static", StaticFiles(directory=STATIC))
    served.add_api_route("/state", state)
    ui.page("/")(page)
    ui.page("/anew")(anew)
    ui.run_with(served, dark=None, tailwind=False, show_welcome_message=False)
    return served


def main() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        server = uvicorn.Server(uvicorn.Config(application(), log_level="warning", timeout_keep_alive=UNUSED_SECONDS))
        print(f"http://127.0.0.1:{listener.getsockname()[1]}", flush=True)
        server.run(sockets=[listener])


if __name__ == "__main__":
    main()
