"""What the browser is told to refuse on the page's behalf: foreign scripts, frames, guesses at types, and copies.

NiceGUI compiles its templates in the browser (Vue) and sends code to run, which takes 'unsafe-eval'; scripts in the
page itself must carry a nonce, so that markup which is put into the page in the browser runs nothing. (What a page is
served with gets the nonce, whoever wrote it: NiceGUI escapes what it is given.) Quasar sets styles inline.
"""

from __future__ import annotations

import re

from volsplat.client.ui.doors.public_address import PublicAddress

HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
}
NOTHING = "default-src 'none'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
"""The policy of every answer that is no page."""

_HOST_IN_A_POLICY = re.compile(r"[\w.-]+(?::[0-9]+)?")  # no IPv6 address can stand in one


def page_policy(nonce: str, place: PublicAddress) -> str:
    """For a page that the browser has at that place, and whose scripts carry the nonce."""
    # That 'self' holds for sockets as well is younger than some browsers.
    scheme = "wss" if place.encrypted else "ws"
    sockets = f" {scheme}://{place.host}" if _HOST_IN_A_POLICY.fullmatch(place.host) else ""
    return (
        f"{NOTHING}; script-src 'self' 'nonce-{nonce}' 'unsafe-eval'; style-src 'self' 'unsafe-inline'; "
        f"img-src 'self' data: blob:; font-src 'self'; connect-src 'self'{sockets}"
    )
