"""What is drawn while a scene moves and once it is settled, by real servers."""

from __future__ import annotations

import dataclasses
import queue
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from threading import Event
from typing import Any, NoReturn, cast

import msgspec
import numpy as np
import pytest

from support.patience import PATIENCE, wait_until
from volsplat.client import Session
from volsplat.client.phantoms import make_phantom
from volsplat.client.phantoms.volume_writer import write_volume
from volsplat.client.scene.lit_from import lit_from
from volsplat.client.scene.resized import sized
from volsplat.client.ui.viewing import drawing_loop
from volsplat.client.ui.viewing import picture as picture_of_loop
from volsplat.client.ui.viewing.drawing_loop import DrawingLoop
from volsplat.client.ui.viewing.image_size import scaled
from volsplat.client.ui.viewing.pacing import Rung
from volsplat.client.ui.viewing.picture import Picture
from volsplat.client.ui.viewing.picture_encoding import encoded
from volsplat.client.ui.viewing.running_step import Progress, progress
from volsplat.client.ui.viewing.scene_model import SceneModel
from volsplat.client.ui.viewing.step_states import step_title
from volsplat.client.ui.viewport.message_base import HEADER_LENGTH_BYTES
from volsplat.client.ui.viewport.viewport_messages import picture_message
from volsplat.protocol.description.refinement_steps import PaperStep, Step
from volsplat.protocol.description.scene import Bounds, Light, Refine, Scene, Shading
from volsplat.protocol.rules.levels import Thinning
from volsplat.protocol.rules.refinement import PAPER_STEPS, same_picture
from volsplat.protocol.text.errors import PeerLost, VolsplatError

PNG = b"\x89PNG"
SIDE = 400  # pixels: of which half is enough for a smaller image


class Drawn:
    """A session's scene, and the pictures that its loop draws."""

    def __init__(self, session: Session) -> None:
        scene = session.volume.settled(session.default_scene())
        self.session = session
        self.model = SceneModel(sized(scene, width=SIDE, height=SIDE), session.volume.fitted_to_turn)
        self._pictures: queue.SimpleQueue[Picture | VolsplatError] = queue.SimpleQueue()
        self.loop = DrawingLoop(session, self.model, self._pictures.put, self._pictures.put)
        self.firsts: list[Picture] = []
        self._events = 0
        self.loop.tell_first(self.firsts.append)
        self.loop.start()

    def next(self) -> Picture:
        picture = self._pictures.get(timeout=PATIENCE)
        assert isinstance(picture, Picture)
        return picture

    def next_failure(self) -> VolsplatError:
        failure = self._pictures.get(timeout=PATIENCE)
        assert isinstance(failure, VolsplatError)
        return failure

    def last(self) -> list[Picture]:
        """All up to the last one."""
        pictures = [self.next()]
        while not pictures[-1].last:
            pictures.append(self.next())
        return pictures

    def zoom_by(self, factor: float, *, settled: bool) -> None:
        """As a pointer does."""

        def zoomed(scene: Scene) -> Scene:
            assert isinstance(scene.view.zoom, float)
            view = msgspec.structs.replace(scene.view, zoom=scene.view.zoom * factor)
            return msgspec.structs.replace(scene, view=view)

        self._events += 1
        self.model.change(zoomed, settled=settled, event=self._events)


@pytest.fixture
def drawn(tmp_path: Path) -> Iterator[Drawn]:
    path = tmp_path / "head.nrrd"
    write_volume(path, *make_phantom("head", (24, 32, 28)))
    with Session(path, workers=1) as session:
        drawn = Drawn(session)
        drawn.last()
        yield drawn
        drawn.loop.close()


