"""A session that is started again, and what is told of it."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from random import Random
from threading import Event
from types import SimpleNamespace
from typing import Any, cast

import pytest

from support.patience import PATIENCE
from support.scenes.arbitrary import plain_scene
from volsplat.client.ui.viewing.restart import Restart
from volsplat.client.ui.viewing.scene_model import SceneModel
from volsplat.client.ui.viewing.trouble import Trouble
from volsplat.client.ui.viewing.viewing import Feed, Troubles, Viewing
from volsplat.protocol.text.errors import BadInput, PeerLost

ROUNDS = 100  # of what threads do at once


class Told:
    """A session of a volume, as far as it is asked."""

    def __init__(self, description: str, failure: PeerLost | None = None) -> None:
        self.volume = SimpleNamespace(description=description)
        self.failure = failure

    def close(self) -> None:
        self.failure = self.failure or PeerLost("the session is closed")


def ended(drawn: list[object]) -> Viewing:
    """A viewing whose session has ended; `drawn` gets what is drawn with next."""
    session = cast(Any, Told("as it was", PeerLost("gone")))
    model, loop = SceneModel(plain_scene()), cast(Any, SimpleNamespace(draw_with=drawn.append))
    return Viewing(session, model, loop, session.volume, model.scene, Feed(), Troubles(), "start it again")


def test_what_was_started_again_is_drawn_and_the_loss_is_over() -> None:
    drawn: list[object] = []
    viewing, again = ended(drawn), cast(Any, Told("as it was"))
    Restart(viewing, lambda say: again).start()
    assert drawn == [again] and viewing.session is again
    assert viewing.troubles.lasting is None


def test_a_file_that_was_saved_anew_is_to_be_opened_anew_not_started_again() -> None:
    drawn: list[object] = []
    viewing = ended(drawn)
    restart = Restart(viewing, lambda say: cast(Any, Told("saved anew")))
    for _ in range(2):
        restart.start()
        assert drawn == [] and viewing.troubles.lasting is not None
        told = viewing.troubles.lasting.text
        assert "save the scene, then open the file anew (O)" in told and "start it again" not in told


@pytest.fixture
def overtaking() -> Iterator[None]:
    """Threads give way to each other wherever they are."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    yield
    sys.setswitchinterval(before)


class SlowlyTold(Told):
    """Who asks whether it has ended may be overtaken before the answer is heard."""

    pauses = Random(0)

    def __getattribute__(self, name: str) -> Any:
        value = super().__getattribute__(name)
        if name == "failure":
            Event().wait(SlowlyTold.pauses.uniform(0.0, 0.002))
        return value


def test_of_two_that_ask_at_once_one_starts_it() -> None:
    for _ in range(ROUNDS):
        drawn: list[object] = []
        viewing = ended(drawn)
        viewing.session = cast(Any, SlowlyTold("as it was", PeerLost("gone")))
        restart = Restart(viewing, lambda say: cast(Any, Told("as it was")))
        with ThreadPoolExecutor(2) as tabs:
            for pressed in [tabs.submit(restart.start) for _ in range(2)]:
                pressed.result(PATIENCE)
        assert len(drawn) == 1


@pytest.mark.usefixtures("overtaking")
def test_what_a_session_says_as_its_start_ends_does_not_last() -> None:
    for _ in range(ROUNDS):
        viewing = ended([])
        with ThreadPoolExecutor(1) as coordinator:

            def opened(say: Callable[[str], None]) -> Any:
                speaking = Event()

                def speak() -> None:
                    for _ in range(20):
                        say("making voxel packets")
                        speaking.set()

                coordinator.submit(speak)
                assert speaking.wait(PATIENCE)
                return Told("as it was")

            Restart(viewing, opened).start()
        assert viewing.troubles.lasting is None


def test_why_it_cannot_be_started_again_lasts_with_its_cure() -> None:
    def gone(say: Callable[[str], None]) -> Any:
        say("surveying the volume")
        raise BadInput("/data/head.nrrd: no such file")

    drawn: list[object] = []
    viewing = ended(drawn)
    Restart(viewing, gone).start()
    assert viewing.troubles.lasting == Trouble("/data/head.nrrd: no such file; start it again", lasting=True)
