"""The page's dialog for movies: a turntable or a flight through key scenes, with progress and cancel."""

from __future__ import annotations

import asyncio
import shutil
from pathlib import Path

from nicegui import background_tasks, context, ui

from volsplat.client.figure.figure import Figure
from volsplat.client.movie.key_frames import key_framed, turntable
from volsplat.client.scene.resized import sized
from volsplat.client.ui.controls.side_dialog import SideDialog
from volsplat.client.ui.doors.handed_files import hand_file
from volsplat.client.ui.doors.saved_names import saved_name
from volsplat.client.ui.viewing.idle_drawing import IdleDrawing
from volsplat.client.ui.viewing.saving import MovieJob
from volsplat.client.ui.viewing.viewing import Viewing
from volsplat.program.temporary_folder import made_folder
from volsplat.protocol.description.scene import LARGEST_EXTENT, Scene
from volsplat.protocol.text.errors import BadInput, VolsplatError

TURNTABLE, KEY_SCENES = "turntable", "key scenes"
KINDS = (".mp4", ".webm")
IMAGES = (2, 10_000)  # least and most
IMAGES_A_SECOND = (1, 120)
PIXELS = (16, LARGEST_EXTENT)
SECONDS_BETWEEN_LOOKS = 0.2


class MovieDialog:
    """One tab's dialog, beside which the volume can still be turned: a movie is drawn while nobody does so."""

    def __init__(self, viewing: Viewing, name: str, opener: ui.button) -> None:
        self._viewing = viewing
        self._keys: list[Scene] = []
        self._job: MovieJob | None = None
        self._dialog = SideDialog("Movie", opener)
        with self._dialog.card:
            self._path = ui.toggle([TURNTABLE, KEY_SCENES], value=TURNTABLE).props("dense no-caps unelevated")
            with ui.row().bind_visibility_from(self._path, "value", value=KEY_SCENES).classes("items-center"):
                self._key_count = ui.label("no key scene yet").classes("vs-muted")
                ui.button("add this scene", on_click=self._add_key).props("flat dense no-caps")
                ui.button("forget them", on_click=self._forget_keys).props("flat dense no-caps")
            with ui.row():
                self._frames = _number("images", 120)
                self._rate = _number("images a second", 30)
            with ui.row():
                self._width = _number("width, pixels", None)
                self._height = _number("height, pixels", None)
            with ui.row():
                self._name = ui.input("name", value=name).props("dense")
                self._kind = ui.select(list(KINDS), value=KINDS[0], label="kind").props("dense")
            self._as_figures = ui.switch("with scale bar, colours and sides")
            self._trouble = ui.label("").classes("vs-bad").props("role=alert")
            self._bar = ui.linear_progress(0.0, show_value=False).props("rounded")
            self._line = ui.label("").classes("vs-muted")
            with ui.row().classes("justify-end w-full"):
                self._cancel = ui.button("cancel", on_click=self._stop).props("flat no-caps")
                self._make = ui.button("make the movie", on_click=self._start).props("no-caps")
                ui.button("close", on_click=self._dialog.close).props("flat no-caps")
        self._gone = False  # the tab
        self._show_state()
        context.client.on_delete(self._leave)

    def open(self) -> None:
        """Show it, with the size that the picture has now."""
        image = self._viewing.model.scene.image
        self._width.value, self._height.value = image.width, image.height
        self._dialog.open()

    def _add_key(self) -> None:
        self._keys.append(self._viewing.model.scene)
        self._show_state()

    def _forget_keys(self) -> None:
        self._keys.clear()
        self._show_state()

    def _scenes(self) -> list[Scene]:
        """Raises BadInput."""
        volume = self._viewing.volume
        geometry = volume.description.geometry
        frames = _whole(self._frames, IMAGES)
        width, height = _whole(self._width, PIXELS), _whole(self._height, PIXELS)

        def made_ready(scene: Scene) -> Scene:
            return sized(volume.settled(volume.fitted_to_turn(scene)), width=width, height=height)

        if self._path.value == TURNTABLE:
            return turntable(made_ready(self._viewing.model.scene), geometry, frames)
        return key_framed([made_ready(key) for key in self._keys], geometry, frames, volume.automatic_window)

    def _start(self) -> None:
        drawing = IdleDrawing(self._viewing.session, self._viewing.loop)
        try:
            folder = made_folder()
        except BadInput as error:
            self._trouble.text = str(error)
            return
        try:
            path = folder / saved_name(self._name.value, self._kind.value)
            scenes, rate = self._scenes(), _whole(self._rate, IMAGES_A_SECOND)
            figure = Figure() if self._as_figures.value else None
            self._job = MovieJob(drawing, scenes, path, rate, figure=figure)
        except VolsplatError as error:
            self._trouble.text = _told(error, folder)
            shutil.rmtree(folder)
            return
        self._trouble.text = ""
        self._show_state()
        self._viewing.jobs += 1
        background_tasks.create(self._follow(self._job, folder), name="movie")

    async def _follow(self, job: MovieJob, folder: Path) -> None:
        """Show how it goes, to the end, whether or not the tab is still there."""
        handed = False  # to the browser, and the folder with it
        try:
            while not job.done:
                self._show_progress(job, folder)
                await asyncio.sleep(SECONDS_BETWEEN_LOOKS)
            self._job = None
            self._show_progress(job, folder)
            if job.whole and not self._gone:
                self._line.text = f"{job.line} in {job.path.name}, which the browser saves"
                with self._dialog.client:
                    hand_file(job.path)
                handed = True
        finally:
            self._viewing.jobs -= 1
            job.cancel()  # at the end of everything it may still be at it
            await asyncio.to_thread(job.join)
            if not handed:
                shutil.rmtree(folder)

    def _show_progress(self, job: MovieJob, folder: Path) -> None:
        if self._gone:
            return
        self._bar.value = job.progress
        self._line.text = job.line if job.error is None else ""
        self._trouble.text = _told(job.error or "", folder)
        self._show_state()

    def _stop(self) -> None:
        if self._job is not None:
            self._job.cancel()

    def _leave(self) -> None:
        self._gone = True
        self._stop()

    def _show_state(self) -> None:
        running = self._job is not None
        self._make.set_enabled(not running)
        self._cancel.set_visibility(running)
        self._bar.set_visibility(running)
        self._key_count.text = f"{len(self._keys)} key scene{'' if len(self._keys) == 1 else 's'}"


def _number(label: str, value: int | None) -> ui.number:
    return ui.number(label, value=value, precision=0).props("dense")


def _whole(field: ui.number, limits: tuple[int, int]) -> int:
    """What the field says. Raises BadInput unless it is a whole number within the limits."""
    least, most = limits
    value = field.value
    if value is None or value != int(value) or not least <= value <= most:
        raise BadInput(f"{field.label}: give a whole number from {least} to {most}")
    return int(value)


def _told(error: VolsplatError | str, folder: Path) -> str:
    """Without the folder, which is nobody's business and soon gone."""
    return str(error).replace(f"{folder}/", "")