def test_a_moving_scene_is_drawn_in_a_smaller_image_that_holds_the_rate(
    drawn: Drawn, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(drawn.loop.pacing, "while_moving", lambda scene: Rung(Step.F, 0.5))
    drawn.zoom_by(1.1, settled=False)
    moving = drawn.next()
    assert (moving.step, moving.published.width, moving.published.height) == (Step.F, SIDE // 2, SIDE // 2)
    assert moving.complete and not moving.last and not moving.in_full_size

    message = picture_message(moving, "tab", drawn.session.volume.description.geometry, drawn.loop.pacing)
    length = int.from_bytes(message[:HEADER_LENGTH_BYTES], "little")
    header = msgspec.json.decode(message[HEADER_LENGTH_BYTES : HEADER_LENGTH_BYTES + length])
    assert (header["width"], header["view"]["zoom"]) == (SIDE // 2, drawn.model.scene.view.zoom / 2)  # type: ignore[operator]

    still = drawn.session.finish(drawn.model.scene).published.pixels
    difference = np.abs(moving.published_in_full_size.pixels - still)
    assert difference.mean() < 0.01 and still.mean() > 0.05

    drawn.model.change(lambda scene: scene)
    refined = drawn.last()
    assert refined[0].step is Step.F  # what was on the screen is as fine as that
    assert refined[-1].in_full_size and np.array_equal(refined[-1].published.pixels, still)


@pytest.mark.parametrize("thinning", [Thinning(sheets=2), Thinning(sheets=2, rows=2), Thinning(octaves=1)])
@pytest.mark.parametrize("share", [0.5, 1.0])
def test_a_moving_scene_that_takes_too_long_is_drawn_lit_with_fewer_voxels(
    drawn: Drawn, thinning: Thinning, share: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = drawn.session.finish(drawn.model.scene).published.pixels
    monkeypatch.setattr(drawn.loop.pacing, "while_moving", lambda scene: Rung(Step.F, share, thinning))
    drawn.zoom_by(1.0, settled=False)
    moving = drawn.next()
    assert (moving.step, moving.one_in, moving.complete) == (Step.F, thinning.one_in, True)
    seen, side = moving.published_in_full_size.pixels, moving.published.width
    all_voxels = drawn.session.finish(scaled(drawn.model.scene, share)).published
    assert all_voxels.width == side and not np.array_equal(all_voxels.pixels, moving.published.pixels)
    unlit_blocks = drawn.session.finish(drawn.model.scene, Step.A).published.pixels
    assert np.abs(seen - whole).mean() < 0.5 * np.abs(unlit_blocks - whole).mean()

    drawn.model.change(lambda scene: scene)
    assert np.array_equal(drawn.last()[-1].published.pixels, whole)


def test_what_a_moving_picture_takes_is_told_with_its_coding_but_not_with_that_of_one_at_rest(
    drawn: Drawn, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One at rest is coded as PNG, which takes as long as many a moving picture in all."""
    measured = list[tuple[Rung, float]]()
    at_rest = list[tuple[Step, float]]()
    monkeypatch.setattr(drawn.loop.pacing, "while_moving", lambda scene: Rung(Step.F, 0.5))
    monkeypatch.setattr(drawn.loop.pacing, "measured", lambda rung, seconds: measured.append((rung, seconds)))
    monkeypatch.setattr(drawn.loop.pacing, "measured_at_rest", lambda step, seconds: at_rest.append((step, seconds)))
    drawn.zoom_by(1.1, settled=False)
    moving = drawn.next()
    drawn.model.change(lambda scene: scene)
    still = drawn.last()[-1]
    assert still.data.startswith(PNG) and moving.outcome is not None and still.outcome is not None
    ((rung, seconds),) = measured
    assert rung == Rung(Step.F, 0.5) and seconds > moving.outcome.wall_seconds
    assert at_rest[-1] == (Step.F, still.outcome.wall_seconds)


def test_step_g_begins_only_once_the_hand_has_rested(drawn: Drawn, monkeypatch: pytest.MonkeyPatch) -> None:
    def to_g(scene: Scene) -> Scene:
        return msgspec.structs.replace(scene, refine=msgspec.structs.replace(scene.refine, finest=Step.G))

    monkeypatch.setattr(drawing_loop, "REST_SECONDS", 2 * PATIENCE)
    drawn.model.change(to_g)
    drawn.zoom_by(1.1, settled=True)
    while True:
        picture = drawn.next()
        assert picture.step <= Step.F and not picture.last
        if picture.complete and picture.step is Step.F:
            break
    monkeypatch.setattr(drawing_loop, "REST_SECONDS", 0.0)
    drawn.zoom_by(1.1, settled=True)  # ends the rest
    steps = {picture.step for picture in drawn.last()}
    assert {Step.F, Step.G} <= steps


@pytest.mark.parametrize(
    ("refine", "shading", "distinct"),
    [
        (Refine(lit_from=PaperStep.C), Shading(), "ABCF"),
        (Refine(lit_from=PaperStep.A), Shading(), "ABCF"),
        (Refine(lit_from=PaperStep.E), Shading(), "ABCDEF"),
        (Refine(lit_from=PaperStep.E), Shading(specular=False), "ABCDF"),
        (Refine(lit_from=PaperStep.F), Shading(), "ABCEF"),
    ],
)
def test_of_steps_with_the_same_picture_only_the_last_is_drawn(
    drawn: Drawn, refine: Refine, shading: Shading, distinct: str
) -> None:
    drawn.model.change(lambda scene: msgspec.structs.replace(scene, refine=refine, shading=shading))
    pictures = drawn.last()
    assert "".join(picture.step for picture in pictures if picture.complete) == distinct
    for picture in pictures:
        assert progress(picture, drawn.model.now, Step.A).running in (None, *map(Step, distinct))

    finished = {step: drawn.session.finish(drawn.model.scene, step).published.pixels for step in PAPER_STEPS}
    for before, step in pairwise(PAPER_STEPS):
        same = same_picture(drawn.model.scene, before, step)
        assert np.array_equal(finished[before], finished[step]) == same
        assert ("the same picture" in step_title(drawn.model.scene, step)) == same


def finest(drawn: Drawn, step: Step) -> list[Step]:
    """Have the image refine to this step; the steps of all pictures up to the last, each once."""
    drawn.model.change(
        lambda scene: msgspec.structs.replace(scene, refine=msgspec.structs.replace(scene.refine, finest=step))
    )
    pictures = drawn.last()
    whole = drawn.session.finish(drawn.model.scene, step).published.pixels
    assert np.array_equal(pictures[-1].published.pixels, whole)
    wanted = Progress(running=None, finished=step)
    assert progress(pictures[-1], drawn.model.now, drawn.loop.pacing.moving.step) == wanted
    return list(dict.fromkeys(picture.step for picture in pictures))


def test_the_image_refines_to_the_step_that_is_asked_for_and_goes_on_from_there(drawn: Drawn) -> None:
    assert finest(drawn, Step.B) == [Step.B], "what is finer is on the screen already"
    drawn.zoom_by(1.1, settled=True)
    assert [picture.step for picture in drawn.last() if picture.complete] == [Step.A, Step.B]
    assert finest(drawn, Step.E) == [Step.C, Step.D, Step.E]
    assert finest(drawn, Step.G) == [Step.F, Step.G]
    assert finest(drawn, Step.F) == [Step.F]
    assert finest(drawn, Step.A) == [Step.A]


def test_steps_with_the_picture_on_the_screen_are_not_drawn_again(drawn: Drawn) -> None:
    drawn.model.change(lit_from)  # so that D, E and F are one picture
    drawn.last()
    shown = drawn.loop.shown
    assert shown is not None and same_picture(drawn.model.scene, Step.D, Step.F)
    for step in (Step.E, Step.D, Step.F):
        assert finest(drawn, step) == [step]
        assert drawn.loop.shown is not None and drawn.loop.shown.published is shown.published
    assert finest(drawn, Step.G) == [Step.G]


def test_what_is_coarser_than_asked_for_is_told_to_be_drawn(drawn: Drawn) -> None:
    shown, state = drawn.loop.shown, drawn.model.now
    assert shown is not None and shown.step is Step.F
    refine = msgspec.structs.replace(state.scene.refine, finest=Step.C)
    coarser = msgspec.structs.replace(state.scene, refine=refine)
    wanted = Progress(running=Step.C, finished=None)
    assert progress(shown, dataclasses.replace(state, scene=coarser), Step.F) == wanted


@pytest.mark.parametrize("step", Step)
def test_what_moves_is_drawn_no_finer_than_asked_for(drawn: Drawn, step: Step) -> None:
    finest(drawn, step)
    for _ in range(3):
        drawn.zoom_by(1.01, settled=False)
        moving = drawn.next()
        assert moving.step <= min(step, Step.F) and (moving.step == step or step not in (Step.D, Step.E, Step.F))


def test_the_words_of_steps_tell_where_light_joins(drawn: Drawn) -> None:
    titles = {lit: [step_title(lit_from(drawn.model.scene, lit), step) for step in Step] for lit in PaperStep}
    assert titles[PaperStep.E][4:6] == ["step E: diffuse", "step F: specular"]
    assert titles[PaperStep.C][2:6] == [
        "step C: full, diffuse, specular",
        "step D: kernel",
        "step E: the same picture as step D",
        "step F: the same picture as step E",
    ]


def test_what_step_g_alone_obeys_leaves_a_finished_picture_up_to_f(drawn: Drawn) -> None:
    shown = drawn.loop.shown
    assert shown is not None

    def with_shadows(scene: Scene) -> Scene:
        light = msgspec.structs.replace(scene.light, shadows=0.5, depth_cue=0.5)
        thinner = msgspec.structs.replace(scene.reconstruction, slab=0.5)
        return msgspec.structs.replace(scene, light=light, reconstruction=thinner)

    # While a hand is at it nothing is drawn, and the step stays finished.
    drawn.model.change(with_shadows, settled=False)
    wait_until(lambda: not drawn.loop._something_to_do() and not drawn.loop.drawing, "done with the moving scene")
    assert progress(shown, drawn.model.now, Step.A) == Progress(running=None, finished=Step.F)
    drawn.model.change(with_shadows)
    (again,) = drawn.last()
    assert again.published is shown.published and again.state.scene == drawn.model.scene
    drawn.model.change(
        lambda scene: msgspec.structs.replace(scene, refine=msgspec.structs.replace(scene.refine, finest=Step.G))
    )
    with_g = drawn.last()[-1]
    assert with_g.step is Step.G
    drawn.model.change(lambda scene: msgspec.structs.replace(scene, light=Light()))
    lighter = drawn.last()[-1]
    assert lighter.step is Step.G and not np.array_equal(lighter.published.pixels, with_g.published.pixels)


def test_the_first_picture_whose_step_is_finished_is_told_once(drawn: Drawn) -> None:
    drawn.zoom_by(1.1, settled=True)
    drawn.last()
    (first,) = drawn.firsts
    assert first.complete and first.step == Step.A


class Gone:
    """A session that has ended, and its turns, which hear of that once it is `told`."""

    over = False

    def __init__(self) -> None:
        self.asked, self.told = Event(), Event()

    def turn(self) -> Gone:
        return self

    def taken(self, *_: object) -> NoReturn:
        self.asked.set()
        assert self.told.wait(PATIENCE)
        raise PeerLost("gone")

    def end(self) -> None:
        """Nobody draws in it."""


def test_the_end_of_a_session_is_not_told_once_another_one_draws(drawn: Drawn) -> None:
    gone = Gone()
    drawn.loop.draw_with(cast(Any, gone))
    assert gone.asked.wait(PATIENCE)
    drawn.loop.draw_with(drawn.session)
    gone.told.set()
    assert drawn.last()[-1].step is Step.F


def test_what_cannot_be_drawn_is_told_and_known_until_the_scene_is_another(drawn: Drawn) -> None:
    assert drawn.loop.failure is None
    drawn.model.change(lambda scene: scene.with_(bounds=Bounds(high=(999, -1, -1))))
    told = drawn.next_failure()
    assert "give low < high" in str(told) and drawn.loop.failure is told
    drawn.model.change(lambda scene: scene.with_(bounds=Bounds()))
    assert drawn.loop.failure is None
    drawn.last()
    assert drawn.loop.failure is None


def test_pictures_are_encoded_before_they_are_shown_unless_nobody_watches(
    drawn: Drawn, monkeypatch: pytest.MonkeyPatch
) -> None:
    encodings: list[bool] = []

    def noted(*args: Any, lossless: bool, **options: Any) -> bytes:
        encodings.append(lossless)
        return encoded(*args, lossless=lossless, **options)

    monkeypatch.setattr(picture_of_loop, "encoded", noted)
    monkeypatch.setattr(drawn.loop, "_is_watched", lambda: False)
    drawn.zoom_by(1.1, settled=True)
    unwatched = drawn.last()
    assert not encodings
    assert unwatched[-1].data.startswith(PNG) and unwatched[-1].data.startswith(PNG)
    assert encodings == [True]

    monkeypatch.setattr(drawn.loop, "_is_watched", lambda: True)
    drawn.zoom_by(1.1, settled=True)
    watched = len(drawn.last())
    assert encodings[1:] == [False] * (watched - 1) + [True]
