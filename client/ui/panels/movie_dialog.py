"""The page's dialog for movies: a turntable or a flight through key scenes, with progress and cancel."""

from __future__ import annotations

import asyncio
import shutil
import tempfile
from pathlib import Path

import msgspec
from nicegui import background_tasks, context, ui

from volsplat.client.movie.key_frames import key_framed, turntable
from volsplat.client.ui.viewing.saving import MovieJob
from volsplat.client.ui.viewing.viewing import Viewing
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.text.errors import VolsplatError

TURNTABLE, KEY_SCENES = "turntable", "key scenes"
KINDS = (".mp4", ".webm")
MOST_FRAMES = 10_000
SECONDS_BETWEEN_LOOKS = 0.2


class MovieDialog:
    """One tab's dialog. While a movie is made, nothing else is drawn."""

    def __init__(self, viewing: Viewing) -> None:
        self._viewing = viewing
        self._keys: list[Scene] = []
        self._job: MovieJob | None = None
        with ui.dialog() as self._dialog, ui.card().classes("vs-dialog"):
            ui.label("Movie").classes("vs-name")
            self._path = ui.toggle([TURNTABLE, KEY_SCENES], value=TURNTABLE).props("dense no-caps unelevated")
            with ui.row().bind_visibility_from(self._path, "value", value=KEY_SCENES).classes("items-center"):
                self._key_count = ui.label("no key scene yet").classes("vs-muted")
                ui.button("add this scene", on_click=self._add_key).props("flat dense no-caps")
                ui.button("forget them", on_click=self._forget_keys).props("flat dense no-caps")
            with ui.row():
                self._frames = ui.number("images", value=120, min=2, max=MOST_FRAMES, precision=0).props("dense")
                self._rate = ui.number("images a second", value=30, min=1, max=120, precision=0).props("dense")
                self._kind = ui.select(list(KINDS), value=KINDS[0], label="kind").props("dense")
            self._trouble = ui.label("").classes("vs-bad")
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
        self._dialog.open()

    def _add_key(self) -> None:
        self._keys.append(self._viewing.model.scene)
        self._show_state()

    def _forget_keys(self) -> None:
        self._keys.clear()
        self._show_state()

    def _scenes(self) -> list[Scene]:
        """Raises BadInput."""
        geometry = self._viewing.volume.description.geometry
        frames = int(self._frames.value or 0)
        if self._path.value == TURNTABLE:
            return turntable(self._viewing.volume.settled(self._viewing.model.scene), geometry, max(frames, 2))
        size = self._viewing.model.scene.image  # the window may have changed since a key was taken
        keys = [self._viewing.volume.settled(msgspec.structs.replace(key, image=size)) for key in self._keys]
        return key_framed(keys, geometry, frames)

    def _start(self) -> None:
        folder = Path(tempfile.mkdtemp(prefix="volsplat-movie-"))
        self._viewing.loop.pause()
        try:
            scenes = self._scenes()
            path = folder / f"movie{self._kind.value}"
            self._job = MovieJob(self._viewing.session, scenes, path, int(self._rate.value or 30))
        except VolsplatError as error:
            self._trouble.text = str(error)
            self._viewing.loop.resume()
            shutil.rmtree(folder)
            return
        self._trouble.text = ""
        self._show_state()
        background_tasks.create(self._follow(self._job, folder), name="movie")

    async def _follow(self, job: MovieJob, folder: Path) -> None:
        """Show how it goes, to the end, whether or not the tab is still there."""
        try:
            while not job.done:
                self._show_progress(job)
                await asyncio.sleep(SECONDS_BETWEEN_LOOKS)
            self._job = None
            self._show_progress(job)
            if job.whole and not self._gone:
                with self._dialog.client:
                    ui.download(job.path.read_bytes(), job.path.name)
        finally:
            job.cancel()  # at the end of everything it may still be at it
            job.join()
            self._viewing.loop.resume()
            shutil.rmtree(folder)

    def _show_progress(self, job: MovieJob) -> None:
        if self._gone:
            return
        self._bar.value = job.progress
        self._line.text = job.line if job.error is None else ""
        self._trouble.text = job.error or ""
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
