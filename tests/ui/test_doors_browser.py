"""What another page in the person's own browser can do to the page that `volsplat view` serves: nothing."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import HTMLResponse
from starlette.routing import Route

from support.pages import patient_http
from support.pages.browser import browser, patient_context, serving
from support.pages.viewed import FIRST, Viewed, viewed
from volsplat.client.phantoms import make_phantom
from volsplat.client.phantoms.volume_writer import write_volume
from volsplat.client.ui.application import LARGEST_FORM
from volsplat.client.ui.viewing.saving import LARGEST_UPLOAD

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

__all__ = ["browser"]

SHOWN = "() => window.volsplatViewport?.log.at(-1)?.last"


@pytest.fixture(scope="module")
def view(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Viewed]:
    path = tmp_path_factory.mktemp("volume") / "head.nrrd"
    write_volume(path, *make_phantom("head", (24, 32, 28)))
    with viewed(path.parent, path, "--workers", "1") as running:
        yield running


@pytest.fixture
def elsewhere(view: Viewed, browser: Browser) -> Iterator[Page]:
    """A tab with a page of another port, in a browser that may see the volume; cookies do not know ports."""
    heard: list[str] = []

    async def page(request: Request) -> HTMLResponse:
        heard.append(request.headers.get("cookie", ""))
        return HTMLResponse("<!doctype html><title>elsewhere</title>")

    elsewhere = Starlette(routes=[Route("/{path:path}", page)])
    with serving(elsewhere) as url, patient_context(browser) as context:
        tab = context.new_page()  # that the browser complains of what it tries is as it should be
        tab.goto(view.url)
        tab.wait_for_function(SHOWN)
        tab.goto(url)
        assert f"volsplat-{view.port}=" in heard[0]  # so it is, and this is why more is asked
        yield tab


def test_another_port_opens_no_socket(view: Viewed, elsewhere: Page) -> None:
    for path in ("viewport?tab=x", "_nicegui_ws/socket.io/?EIO=4&transport=websocket"):
        opened = elsewhere.evaluate(
            """(url) => new Promise((done) => {
                const socket = new WebSocket(url);
                socket.onopen = () => done(true);
                socket.onclose = () => done(false);
            })""",
            f"ws://127.0.0.1:{view.port}/{path}",
        )
        assert not opened


def test_another_port_reads_sends_and_embeds_nothing(view: Viewed, elsewhere: Page) -> None:
    base = f"http://127.0.0.1:{view.port}"
    for mode in ("cors", "no-cors"):
        for method in ("GET", "POST"):
            told = elsewhere.evaluate(
                """async ([url, mode, method]) => {
                    const answer = await fetch(url, { mode, method, credentials: "include" }).catch(() => null);
                    return answer === null ? "" : await answer.text();
                }""",
                [f"{base}/", mode, method],
            )
            assert told == ""
    loaded = elsewhere.evaluate(
        """(url) => new Promise((done) => {
            const script = Object.assign(document.createElement("script"), { src: url, type: "text/javascript" });
            script.onload = () => done(true);
            script.onerror = () => done(false);
            document.head.append(script);
        })""",
        f"{base}/volsplat/static/viewport/svg.js",
    )
    assert not loaded
    elsewhere.evaluate(
        "(url) => document.body.append(Object.assign(document.createElement('iframe'), { src: url }))", base
    )
    elsewhere.wait_for_function("() => frames.length === 1")
    elsewhere.wait_for_timeout(500)
    assert all(frame.locator("canvas").count() == 0 for frame in elsewhere.frames[1:])


def test_another_port_leads_to_no_scene(view: Viewed, elsewhere: Page) -> None:
    with elsewhere.expect_navigation():
        elsewhere.evaluate("(url) => { location.href = url; }", f"http://127.0.0.1:{view.port}/?scene=abc")
    assert "another page asked for this" in elsewhere.inner_text("body")
    elsewhere.goto(f"http://127.0.0.1:{view.port}/")  # the person does it
    elsewhere.wait_for_function(SHOWN)


def test_a_link_to_a_scene_in_a_chat_is_opened_by_one_more_click(view: Viewed, elsewhere: Page) -> None:
    # Another name of this host is another site, to which a browser gives no strict cookie.
    elsewhere.goto(elsewhere.url.replace("127.0.0.1", "localhost"))
    with elsewhere.expect_navigation():
        elsewhere.evaluate("(url) => { location.href = url; }", f"http://127.0.0.1:{view.port}/?scene={FIRST}")
    assert "another page asked for this; open the address yourself" in elsewhere.inner_text("body")
    elsewhere.get_by_role("link", name="open it").click()
    elsewhere.wait_for_function(SHOWN)


def test_markup_that_finds_its_way_into_the_page_runs_nothing(view: Viewed, browser: Browser) -> None:
    with patient_context(browser) as context:
        page = context.new_page()
        page.goto(view.url)
        page.wait_for_function(SHOWN)
        ran = page.evaluate(
            """async () => {
                const told = [];
                document.addEventListener("securitypolicyviolation", (event) => told.push(event.effectiveDirective));
                const host = document.createElement("div");
                host.innerHTML = '<img src="data:," onerror="window.ran = true">';
                document.body.append(host);
                const script = document.createElement("script");
                document.body.append(Object.assign(script, { textContent: "window.ran = true" }));
                while (told.length < 2) await new Promise((done) => setTimeout(done, 20));
                return window.ran ?? false;
            }"""
        )
    assert not ran


def test_the_server_shows_no_catalogue_and_takes_no_more_than_an_upload(view: Viewed) -> None:
    base = f"http://127.0.0.1:{view.port}"
    with patient_http.Client(base_url=base, headers={"Cookie": view.cookie}) as client:
        for path in ("/docs", "/redoc", "/openapi.json", "/docs/oauth2-redirect"):
            assert client.get(path).status_code == 404
        for path in ("/", "/_nicegui/client/x/upload/1", "/_nicegui_ws/socket.io/?EIO=4&transport=polling&sid=x"):
            assert client.post(path, content=b"x" * (LARGEST_UPLOAD + LARGEST_FORM + 1)).status_code == 413
            pieces = (b"x" * 2**20 for _ in range(2 + LARGEST_UPLOAD // 2**20))
            assert client.post(path, content=pieces).status_code == 413
        page = client.get("/")
        assert "'unsafe-inline'" not in page.headers["content-security-policy"].partition("style-src")[0]
        assert "server" not in page.headers
