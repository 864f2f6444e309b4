"""Several who draw with one session, viewports and scripts: each ends with its own finished picture."""

from __future__ import annotations

import itertools
import logging
import sys
import threading
import traceback
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

import numpy as np
import pytest

from support.patience import PATIENCE, wait_until
from volsplat.client import Session
from volsplat.client.phantoms import make_phantom
from volsplat.client.phantoms.volume_writer import write_volume
from volsplat.client.session import asked_images
from volsplat.client.session.asked_frames import FrameGivenUp
from volsplat.client.session.turns import Urgency
from volsplat.client.ui.viewing.opened_viewing import opened_viewing
from volsplat.client.ui.viewing.viewing import Viewing
from volsplat.protocol.description.refinement_steps import Step
from volsplat.protocol.description.scene import Scene

ROUNDS = 8
LARGE = 900  # pixels, of a picture that takes longer than a hand's
HANDS_RATE = 60  # scenes in a second


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Session]:
    path = tmp_path_factory.mktemp("shared") / "head.nrrd"
    write_volume(path, *make_phantom("head", (24, 32, 28)))
    with Session(path, workers=1) as session:
        yield session


@pytest.fixture
def viewings(session: Session) -> Iterator[list[Viewing]]:
    """Two viewports."""
    viewings = [opened_viewing(session, session.default_scene().with_(size=size)) for size in (200, 240)]
    for viewing in viewings:
        viewing.loop.start()
    yield viewings
    for viewing in viewings:
        viewing.loop.close()


def shows_its_scene(viewing: Viewing) -> bool:
    shown = viewing.loop.shown
    return shown is not None and shown.last and shown.state.scene == viewing.model.scene and not viewing.loop.drawing


def turn(viewing: Viewing, angle: float, settled: bool = True) -> None:
    viewing.model.change(lambda scene: scene.with_(rotation=(angle, 10)), settled=settled)


@contextmanager
def never_at_rest(viewing: Viewing) -> Iterator[None]:
    """A hand that has the next scene as soon as one is drawn."""
    over = threading.Event()

    def move() -> None:
        for angle in itertools.count():
            turn(viewing, angle % 360, settled=False)
            if over.wait(1 / HANDS_RATE):
                return

    with ThreadPoolExecutor(1) as thread:
        moved = thread.submit(move)
        try:
            yield
        finally:
            over.set()
        moved.result(PATIENCE)


def waits_for_turns(thread: threading.Thread) -> bool:
    assert thread.ident is not None
    stack = traceback.extract_stack(sys._current_frames()[thread.ident])
    return any(call.name == threading.Condition.wait_for.__name__ for call in stack)


def check_bits(session: Session, viewing: Viewing) -> None:
    assert viewing.loop.shown is not None
    own = session.finish(viewing.model.scene).published.pixels
    assert np.array_equal(viewing.loop.shown.published.pixels, own)


def test_scenes_of_two_viewports_that_are_set_together_are_both_drawn(
    session: Session, viewings: list[Viewing]
) -> None:
    for angle in range(ROUNDS):
        for viewing in viewings:
            turn(viewing, 40 * angle)
        wait_until(lambda: all(map(shows_its_scene, viewings)), "drawn in both viewports")
    for viewing in viewings:
        check_bits(session, viewing)
        assert viewing.loop.failure is None


@pytest.mark.parametrize("settled", [True, False])
def test_viewports_and_renders_that_go_on_and_on_get_their_pictures(
    session: Session, viewings: list[Viewing], settled: bool
) -> None:
    still = session.default_scene().with_(size=160)
    expected = session.finish(still).published.pixels
    enough = threading.Event()
    rendered_beside: list[int] = []

    def render() -> None:
        for count in itertools.count(1):
            assert np.array_equal(session.finish(still).published.pixels, expected)
            if enough.is_set():
                return
            rendered_beside.append(count)

    with ThreadPoolExecutor(1) as thread:
        rendered = thread.submit(render)
        try:
            for angle in range(ROUNDS):
                for viewing in viewings:
                    turn(viewing, 33 * angle, settled=settled)
                    turn(viewing, 33 * angle + 11)
                wait_until(lambda: all(map(shows_its_scene, viewings)), "drawn while a script renders")
            wait_until(lambda: len(rendered_beside) >= ROUNDS, "rendered beside viewports")
        finally:
            enough.set()
        rendered.result(PATIENCE)
    for viewing in viewings:
        check_bits(session, viewing)


