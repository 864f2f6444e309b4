"""The page in the browser, served by a script until the person is done with it."""

from __future__ import annotations

import socket
from contextlib import nullcontext, suppress

from volsplat.client.session.session import Session
from volsplat.client.ui.application import Application
from volsplat.client.ui.doors.browser_tab import BrowserTab
from volsplat.client.ui.doors.page_address import PageAddress
from volsplat.client.ui.opening.shown_volume import ShownVolume
from volsplat.client.ui.page import page
from volsplat.client.ui.viewing.opened_viewing import opened_viewing
from volsplat.protocol.description.scene import Scene
from volsplat.protocol.text.errors import BadInput
from volsplat.protocol.wire.addresses import LOOPBACK


def show_page(session: Session, scene: Scene, port: int, browser: bool, grace: float, lent: bool = False) -> None:
    """Serve it at a port of this machine, or at any free one for 0, until Ctrl-C; ends a session that is not `lent`."""
    with socket.socket() as bound:
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            bound.bind((LOOPBACK, port))
        except (OSError, OverflowError, TypeError) as error:
            raise BadInput(f"port={port}: {error}; choose another one, or leave it out") from None
        address = PageAddress(bound)
        name = session.volume.description.name
        with BrowserTab(address, name) if browser else nullcontext() as tab:

            def ready() -> None:
                print(f"{name} is at {address.url}", flush=True)

            if tab is not None:
                tab.make_room()
            with suppress(KeyboardInterrupt):  # which is how a person is done with it
                viewing = opened_viewing(session, scene)
                Application(ShownVolume(viewing, lent=lent), lambda: page(viewing), address, grace).run(ready)
