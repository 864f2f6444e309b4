"""The page under the longer address of a proxy: everything in it is found, and nobody else is let in."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import HTMLResponse
from starlette.routing import Route

from support.pages import patient_http
from support.pages.browser import browser, browser_page, serving
from support.pages.page_tab import after, drag, opened
from support.pages.prefix_proxy import prefix_proxy
from support.pages.viewed import viewed
from support.programs.hand_started import free_port
from volsplat.client.ui.doors.admission import Admission, Admitted, Asked, Refused, Welcomed
from volsplat.client.ui.doors.behind_proxy import BehindProxy
from volsplat.client.ui.doors.page_policy import page_policy
from volsplat.client.ui.doors.peer_owner import PeerOwner
from volsplat.client.ui.doors.public_address import PublicAddress
from volsplat.client.ui.doors.strict_answers import ScriptNonces
from volsplat.protocol.text.errors import BadInput

if TYPE_CHECKING:
    from playwright.sync_api import Page

__all__ = ["browser", "browser_page"]

PREFIX = "/user/me/proxy/8123"
HUB = PublicAddress.of("https://Hub.example.org/user/me/proxy/8123/")


@pytest.mark.parametrize("cuts", [True, False], ids=["prefix cut", "prefix kept"])
def test_the_page_works_under_a_prefix(volume: Path, browser_page: Page, cuts: bool) -> None:
    page = browser_page
    page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    with prefix_proxy(PREFIX, cuts=cuts) as proxy:
        proxy.target = free_port()
        options = ("--workers", "1", "--port", str(proxy.target), "--behind", proxy.url)
        with viewed(volume.parent, volume, *options) as view:
            assert view.url.startswith(proxy.url)
            missing: list[str] = []
            asked: list[str] = []
            page.on("request", lambda request: asked.append(request.url))
            page.on("response", lambda answer: missing.append(answer.url) if answer.status >= 400 else None)
            opened(page, view.url)
            assert page.url == proxy.url
            after(page, lambda: drag(page, 40, 20))
            after(page, lambda: page.get_by_role("switch", name="diffuse").click())  # over NiceGUI's own socket
            page.get_by_role("button", name="save").click()
            page.get_by_text("copy a link").click()
            page.get_by_text("copied").wait_for()
            link = page.evaluate("() => navigator.clipboard.readText()")
            assert link.startswith(f"{proxy.url}?scene=")
            opened(page, link)
            assert page.url == proxy.url
            field = page.get_by_label("centre i")
            field.select_text()
            page.keyboard.type("north")
            page.get_by_text("“north” is not a number").wait_for()  # were its kind loaded anew, the text would be lost
            assert not any("/components/" in url for url in asked)
            assert (missing, proxy.outside) == ([], [])
            assert patient_http.get(proxy.url).status_code == 403  # without the token
            page.goto("about:blank")


def test_a_proxy_that_passes_no_sockets_on_is_named_and_the_first_picture_stays(
    volume: Path, browser_page: Page
) -> None:
    page = browser_page
    with prefix_proxy(PREFIX, cuts=True, buffers=True) as proxy:
        proxy.target = free_port()
        options = ("--workers", "1", "--port", str(proxy.target), "--behind", proxy.url)
        with viewed(volume.parent, volume, *options) as view:
            page.goto(view.url)
            page.get_by_text("no WebSocket gets through to it: a proxy in between must pass them on").wait_for()
            assert page.evaluate("() => window.volsplatViewport.canvas.width") > 0
            assert proxy.outside == []
            page.goto("about:blank")


async def a_page(request: Request) -> HTMLResponse:
    return HTMLResponse("<!doctype html><script></script>")


@pytest.mark.parametrize(
    ("url", "host", "sockets"),
    [
        ("https://hub.example.org/me/", "hub.example.org", "wss://hub.example.org"),
        ("https://my-hub.example.org:444/", "my-hub.example.org:444", "wss://my-hub.example.org:444"),
        ("http://hub.example.org/me/", "hub.example.org", "ws://hub.example.org"),
        ("https://hub.example.org/me/", "localhost:8123", "ws://localhost:8123"),
    ],
)
def test_sockets_are_allowed_as_the_browser_opens_them(url: str, host: str, sockets: str) -> None:
    """Where 'self' does not hold for sockets, the policy must name them."""
    behind = PublicAddress.of(url)
    admission = Admission(PeerOwner(None), behind)
    welcomed = ask(admission, host, query=f"token={admission.token}")
    assert isinstance(welcomed, Welcomed)
    admitted = ask(admission, host, cookie=welcomed.cookie.partition(";")[0])
    assert isinstance(admitted, Admitted)
    with serving(BehindProxy(ScriptNonces(Starlette(routes=[Route("/{path:path}", a_page)])), behind)) as base:
        page = patient_http.get(f"{base}/", headers={"Host": host})
    for policy in (page_policy("nonce", admitted.place), page.headers["content-security-policy"]):
        assert policy.endswith(f"; connect-src 'self' {sockets}")


def ask(admission: Admission, host: str, path: str = "/", query: str = "", **headers: str) -> object:
    said = [("host", host), *((name.replace("_", "-"), value) for name, value in headers.items())]
    return admission.judge(Asked("GET", path, query, said, ("127.0.0.1", 1), ("127.0.0.1", 2)))


def test_only_the_address_that_was_given_is_let_in_besides_this_machine() -> None:
    admission = Admission(PeerOwner(None), HUB)
    token = f"token={admission.token}"
    for path in ("/", f"{PREFIX}/"):
        welcomed = ask(admission, "hub.example.org", path, token)
        assert isinstance(welcomed, Welcomed) and welcomed.location == f"{PREFIX}/"
        cookie, _, rest = welcomed.cookie.partition(";")
    # Other users' servers lie on the same host, beside the prefix.
    assert cookie.startswith("volsplat-443=") and f"Path={PREFIX}/" in rest and "Secure" in rest
    assert isinstance(ask(admission, "hub.example.org", cookie=cookie), Admitted)
    assert isinstance(ask(admission, "hub.example.org", cookie=cookie, origin="https://hub.example.org"), Admitted)
    assert isinstance(ask(admission, "localhost:8123", "/", token), Welcomed)
    for host, origin in (
        ("hub.example.org", "http://hub.example.org"),
        ("hub.example.org", "https://elsewhere.example.org"),
        ("hub.example.org:444", "https://hub.example.org:444"),
        ("elsewhere.example.org", "https://elsewhere.example.org"),
    ):
        assert isinstance(ask(admission, host, cookie=cookie, origin=origin), Refused)
    assert isinstance(ask(Admission(PeerOwner(None)), "hub.example.org", "/", token), Refused)


def test_a_proxy_that_asks_by_another_name_is_told_of_and_of_which(caplog: pytest.LogCaptureFixture) -> None:
    admission = Admission(PeerOwner(None), HUB)
    for _ in range(3):  # scripts
        refused = ask(admission, "127.0.0.1:8123", "/volsplat/scripts/x.js", origin=HUB.origin)
    assert (
        isinstance(refused, Refused) and "asks for 127.0.0.1:8123, but the page is at hub.example.org" in refused.reason
    )
    assert [record.getMessage() for record in caplog.records] == [refused.reason]
    assert "another page" in getattr(
        ask(admission, "127.0.0.1:8123", origin="https://elsewhere.example.org"), "reason", ""
    )
    assert len(caplog.records) == 1


@pytest.mark.parametrize(
    "url",
    ["", "hub.example.org/user/me", "ftp://hub/x/", "https:///x/", "https://hub/x?y", "https://me@hub/", "http://h:x/"]
    + ["https://hub/a b/", "https://hub//x/", 'https://hub/"/', "https://hub/x/#y", "https://[::1/"],
)
def test_what_is_no_address_of_a_page_is_refused_in_words(url: str) -> None:
    with pytest.raises(BadInput, match="--behind .*give the page's address"):
        PublicAddress.of(url)
