"""Nothing of the page without its token."""

import socket
import threading
from collections.abc import Iterator

import httpx
import pytest
import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import PlainTextResponse
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from volsplat.client.ui.gate import Gate

TOKEN = "the-token-of-the-page"


async def secret(request: Request) -> PlainTextResponse:
    return PlainTextResponse("secret " + str(request.query_params))


async def secret_socket(websocket: WebSocket) -> None:
    await websocket.accept()
    await websocket.send_text("secret")
    await websocket.close()


@pytest.fixture(scope="module")
def port() -> Iterator[int]:
    """A guarded application on a port of this machine."""
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", 0))
        listening.listen()
        number = int(listening.getsockname()[1])
        application = Starlette(routes=[Route("/", secret), WebSocketRoute("/socket", secret_socket)])
        server = uvicorn.Server(uvicorn.Config(Gate(application, TOKEN, number), log_level="warning"))
        serving = threading.Thread(target=server.run, kwargs={"sockets": [listening]})
        serving.start()
        yield number
        server.should_exit = True
        serving.join()


@pytest.mark.parametrize("path", ["/", "/?token=", "/?token=wrong", "/?tokens=" + TOKEN, "/?token=" + TOKEN + "x"])
def test_a_request_without_the_token_gets_one_line_and_nothing_else(port: int, path: str) -> None:
    answer = httpx.get(f"http://127.0.0.1:{port}{path}")
    assert answer.status_code == 403
    assert "secret" not in answer.text and answer.text.count("\n") == 1
    assert not answer.cookies


def test_the_token_in_the_address_becomes_a_cookie_and_leaves_the_address(port: int) -> None:
    with httpx.Client(base_url=f"http://127.0.0.1:{port}") as client:
        answer = client.get("/?token=" + TOKEN + "&scene=abc")
        assert answer.status_code == 303
        assert answer.headers["location"] == "/?scene=abc"
        assert "HttpOnly" in answer.headers["set-cookie"] and "SameSite=strict" in answer.headers["set-cookie"]
        assert client.get("/?scene=abc").text == "secret scene=abc"


@pytest.mark.parametrize("cookie", ["volsplat-{port}=wrong", "other-{port}=" + TOKEN, "=;;=\xff", "volsplat-{port}"])
def test_a_wrong_or_malformed_cookie_opens_nothing(port: int, cookie: str) -> None:
    header = cookie.replace("{port}", str(port)).encode("latin-1")
    assert httpx.get(f"http://127.0.0.1:{port}/", headers=[(b"cookie", header)]).status_code == 403


def test_no_socket_is_opened_without_the_token(port: int) -> None:
    address = f"ws://127.0.0.1:{port}/socket"
    with pytest.raises(InvalidStatus) as refused:
        connect(address)
    assert refused.value.response.status_code == 403
    with connect(address, additional_headers={"Cookie": f"volsplat-{port}={TOKEN}"}) as opened:
        assert opened.recv() == "secret"
