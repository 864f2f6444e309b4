"""Nothing of the page for strangers, for other pages in the person's browser, and for other hosts' names."""

from __future__ import annotations

import os
import re
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from dataclasses import dataclass

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

from support.pages import patient_http
from support.patience import PATIENCE
from volsplat.client.ui.doors.admission import Admission, Asked, Refused
from volsplat.client.ui.doors.gate import Gate
from volsplat.client.ui.doors.peer_owner import PeerOwner
from volsplat.client.ui.doors.strict_answers import StrictHeaders
from volsplat.client.ui.doors.tcp_sockets import tcp_sockets

LARGEST = 1000


async def secret(request: Request) -> PlainTextResponse:
    return PlainTextResponse(f"secret {request.query_params} {len(await request.body())}")


async def secret_socket(websocket: WebSocket) -> None:
    await websocket.accept()
    await websocket.send_text("secret")
    await websocket.close()


@dataclass(frozen=True)
class Guarded:
    """A guarded application on a port of this machine."""

    port: int
    admission: Admission

    @property
    def base(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    def cookie(self, port: int | None = None) -> str:
        """What a browser has once the token was given, for a port that it may see in place of the real one."""
        host = {"Host": f"localhost:{port or self.port}"}
        answer = patient_http.get(f"{self.base}/?token={self.admission.token}", headers=host)
        return answer.headers["set-cookie"].partition(";")[0]

    def ask(self, method: str = "GET", path: str = "/", body: bytes = b"", **headers: str) -> httpx.Response:
        """With the cookie unless one is given; an underscore in a header's name stands for a hyphen."""
        named = {name.replace("_", "-"): value for name, value in ({"cookie": self.cookie()} | headers).items()}
        return patient_http.request(method, f"{self.base}{path}", headers=named, content=body)


@pytest.fixture(scope="module")
def guarded() -> Iterator[Guarded]:
    with socket.create_server(("127.0.0.1", 0)) as listening:
        admission = Admission()
        application = Starlette(
            routes=[Route("/", secret, methods=["GET", "POST"]), WebSocketRoute("/socket", secret_socket)]
        )
        strict = StrictHeaders(Gate(application, admission, LARGEST), {"/kept": "no-cache"})
        server = uvicorn.Server(uvicorn.Config(strict, log_level="warning", proxy_headers=False))
        serving = threading.Thread(target=server.run, kwargs={"sockets": [listening]})
        serving.start()
        yield Guarded(int(listening.getsockname()[1]), admission)
        server.should_exit = True
        serving.join()


def refused(answer: httpx.Response, status: int = 403) -> bool:
    return answer.status_code == status and "secret" not in answer.text and answer.text.count("\n") == 1


# -- the token


@pytest.mark.parametrize("query", ["", "?token=", "?token=wrong", "?tokens={token}", "?token={token}x", "?token=%ff"])
def test_a_request_without_the_token_gets_one_line_and_nothing_else(guarded: Guarded, query: str) -> None:
    answer = patient_http.get(f"{guarded.base}/" + query.replace("{token}", guarded.admission.token))
    assert refused(answer) and not answer.cookies


def test_the_token_in_the_address_becomes_a_cookie_that_is_another_secret(guarded: Guarded) -> None:
    with patient_http.Client(base_url=guarded.base) as client:
        answer = client.get(f"/?token={guarded.admission.token}&scene=abc")
        assert answer.status_code == 303
        assert answer.headers["location"] == "/?scene=abc"
        assert "HttpOnly" in answer.headers["set-cookie"] and "SameSite=strict" in answer.headers["set-cookie"]
        assert guarded.admission.token not in answer.headers["set-cookie"]
        assert client.get("/?scene=abc").text == "secret scene=abc 0"
        assert client.get(f"/?token={guarded.admission.token}").status_code == 303  # as often as the person likes


def test_a_token_for_once_opens_once_and_says_so(guarded: Guarded) -> None:
    used: list[bool] = []
    token = guarded.admission.token_for_once(lambda: used.append(True))
    with patient_http.Client(base_url=guarded.base) as client:
        assert client.head(f"/?token={token}").status_code == 403 and not used  # what looks ahead uses nothing up
        # A browser that comes from a file would keep a strict cookie back from a redirection.
        answer = client.get(f"/?token={token}&scene=abc", headers={"Sec-Fetch-Site": "cross-site"})
        assert answer.status_code == 200 and "url=/?scene=abc" in answer.text and "secret" not in answer.text
        assert used == [True]
        assert client.get("/").text.startswith("secret")
    assert refused(patient_http.get(f"{guarded.base}/?token={token}"))


def test_a_welcome_leads_nowhere_else(guarded: Guarded) -> None:
    answer = patient_http.get(f"{guarded.base}//elsewhere.example/?token={guarded.admission.token}")
    assert answer.headers["location"] == "/elsewhere.example/"


def test_no_token_is_asked_twice_by_two_at_once() -> None:
    admission, used = Admission(), []
    token = admission.token_for_once(lambda: used.append(True))
    asked = Asked("GET", "/", f"token={token}", [("host", "localhost")], ("", 0), ("", 0))
    admission._peers = PeerOwner(None)
    verdicts: list[bool] = []
    threads = [
        threading.Thread(target=lambda: verdicts.append(isinstance(admission.judge(asked), Refused))) for _ in range(20)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(verdicts) == [False] + [True] * 19 and used == [True]


# -- the cookie


@pytest.mark.parametrize("cookie", ["{name}=wrong", "other-{given}", "=;;=\xff", "{name}", "{name}={token}"])
def test_a_wrong_or_malformed_cookie_opens_nothing(guarded: Guarded, cookie: str) -> None:
    given = guarded.cookie()
    name = given.partition("=")[0]
    header = cookie.format(name=name, given=given, token=guarded.admission.token).encode("latin-1")
    assert refused(patient_http.get(guarded.base, headers=[(b"cookie", header)]))


@pytest.mark.parametrize("beside", ['theme={"dark":true}', 'x="', "a b", "bare", "n=\xe9"])
def test_what_other_programs_of_this_host_keep_beside_the_cookie_shuts_nobody_out(
    guarded: Guarded, beside: str
) -> None:
    given = guarded.cookie()
    for header in (f"{beside}; {given}", f"{given}; {beside}"):
        assert patient_http.get(guarded.base, headers=[(b"cookie", header.encode("latin-1"))]).text.startswith("secret")


def test_two_pages_forwarded_to_one_machine_do_not_overwrite_each_others_cookies(guarded: Guarded) -> None:
    first, second = guarded.cookie(8123), guarded.cookie(8124)
    assert first.partition("=")[0] == "volsplat-8123" and second.partition("=")[0] == "volsplat-8124"
    both = f"{first}; {second}"
    assert guarded.ask(cookie=both, host="localhost:8124").text.startswith("secret")
    assert refused(guarded.ask(cookie=first, host="localhost:8124"))


# -- whose name and whose page


@pytest.mark.parametrize("host", ["evil.example", "evil.example:{port}", "localhost.evil.example", "192.168.1.5", ""])
def test_another_name_for_this_host_opens_nothing(guarded: Guarded, host: str) -> None:
    host = host.replace("{port}", str(guarded.port))
    assert refused(guarded.ask(host=host, cookie=guarded.cookie()))
    assert refused(guarded.ask(path=f"/?token={guarded.admission.token}", host=host))


def test_two_names_open_nothing(guarded: Guarded) -> None:
    asked = (
        f"GET / HTTP/1.1\r\nHost: localhost:{guarded.port}\r\nHost: evil.example\r\nCookie: {guarded.cookie()}\r\n\r\n"
    )
    with socket.create_connection(("127.0.0.1", guarded.port)) as raw:
        raw.sendall(asked.encode())
        assert raw.recv(1 << 16).split()[1] in (b"400", b"403")


@pytest.mark.parametrize("host", ["localhost", "127.0.0.1", "[::1]", "LOCALHOST"])
def test_a_forwarded_port_has_another_number(guarded: Guarded, host: str) -> None:
    cookie = guarded.cookie(4711)
    assert guarded.ask(cookie=cookie, host=f"{host}:4711").text.startswith("secret")
    assert guarded.ask("POST", cookie=cookie, host=f"{host}:4711", origin=f"http://{host}:4711").status_code == 200


FOREIGN = ["http://evil.example", "http://127.0.0.1:1", "null", "https://127.0.0.1:{port}", "http://localhost:{port}"]


@pytest.mark.parametrize("origin", FOREIGN)
def test_another_page_moves_nothing(guarded: Guarded, origin: str) -> None:
    origin = origin.replace("{port}", str(guarded.port))
    for method in ("GET", "POST"):
        assert refused(guarded.ask(method, origin=origin))
    headers = {"Cookie": guarded.cookie(), "Origin": origin}
    with pytest.raises(InvalidStatus) as raised:
        connect(f"ws://127.0.0.1:{guarded.port}/socket", additional_headers=headers)
    assert raised.value.response.status_code == 403


@pytest.mark.parametrize("site", ["cross-site", "same-site"])
def test_another_page_embeds_nothing_and_leads_to_no_scene(guarded: Guarded, site: str) -> None:
    assert refused(guarded.ask(path="/?scene=abc", sec_fetch_site=site))
    assert guarded.ask(path="/?scene=abc", sec_fetch_site="none").text.startswith("secret")
    assert guarded.ask(path="/?scene=abc", sec_fetch_site="same-origin").text.startswith("secret")


@pytest.mark.parametrize("path", ["/?scene=abc", "//evil.example/?scene=abc", '/"><script>x</script>?scene=a"b'])
def test_a_link_that_was_followed_from_elsewhere_waits_for_the_person_on_this_host(guarded: Guarded, path: str) -> None:
    navigation = {"Sec-Fetch-Site": "cross-site", "Sec-Fetch-Mode": "navigate", "Sec-Fetch-Dest": "document"}
    for cookie in ({}, {"Cookie": guarded.cookie()}):
        answer = patient_http.get(f"{guarded.base}{path}", headers=navigation | cookie)
        assert (
            answer.status_code == 403 and "another page asked for this" in answer.text and "secret" not in answer.text
        )
        (link,) = re.findall('href="([^"]*)"', answer.text)
        assert re.match("/(?!/)", link) and "<script" not in answer.text


def test_sockets_open_with_the_cookie_and_for_this_page_alone(guarded: Guarded) -> None:
    address = f"ws://127.0.0.1:{guarded.port}/socket"
    for headers in ({}, {"Origin": guarded.base}, {"Cookie": guarded.cookie(), "Host": "evil.example"}):
        with pytest.raises(InvalidStatus) as raised:
            connect(address, additional_headers=headers)
        assert raised.value.response.status_code in (400, 403)
    with pytest.raises(InvalidStatus):  # the token is for a page
        connect(f"{address}?token={guarded.admission.token}")
    for headers in ({}, {"Origin": guarded.base}):  # a script says no origin, and has the cookie
        with connect(address, additional_headers={"Cookie": guarded.cookie(), **headers}) as opened:
            assert opened.recv() == "secret"


# -- whose process


def test_the_sockets_of_a_port_are_those_that_have_it() -> None:
    if not list(tcp_sockets()):
        pytest.skip("this system does not tell whose sockets are (no /proc/net/tcp)")
    with socket.create_server(("127.0.0.1", 0)) as listening, socket.create_connection(listening.getsockname()) as ours:
        for one in (listening, ours):
            host, port = one.getsockname()
            found = list(tcp_sockets(port))
            assert (host, port) in [each.local for each in found]
            assert {each.local[1] for each in found} == {port}


def test_a_socket_is_known_by_both_of_its_ends() -> None:
    if not list(tcp_sockets()):
        pytest.skip("this system does not tell whose sockets are (no /proc/net/tcp)")
    for host, family in (("127.0.0.1", socket.AF_INET), ("::ffff:127.0.0.1", socket.AF_INET6)):
        with socket.create_server(("127.0.0.1", 0)) as listening, socket.socket(family) as ours:
            here = listening.getsockname()
            ours.connect((host, here[1]))
            peer = ("127.0.0.1", ours.getsockname()[1])
            assert not PeerOwner(os.getuid()).is_stranger(peer, here)
            assert not PeerOwner(None).is_stranger(peer, here)
            if os.getuid() != 0:
                assert PeerOwner(os.getuid() + 1).is_stranger(peer, here)
            ours.close()
            assert PeerOwner(os.getuid()).is_stranger(peer, here)


@pytest.mark.skipif(os.getuid() != 0, reason="only root can become another user")
def test_another_user_with_the_token_sees_nothing() -> None:
    nobody = 65534
    asks = (
        "import encodings.idna, os, socket; os.setuid({}); s = socket.socket(); s.connect(('127.0.0.1', {})); s.recv(1)"
    )
    with socket.create_server(("127.0.0.1", 0)) as listening:
        here = listening.getsockname()
        listening.settimeout(PATIENCE)
        with subprocess.Popen([sys.executable, "-I", "-S", "-c", asks.format(nobody, here[1])]):
            connection, peer = listening.accept()
            with connection:
                for own, stranger in ((4711, True), (nobody, False)):
                    admission = Admission(PeerOwner(own))
                    headers = [("host", f"localhost:{here[1]}")]
                    verdict = admission.judge(Asked("GET", "/", f"token={admission.token}", headers, peer, here))
                    assert isinstance(verdict, Refused) == stranger


# -- what is asked for and what is answered


@pytest.mark.parametrize("method", ["PUT", "DELETE", "OPTIONS", "PATCH", "TRACE"])
def test_other_methods_do_nothing(guarded: Guarded, method: str) -> None:
    assert refused(guarded.ask(method), 405)


def test_a_body_has_its_limit_told_or_not(guarded: Guarded) -> None:
    assert guarded.ask("POST", body=b"x" * LARGEST).text == f"secret  {LARGEST}"
    assert refused(guarded.ask("POST", body=b"x" * (LARGEST + 1)), 413)
    assert refused(
        patient_http.post(guarded.base, headers={"Cookie": guarded.cookie()}, content=(b"x" for _ in range(2000))), 413
    )
    assert refused(patient_http.post(guarded.base, content=b"x" * (LARGEST + 1)))  # unread


def test_every_answer_is_for_this_page_alone(guarded: Guarded) -> None:
    answers = [
        patient_http.get(guarded.base),
        patient_http.get(f"{guarded.base}/?token={guarded.admission.token}"),
        guarded.ask(),
    ]
    for answer in answers:
        assert answer.headers["x-content-type-options"] == "nosniff"
        assert answer.headers["referrer-policy"] == "no-referrer"
        assert answer.headers["cross-origin-resource-policy"] == "same-origin"
        assert answer.headers["cache-control"] == "no-store"
        assert "default-src 'none'" in answer.headers["content-security-policy"]
        assert "frame-ancestors 'none'" in answer.headers["content-security-policy"]
        assert "access-control-allow-origin" not in answer.headers
    assert guarded.ask(path="/kept/absent").headers["cache-control"] == "no-cache"