def test_a_refinement_of_a_script_comes_to_its_end_beside_viewports(session: Session, viewings: list[Viewing]) -> None:
    for angle in range(ROUNDS):
        for viewing in viewings:
            turn(viewing, 50 * angle, settled=angle % 2 == 0)
        finished = [image.step for image in session.refine(session.default_scene().with_(size=160)) if image.complete]
        assert finished == [step for step in Step if step <= Step.F]


def test_a_refinement_that_a_script_leaves_half_way_holds_no_viewport_up(
    session: Session, viewings: list[Viewing]
) -> None:
    left = session.refine(session.default_scene().with_(size=300), partial_interval=0.0)
    next(left)
    turn(viewings[0], 70)
    wait_until(lambda: shows_its_scene(viewings[0]), "drawn beside a refinement that nobody goes on with")
    del left


def test_what_a_script_aborts_of_a_viewport_is_drawn_again(session: Session, viewings: list[Viewing]) -> None:
    for angle in range(ROUNDS):
        turn(viewings[0], 20 * angle)
        session.abort()
        wait_until(lambda: shows_its_scene(viewings[0]), "drawn after it was aborted")


def test_of_scripts_that_ask_at_once_the_last_gets_its_picture_and_the_others_are_told(
    session: Session, viewings: list[Viewing]
) -> None:
    scene = session.default_scene().with_(size=400)

    def finished(scene: Scene) -> bool:
        try:
            session.finish(scene)
        except FrameGivenUp:
            return False
        return True

    with ThreadPoolExecutor(4) as threads:
        turn(viewings[0], 5)
        assert any(threads.map(finished, [scene] * 4))
    wait_until(lambda: shows_its_scene(viewings[0]), "drawn after the scripts")


def test_what_scripts_ask_for_is_finished_beside_a_hand_that_never_rests(
    session: Session, viewings: list[Viewing]
) -> None:
    still = session.default_scene().with_(size=LARGE)
    expected = session.finish(still).published.pixels
    with ThreadPoolExecutor(1) as thread, never_at_rest(viewings[0]):
        assert np.array_equal(thread.submit(session.finish, still).result(PATIENCE).published.pixels, expected)
        refined = thread.submit(lambda: [image.step for image in session.refine(still) if image.complete])
        assert refined.result(PATIENCE) == [step for step in Step if step <= Step.F]


def test_a_viewport_is_refined_to_the_end_beside_a_hand_that_never_rests_in_another(
    session: Session, viewings: list[Viewing]
) -> None:
    moved, settled = viewings
    with never_at_rest(moved):
        settled.model.change(lambda scene: scene.with_(size=LARGE, rotation=(35, 5)))
        wait_until(lambda: shows_its_scene(settled), "refined beside a hand in another viewport")
    turn(moved, 15)
    wait_until(lambda: shows_its_scene(moved), "drawn once the hand rests")
    for viewing in viewings:
        check_bits(session, viewing)


def test_an_abort_frees_a_script_that_waits_for_a_hand(session: Session) -> None:
    with ThreadPoolExecutor(1) as thread, session.turn().taken(Urgency.MOVING):
        script = thread.submit(threading.current_thread).result(PATIENCE)
        waiting = thread.submit(session.finish, session.default_scene())
        wait_until(lambda: waits_for_turns(script), "waited for")
        session.abort()
        with pytest.raises(FrameGivenUp, match="aborted; ask again"):
            waiting.result(PATIENCE)


def test_a_script_that_is_interrupted_while_it_asks_holds_no_viewport_up(
    session: Session, viewings: list[Viewing]
) -> None:
    asked = logging.getLogger(asked_images.__name__)

    def interrupt(record: logging.LogRecord) -> bool:
        if threading.current_thread() is threading.main_thread():
            raise KeyboardInterrupt
        return True

    level = asked.level
    asked.setLevel(logging.INFO)
    asked.addFilter(interrupt)
    try:
        with pytest.raises(KeyboardInterrupt):
            session.finish(session.default_scene())
    finally:
        asked.removeFilter(interrupt)
        asked.setLevel(level)
    turn(viewings[0], 25)
    wait_until(lambda: shows_its_scene(viewings[0]), "drawn after a script was interrupted")
