"""What a thread tells the page while the page's event loop ends."""

import asyncio
from typing import Any

from volsplat.client.ui.viewing.trouble import Trouble
from volsplat.client.ui.viewing.viewing import Feed, Troubles


class EndsMeanwhile(asyncio.SelectorEventLoop):
    """Closed by another thread at the worst moment: when it has been looked at, and before it is called."""

    def call_soon_threadsafe(self, *args: Any, **options: Any) -> asyncio.Handle:  # type: ignore[override]
        self.close()
        return super().call_soon_threadsafe(*args, **options)


def test_who_tells_a_loop_that_is_being_closed_goes_on() -> None:
    feed: Feed[str] = Feed()
    feed.attach(EndsMeanwhile())
    feed.tell("a picture")
    feed.tell("another one")
    assert feed.newest is None


def test_a_trouble_that_lasts_stays_while_others_pass_until_it_is_over() -> None:
    troubles = Troubles()
    lost = Trouble("a server was lost; save the scene", lasting=True)
    troubles.tell(lost)
    troubles.tell(Trouble("no such bounds"))
    assert (troubles.lasting, troubles.newest) == (lost, Trouble("no such bounds"))
    troubles.tell_end("the picture is whole again")
    assert (troubles.lasting, troubles.newest) == (None, Trouble("the picture is whole again"))
